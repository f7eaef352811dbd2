"""Open3D's stages. Where it has two ways, its legacy and its tensor interface, the one is taken that used less CPU time."""

import numpy as np
import open3d as o3d

from measure import Work

REG = o3d.pipelines.registration
TREG = o3d.t.pipelines.registration
Tensor = o3d.core.Tensor

NEIGHBOURS = 20
DEVIATIONS = 2.0
EDGE_SIMILARITY = 0.9
SAMPLES = 100_000
CONFIDENCE = 0.999
PAIRS_WITHIN = 1.0
ITERATIONS = 50
LEGACY, TENSOR = "legacy interface", "tensor interface"
ICP_NOTE = "legacy interface, quicker here than the tensor one; its convergence is relative fitness and RMSE, left at 1e-6"


def limit(threads):
    """Its parallel loops are oneTBB's, which no environment variable bounds."""
    o3d.utility.set_max_threads(threads)
    o3d.utility.random.seed(0)


def legacy(points, normals=None):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals.astype(np.float64))
    return cloud


def tensor(points, normals=None):
    cloud = o3d.t.geometry.PointCloud(Tensor(points))
    if normals is not None:
        cloud.point.normals = Tensor(normals)
    return cloud


def f32(array):
    return np.ascontiguousarray(array, np.float32)


def indices(array):
    return np.ascontiguousarray(array, np.uint32)


def pose_work(run, note=""):
    return Work(
        run=run, result=lambda found: np.ascontiguousarray(found, np.float64), count=lambda _: 0, note=note
    )


# Files.


def read(name, way):
    def stage(inputs, _threads):
        path = inputs.path(name)
        if way == TENSOR:
            run, points = o3d.t.io.read_point_cloud, lambda cloud: cloud.point.positions.numpy()
        else:
            run, points = o3d.io.read_point_cloud, lambda cloud: np.asarray(cloud.points)
        return Work(
            run=lambda: run(path),
            result=lambda cloud: points(cloud).mean(axis=0, dtype=np.float64),
            count=lambda cloud: len(points(cloud)),
            note=way + (", which leaves the intensity out" if way == LEGACY else ""),
        )

    return stage


# One cloud.


def voxel(inputs, _threads):
    map_ = legacy(inputs.points("map.f32"))
    return Work(
        run=lambda: map_.voxel_down_sample(inputs.voxel),
        result=lambda thin: f32(thin.points),
        note=LEGACY + "; one thread",
    )


def outliers(inputs, _threads):
    map_ = tensor(inputs.points("map_thin.f32"))
    return Work(
        run=lambda: map_.remove_statistical_outliers(NEIGHBOURS, DEVIATIONS),
        result=lambda kept: indices(np.flatnonzero(kept[1].numpy())),
        note=TENSOR,
    )


def search(points, radius=None):
    """Its search for many points at once."""
    built = o3d.core.nns.NearestNeighborSearch(Tensor(points), o3d.core.int32)
    if radius is None:
        built.knn_index()
    else:
        built.fixed_radius_index(radius)
    return built


def tree(inputs, _threads):
    map_ = inputs.points("map.f32")
    return Work(run=lambda: search(map_), note="core.nns, which the searches below use")


def nearest(inputs, _threads):
    built, probes = search(inputs.points("map.f32")), Tensor(inputs.points("probes.f32"))
    return Work(
        run=lambda: built.knn_search(probes, 1), result=lambda found: f32(np.sqrt(found[1].numpy()[:, 0])), note="core.nns"
    )


def knn(inputs, _threads):
    built, probes = search(inputs.points("map.f32")), Tensor(inputs.points("probes.f32"))
    return Work(
        run=lambda: built.knn_search(probes, NEIGHBOURS),
        result=lambda found: f32(np.sqrt(found[1].numpy()).sum(axis=1)),
        note="core.nns",
    )


def radius(inputs, _threads):
    within = 3.0 * inputs.voxel
    built, probes = search(inputs.points("map.f32"), within), Tensor(inputs.points("probes.f32"))
    return Work(
        run=lambda: built.fixed_radius_search(probes, within, sort=False),
        result=lambda found: indices(np.diff(found[2].numpy())),
        note="core.nns, not sorted",
    )


def normals(**how):
    def stage(inputs, _threads):
        map_ = tensor(inputs.points("map_thin.f32"))
        asked = {name: value(inputs) for name, value in how.items()}

        def fresh():
            if "normals" in map_.point:
                del map_.point["normals"]

        def run():
            map_.estimate_normals(**asked)
            return map_

        return Work(run=run, fresh=fresh, result=lambda done: f32(done.point.normals.numpy()), note=TENSOR)

    return stage


def rows_of(points, chosen):
    """Which rows of `points` the points of `chosen` are: ISS gives a cloud, not indices."""
    place = {point.tobytes(): row for row, point in enumerate(np.asarray(points))}
    return indices(sorted(place[point.tobytes()] for point in np.asarray(chosen)))


def keypoints(cloud, voxel_size):
    return o3d.geometry.keypoint.compute_iss_keypoints(cloud, 6.0 * voxel_size, 4.0 * voxel_size, 0.975, 0.975, 5)


def iss(inputs, _threads):
    map_ = legacy(inputs.points("map_thin.f32"))
    return Work(
        run=lambda: keypoints(map_, inputs.voxel),
        result=lambda found: rows_of(map_.points, found.points),
        note=LEGACY + ", its only one",
    )


def fpfh(at_keypoints):
    def stage(inputs, _threads):
        map_ = tensor(inputs.points("map_thin.f32"), inputs.points("map_normals.f32"))
        at = Tensor(inputs.indices("map_keypoints.u32").astype(np.int64)) if at_keypoints else None
        return Work(
            run=lambda: TREG.compute_fpfh_feature(map_, None, 5.0 * inputs.voxel, at),
            result=lambda found: f32(found.numpy()),
            note=TENSOR,
        )

    return stage


# Two clouds.


def match(mutual):
    def stage(inputs, _threads):
        query, map_ = (Tensor(inputs.features(name)) for name in ("query_fpfh.f32", "map_fpfh.f32"))
        return Work(
            run=lambda: TREG.correspondences_from_features(query, map_, mutual),
            result=lambda found: indices(found.numpy()),
            note=TENSOR,
        )

    return stage


def sampling(within):
    """RANSAC's settings: the inlier distance, and what follows it in both of its calls."""
    checks = [REG.CorrespondenceCheckerBasedOnEdgeLength(EDGE_SIMILARITY), REG.CorrespondenceCheckerBasedOnDistance(within)]
    criteria = REG.RANSACConvergenceCriteria(SAMPLES, CONFIDENCE)
    return within, REG.TransformationEstimationPointToPoint(False), 3, checks, criteria


def sampled(query, map_, pairs, voxel_size):
    within = 2.0 * voxel_size
    return REG.registration_ransac_based_on_correspondence(
        query,
        map_,
        pairs,
        *sampling(within),
    ).transformation


def ransac(inputs, _threads):
    sides = zip(("query", "map"), (("query_thin.f32", "query_keypoints.u32"), ("map_thin.f32", "map_keypoints.u32")))
    cloud = {side: legacy(inputs.points(thin)[inputs.indices(at)]) for side, (thin, at) in sides}
    pairs = o3d.utility.Vector2iVector(inputs.pairs("correspondences.u32").astype(np.int32))
    return pose_work(lambda: sampled(cloud["query"], cloud["map"], pairs, inputs.voxel))


def criteria():
    return REG.ICPConvergenceCriteria(max_iteration=ITERATIONS)


def icp(metric):
    def stage(inputs, _threads):
        query = legacy(inputs.points("query_thin.f32"))
        map_ = legacy(inputs.points("map_thin.f32"), inputs.points("map_normals.f32"))
        start = inputs.pose("start.f64")
        return pose_work(
            lambda: REG.registration_icp(query, map_, PAIRS_WITHIN, start, metric(), criteria()).transformation, ICP_NOTE
        )

    return stage


def gicp(inputs, _threads):
    clouds = {name: legacy(inputs.points(name)) for name in ("query_thin.f32", "map_thin.f32")}
    query, map_ = clouds.values()
    start = inputs.pose("start.f64")
    around = o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS)

    def fresh():
        for cloud in clouds.values():
            cloud.covariances = o3d.utility.Matrix3dVector()

    def run():
        for cloud in clouds.values():
            cloud.estimate_covariances(around)
        estimation = REG.TransformationEstimationForGeneralizedICP()
        return REG.registration_generalized_icp(query, map_, PAIRS_WITHIN, start, estimation, criteria()).transformation

    work = pose_work(run, ICP_NOTE.replace("legacy interface, quicker here than the tensor one", "legacy interface, its only one"))
    work.fresh = fresh
    return work


# From raw clouds to a pose.


def described(raw, voxel_size):
    """A cloud as the paper's chain wants it: thin, with normals; its keypoints and their features."""
    thin = raw.remove_statistical_outliers(NEIGHBOURS, DEVIATIONS)[0].to_legacy().voxel_down_sample(voxel_size)
    even = o3d.t.geometry.PointCloud.from_legacy(thin)
    even.estimate_normals(max_nn=NEIGHBOURS)
    thin = even.to_legacy()
    found = keypoints(thin, voxel_size)
    at = rows_of(thin.points, found.points).astype(np.int64)
    # The tensor interface's FPFH took two thirds of the legacy one's time.
    features = TREG.compute_fpfh_feature(even, None, 5.0 * voxel_size, Tensor(at))
    return thin, thin.select_by_index(at), features


def chain(inputs, _threads):
    query, map_ = tensor(inputs.points("query_0.f32")), tensor(inputs.points("map.f32"))

    def run():
        query_thin, query_keys, query_features = described(query, inputs.voxel)
        map_thin, map_keys, map_features = described(map_, inputs.voxel)
        pairs = TREG.correspondences_from_features(query_features, map_features, False)
        pairs = o3d.utility.Vector2iVector(pairs.numpy().astype(np.int32))
        start = sampled(query_keys, map_keys, pairs, inputs.voxel)
        point = REG.TransformationEstimationPointToPoint(False)
        return REG.registration_icp(query_thin, map_thin, PAIRS_WITHIN, start, point, criteria()).transformation

    return pose_work(run, "without NDT, which it has not; ICP point to point, as the paper has it")


def prepared(raw, voxel_size):
    thin = raw.voxel_down_sample(voxel_size)
    thin.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(2.0 * voxel_size, 30))
    feature = REG.Feature()
    of_thin = TREG.compute_fpfh_feature(o3d.t.geometry.PointCloud.from_legacy(thin), 100, 5.0 * voxel_size)
    feature.data = of_thin.numpy().T.astype(np.float64)
    return thin, feature


def located(raw, map_, voxel_size):
    query_thin, query_feature = prepared(raw, voxel_size)
    map_thin, map_feature = map_
    within = 1.5 * voxel_size
    pose = REG.registration_ransac_based_on_feature_matching(
        query_thin,
        map_thin,
        query_feature,
        map_feature,
        True,
        *sampling(within),
    ).transformation
    for distance in (2.0 * voxel_size, voxel_size):
        pose = REG.registration_icp(
            query_thin, map_thin, distance, pose, REG.TransformationEstimationPointToPlane()
        ).transformation
    return np.asarray(pose)


def relocalize(map_is_prepared):
    def stage(inputs, _threads):
        raw = legacy(inputs.points("map.f32"))
        queries = [legacy(points) for points in inputs.queries()]
        kept = prepared(raw, inputs.voxel) if map_is_prepared else None

        def run():
            return np.stack([located(query, kept or prepared(raw, inputs.voxel), inputs.voxel) for query in queries])

        return pose_work(run, "FPFH, RANSAC by mutual matches, point-to-plane ICP in two steps, as its documentation puts them together")

    return stage


STAGES = {
    "read-pcd-ascii": read("map.ascii.pcd", TENSOR),
    "read-pcd-binary": read("map.pcd", LEGACY),
    "read-pcd-compressed": read("map.compressed.pcd", LEGACY),
    "read-ply": read("map.ply", TENSOR),
    "voxel": voxel,
    "outliers": outliers,
    "tree": tree,
    "nearest": nearest,
    "knn": knn,
    "radius": radius,
    "normals-knn": normals(max_nn=lambda _: NEIGHBOURS),
    "normals-radius": normals(max_nn=lambda _: None, radius=lambda inputs: 2.5 * inputs.voxel),
    "iss": iss,
    "fpfh-all": fpfh(False),
    "fpfh-keypoints": fpfh(True),
    "match": match(False),
    "match-mutual": match(True),
    "ransac": ransac,
    "icp-point": icp(lambda: REG.TransformationEstimationPointToPoint(False)),
    "icp-plane": icp(REG.TransformationEstimationPointToPlane),
    "gicp": gicp,
    "chain": chain,
    "relocalize-prepared": relocalize(True),
    "relocalize": relocalize(False),
}
