"""Clouds of other libraries, by what they have, and by themselves where they are installed."""

from __future__ import annotations

import types

import numpy as np
import pytest

import winze


def test_shapes_of_other_libraries(wall):
    legacy = types.SimpleNamespace(points=wall.tolist(), normals=[])
    gicp = types.SimpleNamespace(points=lambda: np.column_stack([wall, np.ones(len(wall))]))
    tensor = types.SimpleNamespace(cpu=lambda: types.SimpleNamespace(numpy=lambda: wall))
    positions = types.SimpleNamespace(positions=tensor)
    for given in (legacy, gicp, types.SimpleNamespace(point=positions)):
        assert np.array_equal(winze.Cloud(given).points, wall)
    odd = types.SimpleNamespace(points=lambda: np.column_stack([wall, np.arange(len(wall))]))
    with pytest.raises(ValueError, match="fourth"):
        winze.Cloud(odd)


def test_open3d(demo, demo_outcome):
    o3d = pytest.importorskip("open3d")
    clouds = []
    for cloud in demo[:2]:
        legacy = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points))
        tensor = o3d.t.geometry.PointCloud(o3d.core.Tensor(cloud.points))
        assert np.array_equal(winze.Cloud(legacy).points, cloud.points)
        assert np.array_equal(winze.Cloud(tensor).points, cloud.points)
        clouds.append(legacy)
    assert winze.locate(*clouds).pose.tobytes() == demo_outcome.pose.tobytes()


def test_small_gicp(demo, demo_outcome):
    small_gicp = pytest.importorskip("small_gicp")
    clouds = [small_gicp.PointCloud(cloud.points) for cloud in demo[:2]]
    assert np.array_equal(winze.Cloud(clouds[0]).points, demo[0].points)
    assert winze.locate(*clouds).pose.tobytes() == demo_outcome.pose.tobytes()


def test_ply_and_pcd_of_open3d(wall, tmp_path):
    o3d = pytest.importorskip("open3d")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(wall))
    for name in ("a.pcd", "a.ply"):
        assert o3d.io.write_point_cloud(str(tmp_path / name), cloud)
        assert np.abs(winze.read(tmp_path / name).points - wall).max() < 1e-6
        winze.write(tmp_path / f"b{name}", wall)
        assert np.abs(np.asarray(o3d.io.read_point_cloud(str(tmp_path / f"b{name}")).points) - wall).max() < 1e-6
