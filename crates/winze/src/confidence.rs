//! How sure: the probability that the pose answered is within tolerance, as counted on simulated queries.
//!
//! Answers are sorted by the evidence behind them ([`Evidence`]), and each sort has been counted on queries whose truth was known: how many were
//! given, and how many of them lay within 0.5 m and 5° of the truth. No more is claimed than the counts support: of `n` answers that were all right, the
//! rule of three leaves a share of 3/n that may be wrong (Hanley & Lippman-Hand, "If nothing goes wrong, is everything all right?", 1983), so that
//! nothing is ever certain.
//!
//! Three things the number does not know. Mines, sensors and odometry that are unlike the simulated ones. The share of queries that the map does not hold
//! at all: one in six of those counted. And settings other than the default, or methods other than `auto`, for which nothing was counted and nothing is
//! said.

use crate::config::{Config, VerifyConfig};
use crate::method::Method;
use crate::outcome::Verdict;
use crate::relief::Relief;

/// What stands behind an answer with a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Evidence {
    /// Located: the rock says that it is this place, and no other.
    Located,
    /// The rock says that it is this place, yet something forbids to act on the whole pose: a bend that nobody can follow, or a direction
    /// that nothing holds.
    HeldBack,
    /// The shape fits, the rock does not tell.
    Shape,
    /// Several places cannot be told apart; the rock confirms the first.
    AmbiguousRock,
    /// Several places cannot be told apart; the rock confirms none.
    AmbiguousShape,
    /// No place fits: the best of poor ones.
    Poor,
}

/// Answers of one sort, counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Counted {
    /// What stood behind them,
    pub evidence: Evidence,
    /// the rock with at least so many standard deviations above chance.
    pub significance: f64,
    /// How many were given,
    pub given: u32,
    /// and were right.
    pub right: u32,
}

impl Counted {
    const fn new(evidence: Evidence, significance: f64, right: u32, given: u32) -> Self {
        Self {
            evidence,
            significance,
            given,
            right,
        }
    }

    /// The probability that another one is right: Laplace's rule of succession, and never more than the rule of three leaves.
    #[must_use]
    pub fn probability(&self) -> f64 {
        let (right, given) = (f64::from(self.right), f64::from(self.given));
        let laplace = (right + 1.0) / (given + 2.0);
        laplace.min(1.0 - 3.0 / given.max(3.0))
    }
}

/// What was counted: all answers with a pose to 3 966 queries, of the six families of scenarios that `winze sim` plays, seeds 15 to 18 and 20, and of one with
/// bent queries at the map's border (`docs/confidence.md` says which, and from which data). Of one sort, the strongest evidence first.
pub const COUNTED: [Counted; 10] = [
    Counted::new(Evidence::Located, 12.0, 1566, 1566),
    Counted::new(Evidence::Located, 8.0, 903, 903),
    Counted::new(Evidence::Located, 5.0, 406, 407),
    Counted::new(Evidence::Located, 4.0, 127, 127),
    Counted::new(Evidence::Located, 3.0, 82, 82),
    Counted::new(Evidence::HeldBack, 3.0, 57, 69),
    Counted::new(Evidence::Shape, f64::NEG_INFINITY, 36, 36),
    Counted::new(Evidence::AmbiguousRock, 3.0, 7, 9),
    Counted::new(Evidence::AmbiguousShape, f64::NEG_INFINITY, 1, 14),
    Counted::new(Evidence::Poor, f64::NEG_INFINITY, 28, 684),
];

/// What stands behind an answer: its verdict, what the rock says at the pose, and whether the fit was good enough for its open directions to be
/// asked for.
#[must_use]
pub fn evidence(
    verdict: Verdict,
    relief: Option<Relief>,
    fits: bool,
    config: &VerifyConfig,
) -> Evidence {
    let confirmed = relief.is_some_and(|r| {
        r.asked >= config.min_patches && r.significance() >= config.min_significance
    });
    match verdict {
        Verdict::Located => Evidence::Located,
        Verdict::Ambiguous if confirmed => Evidence::AmbiguousRock,
        Verdict::Ambiguous => Evidence::AmbiguousShape,
        _ if !fits => Evidence::Poor,
        _ if confirmed => Evidence::HeldBack,
        _ => Evidence::Shape,
    }
}

/// The probability that an answer with a pose is right: within 0.5 m and 5° of the truth, across the directions that it says are open. `fits`: whether
/// the pose was good enough for these to be asked for ([`Outcome::unobservable`](crate::Outcome::unobservable)). `None` for what was not
/// counted.
#[must_use]
pub fn confidence(
    method: Method,
    verdict: Verdict,
    relief: Option<Relief>,
    fits: bool,
    config: &Config,
) -> Option<f64> {
    if method != Method::Auto || !counted_with(config) {
        return None;
    }
    let evidence = evidence(verdict, relief, fits, &config.verify);
    let significance = relief.map_or(0.0, |r| r.significance());
    COUNTED
        .iter()
        .find(|c| c.evidence == evidence && significance >= c.significance)
        .map(Counted::probability)
}

/// Whether the settings are those that answers were counted with. The seed and a voxel size of one's own do not matter to what evidence means.
fn counted_with(config: &Config) -> bool {
    let default = Config::default();
    let own = Config {
        seed: default.seed,
        scale: default.scale.clone(),
        odometry: default.odometry.clone(),
        ..config.clone()
    };
    own == default
}

#[cfg(test)]
mod tests {
    use super::*;

    fn relief(confirmed: usize, asked: usize) -> Option<Relief> {
        Some(Relief {
            asked,
            confirmed,
            ..Relief::default()
        })
    }

    fn of(verdict: Verdict, relief: Option<Relief>, fits: bool) -> Option<f64> {
        confidence(Method::Auto, verdict, relief, fits, &Config::default())
    }

    #[test]
    fn probabilities_by_hand() {
        // All of 120: 121/122 by Laplace, 0.975 by the rule of three.
        let all = Counted::new(Evidence::Located, 0.0, 120, 120);
        assert_eq!(all.probability(), 0.975);
        let none = Counted::new(Evidence::Poor, 0.0, 0, 98);
        assert_eq!(none.probability(), 0.01);
        // Too few to say anything.
        assert_eq!(Counted::new(Evidence::Shape, 0.0, 2, 2).probability(), 0.0);
    }

    #[test]
    fn no_row_claims_more_than_it_can() {
        for c in COUNTED {
            assert!(c.right <= c.given, "{c:?}");
            assert!(c.probability() <= 1.0 - 3.0 / f64::from(c.given), "{c:?}");
        }
        // More evidence is never less sure.
        let located = COUNTED.iter().filter(|c| c.evidence == Evidence::Located);
        let sure: Vec<f64> = located.map(Counted::probability).collect();
        assert!(sure.is_sorted_by(|a, b| a >= b), "{sure:?}");
    }

    #[test]
    fn evidence_sorts_answers() {
        // 150 of 200: 12.5 standard deviations; 90 of 200: 3.5.
        let (much, little) = (relief(150, 200), relief(90, 200));
        let sure = of(Verdict::Located, much, true);
        assert!(sure > Some(0.997) && sure < Some(0.999), "{sure:?}");
        assert!(of(Verdict::Located, little, true) < Some(0.97));
        assert!(of(Verdict::Located, little, true) > Some(0.9));
        let held = of(Verdict::NotFound, much, true);
        assert!(held < Some(0.9) && held > Some(0.5), "{held:?}");
        assert_eq!(of(Verdict::Degenerate, much, true), held);
        assert!(of(Verdict::NotFound, relief(60, 200), false) < Some(0.05));
        assert!(of(Verdict::NotFound, None, false) < Some(0.05));
        assert!(of(Verdict::Ambiguous, relief(60, 200), true) < Some(0.2));
        let shape = evidence(
            Verdict::Insufficient,
            relief(9, 10),
            true,
            &VerifyConfig::default(),
        );
        assert_eq!(shape, Evidence::Shape, "too few patches confirm nothing");
    }

    #[test]
    fn nothing_is_said_of_what_was_not_counted() {
        let much = relief(150, 200);
        let default = Config::default();
        let said =
            |method, config: &Config| confidence(method, Verdict::Located, much, true, config);
        assert!(said(Method::Auto, &default).is_some());
        assert_eq!(said(Method::FpfhNdtIcp, &default), None);
        let mut other = default.clone();
        (other.seed, other.scale.voxel) = (7, 0.2);
        assert!(said(Method::Auto, &other).is_some());
        other.verify.min_significance = 1.0;
        assert_eq!(said(Method::Auto, &other), None);
    }
}
