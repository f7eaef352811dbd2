"""One question, asked in every form."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess

import numpy as np
import pytest

import winze
from conftest import pose_error


def numbers(outcome: winze.Outcome | dict) -> dict:
    """All that does not depend on the clock or on where the clouds came from."""
    values = outcome if isinstance(outcome, dict) else outcome.to_dict()
    keep = {k: v for k, v in values.items() if k not in ("stages", "seconds", "map", "query")}
    stages = [(s["name"], s["in"], s["out"]) for s in values["stages"]]
    return keep | {"stages": [s for s in stages if not s[0].startswith("read ")]}


def test_the_demo_is_located(demo, demo_outcome):
    _, query, truth = demo
    assert demo_outcome.verdict is winze.Verdict.LOCATED
    assert demo_outcome.verdict == "located" and demo_outcome.located
    assert demo_outcome.pose.shape == (4, 4) and demo_outcome.pose.dtype == np.float64
    distance, angle = pose_error(demo_outcome.pose, truth, query.points.mean(0))
    assert distance < 0.05 and angle < 0.3
    assert demo_outcome.error.translation == pytest.approx(distance, abs=1e-6)
    assert np.degrees(demo_outcome.error.rotation) == pytest.approx(angle, abs=1e-6)


def test_what_an_outcome_tells(demo, demo_outcome):
    o = demo_outcome
    assert 0.9 < o.confidence < 1.0
    assert np.array_equal(o.covariance, o.covariance.T) and o.covariance.shape == (6, 6)
    assert (np.linalg.eigvalsh(o.covariance) > 0).all()
    assert np.allclose(o.covariance_at, o.transform(demo[1].points).mean(0), atol=1e-3)
    assert o.unobservable == []
    assert np.array_equal(o.hypotheses[0].map_from_query, o.pose)
    assert o.hypotheses[0].patches.confirmed > 15 and not o.hypotheses[1].rival
    assert [s.name for s in o.stages][:2] == ["measure map", "measure query"]
    assert o.stages[0].count_in == len(demo[0])
    assert 0.8 < o.inlier_fraction < 1 and o.inlier_rmse < 0.2
    assert json.loads(o.to_json()) == o.to_dict()
    assert o.to_dict()["verdict"] == "located" and o.method == "auto"
    assert "located" in repr(o) and "because" in str(o)


def test_it_shows_itself(demo_outcome, tmp_path):
    png = demo_outcome._repr_png_()
    assert png.startswith(b"\x89PNG") and png == demo_outcome.to_png()
    page = demo_outcome.to_html(tmp_path / "found.html")
    assert page.startswith("<!doctype html>") and (tmp_path / "found.html").read_text() == page
    assert "located" in page and "winze.locate(" in page


def test_an_outcome_is_pickled_without_its_clouds(demo_outcome):
    again = pickle.loads(pickle.dumps(demo_outcome))
    assert again.to_dict() == demo_outcome.to_dict()
    assert again._repr_png_() is None and "located" in str(again)
    with pytest.raises(RuntimeError, match="unpickled"):
        again.to_html()
    assert copy.deepcopy(demo_outcome).to_png() == demo_outcome.to_png()
    assert demo_outcome.without_clouds()._repr_png_() is None


def test_threads_and_forms_change_nothing(demo, demo_outcome, tmp_path):
    map_points, query_points = demo[0].points, demo[1].points
    expected = numbers(demo_outcome)
    winze.write(tmp_path / "map.pcd", map_points)
    winze.write(tmp_path / "query.ply", query_points)
    for given in (
        winze.locate(map_points, query_points, truth=demo[2], threads=1),
        winze.locate(np.asfortranarray(map_points), query_points[::-1][::-1], truth=demo[2], threads=3),
        winze.locate(tmp_path / "map.pcd", str(tmp_path / "query.ply"), truth=demo[2]),
    ):
        assert numbers(given) == expected


def test_the_command_line_says_the_same(demo, binary, tmp_path):
    winze.write(tmp_path / "map.pcd", demo[0])
    winze.write(tmp_path / "query.pcd", demo[1])
    np.savetxt(tmp_path / "truth.txt", demo[2], fmt="%.17g")
    for method in winze.METHODS:
        command = [binary, "locate", "map.pcd", "query.pcd", "--method", method, "--json", "-", "--quiet"]
        options = ["--seed", "3", "--truth", "truth.txt", "--set", "ransac.min_samples=20000"]
        run = subprocess.run([*command, *options], cwd=tmp_path, capture_output=True, text=True)
        assert run.returncode in (0, 1), run.stderr
        ours = winze.locate(
            tmp_path / "map.pcd",
            tmp_path / "query.pcd",
            method=method,
            seed=3,
            truth=demo[2],
            config={"ransac.min_samples": 20000},
        )
        theirs = json.loads(run.stdout)
        assert numbers(ours) == numbers(theirs)
        digests = [d["map"]["digest"] for d in (ours.to_dict(), theirs)]
        assert digests[0] == digests[1] is not None


def test_what_is_known_beforehand(demo):
    map_cloud, query, truth = demo
    at = truth[:3, :3] @ query.points.mean(0) + truth[:3, 3]
    assert winze.locate(map_cloud, query, near=[*at, 5.0]).located
    assert not winze.locate(map_cloud, query, near=[*(at + [40, 0, 0]), 5.0]).located
    upright = winze.locate(map_cloud, query, gravity_aligned=True)
    assert not upright.located, "the query is tilted"
    refined = winze.locate(map_cloud, query, method="ndt+icp", initial=truth)
    assert pose_error(refined.pose, truth, query.points.mean(0))[0] < 0.1


def test_not_to_know_is_an_answer():
    rng = np.random.default_rng(3)
    noise = rng.uniform(-10, 10, (3000, 3))
    outcome = winze.locate(noise, rng.uniform(-10, 10, (3000, 3)))
    assert outcome.verdict in (winze.Verdict.NOT_FOUND, winze.Verdict.AMBIGUOUS, winze.Verdict.INSUFFICIENT)
    few = winze.locate(noise, [[0, 0, 0]])
    assert few.verdict is winze.Verdict.INSUFFICIENT and few.pose is None and few.covariance is None
    assert few.confidence is None and few.hypotheses == [] and few.unobservable is None
    with pytest.raises(ValueError, match="no pose"):
        few.transform([[0, 0, 0]])
    assert few.to_png().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"method": "magic"}, ValueError, "method: .*auto"),
        ({"near": [0, 0, 0]}, ValueError, "radius"),
        ({"near": [0, 0, 0, -1]}, ValueError, "near"),
        ({"near": [0, 0, 0, float("nan")]}, ValueError, "near"),
        ({"near": [900, 900, 900, 1]}, ValueError, "no point of the map"),
        ({"initial": np.eye(3)}, ValueError, r"\(3, 3\)"),
        ({"initial": np.eye(4)}, ValueError, "ndt"),
        ({"method": "ndt+icp", "initial": 2 * np.eye(4)}, ValueError, "initial: not a rigid"),
        ({"truth": [["a"] * 4] * 4}, TypeError, "truth"),
        ({"threads": -1}, ValueError, "threads"),
        ({"threads": 1.5}, TypeError, "threads"),
        ({"threads": 2**64}, ValueError, "threads"),
        ({"seed": -1}, ValueError, "seed"),
        ({"seed": 2**64}, ValueError, "seed"),
        ({"seed": 1.5}, TypeError, "seed"),
        ({"config": {"scale.vxel": 1}}, ValueError, "vxel"),
        ({"config": {"scale": {"voxel": -1}}}, ValueError, "scale.voxel = -1"),
        ({"config": {"icp.kernel": "soft"}}, ValueError, "soft"),
        ({"config": {"scale.voxel": float("nan")}}, ValueError, "finite"),
        ({"config": {"scale.voxel": object()}}, TypeError, "object"),
        ({"config": 3}, TypeError, "Config"),
        ({"config": "nowhere.toml"}, FileNotFoundError, "nowhere"),
        ({"progress": 3}, TypeError, "progress"),
    ],
)
def test_wrong_questions_are_refused_by_name(demo, options, error, says):
    with pytest.raises(error, match=says):
        winze.locate(demo[0], demo[1], **options)


def test_seeds_of_sixty_four_bits(demo):
    for seed in (2**63, 2**64 - 1):
        assert winze.locate(demo[0], demo[1], method="ndt+icp", seed=seed).to_dict()["seed"] == seed
    assert winze.locate(demo[0], demo[1], method="ndt+icp", config=winze.Config(seed=5)).to_dict()["seed"] == 5


def test_what_a_reader_warns_of_is_heard(demo, tmp_path):
    (tmp_path / "q.xyz").write_text("0 0 0\nnan 1 2\n1 1 1\n")
    with pytest.warns(UserWarning, match="q.xyz: 1 points are not finite"):
        winze.locate(demo[0], tmp_path / "q.xyz")


def test_a_map_without_points_is_an_error(demo):
    for nothing in (np.zeros((0, 3)), np.full((200, 3), np.nan), np.zeros((200, 3))):
        with pytest.raises(ValueError, match="usable points in the map"):
            winze.locate(nothing, demo[1])


def test_files_that_cannot_be_read(tmp_path, demo):
    with pytest.raises(FileNotFoundError, match="nowhere.pcd"):
        winze.locate(tmp_path / "nowhere.pcd", demo[1])
    with pytest.raises(IsADirectoryError):
        winze.read(tmp_path)
    broken = tmp_path / "broken.pcd"
    broken.write_text("VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 10\nHEIGHT 1\nPOINTS 10\nDATA ascii\n0 0 0\n")
    with pytest.raises(ValueError, match="broken.pcd.*cut short"):
        winze.read(broken)
    with pytest.raises(FileNotFoundError, match="folder does not exist"):
        winze.write(tmp_path / "no" / "cloud.pcd", [[0, 0, 0]])
    with pytest.raises(ValueError, match="encoding"):
        winze.write(tmp_path / "cloud.pcd", [[0, 0, 0]], encoding="morse")


def test_files_keep_what_they_can(wall, tmp_path):
    utm = wall + [500_000, 4_500_000, 300]
    for name in ("a.pcd", "a.ply", "a.csv"):
        winze.write(tmp_path / name, winze.Cloud(utm, intensity=np.arange(4000) % 7))
        again = winze.read(tmp_path / name)
        assert np.abs(again.points - utm).max() < 1e-4, name
        assert np.array_equal(again.intensity, np.arange(4000) % 7), name
        assert again.report["points_in_file"] == 4000 and again.path == str(tmp_path / name)
    assert winze.read(tmp_path / "a.pcd").report["format"] == "PCD"


def test_jinchuan_from_every_array(data):
    """The real mine, from C, Fortran, f32, strided and big-endian arrays: equal poses."""
    map_cloud = winze.read(data / "jinchuan/map_2025-05-13.pcd")
    query = winze.read(data / "jinchuan/query_2025-04-21.pcd")
    truth = np.loadtxt(data / "jinchuan/T_map_query.txt")
    prepared = winze.Map.build(map_cloud)
    expected = winze.locate(map_cloud, query)
    distance, angle = pose_error(expected.pose, truth, query.points.mean(0))
    assert expected.located and distance < 0.15 and angle < 0.5
    q = query.points
    strided = np.full((len(q), 2, 5), np.nan)
    strided[:, 1, 1:4] = q
    arrays = {
        "C": q,
        "Fortran": np.asfortranarray(q),
        "f32": q.astype(np.float32),
        "strided": strided[:, 1, 1:4],
        "big endian": q.astype(">f8"),
    }
    assert arrays["f32"].astype(np.float64).tobytes() == q.tobytes(), "the file holds f32"
    on_map = prepared.locate(query)
    for name, given in arrays.items():
        found = prepared.locate(given)
        assert found.pose.tobytes() == on_map.pose.tobytes() == expected.pose.tobytes(), name
        assert found.verdict is expected.verdict and found.reason == on_map.reason, name
    found = winze.locate(np.asfortranarray(map_cloud.points).astype(">f4"), arrays["strided"])
    assert numbers(found) == numbers(expected)
