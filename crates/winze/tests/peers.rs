//! The kernels against numbers that PCL and Open3D computed; `peer/README.md` says how.

#![expect(
    clippy::unwrap_used,
    reason = "a test that cannot read its numbers must fail"
)]

use std::path::Path;

use winze::config::{
    DescriptorVariant, FpfhConfig, IcpConfig, IcpMetric, IssCentre, IssConfig, Kernel, Length,
    NdtConfig,
};
use winze::kdtree::KdTree;
use winze::normals::Neighbourhood;
use winze::prepare::Surface;
use winze::{Cloud, Pose, denoise, fpfh, icp, iss, ndt, normals, voxel};

fn rows(name: &str) -> Vec<Vec<f64>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/peer")
        .join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    let rows: Vec<Vec<f64>> = text
        .lines()
        .filter(|l| !l.starts_with('#'))
        .map(|l| l.split(',').filter_map(|t| t.parse().ok()).collect())
        .collect();
    assert!(!rows.is_empty(), "{name}");
    rows
}

fn points(name: &str) -> Vec<[f32; 3]> {
    rows(name)
        .iter()
        .map(|r| [r[0] as f32, r[1] as f32, r[2] as f32])
        .collect()
}

/// The given oriented normals, normalised as their README asks.
fn given_normals() -> Vec<[f32; 3]> {
    rows("normals.csv")
        .iter()
        .map(|r| {
            let n = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]).sqrt();
            [(r[0] / n) as f32, (r[1] / n) as f32, (r[2] / n) as f32]
        })
        .collect()
}

fn surface() -> Surface<'static> {
    let points = points("cloud.csv");
    Surface {
        origin: [0.0; 3],
        voxel: 0.25,
        tree: KdTree::build(&points),
        normals: given_normals().into(),
        points: points.into(),
    }
}

fn indices(name: &str) -> Vec<u32> {
    rows(name).iter().map(|r| r[0] as u32).collect()
}

fn pose(name: &str) -> Pose {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer/poses.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let line = text
        .lines()
        .find(|l| l.starts_with(&format!("{name},")))
        .unwrap();
    let v: Vec<f64> = line
        .split(',')
        .skip(1)
        .map(|t| t.parse().unwrap())
        .collect();
    Pose::from_matrix(std::array::from_fn(|i| {
        std::array::from_fn(|j| v[4 * i + j])
    }))
    .unwrap()
}

#[test]
fn normals_are_those_of_pcl_and_open3d() {
    let points = points("cloud.csv");
    let tree = KdTree::build(&points);
    let station = &rows("stations.csv")[7];
    for (file, most, radius) in [
        ("normals_pcl_k20.csv", 20, 0.0),
        ("normals_open3d_k20.csv", 20, 0.0),
        ("normals_pcl_r08.csv", 0, 0.8),
        ("normals_open3d_r08.csv", 0, 0.8),
    ] {
        let mut ours = normals::estimate(
            &points,
            &tree,
            Neighbourhood {
                radius,
                least: 0,
                most,
            },
        );
        normals::orient_towards(&points, &mut ours, [station[0], station[1], station[2]]);
        for row in rows(file) {
            let n = ours[row[0] as usize];
            let cos: f64 = (0..3).map(|a| f64::from(n[a]) * row[a + 1]).sum();
            // acos of an f32 dot product is good to about 0.03° near 0.
            assert!(
                cos > (0.05f64).to_radians().cos(),
                "{file} row {}: cos {cos}",
                row[0]
            );
        }
    }
}

#[test]
fn fpfh_agrees_with_pcl_and_open3d_within_one_percent() {
    let s = surface();
    for (file, variant) in [
        ("fpfh_pcl.csv", DescriptorVariant::Pcl),
        ("fpfh_open3d.csv", DescriptorVariant::Open3d),
    ] {
        let theirs = rows(file);
        let keypoints: Vec<u32> = theirs.iter().map(|r| r[0] as u32).collect();
        let config = FpfhConfig {
            radius: Length::Metres(1.25),
            variant,
            unsigned: false,
        };
        let ours = fpfh::descriptors(&s.points, &s.normals, &s.tree, &keypoints, &config, s.voxel);
        let mut worst: f64 = 0.0;
        for (a, row) in ours.iter().zip(&theirs) {
            let l1: f64 = a
                .iter()
                .zip(&row[1..])
                .map(|(x, y)| (f64::from(*x) - y).abs())
                .sum();
            let size: f64 = row[1..].iter().sum();
            worst = worst.max(l1 / size);
        }
        assert!(
            worst < 0.01,
            "{file}: worst L1 difference {:.3} %",
            100.0 * worst
        );
    }
}

fn iss_config(centre: IssCentre) -> IssConfig {
    IssConfig {
        salient_radius: Length::Metres(1.0),
        non_max_radius: Length::Metres(0.75),
        cell: Length::Metres(0.0),
        min_relief: 0.0,
        min_keypoints: 0,
        max_keypoints: 0,
        centre,
        ..IssConfig::default()
    }
}

#[test]
fn iss_keypoints_are_exactly_those_of_open3d() {
    let s = surface();
    let ours = iss::keypoints(
        &s.points,
        &s.tree,
        &iss_config(IssCentre::Centroid),
        s.voxel,
    );
    assert_eq!(ours.indices, indices("iss_open3d.csv"));
    assert_eq!(ours.qualified, ours.indices.len());
}

#[test]
fn iss_saliencies_are_those_of_both_scatters_divided_by_the_count() {
    let s = surface();
    let about_point = iss::saliency(&s.points, &s.tree, &iss_config(IssCentre::Point), s.voxel);
    let about_mean = iss::saliency(
        &s.points,
        &s.tree,
        &iss_config(IssCentre::Centroid),
        s.voxel,
    );
    for row in rows("iss_eigen.csv") {
        let (i, n) = (row[0] as usize, row[1]);
        for (ours, l) in [
            (about_point[i], [row[2] / n, row[3] / n, row[4] / n]),
            (about_mean[i], [row[5], row[6], row[7]]),
        ] {
            assert!(
                (f64::from(ours.value) - l[2]).abs() < 1e-5 * l[0],
                "row {i}"
            );
            let ratios = [l[1] / l[0], l[2] / l[1]];
            if ratios.iter().all(|r| (r - 0.975).abs() > 1e-4) {
                assert_eq!(ours.qualifies, ratios.iter().all(|r| *r < 0.975), "row {i}");
            }
        }
    }
}

#[test]
fn outlier_removal_is_that_of_pcl() {
    let points = points("outliers.csv");
    let tree = KdTree::build(&points);
    let removed = |kept: Vec<u32>| -> Vec<u32> {
        (0..points.len() as u32)
            .filter(|i| kept.binary_search(i).is_err())
            .collect()
    };
    let statistical = removed(denoise::statistical(&points, &tree, 16, 1.0));
    assert_eq!(statistical, indices("removed_statistical_pcl.csv"));
    // Open3D counts the point itself among the 16.
    let fifteen = removed(denoise::statistical(&points, &tree, 15, 1.0));
    let open3d = indices("removed_statistical_open3d.csv");
    let differ = fifteen.iter().filter(|i| !open3d.contains(i)).count();
    assert!(
        differ <= 2,
        "{differ} of {} differ from Open3D",
        open3d.len()
    );
    let radius = removed(denoise::radius(&points, &tree, 0.6, 5));
    assert_eq!(radius, indices("removed_radius_pcl.csv"));
}

#[test]
fn voxel_centroids_are_those_of_pcl() {
    let cloud: Vec<[f64; 3]> = rows("cloud.csv")
        .iter()
        .map(|r| [r[0], r[1], r[2]])
        .collect();
    let (cloud, _) = Cloud::from_points(&cloud).unwrap();
    let mut ours: Vec<[f64; 3]> = voxel::downsample(&cloud, 0.5).iter().collect();
    let theirs = rows("voxel_pcl.csv");
    assert_eq!(ours.len(), theirs.len());
    ours.sort_by(|a, b| a.partial_cmp(b).unwrap());
    for row in &theirs {
        let near = ours
            .iter()
            .any(|p| (0..3).all(|a| (p[a] - row[a]).abs() < 2e-5));
        assert!(near, "no centroid at {row:?}");
    }
}

fn moved() -> (Surface<'static>, Pose) {
    let t = rows("T_cloud_moved.csv");
    let truth =
        Pose::from_matrix(std::array::from_fn(|i| std::array::from_fn(|j| t[i][j]))).unwrap();
    (
        Surface {
            points: points("moved.csv").into(),
            voxel: 0.25,
            ..Surface::default()
        },
        truth,
    )
}

fn icp_config(metric: IcpMetric) -> IcpConfig {
    IcpConfig {
        metric,
        max_distance: Length::Metres(1.0),
        final_distance: Length::Metres(1.0),
        kernel: Kernel::None,
        trim: 1.0,
        max_points: 0,
        max_iterations: 300,
        translation_epsilon: 1e-7,
        rotation_epsilon: 1e-8,
        ..IcpConfig::default()
    }
}

#[test]
fn icp_ends_where_pcl_and_open3d_end() {
    let (map, (query, _)) = (surface(), moved());
    for (name, metric) in [
        ("pcl_icp_point", IcpMetric::PointToPoint),
        ("open3d_icp_point", IcpMetric::PointToPoint),
        ("open3d_icp_plane", IcpMetric::PointToPlane),
    ] {
        let ours = icp::align(&map, &query, &Pose::identity(), &icp_config(metric));
        let apart = ours.map_from_query.distance(&pose(name), [0.0; 3]);
        assert!(
            apart.translation < 1e-4 && apart.rotation < 1e-4,
            "{name}: {apart:?} after {} iterations, {}",
            ours.iterations,
            ours.stop
        );
    }
}

#[test]
fn generalized_icp_ends_where_small_gicp_ends() {
    let (mut map, (mut query, _)) = (surface(), moved());
    let around = Neighbourhood {
        radius: 0.0,
        least: 0,
        most: 20,
    };
    for s in [&mut map, &mut query] {
        s.tree = KdTree::build(&s.points);
        s.normals = normals::estimate(&s.points, &s.tree, around).into();
    }
    let config = icp_config(IcpMetric::Generalized);
    let ours = icp::align(&map, &query, &Pose::identity(), &config);
    let apart = ours
        .map_from_query
        .distance(&pose("small_gicp_gicp"), [0.0; 3]);
    assert!(
        apart.translation < 1e-4 && apart.rotation < 1e-4,
        "{apart:?} after {} iterations, {}",
        ours.iterations,
        ours.stop
    );
}

#[test]
fn the_information_matrix_is_that_of_a_peer() {
    let (map, (query, _)) = (surface(), moved());
    let at = pose("open3d_icp_plane");
    let ours = icp::information(&map, &query, &at, 1.0, 0);
    assert_eq!(ours.pairs, 1716);
    // Theirs is for T exp(δ) with the rotation first, about the query's origin and in its axes.
    // Carry ours there: δt_map = R ρ + (R θ) × (c − t), δθ_map = R θ.
    let theirs = rows("information_plane.csv");
    let m = at.to_matrix();
    let (r, t) = (|i: usize, j: usize| m[i][j], [m[0][3], m[1][3], m[2][3]]);
    let arm: [f64; 3] = std::array::from_fn(|a| ours.about[a] - t[a]);
    let mut j = [[0.0; 6]; 6];
    for k in 0..3 {
        let axis = [r(0, k), r(1, k), r(2, k)];
        let swing = [
            axis[1] * arm[2] - axis[2] * arm[1],
            axis[2] * arm[0] - axis[0] * arm[2],
            axis[0] * arm[1] - axis[1] * arm[0],
        ];
        for a in 0..3 {
            j[a][k] = swing[a];
            j[3 + a][k] = axis[a];
            j[a][3 + k] = axis[a];
        }
    }
    for a in 0..6 {
        for b in 0..6 {
            let mut h = 0.0;
            for p in 0..6 {
                for q in 0..6 {
                    h += j[p][a] * ours.matrix[p][q] * j[q][b];
                }
            }
            let scale = (theirs[a][a] * theirs[b][b]).sqrt();
            assert!(
                (h - theirs[a][b]).abs() < 1e-4 * scale,
                "({a}, {b}): {h} and {}",
                theirs[a][b]
            );
        }
    }
}

#[test]
fn ndt_comes_closer_to_the_truth_than_pcls() {
    let (map, (query, truth)) = (surface(), moved());
    let mut config = NdtConfig {
        coarsest: Length::Metres(2.0),
        finest: Length::Metres(2.0),
        max_points: 0,
        translation_epsilon: 1e-5,
        rotation_epsilon: 1e-6,
        max_iterations: 100,
        ..NdtConfig::default()
    };
    let error = |config: &NdtConfig| {
        let levels = ndt::levels(&map, config);
        let found = ndt::align(&levels, &map, &query, &Pose::identity(), config);
        found.map_from_query.distance(&truth, [0.0; 3])
    };
    let ours = error(&config);
    let theirs = pose("pcl_ndt").distance(&truth, [0.0; 3]);
    assert!(
        ours.translation < theirs.translation,
        "{ours:?}, PCL {theirs:?}"
    );
    // Two metres are coarse for a drift of four; finer cells take most of the bias away.
    config.finest = Length::Metres(1.0);
    let finer = error(&config);
    assert!(
        finer.translation < 0.5 * theirs.translation,
        "{finer:?}, PCL {theirs:?}"
    );
}
