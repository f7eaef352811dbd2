#!/usr/bin/env python3
"""Holds a library's result of a stage against winze's: a faster wrong answer does not count.

    compare.py JOBS      # JSON: a list of {"library", "stage", "inputs", "theirs", "ours", ...}

prints the list with `text`, what was found, `comparable`, whether it is near enough, and `right`, how many queries were placed right; all else of a job stays.
"""

import json
import pathlib
import sys

import numpy as np

from inputs import Inputs

# Metres at the query's centroid and degrees, of a pose that counts as right and of one that is the same as another.
RIGHT = 1.5, 5.0
SAME = 0.005, 0.05


def f32(path, width=1):
    return np.fromfile(path, np.float32).reshape(-1, width)


def u32(path, width=1):
    return np.fromfile(path, np.uint32).reshape(-1, width)


def poses(path):
    return np.fromfile(path, np.float64).reshape(-1, 4, 4)


def differing_lengths(theirs, ours):
    return f"{len(theirs)} instead of {len(ours)}", False


def means(_inputs, theirs, ours):
    theirs, ours = np.fromfile(theirs, np.float64), np.fromfile(ours, np.float64)
    apart = float(np.abs(theirs - ours).max())
    return f"mean {apart * 1000:.2f} mm apart", apart < 0.001


def occupied(points, size, anchor):
    """The number of cells of a grid through `anchor` that hold points."""
    cells = np.floor((points - anchor) / size).astype(np.int64)
    cells -= cells.min(axis=0)
    width = cells.max(axis=0) + 1
    return len(np.unique((cells[:, 0] * width[1] + cells[:, 1]) * width[2] + cells[:, 2]))


def voxels(inputs, theirs, ours):
    """As many points as winze, or as many as a grid has cells that goes through the cloud's least corner (half a voxel before it: Open3D's) instead of
    zero: on a cloud that was thinned by a grid before, these differ by several per cent."""
    theirs, ours = len(f32(theirs, 3)), len(f32(ours, 3))
    text = f"{theirs} points ({theirs / ours - 1.0:+.2%}"
    if near(theirs, ours):
        return text + ")", True
    points = inputs.points("map.f32").astype(float)
    corner = points.min(axis=0)
    for anchor in (corner, corner - 0.5 * inputs.voxel):
        if near(theirs, occupied(points, inputs.voxel, anchor)):
            return text + ", as its grid lies elsewhere)", True
    return text + ")", False


def near(count, other):
    return abs(count / max(other, 1) - 1.0) <= 0.01


def shared(theirs, ours):
    """The Jaccard index of two sets of numbers."""
    both = len(np.intersect1d(theirs, ours))
    return both / max(len(np.union1d(theirs, ours)), 1)


def removed(inputs, theirs, ours):
    """Nearly all points are kept, so that those agree anyhow."""
    of = np.arange(len(inputs.points("map_thin.f32")))
    theirs, ours = (np.setdiff1d(of, u32(path)) for path in (theirs, ours))
    share = shared(theirs, ours)
    return f"{len(theirs)} removed, {share:.2%} shared", share >= 0.95


def keypoints(_inputs, theirs, ours):
    theirs, ours = u32(theirs), u32(ours)
    share, more = shared(theirs, ours), len(theirs) / max(len(ours), 1) - 1.0
    return f"{len(theirs)} ({more:+.1%}), {share:.1%} shared", abs(more) <= 0.25 and share >= 0.5


def keypoints_otherwise(inputs, theirs, ours):
    """PCL's: the scatter about the point, as winze's, but summed over the neighbours where winze's is a mean."""
    text, comparable = keypoints(inputs, theirs, ours)
    return text + ": its saliency grows with the number of neighbours", comparable


def keypoints_about_the_mean(_inputs, theirs, ours):
    """Open3D's, held against winze's by Open3D's definition."""
    theirs, ours = u32(theirs), u32(ours + ".mean")
    share = shared(theirs, ours)
    return f"{len(theirs)}, {share:.1%} shared with winze's {len(ours)} by the scatter about the mean", share >= 0.98


def distances(terms):
    """Of `terms` distances each: a sum may be off by as many times the tolerance."""

    def compare(_inputs, theirs, ours):
        theirs, ours = f32(theirs)[:, 0].astype(float), f32(ours)[:, 0].astype(float)
        if len(theirs) != len(ours):
            return differing_lengths(theirs, ours)
        worst = float(np.abs(theirs - ours).max()) / terms
        return f"within {worst * 1000:.3f} mm", worst <= 1e-4

    return compare


def counts(_inputs, theirs, ours):
    theirs, ours = u32(theirs)[:, 0].astype(int), u32(ours)[:, 0].astype(int)
    if len(theirs) != len(ours):
        return differing_lengths(theirs, ours)
    apart = np.abs(theirs - ours)
    return f"{(apart == 0).mean():.2%} equal, {apart.max()} apart at most", (apart <= 1).mean() >= 0.999


def normals(_inputs, theirs, ours):
    theirs, ours = (f32(path, 3).astype(float) for path in (theirs, ours))
    if len(theirs) != len(ours):
        return differing_lengths(theirs, ours)
    cosine = np.abs((theirs * ours).sum(axis=1)) / np.maximum(
        np.linalg.norm(theirs, axis=1) * np.linalg.norm(ours, axis=1), 1e-12
    )
    share = float((cosine >= np.cos(np.radians(1.0))).mean())
    return f"{share:.2%} within 1°", share >= 0.98


def descriptors(_inputs, theirs, ours):
    theirs, ours = (f32(path, 33).astype(float) for path in (theirs, ours))
    if len(theirs) != len(ours):
        return differing_lengths(theirs, ours)
    # Libraries scale their histograms to 1, to 100 or to other sums.
    theirs, ours = (np.nan_to_num(a) / np.maximum(np.abs(np.nan_to_num(a)).sum(axis=1, keepdims=True), 1e-12) for a in (theirs, ours))
    off = float(np.median(np.abs(theirs - ours).sum(axis=1)))
    return f"median difference {off:.2%}", off <= 0.2


def matches(_inputs, theirs, ours):
    number = lambda path: (u32(path, 2).astype(np.uint64) * np.array([1 << 32, 1], np.uint64)).sum(axis=1)  # noqa: E731
    theirs, ours = number(theirs), number(ours)
    share = shared(theirs, ours)
    return f"{len(theirs)} pairs, {share:.2%} shared", share >= 0.98


def apart(pose, other, centroid):
    """Metres at the centroid and degrees between two poses."""
    at = np.append(centroid, 1.0)
    metres = float(np.linalg.norm(((pose - other) @ at)[:3]))
    turn = np.linalg.norm(pose[:3, :3] - other[:3, :3]) / np.sqrt(8.0)
    return metres, float(np.degrees(2.0 * np.arcsin(min(turn, 1.0))))


def within(error, bounds):
    return error[0] <= bounds[0] and error[1] <= bounds[1]


def right(error):
    return within(error, RIGHT)


def as_text(error):
    metres, degrees = error
    return f"{metres * 1000:.1f} mm {degrees:.3f}°" if metres < 10.0 else f"{metres:.0f} m {degrees:.0f}°"


def refined(inputs, theirs, ours):
    """Comparable where from every start the pose is as good as winze's, or nearer the truth."""
    centroid, truth = inputs.points("query_0.f32").mean(axis=0, dtype=float), inputs.pose("truth.f64")
    theirs, ours = poses(theirs), poses(ours)
    if len(theirs) != len(ours):
        return differing_lengths(theirs, ours)
    held = []
    for their, our in zip(theirs, ours):
        off, own, between = apart(their, truth, centroid), apart(our, truth, centroid), apart(their, our, centroid)
        held.append((within(between, SAME) or within(off, own), between, off))
    # Those that fail first.
    fine, between, off = min(held, key=lambda h: (h[0], -h[1][0]))
    return f"worst of {len(held)}: {as_text(between)} from winze's, {as_text(off)} from the truth", fine


def refined_own(inputs, theirs, _ours):
    """winze's own: it has to refine, so that its errors' medians are to be at most half of the starts'."""
    centroid, truth = inputs.points("query_0.f32").mean(axis=0, dtype=float), inputs.pose("truth.f64")
    errors, begun = ([apart(pose, truth, centroid) for pose in found] for found in (poses(theirs), inputs.starts()))
    middle = np.median(errors, axis=0)
    text = f"median {as_text(middle)} from the truth, worst of {len(errors)} {as_text(max(errors))}"
    return text, len(errors) == len(begun) and within(middle, 0.5 * np.median(begun, axis=0))


def posed(inputs, theirs, ours):
    """One pose found without a guess: right or not."""
    centroid, truth = inputs.points("query_0.f32").mean(axis=0, dtype=float), inputs.pose("truth.f64")
    theirs, ours = poses(theirs)[0], poses(ours)[0]
    off = apart(theirs, truth, centroid)
    return f"{as_text(off)} from the truth, {as_text(apart(theirs, ours, centroid))} from winze's", right(off)


def located(inputs, theirs, ours):
    """How many queries were placed right; comparable where they are at least half as many as winze's."""

    def errors(path):
        found = zip(poses(path), inputs.queries())
        return [
            apart(pose, inputs.pose(f"truth_{n}.f64"), query.mean(axis=0, dtype=float)) for n, (pose, query) in enumerate(found)
        ]

    theirs, ours = errors(theirs), errors(ours)
    good = [error for error in theirs if right(error)]
    middle = f", median {np.median([e[0] for e in good]) * 1000:.0f} mm" if good else ""
    # A pose may be given up, so that there are queries without one.
    text = f"{len(good)} of {len(theirs)} right{middle}"
    return text, 2 * len(good) >= max(sum(map(right, ours)), 1), len(good)


def made(_inputs, _theirs, _ours):
    return "", True


REFINERS = ["ndt", "icp-point", "icp-plane", "gicp"]
COMPARE = {
    "read-pcd-ascii": means,
    "read-pcd-binary": means,
    "read-pcd-compressed": means,
    "read-ply": means,
    "voxel": voxels,
    "outliers": removed,
    "tree": made,
    "nearest": distances(1),
    "knn": distances(20),
    "radius": counts,
    "normals-knn": normals,
    "normals-radius": normals,
    "iss": keypoints,
    "fpfh-all": descriptors,
    "fpfh-keypoints": descriptors,
    "match": matches,
    "match-mutual": matches,
    "ransac": posed,
    **dict.fromkeys(REFINERS, refined),
    "chain": posed,
    "relocalize-prepared": located,
    "relocalize": located,
}
# What is held otherwise than its stage.
OF_LIBRARY = {
    ("iss", "PCL"): keypoints_otherwise,
    ("iss", "Open3D"): keypoints_about_the_mean,
    **{(stage, "winze"): refined_own for stage in REFINERS},
}


def judged(job):
    """A job with its verdict."""
    try:
        held = OF_LIBRARY.get((job["stage"], job["library"]), COMPARE[job["stage"]])
        text, comparable, *right = held(Inputs(job["inputs"]), job["theirs"], job["ours"])
    except (OSError, ValueError, IndexError) as error:
        text, comparable, right = f"cannot be compared: {getattr(error, 'strerror', None) or error}", False, []
    return {**job, "text": text, "comparable": bool(comparable), "right": right[0] if right else 0}


def main():
    jobs = json.loads(pathlib.Path(sys.argv[1]).read_text())
    print(json.dumps([judged(job) for job in jobs]))


if __name__ == "__main__":
    main()
