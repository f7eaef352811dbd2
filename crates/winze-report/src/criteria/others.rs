//! The other places that were weighed, beside the best one.

use winze::Outcome;
use winze::config::VerifyConfig;
use winze::outcome::RankedHypothesis;
use winze::verify::{asked_enough, rock_is_sure};

use super::{Criterion, Gauge, OTHER, RIVALS, digits_apart, is_confirmed, percent, percent_digits};

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
        let own = asked_enough(place.relief, config)?;
        let of = best.relief.map_or(0.0, |r| r.excess());
        let enough = own.excess() >= config.rival_excess * of;
        Some(Self {
            share: own.excess().max(0.0) / of.max(f64::MIN_POSITIVE),
            sigma: own.significance(),
            by_share: enough && place.overlap >= config.least_overlap,
            on_its_own: rock_is_sure(place.overlap, place.relief, config),
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
pub(super) fn strongest_other(
    outcome: &Outcome,
    best: &RankedHypothesis,
    config: &VerifyConfig,
) -> Criterion {
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
        .filter_map(|h| {
            Some((
                h,
                asked_enough(h.relief, config)?,
                Rock::of(h, best, config)?,
            ))
        })
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

/// Whether any of the other places is left as a rival, and by which rule the first of these is.
pub(super) fn rivals(
    outcome: &Outcome,
    best: &RankedHypothesis,
    config: &VerifyConfig,
) -> Criterion {
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
