"""The answer."""

from __future__ import annotations

import enum
import json
import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from . import _winze


class Verdict(str, enum.Enum):
    """What is known about where the query lies. Equal to its name in the JSON: ``outcome.verdict == "located"``."""

    LOCATED = "located"
    """Here it is."""
    AMBIGUOUS = "ambiguous"
    """Several places fit; they are among the hypotheses, those with ``rival``."""
    DEGENERATE = "degenerate"
    """The place is known, but not along some directions; they are in ``unobservable``."""
    NOT_FOUND = "not_found"
    """No place in this map fits well enough."""
    INSUFFICIENT = "insufficient"
    """Too little geometry in the query."""

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Patches:
    """What the rock says of a place: patches of wall that were asked whether they lie finest just there."""

    asked: int
    """Patches that were asked."""
    confirmed: int
    """And those that say yes."""
    bend: float | None
    """How far off one rigid pose pieces of the query lie, root mean square, metres; None where that was not measured."""
    beyond: float | None
    """How far off the query's centroid that may leave the pose, where part of the query is not on the map, metres."""
    followed: float | None
    """Share of the query's points in pieces that lie on the map by themselves."""
    piecewise: bool
    """Whether the patches were asked where those pieces lie."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A place that was weighed."""

    map_from_query: npt.NDArray[np.float64]
    """(4, 4), takes query points to the map."""
    score: float
    """Share of the query's prepared points that lie finely on the map's surface."""
    median_point_to_plane: float | None
    """Median distance of the overlapping points from the map's tangent planes, metres; None where nothing overlaps."""
    inlier_fraction: float
    """Share of the prepared points within the inlier distance of the map's."""
    overlap: float
    """Share of them with map surface within the overlap distance."""
    patches: Patches | None
    """What the rock says; None where it was not asked."""
    rival: bool
    """Whether it cannot be ruled out beside the place answered."""
    stop: str | None
    """Why its refinement stopped."""


@dataclass(frozen=True)
class Stage:
    """One step of the run."""

    name: str
    """What it did."""
    seconds: float
    """How long, wall time."""
    count_in: int
    """Points, keypoints, correspondences or hypotheses that went in."""
    count_out: int
    """And that came out."""


@dataclass(frozen=True, eq=False)
class Unobservable:
    """A direction along or about which the query could move and fit as well."""

    kind: str
    """``"translation"`` or ``"rotation"``; a rotation is about an axis through ``covariance_at``."""
    direction: npt.NDArray[np.float64]
    """(3,), unit, in the map's frame."""
    information: float
    """A pair's share of the information there."""


class PoseError(NamedTuple):
    """How far a pose is from the truth."""

    translation: float
    """Displacement of the query's centroid, metres."""
    rotation: float
    """Angle, radians."""


class Outcome:
    """Everything that is known after a question. What was not computed is None.

    In a notebook it shows itself as a picture of the query in the map, before and after. To be drawn it holds on to both clouds;
    :meth:`without_clouds` lets go of them. It can be pickled; what comes back has all numbers, but no clouds.
    """

    def __init__(self, document: str, drawing: _winze.Drawing | None) -> None:
        self._document = document
        self._drawing = drawing

    @cached_property
    def _values(self) -> dict[str, Any]:
        values: dict[str, Any] = json.loads(self._document)
        return values

    def _array(self, key: str) -> npt.NDArray[np.float64] | None:
        value = self._values[key]
        return None if value is None else np.array(value, dtype=np.float64)

    @property
    def verdict(self) -> Verdict:
        """The answer in a word. Only ``Verdict.LOCATED`` may move a robot."""
        return Verdict(self._values["verdict"])

    @property
    def located(self) -> bool:
        """Whether the verdict is ``Verdict.LOCATED``."""
        return self.verdict is Verdict.LOCATED

    @property
    def reason(self) -> str:
        """And in a sentence."""
        return str(self._values["reason"])

    @property
    def confidence(self) -> float | None:
        """Probability that the pose is within 0.5 m and 5° of the truth, as counted on simulated queries; None without a
        pose, and for verdicts, methods and settings that were not counted."""
        value = self._values["confidence"]
        return None if value is None else float(value)

    @property
    def pose(self) -> npt.NDArray[np.float64] | None:
        """(4, 4) float64, ``map_from_query``: the best pose found, whatever the verdict; None where none was."""
        return self._array("map_from_query")

    @property
    def map_from_query(self) -> npt.NDArray[np.float64] | None:
        """The same as ``pose``."""
        return self.pose

    @property
    def covariance(self) -> npt.NDArray[np.float64] | None:
        """(6, 6) of a perturbation [δt, δθ] of the pose in the map's axes about ``covariance_at``; m², m·rad, rad²."""
        return self._array("covariance")

    @property
    def covariance_at(self) -> npt.NDArray[np.float64] | None:
        """(3,), the query's centroid in the map, metres."""
        return self._array("covariance_at")

    @property
    def covariance_at_origin(self) -> npt.NDArray[np.float64] | None:
        """(6, 6), the same about where the pose puts the query's origin: what a ``PoseWithCovariance`` wants."""
        return self._array("covariance_at_origin")

    @property
    def unobservable(self) -> list[Unobservable] | None:
        """Directions that the geometry leaves open; None where the fit was too poor to ask."""
        rows = self._values["unobservable"]
        if rows is None:
            return None
        return [Unobservable(r["kind"], np.array(r["direction"]), r["information"]) for r in rows]

    @cached_property
    def hypotheses(self) -> list[Hypothesis]:
        """Distinct places that were weighed, the one answered first."""
        return [
            Hypothesis(
                map_from_query=np.array(row["map_from_query"]),
                score=row["score"],
                median_point_to_plane=row["median_point_to_plane"],
                inlier_fraction=row["inlier_fraction"],
                overlap=row["overlap"],
                patches=None if row["patches"] is None else Patches(**row["patches"]),
                rival=row["rival"],
                stop=row["stop"],
            )
            for row in self._values["hypotheses"]
        ]

    @property
    def inlier_fraction(self) -> float | None:
        """The paper's inlier share, over all finite points of the query. It can't tell a passage from its twin."""
        value: float | None = self._values["inlier_fraction"]
        return value

    @property
    def inlier_rmse(self) -> float | None:
        """The paper's inlier RMSE, metres."""
        value: float | None = self._values["inlier_rmse"]
        return value

    @property
    def error(self) -> PoseError | None:
        """How far the pose is from the ``truth`` that was given; None without one or without a pose."""
        row = self._values["error"]
        return None if row is None else PoseError(row["translation_m"], float(np.radians(row["rotation_deg"])))

    @property
    def stages(self) -> list[Stage]:
        """The steps in the order they ran."""
        return [Stage(s["name"], s["seconds"], s["in"], s["out"]) for s in self._values["stages"]]

    @property
    def seconds(self) -> float:
        """Wall time of them all."""
        return float(self._values["seconds"])

    @property
    def voxel(self) -> float | None:
        """Voxel size that the answer was found at, metres."""
        value: float | None = self._values["voxel"]
        return value

    @property
    def method(self) -> str:
        """The method's name."""
        return str(self._values["method"])

    def transform(self, points: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Points of the query's frame, (N, 3), in the map's; ``ValueError`` where no pose was found."""
        if self.pose is None:
            raise ValueError(f"no pose was found: {self.reason}")
        given = np.asarray(points, dtype=np.float64)
        moved: npt.NDArray[np.float64] = given @ self.pose[:3, :3].T + self.pose[:3, 3]
        return moved

    def to_dict(self) -> dict[str, Any]:
        """The whole answer as plain values, with the fields of the command line's ``--json``."""
        values: dict[str, Any] = json.loads(self._document)
        return values

    def to_json(self) -> str:
        """The same as text."""
        return self._document

    def to_png(self) -> bytes:
        """The query in the map, before and after, as a PNG file's bytes."""
        return self._drawn().png()

    def to_html(self, path: str | os.PathLike[str] | None = None) -> str:
        """The report, one page with all it needs: the query in the map in three dimensions, every place that was weighed,
        every number beside its threshold. Written to ``path``, if one is given."""
        page = self._drawn().html()
        if path is not None:
            _winze.write_text(os.fspath(path), page)
        return page

    def _drawn(self) -> _winze.Drawing:
        if self._drawing is None:
            raise RuntimeError("this outcome has no clouds to draw (it was unpickled, or let go of them); ask again")
        return self._drawing

    def __str__(self) -> str:
        if self._drawing is None:
            return f"{self.verdict.value}: {self.reason}"
        return self._drawing.summary().rstrip()

    def __repr__(self) -> str:
        confidence = "" if self.confidence is None else f", confidence {self.confidence:.3f}"
        return f"<Outcome {self.verdict.value}{confidence}: {self.reason}>"

    def _repr_png_(self) -> bytes | None:
        return None if self._drawing is None else self.to_png()

    def without_clouds(self) -> Outcome:
        """The same numbers, without the clouds that it could be drawn from: to be kept in large numbers."""
        return Outcome(self._document, None)

    def __copy__(self) -> Outcome:
        # Nothing of it can be changed.
        return self

    def __deepcopy__(self, memo: Any) -> Outcome:
        return self

    def __reduce__(self) -> Any:
        return (Outcome, (self._document, None))
