"""KISS-Matcher's stages. What its Python module does as one call (features, matching) cannot be timed apart."""

import os

import kiss_matcher
import numpy as np

from measure import Work


def limit(threads):
    """It runs on oneTBB and has no setting of its own; oneTBB goes by the processors that the process may use."""
    allowed = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, allowed[:threads])


def matcher(voxel):
    return kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=voxel))


def columns(points):
    """3 x N, f64, as its matrix overloads take them."""
    return np.asfortranarray(points.T.astype(np.float64))


def as_pose(solution):
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(solution.rotation)
    pose[:3, 3] = np.asarray(solution.translation).ravel()
    return pose


def ransac(inputs, _threads):
    query, map_ = inputs.matched()
    made = matcher(inputs.voxel)
    return Work(
        run=lambda: as_pose(made.prune_and_solve(query, map_)),
        result=lambda pose: pose,
        count=lambda _: 0,
        note="prune_and_solve: graph pruning and GNC instead of samples, noise bounds at their defaults for v; threads by affinity",
    )


def relocalize(inputs, _threads):
    map_ = columns(inputs.points("map.f32"))
    queries = [columns(query) for query in inputs.queries()]

    def one(query):
        made = matcher(inputs.voxel)
        matched = made.match(query, map_)
        if len(matched[0]) == 0:
            return np.eye(4)
        return as_pose(made.solve(*(np.array(side, np.float64).T for side in matched)))

    return Work(
        run=lambda: np.stack([one(query) for query in queries]),
        result=lambda poses: poses,
        count=lambda _: 0,
        note="defaults; match and solve by matrices, quicker than estimate by lists; its poses are not refined; threads by affinity",
    )


STAGES = {"ransac": ransac, "relocalize": relocalize}
