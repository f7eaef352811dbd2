"""A pipeline of one's own from the stages: python own_pipeline.py MAP QUERY

Every stage takes and gives arrays, so stages can be left out, swapped or looked into. What comes out is a pose, not a
verdict: how finely it lies is all that is known of it.
"""

from __future__ import annotations

import sys

import winze


def main(map_path: str, query_path: str) -> None:
    map_cloud, query = winze.read(map_path), winze.read(query_path)

    # One number decides all lengths; here it comes from the data, it could be any.
    voxel = winze.choose_voxel(map_cloud, query)
    a, b = winze.prepare(map_cloud, voxel), winze.prepare(query, voxel)
    print(f"voxel {voxel:.3f} m: {len(a)} map points, {len(b)} query points")

    keys_a, keys_b = winze.iss_keypoints(a), winze.iss_keypoints(b)
    # As an example of a choice: matches that another keypoint rivals are left out.
    matches = winze.match_features(
        winze.fpfh(a, keypoints=keys_a),
        winze.fpfh(b, keypoints=keys_b),
        winze.MatchingConfig(ratio=0.97),
    )
    print(f"{len(keys_a.indices)} and {len(keys_b.indices)} keypoints, {len(matches.pairs)} correspondences")
    estimate = winze.ransac(a.points[keys_a.indices], b.points[keys_b.indices], matches, voxel)

    # ICP ends on the nearest pairs alone, here on those within a voxel.
    fine = winze.IcpConfig(metric="point-to-plane", final_distance="1 voxels")
    refined = []
    for hypothesis in estimate.hypotheses[:8]:
        coarse = winze.ndt(a, b, hypothesis.map_from_query)
        found = winze.icp(a, b, coarse.map_from_query, config=fine)
        share, rmse = winze.inliers(a.points, b.points, found.map_from_query, voxel)
        print(f"{hypothesis.inliers} inliers, NDT: {coarse.stop}, ICP: {found.stop}, {share:.3f} within a voxel")
        refined.append((share, found))
    if refined:
        _, best = max(refined, key=lambda row: row[0])
        print(best.map_from_query.round(4))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
