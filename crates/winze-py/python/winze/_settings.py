"""Settings from whatever form they are given in."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar, Union

from . import _config, _winze
from ._config import Config

#: All settings, or only those that are not to be the default: a Config, or a mapping of sections to mappings or of dotted names to
#: values, such as ``{"scale.voxel": 0.3}``.
ConfigLike = Union[Config, Mapping[str, Any], None]

Section = TypeVar("Section")


def changed(config: ConfigLike, seed: int | None = None) -> str:
    """The settings that are not the default, as JSON."""
    table: dict[str, Any]
    if config is None:
        table = {}
    elif isinstance(config, Config):
        table = _differences(config, Config())
    elif isinstance(config, Mapping):
        table = {k: dict(v) if isinstance(v, Mapping) else v for k, v in config.items()}
    else:
        raise TypeError(f"config: {type(config).__name__}; give a winze.Config or a dict")
    if seed is not None:
        table["seed"] = seed
    return _json(table)


def section(key: str, config: Any) -> str:
    """The settings of one stage that are not the default, as JSON."""
    of = getattr(_config, f"{key.capitalize()}Config")
    if config is None:
        return "{}"
    if isinstance(config, Config):
        config = getattr(config, key)
    if not isinstance(config, of):
        raise TypeError(f"config: {type(config).__name__} where a winze.{of.__name__} is expected")
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
    try:
        table = json.loads(_winze.parse_config(Path(path).read_text(encoding="utf-8")))
    except ValueError as e:
        raise ValueError(f"{os.fspath(path)}: {e}") from None
    values: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict):
            value = getattr(_config, f"{key.capitalize()}Config")(**value)
        values[key] = value
    return Config(**values)


def config_text(config: ConfigLike = None) -> str:
    """All settings as TOML with what each one means and may be, for :func:`read_config` and for ``--config``.

    Raises ``ValueError`` where a name is not known or a value is outside its domain.
    """
    return _winze.config_text(changed(config))
