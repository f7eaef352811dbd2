"""One question, and maps that are asked many."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterable
from typing import Any, Literal, Union

import numpy as np
import numpy.typing as npt

from . import _winze
from ._arrays import matrix, native, plain, whole
from ._cloud import Cloud, PointsLike, core
from ._outcome import Outcome
from ._progress import Progress, following
from ._settings import ConfigLike, changed

#: How to look: winze's own, and the five of the seed paper.
Method = Literal["auto", "fpfh", "fpfh+ndt", "fpfh+icp", "ndt+icp", "fpfh+ndt+icp"]

#: All of them.
METHODS: tuple[Method, ...] = ("auto", "fpfh", "fpfh+ndt", "fpfh+icp", "ndt+icp", "fpfh+ndt+icp")


def locate(
    map_points: PointsLike | Map,
    query_points: PointsLike,
    *,
    method: Method = "auto",
    config: ConfigLike = None,
    seed: int | None = None,
    gravity_aligned: bool = False,
    near: npt.ArrayLike | None = None,
    initial: npt.ArrayLike | None = None,
    truth: npt.ArrayLike | None = None,
    threads: int = 0,
    progress: Progress = None,
) -> Outcome:
    """Finds where a query lies in a map, with no initial guess.

    Args:
        map_points: the prior map: (N, 3) points, metres, in any form that :class:`Cloud` takes, a cloud's path, or a
            :class:`Map` or its path.
        query_points: the query, (M, 3), in a frame of its own.
        method: ``"auto"``, or one of the seed paper's five.
        config: settings: a :class:`Config`, of which those count that are not the default; a dict of some, ``{"scale.voxel": 0.3}``; or a
            TOML file's path, as ``--config``.
        seed: of every random choice, in the place of the config's (``auto`` makes none).
        gravity_aligned: both clouds have z up: poses that tilt by more than 10° are refused.
        near: (x, y, z, radius), metres of the map's frame: the query's centroid is known to lie in this ball.
        initial: (4, 4) start pose, for ``"ndt+icp"``.
        truth: (4, 4) true ``map_from_query``; the outcome then has the error.
        threads: how many to work on; 0: all. The answer is the same.
        progress: a function told of each step, or True for a tqdm bar.

    Returns:
        The answer. Not to know is a verdict, not an exception.

    Raises:
        TypeError: for what holds no points.
        ValueError: for arrays of a wrong shape, settings outside their domain, a map without usable points, a transform that
            is not rigid, a broken file.
        OSError: where a file cannot be read.
    """
    workers = whole(threads, "threads")
    prior = _prior(map_points, workers)
    query = core(query_points, "query_points", workers)
    settings, chosen = changed(config, seed)
    region = None
    if near is not None:
        ball = native(plain(near, "near"), "near").astype(np.float64)
        if ball.shape != (4,):
            raise ValueError(f"near: shape {ball.shape} where (x, y, z, radius) is expected")
        region = ball.tolist()
    with following(progress) as callback:
        document, drawing = _winze.locate(
            prior,
            query,
            method=method,
            set=settings,
            seed=chosen,
            initial=None if initial is None else matrix(initial, "initial"),
            gravity_aligned=bool(gravity_aligned),
            near=region,
            truth=None if truth is None else matrix(truth, "truth"),
            command=_command(prior, query, method),
            threads=workers,
            progress=callback,
        )
    return Outcome(document, drawing)


def _command(prior: _winze.Cloud | _winze.Map, query: _winze.Cloud, method: str) -> str:
    def name(path: Any, otherwise: str) -> str:
        return otherwise if path is None else repr(os.fspath(path))

    return f"winze.locate({name(prior.path, 'map')}, {name(query.path, 'query')}, method={method!r})"


def _prior(points: PointsLike | Map, threads: int) -> _winze.Cloud | _winze.Map:
    if isinstance(points, Map):
        return points._core
    if isinstance(points, (str, os.PathLike)) and _winze.is_built(os.fspath(points)):
        return _winze.Map.open(os.fspath(points), False)
    return core(points, "map_points", threads)


class _Folder:
    """A folder that goes when nobody has it any more."""

    def __init__(self) -> None:
        self.name = tempfile.mkdtemp(prefix="winze-map-")
        weakref.finalize(self, _remove, self.name, os.getpid())


def _remove(folder: str, owner: int) -> None:
    # A forked process that ends must not take its parent's map along.
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)


class Map:
    """A map that is prepared once and kept in one file, which opens in milliseconds and gives the same pose and verdict as the
    cloud that it was made of.

    Make one with :meth:`build`, or :meth:`open` a file that :meth:`build` or ``winze map build`` wrote. It can be pickled as long as
    its file is there, so that workers share it without a copy.
    """

    __slots__ = ("__weakref__", "_core", "_folder")

    _core: _winze.Map
    _folder: _Folder | None

    def __init__(self) -> None:
        raise TypeError("make a map with winze.Map.build(clouds), or winze.Map.open(path)")

    @classmethod
    def _of(cls, core: _winze.Map, folder: _Folder | None = None) -> Map:
        made = cls.__new__(cls)
        made._core = core
        made._folder = folder
        return made

    @classmethod
    def build(
        cls,
        clouds: PointsLike | Iterable[PointsLike],
        path: str | os.PathLike[str] | None = None,
        *,
        config: ConfigLike = None,
        crs: str | None = None,
        replace: bool = False,
        memory: int | None = None,
        scratch: str | os.PathLike[str] | None = None,
        threads: int = 0,
        progress: Progress = None,
    ) -> Map:
        """Prepares a map of all points of some clouds, which share one frame.

        Args:
            clouds: a cloud or a list of them, each in any form that :class:`Cloud` takes, or a path: files are streamed, so that
                memory stays bounded whatever their size.
            path: where to keep it; by default in a temporary file that goes with the map, until :meth:`save`.
            config: settings that shape the map, see :func:`locate`; it carries them.
            crs: the coordinate reference system, such as ``"EPSG:32633"``, told again by :meth:`info`.
            replace: whether a file that is there may be replaced.
            memory: bytes to work in; half of what is free by default. The map does not depend on it.
            scratch: folder for scratch files; the map's own by default.
            threads: as for :func:`locate`.
            progress: as for :func:`locate`.

        Raises:
            FileExistsError: where the file is there and ``replace`` is not set.
            ValueError, TypeError, OSError: as :func:`locate`.
        """
        folder = None
        if path is None:
            folder = _Folder()
            path = os.path.join(folder.name, "map.wmap")
        parts = [
            os.fspath(p) if isinstance(p, (str, os.PathLike)) else core(p, f"clouds[{i}]")
            for i, p in enumerate(_parts(clouds))
        ]
        with following(progress) as callback:
            _winze.build(
                parts,
                os.fspath(path),
                set=changed(config)[0],
                crs=crs,
                replace=replace,
                memory=None if memory is None else whole(memory, "memory", 2**63),
                scratch=None if scratch is None else os.fspath(scratch),
                threads=whole(threads, "threads"),
                progress=callback,
            )
        return cls._of(_winze.Map.open(os.fspath(path), False), folder)

    @classmethod
    def open(cls, path: str | os.PathLike[str], *, in_memory: bool = False) -> Map:
        """Opens a map's file by mapping it into memory; processes that open one file share it.

        Args:
            path: the file. It must not be written to or cut short while it is open (to build it anew is no harm: that puts another file
                in its place).
            in_memory: read all of it instead, from a drive that may vanish.

        Raises:
            OSError: where the file cannot be read.
            ValueError: where it is no map, is damaged, or was made by a newer winze.
        """
        return cls._of(_winze.Map.open(os.fspath(path), in_memory))

    @property
    def path(self) -> str | None:
        """Its file; None while it has only a temporary one."""
        path = self._core.path
        return None if path is None or self._folder is not None else os.fspath(path)

    def save(self, path: str | os.PathLike[str], *, replace: bool = False) -> Map:
        """Keeps a copy of its file; the map of that.

        Raises:
            FileExistsError: where there is a file and ``replace`` is not set.
            OSError: where it cannot be written.
        """
        self._core.save(os.fspath(path), replace)
        return Map.open(path)

    def info(self) -> dict[str, Any]:
        """What is in it: points, extent, passages, noise, levels, sources; the fields of ``winze map info --json``."""
        facts: dict[str, Any] = json.loads(self._core.info())
        return facts

    def check(self, *, threads: int = 0, progress: Progress = None) -> None:
        """Verifies every byte; ``ValueError`` for the first thing that is wrong."""
        with following(progress) as callback:
            self._core.check(whole(threads, "threads"), callback)

    def locate(
        self,
        points: PointsLike,
        *,
        method: Method = "auto",
        config: ConfigLike = None,
        seed: int | None = None,
        gravity_aligned: bool = False,
        near: npt.ArrayLike | None = None,
        initial: npt.ArrayLike | None = None,
        truth: npt.ArrayLike | None = None,
        threads: int = 0,
        progress: Progress = None,
    ) -> Outcome:
        """Finds where a query lies in this map, see :func:`winze.locate`. Safe to call from several threads at once."""
        return locate(
            self,
            points,
            method=method,
            config=config,
            seed=seed,
            gravity_aligned=gravity_aligned,
            near=near,
            initial=initial,
            truth=truth,
            threads=threads,
            progress=progress,
        )

    @property
    def points(self) -> npt.NDArray[np.float64]:
        """(N, 3) points of its finest level, two million at most, to look at."""
        return self._core.points()

    def __copy__(self) -> Map:
        # Nothing of it can be changed.
        return self

    def __deepcopy__(self, memo: Any) -> Map:
        return self

    def __repr__(self) -> str:
        info = self.info()
        file = "" if self.path is None else f", {self.path!r}"
        return f"Map({info['points']} points, {len(info['levels'])} levels{file})"

    def __reduce__(self) -> Any:
        if self.path is None:
            raise TypeError("a map without a file of its own cannot be pickled; save() it first")
        return (Map.open, (os.path.abspath(self.path),))


def _parts(clouds: Any) -> list[Any]:
    """One cloud, or all that are in something iterable; a list of rows of plain numbers is one."""
    one = isinstance(clouds, (str, os.PathLike, np.ndarray, Cloud, Map)) or hasattr(clouds, "points")
    if one or hasattr(clouds, "point") or hasattr(clouds, "__array__") or not isinstance(clouds, Iterable):
        return [clouds]
    parts = list(clouds)
    rows = bool(parts) and all(isinstance(p, (list, tuple)) and len(p) == 3 and np.ndim(p) == 1 for p in parts)
    return [parts] if rows and not isinstance(parts[0][0], (str, os.PathLike)) else parts
