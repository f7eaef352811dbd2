//! Real clouds: a mine drift mapped twice, three weeks apart, and a tunnel where it does not
//! belong. They are read from `WINZE_DATA`; without it these tests are ignored.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;
#[path = "../../../examples/common/mod.rs"]
mod study;

use common::{locate, timeless};
use study::{data, halves, off, random_frame, read, truth};
use winze::config::{Config, IcpConfig, IcpMetric, Length};
use winze::prepare::prepare;
use winze::{Cloud, Method, Pose, Verdict, icp, ndt, scale};

fn jinchuan() -> String {
    let folder = data().join("jinchuan");
    format!(
        "{0}/map_2025-05-13.pcd {0}/query_2025-04-21.pcd --truth {0}/T_map_query.txt",
        folder.display()
    )
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn the_drift_is_found_again_three_weeks_later() {
    for seed in [0, 7] {
        let (o, code) = locate(&data(), &format!("{} --seed {seed}", jinchuan()));
        assert_eq!(
            (o["verdict"].as_str(), code),
            (Some("located"), Some(0)),
            "{}",
            o["reason"]
        );
        let number = |v: &serde_json::Value| v.as_f64().unwrap();
        assert!(number(&o["error"]["translation_m"]) < 0.5, "{}", o["error"]);
        assert!(number(&o["error"]["rotation_deg"]) < 5.0, "{}", o["error"]);
        assert!(
            number(&o["inlier_fraction"]) >= 0.94,
            "{}",
            o["inlier_fraction"]
        );
        assert!(number(&o["inlier_rmse"]) <= 0.15, "{}", o["inlier_rmse"]);
    }
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn its_built_map_gives_the_same_pose_by_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let map = data().join("jinchuan/map_2025-05-13.pcd");
    let out = folder.path().join("mine.wmap");
    let run = common::winze(
        folder.path(),
        &format!("map build {} -o {} --quiet", map.display(), out.display()),
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let query = data().join("jinchuan/query_2025-04-21.pcd");
    for method in Method::ALL {
        let of = |map: &std::path::Path| {
            let args = format!("{} {} --method {method}", map.display(), query.display());
            locate(folder.path(), &args)
        };
        let ((of_cloud, one), (of_map, other)) = (of(&map), of(&out));
        assert_eq!(one, other, "{method}");
        for field in [
            "verdict",
            "reason",
            "map_from_query",
            "hypotheses",
            "unobservable",
        ] {
            assert_eq!(of_cloud[field], of_map[field], "{method}: {field}");
        }
        assert!(of_map["map_from_query"].is_array());
        assert_eq!(of_map["inlier_reference"], "finest level of the built map");
    }
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn in_a_tunnel_where_it_does_not_belong_it_is_refused() {
    let args = format!(
        "{0}/gazebo_tunnel/slam_map.pcd {0}/jinchuan/query_2025-04-21.pcd",
        data().display()
    );
    let (o, code) = locate(&data(), &args);
    assert_eq!(
        (o["verdict"].as_str(), code),
        (Some("not_found"), Some(1)),
        "{}",
        o["reason"]
    );
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn the_same_json_at_1_2_and_8_threads_for_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let query = read("jinchuan/query_2025-04-21.pcd").unwrap();
    let start = off(&truth("jinchuan/T_map_query.txt").unwrap(), &query, 0);
    winze_io::write_transform(&folder.path().join("start.txt"), &start).unwrap();
    for method in [
        "auto",
        "fpfh",
        "fpfh+ndt",
        "fpfh+icp",
        "ndt+icp --initial start.txt",
        "fpfh+ndt+icp",
    ] {
        let run = |threads| {
            let args = format!("{} --method {method} --threads {threads}", jinchuan());
            timeless(locate(folder.path(), &args).0)
        };
        let one = run(1);
        assert_eq!(one["verdict"], "located", "{method}: {}", one["reason"]);
        assert_eq!(one, run(2), "{method} at 2 threads");
        assert_eq!(one, run(8), "{method} at 8 threads");
    }
}

fn is_right(pose: &Pose, truth: &Pose, query: &Cloud) -> bool {
    let error = pose.distance(truth, query.centroid().unwrap());
    error.translation < 0.5 && error.rotation < 5f64.to_radians()
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn each_half_of_the_drift_is_found_in_any_frame() {
    let map = read("jinchuan/map_2025-05-13.pcd").unwrap();
    let query = read("jinchuan/query_2025-04-21.pcd").unwrap();
    let truth = truth("jinchuan/T_map_query.txt").unwrap();
    for (seed, half) in (5u64..).zip(halves(&query, &truth)) {
        let frame = random_frame(seed);
        let half = half.transformed(&frame).unwrap();
        let outcome = winze::locate(&map, &half, &Config::default()).unwrap();
        assert_eq!(outcome.verdict, Verdict::Located, "{}", outcome.reason);
        let truth = truth.compose(&frame.inverse());
        assert!(is_right(&outcome.map_from_query.unwrap(), &truth, &half));
    }
}

/// The map's junction looks alike under quarter turns, see docs/junction.md.
#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn at_a_junction_with_a_twin_the_right_place_is_listed_and_none_is_believed() {
    let map = read("gazebo_tunnel/slam_map.pcd").unwrap();
    let world_from_map = truth("gazebo_tunnel/T_world_map.txt").unwrap();
    let world = study::mesh::triangles(&data().join("gazebo_tunnel/world.ply")).unwrap();
    let points = study::mesh::sample(&world, 0, |p| {
        (p[0] - 40.0).abs() < 10.0 && p[1] > -8.0 && p[1] < 25.0
    });
    let frame = random_frame(0);
    let query: Vec<[f64; 3]> = points.iter().map(|p| frame.transform(*p)).collect();
    let (query, _) = Cloud::from_points(&query).unwrap();
    let truth = world_from_map.inverse().compose(&frame.inverse());
    let outcome = winze::locate(&map, &query, &Config::default()).unwrap();
    assert_eq!(outcome.verdict, Verdict::Ambiguous, "{}", outcome.reason);
    let listed = outcome
        .hypotheses
        .iter()
        .any(|h| is_right(&h.map_from_query, &truth, &query));
    assert!(listed);
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn ndt_and_icp_bring_real_pairs_home() {
    let config = Config::default();
    let plane = IcpConfig {
        metric: IcpMetric::PointToPlane,
        max_distance: Length::Metres(1.5),
        max_iterations: 200,
        ..config.icp.clone()
    };
    for (map, query, t) in [
        (
            "pairs/outdoor_target.ply",
            "pairs/outdoor_source.ply",
            "pairs/outdoor_T_target_source.txt",
        ),
        (
            "pairs/room_scan1.pcd",
            "pairs/room_scan2.pcd",
            "pairs/room_T_1_2.txt",
        ),
    ] {
        let (map, cloud) = (read(map).unwrap(), read(query).unwrap());
        let truth = truth(t).unwrap();
        let measure = |c| scale::measure(c).unwrap();
        let voxel = scale::voxel_for(&measure(&map), &measure(&cloud));
        let map = prepare(&map, &config.prepare, voxel);
        let query = prepare(&cloud, &config.prepare, voxel);
        let levels = ndt::levels(&map, &config.ndt);
        for seed in 0..4 {
            let start = off(&truth, &cloud, seed);
            for found in [
                icp::align(&map, &query, &start, &plane),
                ndt::align(&levels, &map, &query, &start, &config.ndt),
            ] {
                let centroid = cloud.centroid().unwrap();
                let error = found.map_from_query.distance(&truth, centroid);
                let home = error.translation < 0.05 && error.rotation < 0.5f64.to_radians();
                assert!(home, "{t} {seed}: {error:?}, {}", found.stop);
                assert!(found.information.pairs > 1000);
            }
        }
    }
}
