"""Telling how far long work is."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Union

#: Called with what is being done and the share of all work that is over (0 to 1, None where it is not known), from
#: another thread than the caller's. ``True`` shows a tqdm bar, if tqdm is there. What it raises ends the work.
Progress = Union[bool, Callable[[str, Union[float, None]], object], None]


@contextmanager
def following(progress: Progress) -> Iterator[Callable[[str, float | None], object] | None]:
    """The callback of whoever wants to follow."""
    if progress is None or progress is False:
        yield None
    elif progress is True:
        try:
            tqdm = importlib.import_module("tqdm.auto").tqdm
        except ImportError:
            yield None
            return
        bar: Any = tqdm(total=1.0, bar_format="{l_bar}{bar}| {elapsed}", leave=False)
        try:
            yield lambda what, done: _advance(bar, what, done)
        finally:
            bar.close()
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress: {type(progress).__name__} is neither a function nor True")


def _advance(bar: Any, what: str, done: float | None) -> None:
    bar.set_description(what, refresh=False)
    if done is not None:
        bar.update(max(0.0, min(done, 1.0) - bar.n))
    bar.refresh()
