"""Simulated mines and evaluations, as the command line makes them."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

import winze

SCENARIO = str(Path(__file__).parent / "small_mine.toml")


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
    out = tmp_path_factory.mktemp("mine") / "made"
    return out, winze.simulate(SCENARIO, out, seed=5, count=2, mesh=False)


def test_a_mine_with_its_truth(mine):
    out, cases = mine
    assert "dust" in winze.scenarios() and len(cases) == 2
    assert [c.name for c in winze.read_cases(out / "cases.json")] == [c.name for c in cases]
    for case in cases:
        assert case.map.exists() and case.query.exists()
        if case.truth is not None:
            found = winze.locate(case.map, case.query, truth=case.truth)
            assert found.error is None or np.isfinite(found.error).all()
            assert (found.error is None) == (found.pose is None)


def test_the_command_line_makes_the_same(mine, binary, tmp_path):
    command = [binary, "sim", SCENARIO, "--count", "2", "--no-mesh", "--seed", "5", "--out", tmp_path / "made", "-q"]
    subprocess.run(command, check=True)
    names = sorted(p.relative_to(mine[0]) for p in mine[0].rglob("*") if p.is_file())
    assert names == sorted(p.relative_to(tmp_path / "made") for p in (tmp_path / "made").rglob("*") if p.is_file())
    for name in names:
        assert (mine[0] / name).read_bytes() == (tmp_path / "made" / name).read_bytes(), name


def test_an_evaluation(mine, binary, tmp_path):
    told = []
    evaluation = winze.evaluate(
        mine[0], method=["auto", "fpfh+icp"], every=2, progress=lambda what, done: told.append(done)
    )
    assert told[-1] == 1.0 and str(evaluation).count("auto") >= 2
    command = [binary, "eval", mine[0], "-m", "auto", "-m", "fpfh+icp", "--every", "2", "--together", "--json", "-", "-q"]
    theirs = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    clock = {"seconds", "again", "query_kept"}
    ours = [{k: v for k, v in run.items() if k not in clock} for run in evaluation.runs]
    assert ours == [{k: v for k, v in run.items() if k not in clock} for run in theirs["runs"]]
    assert [s["wrong_accepts"] for s in evaluation.summaries] == [s["wrong_accepts"] for s in theirs["summaries"]]
    with pytest.raises(ValueError, match="no case"):
        winze.evaluate(mine[0], only="nothing*")
    with pytest.raises(ValueError, match="methods"):
        winze.evaluate(mine[0], method="magic")
    for wrong in (-1, 2**63):
        with pytest.raises(ValueError, match="seeds"):
            winze.evaluate(mine[0], seeds=wrong)
    for ask in (winze.evaluate, winze.read_cases):
        with pytest.raises(FileNotFoundError):
            ask(tmp_path / "none")
        (tmp_path / "cases.json").write_text('{"cases": [{"name": "a", "map": "m", "query": "q"}]}')
        with pytest.raises(ValueError, match=r"cases.json: case 1 \(a\): truth"):
            ask(tmp_path)


def test_scenarios_that_are_none(tmp_path):
    with pytest.raises(ValueError, match="nowhere"):
        winze.simulate("nowhere", tmp_path / "a")
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ValueError, match=str(tmp_path)):
        winze.simulate(SCENARIO, tmp_path, count=1)


def test_the_demo_is_the_command_lines(binary, tmp_path):
    demo = winze.demo()
    subprocess.run([binary, "demo", "--out", tmp_path / "demo", "-q"], check=True)
    assert np.array_equal(winze.read(tmp_path / "demo/map.pcd").points, demo[0].points)
    assert np.array_equal(winze.read(tmp_path / "demo/query.pcd").points, demo[1].points)
    assert np.allclose(np.loadtxt(tmp_path / "demo/truth.txt"), demo[2], atol=1e-12)
