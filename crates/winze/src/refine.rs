//! What the local refiners have in common.

use crate::icp::Information;
use crate::pose::Pose;

/// Why a refiner stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum StopReason {
    /// The last step was smaller than the limits.
    Converged,
    /// The iterations ran out while the pose still moved.
    MaxIterations,
    /// Too few query points were near the map to go on; the pose is where that happened.
    TooFewPairs,
    /// No direction could be solved for.
    Degenerate,
    /// No step along the search direction improved the score.
    NoImprovement,
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::MaxIterations => "iterations ran out",
            Self::TooFewPairs => "too few query points near the map",
            Self::Degenerate => "no direction could be solved for",
            Self::NoImprovement => "no step improved the score",
        })
    }
}

/// A refined pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// Takes query points to the map.
    pub map_from_query: Pose,
    /// Why it stopped.
    pub stop: StopReason,
    /// Iterations done.
    pub iterations: usize,
    /// Query points that took part in the last one.
    pub pairs: usize,
    /// What a point-to-plane fit says about the pose it stopped at, whatever it minimised itself.
    pub information: Information,
}

impl Refined {
    pub(crate) fn start(pose: &Pose) -> Self {
        Self {
            map_from_query: *pose,
            stop: StopReason::MaxIterations,
            iterations: 0,
            pairs: 0,
            information: Information::default(),
        }
    }
}

/// At most `limit` points (0: all), evenly spaced in the order given.
pub(crate) fn sample(points: &[[f32; 3]], limit: usize) -> Vec<[f32; 3]> {
    let stride = if limit == 0 {
        1
    } else {
        points.len().div_ceil(limit).max(1)
    };
    points.iter().step_by(stride).copied().collect()
}

/// Mean of the points and their root mean square distance from it (at least a millimetre), the
/// arm on which a rotation works.
pub(crate) fn spread(points: &[[f32; 3]]) -> ([f64; 3], f64) {
    let Some(centre) = crate::cloud::centroid(points) else {
        return ([0.0; 3], 1.0);
    };
    let mut sum = 0.0;
    for p in points {
        for a in 0..3 {
            let d = f64::from(p[a]) - centre[a];
            sum += d * d;
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let length = (sum / points.len() as f64).sqrt().max(1e-3);
    (centre, length)
}
