"""KISS-Matcher's stages. Features and matching are one call, for the map and the query together, so that what was done for a map cannot be kept.
Its own clocks tell how long the parts took."""

import collections
import os

import kiss_matcher
import numpy as np

from measure import Work


def limit(threads):
    """It runs on oneTBB and has no setting of its own; oneTBB goes by the processors that the process may use."""
    allowed = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, allowed[:threads])


def matcher(voxel, **gains):
    return kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=voxel, **gains))


def columns(points):
    """3 x N, f64, as its matrix overloads take them."""
    return np.asfortranarray(points.T.astype(np.float64))


def as_pose(solution):
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(solution.rotation)
    pose[:3, 3] = np.asarray(solution.translation).ravel()
    return pose


def ransac(inputs, _threads):
    # Of what its binding takes, a list of rows is the quickest.
    query, map_ = map(list, inputs.matched())
    made = matcher(inputs.voxel, robin_noise_bound_gain=2.0, solver_noise_bound_gain=2.0)
    return Work(
        run=lambda: as_pose(made.prune_and_solve(query, map_)),
        result=lambda pose: pose,
        count=lambda _: 0,
        note="prune_and_solve: graph pruning and GNC instead of samples, noise bounds 2 v; threads by affinity",
    )


def relocalize(inputs, _threads):
    map_ = columns(inputs.points("map.f32"))
    queries = [columns(query) for query in inputs.queries()]

    split = collections.Counter()

    def one(query):
        made, pose = matcher(inputs.voxel), np.eye(4)
        matched = made.match(query, map_)
        # Its clock of matching goes on while it prunes.
        pruning = made.get_rejection_time()
        split.update(voxels=made.get_processing_time(), features=made.get_extraction_time())
        split.update(matching=made.get_matching_time() - pruning, pruning=pruning)
        # With fewer it solves nothing.
        if len(matched[0]) >= 2:
            pose = as_pose(made.solve(*(np.array(side, np.float64).T for side in matched)))
            split.update(solving=made.get_solver_time())
        return pose

    def run():
        split.clear()
        return np.stack([one(query) for query in queries])

    return Work(
        run=run,
        result=lambda poses: poses,
        count=lambda _: 0,
        note="defaults; match and solve by matrices; its poses are not refined; threads by affinity",
        split=lambda: split,
    )


STAGES = {"ransac": ransac, "relocalize": relocalize}
