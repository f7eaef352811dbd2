"""What Open3D computes and winze should compute alike; and the page that sets their calls side by side."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

import winze
from pages import ROOT, Page, assert_prints

PAGE = ROOT / "docs/coming-from-open3d-and-pcl.md"

HAVE = {name: importlib.util.find_spec(name) is not None for name in ("open3d", "small_gicp")}
needs_open3d = pytest.mark.skipif(not HAVE["open3d"], reason="needs Open3D")

#: Whose code a table's column is in; PCL's is C++.
COLUMNS = {"Open3D": "open3d", "small_gicp": "small_gicp", "winze": None}


def test_the_page_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = Page(PAGE, "winze_coming_from")
    blocks = iter(page.blocks())
    page.run(next(blocks))
    open3d = next(blocks)
    assert open3d.needs("open3d")
    if HAVE["open3d"]:
        page.run(open3d)
        import open3d as o3d

        monkeypatch.setattr(o3d.visualization, "draw_geometries", lambda *_: None)
    if HAVE["small_gicp"]:
        import small_gicp

        page.module.__dict__["small_gicp"] = small_gicp
    ran = dict.fromkeys(COLUMNS, 0)
    for heads, rows in page.tables():
        if heads[0] == "PCL":
            continue
        assert set(heads[1:]) <= COLUMNS.keys()
        # Theirs first, column by column: some names are shared, and each library goes on from its own.
        for column in range(1, len(heads)):
            needed = COLUMNS[heads[column]]
            if needed is not None and not HAVE[needed]:
                continue
            for row in rows:
                for code in row[column]:
                    if not code.text.isidentifier():
                        page.run(code)
                        ran[heads[column]] += 1
    assert ran["winze"] >= 30 and (ran["Open3D"] >= 25 or not HAVE["open3d"])
    assert page["outcome"].located
    for code in blocks:
        if code.needs("small_gicp") and not HAVE["small_gicp"]:
            continue
        printed = page.run(code)
        assert_prints(code, printed, PAGE)
    missing = [name for name, there in HAVE.items() if not there]
    if missing:
        pytest.skip(f"without {' and '.join(missing)}: winze's calls ran, theirs did not")


@pytest.fixture(scope="module")
def points(demo) -> np.ndarray:
    """(N, 3) float64, of values that float32 holds too."""
    thinned = winze.voxel_downsample(demo[1].points, 0.25)
    return thinned.astype(np.float32).astype(np.float64)


def legacy(points: np.ndarray, normals: np.ndarray | None = None):
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals.astype(np.float64))
    return cloud


@needs_open3d
def test_voxels(points):
    size = 0.5
    theirs = np.asarray(legacy(points).voxel_down_sample(size).points)
    corner = points.min(axis=0) - size / 2
    ours = winze.voxel_downsample(points - corner, size) + corner
    assert len(ours) == len(theirs)
    distance = np.asarray(legacy(ours).compute_point_cloud_distance(legacy(theirs)))
    # A point on the border of two cells may go to either.
    assert (distance > 1e-4).mean() < 0.001


@needs_open3d
def test_outliers(points):
    noisy = np.concatenate([points, np.random.default_rng(2).uniform(-20, 20, (300, 3)).astype(np.float32)])
    _, theirs = legacy(noisy).remove_statistical_outlier(13, 2.0)
    config = winze.PrepareConfig(statistical_neighbours=12, statistical_deviations=2.0)
    ours = winze.remove_outliers(noisy, config=config, return_indices=True)
    assert 0 < len(noisy) - len(ours) and np.setxor1d(ours, theirs).size <= 2
    _, theirs = legacy(noisy).remove_radius_outlier(5, 0.6)
    config = winze.PrepareConfig(statistical_neighbours=0, radius_neighbours=5, outlier_radius=0.6)
    ours = winze.remove_outliers(noisy, config=config, return_indices=True)
    assert 0 < len(noisy) - len(ours) and np.setxor1d(ours, theirs).size <= 2


@needs_open3d
@pytest.mark.parametrize(("radius", "most"), [(0.9, 0), (0.9, 30), (0.0, 30)])
def test_normals(points, radius, most):
    import open3d as o3d

    if most == 0:
        search = o3d.geometry.KDTreeSearchParamRadius(radius)
    elif radius == 0:
        search = o3d.geometry.KDTreeSearchParamKNN(most)
    else:
        search = o3d.geometry.KDTreeSearchParamHybrid(radius, most)
    cloud = legacy(points)
    cloud.estimate_normals(search, fast_normal_computation=False)
    config = winze.PrepareConfig(normal_radius=radius, normal_least=0, normal_most=most)
    ours = winze.estimate_normals(points, config=config)
    has = (ours != 0).any(axis=1)
    assert has.mean() > 0.98
    cosine = np.abs((ours * np.asarray(cloud.normals)).sum(axis=1))[has]
    degrees = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    assert (degrees < 1).mean() > 0.999 and np.median(degrees) < 0.05


@needs_open3d
def test_descriptors_and_matches(points, demo):
    import open3d as o3d

    registration = o3d.pipelines.registration
    features, described = [], []
    for cloud in (points[::2], winze.voxel_downsample(demo[0].points, 0.5).astype(np.float32)):
        normals = winze.estimate_normals(cloud, 0.5)
        cloud, normals = cloud[(normals != 0).any(axis=1)], normals[(normals != 0).any(axis=1)]
        search = o3d.geometry.KDTreeSearchParamRadius(2.0)
        feature = registration.compute_fpfh_feature(legacy(cloud.astype(np.float64), normals), search)
        theirs = feature.data.T
        ours = winze.fpfh(cloud, normals, config=winze.FpfhConfig(radius=2.0, variant="open3d"))
        assert ours.shape == theirs.shape == (len(cloud), 33)
        share = np.abs(ours - theirs).sum(axis=1) / np.maximum(theirs.sum(axis=1), 1.0)
        # A pair on the border of two bins may go to either, which a point with few neighbours feels.
        assert (share < 0.01).mean() > 0.998 and np.median(share) < 1e-4
        features.append(feature)
        described.append(theirs)
    theirs = np.asarray(registration.correspondences_from_features(*features, True, 0.0))
    ours = winze.match_features(described[1], described[0]).pairs
    assert len(ours) > 50
    assert len(set(map(tuple, ours)) ^ set(map(tuple, theirs))) <= 0.01 * len(ours)


@needs_open3d
def test_keypoints(points):
    import open3d as o3d

    theirs = o3d.geometry.keypoint.compute_iss_keypoints(legacy(points), 1.0, 0.75, 0.975, 0.975, 5)
    config = winze.IssConfig(
        salient_radius=1.0,
        non_max_radius=0.75,
        cell=0.0,
        centre="centroid",
        min_relief=0.0,
        min_neighbours=4,
        min_keypoints=0,
        max_keypoints=0,
    )
    ours = points[winze.iss_keypoints(points, config=config).indices]
    near = np.linalg.norm(points[None] - ours[:, None], axis=2) <= 0.75
    ours = ours[near.sum(axis=1) >= 5]
    a, b = (set(map(tuple, p.tolist())) for p in (ours, np.asarray(theirs.points)))
    assert len(a) > 100 and len(a ^ b) <= 0.01 * len(b)


@needs_open3d
def test_refinement_and_fitness(points, demo):
    import open3d as o3d

    registration = o3d.pipelines.registration
    map_points = winze.voxel_downsample(demo[0].points, 0.25)
    truth = demo[2]
    start = truth.copy()
    start[:3, 3] += [0.15, -0.1, 0.05]
    surfaces = winze.prepare(map_points, 0.25), winze.prepare(points, 0.25)
    target, source = (legacy(s.points, s.normals) for s in surfaces)
    criteria = registration.ICPConvergenceCriteria(1e-9, 1e-9, 200)
    for metric, estimation in (
        ("point-to-point", registration.TransformationEstimationPointToPoint()),
        ("point-to-plane", registration.TransformationEstimationPointToPlane()),
    ):
        theirs = registration.registration_icp(source, target, 0.4, start, estimation, criteria).transformation
        config = winze.IcpConfig(
            metric=metric, max_distance=0.4, final_distance=0.4, max_points=0, max_iterations=200
        )
        ours = winze.icp(*surfaces, start, config=config).map_from_query
        at = np.append(points.mean(axis=0), 1.0)
        assert np.linalg.norm((ours - theirs) @ at) < 0.005, metric
    theirs = registration.evaluate_registration(source, target, 0.5, truth)
    share, rmse = winze.inliers(surfaces[0].points, surfaces[1].points, truth, 0.5)
    assert share == pytest.approx(theirs.fitness, abs=1e-4) and rmse == pytest.approx(theirs.inlier_rmse, rel=1e-4)
