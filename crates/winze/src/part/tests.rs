use super::*;
use crate::Method;
use crate::cloud::Cloud;
use crate::locate::{Near, Request, locate_in, locate_traced};
use crate::outcome::Verdict;
use crate::test_world::{cloud, drift};

/// A rough drift of 40 m, and a part of it measured again in a frame of its own.
fn scene() -> (Cloud, Cloud, Pose) {
    let query_from_map = Pose::from_rotation_vector([0.3, -0.2, 2.0], [40.0, -7.0, 3.0]);
    let again = drift(30_000, 40.0, 0.4, 0.01, 101);
    let part = again.iter().filter(|p| p[0] > 4.0 && p[0] < 12.0);
    let part: Vec<[f64; 3]> = part.map(|p| query_from_map.transform(*p)).collect();
    let map = cloud(&drift(30_000, 40.0, 0.4, 0.01, 1));
    (map, cloud(&part), query_from_map.inverse())
}

fn quick() -> Config {
    let mut config = Config::default();
    config.ransac.max_samples = 4_000;
    config.ransac.min_samples = 2_000;
    config
}

/// Everything but the times.
fn timeless(mut outcome: Outcome) -> String {
    (outcome.seconds, outcome.map_seconds) = (0.0, 0.0);
    for s in &mut outcome.stages {
        s.seconds = 0.0;
    }
    format!("{outcome:?}")
}

/// The answer on a map, what a part of it is, and the answer on that.
fn again(
    map: &Cloud,
    query: &Cloud,
    config: &Config,
    request: &Request<'_>,
    reach: Option<u32>,
) -> (Outcome, MapPart, Result<Outcome>) {
    let mut kept = (KeptMap::new(map), KeptQuery::new(query));
    let (outcome, trail) = locate_traced(&mut kept.0, &mut kept.1, config, request).unwrap();
    let traced = (&trail, &outcome);
    let part = MapPart::cut(&mut kept.0, &mut kept.1, config, traced, reach).unwrap();
    let replayed = locate_in(
        &mut KeptMap::part(&part),
        &mut KeptQuery::new(query),
        config,
        request,
    );
    (outcome, part, replayed)
}

#[test]
fn a_part_gives_the_answer_of_the_whole_for_every_method() {
    let (map, query, truth) = scene();
    // Of a map this small all of it is weighed, unless that is ruled out.
    let near = Near {
        centre: truth.transform(query.centroid().unwrap()),
        radius: 3.0,
    };
    for method in Method::ALL {
        let request = Request {
            method,
            initial: (!method.uses_features()).then_some(truth),
            near: Some(near),
            ..Request::default()
        };
        for reach in [Some(2), None] {
            let (outcome, part, replayed) = again(&map, &query, &quick(), &request, reach);
            assert_eq!(
                outcome.verdict,
                Verdict::Located,
                "{method}: {}",
                outcome.reason
            );
            assert_eq!(timeless(outcome), timeless(replayed.unwrap()), "{method}");
            for level in &part.levels {
                assert_eq!(level.points.len() < level.of, reach.is_some(), "{method}");
                assert_eq!(level.points.len(), level.normals.len());
            }
            // Far fewer than the map has, and no more than the query.
            assert!(part.reference.points.len() <= query.len());
            assert_eq!(part.reference.of, map.len());
        }
    }
}

#[test]
fn what_has_no_pose_has_a_part_too() {
    let (map, query, _) = scene();
    let few = query.select(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    let one = query.select(&[0]);
    let elsewhere = Request {
        near: Some(Near {
            centre: [35.0, 0.0, 0.0],
            radius: 3.0,
        }),
        gravity_aligned: true,
        ..Request::default()
    };
    let plain = Request::default();
    for (query, request) in [(&few, &plain), (&one, &plain), (&query, &elsewhere)] {
        let (outcome, _, replayed) = again(&map, query, &quick(), request, Some(2));
        assert_ne!(outcome.verdict, Verdict::Located);
        assert_eq!(timeless(outcome), timeless(replayed.unwrap()));
    }
    // A voxel size that was asked for, at which the map is too small to compare with.
    let mut coarse = quick();
    coarse.scale.voxel = 6.0;
    coarse.verify.min_points = 1;
    let (outcome, part, replayed) = again(&map, &query, &coarse, &plain, Some(2));
    assert!(
        outcome.reason.contains("too few to compare with"),
        "{}",
        outcome.reason
    );
    assert_eq!((part.measure, part.looks.len()), (None, 0));
    assert_eq!(timeless(outcome), timeless(replayed.unwrap()));
}

#[test]
fn what_was_not_looked_at_is_an_error() {
    let (map, query, _) = scene();
    let (_, mut part, _) = again(&map, &query, &quick(), &Request::default(), Some(2));
    let ask = |part: &MapPart| {
        let (mut map, mut query) = (KeptMap::part(part), KeptQuery::new(&query));
        locate_in(&mut map, &mut query, &quick(), &Request::default())
    };
    let looks = std::mem::take(&mut part.looks);
    let error = ask(&part).unwrap_err().to_string();
    assert!(error.contains("give the whole map"), "{error}");
    (part.looks, part.levels) = (looks, Vec::new());
    assert!(matches!(ask(&part), Err(Error::Map(_))));
}

#[test]
fn too_small_a_part_answers_otherwise() {
    let (map, query, _) = scene();
    let (outcome, mut part, _) = again(&map, &query, &quick(), &Request::default(), Some(2));
    for level in &mut part.levels {
        let half = level.points.len() / 2;
        level.points.truncate(half);
        level.normals.truncate(half);
    }
    let (mut map, mut query) = (KeptMap::part(&part), KeptQuery::new(&query));
    let replayed = locate_in(&mut map, &mut query, &quick(), &Request::default()).unwrap();
    assert_ne!(timeless(outcome), timeless(replayed));
}

#[test]
fn a_pose_that_slides_has_a_part_as_long_as_its_way() {
    // A bare tube of 60 m, and 6 m of it.
    let (map, query) = (
        cloud(&drift(40_000, 60.0, 0.0, 0.01, 1)),
        cloud(&drift(6_000, 6.0, 0.0, 0.01, 2)),
    );
    let request = Request {
        method: Method::NdtIcp,
        initial: Some(Pose::from_translation([27.0, 0.0, 0.0])),
        ..Request::default()
    };
    let (outcome, _, replayed) = again(&map, &query, &quick(), &request, Some(2));
    assert_eq!(outcome.verdict, Verdict::Degenerate, "{}", outcome.reason);
    let covariance = outcome.covariance.unwrap();
    assert!(covariance[0][0] > 25.0, "it slid metres: {covariance:?}");
    assert_eq!(timeless(outcome), timeless(replayed.unwrap()));
}
