//! What the local refiners have in common.

use crate::config::VerifyConfig;
use crate::icp::Information;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::verify::{self, Candidate};

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
    /// It gained no more than noise gives on the pose that it began with, which was kept.
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
            Self::NoBetter => "nothing gained, and the earlier pose was kept",
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

/// Standard errors by which a refiner must gain. Neighbouring points err together, so that one of independent points
/// says too little; less than this is what noise gives, which along a wall lets a pose slide by centimetres.
const SIGNIFICANT: f64 = 2.0;

/// The pose `after` a refiner, where the query lies more finely on the map there than at the one `before` it, by
/// [`Fit::bounded_residual`](crate::verify::Fit) and by more than noise gives; else the earlier one, with
/// [`StopReason::NoBetter`].
///
/// Point-to-point ICP needs it: its optimum is not the truth, so a pose that NDT has made good
/// leaves it worse (`docs/refinement.md`).
#[must_use]
pub fn keep_better(
    map: &Surface<'_>,
    query: &Surface<'_>,
    before: Candidate,
    after: Candidate,
    config: &VerifyConfig,
) -> Candidate {
    let poses = (&before.map_from_query, &after.map_from_query);
    // Most that gained nothing need no closer look.
    if before.fit.bounded_residual > after.fit.bounded_residual {
        let (gain, error) = verify::gain(map, query, poses, config);
        if gain > SIGNIFICANT * error {
            return after;
        }
    }
    Candidate {
        stop: Some(StopReason::NoBetter),
        ..before
    }
}

/// At most `limit` points (0: all), evenly spaced in the order given.
pub(crate) fn sample(points: &[[f32; 3]], limit: usize) -> Vec<[f32; 3]> {
    let stride = stride(points.len(), limit);
    points.iter().step_by(stride).copied().collect()
}

/// How many of `count` points [`sample`] takes.
pub(crate) fn sampled(count: usize, limit: usize) -> usize {
    count.div_ceil(stride(count, limit))
}

fn stride(count: usize, limit: usize) -> usize {
    if limit == 0 {
        1
    } else {
        count.div_ceil(limit).max(1)
    }
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
    use crate::config::{IcpConfig, IcpMetric, NdtConfig};
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};
    use crate::{icp, ndt};

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
            let still = verify::gain(&map, &query, (&start, &start), &VerifyConfig::default());
            assert_eq!(still, (0.0, 0.0));
            let config = NdtConfig::default();
            let levels = ndt::levels(&map, &config);
            let candidate = |r: &Refined| {
                let (pose, stop) = (&r.map_from_query, Some(r.stop));
                verify::candidate(&map, &query, pose, stop, &VerifyConfig::default())
            };
            let error = |c: &Candidate| c.map_from_query.distance(&truth, centroid).translation;
            let by_ndt = candidate(&ndt::align(&levels, &map, &query, &start, &config));
            assert!(error(&by_ndt) < 0.03, "{seed}: {}", error(&by_ndt));
            let (finer, error_of_it) = verify::gain(
                &map,
                &query,
                (&start, &by_ndt.map_from_query),
                &VerifyConfig::default(),
            );
            assert!(finer > 20.0 * error_of_it, "{finer} {error_of_it}");
            for metric in [
                IcpMetric::PointToPoint,
                IcpMetric::PointToPlane,
                IcpMetric::Generalized,
            ] {
                let config = IcpConfig {
                    metric,
                    ..IcpConfig::default()
                };
                let by_icp = candidate(&icp::align(&map, &query, &by_ndt.map_from_query, &config));
                let kept = keep_better(&map, &query, by_ndt, by_icp, &VerifyConfig::default());
                let (before, after) = (error(&by_ndt), error(&by_icp));
                assert!(
                    error(&kept) < before + 0.002,
                    "{metric} {seed}: {before}, after {after}"
                );
                harmed += u32::from(after > before + 0.004);
                // From afar it is followed.
                let far = Refined::start(&start);
                let near = candidate(&icp::align(&map, &query, &start, &config));
                let kept = keep_better(
                    &map,
                    &query,
                    candidate(&far),
                    near,
                    &VerifyConfig::default(),
                );
                bettered += u32::from(kept == near && error(&near) < 0.05);
            }
        }
        assert!(harmed >= 3, "point-to-point ICP alone harms: {harmed}");
        assert!(bettered >= 6, "what helps is taken: {bettered}");
    }

    /// Along a flat wall every pose lies as finely as the next but for noise, which one of the two always favours.
    #[test]
    fn noise_does_not_move_a_pose_along_a_wall() {
        let config = VerifyConfig::default();
        let seeds = 20;
        let mut moved = 0;
        for seed in 0..seeds {
            let mut rng = Rng::new(seed, 9);
            // Turned, so that the two clouds' voxels meet by chance.
            let own = Pose::from_rotation_vector([0.0, 0.7, 0.0], [0.33, 0.0, 0.0]);
            let mut wall = |wide: f64, frame: Pose| {
                let points: Vec<_> = (0..20_000)
                    .map(|_| {
                        let noise = 0.01 * rng.normal();
                        frame.transform([rng.range(-wide, wide), noise, rng.range(-2.0, 2.0)])
                    })
                    .collect();
                surface(&points, 0.1)
            };
            let (map, query) = (wall(5.0, Pose::default()), wall(3.0, own));
            let at = |x| {
                let pose = Pose::from_translation([x, 0.0, 0.0]).compose(&own.inverse());
                verify::candidate(&map, &query, &pose, None, &config)
            };
            let (one, other) = (at(0.0), at(0.03));
            assert_ne!(one.fit.bounded_residual, other.fit.bounded_residual);
            for (before, after) in [(one, other), (other, one)] {
                let kept = keep_better(&map, &query, before, after, &config);
                moved += usize::from(kept.map_from_query != before.map_from_query);
            }
        }
        // The finer of two would have moved once a seed; chance exceeds two standard errors once in twenty.
        assert!(moved <= 4, "{moved} of {seeds}");
    }
}
