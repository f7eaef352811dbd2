"""Simulated mines, case files, and methods over them."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _winze
from ._arrays import whole
from ._locate import Method
from ._progress import Progress, following
from ._settings import ConfigLike, changed


@dataclass(frozen=True, eq=False)
class Case:
    """A query that is asked in a map, and the right answer."""

    name: str
    """Its name."""
    map: Path
    """The map's file."""
    query: Path
    """The query's file."""
    truth: npt.NDArray[np.float64] | None
    """(4, 4) true ``map_from_query``; None where the query is not in this map."""
    family: str
    """The kind of case."""
    values: dict[str, Any]
    """All that is known of it: gravity_aligned, overlap, ambiguous, alternatives, unobservable, tolerance, sensor, ..."""


def scenarios() -> dict[str, str]:
    """The built-in scenarios, by name, with what each is about."""
    return {name: f"{about} ({cases} cases)" for name, about, cases in _winze.scenarios()}


def simulate(
    scenario: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    seed: int = 0,
    count: int | None = None,
    mesh: bool = True,
    threads: int = 0,
    progress: Progress = None,
) -> list[Case]:
    """Makes a simulated mine with its map, its queries and the truth, as ``winze sim`` does: the same bytes.

    Args:
        scenario: a name of :func:`scenarios`, or a TOML file.
        out: folder to write to: new, empty, or of an earlier run of the same scenario.
        seed: of everything random.
        count: queries a mine, at most.
        mesh: whether the mine itself is written too.
        threads: how many to work on; 0: all.
        progress: as for :func:`locate`.

    Returns:
        The cases, also in ``out/cases.json``.
    """
    with following(progress) as callback:
        notes = _winze.simulate(
            os.fspath(scenario),
            os.fspath(out),
            seed=whole(seed, "seed", 2**64 - 1),
            count=None if count is None else whole(count, "count", 2**32),
            mesh=mesh,
            threads=whole(threads, "threads"),
            progress=callback,
        )
    for note in notes:
        warnings.warn(note, stacklevel=2)
    return read_cases(out)


def read_cases(path: str | os.PathLike[str]) -> list[Case]:
    """The cases of a ``cases.json``, or of the folder that holds one; paths count from where the program runs.

    Raises:
        OSError: where the file cannot be read.
        ValueError: where it is broken, with the case and the field.
    """
    return [
        Case(
            name=row["name"],
            map=Path(row["map"]),
            query=Path(row["query"]),
            truth=None if row["truth"] is None else np.array(row["truth"], dtype=np.float64),
            family=row["family"],
            values=row,
        )
        for row in json.loads(_winze.read_cases(os.fspath(path)))
    ]


class Evaluation:
    """What methods are worth on some cases. Prints itself as tables."""

    def __init__(self, document: str, text: str) -> None:
        self._document = document
        self._text = text

    def to_dict(self) -> dict[str, Any]:
        """All runs and what follows from them, with the fields of ``winze eval --json``."""
        values: dict[str, Any] = json.loads(self._document)
        return values

    @property
    def runs(self) -> list[dict[str, Any]]:
        """One a method, case and seed."""
        runs: list[dict[str, Any]] = self.to_dict()["runs"]
        return runs

    @property
    def summaries(self) -> list[dict[str, Any]]:
        """Recall, wrong accepts, refusals and errors by method and family."""
        rows: list[dict[str, Any]] = self.to_dict()["summaries"]
        return rows

    def __str__(self) -> str:
        return self._text.rstrip()

    def __repr__(self) -> str:
        return f"<Evaluation of {len(self.runs)} runs>"


def evaluate(
    cases: str | os.PathLike[str],
    *,
    method: Method | Iterable[Method] = "auto",
    seeds: int = 1,
    only: Iterable[str] = (),
    family: Iterable[str] = (),
    every: int = 1,
    config: ConfigLike = None,
    threads: int = 0,
    progress: Progress = None,
) -> Evaluation:
    """Asks all queries of a case file and holds the answers against the truth, as ``winze eval`` does, in this process.

    Args:
        cases: a ``cases.json``, or a folder that holds one.
        method: one or several.
        seeds: for how many seeds methods that draw at random are asked.
        only: names of the cases to ask, with ``*`` for anything.
        family: families likewise.
        every: of those, every so manieth.
        config: settings, see :func:`locate`.
        threads: how many to work on; 0: all.
        progress: as for :func:`locate`.
    """
    methods = [method] if isinstance(method, str) else list(method)
    patterns = [[p] if isinstance(p, str) else list(p) for p in (only, family)]
    settings, chosen = changed(config)
    with following(progress) as callback:
        document, text = _winze.evaluate(
            os.fspath(cases),
            methods=methods,
            seeds=whole(seeds, "seeds", 100_000),
            only=patterns[0],
            family=patterns[1],
            every=whole(every, "every", 2**32),
            set=settings,
            seed=chosen,
            command=f"winze.evaluate({os.fspath(cases)!r})",
            threads=whole(threads, "threads"),
            progress=callback,
        )
    return Evaluation(document, text)
