#!/usr/bin/env python3
"""How far each stage of winze is from what the machine can do, of the raw figures of `bench/run`.

    python bench/python/roofline.py RUNS.json.gz

They hold by input what `bench-winze limits` told: what the machine does a second, and what each stage must do at least.
"""

from __future__ import annotations

import gzip
import json
import statistics
import sys

HEAD = """# How far winze is from what the machine can do

The least bytes and operations follow from the definition of a stage: what comes in and goes out once, and the arithmetic on it. Of a search only the
distances to the points that are found count, so that all that it looks at in vain shows as time above the limit. Of matching every descriptor counts
with every other, so that what an index saves can show as more than 100 %. A stage's limit is the longer of its bytes at the machine's bandwidth and
its operations at the machine's peak of `f32`, both measured on as many threads. The times are medians of wall time. `relocalize` and
`relocalize-prepared` have no least work: how many hypotheses are looked at is the method's own choice.
"""
COLUMNS = "stage | MB that must move | million operations | limit, ms | set by | winze, ms | share of the limit, %\n---|---|---|---|---|---|---"


def seconds(runs: list, input_: str, threads: int) -> dict[str, float]:
    """Median wall time of each of winze's stages."""
    walls: dict[str, list[float]] = {}
    for r in runs:
        if (r["library"], r["input"], r["threads"]) == ("winze", input_, threads) and r.get("wall"):
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


def table(limits: dict, took: dict[str, float], threads: int) -> str:
    machine = limits["machine"][str(threads)]
    measured = (
        f"{threads} thread{'s' if threads > 1 else ''}: {machine['bandwidth'] / 1e9:.1f} GB/s, "
        f"{machine['single'] / 1e9:.1f} thousand million `f32` operations a second, {machine['double'] / 1e9:.1f} of `f64`."
    )
    rows = [row(stage, work, machine, took[stage]) for stage, work in limits["work"].items() if stage in took]
    return "\n".join([measured, "", COLUMNS, *rows, ""])


def page(raw: dict) -> str:
    """Each input and number of threads that was measured and whose limits are known."""
    parts = [HEAD]
    for input_, limits in raw["limits"].items():
        parts.append(f"## {input_}\n")
        for threads in sorted(map(int, limits["machine"])):
            if took := seconds(raw["runs"], input_, threads):
                parts.append(table(limits, took, threads))
    return "\n".join(parts)


def main() -> None:
    with gzip.open(sys.argv[1], "rt") as file:
        print(page(json.load(file)), end="")


if __name__ == "__main__":
    main()
