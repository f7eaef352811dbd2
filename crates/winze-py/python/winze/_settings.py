"""Settings from whatever form they are given in."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, Union

from . import _config, _winze
from ._arrays import whole
from ._config import Config

#: Settings: a Config, of which those count that are not the default; a mapping of sections to mappings or of dotted names to
#: values, such as ``{"scale.voxel": 0.3}``; or a TOML file's path, as ``--config``. Of the latter two all count that are named, so that one can
#: ask for a default against what a built map carries (which is an error: it was built with another value).
ConfigLike = Union[Config, Mapping[str, Any], str, "os.PathLike[str]", None]

Section = TypeVar("Section")


def changed(config: ConfigLike, seed: int | None = None) -> tuple[str, int | None]:
    """The settings that were made, as JSON, and the seed, which TOML could not hold in full."""
    table: dict[str, Any]
    if config is None:
        table = {}
    elif isinstance(config, Config):
        table = _differences(config, Config())
    elif isinstance(config, Mapping):
        table = {str(k): _section(v) for k, v in config.items()}
    elif isinstance(config, (str, os.PathLike)):
        table = _of_file(config)
    else:
        raise TypeError(f"config: {type(config).__name__}; give a winze.Config, a dict or a TOML file's path")
    own = table.pop("seed", None)
    chosen = own if seed is None else seed
    return _json(table), None if chosen is None else whole(chosen, "seed", 2**64 - 1)


def _section(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _differences(value, type(value)())
    return dict(value) if isinstance(value, Mapping) else value


def section(key: str, config: Any) -> str:
    """The settings of one stage that are not the default, as JSON."""
    of = getattr(_config, f"{key.capitalize()}Config")
    if config is None:
        return "{}"
    if isinstance(config, Config):
        config = getattr(config, key)
    if isinstance(config, Mapping):
        return _json({key: dict(config)})
    if not isinstance(config, of):
        raise TypeError(f"config: {type(config).__name__} where a winze.{of.__name__} or a dict is expected")
    return _json({key: _differences(config, of())})


def _json(table: dict[str, Any]) -> str:
    try:
        return json.dumps(table, allow_nan=False, default=_scalar)
    except ValueError:
        raise ValueError("config: a value is not finite") from None


def _scalar(value: Any) -> Any:
    # NumPy's own numbers.
    if hasattr(value, "item") and getattr(value, "ndim", 1) == 0:
        return value.item()
    raise TypeError(f"config: {type(value).__name__} is no value of a setting")


def _differences(config: Any, default: Any) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for f in dataclasses.fields(config):
        value, usual = getattr(config, f.name), getattr(default, f.name)
        if dataclasses.is_dataclass(usual):
            below = _differences(value, usual)
            if below:
                table[f.name] = below
        elif value != usual:
            table[f.name] = value
    return table


def read_config(path: str | os.PathLike[str]) -> Config:
    """Settings of a TOML file, as ``winze config`` prints it and ``--config`` reads it.

    Raises ``ValueError`` with the line or the key where something is wrong, ``OSError`` where the file cannot be read.
    """
    values: dict[str, Any] = {}
    for key, value in _of_file(path).items():
        if isinstance(value, dict):
            value = getattr(_config, f"{key.capitalize()}Config")(**value)
        values[key] = value
    return Config(**values)


def config_text(config: ConfigLike = None) -> str:
    """All settings as TOML with what each one means and may be, for :func:`read_config` and for ``--config``.

    Raises ``ValueError`` where a name is not known or a value is outside its domain.
    """
    return _winze.config_text(*changed(config))


def _of_file(path: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        table: dict[str, Any] = json.loads(_winze.parse_config(Path(path).read_text(encoding="utf-8")))
    except ValueError as e:
        raise ValueError(f"{os.fspath(path)}: {e}") from None
    return table
