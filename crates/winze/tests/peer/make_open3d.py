"""Open3D and small_gicp side of the peer comparison. Run after make_pcl: reads
cloud.csv, stations.csv, normals.csv, outliers.csv, moved.csv, T_cloud_moved.csv
and the PCL rows of poses.csv; writes every *_open3d*.csv, *_small_gicp*.csv and
the complete poses.csv."""

from importlib.metadata import version

import numpy as np
import open3d as o3d
import small_gicp

VIEWPOINT_STATION = 7
STRIDE = 10  # rows written of per-point results
BY_OPEN3D = f", by Open3D {o3d.__version__}"
SMALL_GICP = f"small_gicp {version('small_gicp')}"
Radius = o3d.geometry.KDTreeSearchParamRadius
Knn = o3d.geometry.KDTreeSearchParamKNN
Hybrid = o3d.geometry.KDTreeSearchParamHybrid


def read(name):
    return np.loadtxt(name, delimiter=",", comments="#")


def save(name, header, rows, fmt="%.7g"):
    np.savetxt(name, rows, fmt=fmt, delimiter=",", header=header, comments="# ")


def cloud_of(points, normals=None):
    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        pcd.normals = o3d.utility.Vector3dVector(normals)
    return pcd


def normals(points, eye):
    for tag, param, what in (
        ("k20", Knn(20), "k = 20 (the point is one of the 20)"),
        ("r08", Radius(0.8), "radius 0.8"),
    ):
        pcd = cloud_of(points)
        pcd.estimate_normals(param)
        pcd.orient_normals_towards_camera_location(eye)
        n = np.asarray(pcd.normals)
        index = np.arange(0, len(points), STRIDE)
        save(
            f"normals_open3d_{tag}.csv",
            f"index,nx,ny,nz of every 10th point of cloud.csv: estimate_normals, {what}, "
            "flipped towards row 7 of stations.csv" + BY_OPEN3D,
            np.column_stack([index, n[index]]),
        )


def fpfh(points, given, param):
    return o3d.pipelines.registration.compute_fpfh_feature(cloud_of(points, given), param).data.T


def features(points, given):
    f = fpfh(points, given, Radius(1.25))
    hybrid = fpfh(points, given, Hybrid(1.25, 1000))
    print("fpfh: radius and hybrid(max_nn 1000) differ by at most", np.abs(f - hybrid).max())
    index = np.arange(0, len(points), STRIDE)
    save(
        "fpfh_open3d.csv",
        "index, then 33 FPFH bins (11 f1, 11 f2, 11 f3) of every 10th point: compute_fpfh_feature, "
        "KDTreeSearchParamRadius(1.25), cloud.csv with normals.csv" + BY_OPEN3D,
        np.column_stack([index, f[index]]),
    )
    twice = fpfh(np.vstack([points, points[:1]]), np.vstack([given, given[:1]]), Radius(1.25))
    save(
        "fpfh_duplicate_open3d.csv",
        "33 FPFH bins of point 0 after row 0 of cloud.csv and normals.csv is appended once more: "
        "radius 1.25" + BY_OPEN3D,
        twice[:1],
    )


def keypoints(points):
    found = o3d.geometry.keypoint.compute_iss_keypoints(
        cloud_of(points), salient_radius=1.0, non_max_radius=0.75, gamma_21=0.975, gamma_32=0.975, min_neighbors=5
    )
    row = {tuple(p): i for i, p in enumerate(points)}
    index = np.sort([row[tuple(p)] for p in np.asarray(found.points)])
    save(
        "iss_open3d.csv",
        "indices of the compute_iss_keypoints keypoints of cloud.csv: salient 1.0, non-max 0.75, "
        "gamma21 = gamma32 = 0.975, min neighbours 5" + BY_OPEN3D,
        index,
        "%d",
    )
    print("iss:", len(index))


def outlier_removal():
    pcd = cloud_of(read("outliers.csv"))
    every = np.arange(len(pcd.points))
    for tag, (_, kept), what in (
        ("statistical", pcd.remove_statistical_outlier(16, 1.0), "remove_statistical_outlier(16, 1.0)"),
        ("radius", pcd.remove_radius_outlier(5, 0.6), "remove_radius_outlier(5, 0.6)"),
    ):
        removed = np.setdiff1d(every, np.asarray(kept, dtype=int))
        save(
            f"removed_{tag}_open3d.csv",
            f"removed indices of outliers.csv (all others are kept): {what}" + BY_OPEN3D,
            removed,
            "%d",
        )
        print(tag, "removed", len(removed))


def voxels(points):
    c = np.round(np.asarray(cloud_of(points).voxel_down_sample(0.5).points), 5)
    c = c[np.lexsort((c[:, 2], c[:, 1], c[:, 0]))]
    save(
        "voxel_open3d.csv",
        f"x,y,z centroids ({len(c)} cells) of cloud.csv, 5 decimals, sorted: voxel_down_sample(0.5)" + BY_OPEN3D,
        c,
        "%.5f",
    )
    print("voxels:", len(c))


def registrations(points, given):
    moved, truth = read("moved.csv"), read("T_cloud_moved.csv")
    reg = o3d.pipelines.registration
    stop = reg.ICPConvergenceCriteria(relative_fitness=1e-14, relative_rmse=1e-14, max_iteration=300)
    target, source = cloud_of(points, given), cloud_of(moved)
    poses = {}
    with open("poses.csv") as lines:
        for line in lines:
            if line.startswith("pcl_"):
                name, *numbers = line.strip().split(",")
                poses[name] = np.array(numbers[:16], dtype=float).reshape(4, 4)
    for name, how in (
        ("open3d_icp_point", reg.TransformationEstimationPointToPoint()),
        ("open3d_icp_plane", reg.TransformationEstimationPointToPlane()),
    ):
        poses[name] = reg.registration_icp(source, target, 1.0, np.eye(4), how, stop).transformation

    fine = dict(max_correspondence_distance=1.0, max_iterations=200, rotation_epsilon=1e-10, translation_epsilon=1e-10)
    to, fro = small_gicp.PointCloud(points), small_gicp.PointCloud(moved)
    for c in (to, fro):
        small_gicp.estimate_normals_covariances(c, small_gicp.KdTree(c), num_neighbors=20)
    tree = small_gicp.KdTree(to)
    for name, kind in (("small_gicp_plane", "PLANE_ICP"), ("small_gicp_gicp", "GICP")):
        result = small_gicp.align(to, fro, tree, registration_type=kind, **fine)
        poses[name] = result.T_target_source
        print(name, "converged" if result.converged else "not converged", "inliers", result.num_inliers)
        save(
            f"information_{name}.csv",
            f"rows 1-6: H, row 7: b of align({kind}) at the pose {name} of poses.csv, error {result.error:.7g}, "
            f"{result.num_inliers} inliers; rotation first, T exp(delta), by {SMALL_GICP}",
            np.vstack([result.H, np.ravel(result.b)]),
        )

    with open("poses.csv", "w") as out:
        out.write(
            "# name, 16 numbers of the 4x4 row by row (moved.csv to cloud.csv), translation error in m, "
            f"rotation error in degrees against T_cloud_moved.csv, by PCL 1.13.0, Open3D {o3d.__version__}, {SMALL_GICP}; "
            "settings in README.md\n"
        )
        for name, t in poses.items():
            turn = truth[:3, :3].T @ t[:3, :3]
            skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            angle = np.rad2deg(np.arctan2(np.linalg.norm(skew), np.trace(turn) - 1.0))
            shift = np.linalg.norm(t[:3, 3] - truth[:3, 3])
            numbers = ",".join(f"{v:.9g}" for v in t.ravel())
            out.write(f"{name},{numbers},{shift:.6g},{angle:.6g}\n")
            print(f"{name:18s} {shift * 1000:8.3f} mm {angle:8.4f} deg")


def conventions():
    """The PCL experiments of make_pcl.cpp, with Open3D."""
    cross = [[0.0, 0.0, 0.0]]
    for s in (-1.0, 1.0, -0.5, 0.5):
        cross += [[s, 0.0, 0.0], [0.0, s, 0.0]]
    pcd = cloud_of(np.array(cross))
    tree = o3d.geometry.KDTreeFlann(pcd)
    rows = [
        ("radius_1_count_of_9", tree.search_radius_vector_3d(cross[0], 1.0)[0]),
        ("hybrid_1_count_of_9", tree.search_hybrid_vector_3d(cross[0], 1.0, 100)[0]),
        ("knn_first_is_self", int(tree.search_knn_vector_3d(cross[0], 3)[1][0] == 0)),
    ]
    for n in (4, 5):  # five points, the centre included, lie strictly within 1
        _, kept = pcd.remove_radius_outlier(n, 1.0)
        rows.append((f"radius_removal_keeps_centre_with_min_{n}", int(0 in kept)))
    # As in make_pcl.cpp, but 2 neighbours, for the point itself is one of them.
    for name, xs, multiplier in (
        ("statistical_1.7_kept_of_5", [0, 1, 2, 3, 5], 1.7),
        ("statistical_1.9_kept_of_5", [0, 1, 2, 3, 5], 1.9),
        ("statistical_all_equal_kept_of_4", [0, 1, 2, 3], 1.0),
    ):
        line = np.column_stack([xs, np.zeros((len(xs), 2))])
        rows.append((name, len(cloud_of(line).remove_statistical_outlier(2, multiplier)[1])))
    with open("conventions_open3d.csv", "w") as out:
        out.write("# name,value: small experiments described in README.md" + BY_OPEN3D + "\n")
        out.writelines(f"{name},{value}\n" for name, value in rows)


def main():
    points, eye = read("cloud.csv"), read("stations.csv")[VIEWPOINT_STATION]
    given = read("normals.csv")
    given /= np.linalg.norm(given, axis=1, keepdims=True)
    normals(points, eye)
    features(points, given)
    keypoints(points)
    outlier_removal()
    voxels(points)
    registrations(points, given)
    conventions()


if __name__ == "__main__":
    main()
