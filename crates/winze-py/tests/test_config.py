"""Settings are those of Rust and of the command line."""

from __future__ import annotations

import dataclasses
import json
import runpy
import subprocess
from pathlib import Path

import pytest

import winze
from winze import _winze

PACKAGE = Path(__file__).parent.parent


def test_the_classes_are_what_the_settings_say():
    tool = runpy.run_path(str(PACKAGE / "tools/make_config.py"))
    wanted = tool["whole"](json.loads(_winze.config_schema()))
    found = (Path(winze.__file__).parent / "_config.py").read_text()
    assert found == wanted, "run tools/make_config.py --write"


def test_the_defaults_are_the_defaults(binary):
    printed = subprocess.run([binary, "config"], capture_output=True, text=True, check=True).stdout
    assert winze.config_text() == winze.config_text(winze.Config()) == printed


def test_files_and_classes_say_the_same(tmp_path):
    config = winze.Config(
        seed=7,
        scale=winze.ScaleConfig(voxel=0.3),
        icp=winze.IcpConfig(metric="point-to-plane", max_distance="5 voxels", trim=0.9),
    )
    file = tmp_path / "settings.toml"
    file.write_text(winze.config_text(config))
    assert winze.config_text(winze.read_config(file)) == file.read_text()
    short = tmp_path / "short.toml"
    short.write_text("seed = 7\n[scale]\nvoxel = 0.3\n[icp]\nmetric = 'point-to-plane'\nmax_distance = '5 voxels'\ntrim = 0.9\n")
    assert winze.read_config(short) == config
    dotted = {"seed": 7, "scale.voxel": 0.3, "icp": {"metric": "point-to-plane", "max_distance": "5 voxels", "trim": 0.9}}
    assert winze.config_text(dotted) == file.read_text()
    for text, says in (("[iss\n", "line 1"), ("[iss]\ngama = 1\n", "gama"), ("[fpfh]\nradius = -1\n", "fpfh.radius")):
        file.write_text(text)
        with pytest.raises(ValueError, match=f"settings.toml: .*{says}"):
            winze.read_config(file)


def test_settings_are_frozen_and_checked(wall):
    with pytest.raises(dataclasses.FrozenInstanceError):
        winze.Config().scale.voxel = 3
    with pytest.raises(TypeError, match="gama"):
        winze.IssConfig(gama=1)
    with pytest.raises(ValueError, match="gamma_21 = 2: must lie between 0 and 1"):
        winze.iss_keypoints(wall, 0.3, winze.IssConfig(gamma_21=2.0))
    with pytest.raises(TypeError, match="IssConfig"):
        winze.iss_keypoints(wall, 0.3, winze.FpfhConfig())
    whole = winze.Config(iss=winze.IssConfig(min_keypoints=10))
    a, b = winze.iss_keypoints(wall, 0.3, whole), winze.iss_keypoints(wall, 0.3, whole.iss)
    assert a.indices.tolist() == b.indices.tolist()
