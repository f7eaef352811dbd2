//! Does the covariance cover the error? True errors of the poses that were believed, in units of their covariance.

use serde::{Deserialize, Serialize};
use winze::covariance::{Covariance, perturbation, plain};
use winze::{Outcome, Pose, Verdict};

use super::Run;
use super::calibration::by_family;
use super::mark::Class;
use super::rates::quantile;

/// A pose's error, and what its covariance says of it. Components: x, y, z of the query's centroid in map axes, metres, and the angles about
/// them, radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Doubt {
    /// The perturbation that takes the pose to the truth.
    pub error: [f64; 6],
    /// By the covariance answered.
    pub answered: Said,
    /// By the inverse Hessian of a point-to-plane fit, were its residuals independent.
    pub plain: Option<Said>,
}

/// What one covariance says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Said {
    /// Standard deviation of each component.
    pub sigma: [f64; 6],
    /// The error's square in units of the covariance (NEES).
    pub square: f64,
}

impl Said {
    fn of(covariance: &Covariance, error: [f64; 6]) -> Option<Self> {
        Some(Self {
            sigma: std::array::from_fn(|i| covariance.matrix[i][i].sqrt()),
            square: covariance.nees(error).filter(|s| s.is_finite())?,
        })
    }
}

impl Doubt {
    /// Of an answer, given the true `map_from_query` and the query's centroid in its own frame.
    #[must_use]
    pub fn of(outcome: &Outcome, truth: &Pose, centroid: [f64; 3]) -> Option<Self> {
        let pose = outcome.map_from_query?;
        let error = perturbation(&pose, truth, centroid);
        let covariance = outcome.covariance()?;
        let plain = outcome
            .information
            .and_then(|i| Said::of(&plain(&i)?.about(covariance.about), error));
        Some(Self {
            error,
            answered: Said::of(&covariance, error)?,
            plain,
        })
    }
}

/// Errors in units of one kind of covariance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Covered {
    /// Mean square, 6 where the covariance is right.
    pub mean_square: f64,
    /// Median square, 5.35 where it is right.
    pub median_square: f64,
    /// Share of each component's errors within one standard deviation, 0.683 where it is right.
    pub within_one: [f64; 6],
    /// Within two, 0.954.
    pub within_two: [f64; 6],
}

impl Covered {
    fn of(errors: &[([f64; 6], Said)]) -> Option<Self> {
        let squares: Vec<f64> = errors.iter().map(|(_, s)| s.square).collect();
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let n = errors.len() as f64;
        let within = |most: f64| {
            std::array::from_fn(|i| {
                let inside = |(e, s): &&([f64; 6], Said)| e[i].abs() <= most * s.sigma[i];
                #[expect(clippy::cast_precision_loss, reason = "a count")]
                let count = errors.iter().filter(inside).count() as f64;
                count / n
            })
        };
        Some(Self {
            median_square: quantile(&squares, 0.5)?,
            mean_square: squares.iter().sum::<f64>() / n,
            within_one: within(1.0),
            within_two: within(2.0),
        })
    }
}

/// One method's covariances on one family, or on all of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// The method's name.
    pub method: String,
    /// The family; null for all together.
    pub family: Option<String>,
    /// Right poses located.
    pub answers: usize,
    /// By the covariance answered.
    pub answered: Covered,
    /// By the plain inverse Hessian.
    pub plain: Option<Covered>,
}

impl Coverage {
    /// Of the runs given; `None` where none of them located has a covariance.
    #[must_use]
    pub fn of(method: &str, family: Option<&str>, runs: &[&Run]) -> Option<Self> {
        let believed =
            |r: &&&Run| r.verdict == Some(Verdict::Located) && r.mark.class == Class::Right;
        let doubts: Vec<Doubt> = runs
            .iter()
            .filter(believed)
            .filter_map(|r| r.doubt)
            .collect();
        let answered: Vec<_> = doubts.iter().map(|d| (d.error, d.answered)).collect();
        let plain: Vec<_> = doubts
            .iter()
            .filter_map(|d| Some((d.error, d.plain?)))
            .collect();
        Some(Self {
            method: method.to_owned(),
            family: family.map(ToOwned::to_owned),
            answers: doubts.len(),
            answered: Covered::of(&answered)?,
            plain: Covered::of(&plain),
        })
    }
}

/// One for each method and family, and for each method over all families.
#[must_use]
pub fn coverages(runs: &[Run]) -> Vec<Coverage> {
    by_family(runs, Coverage::of)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{Mark, tests::run};

    fn erring(metres: f64, sigma: f64) -> Run {
        let error = [metres, 0.0, 0.0, 0.0, 0.0, 0.0];
        let mut matrix = [[0.0; 6]; 6];
        (0..6).for_each(|i| matrix[i][i] = sigma * sigma);
        let covariance = Covariance {
            matrix,
            about: [0.0; 3],
        };
        Run {
            doubt: Some(Doubt {
                error,
                answered: Said::of(&covariance, error).unwrap(),
                plain: None,
            }),
            ..run("auto", "a", Class::Right, Mark::default())
        }
    }

    #[test]
    fn coverage_by_hand() {
        let wrong = Run {
            mark: Mark {
                class: Class::WrongAccept,
                ..Mark::default()
            },
            ..erring(90.0, 0.1)
        };
        let runs = [
            erring(0.05, 0.1),
            erring(-0.15, 0.1),
            erring(0.4, 0.1),
            wrong,
        ];
        let all = coverages(&runs);
        let c = &all[0];
        assert_eq!(
            (c.answers, c.plain.clone()),
            (3, None),
            "a wrong place is no error"
        );
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(
            close(c.answered.mean_square, (0.25 + 2.25 + 16.0) / 3.0),
            "{c:?}"
        );
        assert!(close(c.answered.median_square, 2.25));
        assert!(close(c.answered.within_one[0], 1.0 / 3.0));
        assert!(close(c.answered.within_two[0], 2.0 / 3.0));
        assert!(close(c.answered.within_one[5], 1.0));
    }
}
