"""The pages about Python: their code runs, prints what they say and draws what they show."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest

import winze
from conftest import pose_error
from pages import ROOT, Page, assert_prints

TUTORIAL = ROOT / "docs/python.md"
README = ROOT / "crates/winze-py/README.md"


def there(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def can_draw() -> bool:
    """Whether Open3D can draw off-screen. Tried in a process of its own: without a driver some versions abort."""
    script = "import open3d as o3d; o3d.visualization.rendering.OffscreenRenderer(8, 8).render_to_image()"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=120).returncode == 0


def is_blank(path) -> bool:
    """Whether an image shows one colour."""
    import matplotlib.image

    pixels = matplotlib.image.imread(path)[..., :3]
    return float(pixels.std()) < 0.02


@pytest.fixture
def handed(monkeypatch):
    """What draw_geometries is handed: nobody is there to close its window."""
    handed: list = []
    if there("open3d"):
        import open3d as o3d

        monkeypatch.setattr(o3d.visualization, "draw_geometries", lambda geometries, **_: handed.extend(geometries))
    return handed


class NotRun(UserWarning):
    """Some code of a page was not run."""


# The page starts processes however Python does by default, which may be to fork beside threads.
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
@pytest.mark.filterwarnings("ignore::DeprecationWarning:matplotlib", "ignore::DeprecationWarning:open3d")
@pytest.mark.filterwarnings("default::test_tutorial.NotRun")
def test_the_tutorial(tmp_path, monkeypatch, handed):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    page = Page(TUTORIAL, "winze_tutorial")
    left_out = []
    renders = None
    for code in page.blocks():
        if code.needs("open3d") and not there("open3d"):
            left_out.append(f"line {code.line}: no Open3D")
            continue
        if "OffscreenRenderer" in code.text:
            renders = there("open3d") and can_draw()
            if not renders:
                left_out.append(f"line {code.line}: Open3D is not there or cannot draw off-screen")
                continue
        printed = page.run(code)
        if code.prints is not None:
            assert_prints(code, printed, TUTORIAL)
        else:
            # Open3D tells what it draws with.
            said = [line for line in printed.splitlines() if line and "[Open3D " not in line]
            assert not said, f"line {code.line} prints, and the page does not show it: {said}"

    shown = re.findall(r"\]\(images/(python-[\w-]+\.png)\)", page.text)
    assert len(shown) == 4
    for name in shown:
        committed = ROOT / "docs/images" / name
        assert committed.stat().st_size < 200_000 and not is_blank(committed), name
        if name != "python-open3d.png" or renders:
            assert (tmp_path / name).exists() and not is_blank(tmp_path / name), name
    assert (tmp_path / "found.html").read_text(encoding="utf-8").lower().startswith("<!doctype html>")
    assert not is_blank(tmp_path / "found.png")

    distance, degrees = pose_error(page["outcome"].pose, page["truth"], page["query"].points.mean(0))
    assert distance < 0.02 and degrees < 0.1
    if there("open3d"):
        rock, found = handed
        assert len(rock.points) > 50_000 and len(found.points) > 10_000 and rock.has_colors()
        # The query was moved to where the truth puts it.
        low, high = rock.get_min_bound() - 0.5, rock.get_max_bound() + 0.5
        inside = ((np.asarray(found.points) > low) & (np.asarray(found.points) < high)).all(axis=1)
        assert inside.mean() > 0.9
    if left_out:
        warnings.warn("left out of the tutorial: " + "; ".join(left_out), NotRun, stacklevel=1)


def test_the_readme(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = Page(README, "winze_readme")
    (code,) = page.blocks()
    assert "[[" in page.run(code)
    assert page["outcome"].located and (tmp_path / "found.html").exists()
    for named in re.findall(r"`((?:docs|crates)/[\w./-]+)`", page.text):
        assert (ROOT / named).exists(), named


def test_names_on_the_pages_are_there():
    for path in (TUTORIAL, README, ROOT / "docs/coming-from-open3d-and-pcl.md"):
        for name in re.findall(r"\bwinze\.(\w+)", path.read_text(encoding="utf-8")):
            assert hasattr(winze, name), f"{path.name}: winze.{name}"


def test_links_on_the_pages_lead_somewhere():
    for path in (TUTORIAL, ROOT / "docs/coming-from-open3d-and-pcl.md"):
        text = path.read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            file, _, anchor = target.partition("#")
            other = path.parent / file if file else path
            assert other.exists(), f"{path.name}: {target}"
            if anchor:
                heads = re.findall(r"^#+ (.*)$", other.read_text(encoding="utf-8"), re.MULTILINE)
                anchors = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in heads}
                assert anchor in anchors, f"{path.name}: {target}"


def test_examples_in_docstrings(demo, tmp_path, monkeypatch):
    """The one in the module's own docstring, with the demo's files."""
    monkeypatch.chdir(tmp_path)
    winze.write("map.pcd", demo[0])
    winze.write("query.pcd", demo[1])
    block = re.search(r"::\n\n((?:    .*\n|\n)+)", winze.__doc__)
    namespace: dict = {}
    exec("\n".join(line[4:] for line in block[1].splitlines()), namespace)
    assert namespace["outcome"].located
