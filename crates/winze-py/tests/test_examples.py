"""The example programs, as one would start them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import winze
from conftest import pose_error

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture(scope="module")
def files(demo, tmp_path_factory):
    folder = tmp_path_factory.mktemp("examples")
    winze.write(folder / "map.pcd", demo[0])
    winze.write(folder / "query.pcd", demo[1])
    winze.Map.build(demo[0], folder / "mine.wmap")
    return folder


def start(name: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def printed_pose(text: str) -> np.ndarray:
    """The first matrix of an output."""
    numbers = text[text.index("[[") : text.index("]]")].replace("[", " ").replace("]", " ").split()
    return np.array(numbers, dtype=float).reshape(4, 4)


def test_two_clouds(files, demo):
    run = start("locate_two_clouds.py", files / "map.pcd", files / "query.pcd")
    assert run.returncode == 0, run.stderr
    assert run.stdout.startswith("located: ")
    assert pose_error(printed_pose(run.stdout), demo[2], demo[1].points.mean(0))[0] < 0.05
    assert (files / "query.html").exists()


def test_two_clouds_that_do_not_belong_together(files, tmp_path):
    rng = np.random.default_rng(3)
    winze.write(tmp_path / "noise.pcd", rng.uniform(-10, 10, (3000, 3)))
    run = start("locate_two_clouds.py", files / "map.pcd", tmp_path / "noise.pcd")
    assert run.returncode == 1 and "[[" not in run.stdout, run.stderr


def test_own_pipeline(files, demo):
    run = start("own_pipeline.py", files / "map.pcd", files / "query.pcd")
    assert run.returncode == 0, run.stderr
    assert pose_error(printed_pose(run.stdout), demo[2], demo[1].points.mean(0))[0] < 0.1


def test_many_queries(files, demo):
    run = start("many_queries.py", files / "mine.wmap", files / "query.pcd", files / "query.pcd")
    assert run.returncode == 0, run.stderr
    assert run.stdout.count(": located in ") == 2
    assert pose_error(printed_pose(run.stdout), demo[2], demo[1].points.mean(0))[0] < 0.05


@pytest.mark.parametrize("name", sorted(p.name for p in EXAMPLES.glob("*.py")))
def test_without_arguments_they_say_how(name):
    run = start(name)
    assert run.returncode == 1 and f"python {name}" in run.stderr


def test_they_are_typed():
    pytest.importorskip("mypy")
    package = Path(winze.__file__).parent.parent
    # Where it is installed mypy finds it by itself, and wants no other way there.
    path = {} if package.name == "site-packages" else {"MYPYPATH": str(package)}
    # The stubs of a new NumPy are read as nothing older than the Python it is for.
    version = f"--python-version={sys.version_info.major}.{sys.version_info.minor}"
    run = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", version, *map(str, sorted(EXAMPLES.glob("*.py")))],
        capture_output=True,
        text=True,
        env={**path, "PATH": "/usr/bin:/bin"},
        cwd=EXAMPLES,
    )
    assert run.returncode == 0, run.stdout + run.stderr
