#!/usr/bin/env python3
"""KISS-Matcher and Open3D on the queries of a folder of `winze sim`, each with its best of several voxel sizes.

    python3 -m venv peers && peers/bin/pip install kiss-matcher open3d-cpu numpy
    winze sim aliasing --seed 11 --no-mesh --out aliasing
    peers/bin/python bench/peers.py aliasing --count 30 --json peers.json

Of each family the first so many queries are asked that have one right answer in the map. A pose is right as `winze eval`
counts it: within the case's tolerance at the query's centroid. Neither program has a verdict, so every answer counts as given.
With `--scout 10` the first ten of a family are asked at every voxel size and the rest only at the one that was right most often there
(of equals the faster), which is a little to a peer's loss where two sizes are as good as each other.

KISS-Matcher: `estimate` with its defaults, which does its work on the map anew for each query. Open3D: FPFH of both clouds
(those of the map kept), RANSAC with its edge-length and distance checks and its default of 100,000 samples. Both poses are refined by Open3D's point-to-plane ICP.
"""

import argparse
import json
import pathlib
import time

import kiss_matcher
import numpy as np
import open3d as o3d

REG = o3d.pipelines.registration


def read(path):
    return o3d.io.read_point_cloud(str(path))


def thin(cloud, voxel):
    small = cloud.voxel_down_sample(voxel)
    small.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2 * voxel, 30))
    return small


def fpfh(small, voxel):
    return REG.compute_fpfh_feature(
        small, o3d.geometry.KDTreeSearchParamHybrid(5 * voxel, 100)
    )


def icp(query, map_, start, voxel):
    for distance in (2.0 * voxel, voxel):
        start = REG.registration_icp(
            query, map_, distance, start, REG.TransformationEstimationPointToPlane()
        ).transformation
    return np.asarray(start)


def by_kiss(query, map_, voxel):
    matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(voxel_size=voxel))
    found = matcher.estimate(
        np.asarray(query["cloud"].points, dtype=np.float32),
        np.asarray(map_["cloud"].points, dtype=np.float32),
    )
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(found.rotation)
    pose[:3, 3] = np.asarray(found.translation).ravel()
    return pose


def by_open3d(query, map_, voxel):
    distance = 1.5 * voxel
    found = REG.registration_ransac_based_on_feature_matching(
        query["small"],
        map_["small"],
        query["fpfh"],
        map_["fpfh"],
        True,
        distance,
        REG.TransformationEstimationPointToPoint(False),
        3,
        [
            REG.CorrespondenceCheckerBasedOnEdgeLength(0.9),
            REG.CorrespondenceCheckerBasedOnDistance(distance),
        ],
        REG.RANSACConvergenceCriteria(100_000, 0.999),
    )
    return found.transformation


def error(pose, case, centroid):
    truth = np.array(case["truth"])
    at = np.append(centroid, 1.0)
    metres = np.linalg.norm((pose @ at - truth @ at)[:3])
    turn = pose[:3, :3] @ truth[:3, :3].T
    cosine = np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)
    return float(metres), float(np.degrees(np.arccos(cosine)))


def chosen(cases, count, only):
    taken, families = [], {}
    for case in cases:
        if only and case["family"] not in only:
            continue
        if not case["truth"] or case["ambiguous"] or case["unobservable"]:
            continue
        n = families.get(case["family"], 0)
        if n < count:
            families[case["family"]] = n + 1
            taken.append(case)
    return taken


def best_voxel(runs, peer, family):
    """The size that was right most often so far, of equals the faster."""
    own = [r for r in runs if (r["peer"], r["family"]) == (peer, family)]

    def worth(voxel):
        at = [r for r in own if r["voxel"] == voxel]
        return sum(r["right"] for r in at) / len(at), -np.median([r["seconds"] for r in at])

    return max({r["voxel"] for r in own}, key=worth)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--voxels", type=float, nargs="+", default=[0.2, 0.3, 0.5])
    parser.add_argument("--scout", type=int, help="ask only so many of a family at every voxel size")
    parser.add_argument("--families", nargs="+", help="only these")
    parser.add_argument("--peers", nargs="+", default=["kiss-matcher", "open3d"])
    parser.add_argument("--json", type=pathlib.Path)
    args = parser.parse_args()
    if args.scout is not None and args.scout < 1:
        parser.error("--scout wants at least one query")
    peers = {"kiss-matcher": by_kiss, "open3d": by_open3d}
    o3d.utility.random.seed(0)

    runs, kept, asked, settled = [], {}, {}, {}
    for case in chosen(json.loads((args.cases / "cases.json").read_text())["cases"], args.count, args.families):
        cloud = read(args.cases / case["query"])
        centroid = np.asarray(cloud.points).mean(axis=0)
        number = asked[case["family"]] = asked.get(case["family"], 0) + 1
        scouting = args.scout is None or number <= args.scout
        if not scouting and case["family"] not in settled:
            settled[case["family"]] = {n: best_voxel(runs, n, case["family"]) for n in args.peers}
        for voxel in args.voxels:
            best = settled.get(case["family"], {})
            names = [name for name in args.peers if best.get(name, voxel) == voxel]
            if not names:
                continue
            if (case["map"], voxel) not in kept:
                map_ = read(args.cases / case["map"])
                small = thin(map_, voxel)
                kept[case["map"], voxel] = {"cloud": map_, "small": small, "fpfh": fpfh(small, voxel)}
            map_ = kept[case["map"], voxel]
            begun = time.perf_counter()
            small = thin(cloud, voxel)
            query = {"cloud": cloud, "small": small, "fpfh": fpfh(small, voxel)}
            prepared = time.perf_counter() - begun
            for name in names:
                begun = time.perf_counter()
                pose = icp(small, map_["small"], peers[name](query, map_, voxel), voxel)
                seconds = time.perf_counter() - begun + (prepared if name == "open3d" else 0.0)
                metres, degrees = error(pose, case, centroid)
                within = case["tolerance"]
                right = metres <= within["translation_m"] and degrees <= within["rotation_deg"]
                runs.append(
                    {
                        "case": case["name"],
                        "family": case["family"],
                        "peer": name,
                        "voxel": voxel,
                        "right": bool(right),
                        "translation_m": metres,
                        "rotation_deg": degrees,
                        "seconds": seconds,
                    }
                )
            for r in runs[-len(names) :]:
                print(f"# {r['case']} {r['peer']} at {voxel} m: {r['right']}, {r['seconds']:.1f} s", flush=True)
        if args.json:
            args.json.write_text(json.dumps(runs, indent=1))

    print(f"{'peer':14}{'family':24}{'voxel m':>8}{'right':>10}{'s p50':>8}")
    for name in args.peers:
        for family in sorted({r["family"] for r in runs}):
            for voxel in args.voxels:
                own = [
                    r for r in runs if (r["peer"], r["family"], r["voxel"]) == (name, family, voxel)
                ]
                right = f"{sum(r['right'] for r in own)}/{len(own)}"
                middle = np.median([r["seconds"] for r in own])
                print(f"{name:14}{family:24}{voxel:8.2f}{right:>10}{middle:8.1f}")


if __name__ == "__main__":
    main()
