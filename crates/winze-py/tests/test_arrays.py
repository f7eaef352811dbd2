"""Any array of points gives the right cloud, or an error that says what was wrong."""

from __future__ import annotations

import copy
import pickle
import types

import numpy as np
import pytest

import winze


class Stubborn:
    """An array that does not want to be one, like a tensor that needs its gradient."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("it needs its gradient")


def layouts(points: np.ndarray) -> dict[str, np.ndarray]:
    """The same points in every layout that NumPy has."""
    n = len(points)
    wide = np.full((n, 7), np.nan, points.dtype)
    wide[:, 1:7:2] = points
    far = np.full((3 * n, 3), np.nan, points.dtype)
    far[::3] = points
    packed = np.zeros(n, dtype=[("tag", "u1"), ("xyz", points.dtype, 3)])
    packed["xyz"] = points
    buffer = bytearray(points.nbytes + 1)
    odd = np.frombuffer(buffer, points.dtype, points.size, offset=1).reshape(points.shape)
    odd[...] = points
    frozen = points.copy()
    frozen.flags.writeable = False
    reversed_order = points[:, ::-1].copy()
    return {
        "C": np.ascontiguousarray(points),
        "Fortran": np.asfortranarray(points),
        "transposed": np.ascontiguousarray(points.T).T,
        "columns picked": points[:, [0, 1, 2]],
        "strided columns": wide[:, 1:7:2],
        "strided rows": far[::3],
        "reversed rows": points[::-1].copy()[::-1],
        "reversed columns": reversed_order[:, ::-1],
        "big endian": points.astype(points.dtype.newbyteorder(">")),
        "little endian": points.astype(points.dtype.newbyteorder("<")),
        "big endian, Fortran": np.asfortranarray(points.astype(points.dtype.newbyteorder(">"))),
        "not aligned": odd,
        "part of a record": packed["xyz"],
        "read-only": frozen,
    }


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_every_layout_gives_the_same_cloud(wall, dtype):
    points = wall.astype(dtype)
    for name, given in layouts(points).items():
        assert np.array_equal(np.asarray(given), points), name
        cloud = winze.Cloud(given)
        assert cloud.points.dtype == dtype, name
        assert np.array_equal(cloud.points, points), name


def test_fortran_order_is_not_read_transposed():
    given = np.asfortranarray(np.arange(12.0).reshape(4, 3))
    assert winze.Cloud(given).points[0].tolist() == [0.0, 1.0, 2.0]
    given = np.asfortranarray(np.arange(9.0).reshape(3, 3))
    assert winze.Cloud(given).points.tolist() == given.tolist()


@pytest.mark.parametrize("dtype", ["i1", "i2", "i4", "i8", "u1", "u2", ">i4", ">u2", "f2", ">f2", "g"])
def test_other_numbers_are_taken_at_their_value(dtype):
    given = np.arange(30).reshape(10, 3).astype(dtype)
    assert np.array_equal(winze.Cloud(given).points, np.arange(30.0).reshape(10, 3))


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        (np.zeros((4, 3), bool), TypeError, "bool"),
        (np.zeros((4, 3), complex), TypeError, "complex"),
        (np.zeros((4, 3), "U3"), TypeError, "U3"),
        (np.zeros((4, 3), object), TypeError, "object"),
        (np.zeros((4, 3), "M8[s]"), TypeError, "datetime"),
        (None, TypeError, "NoneType"),
        (7, TypeError, "int"),
        ("map", TypeError, "winze.read"),
        (np.zeros(3), ValueError, r"\(3,\)"),
        (np.zeros((2, 3, 3)), ValueError, r"\(2, 3, 3\)"),
        (np.zeros((3, 100)), ValueError, "transpose"),
        (np.zeros((100, 2)), ValueError, r"\(100, 2\)"),
        (np.zeros((100, 4)), ValueError, "fourth"),
        (np.zeros((100, 6)), ValueError, r"\(100, 6\)"),
        ([[0.0, 1.0, 2.0], [3.0]], ValueError, "rows of numbers"),
        (np.zeros(4, [("x", "f4"), ("y", "f4")]), ValueError, "without z"),
        (np.ma.masked_array(np.zeros((4, 3)), np.eye(4, 3)), ValueError, "mask"),
        ([[1e9, 0, 0], [0, 0, 0]], ValueError, "wide"),
        (np.ma.masked_array(np.zeros(4, [("x", "f4"), ("y", "f4"), ("z", "f4")]), True), ValueError, "mask"),
        (types.SimpleNamespace(points=np.ma.masked_array(np.zeros((4, 3)), np.eye(4, 3))), ValueError, "points: .*mask"),
        (types.SimpleNamespace(points=[[0.0], [1.0, 2.0]]), ValueError, "points: rows"),
        (types.SimpleNamespace(points=object()), TypeError, "points: object"),
        (types.SimpleNamespace(points=lambda which: which), TypeError, "points: .*cannot be asked"),
        (np.zeros(4, [("x", "f4", 2), ("y", "f4", 2), ("z", "f4", 2)]), ValueError, "single number"),
        (Stubborn(), ValueError, "points: .*gradient"),
    ],
)
def test_what_is_no_cloud_is_refused_by_name(given, error, says):
    with pytest.raises(error, match=says):
        winze.Cloud(given)


def test_a_fourth_column_is_what_it_is_said_to_be(wall):
    four = np.column_stack([wall, np.arange(len(wall))])
    for given in (four, np.asfortranarray(four), four.astype(">f8")):
        cloud = winze.Cloud(given, fourth="intensity")
        assert np.array_equal(cloud.points, wall)
        assert np.array_equal(cloud.intensity, np.arange(len(wall)))
        ignored = winze.Cloud(given, fourth="ignore")
        assert ignored.intensity is None and np.array_equal(ignored.points, wall)
    with pytest.raises(ValueError, match="no fourth"):
        winze.Cloud(wall, fourth="intensity")
    with pytest.raises(ValueError, match="rgb"):
        winze.Cloud(four, fourth="rgb")


def test_records_are_read_by_their_names(wall):
    records = np.zeros(len(wall), [("x", ">f4"), ("ring", "u2"), ("y", "f4"), ("z", "f8"), ("intensity", "f4")])
    for i, name in enumerate("xyz"):
        records[name] = wall[:, i]
    records["intensity"] = 3.0
    cloud = winze.Cloud(records)
    assert np.allclose(cloud.points, wall, atol=1e-6)
    assert (cloud.intensity == 3.0).all()
    assert len(winze.Cloud(records.reshape(40, 100))) == len(wall)


def test_intensity_goes_with_its_points(wall):
    points = wall.copy()
    points[5] = np.nan
    cloud = winze.Cloud(points, intensity=np.arange(len(wall))[::-1])
    assert len(cloud) == len(wall) - 1
    assert cloud.intensity[5] == len(wall) - 1 - 6
    with pytest.raises(ValueError, match="3 values for 4000"):
        winze.Cloud(wall, intensity=[1, 2, 3])
    with pytest.raises(ValueError, match="shape"):
        winze.Cloud(wall, intensity=np.zeros((4000, 1)))


def test_coordinates_far_from_the_origin_keep_millimetres(wall):
    origin = np.array([500_000.123, 4_500_000.456, 300.789])
    cloud = winze.Cloud(wall + origin)
    assert np.abs(cloud.points - (wall + origin)).max() < 1e-5
    assert np.abs(cloud.origin - origin).max() < 10
    thinned = winze.voxel_downsample(wall + origin, 0.25)
    assert np.abs(thinned.mean(0) - origin - wall.mean(0)).max() < 0.2
    assert np.abs(winze.Cloud(wall + origin).transform(shift(-origin)).points - wall).max() < 1e-5


def shift(by: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = by
    return pose


def test_broken_rows_are_dropped_and_counted(wall):
    points = wall.copy()
    points[[3, 10]] = [[np.nan, 0, 0], [0, np.inf, 0]]
    points[20] = 1e12
    cloud = winze.Cloud(points)
    assert cloud.dropped == {"non_finite": 2, "no_returns": 0, "far": 1}
    assert np.array_equal(cloud.points, np.delete(wall, [3, 10, 20], axis=0))


@pytest.mark.parametrize("empty", [[], np.zeros((0, 3)), np.zeros((0, 3), "f4"), np.full((5, 3), np.nan)])
def test_no_points_are_an_empty_cloud(empty):
    cloud = winze.Cloud(empty)
    assert len(cloud) == 0 and cloud.points.shape == (0, 3)
    assert winze.voxel_downsample(empty, 0.1).shape == (0, 3)
    assert np.isnan(cloud.bounds).all() and "no points" in repr(cloud)


def test_single_precision_stays_so(wall):
    single = wall.astype(np.float32)
    assert winze.voxel_downsample(single, 0.2).dtype == np.float32
    assert winze.voxel_downsample(wall, 0.2).dtype == np.float64
    far = (wall + [2000, 0, 0]).astype(np.float32)
    assert winze.Cloud(far).points.dtype == np.float32
    assert np.abs(winze.Cloud(far).points - far).max() < 1e-6


def test_lists_and_clouds_are_arrays_too(wall):
    cloud = winze.Cloud(wall[:50].tolist())
    assert np.array_equal(np.asarray(cloud), wall[:50])
    assert np.array_equal(np.asarray(cloud, dtype=np.float32), wall[:50].astype(np.float32))
    assert np.array_equal(winze.Cloud(cloud).points, wall[:50])
    assert "50 points" in repr(cloud)


def test_single_precision_does_not_go_where_it_does_not_reach(wall):
    single = winze.Cloud(wall.astype(np.float32))
    away = shift(np.array([500_000.1, 4_500_000.2, 300.3]))
    moved = single.transform(away)
    assert moved.points.dtype == np.float64
    assert np.abs(moved.points - wall - away[:3, 3]).max() < 1e-5
    far = winze.Cloud((wall + 2000).astype(np.float32))
    wide = np.asarray(far, dtype=np.float64)
    assert np.abs(wide - (wall + 2000).astype(np.float32)).max() < 1e-6


def test_copies_are_the_same_cloud(wall, tmp_path):
    points = wall + [500_045.6, 4_500_000.7, 300]
    points[7] = np.nan
    cloud = winze.Cloud(points, intensity=np.arange(4000), viewpoint=[5e5, 4.5e6, 301])
    winze.write(tmp_path / "a.pcd", cloud)
    for original in (cloud, winze.read(tmp_path / "a.pcd")):
        for again in (pickle.loads(pickle.dumps(original)), copy.deepcopy(original), winze.Cloud(original)):
            assert again.offsets.tobytes() == original.offsets.tobytes()
            assert again.origin.tolist() == original.origin.tolist()
            assert again.intensity.tobytes() == original.intensity.tobytes()
            assert again.dropped == original.dropped and again.path == original.path
            assert (again.viewpoint == original.viewpoint).all()
    seen = winze.Cloud(cloud, viewpoint=[0, 0, 0])
    assert seen.viewpoint.tolist() == [0, 0, 0] and seen.intensity.tobytes() == cloud.intensity.tobytes()
    with pytest.raises(ValueError, match="viewpoint.*finite"):
        winze.Cloud(wall, viewpoint=[0, np.nan, 0])
