use super::*;
use crate::locate::locate_in;
use crate::outcome::Outcome;
use crate::request::{Near, Request};
use crate::test_world::{cloud, drift};
use crate::{Method, locate_by};

/// A rough drift of 16 m, and two parts of it measured again, each in a frame of its own.
fn scene() -> (Cloud, [Cloud; 2], Pose) {
    let query_from_map = Pose::from_rotation_vector([0.3, -0.2, 2.0], [40.0, -7.0, 3.0]);
    let again = drift(12_000, 16.0, 0.4, 0.01, 101);
    let part = |from: f64| {
        let part: Vec<[f64; 3]> = again
            .iter()
            .filter(|p| p[0] > from && p[0] < from + 7.0)
            .map(|p| query_from_map.transform(*p))
            .collect();
        cloud(&part)
    };
    let map = cloud(&drift(12_000, 16.0, 0.4, 0.01, 1));
    (map, [part(2.0), part(8.0)], query_from_map.inverse())
}

fn quick(seed: u64) -> Config {
    let mut config = Config {
        seed,
        ..Config::default()
    };
    config.ransac.max_samples = 4_000;
    config.ransac.min_samples = 2_000;
    config.iss.min_keypoints = 300;
    config.scale.voxel = 0.35;
    config
}

/// Everything but the times, which are all that may differ.
fn timeless(mut outcome: Outcome) -> String {
    outcome.seconds = 0.0;
    outcome.map_seconds = 0.0;
    for s in &mut outcome.stages {
        s.seconds = 0.0;
    }
    format!("{outcome:?}")
}

#[test]
fn what_is_kept_changes_no_bit_of_any_method_s_answer() {
    let (map, queries, truth) = scene();
    let mut kept_map = KeptMap::new(&map);
    let mut kept: Vec<KeptQuery<'_>> = queries.iter().map(KeptQuery::new).collect();
    for method in Method::ALL {
        let request = Request {
            method,
            initial: (!method.uses_features()).then_some(truth),
            ..Request::default()
        };
        for seed in [0, 5] {
            let config = quick(seed);
            // The other query comes in between now and then.
            let asked = if method == Method::Auto { 2 } else { 1 };
            for (i, query) in queries.iter().enumerate().take(asked) {
                let alone = locate_by(&map, query, &config, &request).unwrap();
                let within = locate_in(&mut kept_map, &mut kept[i], &config, &request).unwrap();
                assert!(alone.map_seconds > 0.0 && alone.map_seconds < alone.seconds);
                assert_eq!(timeless(alone), timeless(within), "{method} {seed} {i}");
            }
        }
    }
}

#[test]
fn other_settings_and_other_maps_are_not_confused() {
    let (map, [query, _], _) = scene();
    let other = cloud(&drift(12_000, 16.0, 0.4, 0.01, 3));
    let (mut one, mut two) = (KeptMap::new(&map), KeptMap::new(&other));
    let mut kept = KeptQuery::new(&query);
    let (plain, mut changed, mut icp) = (quick(0), quick(0), quick(0));
    changed.fpfh.radius = crate::config::Length::Voxels(5.0);
    changed.prepare.max_range = 46.0;
    icp.icp.max_iterations = 2;
    let request = Request::default();
    for config in [&plain, &changed, &plain, &icp] {
        for (cloud, kept_map) in [(&map, &mut one), (&other, &mut two)] {
            let alone = locate_by(cloud, &query, config, &request).unwrap();
            let within = locate_in(kept_map, &mut kept, config, &request).unwrap();
            assert_eq!(timeless(alone), timeless(within));
        }
    }
}

#[test]
fn a_search_region_leaves_what_is_kept_alone() {
    let (map, [query, _], truth) = scene();
    let mut kept_map = KeptMap::new(&map);
    let mut kept = KeptQuery::new(&query);
    let near = Request {
        near: Some(Near {
            centre: truth.transform(query.centroid().unwrap()),
            radius: 2.0,
        }),
        ..Request::default()
    };
    let mut config = quick(0);
    config.scale = crate::config::ScaleConfig::default();
    for request in [Request::default(), near, Request::default()] {
        let alone = locate_by(&map, &query, &config, &request).unwrap();
        let within = locate_in(&mut kept_map, &mut kept, &config, &request).unwrap();
        assert_eq!(timeless(alone), timeless(within));
    }
}

#[test]
fn no_more_sizes_are_held_than_were_asked_for() {
    let mut recent = Recent::new(2);
    for voxel in [0.1, 0.2, 0.1, 0.3] {
        *recent.at(voxel, || 0) += 1;
    }
    // 0.2 was used longest ago.
    assert_eq!(recent.held, [(0.1, 2), (0.3, 1)]);
    assert_eq!(*recent.at(0.2, || 7), 7);
    assert_eq!(recent.held, [(0.3, 1), (0.2, 7)]);
}
