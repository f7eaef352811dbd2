//! Tests of evidence and verdict.

use super::*;
use crate::judge::judge;
use crate::outcome::Verdict;
use crate::test_world::{drift, surface};

#[test]
fn the_right_place_fits_and_the_wrong_one_does_not() {
    let map = surface(&drift(90_000, 40.0, 0.4, 0.01, 1), 0.2);
    let query = surface(&drift(60_000, 20.0, 0.4, 0.01, 2), 0.2);
    let config = VerifyConfig::default();
    let at = |x| candidate(&map, &query, &Pose::from_translation(x), None, &config);
    let right = at([0.0; 3]);
    let wrong = at([15.0, 0.0, 0.0]);
    assert!(
        right.fit.overlap > 0.95 && right.fit.fitness > 0.7,
        "{right:?}"
    );
    // The paper's metric hardly sees the difference, the fine residual does.
    assert!(wrong.fit.inlier_fraction > 0.9, "{wrong:?}");
    assert!(
        wrong.fit.median_point_to_plane > 2.0 * right.fit.median_point_to_plane,
        "{wrong:?}"
    );
    let ranked = rank(vec![wrong, right], &query, &config, 0.2);
    assert_eq!(ranked[0], right);
    let verdict = |ranked: &[Candidate]| {
        let mut ranked = ranked.to_vec();
        ask_relief(&mut ranked, &map, &query, &config, None);
        judge(&ranked, &map, &query, &config).verdict
    };
    assert_eq!(verdict(&ranked), Verdict::Located);
    assert_eq!(verdict(&[]), Verdict::NotFound);
    assert_eq!(
        judge(&ranked, &map, &query, &config).verdict,
        Verdict::Insufficient,
        "the shape alone is not believed"
    );
    assert_eq!(
        verdict(&[wrong]),
        Verdict::NotFound,
        "alone it must not pass either"
    );
    let out = at([30.0, 0.0, 0.0]);
    assert_eq!(verdict(&[out]), Verdict::NotFound);
    let careless = VerifyConfig {
        min_overlap: 0.0,
        ..config.clone()
    };
    let nowhere = at([900.0, 0.0, 0.0]);
    assert_eq!(
        judge(&[nowhere], &map, &query, &careless).verdict,
        Verdict::NotFound
    );
    let few = surface(&drift(60, 20.0, 0.4, 0.01, 2), 0.2);
    assert_eq!(
        judge(&[right], &map, &few, &config).verdict,
        Verdict::Insufficient
    );
}

#[test]
fn merging_keeps_the_fittest_of_each_place() {
    let s = surface(&drift(20_000, 10.0, 0.3, 0.0, 1), 0.2);
    let at = |x: f64, fitness: f64| Candidate {
        map_from_query: Pose::from_translation([x, 0.0, 0.0]),
        fit: Fit {
            overlap: 1.0,
            fitness,
            median_point_to_plane: 0.01,
            bounded_residual: 0.01,
            inlier_fraction: 1.0,
        },
        relief: None,
        stop: None,
    };
    let ranked = rank(
        vec![at(0.0, 0.5), at(0.1, 0.6), at(5.0, 0.4), at(-0.1, 0.3)],
        &s,
        &VerifyConfig::default(),
        0.2,
    );
    assert_eq!(
        ranked.iter().map(|c| c.fit.fitness).collect::<Vec<_>>(),
        [0.6, 0.4]
    );
}

/// Points of the rough drift from 0 to 45 m, bent to an arc that leaves the walls by up to three metres.
fn arc() -> Vec<[f64; 3]> {
    drift(120_000, 45.0, 0.3, 0.01, 2)
        .into_iter()
        .map(|[x, y, z]| [x, y + 3.0 * ((x - 10.0) / 34.0) * ((x - 10.0) / 34.0), z])
        .collect()
}

/// The verdict on the bent query in a map of so many metres, begun where one end of it lies, and what became of the pose.
fn bent(length: f64, config: &VerifyConfig) -> (Verdict, Candidate) {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "small"
    )]
    let points = (3_200.0 * length) as usize;
    let map = surface(&drift(points, length, 0.3, 0.01, 1), 0.15);
    let query = surface(&arc(), 0.15);
    let icp = IcpConfig {
        metric: crate::config::IcpMetric::PointToPlane,
        ..IcpConfig::default()
    };
    let mut pool = vec![candidate(&map, &query, &Pose::identity(), None, config)];
    by_evidence(&mut pool, &map, &query, config, &icp);
    (judge(&pool, &map, &query, config).verdict, pool[0])
}

#[test]
fn a_bent_query_is_answered_by_the_pose_of_its_pieces() {
    let config = VerifyConfig {
        piece_size: crate::config::Length::Metres(6.0),
        ..VerifyConfig::default()
    };
    let (verdict, found) = bent(50.0, &config);
    assert_eq!(verdict, Verdict::Located);
    let relief = found.relief.unwrap();
    assert!(
        relief.piecewise && relief.followed.unwrap() > 0.9 && relief.beyond.unwrap() < 0.1,
        "{relief:?}"
    );
    let straight = drift(120_000, 45.0, 0.3, 0.01, 2);
    let best = crate::fit::fit_rigid(arc().into_iter().zip(straight).map(|(b, s)| (b, s, 1.0)));
    let off = found
        .map_from_query
        .distance(&best.unwrap(), [22.0, 0.5, 0.0]);
    assert!(off.translation < 0.08 && off.rotation < 0.01, "{off:?}");

    // Of which half is not in the map: where the rest lies no one knows, and the half that is does not say.
    let (verdict, half) = bent(22.0, &config);
    let relief = half.relief.unwrap();
    assert!(relief.followed.is_some_and(|f| f < 0.6), "{relief:?}");
    assert!(
        !relief.piecewise && relief.beyond.unwrap() > 0.4,
        "{relief:?}"
    );
    assert_eq!(half.map_from_query, Pose::identity(), "{verdict}");
    let careless = VerifyConfig {
        min_followed: 0.2,
        ..config
    };
    let (verdict, found) = bent(22.0, &careless);
    assert!(found.relief.unwrap().piecewise);
    assert_eq!(verdict, Verdict::NotFound, "the rest may be anywhere");
}
