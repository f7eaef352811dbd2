//! Tests of the verdict.

use super::*;
use crate::pose::Pose;
use crate::test_world::{drift, surface};
use crate::verify::{ask_relief, rank};

fn candidate(map: &Surface<'_>, query: &Surface<'_>, pose: Pose) -> Candidate {
    crate::verify::candidate(map, query, &pose, None, &VerifyConfig::default())
}

/// As if so much of the query overlapped and lay finely, and the rock had said so.
fn lying(at: Candidate, overlap: f64, fitness: f64, relief: Relief) -> Candidate {
    Candidate {
        fit: Fit {
            overlap,
            fitness,
            ..at.fit
        },
        relief: Some(relief),
        ..at
    }
}

fn said(asked: usize, confirmed: usize) -> Relief {
    Relief {
        asked,
        confirmed,
        ..Relief::default()
    }
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
fn rock_that_says_yes_a_little_too_often_does_not_overrule_a_better_shape() {
    let map = surface(&drift(90_000, 40.0, 0.4, 0.01, 1), 0.2);
    let query = surface(&drift(60_000, 20.0, 0.4, 0.01, 2), 0.2);
    let config = VerifyConfig::default();
    let here = candidate(&map, &query, Pose::identity());
    let at = |x: f64| Candidate {
        map_from_query: Pose::from_translation([x, 0.0, 0.0]),
        ..here
    };
    let lies = |x, fitness, confirmed| lying(at(x), 0.8, fitness, said(140, confirmed));
    let judged = |best: Candidate, other: Candidate| judge(&[best, other], &map, &query, &config);
    let verdict = |best: Candidate, other: Candidate| judged(best, other).verdict;
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
    assert_eq!(
        verdict(lies(0.0, 0.5, 60), lies(15.0, 0.1, 20)),
        Verdict::Ambiguous,
        "not confirmed, and as fine elsewhere"
    );
    // And a rival need not be believed by itself to be one: 56 of 140 have half of what 66 exceed chance by.
    assert_eq!(
        verdict(lies(0.0, 0.5, 66), lies(7.5, 0.4, 56)),
        Verdict::Ambiguous
    );
    // One that is, is one even where far less of it can be asked: 16 of 20 are 4.4 standard deviations.
    let partly_mapped = |confirmed| lying(at(7.5), 0.8, 0.4, said(20, confirmed));
    let both = judged(lies(0.0, 0.5, 120), partly_mapped(16));
    assert_eq!(both.verdict, Verdict::Ambiguous);
    assert!(
        both.reason.contains("16 of 20 do, 7.5 m and 0° away"),
        "{}",
        both.reason
    );
    assert_eq!(
        verdict(lies(0.0, 0.5, 120), partly_mapped(14)),
        Verdict::Located
    );
    // Also of one that is not confirmed itself, which a method that answers with its first pose may come with.
    let other = judged(lies(0.0, 0.9, 40), partly_mapped(16));
    assert_eq!(other.verdict, Verdict::Ambiguous, "{}", other.reason);
}

#[test]
fn the_rock_of_one_end_does_not_place_a_bent_query() {
    let map = surface(&drift(90_000, 40.0, 0.4, 0.01, 1), 0.2);
    let query = surface(&drift(60_000, 20.0, 0.4, 0.01, 2), 0.2);
    let config = VerifyConfig::default();
    let here = candidate(&map, &query, Pose::identity());
    let lies = |fitness, piecewise| {
        let relief = Relief {
            piecewise,
            ..said(70, 45)
        };
        lying(here, 0.7, fitness, relief)
    };
    let judged = |c: Candidate| judge(&[c], &map, &query, &config);
    assert_eq!(judged(lies(0.5, false)).verdict, Verdict::Located);
    let bent = judged(lies(0.3, false));
    assert_eq!(bent.verdict, Verdict::NotFound);
    assert!(bent.reason.contains("no one pose"), "{}", bent.reason);
    // The pose of its pieces lies loosely as a whole, and is right.
    assert_eq!(judged(lies(0.3, true)).verdict, Verdict::Located);
    // Bent where it lies, and by so much that the rest may be elsewhere.
    let beyond = |metres| {
        let mut c = lies(0.5, true);
        let relief = c.relief.as_mut().unwrap();
        (relief.beyond, relief.followed) = (Some(metres), Some(0.7));
        judged(c)
    };
    assert_eq!(beyond(0.2).verdict, Verdict::Located);
    let elsewhere = beyond(0.5);
    assert_eq!(elsewhere.verdict, Verdict::NotFound);
    assert!(
        elsewhere.reason.contains("0.50 m off"),
        "{}",
        elsewhere.reason
    );
    // A pose that is not refined is held against its refinement.
    let refined = lies(0.5, false).fit;
    let rough = judge_against(&[lies(0.3, false)], Some(refined), &map, &query, &config);
    assert_eq!(rough.verdict, Verdict::Located, "{}", rough.reason);
}
