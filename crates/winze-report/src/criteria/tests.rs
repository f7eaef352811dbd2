//! Tests of what a verdict rests on, as it is told.

use super::*;
use winze::Pose;
use winze::relief::Relief;

fn hypothesis(overlap: f64, score: f64, confirmed: usize, asked: usize) -> RankedHypothesis {
    RankedHypothesis {
        map_from_query: Pose::identity(),
        score,
        median_point_to_plane: Some(0.012),
        inlier_fraction: 0.9,
        overlap,
        relief: Some(Relief {
            asked,
            confirmed,
            ..Relief::default()
        }),
        rival: false,
        stop: None,
    }
}

fn outcome(verdict: Verdict, hypotheses: Vec<RankedHypothesis>) -> Outcome {
    let stage = winze::outcome::Stage {
        name: "prepare query".into(),
        seconds: 0.1,
        count_in: 9000,
        count_out: 3000,
    };
    Outcome {
        verdict,
        reason: String::new(),
        confidence: None,
        map_from_query: hypotheses.first().map(|h| h.map_from_query),
        covariance: None,
        covariance_at: None,
        unobservable: None,
        information: None,
        hypotheses,
        inlier_fraction: None,
        inlier_rmse: None,
        inlier_distance: 0.5,
        inlier_reference: "map as read",
        voxel: Some(0.2),
        stages: vec![stage],
        seconds: 1.0,
        map_seconds: 0.5,
        method: "auto",
        seed: 0,
        map_points: 10_000,
        query_points: 9000,
    }
}

fn rows(o: &Outcome) -> Vec<Criterion> {
    criteria(o, &VerifyConfig::default(), None)
}

fn row<'a>(rows: &'a [Criterion], asks: &str) -> &'a Criterion {
    rows.iter().find(|r| r.asks == asks).unwrap()
}

fn deciding(rows: &[Criterion]) -> Vec<&str> {
    rows.iter().filter(|r| r.decides).map(|r| r.asks).collect()
}

#[test]
fn a_located_query_meets_all() {
    let best = hypothesis(0.68, 0.55, 60, 88);
    let o = outcome(Verdict::Located, vec![best, hypothesis(0.6, 0.2, 20, 59)]);
    let rows = rows(&o);
    assert!(rows.iter().all(|r| r.met == Some(true)), "{rows:#?}");
    assert!(deciding(&rows).is_empty());
    // 88 patches: 29.3 by chance, give or take 4.42.
    assert!(
        row(&rows, ROCK)
            .found
            .contains("60 of 88 patches agree, 6.9 σ more")
    );
    // (20 - 59/3) / (60 - 88/3)
    let other = &row(&rows, OTHER).found;
    assert!(
        other.contains("20 of 59 patches: 1\u{a0}% of") && other.ends_with("chance, 0.1 σ"),
        "{other}"
    );
    assert!(row(&rows, OVERLAP).wanted.starts_with("at least 10\u{a0}%"));
}

#[test]
fn what_decides_is_marked() {
    let best = hypothesis(0.68, 0.55, 60, 88);
    let rival = RankedHypothesis {
        rival: true,
        ..hypothesis(0.67, 0.54, 55, 88)
    };
    let o = outcome(Verdict::Ambiguous, vec![best, rival]);
    assert_eq!(deciding(&rows(&o)), [RIVALS]);
    assert_eq!(row(&rows(&o), OTHER).met, Some(false));
    // (55 - 88/3) / (60 - 88/3)
    let told = rows(&o);
    let why = row(&told, RIVALS);
    assert_eq!(
        (why.found.as_str(), why.wanted.as_str()),
        (
            "1 of 1 cannot: place 2 has 84\u{a0}% of the first's excess over chance",
            "below 40\u{a0}%"
        )
    );

    let elsewhere = outcome(Verdict::NotFound, vec![hypothesis(0.8, 0.6, 20, 60)]);
    assert_eq!(deciding(&rows(&elsewhere)), [ROCK]);
    let off = outcome(Verdict::NotFound, vec![hypothesis(0.3, 0.1, 20, 60)]);
    assert_eq!(deciding(&rows(&off)), [OVERLAP]);
    assert!(
        row(&rows(&off), OVERLAP)
            .wanted
            .starts_with("at least 50\u{a0}%")
    );
    let loose = outcome(Verdict::NotFound, vec![hypothesis(0.8, 0.3, 60, 88)]);
    assert_eq!(deciding(&rows(&loose)), [FINE]);

    let few = outcome(Verdict::Insufficient, vec![hypothesis(0.8, 0.6, 9, 10)]);
    assert_eq!(deciding(&rows(&few)), [PATCHES]);
    assert_eq!(row(&rows(&few), ROCK).met, None);
    let none = outcome(Verdict::Insufficient, Vec::new());
    assert_eq!(deciding(&rows(&none)), [POINTS]);
}

#[test]
fn an_open_direction_is_named() {
    let mut o = outcome(Verdict::Degenerate, vec![hypothesis(0.9, 0.9, 25, 60)]);
    let mut matrix = [[0.0; 6]; 6];
    let diagonal = [0.0, 50.0, 50.0, 400.0, 400.0, 400.0];
    for (i, v) in diagonal.into_iter().enumerate() {
        matrix[i][i] = v;
    }
    o.information = Some(winze::icp::Information {
        matrix,
        about: [0.0; 3],
        moments: [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 4.0]],
        pairs: 100,
        residual_variance: 1e-4,
    });
    let rows = rows(&o);
    assert_eq!(deciding(&rows), [WEAKEST]);
    let found = &row(&rows, WEAKEST).found;
    assert!(
        found.contains("sliding along (1.00, 0.00, 0.00)"),
        "{found}"
    );
}

#[test]
fn a_bent_query_is_told_of() {
    let mut best = hypothesis(0.9, 0.3, 60, 88);
    if let Some(r) = &mut best.relief {
        r.piecewise = true;
        r.bend = Some(0.21);
        r.beyond = Some(0.4);
        r.followed = Some(0.7);
    }
    let rows = rows(&outcome(Verdict::NotFound, vec![best]));
    assert_eq!(deciding(&rows), [BEND]);
    assert_eq!(row(&rows, FINE).met, None);
}

#[test]
fn a_bend_is_not_asked_where_the_rock_does_not_confirm_the_place() {
    let mut best = hypothesis(0.8, 0.6, 20, 60);
    if let Some(r) = &mut best.relief {
        r.beyond = Some(0.4);
        r.followed = Some(0.7);
    }
    let o = outcome(Verdict::NotFound, vec![best]);
    let told = rows(&o);
    assert_eq!(deciding(&told), [ROCK]);
    assert_eq!(row(&told, BEND).met, None);
    assert!(row(&told, BEND).wanted.contains("does not confirm"));
    assert!(meaning(&o, &VerifyConfig::default()).contains("its rock is not the same"));
    // What was not followed was not asked either.
    let mut best = hypothesis(0.8, 0.6, 60, 88);
    if let Some(r) = &mut best.relief {
        r.beyond = Some(0.4);
    }
    let told = rows(&outcome(Verdict::Located, vec![best]));
    assert_eq!(row(&told, BEND).met, None);
}

#[test]
fn other_places_are_judged_as_the_verdict_does() {
    let best = hypothesis(0.68, 0.55, 60, 88);
    // The same place, further along what is open: no rival, however much its rock says.
    let slid = hypothesis(0.67, 0.54, 55, 88);
    let mut o = outcome(Verdict::Degenerate, vec![best, slid]);
    o.unobservable = Some(vec![open(DirectionKind::Translation, 1e-4)]);
    let told = rows(&o);
    assert_eq!(row(&told, OTHER).met, Some(true));
    assert!(row(&told, OTHER).found.contains("further along"));
    assert_eq!(row(&told, OTHER).gauge, None);
    assert_eq!(row(&told, RIVALS).found, "the one other can");

    // Too little of the query lies there.
    let corner = hypothesis(0.05, 0.04, 55, 88);
    let told = rows(&outcome(Verdict::Located, vec![best, corner]));
    assert_eq!(row(&told, OTHER).met, Some(true));
    assert!(
        row(&told, OTHER)
            .found
            .contains("only 5\u{a0}% of the query")
    );

    // A rival by its shape is none by its rock: met, though another place decides.
    let twin = RankedHypothesis {
        rival: true,
        ..hypothesis(0.66, 0.54, 2, 5)
    };
    let weak = hypothesis(0.6, 0.2, 20, 59);
    let told = rows(&outcome(Verdict::Ambiguous, vec![best, twin, weak]));
    assert_eq!(row(&told, OTHER).met, Some(true));
    assert_eq!(deciding(&told), [RIVALS]);
    let why = row(&told, RIVALS);
    assert!(
        why.found
            .starts_with("1 of 2 cannot: place 2 fits as finely: 97\u{a0}% of"),
        "{}",
        why.found
    );
    assert_eq!(why.wanted, "below 50\u{a0}%, or above 1.6 times");

    // By its own significance, with less than the share of the excess.
    let own = RankedHypothesis {
        rival: true,
        ..hypothesis(0.6, 0.5, 75, 150)
    };
    let many = hypothesis(0.68, 0.55, 180, 200);
    let told = rows(&outcome(Verdict::Ambiguous, vec![many, own]));
    let other = row(&told, OTHER);
    assert_eq!(other.met, Some(false));
    assert_eq!(other.gauge.map(|g| g.threshold), Some(4.0));
    assert!(row(&told, RIVALS).found.ends_with("4.3 σ on its own"));

    // Finer by its shape where the rock is in doubt: 30 of 54 patches are 3.5 σ.
    let doubtful = hypothesis(0.68, 0.5, 30, 54);
    let finer = RankedHypothesis {
        rival: true,
        ..hypothesis(0.68, 0.6, 19, 54)
    };
    let told = rows(&outcome(Verdict::Ambiguous, vec![doubtful, finer]));
    assert!(
        row(&told, RIVALS)
            .found
            .contains("place 2 has 60\u{a0}% of the query lie finely, the first 50\u{a0}%")
    );

    // Not asked where the rock does not confirm the best.
    let unsure = hypothesis(0.68, 0.55, 20, 60);
    let told = rows(&outcome(Verdict::NotFound, vec![unsure, slid]));
    assert_eq!(row(&told, OTHER).met, None);
}

fn open(kind: DirectionKind, information: f64) -> Unobservable {
    Unobservable {
        kind,
        direction: [1.0, 0.0, 0.0],
        information,
    }
}

#[test]
fn the_direction_that_the_verdict_names_is_told_of() {
    let mut o = outcome(Verdict::Degenerate, vec![hypothesis(0.9, 0.9, 25, 60)]);
    o.unobservable = Some(vec![
        open(DirectionKind::Translation, 0.004),
        open(DirectionKind::Rotation, 0.001),
    ]);
    let rows = rows(&o);
    assert_eq!(deciding(&rows), [WEAKEST]);
    let found = &row(&rows, WEAKEST).found;
    assert!(
        found.contains("sliding along (1.00") && found.contains("0.40\u{a0}%"),
        "{found}"
    );
    assert!(found.ends_with("and 1 more fall short"), "{found}");
}

#[test]
fn points_with_a_normal_count_and_something_always_decides() {
    let verify = VerifyConfig::default();
    let few = outcome(Verdict::Insufficient, Vec::new());
    let told = criteria(&few, &verify, Some(42));
    assert_eq!(deciding(&told), [POINTS]);
    assert_eq!(
        row(&told, POINTS).found,
        "42 points left with a surface normal, 0.20 m apart"
    );
    assert_eq!(row(&told, POINTS).gauge.map(|g| g.value), Some(42.0));
    let told = criteria(&outcome(Verdict::NotFound, Vec::new()), &verify, Some(1000));
    assert_eq!(deciding(&told), [ANY]);
    assert_eq!(row(&told, POINTS).met, Some(true));
}

#[test]
fn just_short_does_not_read_like_enough() {
    let short = rows(&outcome(
        Verdict::NotFound,
        vec![hypothesis(0.496, 0.4, 20, 60)],
    ));
    let overlap = row(&short, OVERLAP);
    assert!(overlap.found.starts_with("49.6\u{a0}%"));
    assert!(overlap.wanted.starts_with("at least 50.0\u{a0}%"));
    // In steps of 0.05 σ.
    for confirmed in 0..2000 {
        let best = hypothesis(0.8, 0.6, confirmed, 2000);
        let rows = rows(&outcome(Verdict::NotFound, vec![best]));
        let rock = row(&rows, ROCK);
        if rock.met == Some(false) {
            assert!(!rock.found.contains(" 3.0 σ"), "{}", rock.found);
        }
    }
    assert_eq!(digits_apart(2.96, &[3.0], 1), 2);
    assert_eq!(digits_apart(3.0, &[3.0], 1), 1);
    assert_eq!(digits_apart(3.96, &[3.0, 4.0], 1), 2);
    assert_eq!(digits_apart(2.999_6, &[3.0], 1), 4);
}
