"""What several tests share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import winze

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def demo() -> tuple[winze.Cloud, winze.Cloud, np.ndarray]:
    """A small mine, a query and the truth, thinned: the tests ask often."""
    map_cloud, query, truth = winze.demo()
    return winze.voxel_downsample(map_cloud, 0.15), winze.voxel_downsample(query, 0.15), truth


@pytest.fixture(scope="session")
def demo_outcome(demo) -> winze.Outcome:
    return winze.locate(demo[0], demo[1], truth=demo[2])


@pytest.fixture(scope="session")
def wall() -> np.ndarray:
    """(4000, 3) float64, of values that float32 holds too: a rough wall with a corner."""
    rng = np.random.default_rng(7)
    a, b = rng.uniform(0, 8, (2, 2000, 2))
    bump = lambda p: 0.3 * np.sin(1.3 * p[:, 0]) * np.cos(1.7 * p[:, 1])  # noqa: E731
    floor = np.column_stack([a, bump(a)])
    side = np.column_stack([b[:, 0], 8 + bump(b[:, ::-1]), b[:, 1]])
    points = np.concatenate([floor, side]) + rng.normal(0, 0.005, (4000, 3))
    return points.astype(np.float32).astype(np.float64)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder with the real clouds, in WINZE_DATA or beside the project."""
    folder = ROOT / os.environ.get("WINZE_DATA", "../shared/data")
    if (folder / "jinchuan").is_dir():
        return folder
    if "WINZE_DATA" in os.environ or os.environ.get("WINZE_REQUIRE_DATA") == "1":
        pytest.fail(f"no real clouds in {folder}")
    pytest.skip("needs the clouds of WINZE_DATA")


@pytest.fixture(scope="session")
def binary() -> Path:
    """The command line, as `cargo build` or `cargo test` left it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    built = [p for p in (target / profile / "winze" for profile in ("debug", "release")) if p.exists()]
    if built:
        return max(built, key=lambda p: p.stat().st_mtime)
    if os.environ.get("WINZE_REQUIRE_BINARY") == "1":
        pytest.fail(f"no command line in {target}")
    pytest.skip("needs the command line: cargo build")


def pose_error(pose: np.ndarray, truth: np.ndarray, at: np.ndarray) -> tuple[float, float]:
    """Displacement of a point and angle, metres and degrees."""
    moved = (pose[:3, :3] - truth[:3, :3]) @ at + pose[:3, 3] - truth[:3, 3]
    cosine = (np.trace(pose[:3, :3].T @ truth[:3, :3]) - 1) / 2
    return float(np.linalg.norm(moved)), float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
