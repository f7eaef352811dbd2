#!/usr/bin/env python3
"""Draws CPU time by stage and library, one panel an input, on a logarithmic axis.

    bars.py RUNS.json.gz BARS.png
"""

import gzip
import json
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import tables

COLOURS = {
    "winze": "#d9480f",
    "PCL": "#1c7ed6",
    "Open3D": "#2b8a3e",
    "Open3D-FGR": "#74b816",
    "small_gicp": "#9c36b5",
    "KISS-Matcher": "#f08c00",
    "TEASER++": "#0c8599",
    "kiddo": "#868e96",
    "nanoflann": "#343a40",
}
ROW = 0.16
# Seconds below which a bar is not drawn shorter.
LEAST = 1e-4


def colour(name):
    """All voxel sizes of a library have one."""
    return COLOURS.get(name.partition("@")[0], "#adb5bd")


def panel(axes, cells, input_, threads, names):
    """The bars of one input, stage under stage."""
    at, ticks = 0.0, []
    for stage in tables.stages(cells):
        drawn = [
            (name, cells[input_, threads, stage, name])
            for name in names
            if (input_, threads, stage, name) in cells and not cells[input_, threads, stage, name]["failed"]
        ]
        if not drawn:
            continue
        top = at
        for name, cell in drawn:
            axes.barh(
                at,
                max(cell["cpu"], LEAST),
                height=0.92,
                left=0.0,
                color=colour(name),
                alpha=1.0 if cell["comparable"] else 0.3,
                hatch=None if cell["comparable"] else "////",
            )
            at += 1.0
        standing = tables.standing(cells, input_, threads, stage)
        if standing:
            ratio = standing["cpu"]
            longest = max(max(c["cpu"], LEAST) for _, c in drawn)
            axes.annotate(
                tables.ratio(ratio) + "×",
                (longest, (top + at - 1.0) / 2),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                fontsize=9,
                color="#212529" if ratio >= 1 else "#c92a2a",
            )
        ticks.append(((top + at - 1.0) / 2, stage))
        axes.axhline(at - 0.1, color="#dee2e6", lw=0.6, zorder=0)
        at += 0.8
    axes.set_xscale("log")
    axes.set_yticks([t for t, _ in ticks], [s for _, s in ticks], fontsize=10)
    axes.set_ylim(at - 0.3, -0.8)
    used = [max(c["cpu"], LEAST) for at_, c in cells.items() if at_[:2] == (input_, threads) and not c["failed"]]
    # So that the shortest bar shows and the ratios beside the longest have room.
    axes.set_xlim(min(used) / 2.0, max(used) * 4.0)
    axes.grid(axis="x", color="#e9ecef", zorder=0)
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel("CPU time, s")
    axes.set_title(f"{input_}, {threads} thread{'s' * (threads > 1)}", fontsize=12, loc="left")
    return at


def draw(raw, path):
    cells = tables.gathered(raw)
    names = tables.libraries(cells)
    threads = min(t for _, t in tables.sections(cells))
    inputs = list(dict.fromkeys(i for i, _ in tables.sections(cells)))
    rows = max(sum(1 for at in cells if at[:2] == (i, threads)) for i in inputs) + len(tables.stages(cells))
    figure, panels = plt.subplots(
        1, len(inputs), figsize=(8.0 * len(inputs), 2.2 + ROW * rows), squeeze=False, layout="constrained"
    )
    for axes, input_ in zip(panels[0], inputs):
        panel(axes, cells, input_, threads, names)
    labels = list(dict.fromkeys(name.partition("@")[0] for name in names))
    handles = [plt.Rectangle((0, 0), 1, 1, color=colour(name)) for name in labels]
    if any(not c["comparable"] and not c["failed"] for c in cells.values()):
        handles.append(plt.Rectangle((0, 0), 1, 1, facecolor="#ced4da", hatch="////", alpha=0.6))
        labels.append("another result")
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False, fontsize=10)
    figure.supxlabel("× : best peer with a comparable result, over winze", fontsize=10, color="#495057")
    figure.savefig(path, dpi=110)


def main():
    with gzip.open(sys.argv[1], "rt") as file:
        draw(json.load(file), sys.argv[2])


if __name__ == "__main__":
    main()
