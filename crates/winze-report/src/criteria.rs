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
    place.overlap >= config.least_overlap
        && asked_enough(place, config).is_some_and(|r| r.significance() >= config.min_significance)
}

/// And by so much that no shape overrules it.
fn is_beyond_doubt(place: &RankedHypothesis, config: &VerifyConfig) -> bool {
    is_confirmed(place, config)
        && place
            .relief
            .is_some_and(|r| r.significance() >= config.sure_significance)
}

/// What the rock says, where enough of it could be asked.
fn asked_enough(place: &RankedHypothesis, config: &VerifyConfig) -> Option<Relief> {
    place.relief.filter(|r| r.asked >= config.min_patches)
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

/// What the rock says of another place beside the best one: the two ways in which it makes a rival, see [`winze::judge`].
struct Rock {
    /// Of the best's excess over chance.
    share: f64,
    sigma: f64,
    /// Enough of the excess, on enough overlap.
    by_share: bool,
    /// Confirmed on its own, beyond doubt.
    on_its_own: bool,
}

impl Rock {
    /// `None` where too little of it could be asked.
    fn of(
        place: &RankedHypothesis,
        best: &RankedHypothesis,
        config: &VerifyConfig,
    ) -> Option<Self> {
        let own = asked_enough(place, config)?;
        let of = best.relief.map_or(0.0, |r| r.excess());
        let enough = own.excess() >= config.rival_excess * of;
        Some(Self {
            share: own.excess().max(0.0) / of.max(f64::MIN_POSITIVE),
            sigma: own.significance(),
            by_share: enough && place.overlap >= config.least_overlap,
            on_its_own: is_beyond_doubt(place, config),
        })
    }

    fn as_sure(&self) -> bool {
        self.by_share || self.on_its_own
    }

    fn share_gauge(&self, config: &VerifyConfig) -> Gauge {
        Gauge {
            value: self.share.clamp(0.0, 1.0),
            threshold: config.rival_excess,
            end: 1.0,
        }
    }

    fn sigma_gauge(&self, config: &VerifyConfig) -> Gauge {
        Gauge {
            value: self.sigma.max(0.0),
            threshold: config.sure_significance,
            end: self.sigma.max(2.0 * config.sure_significance),
        }
    }
}

/// What the rock says of the other places: of the strongest that it keeps as a rival, or else of the strongest.
fn strongest_other(outcome: &Outcome, best: &RankedHypothesis, config: &VerifyConfig) -> Criterion {
    let mut row = Criterion {
        asks: OTHER,
        found: "no other place came up".into(),
        wanted: format!(
            "below {}, and below {:.1} σ",
            percent(config.rival_excess, 0),
            config.sure_significance
        ),
        met: None,
        decides: false,
        gauge: None,
    };
    let sure = is_confirmed(best, config);
    if !sure {
        row.wanted = "not asked: the rock does not confirm the first".into();
    }
    if outcome.hypotheses.len() < 2 {
        return row;
    }
    let others = outcome.hypotheses.iter().skip(1);
    let strongest = others
        .filter_map(|h| Some((h, asked_enough(h, config)?, Rock::of(h, best, config)?)))
        .max_by(|(a, a_relief, a_rock), (b, b_relief, b_rock)| {
            let kept = |h: &RankedHypothesis, rock: &Rock| h.rival && rock.as_sure();
            let first = kept(a, a_rock).cmp(&kept(b, b_rock));
            first.then(a_relief.excess().total_cmp(&b_relief.excess()))
        });
    let Some((place, relief, rock)) = strongest else {
        row.found = "none had enough of it to ask".into();
        return row;
    };
    let told = format!("at best {} of {} patches", relief.confirmed, relief.asked);
    if !sure {
        row.found = format!("{told}, {:.1} σ", rock.sigma);
        return row;
    }
    let of_share = percent_digits(rock.share, config.rival_excess, 0);
    let of_sigma = digits_apart(rock.sigma, &[config.sure_significance], 1);
    let (sigma, beyond) = (rock.sigma, config.sure_significance);
    let rival = place.rival && rock.as_sure();
    let but = if rival {
        String::new()
    } else if rock.as_sure() {
        "; it is the same place further along what is open".into()
    } else if place.overlap < config.least_overlap {
        let digits = percent_digits(place.overlap, config.least_overlap, 0);
        format!(
            "; only {} of the query has map there, below {}",
            percent(place.overlap, digits),
            percent(config.least_overlap, digits)
        )
    } else {
        String::new()
    };
    row.found = format!(
        "{told}: {} of the answer's excess over chance, {sigma:.of_sigma$} σ{but}",
        percent(rock.share, of_share)
    );
    row.wanted = format!(
        "below {}, and below {beyond:.of_sigma$} σ",
        percent(config.rival_excess, of_share)
    );
    row.met = Some(!rival);
    row.gauge = if rival && !rock.by_share {
        Some(rock.sigma_gauge(config))
    } else {
        // A bar beyond its tick would read as not met.
        Some(rock.share_gauge(config)).filter(|g| rival || g.value < g.threshold)
    };
    row
}

fn rivals(outcome: &Outcome, best: &RankedHypothesis, config: &VerifyConfig) -> Criterion {
    let rivals = outcome.hypotheses.iter().filter(|h| h.rival).count();
    let others = outcome.hypotheses.len().saturating_sub(1);
    let mut row = Criterion {
        asks: RIVALS,
        found: match (rivals, others) {
            (0, 0) => "no other place came up".into(),
            (0, 1) => "the one other can".into(),
            (0, n) => format!("all {n} others can"),
            (r, n) => format!("{r} of {n} cannot"),
        },
        wanted: "none may be left".into(),
        met: Some(rivals == 0),
        decides: false,
        gauge: None,
    };
    let mut places = outcome.hypotheses.iter().enumerate();
    if let Some((i, rival)) = places.find(|(_, h)| h.rival)
        && let Some(kept) = kept_by(rival, best, config)
    {
        row.found = format!("{}: place {} {}", row.found, i + 1, kept.found);
        row.wanted = kept.wanted;
        row.gauge = kept.gauge;
    }
    row
}

/// By which rule a rival was kept.
struct Kept {
    found: String,
    wanted: String,
    gauge: Option<Gauge>,
}

/// The first of the rules that [`winze::judge`] keeps `rival` by.
fn kept_by(
    rival: &RankedHypothesis,
    best: &RankedHypothesis,
    config: &VerifyConfig,
) -> Option<Kept> {
    let sure = is_confirmed(best, config);
    let rock = Rock::of(rival, best, config);
    let by_rock = sure && rock.is_some();
    if let Some(rock) = rock.as_ref().filter(|r| by_rock && r.by_share) {
        let digits = percent_digits(rock.share, config.rival_excess, 0);
        return Some(Kept {
            found: format!(
                "has {} of the first's excess over chance",
                percent(rock.share, digits)
            ),
            wanted: format!("below {}", percent(config.rival_excess, digits)),
            gauge: Some(rock.share_gauge(config)),
        });
    }
    if !by_rock && let Some(kept) = as_fine(rival, best, config) {
        return Some(kept);
    }
    if let Some(rock) = rock.filter(|r| r.on_its_own) {
        let (sigma, beyond) = (rock.sigma, config.sure_significance);
        let digits = digits_apart(sigma, &[beyond], 1);
        return Some(Kept {
            found: format!("has rock that agrees by {sigma:.digits$} σ on its own"),
            wanted: format!("below {beyond:.digits$} σ"),
            gauge: Some(rock.sigma_gauge(config)),
        });
    }
    let sigma = best.relief.map_or(0.0, |r| r.significance());
    let beyond = config.sure_significance;
    (sure && sigma < beyond && rival.score > best.score).then(|| {
        let digits = percent_digits(rival.score, best.score, 0);
        let of_sigma = digits_apart(sigma, &[beyond], 1);
        Kept {
            found: format!(
                "has {} of the query lie finely, the first {}, whose rock says {sigma:.of_sigma$} σ",
                percent(rival.score, digits),
                percent(best.score, digits)
            ),
            wanted: format!("no more than the first, or {beyond:.of_sigma$} σ of its rock"),
            gauge: None,
        }
    })
}

/// That a rival fits as finely wherever it overlaps; `None` where it does not.
fn as_fine(
    rival: &RankedHypothesis,
    best: &RankedHypothesis,
    config: &VerifyConfig,
) -> Option<Kept> {
    let overlap = rival.overlap / best.overlap.max(f64::MIN_POSITIVE);
    let off = rival.median_point_to_plane? / best.median_point_to_plane?.max(f64::MIN_POSITIVE);
    let (least, most) = (config.rival_overlap, config.rival_residual);
    if overlap < least || off > most {
        return None;
    }
    let digits = percent_digits(overlap, least, 0);
    let of_off = digits_apart(off, &[most], 1);
    Some(Kept {
        found: format!(
            "fits as finely: {} of the first's overlap, a median {off:.of_off$} times the first's",
            percent(overlap, digits)
        ),
        wanted: format!(
            "below {}, or above {most:.of_off$} times",
            percent(least, digits)
        ),
        gauge: Some(Gauge {
            value: overlap.min(1.0),
            threshold: least,
            end: 1.0,
        }),
    })
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
}
