"""What calling winze from Python costs, against the same call in Rust, on a million points.

    cargo build --release --example bench_calls
    python bench/python_overhead.py target/release/examples/bench_calls --out FOLDER

wants the module `winze` installed from a release wheel. Rust and Python take turns; each call begins with points in memory as float64
and ends with the result, in Python a NumPy array. Prints a table of the quickest of each, since whatever else a machine does
only adds, and how much memory each form of array takes on its way into a cloud; leaves every figure in FOLDER/python_overhead.json.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import winze

VOXEL, COARSE = 0.05, 0.3


def mine(count: int, seed: int) -> np.ndarray:
    """A rough drift with two crosscuts, `count` points."""
    rng = np.random.default_rng(seed)
    along, angle = rng.uniform(0, 1, count), rng.uniform(0, 2 * np.pi, count)
    which = rng.integers(0, 4, count)
    length = np.where(which < 2, 160.0, 60.0)
    x = along * length
    bump = sum(
        a * np.sin(k * x + m * angle + which * (1 + k))
        for a, k, m in ((0.3, 0.7, 2), (0.2, 1.9, 3), (0.12, 3.7, 1), (0.06, 8.1, 5))
    )
    r = 2.2 + bump
    across, up = r * np.cos(angle), 0.8 * r * np.sin(angle)
    points = np.empty((count, 3))
    main = which < 2
    points[main] = np.column_stack([x, across, up])[main]
    for w, at in ((2, 45.0), (3, 110.0)):
        cut = which == w
        points[cut] = np.column_stack([at + across, x + 2, up])[cut]
    return points + rng.normal(0, 0.008, (count, 3))


def python_calls(points: np.ndarray, query: np.ndarray, threads: int, from_cloud: bool) -> dict[str, float]:
    """Seconds of each call."""
    seconds: dict[str, float] = {}

    def timed(name, work):
        begun = time.perf_counter()
        done = work()
        seconds[name] = time.perf_counter() - begun
        return done

    t = {"threads": threads}
    cloud = timed("Cloud", lambda: winze.Cloud(points))
    p = cloud if from_cloud else points
    q = winze.Cloud(query) if from_cloud else query
    timed("voxel_downsample", lambda: winze.voxel_downsample(p, VOXEL, **t))
    timed("remove_outliers", lambda: winze.remove_outliers(p, VOXEL, return_indices=True, **t))
    normals = timed("estimate_normals", lambda: winze.estimate_normals(p, VOXEL, **t))
    found = timed("iss_keypoints", lambda: winze.iss_keypoints(p, VOXEL, **t))
    timed("fpfh", lambda: winze.fpfh(p, normals, found, VOXEL, **t))
    surface = timed("prepare", lambda: winze.prepare(p, COARSE, **t))
    query_surface = winze.prepare(q, COARSE, **t)
    at, descriptors = [], []
    for s in (surface, query_surface):
        keypoints = winze.iss_keypoints(s, **t)
        at.append(s.points[keypoints.indices])
        descriptors.append(winze.fpfh(s, keypoints=keypoints, **t))
    matches = timed("match_features", lambda: winze.match_features(*descriptors, **t))
    timed("ransac", lambda: winze.ransac(*at, matches, COARSE, **t))
    start = np.eye(4)
    start[:3, 3] = [0.1, -0.1, 0.05]
    timed("ndt", lambda: winze.ndt(surface, query_surface, start, **t))
    timed("icp", lambda: winze.icp(surface, query_surface, start, **t))
    timed("inliers", lambda: winze.inliers(p, q, start, **t))
    timed("locate", lambda: winze.locate(p, q, **t))
    return seconds


def rust_calls(binary: str, folder: Path, threads: int) -> dict[str, float]:
    command = [binary, folder / "map.f64", folder / "query.f64", str(threads)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return {name: float(s) for name, s in (line.split("\t") for line in lines)}


FORMS = {
    "C float64": lambda p: p,
    "Fortran float64": np.asfortranarray,
    "strided float64": lambda p: np.repeat(p, 2, axis=1)[:, ::2],
    "C float32": lambda p: p.astype(np.float32),
    "big-endian float64": lambda p: p.astype(">f8"),
}


def rise(form: str) -> float:
    """By how many megabytes this process grows at most while an array becomes a cloud."""
    array = FORMS[form](mine(1_000_000, 1))
    winze.Cloud(array[:1000])
    Path("/proc/self/clear_refs").write_text("5")
    status = lambda key: int(Path("/proc/self/status").read_text().split(key)[1].split()[0]) / 1024  # noqa: E731
    before = status("VmRSS:")
    cloud = winze.Cloud(array)
    most = status("VmHWM:") - before
    del cloud
    return most


def memory() -> dict[str, float]:
    """The same for each form, each in a process whose memory comes fresh from the system."""
    fresh = {**os.environ, "MALLOC_MMAP_THRESHOLD_": "65536"}
    ask = lambda form: subprocess.run(  # noqa: E731
        [sys.executable, __file__, "--rise", form], env=fresh, check=True, capture_output=True, text=True
    )
    return {form: float(ask(form).stdout) for form in FORMS}


def two_at_once(points: np.ndarray, query: np.ndarray, rounds: int) -> dict[str, list[float]]:
    """Seconds of two questions of one thread each, one after the other and from two Python threads at once."""
    kept = winze.Map.build(points)
    ask = lambda: kept.locate(query, threads=1)  # noqa: E731
    ask()
    seconds: dict[str, list[float]] = {"in turn": [], "at once": []}
    for _ in range(rounds):
        begun = time.perf_counter()
        ask()
        ask()
        seconds["in turn"].append(time.perf_counter() - begun)
        threads = [threading.Thread(target=ask) for _ in range(2)]
        begun = time.perf_counter()
        for t in threads:
            t.start()
        for t in threads:
            t.join()
        seconds["at once"].append(time.perf_counter() - begun)
    return seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--rounds", type=int, default=5)
    if sys.argv[1:2] == ["--rise"]:
        print(rise(sys.argv[2]))
        return
    args = parser.parse_args()
    points, query = mine(1_000_000, 1), mine(1_000_000, 2)
    query = query[(query[:, 0] > 25) & (query[:, 0] < 75) & (np.abs(query[:, 1]) < 25)]
    result: dict = {
        "points": len(points),
        "query": len(query),
        "versions": {"winze": winze.__version__, "numpy": np.__version__, "python": platform.python_version()},
        "machine": platform.machine(),
        "calls": {},
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        points.tofile(folder / "map.f64")
        query.tofile(folder / "query.f64")
        for threads in (1, 2):
            ask = {
                "rust": lambda t=threads: rust_calls(args.binary, folder, t),
                "python": lambda t=threads: python_calls(points, query, t, False),
                "python from a Cloud": lambda t=threads: python_calls(points, query, t, True),
            }
            runs: dict = {who: [] for who in ask}
            for i in range(args.rounds):
                # Each comes first, second and last in turn.
                for who in [*ask][i % 3 :] + [*ask][: i % 3]:
                    runs[who].append(ask[who]())
            result["calls"][threads] = runs
            print(f"\n{threads} thread(s), {len(points)} points; the quickest of {args.rounds}\n")
            print("| call | Rust, s | Python, s | overhead | from a Cloud |\n|---|---|---|---|---|")
            for call in runs["rust"][0]:
                m = {who: min(r[call] for r in own) for who, own in runs.items()}
                share = [f"{100 * (m[k] / m['rust'] - 1):+.1f} %" for k in ("python", "python from a Cloud")]
                print(f"| `{call}` | {m['rust']:.4f} | {m['python']:.4f} | {share[0]} | {share[1]} |")
    result["megabytes"] = memory()
    print("\n| a million points | MB into a Cloud |\n|---|---|")
    for form, most in result["megabytes"].items():
        print(f"| {form} | {most:.1f} |")
    result["two questions"] = two_at_once(points, query, args.rounds)
    in_turn, at_once = (min(v) for v in result["two questions"].values())
    print(f"\ntwo questions in turn {in_turn:.3f} s, from two threads at once {at_once:.3f} s: {in_turn / at_once:.2f} times as fast")
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "python_overhead.json").write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
