//! Does confidence mean what it says? Answers in bins of the confidence they were given with, against the share that was right.

use serde::Serialize;

use super::Run;
use super::rates::Rate;
use super::summary::by_family;
use winze::PoseDistance;
use winze::confidence::is_right;

/// Lower ends of the bins of confidence: narrow where people act, so that no two [rows](winze::confidence::COUNTED) share one.
const BINS: [f64; 12] = [
    0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.97, 0.98, 0.99, 0.995, 0.9975,
];

/// Answers given with about the same confidence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bin {
    /// Confidence from here
    pub from: f64,
    /// to here.
    pub to: f64,
    /// Its mean over the answers.
    pub confidence: f64,
    /// Of the answers, those that were right.
    pub right: Rate,
}

impl Bin {
    /// Whether the mean confidence lies within the interval of the share that was right, in words.
    #[must_use]
    pub fn judged(&self) -> &'static str {
        match (self.right.low, self.right.high) {
            (Some(low), _) if self.confidence < low => "too modest",
            (_, Some(high)) if self.confidence > high => "too sure",
            _ => "yes",
        }
    }
}

/// One method's confidence on one family, or on all of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Calibration {
    /// The method's name.
    pub method: String,
    /// The family; null for all together.
    pub family: Option<String>,
    /// Answers with a confidence.
    pub answers: usize,
    /// Mean square difference of confidence from what came true (1 or 0): Brier, "Verification of forecasts expressed in terms of probability", 1950.
    pub brier: f64,
    /// Mean over the bins, weighted by their answers, of the difference between mean confidence and share right (ECE).
    pub calibration_error: f64,
    /// The most by which a bin's mean confidence exceeds the upper end of the interval of its share right.
    pub overconfidence: f64,
    /// Those with answers.
    pub bins: Vec<Bin>,
}

/// The confidence of a run, and whether it came true ([`is_right`], whatever the verdict).
fn told(run: &Run) -> Option<(f64, bool)> {
    let confidence = run.confidence.filter(|c| (0.0..=1.0).contains(c))?;
    let error = run.mark.translation_m.zip(run.mark.rotation_deg);
    let right = error.is_some_and(|(metres, degrees)| {
        is_right(PoseDistance {
            translation: metres,
            rotation: degrees.to_radians(),
        })
    });
    Some((confidence, right))
}

impl Calibration {
    /// Of the runs given; `None` where none of them has a confidence.
    #[must_use]
    pub fn of(method: &str, family: Option<&str>, runs: &[&Run]) -> Option<Self> {
        let told: Vec<(f64, bool)> = runs.iter().filter_map(|r| told(r)).collect();
        if told.is_empty() {
            return None;
        }
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let mean = |values: &mut dyn Iterator<Item = f64>, n: usize| values.sum::<f64>() / n as f64;
        let upper = BINS.iter().skip(1).copied().chain([1.0]);
        let bins: Vec<Bin> = BINS
            .iter()
            .zip(upper)
            .filter_map(|(&from, to)| {
                // The last one is closed.
                let within = |c: f64| from <= c && (c < to || to >= 1.0);
                let own: Vec<&(f64, bool)> = told.iter().filter(|(c, _)| within(*c)).collect();
                (!own.is_empty()).then(|| Bin {
                    from,
                    to,
                    confidence: mean(&mut own.iter().map(|(c, _)| *c), own.len()),
                    right: Rate::of(&own, |(_, right)| *right),
                })
            })
            .collect();
        let outcome = |right: bool| f64::from(u8::from(right));
        let squares = &mut told.iter().map(|(c, r)| (c - outcome(*r)).powi(2));
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let gap = |b: &Bin| {
            let share = b.right.share.unwrap_or_default();
            (b.confidence - share).abs() * b.right.of as f64
        };
        let over = |b: &Bin| b.confidence - b.right.high.unwrap_or(1.0);
        Some(Self {
            method: method.to_owned(),
            family: family.map(ToOwned::to_owned),
            answers: told.len(),
            brier: mean(squares, told.len()),
            calibration_error: mean(&mut bins.iter().map(gap), told.len()),
            overconfidence: bins.iter().map(over).fold(0.0, f64::max),
            bins,
        })
    }
}

/// One for each method and family whose runs have a confidence, and for each method over all families.
#[must_use]
pub fn calibrations(runs: &[Run]) -> Vec<Calibration> {
    by_family(runs, Calibration::of)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{Class, Mark, tests::run};
    use winze::confidence::{COUNTED, Counted};

    fn answered(confidence: f64, metres: f64) -> Run {
        let mark = Mark {
            translation_m: Some(metres),
            rotation_deg: Some(1.0),
            ..Mark::default()
        };
        Run {
            confidence: Some(confidence),
            ..run("auto", "a", Class::Refusal, mark)
        }
    }

    #[test]
    fn scores_by_hand() {
        // Three of four right at 0.8, none of two at 0.25.
        let mut runs: Vec<Run> = [0.1, 0.2, 0.5, 0.6]
            .map(|metres| answered(0.8, metres))
            .to_vec();
        runs.extend([answered(0.25, 9.0), answered(0.25, 9.0)]);
        runs.push(run("auto", "a", Class::Right, Mark::default()));
        let all = calibrations(&runs);
        assert_eq!(all.len(), 2, "the family, and all of them");
        let c = &all[1];
        assert_eq!((c.answers, c.bins.len()), (6, 2));
        let brier = (3.0 * 0.04 + 0.64 + 2.0 * 0.0625) / 6.0;
        assert!((c.brier - brier).abs() < 1e-12);
        let error = (4.0 * 0.05 + 2.0 * 0.25) / 6.0;
        assert!((c.calibration_error - error).abs() < 1e-12);
        assert!(c.bins.iter().all(|b| b.judged() == "yes"), "{c:?}");
        assert_eq!(c.overconfidence, 0.0);
    }

    #[test]
    fn too_sure_is_seen() {
        let runs: Vec<Run> = (0..100)
            .map(|i| answered(0.999, f64::from(u8::from(i % 10 == 0))))
            .collect();
        let c = &calibrations(&runs)[0];
        assert_eq!(c.bins[0].judged(), "too sure");
        assert!(c.overconfidence > 0.04, "{c:?}");
        assert!((c.calibration_error - 0.099).abs() < 1e-9);
    }

    #[test]
    fn too_modest_is_seen_too_and_bins_meet() {
        let runs: Vec<Run> = [0.99, 0.9975, 1.0]
            .into_iter()
            .flat_map(|c| vec![answered(c, 0.1); 900])
            .collect();
        let c = &calibrations(&runs)[0];
        let bins: Vec<_> = c.bins.iter().map(|b| (b.from, b.to, b.right.of)).collect();
        assert_eq!(bins, [(0.99, 0.995, 900), (0.9975, 1.0, 1800)]);
        assert_eq!(c.bins[0].judged(), "too modest");
        assert_eq!(c.bins[1].judged(), "yes");
    }

    #[test]
    fn a_query_that_is_not_in_the_map_is_never_right() {
        let mut out = answered(0.9, 0.0);
        out.mark = Mark::default();
        let c = &calibrations(&[out, answered(f64::NAN, 0.0)])[0];
        assert_eq!((c.answers, c.bins[0].right.count), (1, 0));
        let mute = run("auto", "a", Class::Right, Mark::default());
        assert!(calibrations(&[mute]).is_empty());
    }

    #[test]
    fn every_row_has_a_bin_of_its_own() {
        let mut bins: Vec<usize> = COUNTED
            .iter()
            .filter_map(Counted::probability)
            .map(|p| BINS.iter().filter(|from| **from <= p).count())
            .collect();
        bins.sort_unstable();
        bins.dedup();
        assert_eq!(bins.len(), COUNTED.len());
    }
}
