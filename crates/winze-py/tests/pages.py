"""The code of pages: their blocks, and the calls in their tables."""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import sys
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]

BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n^```text\n(.*?)^```\n)?", re.MULTILINE | re.DOTALL)


@dataclass
class Code:
    """Some lines of a page."""

    line: int
    text: str
    prints: str | None = None

    def needs(self, module: str) -> bool:
        return re.search(rf"^\s*import {module}\b", self.text, re.MULTILINE) is not None


class Page:
    """A page, whose code runs in one namespace."""

    def __init__(self, path: Path, name: str) -> None:
        self.path = path
        self.text = path.read_text(encoding="utf-8")
        # A module, so that what it defines can be pickled.
        self.module = types.ModuleType(name)
        sys.modules[name] = self.module

    def blocks(self) -> list[Code]:
        """The Python blocks, each with what it is said to print."""
        found = BLOCK.finditer(self.text)
        return [Code(self.text.count("\n", 0, m.start()) + 2, m[1], m[2]) for m in found]

    def tables(self) -> Iterator[tuple[list[str], list[list[list[Code]]]]]:
        """Tables: the heads, and the code of each cell of each row."""
        heads: list[str] = []
        rows: list[list[list[Code]]] = []
        for number, line in enumerate([*self.text.splitlines(), ""], 1):
            if line.startswith("|---"):
                continue
            if not line.startswith("| "):
                if rows:
                    yield heads, rows
                heads, rows = [], []
            elif not heads:
                heads = [cell.strip() for cell in line.strip("|").split("|")]
            else:
                cells = line.strip("|").split("|")
                rows.append([[Code(number, code) for code in re.findall(r"`([^`]+)`", c)] for c in cells])

    def run(self, code: Code) -> str:
        """Runs some lines, and answers what they print; an error tells the page's line."""
        printed = io.StringIO()
        compiled = compile("\n" * (code.line - 1) + code.text, str(self.path), "exec")
        with contextlib.redirect_stdout(printed):
            exec(compiled, self.module.__dict__)
        return printed.getvalue()

    def __getitem__(self, name: str) -> Any:
        return self.module.__dict__[name]


def assert_prints(code: Code, got: str, page: Path) -> None:
    """Whether lines print what the page says; ``...`` stands for anything."""
    assert code.prints is not None
    checker = doctest.OutputChecker()
    if not checker.check_output(code.prints, got, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE):
        raise AssertionError(f"{page}, line {code.line}, says\n{code.prints}\nbut prints\n{got}")
