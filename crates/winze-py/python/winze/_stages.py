"""The stages, a function each.

Lengths of a stage's settings are metres or multiples of a voxel size. Where ``voxel`` is not given, that is the
spacing of the points themselves, as :func:`spacing` measures it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from . import _winze
from ._arrays import index, length, matrix, native, place, plain, rows, whole
from ._cloud import Cloud, PointsLike, core, kept
from ._config import (
    Config,
    FpfhConfig,
    IcpConfig,
    IssConfig,
    MatchingConfig,
    NdtConfig,
    PrepareConfig,
    RansacConfig,
)
from ._settings import section


class Surface:
    """Points at one voxel size with normals and a neighbour tree, from :func:`prepare`. Stages take it in the place of points and
    then need no tree of their own."""

    __slots__ = ("_core",)

    _core: _winze.Surface

    def __init__(self) -> None:
        raise TypeError("make a surface with winze.prepare(points, voxel)")

    @classmethod
    def _of(cls, core: _winze.Surface) -> Surface:
        made = cls.__new__(cls)
        made._core = core
        return made

    def __len__(self) -> int:
        return len(self._core)

    @property
    def points(self) -> npt.NDArray[np.float64]:
        """(N, 3), metres; neighbours in space are neighbours in memory. A copy."""
        return self._core.points()

    @property
    def normals(self) -> npt.NDArray[np.float32]:
        """(N, 3) unit normals, oriented by one rule; zero where undefined. A copy."""
        return self._core.normals()

    @property
    def voxel(self) -> float:
        """Voxel size that the points were thinned to, metres."""
        return self._core.voxel

    def __copy__(self) -> Surface:
        # Nothing of it can be changed.
        return self

    def __deepcopy__(self, memo: Any) -> Surface:
        return self

    def __repr__(self) -> str:
        return f"Surface({len(self)} points at {self.voxel:g} m)"


@dataclass(frozen=True, eq=False)
class Keypoints:
    """ISS keypoints."""

    indices: npt.NDArray[np.int64]
    """(K,) rows of the points, ascending."""
    saliency: npt.NDArray[np.float32]
    """(K,) smallest eigenvalue over the squared salient radius."""
    qualified: int
    """How many passed the test; the others were filled in by saliency."""


@dataclass(frozen=True, eq=False)
class Matches:
    """Descriptors that look alike."""

    pairs: npt.NDArray[np.int64]
    """(K, 2): a row of the query's descriptors and one of the map's."""
    distances: npt.NDArray[np.float32]
    """(K,) Euclidean distance of the two."""


@dataclass(frozen=True, eq=False)
class SampledPose:
    """A pose that some correspondences agree on."""

    map_from_query: npt.NDArray[np.float64]
    """(4, 4), takes query points to the map."""
    inliers: int
    """Correspondences within the inlier distance, a keypoint of the query counted once."""
    rmse: float
    """Root mean square distance of those, metres."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """What sampling found."""

    hypotheses: list[SampledPose]
    """Distinct poses, the best supported first."""
    samples: int
    """Samples drawn."""


@dataclass(frozen=True, eq=False)
class Refined:
    """A refined pose."""

    map_from_query: npt.NDArray[np.float64]
    """(4, 4), takes query points to the map."""
    stop: str
    """Why it ended: ``"converged"``, ``"max_iterations"``, ``"too_few_pairs"``, ``"degenerate"``, ``"no_improvement"``."""
    iterations: int
    """Iterations done."""
    pairs: int
    """Query points that took part in the last one."""
    information: npt.NDArray[np.float64]
    """(6, 6) point-to-plane information about [δt, δθ] at ``about``, summed over the pairs, not weighted by noise."""
    about: npt.NDArray[np.float64]
    """(3,), metres."""


def spacing(points: PointsLike, *, threads: int = 0) -> float:
    """Median distance from a point to the nearest other one, over an even sample, metres, at least a millimetre.

    Raises:
        ValueError: where no two points lie apart.
    """
    workers = whole(threads, "threads")
    found = _winze.spacing(core(points, "points", workers), workers)
    if found is None:
        raise ValueError("points: no two of them lie apart")
    return found


def _voxel(cloud: _winze.Cloud, voxel: float | None, threads: int) -> float:
    """What lengths are multiples of: the points' spacing where nothing is said, and anything where they have none."""
    if voxel is not None:
        return length(voxel, "voxel")
    found = _winze.spacing(cloud, threads)
    return 1.0 if found is None else found


def _size(surface: Surface, voxel: float | None) -> float:
    return surface.voxel if voxel is None else length(voxel, "voxel")


def choose_voxel(map_points: PointsLike, query_points: PointsLike, *, threads: int = 0) -> float:
    """The voxel size at which a query is best compared with a map, from spacing, passage width and extent of both, metres."""
    workers = whole(threads, "threads")
    a, b = core(map_points, "map_points", workers), core(query_points, "query_points", workers)
    return _winze.choose_voxel(a, b, workers)


@overload
def voxel_downsample(points: Cloud, voxel: float, *, threads: int = 0) -> Cloud: ...
@overload
def voxel_downsample(points: npt.ArrayLike, voxel: float, *, threads: int = 0) -> npt.NDArray[Any]: ...
@overload
def voxel_downsample(points: Any, voxel: float, *, threads: int = 0) -> Any: ...
def voxel_downsample(points: PointsLike, voxel: float, *, threads: int = 0) -> Any:
    """One point a voxel: the centroid of its points.

    Cells are ``floor(p / voxel)``, aligned to the coordinates; the answer is ordered by cell (z, then y, then x).

    Args:
        points: (N, 3), metres.
        voxel: edge length, metres.

    Returns:
        (M, 3), float32 where the points are, else float64; a Cloud, with mean intensities, where one was given.
    """
    workers = whole(threads, "threads")
    thinned = _winze.voxel_downsample(core(points, "points", workers), length(voxel, "voxel"), workers)
    return Cloud._of(thinned) if isinstance(points, Cloud) else thinned.points()


@overload
def remove_outliers(
    points: Cloud,
    voxel: float | None = None,
    config: PrepareConfig | Config | Mapping[str, Any] | None = None,
    *,
    return_indices: Literal[False] = False,
    threads: int = 0,
) -> Cloud: ...
@overload
def remove_outliers(
    points: npt.ArrayLike,
    voxel: float | None = None,
    config: PrepareConfig | Config | Mapping[str, Any] | None = None,
    *,
    return_indices: Literal[False] = False,
    threads: int = 0,
) -> npt.NDArray[Any]: ...
@overload
def remove_outliers(
    points: PointsLike,
    voxel: float | None = None,
    config: PrepareConfig | Config | Mapping[str, Any] | None = None,
    *,
    return_indices: Literal[True],
    threads: int = 0,
) -> npt.NDArray[np.int64]: ...
def remove_outliers(
    points: PointsLike,
    voxel: float | None = None,
    config: PrepareConfig | Config | Mapping[str, Any] | None = None,
    *,
    return_indices: bool = False,
    threads: int = 0,
) -> Any:
    """Drops points that too few others confirm: by the mean distance to their nearest neighbours
    (``statistical_neighbours``, ``statistical_deviations``), then by the number of neighbours in a ball (``outlier_radius``, ``radius_neighbours``;
    off by default).

    Args:
        points: (N, 3), metres, of even density: downsample first.
        voxel: what ``outlier_radius`` is a multiple of, metres.
        config: the settings, by default those of :func:`locate`.
        return_indices: answer the rows of the points that stay instead.

    Returns:
        (M, 3): those rows of the array as they are, or a Cloud where one was given; or (M,) int64 rows.
    """
    workers = whole(threads, "threads")
    cloud = core(points, "points", workers)
    stay = _winze.remove_outliers(cloud, section("prepare", config), _voxel(cloud, voxel, workers), workers)
    became = kept(points, cloud)
    chosen = stay if became is None else became[stay]
    if return_indices:
        return chosen
    if isinstance(points, Cloud):
        return Cloud._of(cloud.select(stay))
    if isinstance(points, (str, os.PathLike)):
        return cloud.select(stay).points()
    return rows(points, "points")[chosen]


def estimate_normals(
    points: PointsLike,
    voxel: float | None = None,
    config: PrepareConfig | Config | Mapping[str, Any] | None = None,
    *,
    viewpoint: npt.ArrayLike | None = None,
    threads: int = 0,
) -> npt.NDArray[np.float32]:
    """A unit normal a point, from the principal components of its neighbourhood.

    The neighbourhood is all points within ``normal_radius``, but at least ``normal_least`` and at most ``normal_most`` of them. The sign
    is turned towards ``viewpoint``, where one is given; else, by ``orientation``, to the open side, where more of the cloud within
    ``open_side_radius`` lies, or towards a Cloud's own viewpoint.

    Args:
        points: (N, 3), metres.
        voxel: what the radii are multiples of, metres.
        config: the settings, by default those of :func:`locate`. For the k nearest: ``PrepareConfig(normal_radius=0.0, normal_most=k)``.
        viewpoint: (3,), where the sensor stood.

    Returns:
        (N, 3) float32; zero where the neighbourhood spans no plane, and where the point is not finite.
    """
    workers = whole(threads, "threads")
    cloud = core(points, "points", workers)
    normals = _winze.estimate_normals(
        cloud,
        section("prepare", config),
        _voxel(cloud, voxel, workers),
        None if viewpoint is None else place(viewpoint, "viewpoint"),
        workers,
    )
    became = kept(points, cloud)
    if became is None:
        return normals
    of_rows = np.zeros((cloud.rows, 3), dtype=np.float32)
    of_rows[became] = normals
    return of_rows


def prepare(
    points: PointsLike,
    voxel: float,
    config: PrepareConfig | Config | Mapping[str, Any] | None = None,
    *,
    threads: int = 0,
) -> Surface:
    """Thins points to a voxel size, drops outliers, finds normals and builds a tree: what all later stages work on.

    Args:
        points: (N, 3), metres.
        voxel: edge length, metres.
        config: the settings, by default those of :func:`locate`.
    """
    workers = whole(threads, "threads")
    cloud = core(points, "points", workers)
    return Surface._of(_winze.prepare(cloud, section("prepare", config), length(voxel, "voxel"), workers))


def iss_keypoints(
    points: PointsLike | Surface,
    voxel: float | None = None,
    config: IssConfig | Config | Mapping[str, Any] | None = None,
    *,
    threads: int = 0,
) -> Keypoints:
    """Intrinsic shape signatures (Zhong 2009): points whose neighbourhood varies in all directions.

    Args:
        points: (N, 3), metres, of even density, or a Surface.
        voxel: what the radii are multiples of, metres; a Surface's own.
        config: the settings.
    """
    workers = whole(threads, "threads")
    if isinstance(points, Surface):
        size = _size(points, voxel)
        return Keypoints(*_winze.iss_keypoints(points._core, section("iss", config), size, workers))
    cloud = core(points, "points")
    size = _voxel(cloud, voxel, workers)
    found, saliency, qualified = _winze.iss_keypoints(cloud, section("iss", config), size, workers)
    became = kept(points, cloud)
    return Keypoints(found if became is None else became[found], saliency, qualified)


def fpfh(
    points: PointsLike | Surface,
    normals: npt.ArrayLike | None = None,
    keypoints: npt.ArrayLike | Keypoints | None = None,
    voxel: float | None = None,
    config: FpfhConfig | Config | Mapping[str, Any] | None = None,
    *,
    threads: int = 0,
) -> npt.NDArray[np.float32]:
    """Fast point feature histograms (Rusu, Blodow & Beetz 2009).

    Args:
        points: (N, 3), metres, of even density, or a Surface.
        normals: (N, 3), unit or zero; a Surface's own.
        keypoints: (K,) rows to describe, or :class:`Keypoints`; all by default.
        voxel: what the radius is a multiple of, metres; a Surface's own.
        config: the settings.

    Returns:
        (K, 33) float32: eleven bins each of θ, α and φ. Zero where the point has no normal or no neighbour with one.
    """
    workers = whole(threads, "threads")
    chosen = keypoints.indices if isinstance(keypoints, Keypoints) else keypoints
    wanted = None if chosen is None else index(chosen, "keypoints")
    given = None if normals is None else _normals(normals)
    if isinstance(points, Surface):
        size = _size(points, voxel)
        return _winze.fpfh(points._core, given, wanted, section("fpfh", config), size, workers)
    cloud = core(points, "points")
    size = _voxel(cloud, voxel, workers)
    became = kept(points, cloud)
    if became is None:
        return _winze.fpfh(cloud, given, wanted, section("fpfh", config), size, workers)
    # Rows that are no points have no descriptor.
    if given is not None and len(given) == cloud.rows:
        given = given[became]
    at = np.full(cloud.rows, -1, dtype=np.int64)
    at[became] = np.arange(len(became))
    wanted = np.arange(cloud.rows) if wanted is None else wanted
    if wanted.size and (wanted.min() < 0 or wanted.max() >= cloud.rows):
        raise ValueError(f"keypoints: a row outside the {cloud.rows} of the points")
    there = at[wanted] >= 0
    of_rows = np.zeros((len(wanted), 33), dtype=np.float32)
    of_rows[there] = _winze.fpfh(cloud, given, at[wanted][there], section("fpfh", config), size, workers)
    return of_rows


def _normals(normals: Any) -> npt.NDArray[np.float32]:
    array = plain(normals, "normals")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"normals: shape {array.shape} where (N, 3) is expected")
    with np.errstate(over="ignore"):
        return native(array, "normals").astype(np.float32, copy=False)


def _descriptors(given: Any, what: str) -> npt.NDArray[np.float32]:
    array = plain(given, what)
    if array.ndim != 2:
        raise ValueError(f"{what}: shape {array.shape} where (N, 33) is expected")
    with np.errstate(over="ignore"):
        return native(array, what).astype(np.float32, copy=False)


def match_features(
    map_descriptors: npt.ArrayLike,
    query_descriptors: npt.ArrayLike,
    config: MatchingConfig | Config | Mapping[str, Any] | None = None,
    *,
    threads: int = 0,
) -> Matches:
    """Nearest descriptors by Euclidean distance, exact. Descriptors that are all zero or not finite match nothing.

    Args:
        map_descriptors: (N, 33).
        query_descriptors: (M, 33).
        config: the settings; by default one nearest neighbour, mutual.
    """
    found = _winze.match_features(
        _descriptors(query_descriptors, "query_descriptors"),
        _descriptors(map_descriptors, "map_descriptors"),
        section("matching", config),
        whole(threads, "threads"),
    )
    return Matches(*found)


def ransac(
    map_points: PointsLike,
    query_points: PointsLike,
    correspondences: npt.ArrayLike | Matches,
    voxel: float,
    config: RansacConfig | Config | Mapping[str, Any] | None = None,
    *,
    seed: int = 0,
    threads: int = 0,
) -> Estimate:
    """Poses from correspondences by random sampling, several and distinct, the best supported first. The same seed gives the same
    poses.

    Args:
        map_points: (N, 3), the map's keypoints, metres.
        query_points: (M, 3), the query's keypoints.
        correspondences: (K, 2) pairs of rows, query then map, or :class:`Matches`.
        voxel: what the distances of the settings are multiples of, metres.
        config: the settings.
        seed: of every random choice.
    """
    pairs = correspondences.pairs if isinstance(correspondences, Matches) else correspondences
    workers = whole(threads, "threads")
    clouds = []
    for what, points in (("query_points", query_points), ("map_points", map_points)):
        clouds.append(core(points, what, workers))
        if kept(points, clouds[-1]) is not None:
            raise ValueError(f"{what}: some are not finite, and keypoints are counted by their rows")
    found, samples = _winze.ransac(
        clouds[0],
        clouds[1],
        index(pairs, "correspondences", 2),
        section("ransac", config),
        length(voxel, "voxel"),
        whole(seed, "seed", 2**64 - 1),
        workers,
    )
    return Estimate([SampledPose(*row) for row in found], samples)


def _pair(
    map_points: PointsLike | Surface,
    query_points: PointsLike | Surface,
    voxel: float | None,
    config: Any,
    threads: int,
) -> tuple[_winze.Surface, _winze.Surface]:
    """Both as surfaces of one voxel size."""
    both = (map_points, query_points)
    sizes = [p.voxel for p in both if isinstance(p, Surface)]
    if voxel is not None:
        sizes.append(length(voxel, "voxel"))
    if len(set(sizes)) > 1:
        raise ValueError(f"voxel: {' and '.join(f'{s:g} m' for s in sizes)}; one size must do, prepare both at it")
    if sizes:
        size = sizes[0]
    else:
        size = choose_voxel(map_points, query_points, threads=threads)
    settings = config if isinstance(config, Config) else None
    a, b = (p if isinstance(p, Surface) else prepare(p, size, settings, threads=threads) for p in both)
    return a._core, b._core


def ndt(
    map_points: PointsLike | Surface,
    query_points: PointsLike | Surface,
    initial: npt.ArrayLike | None = None,
    voxel: float | None = None,
    config: NdtConfig | Config | Mapping[str, Any] | None = None,
    *,
    threads: int = 0,
) -> Refined:
    """Refines a pose by the normal distributions transform, point to distribution (Magnusson 2009), from coarse cells to fine ones.

    Args:
        map_points: (N, 3), metres, or a Surface, which is not prepared again.
        query_points: (M, 3), or a Surface.
        initial: (4, 4) ``map_from_query`` to start at; the identity by default.
        voxel: voxel size to prepare points at, metres; chosen from the data by default.
        config: the settings; with a whole :class:`Config`, points are prepared by it too. ``keep_better`` is for :func:`locate`: here the answer is
            where it ends.
    """
    return _refine("ndt", map_points, query_points, initial, voxel, config, threads)


def icp(
    map_points: PointsLike | Surface,
    query_points: PointsLike | Surface,
    initial: npt.ArrayLike | None = None,
    voxel: float | None = None,
    config: IcpConfig | Config | Mapping[str, Any] | None = None,
    *,
    threads: int = 0,
) -> Refined:
    """Refines a pose by iterative closest point: point-to-point (Besl & McKay 1992) or, with
    ``IcpConfig(metric="point-to-plane")``, point-to-plane (Chen & Medioni 1992) or, with
    ``IcpConfig(metric="generalized")``, plane to plane (GICP; Segal, Haehnel & Thrun 2009).

    Args:
        map_points: (N, 3), metres, or a Surface, which is not prepared again.
        query_points: (M, 3), or a Surface.
        initial: (4, 4) ``map_from_query`` to start at; the identity by default.
        voxel: voxel size to prepare points at, metres; chosen from the data by default.
        config: the settings; with a whole :class:`Config`, points are prepared by it too. ``keep_better`` is for :func:`locate`: here the answer is
            where it ends.
    """
    return _refine("icp", map_points, query_points, initial, voxel, config, threads)


def _refine(
    stage: Literal["ndt", "icp"],
    map_points: PointsLike | Surface,
    query_points: PointsLike | Surface,
    initial: npt.ArrayLike | None,
    voxel: float | None,
    config: Any,
    threads: int,
) -> Refined:
    workers = whole(threads, "threads")
    start = matrix(np.eye(4) if initial is None else initial, "initial")
    a, b = _pair(map_points, query_points, voxel, config, workers)
    refine = _winze.ndt if stage == "ndt" else _winze.icp
    pose, stop, iterations, pairs, information, about = refine(a, b, start, section(stage, config), workers)
    return Refined(pose, stop, iterations, pairs, information, np.array(about))


def inliers(
    map_points: PointsLike,
    query_points: PointsLike,
    map_from_query: npt.ArrayLike,
    distance: float = 0.5,
    *,
    threads: int = 0,
) -> tuple[float, float | None]:
    """The paper's metrics at a pose: the share of query points whose nearest map point is nearer than ``distance`` metres, and the root mean
    square distance of those (None where there are none). They cannot tell a passage from its twin.

    Args:
        map_points: (N, 3), metres.
        query_points: (M, 3).
        map_from_query: (4, 4).
        distance: metres.
    """
    workers = whole(threads, "threads")
    return _winze.inliers(
        core(map_points, "map_points", workers),
        core(query_points, "query_points", workers),
        matrix(map_from_query, "map_from_query"),
        length(distance, "distance"),
        workers,
    )
