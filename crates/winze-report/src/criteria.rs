//! Why the verdict is what it is: each thing it rests on, as a number beside its threshold.
//!
//! The rules are those of [`winze::judge`]; what is told here is what they looked at, in the order that a person asks.

mod others;

use winze::config::VerifyConfig;
use winze::degeneracy::{self, DirectionKind, Unobservable};
use winze::outcome::RankedHypothesis;
use winze::verify::rock_confirms;
use winze::{Outcome, Verdict};

use others::{rivals, strongest_other};

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

/// What the verdict of `outcome` rests on; `config` is what it was verified by, `with_normal` how many of the query's prepared points have a
/// surface normal, where that is known.
#[must_use]
pub fn criteria(
    outcome: &Outcome,
    config: &VerifyConfig,
    with_normal: Option<usize>,
) -> Vec<Criterion> {
    let mut rows = vec![points(outcome, config, with_normal)];
    let mut sure = false;
    if let Some(best) = outcome.hypotheses.first() {
        sure = is_confirmed(best, config);
        rows.push(overlap(best, config, sure));
        rows.push(fine(best, config, sure));
        rows.push(asked(best, config));
        rows.push(same_rock(best, config));
        rows.push(strongest_other(outcome, best, config));
        rows.push(rivals(outcome, best, config));
        rows.extend(bend(best, config, sure));
        rows.extend(weakest_direction(outcome, config, sure));
    } else if outcome.verdict == Verdict::NotFound {
        rows.push(none_came_up());
    }
    decide(&mut rows, outcome.verdict, sure);
    rows
}

/// Marks the first unmet criterion that leads to the verdict; `sure`: the rock confirms the best place.
fn decide(rows: &mut [Criterion], verdict: Verdict, sure: bool) {
    let leads: &[&str] = match verdict {
        Verdict::Located => &[],
        Verdict::Ambiguous => &[RIVALS],
        Verdict::Degenerate => &[WEAKEST],
        Verdict::Insufficient => &[POINTS, PATCHES],
        Verdict::NotFound if sure => &[FINE, BEND],
        // Rock that says no where the shape fits comes last, see the rules.
        Verdict::NotFound => &[ANY, OVERLAP, FINE, ROCK],
    };
    let unmet = |r: &Criterion, name: &str| r.asks == name && r.met == Some(false);
    if let Some(name) = leads.iter().find(|n| rows.iter().any(|r| unmet(r, n))) {
        for r in rows.iter_mut().filter(|r| unmet(r, name)) {
            r.decides = true;
        }
    }
}

const POINTS: &str = "Does the query hold enough geometry?";
const ANY: &str = "Did any place come up?";
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
    let rows = criteria(outcome, config, None);
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
fn percent(share: f64, digits: usize) -> String {
    format!("{:.digits$}\u{a0}%", 100.0 * share)
}

/// Digits after the point that are added at most.
const MORE_DIGITS: usize = 6;

/// How many digits after the point, at least so many, tell a number from each of its thresholds: one just short of what is asked for must not read
/// like it.
fn digits_apart(value: f64, thresholds: &[f64], least: usize) -> usize {
    let told = |digits: usize| {
        thresholds.iter().all(|t| {
            value.total_cmp(t).is_eq() || format!("{value:.digits$}") != format!("{t:.digits$}")
        })
    };
    let most = least + MORE_DIGITS;
    (least..most).find(|d| told(*d)).unwrap_or(least)
}

/// The same of shares that are told in percent.
fn percent_digits(share: f64, threshold: f64, least: usize) -> usize {
    digits_apart(100.0 * share, &[100.0 * threshold], least)
}

/// The rock has confirmed the place, as the verdict takes it.
pub(crate) fn is_confirmed(place: &RankedHypothesis, config: &VerifyConfig) -> bool {
    rock_confirms(place.overlap, place.relief, config)
}

#[expect(clippy::cast_precision_loss, reason = "counts")]
fn points(outcome: &Outcome, config: &VerifyConfig, with_normal: Option<usize>) -> Criterion {
    let mut stages = outcome.stages.iter();
    let prepared = stages.rfind(|s| s.name == "prepare query");
    let counted = with_normal.or(prepared.map(|s| s.count_out));
    let apart = outcome
        .voxel
        .map_or_else(String::new, |v| format!(", {v:.2} m apart"));
    let found = match (with_normal, counted) {
        (Some(n), _) => format!("{n} points left with a surface normal{apart}"),
        (None, Some(n)) => format!("{n} points left{apart}"),
        (None, None) => format!("{} points as read", outcome.query_points),
    };
    let enough = counted.is_some_and(|n| n >= config.min_points);
    // Where points without a normal were not told apart, only the verdict knows.
    let refused = outcome.verdict == Verdict::Insufficient && outcome.hypotheses.is_empty();
    Criterion {
        asks: POINTS,
        found,
        wanted: format!("at least {}", config.min_points),
        met: Some(enough && !refused),
        decides: false,
        gauge: counted
            .filter(|n| *n < 10 * config.min_points)
            .map(|n| Gauge {
                value: n as f64,
                threshold: config.min_points as f64,
                end: 2.0 * (n.max(config.min_points)) as f64,
            }),
    }
}

fn none_came_up() -> Criterion {
    Criterion {
        asks: ANY,
        found: "0".into(),
        wanted: "at least 1".into(),
        met: Some(false),
        decides: false,
        gauge: None,
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
    let digits = percent_digits(best.overlap, least, 0);
    share_row(
        OVERLAP,
        best.overlap,
        least,
        format!(
            "{} of it has map within reach",
            percent(best.overlap, digits)
        ),
        format!("at least {} {when}", percent(least, digits)),
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
    let digits = percent_digits(share, config.min_fine_share, 0);
    let mut row = share_row(
        FINE,
        share,
        config.min_fine_share,
        format!("{} of that does{median}", percent(share, digits)),
        format!("at least {}", percent(config.min_fine_share, digits)),
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
    let (least, beyond) = (config.min_significance, config.sure_significance);
    let digits = digits_apart(sigma, &[least, beyond], 1);
    let found = if relief.asked == 0 {
        "no patch could be asked".into()
    } else if sigma < 0.0 {
        format!(
            "{} of {} patches agree, fewer than by chance ({sigma:.digits$} σ)",
            relief.confirmed, relief.asked
        )
    } else {
        format!(
            "{} of {} patches agree, {sigma:.digits$} σ more than by chance",
            relief.confirmed, relief.asked
        )
    };
    Criterion {
        asks: ROCK,
        found,
        wanted: format!("at least {least:.digits$} σ; from {beyond:.digits$} σ beyond doubt"),
        met: enough.then_some(sigma >= least),
        decides: false,
        gauge: Some(Gauge {
            value: sigma.max(0.0),
            threshold: least,
            end: sigma.max(2.0 * beyond),
        }),
    }
}

/// Pieces are followed at places that the rock does not confirm as well, where the bend is not asked for.
fn bend(best: &RankedHypothesis, config: &VerifyConfig, sure: bool) -> Option<Criterion> {
    let relief = best.relief?;
    let beyond = relief.beyond?;
    let most = config.max_beyond;
    let off = relief.bend.map_or_else(String::new, |b| {
        format!("; its pieces lie {b:.2} m off one pose")
    });
    let digits = digits_apart(beyond, &[most], 2);
    let asked = sure && relief.followed.is_some();
    Some(Criterion {
        asks: BEND,
        found: format!("a bend may leave its middle {beyond:.digits$} m off{off}"),
        wanted: if asked {
            format!("at most {most:.digits$} m")
        } else if sure {
            "not asked: how much was followed is not known".into()
        } else {
            "not asked: the rock does not confirm it".into()
        },
        met: asked.then_some(beyond <= most),
        decides: false,
        gauge: asked.then_some(Gauge {
            value: beyond,
            threshold: most,
            end: beyond.max(2.0 * most),
        }),
    })
}

/// The open direction that the verdict names, or the weakest where none is open.
fn weakest_direction(outcome: &Outcome, config: &VerifyConfig, sure: bool) -> Option<Criterion> {
    let least = if sure {
        config.min_information_confirmed
    } else {
        config.min_information
    };
    let open = outcome.unobservable.as_deref().unwrap_or_default();
    let named: Unobservable = match open.first() {
        Some(first) => *first,
        None => degeneracy::directions(outcome.information.as_ref()?)
            .into_iter()
            .min_by(|a, b| a.information.total_cmp(&b.information))?,
    };
    let way = match named.kind {
        DirectionKind::Translation => "sliding along",
        DirectionKind::Rotation => "turning about",
    };
    // Minus zero reads badly.
    let [x, y, z] = named.direction.map(|v| (100.0 * v).round() / 100.0 + 0.0);
    let others = match open.len() {
        0 => ", elsewhere more".into(),
        1 => String::new(),
        n => format!(", and {} more fall short", n - 1),
    };
    let digits = percent_digits(
        named.information,
        least,
        if named.information < 0.0995 { 2 } else { 1 },
    );
    Some(Criterion {
        asks: WEAKEST,
        found: format!(
            "against {way} ({x:.2}, {y:.2}, {z:.2}) a point tells {} of what it could{others}",
            percent(named.information, digits)
        ),
        wanted: format!("at least {}", percent(least, digits)),
        met: Some(named.information >= least),
        decides: false,
        gauge: Some(Gauge {
            value: named.information,
            threshold: least,
            end: (4.0 * least).max(named.information),
        }),
    })
}

#[cfg(test)]
mod tests;
