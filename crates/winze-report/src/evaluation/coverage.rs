//! Does the covariance cover the error? True errors of the poses that were believed, in units of their covariance.

use serde::{Deserialize, Serialize};
use winze::covariance::{Covariance, inverse_hessian, perturbation};
use winze::icp::Information;
use winze::vec3::norm;
use winze::{Pose, Verdict};

use super::Run;
use super::rates::quantile;
use super::summary::by_family;

/// A pose so far from the truth, metres, is at another place.
const SAME_PLACE: f64 = 5.0;

/// A pose's error, and what its covariance says of it. Components: x, y, z of the query's centroid in map axes, metres, and the angles about
/// them, radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseError {
    /// The perturbation that takes the pose to the truth.
    pub error: [f64; 6],
    /// By the covariance answered.
    pub covariance: Uncertainty,
    /// By the inverse Hessian of a point-to-plane fit, were its residuals independent.
    pub inverse_hessian: Option<Uncertainty>,
}

/// What one covariance says.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Standard deviation of each component.
    pub sigma: [f64; 6],
    /// The error's square in units of the covariance (NEES).
    pub nees: f64,
}

impl Uncertainty {
    fn of(covariance: &Covariance, error: [f64; 6]) -> Option<Self> {
        Some(Self {
            sigma: std::array::from_fn(|i| covariance.matrix[i][i].sqrt()),
            nees: covariance.nees(error).filter(|s| s.is_finite())?,
        })
    }
}

impl PoseError {
    /// Of a pose with its covariance and what a point-to-plane fit says there, given the true `map_from_query` and the query's centroid in its own
    /// frame. `None` where the covariance is not positive definite.
    #[must_use]
    pub fn of(
        map_from_query: &Pose,
        covariance: &Covariance,
        information: Option<&Information>,
        truth: &Pose,
        centroid: [f64; 3],
    ) -> Option<Self> {
        let error = perturbation(map_from_query, truth, centroid);
        Some(Self {
            error,
            covariance: Uncertainty::of(covariance, error)?,
            inverse_hessian: information
                .and_then(|i| Uncertainty::of(&inverse_hessian(i)?.about(covariance.about), error)),
        })
    }
}

/// Errors in units of one kind of covariance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Covered {
    /// Mean NEES, 6 where the covariance is right.
    pub mean_nees: f64,
    /// Median NEES, 5.35 where it is right.
    pub median_nees: f64,
    /// Share of each component's errors within one standard deviation, 0.683 where it is right.
    pub within_one: [f64; 6],
    /// Within two, 0.954.
    pub within_two: [f64; 6],
}

impl Covered {
    fn of(errors: &[([f64; 6], Uncertainty)]) -> Option<Self> {
        let squares: Vec<f64> = errors.iter().map(|(_, s)| s.nees).collect();
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let n = errors.len() as f64;
        let within = |most: f64| {
            std::array::from_fn(|i| {
                let inside = |(e, s): &&([f64; 6], Uncertainty)| e[i].abs() <= most * s.sigma[i];
                #[expect(clippy::cast_precision_loss, reason = "a count")]
                let count = errors.iter().filter(inside).count() as f64;
                count / n
            })
        };
        Some(Self {
            median_nees: quantile(&squares, 0.5)?,
            mean_nees: squares.iter().sum::<f64>() / n,
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
    /// Located.
    pub located: usize,
    /// Of these, those that lie within 5 m of the truth and have a covariance: they are what is looked at. A wrong place is not for a covariance to
    /// cover.
    pub answers: usize,
    /// By the covariance answered.
    pub answered: Covered,
    /// By the plain inverse Hessian.
    pub inverse_hessian: Option<Covered>,
}

impl Coverage {
    /// Of the runs given; `None` where none of them located has a covariance.
    #[must_use]
    pub fn of(method: &str, family: Option<&str>, runs: &[&Run]) -> Option<Self> {
        let located: Vec<&&Run> = runs
            .iter()
            .filter(|r| r.verdict == Some(Verdict::Located) && r.mark.has_truth)
            .collect();
        let same_place = |e: &PoseError| norm([e.error[0], e.error[1], e.error[2]]) < SAME_PLACE;
        let errors: Vec<PoseError> = located
            .iter()
            .filter_map(|r| r.pose_error)
            .filter(same_place)
            .collect();
        let answered: Vec<_> = errors.iter().map(|d| (d.error, d.covariance)).collect();
        let inverse: Vec<_> = errors
            .iter()
            .filter_map(|d| Some((d.error, d.inverse_hessian?)))
            .collect();
        Some(Self {
            method: method.to_owned(),
            family: family.map(ToOwned::to_owned),
            located: located.len(),
            answers: errors.len(),
            answered: Covered::of(&answered)?,
            inverse_hessian: Covered::of(&inverse),
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
        let mark = Mark {
            has_truth: true,
            ..Mark::default()
        };
        Run {
            pose_error: Some(PoseError {
                error,
                covariance: Uncertainty::of(&covariance, error).unwrap(),
                inverse_hessian: None,
            }),
            ..run("auto", "a", crate::evaluation::Class::Right, mark)
        }
    }

    #[test]
    fn an_error_of_an_outcome_by_hand() {
        let pose = Pose::from_rotation_vector([0.1, 0.2, 0.3], [5.0, 6.0, 7.0]);
        let middle = [1.0, 2.0, 3.0];
        let about = pose.transform(middle);
        let mut matrix = [[0.0; 6]; 6];
        (0..6).for_each(|i| matrix[i][i] = 0.01);
        let truth = pose.perturbed([0.0, 0.3, 0.0], [0.0; 3], about);
        let of = |matrix| {
            let covariance = Covariance { matrix, about };
            PoseError::of(&pose, &covariance, None, &truth, middle)
        };
        let error = of(matrix).unwrap();
        assert!((error.error[1] - 0.3).abs() < 1e-9 && error.error[0].abs() < 1e-9);
        assert!((error.covariance.nees - 9.0).abs() < 1e-6, "{error:?}");
        matrix[2][2] = f64::NAN;
        assert_eq!(of(matrix), None);
    }

    #[test]
    fn coverage_by_hand() {
        let elsewhere = erring(90.0, 0.1);
        let mut mute = erring(0.1, 0.1);
        mute.pose_error = None;
        let runs = [
            erring(0.05, 0.1),
            erring(-0.15, 0.1),
            erring(0.4, 0.1),
            elsewhere,
            mute,
        ];
        let all = coverages(&runs);
        let c = &all[0];
        assert_eq!((c.located, c.answers), (5, 3), "a wrong place is no error");
        assert_eq!(c.inverse_hessian, None);
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(
            close(c.answered.mean_nees, (0.25 + 2.25 + 16.0) / 3.0),
            "{c:?}"
        );
        assert!(close(c.answered.median_nees, 2.25));
        assert!(close(c.answered.within_one[0], 1.0 / 3.0));
        assert!(close(c.answered.within_two[0], 2.0 / 3.0));
        assert!(close(c.answered.within_one[5], 1.0));
    }
}
