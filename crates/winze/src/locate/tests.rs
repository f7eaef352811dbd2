use super::*;
use crate::base::base_of;
use crate::columns::Memory;
use crate::prepare::Frame;
use crate::prepare::prepare;
use crate::prepared::level_in;
use crate::refine::StopReason;
use crate::test_world::{cloud, drift};
use crate::verify::gain;
use crate::{icp, ndt};

/// A rough drift of 30 m, and the middle of it measured again, in a frame of its own.
fn pair(seed: u64) -> (Vec<[f64; 3]>, Cloud, Pose) {
    let query_from_map = Pose::from_rotation_vector([0.3, -0.2, 2.0], [40.0, -7.0, 3.0]);
    let part: Vec<[f64; 3]> = drift(60_000, 30.0, 0.4, 0.01, seed + 100)
        .iter()
        .filter(|p| p[0] > 8.0 && p[0] < 20.0)
        .map(|p| query_from_map.transform(*p))
        .collect();
    let map = drift(60_000, 30.0, 0.4, 0.01, seed);
    (map, cloud(&part), query_from_map.inverse())
}

/// The surface of a map's `cloud` at a `voxel` size that was asked for, metres.
fn prepare_map(cloud: &Cloud, voxel: f64, config: &Config) -> Surface<'static> {
    let base = base_of(cloud, voxel);
    let frame = Frame {
        origin: cloud.origin(),
        viewpoint: cloud.viewpoint(),
    };
    let points = (&base.points[..], &base.weights[..]);
    let Ok(surface) = level_in(points, frame, voxel, config, &Memory);
    surface.into_surface()
}

fn by(map: &Cloud, query: &Cloud, request: &Request<'_>) -> Outcome {
    locate_by(map, query, &Config::default(), request).unwrap()
}

#[test]
fn a_twin_makes_every_method_that_searches_ambiguous() {
    let (one, query, truth) = pair(1);
    let both: Vec<[f64; 3]> = one
        .iter()
        .copied()
        .chain(
            drift(60_000, 30.0, 0.4, 0.01, 7)
                .iter()
                .map(|p| [p[0], p[1] + 25.0, p[2]]),
        )
        .collect();
    let (one, both) = (cloud(&one), cloud(&both));
    for method in Method::ALL.into_iter().filter(|m| m.uses_features()) {
        let request = Request {
            method,
            ..Request::default()
        };
        let outcome = by(&one, &query, &request);
        assert_eq!(
            outcome.verdict,
            Verdict::Located,
            "{method:?}: {}",
            outcome.reason
        );
        let error = outcome.error(&truth, &query).unwrap();
        assert!(
            error.translation < 0.2 && error.rotation < 0.05,
            "{error:?}"
        );
        let outcome = by(&both, &query, &request);
        assert_eq!(
            outcome.verdict,
            Verdict::Ambiguous,
            "{method:?}: {}",
            outcome.reason
        );
        assert!(outcome.hypotheses.len() > 1);
    }
}

#[test]
fn a_bare_tube_is_never_located() {
    let bare = |n, seed| drift(n, 40.0, 0.0, 0.005, seed);
    let part: Vec<[f64; 3]> = bare(80_000, 2)
        .into_iter()
        .filter(|p| p[0] > 12.0 && p[0] < 27.0)
        .collect();
    let outcome = by(&cloud(&bare(80_000, 1)), &cloud(&part), &Request::default());
    assert_ne!(outcome.verdict, Verdict::Located, "{}", outcome.reason);
}

#[test]
fn what_is_known_beforehand_holds_for_the_answer_too() {
    let (map, query, truth) = pair(1);
    let map = cloud(&map);
    let at = truth.transform(query.centroid().unwrap());
    let mut config = Config::default();
    config.ransac.max_samples = 200_000;
    config.scale.tries = 1;
    let by = |map: &Cloud, query: &Cloud, request: &Request<'_>| {
        locate_by(map, query, &config, request).unwrap()
    };
    for method in [Method::Auto, Method::Fpfh, Method::NdtIcp] {
        let near = |centre| Request {
            method,
            initial: Some(truth),
            near: Some(Near {
                centre,
                radius: 3.0,
            }),
            ..Request::default()
        };
        assert_eq!(by(&map, &query, &near(at)).verdict, Verdict::Located);
        let elsewhere = by(&map, &query, &near([at[0] + 6.0, at[1], at[2]]));
        assert_ne!(elsewhere.verdict, Verdict::Located, "{method:?}");
        // The query's frame lies on its side.
        let upright = Request {
            gravity_aligned: true,
            near: None,
            ..near(at)
        };
        assert_ne!(by(&map, &query, &upright).verdict, Verdict::Located);
    }
    let nowhere = Request {
        near: Some(Near {
            centre: [1e5, 0.0, 0.0],
            radius: 4.0,
        }),
        ..Request::default()
    };
    assert!(matches!(
        locate_by(&map, &query, &Config::default(), &nowhere),
        Err(Error::EmptyRegion { .. })
    ));
}

#[test]
fn a_sparse_query_is_insufficient_and_no_fault_of_the_map() {
    let (map, _, _) = pair(1);
    let thin: Vec<[f64; 3]> = map.iter().step_by(60).copied().collect();
    let ten: Vec<[f64; 3]> = (0..10).map(|i| [2.0 * f64::from(i), 0.1, 0.0]).collect();
    let outcome = by(&cloud(&thin), &cloud(&ten), &Request::default());
    assert_eq!(outcome.verdict, Verdict::Insufficient, "{}", outcome.reason);
    let few = locate(&cloud(&ten), &cloud(&thin), &Config::default());
    assert_eq!(few.unwrap_err(), Error::EmptyMap { points: 10 });
}

#[test]
fn range_limits_that_leave_nothing_are_named() {
    let (map, query, _) = pair(1);
    let mut config = Config::default();
    config.prepare.max_range = 0.01;
    let outcome = locate(&cloud(&map), &query, &config).unwrap();
    assert_eq!(outcome.verdict, Verdict::Insufficient);
    assert!(outcome.reason.contains("range"), "{}", outcome.reason);
}

#[test]
fn other_rock_on_the_same_plan_is_refused_at_every_scale() {
    let (_, query, _) = pair(1);
    let other = drift(60_000, 30.0, 0.4, 0.01, 1)
        .iter()
        .map(|p| {
            [
                p[0],
                p[1],
                p[2] + 0.35 * (3.0 * p[0]).sin() * (2.0 * p[1]).cos(),
            ]
        })
        .collect::<Vec<_>>();
    let outcome = by(&cloud(&other), &query, &Request::default());
    assert_ne!(outcome.verdict, Verdict::Located, "{}", outcome.reason);
}

#[test]
fn the_bare_chain_ends_where_icp_does_and_the_guarded_one_no_worse() {
    let (map, query, truth) = pair(1);
    let map = cloud(&map);
    let start = truth.compose(&Pose::from_translation([0.2, -0.1, 0.1]));
    let mut config = Config::default();
    config.scale.voxel = 0.2;
    let mut run = |keep_better| {
        config.icp.keep_better = keep_better;
        config.ndt.keep_better = keep_better;
        let request = Request {
            method: Method::NdtIcp,
            initial: Some(start),
            ..Request::default()
        };
        locate_by(&map, &query, &config, &request).unwrap()
    };
    let (bare, guarded) = (run(false), run(true));
    let map = prepare_map(&map, 0.2, &config);
    let query = prepare(&query, &config.prepare, 0.2);
    let levels = ndt::levels(&map, &config.ndt);
    let by_ndt = ndt::align(&levels, &map, &query, &start, &config.ndt);
    let by_icp = icp::align(&map, &query, &by_ndt.map_from_query, &config.icp);
    assert_eq!(bare.map_from_query, Some(by_icp.map_from_query));
    assert_eq!(bare.hypotheses[0].stop, Some(by_icp.stop));
    let poses = (&by_ndt.map_from_query, &by_icp.map_from_query);
    let (gain, error) = gain(&map, &query, poses, &config.verify);
    let (pose, stop) = if gain > 2.0 * error {
        (by_icp.map_from_query, by_icp.stop)
    } else {
        (by_ndt.map_from_query, StopReason::NoBetter)
    };
    assert_eq!(guarded.map_from_query, Some(pose));
    assert_eq!(guarded.hypotheses[0].stop, Some(stop));
}

#[test]
fn a_bent_pose_that_leaves_the_region_is_no_answer() {
    let query_from_map = Pose::from_rotation_vector([0.1, -0.2, 2.0], [40.0, -7.0, 3.0]);
    // Seen far more often at one end, so that the centroid of its points is not that of its surface.
    let end = drift(300_000, 30.0, 0.4, 0.01, 10);
    let bent: Vec<[f64; 3]> = drift(90_000, 30.0, 0.4, 0.01, 9)
        .into_iter()
        .chain(end.into_iter().filter(|p| p[0] > 22.0))
        .map(|[x, y, z]| [x, y + 1.5 * (x / 30.0) * (x / 30.0), z])
        .map(|p| query_from_map.transform(p))
        .collect();
    let (map, query) = (cloud(&drift(90_000, 30.0, 0.4, 0.01, 1)), cloud(&bent));
    let near = |centre: [f64; 3]| Request {
        near: Some(Near {
            centre,
            radius: 2.0,
        }),
        ..Request::default()
    };
    let free = by(&map, &query, &Request::default());
    assert_eq!(free.verdict, Verdict::Located, "{}", free.reason);
    assert!(free.reason.contains("piece by piece"), "{}", free.reason);
    let at = free.covariance_at.unwrap();
    // Where the walls were laid along, and where the bend pushed the pose: rigid poses lie on the one side or the other.
    for way in [
        [1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0],
    ] {
        let off = |metres: f64| std::array::from_fn(|k| at[k] + metres * way[k]);
        // The place that is reported is the one that a region is asked for.
        let inside = by(&map, &query, &near(off(1.95)));
        assert_eq!(
            inside.verdict,
            Verdict::Located,
            "{way:?}: {}",
            inside.reason
        );
        let outside = by(&map, &query, &near(off(2.05)));
        let there = outside
            .covariance_at
            .map(|c| crate::vec3::distance(c, off(2.05)));
        assert!(
            outside.verdict != Verdict::Located || there.unwrap() <= 2.0,
            "{way:?}: {}",
            outside.reason
        );
    }
}

#[test]
fn what_no_pose_agrees_with_is_named() {
    let (map, query, _) = pair(1);
    let upright = Request {
        gravity_aligned: true,
        ..Request::default()
    };
    // Its frame lies on its side.
    let outcome = by(&cloud(&map), &query, &upright);
    assert_ne!(outcome.verdict, Verdict::Located);
    assert!(
        outcome.reason.contains("attitude asked for"),
        "{}",
        outcome.reason
    );
}
