//! Tests of evidence and verdict.

use super::*;
use crate::config::VerifyConfig;
use crate::judge::judge;
use crate::outcome::Verdict;
use crate::test_world::{drift, surface};

fn candidate(map: &Surface<'_>, query: &Surface<'_>, pose: Pose) -> Candidate {
    Candidate {
        map_from_query: pose,
        fit: fit(map, query, &pose, &VerifyConfig::default()),
        relief: None,
        stop: None,
    }
}

#[test]
fn the_right_place_fits_and_the_wrong_one_does_not() {
    let map = surface(&drift(90_000, 40.0, 0.4, 0.01, 1), 0.2);
    let query = surface(&drift(60_000, 20.0, 0.4, 0.01, 2), 0.2);
    let config = VerifyConfig::default();
    let right = candidate(&map, &query, Pose::identity());
    let wrong = candidate(&map, &query, Pose::from_translation([15.0, 0.0, 0.0]));
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
    let out = candidate(&map, &query, Pose::from_translation([30.0, 0.0, 0.0]));
    assert_eq!(verdict(&[out]), Verdict::NotFound);
    let careless = VerifyConfig {
        min_overlap: 0.0,
        ..config.clone()
    };
    let nowhere = candidate(&map, &query, Pose::from_translation([900.0, 0.0, 0.0]));
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
fn a_twin_makes_it_ambiguous_and_a_bare_tube_degenerate() {
    let config = VerifyConfig::default();
    // Two equal drifts, 20 m apart.
    let one = drift(60_000, 20.0, 0.4, 0.01, 1);
    let both: Vec<[f64; 3]> = one
        .iter()
        .copied()
        .chain(
            drift(60_000, 20.0, 0.4, 0.01, 3)
                .iter()
                .map(|p| [p[0], p[1] + 20.0, p[2]]),
        )
        .collect();
    let map = surface(&both, 0.2);
    let query = surface(&drift(60_000, 20.0, 0.4, 0.01, 2), 0.2);
    let twins = vec![
        candidate(&map, &query, Pose::identity()),
        candidate(&map, &query, Pose::from_translation([0.0, 20.0, 0.0])),
    ];
    let mut twins = rank(twins, &query, &config, 0.2);
    ask_relief(&mut twins, &map, &query, &config, None);
    assert!(twins.iter().all(|c| confirmed(c, &config)), "{twins:?}");
    let judged = judge(&twins, &map, &query, &config);
    assert_eq!(judged.verdict, Verdict::Ambiguous, "{}", judged.reason);
    let bare = surface(&drift(90_000, 40.0, 0.0, 0.005, 1), 0.2);
    let part: Vec<[f64; 3]> = drift(90_000, 40.0, 0.0, 0.005, 2)
        .into_iter()
        .filter(|p| p[0] > 10.0 && p[0] < 25.0)
        .collect();
    let query = surface(&part, 0.2);
    let mut found = [candidate(&bare, &query, Pose::identity())];
    ask_relief(&mut found, &bare, &query, &config, None);
    assert!(!confirmed(&found[0], &config), "{found:?}");
    let judged = judge(&found, &bare, &query, &config);
    assert_eq!(judged.verdict, Verdict::Degenerate, "{}", judged.reason);
    assert!(judged.unobservable.unwrap()[0].direction[0].abs() > 0.99);
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

#[test]
fn rock_that_says_yes_a_little_too_often_does_not_overrule_a_better_shape() {
    let map = surface(&drift(90_000, 40.0, 0.4, 0.01, 1), 0.2);
    let query = surface(&drift(60_000, 20.0, 0.4, 0.01, 2), 0.2);
    let config = VerifyConfig::default();
    let lies = |x: f64, fitness: f64, confirmed: usize| Candidate {
        fit: Fit {
            fitness,
            overlap: 0.8,
            ..candidate(&map, &query, Pose::identity()).fit
        },
        relief: Some(Relief {
            asked: 140,
            confirmed,
            ..Relief::default()
        }),
        ..candidate(&map, &query, Pose::from_translation([x, 0.0, 0.0]))
    };
    let verdict =
        |best: Candidate, other: Candidate| judge(&[best, other], &map, &query, &config).verdict;
    // 66 of 140 is 3.5 standard deviations above chance, 120 is 13; 60 is 2.4.
    assert_eq!(
        verdict(lies(0.0, 0.4, 66), lies(7.5, 0.5, 20)),
        Verdict::Ambiguous
    );
    assert_eq!(
        verdict(lies(0.0, 0.5, 66), lies(7.5, 0.4, 20)),
        Verdict::Located
    );
    assert_eq!(
        verdict(lies(0.0, 0.4, 120), lies(7.5, 0.5, 20)),
        Verdict::Located
    );
    assert_ne!(
        verdict(lies(0.0, 0.5, 60), lies(7.5, 0.4, 20)),
        Verdict::Located
    );
    // And a rival need not be believed by itself to be one: 56 of 140 have half of what 66 exceed chance by.
    assert_eq!(
        verdict(lies(0.0, 0.5, 66), lies(7.5, 0.4, 56)),
        Verdict::Ambiguous
    );
    // One that is, is one even where far less of it can be asked: 16 of 20 are 4.4 standard deviations.
    let partly_mapped = |confirmed| Candidate {
        relief: Some(Relief {
            asked: 20,
            confirmed,
            ..Relief::default()
        }),
        ..lies(7.5, 0.4, 20)
    };
    assert_eq!(
        verdict(lies(0.0, 0.5, 120), partly_mapped(16)),
        Verdict::Ambiguous
    );
    assert_eq!(
        verdict(lies(0.0, 0.5, 120), partly_mapped(12)),
        Verdict::Located
    );
}
