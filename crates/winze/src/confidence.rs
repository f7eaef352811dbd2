//! How sure: the probability that the pose answered is right, as counted on simulated queries.
//!
//! Answers are sorted by the evidence behind them ([`Evidence`]), and each sort has been counted on queries whose truth was known: how many were
//! given, and how many of them were [right](is_right). The probability is Laplace's rule of succession, `(right + 1) / (given + 2)`, and never more than
//! `1 − 3 / given`: of `given` answers that were all right, a share of three over so many may yet be wrong (the rule of three: Hanley & Lippman-Hand, "If
//! nothing goes wrong, is everything all right?", 1983), so that nothing is ever certain.
//!
//! Three things the number does not know. Mines, sensors and odometry that are unlike the simulated ones. The share of queries that the map does not hold
//! at all: one in ten of those counted. And settings other than the default, or methods other than `auto`, for which nothing was counted and nothing is
//! said.

use crate::config::{Config, VerifyConfig};
use crate::method::Method;
use crate::outcome::Verdict;
use crate::pose::PoseDistance;
use crate::relief::Relief;
use crate::verify::asked_enough;

/// How far the query's centroid may be off in an answer that counts as right, metres,
pub const METRES: f64 = 0.5;
/// and its attitude, degrees.
pub const DEGREES: f64 = 5.0;

/// Whether a pose so far from the truth is right, which is what [`confidence`] speaks of.
#[must_use]
pub fn is_right(error: PoseDistance) -> bool {
    error.translation <= METRES && error.rotation <= DEGREES.to_radians()
}

/// What stands behind an answer with a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Evidence {
    /// `located`: the rock says that it is this place, and no other.
    Located,
    /// `not_found`, though the rock says that it is this place: the query is too bent for one pose.
    HeldBack,
    /// `not_found`, though the shape fits: the rock does not tell.
    Shape,
    /// `ambiguous`: several places cannot be told apart; the rock confirms the first.
    AmbiguousRock,
    /// `ambiguous`, and the rock confirms none.
    AmbiguousShape,
    /// `not_found`: the best of poor ones.
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

    /// The probability that another one is right; `None` where too few were counted to say.
    #[must_use]
    pub fn probability(&self) -> Option<f64> {
        let (right, given) = (f64::from(self.right), f64::from(self.given));
        let laplace = (right + 1.0) / (given + 2.0);
        (self.given > 3).then(|| laplace.min(1.0 - 3.0 / given))
    }
}

/// What was counted: the answers with a pose to 3 966 queries, of the six families of scenarios that `winze sim` plays, seeds 15 to 18 and 20, and of one with
/// bent queries at the map's border (`docs/confidence.md` says which, and from which data). Of one sort, the strongest evidence first.
pub const COUNTED: [Counted; 10] = [
    Counted::new(Evidence::Located, 12.0, 1566, 1566),
    Counted::new(Evidence::Located, 8.0, 903, 903),
    Counted::new(Evidence::Located, 5.0, 406, 407),
    Counted::new(Evidence::Located, 4.0, 127, 127),
    Counted::new(Evidence::Located, 3.0, 82, 82),
    Counted::new(Evidence::HeldBack, 3.0, 55, 67),
    Counted::new(Evidence::Shape, f64::NEG_INFINITY, 35, 35),
    Counted::new(Evidence::AmbiguousRock, 3.0, 7, 9),
    Counted::new(Evidence::AmbiguousShape, f64::NEG_INFINITY, 1, 14),
    Counted::new(Evidence::Poor, f64::NEG_INFINITY, 28, 684),
];

/// What stands behind an answer with a pose: its verdict, what the rock says there, and whether the fit was good enough (`fits`) for its open
/// directions to be asked for ([`Outcome::unobservable`](crate::Outcome::unobservable)). `None` for a degenerate or an insufficient answer: too few
/// of these were counted to say anything.
#[must_use]
pub fn evidence(
    verdict: Verdict,
    relief: Option<Relief>,
    fits: bool,
    config: &VerifyConfig,
) -> Option<Evidence> {
    let confirmed =
        asked_enough(relief, config).is_some_and(|r| r.significance() >= config.min_significance);
    match verdict {
        Verdict::Located => Some(Evidence::Located),
        Verdict::Ambiguous if confirmed => Some(Evidence::AmbiguousRock),
        Verdict::Ambiguous => Some(Evidence::AmbiguousShape),
        Verdict::NotFound if !fits => Some(Evidence::Poor),
        Verdict::NotFound if confirmed => Some(Evidence::HeldBack),
        Verdict::NotFound => Some(Evidence::Shape),
        Verdict::Degenerate | Verdict::Insufficient => None,
    }
}

/// The probability that an answer with a pose is [right](is_right), of its [`evidence`]. `None` for what was not counted.
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
    let evidence = evidence(verdict, relief, fits, &config.verify)?;
    let significance = relief.map_or(0.0, |r| r.significance());
    COUNTED
        .iter()
        .find(|c| c.evidence == evidence && significance >= c.significance)?
        .probability()
}

/// Whether all settings that the answer of `auto` depends on are those that answers were counted with.
fn counted_with(config: &Config) -> bool {
    let default = Config::default();
    let own = Config {
        // `auto` draws nothing at random and matches by rules of its own; a covariance is no evidence.
        seed: default.seed,
        matching: default.matching.clone(),
        ransac: default.ransac.clone(),
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
        assert_eq!(all.probability(), Some(0.975));
        let none = Counted::new(Evidence::Poor, 0.0, 0, 98);
        assert_eq!(none.probability(), Some(0.01));
        // Too few to say anything.
        let few = Counted::new(Evidence::Shape, 0.0, 3, 3);
        assert_eq!(few.probability(), None);
    }

    #[test]
    fn no_row_claims_more_than_it_can() {
        for c in COUNTED {
            assert!(c.right <= c.given, "{c:?}");
            let most = 1.0 - 3.0 / f64::from(c.given);
            assert!(c.probability().is_some_and(|p| p <= most), "{c:?}");
        }
        // More evidence is never less sure.
        let located = COUNTED.iter().filter(|c| c.evidence == Evidence::Located);
        let sure: Vec<f64> = located.filter_map(Counted::probability).collect();
        assert_eq!(sure.len(), 5);
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
        assert_eq!(of(Verdict::Degenerate, much, true), None);
        assert_eq!(of(Verdict::Insufficient, None, false), None);
        assert!(of(Verdict::NotFound, relief(60, 200), false) < Some(0.05));
        assert!(of(Verdict::NotFound, None, false) < Some(0.05));
        assert!(of(Verdict::Ambiguous, relief(60, 200), true) < Some(0.2));
        let few = evidence(
            Verdict::NotFound,
            relief(9, 10),
            true,
            &VerifyConfig::default(),
        );
        assert_eq!(
            few,
            Some(Evidence::Shape),
            "too few patches confirm nothing"
        );
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
        (other.seed, other.odometry.map, other.ransac.confidence) = (7, 0.05, 0.9);
        assert!(said(Method::Auto, &other).is_some());
        other.scale.voxel = 0.2;
        assert_eq!(said(Method::Auto, &other), None);
        other = default.clone();
        other.verify.min_significance = 1.0;
        assert_eq!(said(Method::Auto, &other), None);
    }
}
