"""Whatever holds points, as an array that can be read where it lies."""

from __future__ import annotations

import os
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

#: What the fourth column of points is.
Fourth = Literal["intensity", "ignore"]


def rows(points: Any, what: str, fourth: Fourth | None = None) -> npt.NDArray[Any]:
    """The points as a two-dimensional native float32 or float64 array; a copy only where NumPy must make one."""
    if fourth not in (None, "intensity", "ignore"):
        raise ValueError(f'fourth: {fourth!r}; say "intensity" or "ignore"')
    array, homogeneous = _array(points, what)
    if array.ndim == 1 and array.size == 0:
        array = array.reshape(0, 3)
    if array.ndim != 2:
        raise ValueError(f"{what}: shape {array.shape} where (N, 3) is expected, a point a row")
    columns = array.shape[1]
    if columns == 4 and homogeneous:
        if fourth == "intensity":
            raise ValueError(f"{what}: the fourth column is the 1 of homogeneous coordinates, no intensity")
        array = array[:, :3]
    elif columns == 4:
        if fourth is None:
            raise ValueError(
                f"{what}: shape {array.shape}; say what the fourth column is: "
                'winze.Cloud(points, fourth="intensity") or fourth="ignore", or give points[:, :3]'
            )
        if fourth == "ignore":
            array = array[:, :3]
    elif columns != 3:
        hint = "; points are rows, give its transpose" if array.shape[0] in (3, 4) else ""
        raise ValueError(f"{what}: shape {array.shape} where (N, 3) is expected{hint}")
    elif fourth == "intensity" and not homogeneous:
        raise ValueError(f"{what}: shape {array.shape} has no fourth column for an intensity")
    return native(array, what)


def native(array: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
    """Numbers of another type, byte order or alignment as native float32 or float64; others as they are."""
    kind, size = array.dtype.kind, array.dtype.itemsize
    if kind not in "fiu":
        raise TypeError(f"{what}: {array.dtype} where real numbers are expected")
    single = kind == "f" and size <= 4
    wanted = np.dtype(np.float32 if single else np.float64)
    readable = array.flags.aligned and all(s % wanted.itemsize == 0 for s in array.strides)
    if array.dtype == wanted and array.dtype.isnative and readable:
        return array
    # Not ascontiguousarray, which leaves a contiguous array where it lies, aligned or not.
    return array.astype(wanted, order="C", copy=True)


def _array(points: Any, what: str) -> tuple[npt.NDArray[Any], bool]:
    """An array, and whether its fourth column is the 1 of homogeneous coordinates."""
    if isinstance(points, np.ndarray):
        return _fields(points, what) if points.dtype.names is not None else plain(points, what), False
    if isinstance(points, (str, bytes, os.PathLike)):
        raise TypeError(f"{what}: a path; read it first: winze.read({points!r})")
    # Open3D's tensor cloud: a map of named tensors, maybe on another device.
    named = getattr(points, "point", None)
    if named is not None and hasattr(named, "positions"):
        tensor = named.positions
        tensor = tensor.cpu() if hasattr(tensor, "cpu") else tensor
        return plain(tensor.numpy() if hasattr(tensor, "numpy") else tensor, what), False
    # Open3D's legacy cloud has its points in an attribute, small_gicp's in a method, with a 1 in the fourth column.
    own = getattr(points, "points", None)
    if own is not None:
        if not callable(own):
            return _array(own, what) if isinstance(own, np.ndarray) else (plain(own, what), False)
        try:
            given = own()
        except TypeError as e:
            raise TypeError(f"{what}: {type(points).__name__}.points() cannot be asked ({e})") from None
        array = plain(given, what)
        return array, array.ndim == 2 and array.shape[1] == 4 and bool((array[:, 3] == 1).all())
    return plain(points, what), False


def plain(values: Any, what: str) -> npt.NDArray[Any]:
    """Any array or nested list, as a plain array; what masks values or holds none is refused by name."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise ValueError(f"{what}: a masked array with masked values; give points[~mask], or points.filled(nan)")
    try:
        array = np.asarray(values)
    except Exception as e:
        kind = TypeError if isinstance(e, TypeError) else ValueError
        raise kind(f"{what}: rows of numbers are expected ({e})") from None
    if isinstance(values, np.ndarray) and array.dtype.kind == "O":
        raise TypeError(f"{what}: objects where real numbers are expected; give points.astype(float)")
    if array.dtype.kind == "O" or array.ndim == 0:
        raise TypeError(
            f"{what}: {type(values).__name__} is no array of numbers; points are (N, 3) numbers, a winze.Cloud, "
            "or an Open3D or small_gicp cloud"
        )
    return array


def _fields(points: npt.NDArray[Any], what: str) -> npt.NDArray[Any]:
    """The x, y and z of records, such as ROS gives."""
    names = points.dtype.names or ()
    missing = [n for n in "xyz" if n not in names]
    if missing:
        raise ValueError(f"{what}: records without {', '.join(missing)}; there are {', '.join(names)}")
    flat = points.reshape(-1)
    columns = [native(plain(flat[n], f"{what}, {n}"), f"{what}, {n}") for n in "xyz"]
    if any(c.ndim != 1 for c in columns):
        raise ValueError(f"{what}: records whose x, y or z is no single number")
    return np.stack(columns, axis=1)


def intensity_of(points: Any) -> npt.NDArray[np.float32] | None:
    """The intensity of records that have one."""
    if not isinstance(points, np.ndarray) or points.dtype.names is None:
        return None
    for name in ("intensity", "reflectivity"):
        if name in points.dtype.names:
            return numbers(points.reshape(-1)[name], "intensity")
    return None


def numbers(values: Any, what: str) -> npt.NDArray[np.float32]:
    """One number a point, in single precision."""
    array = native(plain(values, what), what)
    if array.ndim != 1:
        raise ValueError(f"{what}: shape {array.shape} where (N,) is expected")
    return np.ascontiguousarray(array, dtype=np.float32)


def place(values: Any, what: str) -> list[float]:
    """Three finite coordinates."""
    array = native(plain(values, what), what)
    if array.shape != (3,):
        raise ValueError(f"{what}: shape {array.shape} where (3,) is expected")
    if not np.isfinite(array).all():
        raise ValueError(f"{what}: {array.tolist()} is not finite")
    three: list[float] = array.astype(np.float64).tolist()
    return three


def length(value: Any, what: str) -> float:
    """A length, metres; whether it is above 0 is asked where it is used."""
    if isinstance(value, (bool, str, bytes)) or not hasattr(value, "__float__") or np.ndim(value) != 0:
        raise TypeError(f"{what}: {value!r} is no length in metres")
    try:
        return float(value)
    except OverflowError:
        return np.inf


def matrix(pose: Any, what: str) -> list[list[float]]:
    """A 4x4 matrix as rows."""
    array = plain(pose, what)
    if array.dtype.kind not in "fiu":
        raise TypeError(f"{what}: {array.dtype} where a 4x4 matrix of real numbers is expected")
    if array.shape != (4, 4):
        raise ValueError(f"{what}: shape {array.shape} where (4, 4) is expected")
    rows: list[list[float]] = array.astype(np.float64).tolist()
    return rows


#: Threads that can be asked for.
MOST_THREADS = 1024


def whole(value: Any, what: str, most: int = MOST_THREADS) -> int:
    """A number from 0 to `most`."""
    try:
        number = value.__index__()
    except AttributeError:
        raise TypeError(f"{what}: {value!r} is no whole number") from None
    if not 0 <= number <= most:
        raise ValueError(f"{what}: {number}; it must lie between 0 and {most}")
    return int(number)


def index(values: Any, what: str, columns: int | None = None) -> npt.NDArray[np.int64]:
    """Row numbers."""
    array = plain(values, what)
    if array.size == 0:
        return np.zeros((0,) if columns is None else (0, columns), dtype=np.int64)
    if array.dtype.kind not in "iu":
        raise TypeError(f"{what}: {array.dtype} where row numbers are expected")
    if array.ndim != (1 if columns is None else 2):
        expected = "(K,)" if columns is None else f"(K, {columns})"
        raise ValueError(f"{what}: shape {array.shape} where {expected} is expected")
    if array.dtype.kind == "u" and array.max() > np.iinfo(np.int64).max:
        raise ValueError(f"{what}: {array.max()} is no row")
    return np.ascontiguousarray(array, dtype=np.int64)
