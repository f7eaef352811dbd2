"""Long work: threads, progress, interruption, forks."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import winze

LONG = """
import signal, time
import numpy as np
import winze
rng = np.random.default_rng(1)
points = rng.uniform(0, 30, (1_500_000, 3))
# Whoever runs the tests in the background has it ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
def work():
    {work}

print("ready", flush=True)
try:
    # In a function: what is raised between the turns of a loop in this block itself, CPython 3.11 does not always catch here.
    work()
except KeyboardInterrupt:
    print("interrupted", time.time(), flush=True)
"""

WORK = {
    "locate": "winze.locate(points, points[::3])",
    "normals": "winze.estimate_normals(points, config=winze.PrepareConfig(normal_most=200, normal_radius=0.0), threads=1)",
    "fpfh": "winze.fpfh(points, np.ones_like(points) / 3**0.5, voxel=0.3)",
    "map": "winze.Map.build(points)",
    "voxels": "while True: winze.voxel_downsample(points, 0.05)",
    "write": "import tempfile; winze.write(tempfile.mkdtemp() + '/a.csv', np.tile(points, (20, 1)))",
    "simulate": "import tempfile; winze.simulate('aliasing', tempfile.mkdtemp())",
}


@pytest.mark.parametrize("name", WORK)
def test_ctrl_c_ends_it_soon(name):
    script = LONG.format(work=WORK[name])
    run = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    too_long = threading.Timer(60, run.kill)
    too_long.start()
    assert run.stdout.readline() == "ready\n"
    time.sleep(1.0)
    sent = time.time()
    run.send_signal(signal.SIGINT)
    said = run.stdout.readline().split()
    too_long.cancel()
    assert said and said[0] == "interrupted", "the work was over before it was interrupted, or was not heard"
    assert float(said[1]) - sent < 10
    run.stdout.close()
    assert run.wait(20) == 0


def test_interrupted_work_leaves_nothing_behind(demo, tmp_path):
    def stop(what, done):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        winze.Map.build(demo[0], tmp_path / "a.wmap", progress=stop)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(RuntimeError, match="enough"):
        winze.simulate("dust", tmp_path / "mine", count=1, progress=stop)
    assert not (tmp_path / "mine/cases.json").exists() and not (tmp_path / "mine/.making").exists()


def test_progress_is_told(demo, capsys):
    told = []
    outcome = winze.locate(demo[0], demo[1], progress=lambda what, done: told.append((what, done)))
    names = [what for what, _ in told]
    assert "describe map" in names and names[-1] == "done" and told[-1][1] == 1.0
    shares = [done for _, done in told]
    assert shares == sorted(shares) and 0 <= shares[0]
    assert outcome.located
    pytest.importorskip("tqdm")
    winze.Map.build(demo[0], progress=True)
    assert "%" in capsys.readouterr().err


def test_what_a_callback_raises_ends_the_work(demo):
    def stop(what, done):
        if what == "estimate":
            raise LookupError(what)

    with pytest.raises(LookupError, match="estimate"):
        winze.locate(demo[0], demo[1], progress=stop)
    assert winze.locate(demo[0], demo[1]).located, "the threads work again"


def test_the_gil_is_released(demo):
    beats = []
    over = threading.Event()

    def beat():
        while not over.is_set():
            beats.append(time.perf_counter())
            time.sleep(0.001)

    other = threading.Thread(target=beat)
    other.start()
    begun = time.perf_counter()
    winze.locate(demo[0], demo[1], threads=1)
    took = time.perf_counter() - begun
    over.set()
    other.join()
    during = [b for b in beats if begun < b < begun + took]
    assert len(during) > 20 and np.diff(during).max() < max(0.5 * took, 0.5)


def test_python_threads_get_the_same_answer(demo, demo_outcome):
    kept = winze.Map.build(demo[0])
    found = [None] * 6

    def ask(i):
        found[i] = kept.locate(demo[1], threads=1 + i % 2)

    threads = [threading.Thread(target=ask, args=(i,)) for i in range(6)]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert {o.pose.tobytes() for o in found} == {demo_outcome.pose.tobytes()}


def count_points(points):
    return len(winze.voxel_downsample(points, 0.5)), os.getpid()


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own(wall):
    expected = len(winze.voxel_downsample(wall, 0.5))
    with multiprocessing.get_context("fork").Pool(2) as pool:
        found = pool.map_async(count_points, [wall] * 4).get(timeout=60)
    assert {n for n, _ in found} == {expected} and os.getpid() not in {p for _, p in found}
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply_async(count_points, (winze.Cloud(wall),)).get(timeout=60)[0] == expected


def test_a_callback_may_ask_winze_itself(demo, wall):
    inner = []

    def ask(what, done):
        if what == "match":
            inner.append(len(winze.voxel_downsample(wall, 0.5, threads=1)))

    assert winze.locate(demo[0], demo[1], progress=ask, threads=1).located
    assert inner and set(inner) == {len(winze.voxel_downsample(wall, 0.5))}


def test_what_ends_a_program_ends_it(demo):
    def leave(what, done):
        raise SystemExit(3)

    with pytest.raises(SystemExit):
        winze.locate(demo[0], demo[1], progress=leave)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_in_the_middle_of_work(demo, wall):
    """A child of a process whose other threads are at work has threads of its own."""
    over = threading.Event()

    def work():
        while not over.is_set():
            winze.estimate_normals(demo[0], threads=1)

    busy = threading.Thread(target=work)
    busy.start()
    try:
        for _ in range(5):
            with multiprocessing.get_context("fork").Pool(1) as pool:
                assert pool.apply_async(count_points, (wall,)).get(timeout=60)[0] > 0
    finally:
        over.set()
        busy.join()
