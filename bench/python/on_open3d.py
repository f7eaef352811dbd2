"""Open3D's stages. Where it has two ways, its legacy and its tensor interface, the one is taken that used less CPU time when this was written."""

import numpy as np
import open3d as o3d

from measure import Work

REG = o3d.pipelines.registration
TREG = o3d.t.pipelines.registration
Tensor = o3d.core.Tensor

NEIGHBOURS = 20
# It counts the point itself among the neighbours of which it takes the mean distance.
OUTLIERS = NEIGHBOURS + 1, 2.0
EDGE_SIMILARITY = 0.9
SAMPLES = 100_000
CONFIDENCE = 0.999
PAIRS_WITHIN = 1.0
ITERATIONS = 50
# Any odd numbers will do.
ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
LEGACY, TENSOR = "legacy interface", "tensor interface"
ICP_NOTE = "legacy interface; its convergence is relative fitness and RMSE, left at 1e-6"


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
    return Work(run=run, result=lambda found: np.ascontiguousarray(found, np.float64), count=lambda _: 0, note=note)


def refining(run, inputs, note):
    """`run` from each start."""
    starts = inputs.starts()
    return pose_work(lambda: [run(start) for start in starts], note)


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
        run=lambda: map_.remove_statistical_outliers(*OUTLIERS),
        result=lambda kept: indices(np.flatnonzero(kept[1].numpy())),
        note=TENSOR,
    )


def search(points, radius=None):
    """Its search for many points, a tensor, at once."""
    built = o3d.core.nns.NearestNeighborSearch(points, o3d.core.int32)
    if radius is None:
        built.knn_index()
    else:
        built.fixed_radius_index(radius)
    return built


def tree(inputs, _threads):
    map_ = Tensor(inputs.points("map.f32"))
    return Work(run=lambda: search(map_), note="core.nns, which the searches below use")


def nearest(inputs, _threads):
    built, probes = search(Tensor(inputs.points("map.f32"))), Tensor(inputs.points("probes.f32"))
    return Work(
        run=lambda: built.knn_search(probes, 1), result=lambda found: f32(np.sqrt(found[1].numpy()[:, 0])), note="core.nns"
    )


def knn(inputs, _threads):
    built, probes = search(Tensor(inputs.points("map.f32"))), Tensor(inputs.points("probes.f32"))
    return Work(
        run=lambda: built.knn_search(probes, NEIGHBOURS),
        result=lambda found: f32(np.sqrt(found[1].numpy()).sum(axis=1)),
        note="core.nns",
    )


def radius(inputs, _threads):
    within = 3.0 * inputs.voxel
    built, probes = search(Tensor(inputs.points("map.f32")), within), Tensor(inputs.points("probes.f32"))
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
    """Which rows of `points` the points of `chosen` are, by a hash of the bits: ISS gives a cloud, not indices."""

    def hashed(cloud):
        bits = np.asarray(cloud).view(np.uint64)
        # The low bits of what was 32 bits wide before are zero.
        return (bits ^ (bits >> np.uint64(32))) @ ODD

    return np.flatnonzero(np.isin(hashed(points), hashed(chosen)))


def keypoints(cloud, voxel_size):
    return o3d.geometry.keypoint.compute_iss_keypoints(cloud, 6.0 * voxel_size, 4.0 * voxel_size, 0.975, 0.975, 5)


def iss(inputs, _threads):
    map_ = legacy(inputs.points("map_thin.f32"))
    return Work(
        run=lambda: keypoints(map_, inputs.voxel),
        result=lambda found: indices(rows_of(map_.points, found.points)),
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

        def run(start):
            return REG.registration_icp(query, map_, PAIRS_WITHIN, start, metric(), criteria()).transformation

        return refining(run, inputs, ICP_NOTE)

    return stage


def gicp(inputs, _threads):
    clouds = {name: legacy(inputs.points(name)) for name in ("query_thin.f32", "map_thin.f32")}
    query, map_ = clouds.values()
    around = o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS)

    def run(start):
        # Those of the start before are overwritten.
        for cloud in clouds.values():
            cloud.estimate_covariances(around)
        estimation = REG.TransformationEstimationForGeneralizedICP()
        return REG.registration_generalized_icp(query, map_, PAIRS_WITHIN, start, estimation, criteria()).transformation

    return refining(run, inputs, ICP_NOTE.replace("interface", "interface, its only one", 1))


# From raw clouds to a pose.


def described(raw, voxel_size):
    """A cloud as the paper's chain wants it: thin; its keypoints and their features."""
    thin = raw.remove_statistical_outliers(*OUTLIERS)[0].to_legacy().voxel_down_sample(voxel_size)
    even = o3d.t.geometry.PointCloud.from_legacy(thin)
    even.estimate_normals(max_nn=NEIGHBOURS)
    found = keypoints(thin, voxel_size)
    at = rows_of(thin.points, found.points)
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


def by_ransac(*clouds, voxel_size):
    return REG.registration_ransac_based_on_feature_matching(*clouds, True, *sampling(1.5 * voxel_size))


def by_fgr(*clouds, voxel_size):
    option = REG.FastGlobalRegistrationOption(maximum_correspondence_distance=0.5 * voxel_size)
    return REG.registration_fgr_based_on_feature_matching(*clouds, option)


def located(raw, map_, voxel_size, way):
    query_thin, query_feature = prepared(raw, voxel_size)
    map_thin, map_feature = map_
    pose = way(query_thin, map_thin, query_feature, map_feature, voxel_size=voxel_size).transformation
    for distance in (2.0 * voxel_size, voxel_size):
        pose = REG.registration_icp(
            query_thin, map_thin, distance, pose, REG.TransformationEstimationPointToPlane()
        ).transformation
    return np.asarray(pose)


def relocalize(map_is_prepared, way):
    def stage(inputs, _threads):
        raw = legacy(inputs.points("map.f32"))
        queries = [legacy(points) for points in inputs.queries()]
        kept = prepared(raw, inputs.voxel) if map_is_prepared else None

        def run():
            return np.stack([located(query, kept or prepared(raw, inputs.voxel), inputs.voxel, way) for query in queries])

        how = "fast global registration" if way is by_fgr else "RANSAC by mutual matches"
        return pose_work(run, f"FPFH, {how}, point-to-plane ICP in two steps, as its documentation puts them together")

    return stage


def relocate(way):
    return {"relocalize-prepared": relocalize(True, way), "relocalize": relocalize(False, way)}


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
    **relocate(by_ransac),
}
FAST_STAGES = relocate(by_fgr)
