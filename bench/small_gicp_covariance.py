#!/usr/bin/env python3
"""Does small_gicp's covariance cover its error? On the queries that an evaluation of winze located.

    python3 -m venv peers && peers/bin/pip install small_gicp open3d-cpu numpy
    winze sim low-overlap --seed 19 --no-mesh --out low-overlap
    winze eval low-overlap --json low-overlap.json
    peers/bin/python bench/small_gicp_covariance.py low-overlap low-overlap.json --every 4

Each query is aligned anew by small_gicp (GICP and point-to-plane ICP at 0.25 m, its defaults), starting from winze's pose, so that it has nothing left to
search. Its covariance is the inverse of the Hessian that it answers with; of point-to-plane ICP, whose residuals are metres, also that
times the mean square residual. Errors are those of its own pose, in units of its own covariance, in the axes of the map about the query's
centroid, as `winze eval` has them.
"""

import argparse
import collections
import json
import pathlib

import numpy as np
import open3d as o3d
import small_gicp


def read(path):
    return np.asarray(o3d.io.read_point_cloud(str(path)).points)


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def rotation_vector(matrix):
    angle = np.arccos(np.clip((np.trace(matrix) - 1) / 2, -1, 1))
    if angle < 1e-9:
        return np.zeros(3)
    skew = (matrix - matrix.T) / (2 * np.sin(angle))
    return angle * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


def error(pose, truth, centroid):
    moved = (truth @ np.append(centroid, 1))[:3] - (pose @ np.append(centroid, 1))[:3]
    return np.append(moved, rotation_vector(truth[:3, :3] @ pose[:3, :3].T))


def covariance(hessian, pose, centroid):
    """Of [x y z, about x y z] in map axes about the centroid; small_gicp perturbs by T exp([rotation, translation])."""
    turn = pose[:3, :3]
    change = np.zeros((6, 6))
    change[:3, :3] = -turn @ cross(centroid)
    change[:3, 3:] = turn
    change[3:, :3] = turn
    try:
        return change @ np.linalg.inv(hessian) @ change.T
    except np.linalg.LinAlgError:
        return None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("evaluation", type=pathlib.Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--voxel", type=float, default=0.25)
    args = parser.parse_args()
    cases = {c["name"]: c for c in json.loads((args.folder / "cases.json").read_text())["cases"]}
    runs = [
        r
        for r in json.loads(args.evaluation.read_text())["runs"]
        if r["method"] == "auto" and r["verdict"] == "located" and r["mark"]["class"] == "right"
    ]
    maps, found, off = {}, collections.defaultdict(list), collections.defaultdict(list)
    for run in runs[:: args.every]:
        case = cases[run["case"]]
        if case["map"] not in maps:
            points = read(args.folder / case["map"])
            maps[case["map"]] = small_gicp.preprocess_points(points, args.voxel)
        target, tree = maps[case["map"]]
        points = read(args.folder / case["query"])
        source, _ = small_gicp.preprocess_points(points, args.voxel)
        truth, centroid = np.array(case["truth"]), points.mean(axis=0)
        for kind in ("GICP", "PLANE_ICP"):
            result = small_gicp.align(
                target, source, tree, np.array(run["map_from_query"]), registration_type=kind
            )
            pose = result.T_target_source
            e = error(pose, truth, centroid)
            kinds = {f"{kind}, inverse Hessian": 1.0}
            if kind == "PLANE_ICP":
                # Its error is half the sum of squares.
                kinds["PLANE_ICP, scaled by residuals"] = 2 * result.error / max(result.num_inliers, 1)
            for name, factor in kinds.items():
                c = covariance(result.H, pose, centroid)
                off[run["family"], name].append(np.linalg.norm(e[:3]))
                if c is None or np.any(np.diag(c) <= 0):
                    continue
                c = factor * c
                square = e @ np.linalg.solve(c, e)
                found[run["family"], name].append((square, np.abs(e) / np.sqrt(np.diag(c))))
    print("family | small_gicp's | queries | error, m: median | mean square | median | within 1 σ, % (x y z, about x y z) | within 2 σ, %")
    print("---|---|---|---|---|---|---|---")
    for (family, name), rows in sorted(found.items()):
        squares = np.array([s for s, _ in rows])
        sigmas = np.array([s for _, s in rows])
        within = [
            " ".join(f"{100 * share:.0f}" for share in (sigmas <= most).mean(axis=0))
            for most in (1, 2)
        ]
        print(
            f"{family} | {name} | {len(rows)} | {np.median(off[family, name]):.3f} | {squares.mean():.1f} | {np.median(squares):.1f} | {within[0]} | {within[1]}"
        )


if __name__ == "__main__":
    main()
