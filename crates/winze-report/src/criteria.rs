//! Why the verdict is what it is: each thing it rests on, as a number beside its threshold.
//!
//! The rules are those of [`winze::judge`]; what is told here is what they looked at, in the order that a person asks.

use winze::config::VerifyConfig;
use winze::degeneracy::{self, DirectionKind, Unobservable};
use winze::outcome::RankedHypothesis;
use winze::relief::Relief;
use winze::{Outcome, Verdict};

/// One thing that a verdict rests on.
#[derive(Debug, Clone, PartialEq)]
pub struct Criterion {
    /// What is asked, in plain words.
    pub asks: &'static str,
    /// What was found, with its unit.
    pub found: String,
    /// What is wanted, with its unit.
    pub wanted: String,
    /// Whether it was met; `None` where it was not asked.
    pub met: Option<bool>,
    /// It alone made the verdict another one than `located`.
    pub decides: bool,
    /// Both numbers, to be drawn; `None` where there is nothing to draw.
    pub gauge: Option<Gauge>,
}

/// A number beside its threshold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gauge {
    /// The number.
    pub value: f64,
    /// Its threshold.
    pub threshold: f64,
    /// Where the scale ends.
    pub end: f64,
}

/// What the verdict of `outcome` rests on; `config` is what it was verified by.
#[must_use]
pub fn criteria(outcome: &Outcome, config: &VerifyConfig) -> Vec<Criterion> {
    let mut rows = vec![points(outcome, config)];
    if let Some(best) = outcome.hypotheses.first() {
        let sure = is_confirmed(best, config);
        rows.push(overlap(best, config, sure));
        rows.push(fine(best, config, sure));
        rows.push(asked(best, config));
        rows.push(same_rock(best, config));
        rows.push(strongest_other(outcome, config));
        rows.push(rivals(outcome));
        rows.extend(bend(best, config));
        rows.extend(weakest_direction(outcome, config, sure));
    }
    decide(&mut rows, outcome.verdict);
    rows
}

/// Marks the first unmet criterion that leads to the verdict.
fn decide(rows: &mut [Criterion], verdict: Verdict) {
    let leads: &[&str] = match verdict {
        Verdict::Located => &[],
        Verdict::Ambiguous => &[RIVALS],
        Verdict::Degenerate => &[WEAKEST],
        Verdict::Insufficient => &[POINTS, PATCHES],
        // Rock that says no where the shape fits comes last, see the rules.
        Verdict::NotFound => &[OVERLAP, FINE, BEND, ROCK],
    };
    let unmet = |r: &Criterion, name: &str| r.asks == name && r.met == Some(false);
    if let Some(name) = leads.iter().find(|n| rows.iter().any(|r| unmet(r, n))) {
        for r in rows.iter_mut().filter(|r| unmet(r, name)) {
            r.decides = true;
        }
    }
}

const POINTS: &str = "Does the query hold enough geometry?";
const OVERLAP: &str = "Does it lie on the map?";
const FINE: &str = "Does it lie there finely?";
const PATCHES: &str = "Is there enough wall to ask?";
const ROCK: &str = "Is it the same rock?";
const OTHER: &str = "Does the rock of another place fit as well?";
const RIVALS: &str = "Can other places be ruled out?";
const BEND: &str = "Is the query straight enough?";
const WEAKEST: &str = "Is it held in every direction?";

/// What the verdict means, in a sentence or two, and what to do about it.
#[must_use]
pub fn meaning(outcome: &Outcome, config: &VerifyConfig) -> &'static str {
    let best = outcome.hypotheses.first();
    let sure = best.is_some_and(|b| is_confirmed(b, config));
    let rows = criteria(outcome, config);
    let decides = |name: &str| rows.iter().any(|r| r.decides && r.asks == name);
    match outcome.verdict {
        Verdict::Located => {
            "The query lies in the map where it is shown, and the rock itself says so."
        }
        Verdict::Ambiguous => {
            "Several places in the map fit. Drive on a little and ask again; do not act on the first of them."
        }
        Verdict::Degenerate if sure => {
            "The rock confirms the place, but the query could still move the way the arrows show. Trust the rest of the pose."
        }
        Verdict::Degenerate => {
            "The query could move the way the arrows show, and the place rests on its shape alone: another passage of that shape would answer alike."
        }
        Verdict::NotFound if best.is_none() => "No place in this map came up for the query.",
        Verdict::NotFound if sure => {
            "The rock says that it is this place, but the query is too bent or too blurred for one pose. Ask again with a shorter one."
        }
        Verdict::NotFound if decides(ROCK) => {
            "A place has the query's shape, but its rock is not the same. What is shown is only the best of those tried."
        }
        Verdict::NotFound => {
            "No place in this map has the query's shape. What is shown is only the best of those tried."
        }
        Verdict::Insufficient if best.is_some() => {
            "The shape fits, but there is too little wall to ask whether it is the same rock. Collect more."
        }
        Verdict::Insufficient => "The query holds too little geometry to look for. Collect more.",
    }
}

/// With a space that does not break.
fn percent(share: f64) -> String {
    format!("{:.0}\u{a0}%", 100.0 * share)
}

fn fine_percent(share: f64) -> String {
    let digits = if share < 0.0995 { 2 } else { 1 };
    format!("{:.digits$}\u{a0}%", 100.0 * share)
}

/// The rock has confirmed the place.
pub(crate) fn is_confirmed(best: &RankedHypothesis, config: &VerifyConfig) -> bool {
    best.overlap >= config.least_overlap
        && best.relief.is_some_and(|r| {
            r.asked >= config.min_patches && r.significance() >= config.min_significance
        })
}

#[expect(clippy::cast_precision_loss, reason = "counts")]
fn points(outcome: &Outcome, config: &VerifyConfig) -> Criterion {
    let prepared = outcome
        .stages
        .iter()
        .filter(|s| s.name == "prepare query")
        .map(|s| s.count_out)
        .next_back();
    let found = match (prepared, outcome.voxel) {
        (Some(n), Some(voxel)) => format!("{n} points left, {voxel:.2} m apart"),
        (Some(n), None) => format!("{n} points"),
        (None, _) => format!("{} points as read", outcome.query_points),
    };
    let enough = prepared.is_some_and(|n| n >= config.min_points);
    // Points without a normal do not count, which only the verdict knows.
    let refused = outcome.verdict == Verdict::Insufficient && outcome.hypotheses.is_empty();
    Criterion {
        asks: POINTS,
        found,
        wanted: format!("at least {}", config.min_points),
        met: Some(enough && !refused),
        decides: false,
        gauge: prepared
            .filter(|n| *n < 10 * config.min_points)
            .map(|n| Gauge {
                value: n as f64,
                threshold: config.min_points as f64,
                end: 2.0 * (n.max(config.min_points)) as f64,
            }),
    }
}

fn share_row(
    asks: &'static str,
    value: f64,
    threshold: f64,
    found: String,
    wanted: String,
) -> Criterion {
    Criterion {
        asks,
        found,
        wanted,
        met: Some(value >= threshold),
        decides: false,
        gauge: Some(Gauge {
            value,
            threshold,
            end: 1.0,
        }),
    }
}

fn overlap(best: &RankedHypothesis, config: &VerifyConfig, sure: bool) -> Criterion {
    let (least, when) = if sure {
        (config.least_overlap, "where the rock agrees")
    } else {
        (config.min_overlap, "where the rock does not tell")
    };
    share_row(
        OVERLAP,
        best.overlap,
        least,
        format!("{} of it has map within reach", percent(best.overlap)),
        format!("at least {} {when}", percent(least)),
    )
}

fn fine(best: &RankedHypothesis, config: &VerifyConfig, sure: bool) -> Criterion {
    let share = if best.overlap > 0.0 {
        best.score / best.overlap
    } else {
        0.0
    };
    let median = best
        .median_point_to_plane
        .map_or_else(String::new, |m| format!(", median {:.1} cm off", 100.0 * m));
    let mut row = share_row(
        FINE,
        share,
        config.min_fine_share,
        format!("{} of that does{median}", percent(share)),
        format!("at least {}", percent(config.min_fine_share)),
    );
    if sure && best.relief.is_some_and(|r| r.piecewise) {
        // A bent query lies finely piece by piece only.
        row.met = None;
        row.wanted = "not asked: it was laid down piece by piece".into();
    }
    row
}

#[expect(clippy::cast_precision_loss, reason = "counts")]
fn asked(best: &RankedHypothesis, config: &VerifyConfig) -> Criterion {
    let asked = best.relief.map_or(0, |r| r.asked);
    let least = config.min_patches;
    Criterion {
        asks: PATCHES,
        found: format!("{asked} patches"),
        wanted: format!("at least {least}"),
        met: Some(asked >= least),
        decides: false,
        gauge: Some(Gauge {
            value: asked as f64,
            threshold: least as f64,
            end: (asked.max(3 * least)) as f64,
        }),
    }
}

fn same_rock(best: &RankedHypothesis, config: &VerifyConfig) -> Criterion {
    let relief = best.relief.unwrap_or_default();
    let sigma = relief.significance();
    let enough = relief.asked >= config.min_patches;
    let found = if relief.asked == 0 {
        "no patch could be asked".into()
    } else if sigma < 0.0 {
        format!(
            "{} of {} patches agree, fewer than by chance ({sigma:.1} σ)",
            relief.confirmed, relief.asked
        )
    } else {
        format!(
            "{} of {} patches agree, {sigma:.1} σ more than by chance",
            relief.confirmed, relief.asked
        )
    };
    Criterion {
        asks: ROCK,
        found,
        wanted: format!(
            "at least {:.1} σ; from {:.1} σ beyond doubt",
            config.min_significance, config.sure_significance
        ),
        met: enough.then_some(sigma >= config.min_significance),
        decides: false,
        gauge: Some(Gauge {
            value: sigma.max(0.0),
            threshold: config.min_significance,
            end: sigma.max(2.0 * config.sure_significance),
        }),
    }
}

/// What the rock says of the other places, the strongest of them.
fn strongest_other(outcome: &Outcome, config: &VerifyConfig) -> Criterion {
    let best = outcome.hypotheses.first().and_then(|h| h.relief);
    let excess = best.map_or(0.0, |r| r.excess());
    let others: Vec<Relief> = outcome
        .hypotheses
        .iter()
        .skip(1)
        .filter_map(|h| h.relief)
        .filter(|r| r.asked >= config.min_patches)
        .collect();
    let strongest = others
        .iter()
        .max_by(|a, b| a.excess().total_cmp(&b.excess()));
    let doubt = |r: &Relief| r.significance() >= config.sure_significance;
    let share = strongest
        .filter(|_| excess > 0.0)
        .map(|r| r.excess() / excess);
    let found = match strongest {
        None if outcome.hypotheses.len() < 2 => "no other place came up".into(),
        None => "none had enough of it to ask".into(),
        Some(r) => format!(
            "at best {} of {} patches{}",
            r.confirmed,
            r.asked,
            share.map_or_else(String::new, |s| format!(
                ": {} of the answer's excess over chance",
                percent(s.max(0.0))
            ))
        ),
    };
    Criterion {
        asks: OTHER,
        found,
        wanted: format!(
            "below {}, and below {:.1} σ",
            percent(config.rival_excess),
            config.sure_significance
        ),
        met: share.map(|s| s < config.rival_excess && !others.iter().any(doubt)),
        decides: false,
        gauge: share.map(|s| Gauge {
            value: s.clamp(0.0, 1.0),
            threshold: config.rival_excess,
            end: 1.0,
        }),
    }
}

fn rivals(outcome: &Outcome) -> Criterion {
    let rivals = outcome.hypotheses.iter().filter(|h| h.rival).count();
    let others = outcome.hypotheses.len().saturating_sub(1);
    Criterion {
        asks: RIVALS,
        found: match (rivals, others) {
            (0, 0) => "there is no other".into(),
            (0, n) => format!("all {n} of them"),
            (r, n) => format!("{r} of {n} cannot"),
        },
        wanted: "all of them".into(),
        met: Some(rivals == 0),
        decides: false,
        gauge: None,
    }
}

fn bend(best: &RankedHypothesis, config: &VerifyConfig) -> Option<Criterion> {
    let relief = best.relief?;
    let beyond = relief.beyond?;
    let off = relief.bend.map_or_else(String::new, |b| {
        format!("; its pieces lie {b:.2} m off one pose")
    });
    Some(Criterion {
        asks: BEND,
        found: format!("a bend may leave its middle {beyond:.2} m off{off}"),
        wanted: format!("at most {:.2} m", config.max_beyond),
        met: Some(beyond <= config.max_beyond),
        decides: false,
        gauge: Some(Gauge {
            value: beyond,
            threshold: config.max_beyond,
            end: beyond.max(2.0 * config.max_beyond),
        }),
    })
}

fn weakest_direction(outcome: &Outcome, config: &VerifyConfig, sure: bool) -> Option<Criterion> {
    let least = if sure {
        config.min_information_confirmed
    } else {
        config.min_information
    };
    let all = degeneracy::directions(outcome.information.as_ref()?);
    let weakest: Unobservable = all
        .into_iter()
        .min_by(|a, b| a.information.total_cmp(&b.information))?;
    let held = weakest.information >= least;
    let way = match weakest.kind {
        DirectionKind::Translation => "sliding along",
        DirectionKind::Rotation => "turning about",
    };
    // Minus zero reads badly.
    let [x, y, z] = weakest.direction.map(|v| (100.0 * v).round() / 100.0 + 0.0);
    Some(Criterion {
        asks: WEAKEST,
        found: format!(
            "against {way} ({x:.2}, {y:.2}, {z:.2}) a point tells {} of what it could, elsewhere more",
            fine_percent(weakest.information)
        ),
        wanted: format!("at least {}", fine_percent(least)),
        met: Some(held),
        decides: false,
        gauge: Some(Gauge {
            value: weakest.information,
            threshold: least,
            end: (4.0 * least).max(weakest.information),
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use winze::Pose;

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
        criteria(o, &VerifyConfig::default())
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
        assert!(
            row(&rows, OTHER)
                .found
                .contains("20 of 59 patches: 1\u{a0}% of")
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
        }
        let rows = rows(&outcome(Verdict::NotFound, vec![best]));
        assert_eq!(deciding(&rows), [BEND]);
        assert_eq!(row(&rows, FINE).met, None);
    }
}
