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
