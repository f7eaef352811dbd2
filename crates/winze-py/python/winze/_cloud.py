"""Clouds and their files."""

from __future__ import annotations

import os
import warnings
from typing import Any, Protocol, Union

import numpy as np
import numpy.typing as npt

from . import _winze
from ._arrays import Fourth, intensity_of, matrix, numbers, place, rows, whole


class HasPoints(Protocol):
    """A cloud of Open3D or small_gicp: an attribute or a method with points."""

    @property
    def points(self) -> Any: ...


class HasPoint(Protocol):
    """A tensor cloud of Open3D: tensors by name, ``positions`` among them."""

    @property
    def point(self) -> Any: ...


#: Points in any form: an array of shape (N, 3), a Cloud, a path, an Open3D or small_gicp cloud, records with fields x, y and z.
PointsLike = Union["Cloud", npt.ArrayLike, "os.PathLike[str]", HasPoints, HasPoint]


class Cloud:
    """A point cloud: float32 offsets from a float64 origin, so that coordinates far from zero (UTM) keep a millimetre.

    Every function takes arrays as well; a Cloud saves the conversion where one cloud is used several times, and
    carries an intensity and where it was seen from.
    """

    __slots__ = ("_core", "_report")

    _core: _winze.Cloud
    _report: dict[str, Any]

    def __init__(
        self,
        points: PointsLike,
        *,
        intensity: npt.ArrayLike | None = None,
        fourth: Fourth | None = None,
        viewpoint: npt.ArrayLike | None = None,
    ) -> None:
        """Takes points, metres.

        Args:
            points: (N, 3), or (N, 4) with ``fourth`` saying what the fourth column is; any real dtype and layout; records with
                fields x, y, z (and intensity), as ROS gives; an Open3D or small_gicp cloud. Rows that
                are not finite, and the few that lie hopelessly far from the rest, are dropped and counted in ``dropped``.
            intensity: (N,), kept in float32.
            fourth: ``"intensity"`` or ``"ignore"``.
            viewpoint: (3,), where the one sensor stood that saw all of it; with ``PrepareConfig(orientation="auto")`` normals are turned
                towards it.

        A Cloud is taken with all that it has, and shared rather than copied where nothing is added.

        Raises:
            TypeError: for what holds no real numbers.
            ValueError: for a wrong shape, or where more than 1 % of the points lie more than 16 km from the middle.
        """
        self._report = {}
        seen_from = None if viewpoint is None else place(viewpoint, "viewpoint")
        given = intensity_of(points) if intensity is None else numbers(intensity, "intensity")
        if isinstance(points, Cloud):
            same = given is None and seen_from is None
            self._core = points._core if same else points._core.with_more(given, seen_from)
            self._report = points._report
            return
        array = rows(points, "points", fourth)
        self._core = _winze.Cloud(array, fourth == "intensity", given, seen_from)

    @classmethod
    def _of(cls, core: _winze.Cloud, report: dict[str, Any] | None = None) -> Cloud:
        cloud = cls.__new__(cls)
        cloud._core = core
        cloud._report = report or {}
        return cloud

    def __len__(self) -> int:
        return len(self._core)

    @property
    def points(self) -> npt.NDArray[Any]:
        """(N, 3) coordinates in the cloud's own frame, metres: float64, or float32 where the cloud was made of such. A copy."""
        return self._core.points()

    @property
    def offsets(self) -> npt.NDArray[np.float32]:
        """(N, 3) float32, offsets from ``origin``. A copy."""
        return self._core.offsets()

    @property
    def origin(self) -> npt.NDArray[np.float64]:
        """(3,) float64; zero where all coordinates are small, else whole metres in the cloud's middle."""
        return np.array(self._core.origin)

    @property
    def intensity(self) -> npt.NDArray[np.float32] | None:
        """(N,) float32, where the cloud has one."""
        return self._core.intensity

    @property
    def viewpoint(self) -> npt.NDArray[np.float64] | None:
        """(3,) where the sensor stood, where that is known."""
        at = self._core.viewpoint
        return None if at is None else np.array(at)

    @property
    def bounds(self) -> npt.NDArray[np.float64]:
        """(2, 3), the smallest and largest corner, metres; NaN for an empty cloud."""
        found = self._core.bounds()
        return np.full((2, 3), np.nan) if found is None else np.array(found)

    @property
    def dropped(self) -> dict[str, int]:
        """How many points did not make it in, by reason."""
        non_finite, no_returns, far = self._core.dropped
        return {"non_finite": non_finite, "no_returns": no_returns, "far": far}

    @property
    def path(self) -> str | None:
        """The file it was read from."""
        path = self._core.path
        return None if path is None else os.fspath(path)

    @property
    def report(self) -> dict[str, Any]:
        """What the reader told of the file: format, encoding, points_in_file, fields, organised, warnings. Empty without one."""
        return dict(self._report)

    def transform(self, pose: npt.ArrayLike) -> Cloud:
        """The cloud moved by a rigid (4, 4) transform; ``ValueError`` where it is none."""
        return Cloud._of(self._core.transformed(matrix(pose, "pose")))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        if copy is False:
            raise ValueError("a Cloud's points cannot be had without a copy")
        if dtype is None:
            return self.points
        return self._core.points(np.dtype(dtype) == np.float32).astype(dtype, copy=False)

    def __repr__(self) -> str:
        if len(self) == 0:
            return "Cloud(no points)"
        low, high = self.bounds
        extent = " x ".join(f"{v:.1f}" for v in high - low)
        file = "" if self.path is None else f", {self.path!r}"
        return f"Cloud({len(self)} points, {extent} m{file})"

    def __copy__(self) -> Cloud:
        # Nothing of it can be changed.
        return self

    def __deepcopy__(self, memo: Any) -> Cloud:
        return self

    def __reduce__(self) -> Any:
        c = self._core
        state = (c.offsets(), c.origin, c.intensity, c.viewpoint, c.dropped, c.is_single, self.path, c.digest)
        return (_restored, (state, self._report))


def _restored(state: Any, report: dict[str, Any]) -> Cloud:
    return Cloud._of(_winze.Cloud.restored(*state), report)


def core(points: PointsLike, what: str, threads: int = 0) -> _winze.Cloud:
    """What the Rust side takes."""
    if isinstance(points, Cloud):
        return points._core
    if isinstance(points, (str, os.PathLike)):
        found, report = _winze.read(os.fspath(points), threads)
        told = list(report["warnings"])
        if found.dropped[0]:
            told.append(f"{found.dropped[0]} points are not finite and were dropped")
        for text in told:
            warnings.warn(f"{os.fspath(points)}: {text}", stacklevel=4)
        return found
    # It has points to look at, and is no cloud.
    if isinstance(getattr(points, "_core", None), _winze.Map):
        raise TypeError(f"{what}: a winze.Map where points are expected; a map goes first, or is asked: map.locate(points)")
    return _winze.Cloud(rows(points, what), False, intensity_of(points), None)


def kept(points: PointsLike, cloud: _winze.Cloud) -> npt.NDArray[np.int64] | None:
    """Which rows of an array became points, where not all did. A Cloud's own points are its rows."""
    return None if isinstance(points, Cloud) else cloud.kept


def read(path: str | os.PathLike[str], *, threads: int = 0) -> Cloud:
    """Reads a cloud: PCD (ascii, binary, compressed), PLY, or text (.xyz, .txt, .csv, .asc, .pts).

    Returns the finite points in the file's own frame, metres; ``cloud.dropped`` counts the others, ``cloud.report`` has what
    the reader told of the file.

    Raises:
        OSError: where the file cannot be read.
        ValueError: where it is broken, with the line or byte, or of no known format.
    """
    found, report = _winze.read(os.fspath(path), whole(threads, "threads"))
    return Cloud._of(found, report)


def write(
    path: str | os.PathLike[str],
    points: PointsLike,
    *,
    encoding: str | None = None,
    threads: int = 0,
) -> list[str]:
    """Writes a cloud as PCD, PLY or text, by the name's extension, whole or not at all; an earlier file is replaced.

    Args:
        path: where to.
        points: (N, 3), metres, or a Cloud, whose intensity goes along.
        encoding: ``"ascii"``, ``"binary"`` or ``"compressed"``; the format's usual one by default.

    Returns:
        Warnings, such as of digits that the format does not hold.

    Raises:
        OSError: where the file cannot be written.
        ValueError: for an unknown format, or an encoding that it does not have.
    """
    return _winze.write(os.fspath(path), core(points, "points"), encoding, whole(threads, "threads"))


def demo(seed: int = 0) -> tuple[Cloud, Cloud, npt.NDArray[np.float64]]:
    """A small simulated mine, a drive through a part of it in a frame of its own, and the truth: what ``winze demo`` shows.

    Returns:
        map, query, and ``map_from_query`` (4, 4).
    """
    a, b, pose = _winze.demo(whole(seed, "seed", 2**64 - 1))
    return Cloud._of(a), Cloud._of(b), pose
