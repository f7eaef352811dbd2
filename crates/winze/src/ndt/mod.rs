//! The normal distributions transform, point to distribution (Magnusson 2009, chapter 6).
//!
//! The map becomes one Gaussian a cell; the pose climbs the likelihood of the query's points under
//! them. Each cell's likelihood is a Gaussian mixed with a uniform outlier density, approximated by
//! `−d1 exp(−d2/2 · xᵀΣ⁻¹x)` (equations 6.8 to 6.10), with an analytic gradient and Hessian and Newton
//! steps under a line search, from coarse cells to fine ones: no single resolution decides.
//!
//! [`NdtForm::Plain`] is the paper's form: the bare Gaussian and gradient ascent.

mod cells;

pub use cells::{Gaussian, NdtCell, NdtCells, NdtColumns, cells_in};

use crate::config::{NdtConfig, NdtForm};
use crate::eigen3::times;
use crate::icp;
use crate::parallel;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{Refined, StopReason, sample, spread};
use crate::solve::System;
use crate::vec3::{cross, dot};

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
        let (next, iterations, stop) = match config.form {
            NdtForm::Mixture => problem.newton(pose),
            NdtForm::Plain => problem.gradient_ascent(pose),
        };
        pose = next;
        refined.iterations += iterations;
        refined.stop = stop;
        refined.pairs = problem.derivatives(&pose).count;
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
    let finest = config.finest.metres(voxel);
    let mut size = config.coarsest.metres(voxel).max(finest);
    let mut sizes = vec![size];
    while size > 1.5 * finest {
        size = (0.5 * size).max(finest);
        sizes.push(size);
    }
    sizes
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

    /// The score's negative as `cost`, its gradient and Hessian about the moved centroid, and the
    /// number of points that met a Gaussian.
    fn derivatives(&self, pose: &Pose) -> System {
        let (height, d2) = self.bell();
        let centre = pose.transform(self.centroid);
        parallel::sum(
            self.points.len(),
            |system: &mut System, i| {
                let p = pose.transform(self.points[i].map(f64::from));
                let arm = [p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]];
                let mut met = false;
                self.cells.around(p, self.config.neighbours, |cell| {
                    met = true;
                    add_cell(system, cell, p, arm, height, d2);
                });
                system.count += usize::from(met);
            },
            System::merge,
        )
    }

    /// The score's negative alone.
    fn cost(&self, pose: &Pose) -> f64 {
        let (height, d2) = self.bell();
        parallel::sum(
            self.points.len(),
            |cost: &mut f64, i| {
                let p = pose.transform(self.points[i].map(f64::from));
                self.cells.around(p, self.config.neighbours, |cell| {
                    let x = [
                        p[0] - cell.mean[0],
                        p[1] - cell.mean[1],
                        p[2] - cell.mean[2],
                    ];
                    let bx = times(&cell.inverse_covariance, x);
                    *cost -= height * libm::exp(-0.5 * d2 * dot(x, bx));
                });
            },
            |a, b| *a += b,
        )
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
    fn newton(&self, mut pose: Pose) -> (Pose, usize, StopReason) {
        for iteration in 1..=self.config.max_iterations {
            let system = self.derivatives(&pose);
            if system.count < self.config.min_pairs {
                return (pose, iteration, StopReason::TooFewPairs);
            }
            let Some(mut step) = system.step(self.length, 1e-6) else {
                return (pose, iteration, StopReason::Degenerate);
            };
            let limit = 0.5 * self.cells.size / self.reach(&step).max(1e-12);
            if limit < 1.0 {
                step = step.map(|s| s * limit);
            }
            let slope: f64 = step.iter().zip(&system.g).map(|(s, g)| s * g).sum();
            let Some(by) = self.line_search(&pose, &step, system.cost, slope) else {
                return (pose, iteration, StopReason::NoImprovement);
            };
            pose = self.moved(&pose, &step, by);
            if self.settled(&step.map(|s| s * by)) {
                return (pose, iteration, StopReason::Converged);
            }
        }
        (pose, self.config.max_iterations, StopReason::MaxIterations)
    }

    /// Steepest ascent of the likelihood, the step growing while it helps and shrinking while it
    /// does not.
    fn gradient_ascent(&self, mut pose: Pose) -> (Pose, usize, StopReason) {
        let mut stride = 0.1 * self.cells.size;
        for iteration in 1..=self.config.max_iterations {
            let system = self.derivatives(&pose);
            if system.count < self.config.min_pairs {
                return (pose, iteration, StopReason::TooFewPairs);
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
                return (pose, iteration, StopReason::Degenerate);
            }
            let step = direction.map(|d| d * stride / reach);
            let slope: f64 = step.iter().zip(&system.g).map(|(s, g)| s * g).sum();
            let Some(by) = self.line_search(&pose, &step, system.cost, slope) else {
                return (pose, iteration, StopReason::NoImprovement);
            };
            pose = self.moved(&pose, &step, by);
            if self.settled(&step.map(|s| s * by)) {
                return (pose, iteration, StopReason::Converged);
            }
            stride *= if by >= 1.0 { 1.5 } else { by };
        }
        (pose, self.config.max_iterations, StopReason::MaxIterations)
    }

    /// The largest of 1, ½, ¼, … that satisfies Armijo's condition.
    fn line_search(&self, pose: &Pose, step: &[f64; 6], cost: f64, slope: f64) -> Option<f64> {
        let mut by = 1.0;
        for _ in 0..12 {
            if self.cost(&self.moved(pose, step, by)) <= cost + 1e-4 * by * slope {
                return Some(by);
            }
            by *= 0.5;
        }
        None
    }
}

/// Adds one cell's part of the negative score at point `p`, with `arm` its place about the centre.
///
/// With `e = exp(−d2/2 xᵀBx)`, `B = Σ⁻¹` and the point's Jacobian `J = [I, −arm^]`: gradient
/// `k Jᵀ B x`, Hessian `k (JᵀBJ − d2 gᵀg + xᵀB ∂²p)`, `k = height d2 e` (equations 6.12 and 6.13).
#[inline]
fn add_cell(system: &mut System, cell: &NdtCell, p: [f64; 3], arm: [f64; 3], height: f64, d2: f64) {
    let b = &cell.inverse_covariance;
    let x = [
        p[0] - cell.mean[0],
        p[1] - cell.mean[1],
        p[2] - cell.mean[2],
    ];
    let bx = times(b, x);
    let e = libm::exp(-0.5 * d2 * dot(x, bx));
    let k = height * d2 * e;
    let turn = cross(arm, bx);
    let g = [bx[0], bx[1], bx[2], turn[0], turn[1], turn[2]];
    // Columns of J: the axes, then axis × arm.
    let j = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, -arm[2], arm[1]],
        [arm[2], 0.0, -arm[0]],
        [-arm[1], arm[0], 0.0],
    ];
    let bj = j.map(|column| times(b, column));
    let along = dot(bx, arm);
    let mut at = 0;
    for r in 0..6 {
        for c in r..6 {
            let mut h = dot(j[r], bj[c]) - d2 * g[r] * g[c];
            if r >= 3 {
                // ∂²p/∂θr∂θc at zero is ½(er (ec·arm) + ec (er·arm)) − arm (er·ec).
                let (i, l) = (r - 3, c - 3);
                h += 0.5 * (bx[i] * arm[l] + bx[l] * arm[i]) - if i == l { along } else { 0.0 };
            }
            system.h[at] += k * h;
            at += 1;
        }
        system.g[r] += k * g[r];
    }
    system.cost -= height * e;
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
            let at = problem.derivatives(&pose);
            assert!((at.cost - problem.cost(&pose)).abs() < 1e-9 * at.cost.abs());
            let h = 1e-6;
            let moved = |i: usize, by: f64| {
                let mut step = [0.0; 6];
                step[i] = by;
                problem.moved(&pose, &step, 1.0)
            };
            let matrix = at.matrix();
            let size = |i: usize, j: usize| (matrix[i][i].abs() * matrix[j][j].abs()).sqrt();
            for i in 0..6 {
                let numeric =
                    (problem.cost(&moved(i, h)) - problem.cost(&moved(i, -h))) / (2.0 * h);
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
                        problem.cost(&problem.moved(&pose, &step, 1.0))
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
