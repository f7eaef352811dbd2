"""Tables of what `bench/run` measured. All that is in them follows from the raw figures."""

import statistics

REFERENCE = "winze"
MEGABYTE = 1e6

STAGES = [
    "read-pcd-ascii",
    "read-pcd-binary",
    "read-pcd-compressed",
    "read-ply",
    "voxel",
    "outliers",
    "tree",
    "nearest",
    "knn",
    "radius",
    "normals-knn",
    "normals-radius",
    "iss",
    "fpfh-all",
    "fpfh-keypoints",
    "match",
    "match-mutual",
    "ransac",
    "ndt",
    "icp-point",
    "icp-plane",
    "gicp",
    "chain",
    "relocalize-prepared",
    "relocalize",
]

# By how much winze is to be ahead of the best peer in CPU time.
TARGETS = {
    "read-pcd-ascii": 3,
    "read-pcd-binary": 3,
    "read-pcd-compressed": 3,
    "read-ply": 3,
    "voxel": 2,
    "outliers": 4,
    "normals-knn": 4,
    "normals-radius": 4,
    "iss": 6,
    "fpfh-all": 6,
    "fpfh-keypoints": 6,
    "match": 3,
    "match-mutual": 3,
    "ransac": 5,
    "ndt": 4,
    "icp-point": 2,
    "icp-plane": 2,
    "gicp": 2,
    "chain": 8,
    "relocalize-prepared": 10,
}
# Stages whose target names the peer. Of its voxel sizes (`NAME@METRES`) the one that places most queries right counts, of equals the quickest.
AGAINST = {"relocalize-prepared": "KISS-Matcher"}
# Stages with a second row: against the best of all (None), and where the work is the same against the one that the target names.
ALSO = {"relocalize-prepared": None, "relocalize": "KISS-Matcher"}
# There the tree was made before, so that what is measured leaves most of the memory out.
WITHOUT_MEMORY = ["nearest", "knn", "radius"]
WITHOUT_TARGET = {"yes": "ahead", "about": "about", "no": "behind"}
# Who has no map prepared beforehand is asked with the map's work done anew.
INSTEAD = {"relocalize-prepared": "relocalize"}


def key(run):
    return run["input"], run["threads"], run["stage"], run["library"]


def gathered(raw):
    """By (input, threads, stage, library): the medians of all rounds, or why there are none."""
    cells = {}
    for run in raw["runs"]:
        cell = cells.setdefault(key(run), {"wall": [], "cpu": [], "own": 0, "peak": 0, "count": None, "note": "", "split": {}, "failed": None})
        if run.get("failed"):
            cell["failed"] = cell["failed"] or run["failed"]
            continue
        cell["wall"] += run["wall"]
        cell["cpu"] += run["cpu"]
        cell["own"] = max(cell["own"], run["rss_peak"] - run["rss_before"])
        cell["peak"] = max(cell["peak"], run["rss_peak"])
        cell["count"], cell["note"], cell["split"] = run["count"], run.get("note", ""), run.get("split", {})
    compared = {key(c): c for c in raw.get("comparisons", [])}
    for at, cell in cells.items():
        cell["runs"] = len(cell["cpu"])
        if cell["runs"] == 0 and not cell["failed"]:
            cell["failed"] = "no run"
        cell["least"], cell["most"] = (min(cell["cpu"]), max(cell["cpu"])) if cell["runs"] else (None, None)
        for name in ("cpu", "wall"):
            cell[name] = statistics.median(cell[name]) if cell["runs"] else None
        told = compared.get(at, {})
        cell["result"] = told.get("text", "")
        # What was not held against winze's result counts for nothing. winze's own is held against the truth, where there is one.
        cell["comparable"] = bool(told.get("comparable", at[3] == REFERENCE))
        cell["instead"] = False
        cell["right"] = told.get("right", 0)
    lend(cells)
    return cells


def lend(cells):
    for (input_, threads, stage, library), cell in list(cells.items()):
        for wanted, instead in INSTEAD.items():
            at = (input_, threads, wanted, library)
            asked = any(k[:3] == at[:3] for k in cells)
            if stage == instead and at not in cells and asked:
                cells[at] = {**cell, "instead": True}


def best(cells, at, what, only=None):
    """The peer that needs least of `what` among those whose result is comparable, with its cell."""
    peers = [
        (cell[what], library, cell)
        for (*where, library), cell in cells.items()
        if tuple(where) == at and library != REFERENCE and not cell["failed"] and cell["comparable"] and only in (None, library)
    ]
    return min(peers, key=lambda p: p[:2])[1:] if peers else None


def chosen(cells, at, name):
    """The voxel size of a peer that counts, as the library's name; None where none is comparable."""
    able = [
        (-cell["right"], cell["cpu"], library)
        for (*where, library), cell in cells.items()
        if tuple(where) == at and library.partition("@")[0] == name and not cell["failed"] and cell["comparable"]
    ]
    return min(able)[2] if able else None


def standing(cells, input_, threads, stage, also=False):
    """winze beside the best peer at one stage, or `also` beside that of its second row. Ratios above 1 are winze's lead. None where one lacks."""
    at = (input_, threads, stage)
    own = cells.get((*at, REFERENCE))
    against = (ALSO if also else AGAINST).get(stage)
    named = chosen(cells, at, against) if against else None
    # Another peer than the one that the target names has no target.
    target = TARGETS.get(stage) if named or stage not in AGAINST else None
    found = best(cells, at, "cpu", named)
    if own is None or own["failed"] or not own["comparable"] or found is None:
        return None
    library, peer = found
    wall = best(cells, at, "wall", named)
    least = best(cells, at, "own")[1]["own"]
    lead, surely = over(peer["cpu"], own["cpu"]), over(peer["least"], own["most"])
    # Of queries winze must place as many right.
    enough = own["right"] >= peer["right"]
    return {
        "own": own,
        "peer": peer,
        "library": library,
        "cpu": lead,
        "wall": over(wall[1]["wall"], own["wall"]),
        "memory": over(max(least, MEGABYTE), max(own["own"], MEGABYTE)),
        "target": target,
        "reached": reached(surely, lead, target or 1) if enough else "no",
    }


def reached(surely, lead, target):
    """By the peer's quickest run over winze's slowest, or by the medians alone."""
    return "yes" if surely >= target else "about" if lead >= target else "no"


def both(cells, input_, threads, stage):
    """The standings of a stage: one, or two where it has a second row and that is of another peer."""
    first = standing(cells, input_, threads, stage)
    second = standing(cells, input_, threads, stage, also=True) if stage in ALSO else None
    if first and second and second["library"] != first["library"]:
        return [first, second]
    return [first] if first else []


def over(a, b):
    return a / b if b > 0 else float("inf")


def unit(value):
    """Of a time: by how much to multiply, how to write and what to call it."""
    if value < 0.01:
        return 1000, ".2f", "ms"
    return (1000, ".0f", "ms") if value < 1 else (1, ".2f", "s")


def seconds(value):
    times, form, name = unit(value)
    return f"{value * times:{form}} {name}"


def spread(cell):
    """The median, and the least and the most in its unit."""
    text = seconds(cell["cpu"])
    if cell["runs"] < 2:
        return text
    times, form, _ = unit(cell["cpu"])
    return f"{text} ({cell['least'] * times:{form}}–{cell['most'] * times:{form}})"


def ratio(value):
    """Finer where it is near 1, so that the one that is ahead shows."""
    if value < 2:
        return f"{value:.2f}"
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"


def megabytes(value):
    return f"{value / MEGABYTE:.0f}"


def row(cells):
    return "| " + " | ".join(str(c).replace("|", "/") for c in cells) + " |"


def table(head, rows):
    return "\n".join([row(head), row(["---"] + ["---:"] * (len(head) - 1)), *(row(r) for r in rows)]) + "\n"


def libraries(cells):
    """winze first, the others by name."""
    names = {library for *_, library in cells}
    return [REFERENCE] * (REFERENCE in names) + sorted(names - {REFERENCE}, key=str.lower)


def stages(cells):
    present = {stage for _, _, stage, _ in cells}
    return [s for s in STAGES if s in present] + sorted(present - set(STAGES))


def sections(cells):
    return sorted({at[:2] for at in cells}, key=lambda a: (a[0] != "sim", *a))


def mark(cell, text, repeat):
    """A cell's text and what must be known about it."""
    if cell["runs"] < repeat:
        text += f" (n={cell['runs']})"
    if cell["instead"]:
        text += " †"
    return text if cell["comparable"] else text + " ✗"


def shown(cells, at, text, repeat):
    cell = cells.get(at)
    if cell is None:
        return ""
    if cell["failed"]:
        return "failed"
    return mark(cell, text(cell), repeat)


def grid(cells, where, text, repeat):
    names = libraries(cells)
    rows = [
        [stage] + [shown(cells, (*where, stage, name), text, repeat) for name in names]
        for stage in stages(cells)
        if any((*where, stage, name) in cells for name in names)
    ]
    return table(["stage", *names], rows)


def missing(cells, at):
    """The row of a stage that has nothing to hold against each other."""
    own = cells.get((*at, REFERENCE))
    if own is None and any(where[:3] == at for where in cells):
        return [[at[2], "none", "", "", "", "", "", "", ""]]
    if own is None:
        return []
    text = "failed" if own["failed"] else seconds(own["cpu"]) + ("" if own["comparable"] else ", wrong")
    return [[at[2], text, "", "none that is comparable", "", "", "", "", ""]]


def which(standing_):
    return standing_["library"] + (" †" if standing_["peer"]["instead"] else "")


def verdicts(cells, input_, threads):
    rows = []
    for stage in stages(cells):
        found = both(cells, input_, threads, stage)
        rows += missing(cells, (input_, threads, stage)) if not found else []
        rows += [
            [
                stage,
                seconds(s["own"]["cpu"]),
                seconds(s["peer"]["cpu"]),
                which(s),
                ratio(s["cpu"]),
                ratio(s["wall"]),
                s["target"] or "–",
                s["reached"] if s["target"] else WITHOUT_TARGET[s["reached"]],
                "–" if stage in WITHOUT_MEMORY else ratio(s["memory"]),
            ]
            for s in found
        ]
    head = ["stage", "winze CPU", "best peer CPU", "which", "CPU ratio", "wall ratio", "target", "reached", "memory ratio"]
    return table(head, rows)


def machine(raw):
    m = raw.get("machine", {})
    about = [f"{raw.get('date', '')}", m.get("cpu", ""), f"{m.get('cores', '?')} cores", m.get("kernel", ""), m.get("rustc", "")]
    about += [
        f"load {when} " + ", ".join(f"{x:.2f}" for x in m[name])
        for when, name in (("at the start", "load"), ("after", "load_after"))
        if m.get(name)
    ]
    return "; ".join(a for a in about if a) + "; winze at " + m.get("commit", "?") + "."


def versions(raw):
    found = {run["library"]: run["version"] for run in raw["runs"] if run.get("version")}
    return ", ".join(f"{library} {version}" for library, version in sorted(found.items(), key=lambda v: v[0].lower()))


LEGEND = """Medians of {repeat} timed runs after a warm-up, with the least and the most, or of as many as `n` says (of what takes over 100 s one,
which may be the warm-up). ✗: the result cannot be compared with winze's (or was not), so the peer does not count as best. Ratios are best peer over
winze: above 1 winze is ahead. `reached`: `yes` where even the peer's quickest run over winze's slowest reaches the target, `about` where the medians
do; without a target `ahead`, `about` and `behind`. The best in CPU time, in wall time and in memory may be three different peers; where a row is
against one by name, CPU and wall are that one's. Memory is the peak less what was resident before (at least 1 MB).

†: its work on the map cannot be kept, so this is its `relocalize`, the map's work included. Like for like is the stage `relocalize`, where winze
does the map's work anew too: it has a row against the best peer and one against KISS-Matcher, as `relocalize-prepared` has one against KISS-Matcher
and one against the best.
"""


def full(raw):
    cells = gathered(raw)
    repeat = raw.get("repeat", 5)
    parts = ["# winze beside its peers\n", machine(raw) + "\n", versions(raw) + ".\n", LEGEND.format(repeat=repeat)]
    for input_, threads in sections(cells):
        where = (input_, threads)
        parts += [
            f"## {input_}, {threads} thread{'s' * (threads > 1)}\n",
            "### Best peer over winze\n",
            verdicts(cells, input_, threads),
            "### CPU time\n",
            grid(cells, where, spread, repeat),
            "### Wall time\n",
            grid(cells, where, lambda c: seconds(c["wall"]), repeat),
            "### Peak memory: of the stage (of the process), MB\n",
            grid(cells, where, lambda c: f"{megabytes(c['own'])} ({megabytes(c['peak'])})", repeat),
            "### Results beside winze's\n",
            grid(cells, where, lambda c: c["result"] or (f"{c['count']}" if c["count"] else "–"), 0),
        ]
    parts += ["## Notes\n", notes(cells)]
    return "\n".join(parts)


def notes(cells):
    """What the runners had to say, and what failed."""
    said = {}
    for (input_, threads, stage, library), cell in sorted(cells.items(), key=lambda c: (c[0][3].lower(), c[0])):
        if cell["instead"]:
            continue
        if cell["note"]:
            said.setdefault((library, cell["note"]), []).append(stage)
        if cell["failed"]:
            said.setdefault((library, f"failed at {input_}, {threads} threads: {cell['failed']}"), []).append(stage)
    lines = []
    for (library, note), at in said.items():
        lines.append(f"* {library}, {', '.join(dict.fromkeys(at))}: {note}.")
    # Of the parts of a run that the library's own clocks tell.
    for (input_, threads, stage, library), cell in sorted(cells.items(), key=lambda c: (c[0][3].lower(), c[0])):
        if cell["split"] and not cell["instead"]:
            parts = ", ".join(f"{name} {seconds(value)}" for name, value in cell["split"].items())
            where = f"{stage} of {input_}, {threads} thread{'s' * (threads > 1)}"
            lines.append(f"* {library}, {where}, wall time of the last run by its own clocks: {parts}.")
    return "\n".join(lines) + "\n"


def short(raw):
    """One table an input for the README."""
    cells = gathered(raw)
    parts = []
    for input_ in dict.fromkeys(i for i, _ in sections(cells)):
        counts = [t for i, t in sections(cells) if i == input_]
        rows = []
        for stage in stages(cells):
            found = {t: both(cells, input_, t, stage) for t in counts}
            for n, first in enumerate(found[counts[0]]):
                leads = [ratio(s[n]["cpu"]) if n < len(s) else "" for s in found.values()]
                rows.append([stage, seconds(first["own"]["cpu"]), seconds(first["peer"]["cpu"]), which(first), *leads])
        heads = [f"ratio, {t} thread{'s' * (t > 1)}" for t in counts]
        parts.append(f"{input_}, CPU time with {counts[0]} thread{'s' * (counts[0] > 1)}:\n")
        parts.append(table(["stage", "winze", "best peer", "which", *heads], rows))
    return "\n".join(parts)
