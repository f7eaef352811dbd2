"""Writes ``python/winze/_config.py`` from the settings that the Rust crates declare.

    python tools/make_config.py            # prints it
    python tools/make_config.py --write    # in its place

A test holds the file against what this prints.
"""

import importlib.util
import json
import sys
import textwrap
from pathlib import Path

PLACE = Path(__file__).parent.parent / "python" / "winze" / "_config.py"

HEAD = '''"""Settings, one frozen class a stage. Made by ``tools/make_config.py``; do not edit.

A length is metres (``0.5``) or a multiple of the voxel size (``"3 voxels"``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, Union

#: Metres, or a multiple of the voxel size: ``0.5``, ``"0.5 m"``, ``"3 voxels"``.
Length = Union[float, str]


'''


def class_name(key: str) -> str:
    return f"{key.capitalize()}Config"


def is_length(field: dict) -> bool:
    return isinstance(field["default"], str) and not field["choices"]


def annotation(field: dict) -> str:
    default = field["default"]
    if field["choices"] and isinstance(default, str):
        return f"Literal[{', '.join(json.dumps(c) for c in field['choices'])}]"
    if is_length(field):
        return "Length"
    return type(default).__name__


def default(field: dict) -> str:
    value = field["default"]
    return json.dumps(value) if isinstance(value, str) else repr(value)


def wrapped(text: str, indent: str) -> str:
    lines = textwrap.wrap(text, 100 - len(indent))
    return ("\n" + indent).join(lines)


def sentence(text: str) -> str:
    return text[:1].upper() + text[1:] if text[:1].isascii() else text


def doc(field: dict) -> str:
    text = sentence(field["doc"].replace("`", "``").rstrip(",;"))
    text = text if text.endswith(".") else text + "."
    rule = field["rule"]
    return text if rule == "may be anything" else f"{text} {sentence(rule)}."


def section(s: dict) -> str:
    lines = ["@dataclass(frozen=True, kw_only=True)", f"class {class_name(s['key'])}:"]
    lines.append(f'    """{wrapped(s["doc"].replace("`", "``"), "    ")}"""')
    for f in s["fields"]:
        lines.append("")
        lines.append(f"    {f['name']}: {annotation(f)} = {default(f)}")
        lines.append(f'    """{wrapped(doc(f), "    ")}"""')
    return "\n".join(lines)


def whole(schema: dict) -> str:
    parts = [HEAD + "\n\n\n".join(section(s) for s in schema["sections"])]
    lines = ["@dataclass(frozen=True, kw_only=True)", "class Config:"]
    lines.append('    """All settings: one section a stage. ``dataclasses.replace`` makes others of them."""')
    lines += ["", f"    seed: int = {schema['seed']}", '    """Seed of every random choice (``auto`` makes none)."""']
    for s in schema["sections"]:
        lines += ["", f"    {s['key']}: {class_name(s['key'])} = field(default_factory={class_name(s['key'])})"]
        lines.append(f'    """{wrapped(s["doc"].replace("`", "``"), "    ")}"""')
    parts.append("\n".join(lines))
    return "\n\n\n".join(parts) + "\n"


def schema() -> dict:
    """What the compiled module tells, also where the package around it cannot be imported for want of this file."""
    package = importlib.util.find_spec("winze")
    folder = Path(package.submodule_search_locations[0])
    compiled = importlib.util.spec_from_file_location("winze._winze", next(folder.glob("_winze*.so")))
    module = importlib.util.module_from_spec(compiled)
    compiled.loader.exec_module(module)
    return json.loads(module.config_schema())


if __name__ == "__main__":
    text = whole(schema())
    if "--write" in sys.argv:
        PLACE.write_text(text)
    else:
        sys.stdout.write(text)
