"""Maps that are prepared once."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
import shutil
import sys

import numpy as np
import pytest

import winze


@pytest.fixture(scope="module")
def built(demo, tmp_path_factory):
    return winze.Map.build(demo[0], tmp_path_factory.mktemp("map") / "mine.wmap", crs="EPSG:32633")


def test_it_answers_as_the_cloud_does(demo, demo_outcome, built):
    outcome = built.locate(demo[1])
    assert outcome.pose.tobytes() == demo_outcome.pose.tobytes()
    assert outcome.verdict is demo_outcome.verdict and outcome.covariance.tobytes() == demo_outcome.covariance.tobytes()
    assert "finest level" in outcome.to_dict()["inlier_reference"]
    assert winze.locate(built, demo[1]).pose.tobytes() == outcome.pose.tobytes()
    assert winze.locate(built.path, demo[1]).pose.tobytes() == outcome.pose.tobytes()
    renamed = shutil.copy(built.path, built.path + ".of-today")
    assert winze.locate(renamed, demo[1]).pose.tobytes() == outcome.pose.tobytes(), "known by its content"
    assert outcome.to_png().startswith(b"\x89PNG") and "<html" in outcome.to_html()


def test_it_is_built_from_arrays_and_files_alike(demo, built, tmp_path):
    winze.write(tmp_path / "a.pcd", demo[0].points[::2])
    winze.write(tmp_path / "b.ply", demo[0].points[1::2])
    of_files = winze.Map.build([tmp_path / "a.pcd", str(tmp_path / "b.ply")])
    of_arrays = winze.Map.build([np.asfortranarray(demo[0].points[::2]), demo[0].points[1::2]])
    poses = {m.locate(demo[1]).pose.tobytes() for m in (of_files, of_arrays)}
    assert len(poses) == 1
    again = winze.Map.build([demo[0].points[::2], demo[0].points[1::2]])
    assert again.info()["digest"] == of_arrays.info()["digest"], "equal arrays, equal map"
    assert of_files.info()["points"] == built.info()["points"] == len(demo[0])
    assert len(winze.Map.build(demo[0].points[:500].tolist()).info()["sources"]) == 1
    of_generator = winze.Map.build(p for p in sorted(tmp_path.glob("*.p*")))
    assert of_generator.info()["points"] == len(demo[0])
    records = np.zeros(500, [("x", "f4"), ("y", "f4"), ("z", "f4")])
    for i, name in enumerate("xyz"):
        records[name] = demo[0].points[:500, i]
    assert winze.Map.build([records, records]).info()["points"] == 1000


def test_it_is_kept(demo, built, tmp_path):
    assert built.path.endswith("mine.wmap") and "EPSG:32633" == built.info()["crs"]
    built.check()
    passing = winze.Map.build(demo[0])
    assert passing.path is None
    with pytest.raises(TypeError, match="save"):
        pickle.dumps(passing)
    kept = passing.save(tmp_path / "kept.wmap")
    assert kept.path == str(tmp_path / "kept.wmap")
    assert kept.info()["digest"] == passing.info()["digest"]
    with pytest.raises(FileExistsError, match="replace"):
        passing.save(tmp_path / "kept.wmap")
    passing.save(tmp_path / "kept.wmap", replace=True)
    assert [p.name for p in tmp_path.iterdir()] == ["kept.wmap"], "nothing half-written is left"
    with pytest.raises(FileExistsError):
        winze.Map.build(demo[0], tmp_path / "kept.wmap")
    again = pickle.loads(pickle.dumps(kept))
    in_memory = winze.Map.open(kept.path, in_memory=True)
    for m in (again, in_memory):
        assert m.info()["digest"] == kept.info()["digest"]
    assert repr(kept).startswith(f"Map({len(demo[0])} points, ") and "kept.wmap" in repr(kept)
    assert copy.copy(passing) is passing and copy.deepcopy(kept) is kept
    with pytest.raises(FileNotFoundError, match="folder does not exist"):
        passing.save(tmp_path / "no" / "kept.wmap")
    assert kept.points.shape[1] == 3


def test_what_is_no_map(tmp_path, demo):
    with pytest.raises(FileNotFoundError):
        winze.Map.open(tmp_path / "none.wmap")
    (tmp_path / "text.wmap").write_text("hello")
    with pytest.raises(ValueError, match="no prepared map"):
        winze.Map.open(tmp_path / "text.wmap")
    kept = winze.Map.build(demo[0], tmp_path / "cut.wmap")
    whole = (tmp_path / "cut.wmap").read_bytes()
    del kept
    (tmp_path / "cut2.wmap").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="cut2.wmap"):
        winze.Map.open(tmp_path / "cut2.wmap")
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 0x55
    (tmp_path / "damaged.wmap").write_bytes(damaged)
    with pytest.raises(ValueError, match="damaged.wmap"):
        winze.Map.open(tmp_path / "damaged.wmap").check()
    with pytest.raises(TypeError, match=r"Map.build"):
        winze.Map()
    with pytest.raises(TypeError, match=r"clouds\[0\]: a winze.Map"):
        winze.Map.build(winze.Map.build(demo[0]))
    with pytest.raises(TypeError, match="query_points: a winze.Map"):
        winze.locate(demo[0], winze.Map.build(demo[0]))
    with pytest.raises(ValueError, match="none given"):
        winze.Map.build([])
    with pytest.raises(ValueError, match=r"clouds\[1\]"):
        winze.Map.build([demo[0], np.zeros((3, 7))])
    with pytest.raises(ValueError, match="^array_1.pcd: usable points.* 10, at least 100"):
        winze.Map.build(demo[0].points[:10])


def test_it_carries_its_settings(demo, tmp_path):
    kept = winze.Map.build(demo[0], tmp_path / "fine.wmap", config={"prepare.normal_least": 12})
    outcome = kept.locate(demo[1])
    assert outcome.located
    asked = winze.locate(demo[0], demo[1], config={"prepare.normal_least": 12})
    assert outcome.pose.tobytes() == asked.pose.tobytes()
    with pytest.raises(ValueError, match="normal_least"):
        kept.locate(demo[1], config={"prepare.normal_least": 20})
    # The default is a contradiction too, where it is said.
    (tmp_path / "usual.toml").write_text("[prepare]\nnormal_least = 16\n")
    for usual in ({"prepare.normal_least": 16}, tmp_path / "usual.toml"):
        with pytest.raises(ValueError, match="normal_least"):
            kept.locate(demo[1], config=usual)


def end(_):
    sys.exit(0)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_leaves_the_map_there(demo, tmp_path):
    passing = winze.Map.build(demo[0])
    child = multiprocessing.get_context("fork").Process(target=end, args=(passing,))
    child.start()
    child.join(60)
    assert child.exitcode == 0
    assert passing.save(tmp_path / "kept.wmap").info()["points"] == len(demo[0])
