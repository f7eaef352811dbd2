//! Iterative closest point: point-to-point (Besl & McKay 1992), point-to-plane (Chen & Medioni 1992) and generalized, plane to
//! plane (Segal, Haehnel & Thrun 2009).
//!
//! Each iteration pairs every query point with its nearest map point within a distance that shrinks
//! from generous to tight, weighs the pairs by a robust kernel and steps to the least-squares
//! pose: in closed form for point-to-point, one Gauss-Newton step for the other two.
//! Directions that the pairs say nothing at all about are left where they were; in those that they say
//! little about (along a bare tunnel) noise decides, and [`degeneracy`](crate::degeneracy) tells.

mod metrics;
mod pairs;

use crate::config::{IcpConfig, IcpMetric, Kernel};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{Refined, StopReason, sample, spread};
use crate::vec3::{cross, dot, sub};

use metrics::Problem;
use pairs::{Pairing, trim};

/// Directions with less than this share of the largest curvature get no step.
const CURVATURE_FLOOR: f64 = 1e-6;

/// Refines `start` (`map_from_query`) by ICP. Distances count in multiples of the map's voxel size.
#[must_use]
pub fn align(map: &Surface<'_>, query: &Surface<'_>, start: &Pose, config: &IcpConfig) -> Refined {
    let chosen = sample(&query.points, config.max_points);
    let normals = match config.metric {
        IcpMetric::Generalized => sample(&query.normals, config.max_points),
        IcpMetric::PointToPoint | IcpMetric::PointToPlane => Vec::new(),
    };
    let (centroid, length) = spread(&chosen);
    let mut pose = start.between_origins(map.origin, query.origin);
    let mut pairing = Pairing::new(map, &chosen);
    let last = config.final_distance.metres(map.voxel);
    let mut distance = config.max_distance.metres(map.voxel).max(last);
    let mut refined = Refined::start(start);
    for iteration in 1..=config.max_iterations {
        let mut pairs = pairing.at(&pose, distance);
        trim(&mut pairs, config.trim);
        refined.pairs = pairs.len();
        refined.iterations = iteration;
        if pairs.len() < config.min_pairs {
            refined.stop = StopReason::TooFewPairs;
            break;
        }
        let problem = Problem {
            map,
            query: &chosen,
            normals: &normals,
            pairs: &pairs,
            pose: &pose,
            centroid,
            kernel: config.kernel,
            scale: config.kernel_scale * distance,
        };
        let system = match config.metric {
            IcpMetric::PointToPoint => None,
            IcpMetric::PointToPlane => Some(problem.point_to_plane()),
            IcpMetric::Generalized => Some(problem.generalized()),
        };
        let next = match system {
            None => problem.point_to_point(),
            Some(system) => system.step(length, CURVATURE_FLOOR).map(|s| {
                let centre = pose.transform(centroid);
                pose.perturbed([s[0], s[1], s[2]], [s[3], s[4], s[5]], centre)
            }),
        };
        let Some(next) = next else {
            refined.stop = StopReason::Degenerate;
            break;
        };
        let step = pose.distance(&next, centroid);
        pose = next;
        let settled = step.translation < config.translation_epsilon
            && step.rotation < config.rotation_epsilon;
        if settled && distance <= last {
            refined.stop = StopReason::Converged;
            break;
        }
        // A pose that still moves by a good part of the bound needs its distant pairs.
        if step.translation + length * step.rotation < 0.1 * distance {
            distance = (distance * config.shrink).max(last);
        }
    }
    refined.map_from_query = pose.from_between_origins(map.origin, query.origin);
    refined.information = about(
        &mut pairing,
        centroid,
        query.origin,
        &refined.map_from_query,
        last,
    );
    refined
}

/// The 6×6 information matrix `Σ JᵀJ` of a point-to-plane fit of `query` on `map` at `map_from_query`,
/// for steps `[δt, δθ]` about the query's centroid in map axes, with the mean square residual of
/// its pairs.
///
/// In units of one residual variance: divide by the variance for an inverse covariance, and mind
/// that neighbouring points do not err independently. Pairs further apart than `distance` metres
/// do not count.
#[must_use]
pub fn information(
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    distance: f64,
    max_points: usize,
) -> Information {
    let chosen = sample(&query.points, max_points);
    let (centroid, _) = spread(&chosen);
    let mut pairing = Pairing::new(map, &chosen);
    about(
        &mut pairing,
        centroid,
        query.origin,
        map_from_query,
        distance,
    )
}

/// See [`information`]; `origin` is that of the query's offsets, `centroid` one of them.
fn about(
    pairing: &mut Pairing<'_>,
    centroid: [f64; 3],
    origin: [f64; 3],
    map_from_query: &Pose,
    distance: f64,
) -> Information {
    let (map, query) = (pairing.map(), pairing.query());
    let pose = map_from_query.between_origins(map.origin, origin);
    let pairs = pairing.at(&pose, distance);
    let problem = Problem {
        map,
        query,
        normals: &[],
        pairs: &pairs,
        pose: &pose,
        centroid,
        kernel: Kernel::None,
        scale: 1.0,
    };
    let system = problem.point_to_plane();
    let centre = pose.transform(centroid);
    Information {
        moments: problem.moments(),
        matrix: system.matrix(),
        about: std::array::from_fn(|a| centre[a] + map.origin[a]),
        pairs: system.count,
        residual_variance: system.cost / system.weight.max(1.0),
    }
}

/// One residual of a point-to-plane fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Row {
    /// The query point at the pose, as an offset in the map.
    pub(crate) at: [f64; 3],
    /// How the residual changes with a step `[δt, δθ]` about the query's centroid.
    pub(crate) jacobian: [f64; 6],
    /// Distance from the tangent plane, metres, signed.
    pub(crate) residual: f64,
}

/// The residuals of [`information`], one by one, and what they were taken from.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    pub(crate) rows: Vec<Row>,
    /// The query's points at the pose, paired or not, as offsets in the map.
    pub(crate) points: Vec<[f64; 3]>,
    /// Their centroid.
    pub(crate) centre: [f64; 3],
    /// Their root mean square distance from it.
    pub(crate) length: f64,
}

/// See [`Rows`].
pub(crate) fn rows(
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    distance: f64,
    max_points: usize,
) -> Rows {
    let chosen = sample(&query.points, max_points);
    let (centroid, length) = spread(&chosen);
    let pose = map_from_query.between_origins(map.origin, query.origin);
    let centre = pose.transform(centroid);
    let pairs = Pairing::new(map, &chosen).at(&pose, distance);
    let points: Vec<_> = chosen
        .iter()
        .map(|p| pose.transform(p.map(f64::from)))
        .collect();
    Rows {
        rows: pairs
            .iter()
            .filter_map(|p| row(map, points[p.query as usize], p.map as usize, centre))
            .collect(),
        points,
        centre,
        length,
    }
}

/// The residual of a point at `moved` and its nearest map point; `None` where that has no normal.
fn row(map: &Surface<'_>, moved: [f64; 3], nearest: usize, centre: [f64; 3]) -> Option<Row> {
    let n = map.normals[nearest].map(f64::from);
    if n == [0.0; 3] {
        return None;
    }
    let d = sub(moved, map.points[nearest].map(f64::from));
    // n · (θ × a) = θ · (a × n)
    let turn = cross(sub(moved, centre), n);
    Some(Row {
        at: moved,
        jacobian: [n[0], n[1], n[2], turn[0], turn[1], turn[2]],
        residual: dot(n, d),
    })
}

/// What a point-to-plane fit says about the pose, see [`information`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Information {
    /// `Σ JᵀJ`, ordered δt, δθ: counts, m, m².
    pub matrix: [[f64; 6]; 6],
    /// The point that rotations turn about, map frame, metres.
    pub about: [f64; 3],
    /// Second moments of the paired query points about that point, map axes, m².
    pub moments: [[f64; 3]; 3],
    /// Pairs that took part.
    pub pairs: usize,
    /// Mean square point-to-plane distance of the pairs, m².
    pub residual_variance: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};

    fn start(seed: u64) -> Pose {
        let mut rng = Rng::new(seed, 0);
        let d = rng.direction();
        let r = rng.direction();
        Pose::identity().perturbed(d.map(|v| 0.4 * v), r.map(|v| 0.06 * v), [5.0, 0.0, 0.0])
    }

    fn error(found: &Refined) -> (f64, f64) {
        let d = found
            .map_from_query
            .distance(&Pose::identity(), [5.0, 0.0, 0.0]);
        (d.translation, d.rotation)
    }

    #[test]
    fn all_metrics_come_home_from_half_a_metre() {
        let map = surface(&drift(80_000, 14.0, 0.3, 0.01, 1), 0.15);
        // In a frame of its own: two clouds thinned on one grid lock into each other.
        let own = Pose::from_rotation_vector([0.2, 0.5, 1.0], [3.0, -2.0, 1.0]);
        let turned: Vec<[f64; 3]> = drift(50_000, 10.0, 0.3, 0.01, 2)
            .iter()
            .map(|p| own.transform(*p))
            .collect();
        let query = surface(&turned, 0.15);
        for (metric, limit) in [
            (IcpMetric::PointToPlane, 0.01),
            (IcpMetric::Generalized, 0.01),
            (IcpMetric::PointToPoint, 0.06),
        ] {
            for seed in 0..6 {
                let config = IcpConfig {
                    metric,
                    max_distance: crate::config::Length::Metres(1.0),
                    max_iterations: 200,
                    ..IcpConfig::default()
                };
                let mut found = align(&map, &query, &start(seed).compose(&own.inverse()), &config);
                found.map_from_query = found.map_from_query.compose(&own);
                let (t, r) = error(&found);
                assert!(
                    t < limit && r < limit,
                    "{metric} {seed}: {t} m, {r} rad, {}",
                    found.stop
                );
                assert_eq!(found.stop, StopReason::Converged);
            }
        }
    }

    #[test]
    fn kernels_and_trimming_resist_a_second_wall() {
        let map = surface(&drift(80_000, 14.0, 0.3, 0.01, 1), 0.15);
        let mut points = drift(50_000, 10.0, 0.3, 0.01, 2);
        // A fifth of the query is something that stands in front of the wall today.
        let n = points.len();
        for p in &mut points[..n / 5] {
            p[1] *= 0.9;
            p[2] *= 0.9;
            p[0] += 0.1;
        }
        let query = surface(&points, 0.15);
        let run = |metric, kernel, trim| {
            let config = IcpConfig {
                metric,
                kernel,
                trim,
                final_distance: crate::config::Length::Metres(0.5),
                ..IcpConfig::default()
            };
            error(&align(&map, &query, &start(1), &config)).0
        };
        for metric in [IcpMetric::PointToPlane, IcpMetric::Generalized] {
            let plain = run(metric, Kernel::None, 1.0);
            assert!(plain > 0.03, "the second wall must hurt: {plain}");
            for (kernel, trim) in [
                (Kernel::GemanMcClure, 1.0),
                (Kernel::Huber, 1.0),
                (Kernel::GemanMcClure, 0.7),
            ] {
                let robust = run(metric, kernel, trim);
                // Planes that turn with the query pull on longer: 0.7 to 0.9 of it remains.
                let share = if metric == IcpMetric::Generalized {
                    0.92
                } else {
                    0.75
                };
                assert!(
                    robust < share * plain,
                    "{metric} {kernel} {trim}: {robust}, without {plain}"
                );
            }
        }
    }

    #[test]
    fn along_a_bare_tunnel_nothing_is_moved() {
        let map = surface(&drift(80_000, 40.0, 0.0, 0.0, 1), 0.15);
        let inside: Vec<[f64; 3]> = drift(80_000, 40.0, 0.0, 0.0, 2)
            .into_iter()
            .filter(|p| p[0] > 15.0 && p[0] < 25.0)
            .collect();
        let query = surface(&inside, 0.15);
        let config = IcpConfig {
            metric: IcpMetric::PointToPlane,
            ..IcpConfig::default()
        };
        let start = Pose::from_translation([0.3, 0.1, 0.0]);
        let found = align(&map, &query, &start, &config);
        let t = found.map_from_query.translation();
        assert!((t[0] - 0.3).abs() < 0.1 && t[1].abs() < 0.02, "{t:?}");
    }

    #[test]
    fn far_away_and_empty_clouds_stop_with_a_reason() {
        let map = surface(&drift(20_000, 10.0, 0.3, 0.0, 1), 0.2);
        let far = Pose::from_translation([500.0, 0.0, 0.0]);
        let found = align(&map, &map, &far, &IcpConfig::default());
        assert_eq!(
            (found.stop, found.map_from_query),
            (StopReason::TooFewPairs, far)
        );
        let nothing = Surface::default();
        assert_eq!(
            align(&map, &nothing, &far, &IcpConfig::default()).stop,
            StopReason::TooFewPairs
        );
        assert_eq!(
            align(&nothing, &map, &far, &IcpConfig::default()).stop,
            StopReason::TooFewPairs
        );
    }

    #[test]
    fn the_plane_jacobian_is_that_of_finite_differences() {
        let map = surface(&drift(20_000, 10.0, 0.3, 0.0, 1), 0.2);
        let query = surface(&drift(9_000, 10.0, 0.3, 0.01, 2), 0.2);
        let pose = Pose::from_rotation_vector([0.01, 0.0, 0.02], [0.02, 0.01, 0.0]);
        let (centroid, _) = spread(&query.points);
        let pairs = Pairing::new(&map, &query.points).at(&pose, 0.3);
        let centre = pose.transform(centroid);
        let problem = Problem {
            map: &map,
            query: &query.points,
            normals: &query.normals,
            pairs: &pairs,
            pose: &pose,
            centroid,
            kernel: Kernel::None,
            scale: 1.0,
        };
        let system = problem.point_to_plane();
        // The pairs held fixed, the cost under a small step.
        let cost = |step: [f64; 6]| -> f64 {
            let moved = pose.perturbed(
                [step[0], step[1], step[2]],
                [step[3], step[4], step[5]],
                centre,
            );
            pairs
                .iter()
                .map(|p| {
                    let at = moved.transform(query.points[p.query as usize].map(f64::from));
                    let (q, n) = (map.points[p.map as usize], map.normals[p.map as usize]);
                    (0..3)
                        .map(|a| (at[a] - f64::from(q[a])) * f64::from(n[a]))
                        .sum::<f64>()
                        .powi(2)
                })
                .sum()
        };
        for i in 0..6 {
            let h = 1e-5;
            let (mut up, mut down) = ([0.0; 6], [0.0; 6]);
            up[i] = h;
            down[i] = -h;
            let numeric = (cost(up) - cost(down)) / (2.0 * h);
            assert!(
                (numeric - 2.0 * system.g[i]).abs() < 1e-3 * (1.0 + numeric.abs()),
                "{i}: {numeric} {}",
                2.0 * system.g[i]
            );
        }
    }
}
