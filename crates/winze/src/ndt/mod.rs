//! The normal distributions transform, point to distribution (Magnusson 2009, chapter 6).
//!
//! The map becomes one Gaussian a cell; the pose climbs the likelihood of the query's points under
//! them. Each cell's likelihood is a Gaussian mixed with a uniform outlier density, approximated by
//! `−d1 exp(−d2/2 · xᵀΣ⁻¹x)` (equations 6.8 to 6.10), with an analytic gradient and Hessian and Newton
//! steps under a line search, from coarse cells to fine ones: no single resolution decides.
//!
//! [`NdtForm::Plain`] is the paper's form: the bare Gaussian and gradient ascent.

mod cells;
mod score;

pub use cells::{Gaussian, NdtCells, NdtColumns, cells_in};

use crate::config::{NdtConfig, NdtForm};
use crate::icp;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{Refined, StopReason, sample, spread};
use crate::solve::System;
use crate::voxel::FINEST;

use score::Score;

/// Refines `start` (`map_from_query`) by NDT over `levels`, coarse to fine (see [`levels`]).
///
/// `pairs` of the answer counts the query points that met a Gaussian at the finest level.
#[must_use]
pub fn align(
    levels: &[NdtCells<'_>],
    map: &Surface<'_>,
    query: &Surface<'_>,
    start: &Pose,
    config: &NdtConfig,
) -> Refined {
    let chosen = sample(&query.points, config.max_points);
    let (centroid, length) = spread(&chosen);
    let mut pose = start.between_origins(map.origin, query.origin);
    let mut refined = Refined::start(start);
    for cells in levels {
        let problem = Problem {
            cells,
            points: &chosen,
            centroid,
            length,
            config,
        };
        let (at, iterations, stop) = match config.form {
            NdtForm::Mixture => problem.newton(pose),
            NdtForm::Plain => problem.gradient_ascent(pose),
        };
        pose = at.pose;
        refined.iterations += iterations;
        refined.stop = stop;
        refined.pairs = at.system.count;
    }
    refined.map_from_query = pose.from_between_origins(map.origin, query.origin);
    let reach = 0.5 * config.finest.metres(map.voxel);
    refined.information = icp::information(
        map,
        query,
        &refined.map_from_query,
        reach,
        config.max_points,
    );
    refined
}

/// The Gaussians of `map` at every resolution that `config` asks for, coarsest first.
#[must_use]
pub fn levels(map: &Surface<'_>, config: &NdtConfig) -> Vec<NdtCells<'static>> {
    let build = |s| NdtCells::build(&map.points, s, config.min_points, config.eigenvalue_floor);
    sizes(map.voxel, config).into_iter().map(build).collect()
}

/// The cell sizes that `config` asks for of a map thinned to `voxel` metres, coarsest first, metres.
#[must_use]
pub fn sizes(voxel: f64, config: &NdtConfig) -> Vec<f64> {
    let finest = config.finest.metres(voxel).max(FINEST);
    let mut size = config.coarsest.metres(voxel).max(finest);
    let mut sizes = vec![size];
    while size > 1.5 * finest {
        size = (0.5 * size).max(finest);
        sizes.push(size);
    }
    sizes
}

/// A pose, with the score and its derivatives there.
struct At {
    pose: Pose,
    system: System,
}

/// One resolution's optimisation.
struct Problem<'a> {
    cells: &'a NdtCells<'a>,
    points: &'a [[f32; 3]],
    centroid: [f64; 3],
    length: f64,
    config: &'a NdtConfig,
}

impl Problem<'_> {
    /// `d1` (as a positive height) and `d2` of the score's bell.
    fn bell(&self) -> (f64, f64) {
        match self.config.form {
            NdtForm::Plain => (1.0, 1.0),
            NdtForm::Mixture => {
                let outliers = self.config.outlier_ratio;
                let size = self.cells.size;
                // Equation 6.8: densities of inliers and outliers over the cell; the factor 10 is
                // Magnusson's scale of the inlier density.
                let c1 = 10.0 * (1.0 - outliers);
                let c2 = outliers / (size * size * size);
                let d3 = -libm::log(c2);
                let d1 = -libm::log(c1 + c2) - d3;
                let half = libm::exp(-0.5);
                let d2 = -2.0 * libm::log((-libm::log(c1 * half + c2) - d3) / d1);
                (-d1, d2)
            }
        }
    }

    /// The pose with the score's negative as `cost`, its gradient and Hessian about the moved centroid, and the number of points that
    /// met a Gaussian.
    fn at(&self, pose: Pose) -> At {
        let (height, d2) = self.bell();
        let score = Score {
            cells: self.cells,
            points: self.points,
            centroid: self.centroid,
            neighbours: self.config.neighbours,
            height,
            d2,
        };
        let system = score.derivatives(&pose);
        At { pose, system }
    }

    fn moved(&self, pose: &Pose, step: &[f64; 6], by: f64) -> Pose {
        let s = step.map(|v| v * by);
        pose.perturbed(
            [s[0], s[1], s[2]],
            [s[3], s[4], s[5]],
            pose.transform(self.centroid),
        )
    }

    /// How far a step moves a typical point, metres.
    fn reach(&self, step: &[f64; 6]) -> f64 {
        let norm = |v: &[f64]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        norm(&step[..3]) + self.length * norm(&step[3..])
    }

    fn settled(&self, step: &[f64; 6]) -> bool {
        let norm = |v: &[f64]| v.iter().map(|c| c * c).sum::<f64>().sqrt();
        norm(&step[..3]) < self.config.translation_epsilon
            && norm(&step[3..]) < self.config.rotation_epsilon
    }

    /// Newton's method; indefinite Hessians are made positive, steps are kept within half a cell
    /// and halved until the score improves (Armijo).
    fn newton(&self, start: Pose) -> (At, usize, StopReason) {
        let mut at = self.at(start);
        for iteration in 1..=self.config.max_iterations {
            let system = &at.system;
            if system.count < self.config.min_pairs {
                return (at, iteration, StopReason::TooFewPairs);
            }
            let Some(mut step) = system.step(self.length, 1e-6) else {
                return (at, iteration, StopReason::Degenerate);
            };
            let limit = 0.5 * self.cells.size / self.reach(&step).max(1e-12);
            if limit < 1.0 {
                step = step.map(|s| s * limit);
            }
            let slope: f64 = step.iter().zip(&system.g).map(|(s, g)| s * g).sum();
            let Some((by, next)) = self.line_search(&at, &step, slope) else {
                return (at, iteration, StopReason::NoImprovement);
            };
            at = next;
            if self.settled(&step.map(|s| s * by)) {
                return (at, iteration, StopReason::Converged);
            }
        }
        (at, self.config.max_iterations, StopReason::MaxIterations)
    }

    /// Steepest ascent of the likelihood, the step growing while it helps and shrinking while it
    /// does not.
    fn gradient_ascent(&self, start: Pose) -> (At, usize, StopReason) {
        let mut at = self.at(start);
        let mut stride = 0.1 * self.cells.size;
        for iteration in 1..=self.config.max_iterations {
            let system = &at.system;
            if system.count < self.config.min_pairs {
                return (at, iteration, StopReason::TooFewPairs);
            }
            // Rotation in units of arc, so that one stride fits both halves.
            let arm = self.length * self.length;
            let direction: [f64; 6] = std::array::from_fn(|i| {
                if i < 3 {
                    -system.g[i]
                } else {
                    -system.g[i] / arm
                }
            });
            let reach = self.reach(&direction);
            if !(reach > 0.0 && reach.is_finite()) {
                return (at, iteration, StopReason::Degenerate);
            }
            let step = direction.map(|d| d * stride / reach);
            let slope: f64 = step.iter().zip(&system.g).map(|(s, g)| s * g).sum();
            let Some((by, next)) = self.line_search(&at, &step, slope) else {
                return (at, iteration, StopReason::NoImprovement);
            };
            at = next;
            if self.settled(&step.map(|s| s * by)) {
                return (at, iteration, StopReason::Converged);
            }
            stride *= if by >= 1.0 { 1.5 } else { by };
        }
        (at, self.config.max_iterations, StopReason::MaxIterations)
    }

    /// The largest of 1, ½, ¼, … that satisfies Armijo's condition, and where it leads: the first is nearly always taken, so that the
    /// derivatives that the next iteration needs come with it.
    fn line_search(&self, from: &At, step: &[f64; 6], slope: f64) -> Option<(f64, At)> {
        let mut by = 1.0;
        for _ in 0..12 {
            let at = self.at(self.moved(&from.pose, step, by));
            if at.system.cost <= from.system.cost + 1e-4 * by * slope {
                return Some((by, at));
            }
            by *= 0.5;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Length;
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};

    fn config() -> NdtConfig {
        NdtConfig {
            coarsest: Length::Metres(2.0),
            finest: Length::Metres(0.5),
            ..NdtConfig::default()
        }
    }

    #[test]
    fn gradient_and_hessian_are_those_of_finite_differences() {
        let map = surface(&drift(40_000, 10.0, 0.3, 0.0, 1), 0.2);
        let query = surface(&drift(4_000, 10.0, 0.3, 0.01, 2), 0.2);
        for form in [NdtForm::Mixture, NdtForm::Plain] {
            // Cells so large that all points see all of them: elsewhere the score jumps where a
            // point changes cells.
            let config = NdtConfig {
                form,
                neighbours: 27,
                ..config()
            };
            let cells = NdtCells::build(&map.points, 20.0, 6, 0.01);
            assert!(cells.len() >= 4);
            let (centroid, length) = spread(&query.points);
            let problem = Problem {
                cells: &cells,
                points: &query.points,
                centroid,
                length,
                config: &config,
            };
            let pose = Pose::from_rotation_vector([0.02, -0.01, 0.03], [0.05, 0.02, -0.04]);
            let at = problem.at(pose).system;
            let cost_at = |pose: &Pose| problem.at(*pose).system.cost;
            let h = 1e-6;
            let moved = |i: usize, by: f64| {
                let mut step = [0.0; 6];
                step[i] = by;
                problem.moved(&pose, &step, 1.0)
            };
            let matrix = at.matrix();
            let size = |i: usize, j: usize| (matrix[i][i].abs() * matrix[j][j].abs()).sqrt();
            for i in 0..6 {
                let numeric = (cost_at(&moved(i, h)) - cost_at(&moved(i, -h))) / (2.0 * h);
                assert!(
                    (numeric - at.g[i]).abs() < 1e-3 * (1.0 + at.g[i].abs()),
                    "{form} g{i}: {numeric} {}",
                    at.g[i]
                );
                for j in 0..6 {
                    // Differences of the gradient about a moved pose differ from the Hessian by the
                    // curvature of the group, so differentiate the cost twice instead.
                    let k = 1e-4;
                    let cost = |a: f64, b: f64| {
                        let mut step = [0.0; 6];
                        step[i] += a;
                        step[j] += b;
                        cost_at(&problem.moved(&pose, &step, 1.0))
                    };
                    let second =
                        (cost(k, k) - cost(k, -k) - cost(-k, k) + cost(-k, -k)) / (4.0 * k * k);
                    assert!(
                        (second - matrix[i][j]).abs() < 2e-3 * size(i, j),
                        "{form} h{i}{j}: {second} {}",
                        matrix[i][j]
                    );
                }
            }
        }
    }

    #[test]
    fn comes_home_from_half_a_metre_with_every_neighbourhood() {
        let map = surface(&drift(80_000, 14.0, 0.3, 0.01, 1), 0.15);
        let query = surface(&drift(50_000, 10.0, 0.3, 0.01, 2), 0.15);
        for neighbours in [1, 7, 27] {
            let config = NdtConfig {
                neighbours,
                ..config()
            };
            let levels = levels(&map, &config);
            assert_eq!(
                levels.iter().map(|l| l.size).collect::<Vec<_>>(),
                [2.0, 1.0, 0.5]
            );
            for seed in 0..4 {
                let mut rng = Rng::new(seed, 0);
                let start = Pose::identity().perturbed(
                    rng.direction().map(|v| 0.4 * v),
                    rng.direction().map(|v| 0.06 * v),
                    [5.0, 0.0, 0.0],
                );
                let found = align(&levels, &map, &query, &start, &config);
                let d = found
                    .map_from_query
                    .distance(&Pose::identity(), [5.0, 0.0, 0.0]);
                assert!(
                    d.translation < 0.03 && d.rotation < 0.01,
                    "{neighbours} {seed}: {d:?} {}",
                    found.stop
                );
            }
        }
    }

    #[test]
    fn the_plain_form_improves_a_near_start() {
        let map = surface(&drift(80_000, 14.0, 0.3, 0.01, 1), 0.15);
        let query = surface(&drift(50_000, 10.0, 0.3, 0.01, 2), 0.15);
        let config = NdtConfig {
            form: NdtForm::Plain,
            max_iterations: 100,
            ..config()
        };
        let start = Pose::from_translation([0.1, 0.1, -0.1]);
        let found = align(&levels(&map, &config), &map, &query, &start, &config);
        let d = found
            .map_from_query
            .distance(&Pose::identity(), [5.0, 0.0, 0.0]);
        assert!(d.translation < 0.05, "{d:?} {}", found.stop);
    }

    #[test]
    fn far_away_and_empty_clouds_stop_with_a_reason() {
        let map = surface(&drift(20_000, 10.0, 0.3, 0.0, 1), 0.2);
        let far = Pose::from_translation([500.0, 0.0, 0.0]);
        let levels = levels(&map, &config());
        let found = align(&levels, &map, &map, &far, &config());
        assert_eq!(
            (found.stop, found.map_from_query),
            (StopReason::TooFewPairs, far)
        );
        assert_eq!(
            align(&levels, &map, &Surface::default(), &far, &config()).stop,
            StopReason::TooFewPairs
        );
    }
}
