"""The stages, against NumPy by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import winze
from conftest import pose_error


def test_voxels_are_means_of_their_points(wall):
    thinned = winze.voxel_downsample(wall, 0.5)
    cells = np.floor(wall / 0.5).astype(int)
    keys, inverse = np.unique(cells[:, ::-1], axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    means = np.column_stack([np.bincount(inverse, wall[:, a]) for a in range(3)])
    means /= np.bincount(inverse)[:, None]
    assert thinned.shape == means.shape == (len(keys), 3)
    assert np.abs(thinned - means).max() < 1e-5
    cloud = winze.voxel_downsample(winze.Cloud(wall, intensity=np.ones(4000)), 0.5)
    assert isinstance(cloud, winze.Cloud) and (cloud.intensity == 1).all()
    for wrong in (0, -1, np.nan, np.inf):
        with pytest.raises(ValueError, match="voxel"):
            winze.voxel_downsample(wall, wrong)
    for wrong in ("0.5", None, [0.5], True):
        with pytest.raises(TypeError, match="voxel"):
            winze.voxel_downsample(wall, wrong)
    with pytest.raises(ValueError, match="voxel"):
        winze.voxel_downsample(wall, 10**400)


def brute_statistical(points: np.ndarray, k: int, deviations: float) -> np.ndarray:
    distances = np.sort(np.linalg.norm(points[:, None] - points[None], axis=2), axis=1)[:, 1 : k + 1]
    mean = distances.mean(1)
    return np.flatnonzero(mean <= mean.mean() + deviations * mean.std(ddof=1))


def test_outliers_go(wall):
    points = wall[::4].copy()
    points[17] = [4, 4, 5]
    kept = winze.remove_outliers(points, return_indices=True)
    assert np.array_equal(kept, brute_statistical(points, 12, 3.0))
    assert 17 not in kept
    assert np.array_equal(winze.remove_outliers(points), points[kept])
    utm = points + [500_000.123456789, 4_500_000, 0]
    cleaned = winze.remove_outliers(utm)
    assert np.isin(cleaned, utm).all(), "rows as they are"
    config = winze.PrepareConfig(statistical_neighbours=0, radius_neighbours=3, outlier_radius=0.6)
    near = (np.linalg.norm(points[:, None] - points[None], axis=2) <= 0.6).sum(1) - 1
    got = winze.remove_outliers(points, config=config, return_indices=True)
    assert np.array_equal(got, np.flatnonzero(near >= 3))


def test_rows_that_are_no_points_keep_their_place(wall):
    holes = wall.copy()
    holes[[0, 100, 3999]] = np.nan
    whole = np.delete(wall, [0, 100, 3999], axis=0)
    kept = winze.remove_outliers(holes, 0.2, return_indices=True)
    assert np.array_equal(holes[kept], whole[winze.remove_outliers(whole, 0.2, return_indices=True)])
    normals = winze.estimate_normals(holes, 0.2)
    assert (normals[[0, 100, 3999]] == 0).all()
    assert np.array_equal(np.delete(normals, [0, 100, 3999], axis=0), winze.estimate_normals(whole, 0.2))
    found = winze.iss_keypoints(holes, 0.2)
    assert np.array_equal(holes[found.indices], whole[winze.iss_keypoints(whole, 0.2).indices])
    described = winze.fpfh(holes, normals, found, 0.2)
    of_whole = winze.fpfh(whole, winze.estimate_normals(whole, 0.2), winze.iss_keypoints(whole, 0.2), 0.2)
    assert np.array_equal(described, of_whole)
    assert (winze.fpfh(holes, normals, [100], 0.2) == 0).all()


def test_a_cloud_counts_its_own_points(wall):
    holes = wall.copy()
    holes[[0, 100, 3999]] = np.nan
    cloud = winze.Cloud(holes)
    assert winze.estimate_normals(cloud, 0.2).shape == cloud.points.shape == (3997, 3)
    assert winze.estimate_normals(cloud, 0.2, viewpoint=[0, 0, 9]).shape == (3997, 3)
    kept = winze.remove_outliers(cloud, 0.2, return_indices=True)
    assert np.array_equal(winze.remove_outliers(cloud, 0.2).points, cloud.points[kept])
    found = winze.iss_keypoints(cloud, 0.2)
    assert found.indices.max() < 3997
    assert len(winze.fpfh(cloud, winze.estimate_normals(cloud, 0.2), found, 0.2)) == len(found.indices)
    assert winze.ransac(cloud, cloud, [[0, 0], [9, 9], [700, 700]], 0.2).samples > 0


@pytest.mark.parametrize("few", [[], [[1.0, 2.0, 3.0]], [[1.0, 2.0, 3.0]] * 5])
def test_too_few_points_are_no_error(few):
    points = np.reshape(few, (-1, 3))
    assert winze.remove_outliers(points).shape == points.shape
    assert (winze.estimate_normals(points) == 0).all()
    assert len(winze.iss_keypoints(points).indices) <= len(points)


def test_normals_are_those_of_the_covariance(wall):
    points = wall[:2000]
    config = winze.PrepareConfig(normal_radius=0.0, normal_least=0, normal_most=20)
    normals = winze.estimate_normals(points, config=config, viewpoint=[4, 4, 50])
    assert normals.dtype == np.float32 and normals.shape == points.shape
    for i in range(0, 2000, 97):
        nearest = points[np.argsort(np.linalg.norm(points - points[i], axis=1))[:20]]
        expected = np.linalg.eigh(np.cov(nearest.T))[1][:, 0]
        assert abs(expected @ normals[i]) > 0.9999
    assert (normals[:, 2] > 0).all(), "towards the viewpoint"
    below = winze.Cloud(points, viewpoint=[4, 4, -50])
    below = winze.estimate_normals(below, config=dataclasses.replace(config, orientation="auto"))
    assert np.array_equal(below, -normals)
    line = np.column_stack([np.arange(30.0), np.zeros(30), np.zeros(30)])
    assert (winze.estimate_normals(line) == 0).all()


def test_spacing_and_voxel(wall, demo):
    grid = np.stack(np.meshgrid(*[np.arange(12) * 0.25] * 3), -1).reshape(-1, 3)
    assert winze.spacing(grid) == pytest.approx(0.25)
    with pytest.raises(ValueError, match="no two"):
        winze.spacing([[1, 2, 3]] * 5)
    assert 0.05 < winze.choose_voxel(demo[0], demo[1]) < 1.0
    with pytest.raises(ValueError, match="query"):
        winze.choose_voxel(demo[0], [[1, 2, 3]] * 5)


def test_keypoints_and_descriptors(wall):
    surface = winze.prepare(wall, 0.3)
    assert surface.voxel == 0.3 and len(surface) == len(surface.points) == len(surface.normals)
    found = winze.iss_keypoints(surface, config=winze.IssConfig(min_keypoints=50))
    assert (np.diff(found.indices) > 0).all() and len(found.saliency) == len(found.indices) >= 50
    of_array = winze.iss_keypoints(surface.points, 0.3, winze.IssConfig(min_keypoints=50))
    assert np.array_equal(of_array.indices, found.indices)
    described = winze.fpfh(surface, keypoints=found)
    assert described.shape == (len(found.indices), 33) and described.dtype == np.float32
    sums = described.reshape(-1, 3, 11).sum(2)
    assert np.allclose(sums[sums > 0], 100, atol=0.01) or np.allclose(sums[sums > 0], 200, atol=0.01)
    for normals in (surface.normals, surface.normals.astype(">f8"), np.asfortranarray(surface.normals)):
        again = winze.fpfh(surface.points, normals, found.indices, 0.3)
        # Neighbours of equal distance may be summed in another order.
        assert np.abs(again - described).max() < 1e-3
    assert np.array_equal(winze.fpfh(surface)[found.indices], described)
    with pytest.raises(ValueError, match="normals"):
        winze.fpfh(surface.points)
    with pytest.raises(ValueError, match="normals"):
        winze.fpfh(surface.points, surface.normals[:-1])
    for wrong in ([-1], [len(surface)]):
        with pytest.raises(ValueError, match="keypoints"):
            winze.fpfh(surface, keypoints=wrong)
    with pytest.raises(TypeError, match="keypoints"):
        winze.fpfh(surface, keypoints=[0.5])


def test_matches_are_the_nearest(wall):
    rng = np.random.default_rng(5)
    query, other = rng.uniform(0, 100, (40, 33)), rng.uniform(0, 100, (60, 33)).astype(np.float32)
    found = winze.match_features(other, query, winze.MatchingConfig(mutual=False))
    distances = np.linalg.norm(query.astype(np.float32)[:, None] - other[None], axis=2)
    assert np.array_equal(found.pairs[:, 0], np.arange(40))
    assert np.array_equal(found.pairs[:, 1], distances.argmin(1))
    assert np.allclose(found.distances, distances.min(1), rtol=1e-5)
    mutual = winze.match_features(np.asfortranarray(other), query)
    assert all(distances[:, m].argmin() == q for q, m in mutual.pairs)
    with pytest.raises(ValueError, match="33"):
        winze.match_features(other, query[:, :32])


def test_sampling_finds_the_pose(wall):
    rng = np.random.default_rng(5)
    truth = np.eye(4)
    angle = 2.1
    truth[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    truth[:3, 3] = [400_000, 5_000_000, -20]
    query = wall[rng.permutation(4000)[:200]]
    target = query @ truth[:3, :3].T + truth[:3, 3]
    pairs = np.column_stack([np.arange(200), np.arange(200)])
    pairs[100:, 1] = rng.permutation(200)[100:]
    pairs = pairs[rng.permutation(200)]
    config = winze.RansacConfig(min_samples=2000, max_samples=20_000)
    estimate = winze.ransac(target, query, pairs, 0.2, config, seed=4)
    best = estimate.hypotheses[0]
    distance, degrees = pose_error(best.map_from_query, truth, query.mean(0))
    assert distance < 0.01 and degrees < 0.1 and best.inliers >= 100 and best.rmse < 0.01
    again = winze.ransac(target, query, pairs, 0.2, config, seed=4, threads=1)
    assert again.hypotheses[0].map_from_query.tobytes() == best.map_from_query.tobytes()
    assert again.samples == estimate.samples
    assert winze.ransac(target, query, np.zeros((0, 2), int), 0.2).hypotheses == []
    for wrong in ([[0, 200]], [[-1, 0]]):
        with pytest.raises(ValueError, match="correspondences"):
            winze.ransac(target, query, wrong, 0.2)
    with pytest.raises(ValueError, match="correspondences"):
        winze.ransac(target, query, [[0, 1, 2]], 0.2)


def test_refiners_come_home(demo):
    map_cloud, query, truth = demo
    start = truth.copy()
    start[:3, 3] += [0.15, -0.1, 0.05]
    surfaces = winze.prepare(map_cloud, 0.2), winze.prepare(query, 0.2)
    for refine in (winze.ndt, lambda *a, **k: winze.icp(*a, config=winze.IcpConfig(metric="point-to-plane"), **k)):
        refined = refine(*surfaces, start)
        assert pose_error(refined.map_from_query, truth, query.points.mean(0))[0] < 0.03
        assert refined.pairs > 1000 and refined.iterations > 1
        assert refined.information.shape == (6, 6) and refined.about.shape == (3,)
        of_points = refine(map_cloud.points, np.asfortranarray(query.points), start, 0.2)
        assert of_points.map_from_query.tobytes() == refined.map_from_query.tobytes()
    # A surface and points: these are prepared at the surface's size.
    mixed = winze.icp(surfaces[0], query, start)
    assert mixed.map_from_query.tobytes() == winze.icp(*surfaces, start).map_from_query.tobytes()
    nowhere = start.copy()
    nowhere[:3, 3] += 900
    assert winze.icp(*surfaces, nowhere).stop == winze.ndt(*surfaces, nowhere).stop == "too_few_pairs"
    with pytest.raises(ValueError, match="0.2 m and 0.3 m"):
        winze.icp(*surfaces, start, 0.3)
    with pytest.raises(TypeError, match="Map"):
        winze.icp(winze.Map.build(map_cloud), query, start)


def test_inliers_are_counted(wall):
    pose = np.eye(4)
    pose[2, 3] = 0.25
    fraction, rmse = winze.inliers(wall[:500], wall[:100], pose, 0.26)
    nearest = np.linalg.norm(wall[None, :500] - (wall[:100] + [0, 0, 0.25])[:, None], axis=2).min(1)
    assert fraction == pytest.approx((nearest < 0.26).mean())
    assert rmse == pytest.approx(np.sqrt((nearest[nearest < 0.26] ** 2).mean()), rel=1e-4)
    assert winze.inliers(wall, [[900, 0, 0]], np.eye(4)) == (0.0, None)
    with pytest.raises(ValueError, match="distance"):
        winze.inliers(wall, wall, np.eye(4), 0)


def test_stages_do_not_depend_on_threads(demo):
    cloud = demo[0]
    for call in (
        lambda t: winze.voxel_downsample(cloud.points, 0.3, threads=t),
        lambda t: winze.estimate_normals(cloud, 0.3, threads=t),
        lambda t: winze.prepare(cloud, 0.3, threads=t).points,
        lambda t: winze.fpfh(winze.prepare(cloud, 0.3), threads=t),
    ):
        assert call(1).tobytes() == call(2).tobytes() == call(8).tobytes()
