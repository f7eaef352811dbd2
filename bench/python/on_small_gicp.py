"""small_gicp's stages. It takes points as f64 and the number of threads with every call."""

import numpy as np
import small_gicp

from measure import Work

PAIRS_WITHIN = 1.0
ITERATIONS = 50
ROTATION_EPSILON = 0.00005
TRANSLATION_EPSILON = 0.0005
NEIGHBOURS = 20
WALK = "k nearest by batch_knn_search, which gives arrays where batch_nearest_neighbor_search gives lists"


def limit(_threads):
    """Nothing: the number goes with every call."""


def cloud(points):
    return small_gicp.PointCloud(points.astype(np.float64))


def voxel(inputs, threads):
    map_ = cloud(inputs.points("map.f32"))
    return Work(
        run=lambda: small_gicp.voxelgrid_sampling(map_, inputs.voxel, threads),
        result=lambda thin: thin.points()[:, :3].astype(np.float32),
        note="with threads a voxel may give more than one point (its documentation says so)" if threads > 1 else "",
    )


def tree(inputs, threads):
    map_ = cloud(inputs.points("map.f32"))
    return Work(run=lambda: small_gicp.KdTree(map_, threads))


def nearest(inputs, threads):
    built = small_gicp.KdTree(cloud(inputs.points("map.f32")), threads)
    probes = inputs.points("probes.f32").astype(np.float64)
    return Work(
        run=lambda: built.batch_knn_search(probes, 1, threads),
        result=lambda found: np.sqrt(found[1][:, 0]).astype(np.float32),
        note=WALK,
    )


def knn(inputs, threads):
    built = small_gicp.KdTree(cloud(inputs.points("map.f32")), threads)
    probes = inputs.points("probes.f32").astype(np.float64)
    return Work(
        run=lambda: built.batch_knn_search(probes, NEIGHBOURS, threads),
        result=lambda found: np.sqrt(found[1]).sum(axis=1).astype(np.float32),
    )


def normals_knn(inputs, threads):
    map_ = cloud(inputs.points("map_thin.f32"))

    def run():
        built = small_gicp.KdTree(map_, threads)
        small_gicp.estimate_normals(map_, built, NEIGHBOURS, threads)
        return map_

    return Work(run=run, result=lambda done: done.normals()[:, :3].astype(np.float32))


def registration(kind):
    """A refiner as a stage. Covariances, and for planes normals, are made within the time."""

    def stage(inputs, threads):
        map_ = cloud(inputs.points("map_thin.f32"))
        query = cloud(inputs.points("query_thin.f32"))
        starts = inputs.starts()
        note = ""
        if kind == "PLANE_ICP":
            # There is no way to hand normals in, so they are its own of as many neighbours, made outside the time.
            small_gicp.estimate_normals(map_, None, NEIGHBOURS, threads)
            note = "normals are its own of 20 neighbours, made outside the time: it takes none from outside"

        def one(start):
            built = small_gicp.KdTree(map_, threads)
            if kind == "GICP":
                small_gicp.estimate_covariances(map_, built, NEIGHBOURS, threads)
                of_query = small_gicp.KdTree(query, threads)
                small_gicp.estimate_covariances(query, of_query, NEIGHBOURS, threads)
            return small_gicp.align(
                map_,
                query,
                built,
                start,
                registration_type=kind,
                max_correspondence_distance=PAIRS_WITHIN,
                num_threads=threads,
                max_iterations=ITERATIONS,
                rotation_epsilon=ROTATION_EPSILON,
                translation_epsilon=TRANSLATION_EPSILON,
            )

        return Work(
            run=lambda: [one(start) for start in starts],
            result=lambda found: np.stack([each.T_target_source for each in found]).astype(np.float64),
            count=lambda _: 0,
            note=note,
        )

    return stage


STAGES = {
    "voxel": voxel,
    "tree": tree,
    "nearest": nearest,
    "knn": knn,
    "normals-knn": normals_knn,
    "icp-point": registration("ICP"),
    "icp-plane": registration("PLANE_ICP"),
    "gicp": registration("GICP"),
}
