//! What the local refiners have in common.

use crate::icp::Information;
use crate::pose::Pose;
use crate::verify::Candidate;

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
    /// It led to a pose that lies less finely on the map than the one it began with, which was kept.
    NoBetter,
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::MaxIterations => "iterations ran out",
            Self::TooFewPairs => "too few query points near the map",
            Self::Degenerate => "no direction could be solved for",
            Self::NoImprovement => "no step improved the score",
            Self::NoBetter => "it was finer before, and that pose was kept",
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

/// Of a pose `before` a refiner and the one `after` it, the one that lies more finely on the map, by
/// [`Fit::bounded_residual`](crate::verify::Fit); where that is the earlier one,
/// [`StopReason::NoBetter`] stands with it.
///
/// Point-to-point ICP needs it: its optimum is not the truth, so a pose that NDT has made good
/// leaves it worse (`docs/refinement.md`).
#[must_use]
pub fn keep_better(before: Candidate, after: Candidate) -> Candidate {
    if before.fit.bounded_residual < after.fit.bounded_residual {
        Candidate {
            stop: Some(StopReason::NoBetter),
            ..before
        }
    } else {
        after
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{IcpConfig, IcpMetric, NdtConfig, VerifyConfig};
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};
    use crate::{icp, ndt, verify};

    /// A drift's first 16 m as the map, metres 6 to 22 of it as the query: a third of that is not
    /// in the map.
    #[test]
    fn what_icp_makes_worse_is_left_as_ndt_made_it() {
        let (mut harmed, mut bettered) = (0, 0);
        for seed in 0..4u32 {
            let rough = 0.3 + 0.05 * f64::from(seed);
            let draw = u64::from(2 * seed);
            let walls = |n, draw| drift(n, 22.0, rough, 0.01, draw).into_iter();
            let map: Vec<_> = walls(90_000, draw).filter(|p| p[0] < 16.0).collect();
            let query: Vec<_> = walls(60_000, draw + 1).filter(|p| p[0] > 6.0).collect();
            let own = Pose::from_rotation_vector([0.2, 0.5, 1.0], [3.0, -2.0, 1.0]);
            let query: Vec<_> = query.iter().map(|p| own.transform(*p)).collect();
            let (map, query) = (surface(&map, 0.2), surface(&query, 0.2));
            let truth = own.inverse();
            let centroid = query.centroid().unwrap();
            let mut rng = Rng::new(u64::from(seed), 5);
            let start = truth.perturbed(
                rng.direction().map(|v| 0.3 * v),
                rng.direction().map(|v| 0.04 * v),
                truth.transform(centroid),
            );
            let config = NdtConfig::default();
            let levels = ndt::levels(&map, &config);
            let candidate = |r: &Refined| Candidate {
                map_from_query: r.map_from_query,
                fit: verify::fit(&map, &query, &r.map_from_query, &VerifyConfig::default()),
                stop: Some(r.stop),
            };
            let error = |c: &Candidate| c.map_from_query.distance(&truth, centroid).translation;
            let by_ndt = candidate(&ndt::align(&levels, &map, &query, &start, &config));
            assert!(error(&by_ndt) < 0.03, "{seed}: {}", error(&by_ndt));
            for metric in [IcpMetric::PointToPoint, IcpMetric::PointToPlane] {
                let config = IcpConfig {
                    metric,
                    ..IcpConfig::default()
                };
                let by_icp = candidate(&icp::align(&map, &query, &by_ndt.map_from_query, &config));
                let kept = keep_better(by_ndt, by_icp);
                let (before, after) = (error(&by_ndt), error(&by_icp));
                assert!(
                    error(&kept) < before + 0.002,
                    "{metric} {seed}: {before}, after {after}"
                );
                harmed += u32::from(after > before + 0.004);
                bettered += u32::from(kept == by_icp && after < before);
            }
        }
        assert!(harmed >= 3, "point-to-point ICP alone harms: {harmed}");
        assert!(bettered >= 2, "what helps is taken: {bettered}");
    }

    #[test]
    fn the_finer_pose_is_kept_and_the_later_of_two_equals() {
        let at = |x: f64, bounded_residual: f64| Candidate {
            map_from_query: Pose::from_translation([x, 0.0, 0.0]),
            fit: verify::Fit {
                overlap: 1.0,
                fitness: 1.0,
                median_point_to_plane: 0.01,
                bounded_residual,
                inlier_fraction: 1.0,
            },
            stop: Some(StopReason::Converged),
        };
        let (before, coarser, equal, finer) =
            (at(0.0, 0.02), at(1.0, 0.03), at(2.0, 0.02), at(3.0, 0.01));
        let kept = keep_better(before, coarser);
        assert_eq!(
            (kept.map_from_query, kept.fit, kept.stop),
            (
                before.map_from_query,
                before.fit,
                Some(StopReason::NoBetter)
            )
        );
        assert_eq!(keep_better(before, equal), equal);
        assert_eq!(keep_better(before, finer), finer);
    }
}
