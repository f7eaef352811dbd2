#!/usr/bin/env python3
"""How far each stage of winze is from what the machine can do.

    bench-winze limits INPUTS > limits.json
    python bench/python/roofline.py limits.json RUNS.json.gz

`limits.json` holds what the machine does a second and what each stage must do at least; the runs are those of `bench/run`. A stage's limit is the longer of
its bytes at the machine's bandwidth and its operations at the machine's peak of `f32`.
"""

from __future__ import annotations

import gzip
import json
import statistics
import sys


def seconds(runs: dict, threads: int) -> dict[str, float]:
    """Median wall time of each of winze's stages."""
    walls: dict[str, list[float]] = {}
    for r in runs["runs"]:
        if r["library"] == "winze" and r["input"] == "sim" and r["threads"] == threads and r.get("wall"):
            walls.setdefault(r["stage"], []).extend(r["wall"])
    return {stage: statistics.median(wall) for stage, wall in walls.items()}


def row(stage: str, work: dict, machine: dict, took: float) -> str:
    moving = work["bytes"] / machine["bandwidth"]
    counting = work["ops"] / machine["single"]
    limit = max(moving, counting)
    bound = "memory" if moving >= counting else "arithmetic"
    return (
        f"{stage} | {work['bytes'] / 1e6:.1f} | {work['ops'] / 1e6:.0f} | {1e3 * limit:.2f} | {bound} "
        f"| {1e3 * took:.1f} | {100 * limit / took:.1f}"
    )


def table(limits: dict, runs: dict, threads: int) -> str:
    machine = limits["machine"][str(threads)]
    took = seconds(runs, threads)
    head = "stage | MB that must move | million operations | limit, ms | set by | winze, ms | share of the limit, %\n---|---|---|---|---|---|---"
    rows = [row(s, w, machine, took[s]) for s, w in limits["work"].items() if s in took]
    measured = (
        f"{threads} thread{'s' if threads > 1 else ''}: {machine['bandwidth'] / 1e9:.1f} GB/s, "
        f"{machine['single'] / 1e9:.1f} thousand million `f32` operations a second, {machine['double'] / 1e9:.1f} of `f64`."
    )
    return "\n".join([measured, "", head, *rows, ""])


def main() -> None:
    limits = json.load(open(sys.argv[1]))
    with gzip.open(sys.argv[2], "rt") as file:
        runs = json.load(file)
    for threads in (1, 2):
        print(table(limits, runs, threads))


if __name__ == "__main__":
    main()
