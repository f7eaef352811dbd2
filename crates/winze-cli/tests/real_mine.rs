//! Real clouds: a mine drift mapped twice, three weeks apart, and a tunnel where it does not
//! belong. They are read from `WINZE_DATA`; without it these tests are ignored.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

mod common;

use common::{data, locate, timeless};

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
    for method in [
        "auto",
        "fpfh",
        "fpfh+ndt",
        "fpfh+icp",
        "ndt+icp",
        "fpfh+ndt+icp",
    ] {
        let run = |threads| {
            let args = format!("{} --method {method} --threads {threads}", jinchuan());
            timeless(locate(&data(), &args).0)
        };
        let one = run(1);
        assert_eq!(one, run(2), "{method} at 2 threads");
        assert_eq!(one, run(8), "{method} at 8 threads");
    }
}
