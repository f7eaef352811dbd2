//! What ICP minimises: sums over the pairs, and for point-to-point the pose that follows from them.

use nalgebra::{Matrix3, Vector3};

use crate::config::Kernel;
use crate::fit::best_rotation;
use crate::parallel;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::simd;
use crate::solve::{
    LANES, Lane, Lane3, LaneSystem, System, add, add_product, applied, dot, joined, times,
};

use super::pairs::Pair;

/// Variance of a surface along its normal, as a share of that along the surface (Segal, Haehnel & Thrun 2009).
const THICKNESS: f64 = 0.001;

/// The pairs of one iteration.
#[derive(Clone, Copy)]
pub(super) struct Problem<'a> {
    pub(super) map: &'a Surface<'a>,
    pub(super) query: &'a [[f32; 3]],
    /// The query's normals, where the metric asks for them.
    pub(super) normals: &'a [[f32; 3]],
    pub(super) pairs: &'a [Pair],
    pub(super) pose: &'a Pose,
    /// Of the query, in its frame: what steps turn about.
    pub(super) centroid: [f64; 3],
    pub(super) kernel: Kernel,
    /// Of the kernel, metres.
    pub(super) scale: f64,
}

/// Pairs side by side.
#[derive(Clone, Copy, Default)]
struct Batch {
    /// The query's points about their centroid, in its frame,
    own: Lane3,
    /// and the map's about where the pose takes that.
    target: Lane3,
    /// The map's normals,
    normal: Lane3,
    /// and the query's, in its frame.
    own_normal: Lane3,
    /// Metres.
    distance: Lane,
    /// 1, or 0 where there is no pair: such a lane holds zeros, and weighs nothing.
    taken: Lane,
}

/// What the pairs are made of that a metric asks for.
#[derive(Clone, Copy, PartialEq)]
enum Needs {
    Points,
    /// Pairs whose map point has no normal are left out.
    MapNormals,
    BothNormals,
}

/// Sums of weights, of weighted points on both sides and of their products.
#[derive(Clone, Copy, Default)]
struct PointSums {
    weight: Lane,
    own: Lane3,
    target: Lane3,
    products: [Lane3; 3],
}

impl Problem<'_> {
    /// The pose at which the weighted squared distances of the pairs are least, in closed form (Horn 1987).
    pub(super) fn point_to_point(&self) -> Option<Pose> {
        let (sums, count) = self.sum(
            Needs::Points,
            #[inline(always)]
            |sums: &mut PointSums, batch: &Batch| {
                let w = self.weights(&batch.distance, &batch.taken);
                add(&mut sums.weight, &w);
                for i in 0..3 {
                    add_product(&mut sums.own[i], &w, &batch.own[i]);
                    let weighted = times(&w, &batch.target[i]);
                    add(&mut sums.target[i], &weighted);
                    for j in 0..3 {
                        add_product(&mut sums.products[i][j], &weighted, &batch.own[j]);
                    }
                }
            },
            |a: &mut PointSums, b| {
                add(&mut a.weight, &b.weight);
                for i in 0..3 {
                    add(&mut a.own[i], &b.own[i]);
                    add(&mut a.target[i], &b.target[i]);
                    for j in 0..3 {
                        add(&mut a.products[i][j], &b.products[i][j]);
                    }
                }
            },
        );
        let weight = joined(&sums.weight);
        if count < 3 || !(weight > 0.0) {
            return None;
        }
        let mean = |sum: &Lane3| Vector3::from(sum.map(|l| joined(&l))) / weight;
        let (own, target) = (mean(&sums.own), mean(&sums.target));
        let products = Matrix3::from_fn(|i, j| joined(&sums.products[i][j]));
        let rotation = best_rotation(&(products - target * own.transpose() * weight))?;
        let from = Vector3::from(self.centroid) + own;
        let to = Vector3::from(self.pose.transform(self.centroid)) + target;
        Some(Pose::from_parts(rotation, to - rotation * from))
    }

    /// Distances from the tangent planes at the map's points.
    pub(super) fn point_to_plane(&self) -> System {
        let turn = self.turn();
        let (system, count) = self.sum(
            Needs::MapNormals,
            #[inline(always)]
            |system: &mut LaneSystem, batch: &Batch| {
                let arm = turned(&turn, &batch.own);
                let n = &batch.normal;
                let r = dot(n, &minus(&arm, &batch.target));
                // n · (θ × a) = θ · (a × n)
                let [x, y, z] = crate::solve::cross(&arm, n);
                let w = self.weights(&r.map(f64::abs), &batch.taken);
                system.add_rows(&[n[0], n[1], n[2], x, y, z], &r, &w);
            },
            LaneSystem::merge,
        );
        system.joined(count)
    }

    /// Distances between the surfaces at both points, each a Gaussian that is thin along its normal (where it has none, a ball).
    ///
    /// In units that make the distance of two parallel surfaces count as it is in metres: the paper's objective times twice the
    /// thickness, which moves no minimum and lets kernels mean what they mean elsewhere.
    pub(super) fn generalized(&self) -> System {
        let turn = self.turn();
        let (system, count) = self.sum(
            Needs::BothNormals,
            #[inline(always)]
            |system: &mut LaneSystem, batch: &Batch| {
                let arm = turned(&turn, &batch.own);
                let d = minus(&arm, &batch.target);
                let b = plane_to_plane(&batch.normal, &turned(&turn, &batch.own_normal));
                let bd = applied(&b, &d);
                let squared = dot(&d, &bd);
                let w = self.weights(&squared.map(|s| s.max(0.0).sqrt()), &batch.taken);
                add_product(&mut system.cost, &w, &squared);
                add(&mut system.weight, &w);
                let b = b.each_ref().map(|e| times(&w, e));
                system.add_points(&arm, &b, &bd.each_ref().map(|e| times(&w, e)));
            },
            LaneSystem::merge,
        );
        system.joined(count)
    }

    /// Second moments of the paired query points about the moved centroid, map axes, m².
    pub(super) fn moments(&self) -> [[f64; 3]; 3] {
        let turn = self.turn();
        let merge = |a: &mut [Lane3; 3], b: [Lane3; 3]| {
            for (a, b) in a.as_flattened_mut().iter_mut().zip(b.as_flattened()) {
                add(a, b);
            }
        };
        let (sums, count) = self.sum(
            Needs::Points,
            #[inline(always)]
            |sums: &mut [Lane3; 3], batch: &Batch| {
                let arm = turned(&turn, &batch.own);
                for i in 0..3 {
                    for j in 0..3 {
                        add_product(&mut sums[i][j], &arm[i], &arm[j]);
                    }
                }
            },
            merge,
        );
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let n = count.max(1) as f64;
        sums.map(|row| row.map(|l| joined(&l) / n))
    }

    /// The pose's rotation, row by row.
    fn turn(&self) -> [[f64; 3]; 3] {
        let r = self.pose.rotation();
        std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)]))
    }

    /// The weights of residuals of sizes `r`.
    #[inline(always)]
    fn weights(&self, r: &Lane, taken: &Lane) -> Lane {
        let scale = self.scale;
        let each = |weight: fn(f64, f64) -> f64| -> Lane {
            std::array::from_fn(|l| taken[l] * weight(r[l], scale))
        };
        match self.kernel {
            Kernel::None => *taken,
            Kernel::Huber => each(|r, scale| if r <= scale { 1.0 } else { scale / r }),
            Kernel::GemanMcClure => each(|r, scale| {
                let s = scale * scale;
                let w = s / (s + r * r);
                w * w
            }),
        }
    }

    /// The sums of what `add` makes of the pairs, and how many took part.
    fn sum<S: Default + Send>(
        &self,
        needs: Needs,
        add: impl Fn(&mut S, &Batch) + Sync,
        merge: impl Fn(&mut S, S),
    ) -> (S, usize) {
        let parts = parallel::chunks(self.pairs.len(), |range| {
            simd::wide(
                #[inline(always)]
                || {
                    let mut sums = S::default();
                    let mut batch = Batch::default();
                    let (mut lane, mut count) = (0, 0);
                    for pair in &self.pairs[range] {
                        if !self.take(pair, needs, &mut batch, lane) {
                            continue;
                        }
                        count += 1;
                        lane += 1;
                        if lane == LANES {
                            add(&mut sums, &batch);
                            batch = Batch::default();
                            lane = 0;
                        }
                    }
                    if lane > 0 {
                        add(&mut sums, &batch);
                    }
                    (sums, count)
                },
            )
        });
        let (mut sums, mut count) = (S::default(), 0);
        for (part, n) in parts {
            merge(&mut sums, part);
            count += n;
        }
        (sums, count)
    }

    /// Puts a pair in a lane; `false` where the metric has no use for it.
    #[inline(always)]
    fn take(&self, pair: &Pair, needs: Needs, batch: &mut Batch, lane: usize) -> bool {
        let (query, map) = (pair.query as usize, pair.map as usize);
        if needs != Needs::Points {
            let normal = self.map.normals.get(map).copied().unwrap_or_default();
            if needs == Needs::MapNormals && normal == [0.0; 3] {
                return false;
            }
            let of_query = self.normals.get(query).copied();
            let own = of_query.filter(|_| needs == Needs::BothNormals);
            let own = own.unwrap_or_default();
            for a in 0..3 {
                batch.normal[a][lane] = f64::from(normal[a]);
                batch.own_normal[a][lane] = f64::from(own[a]);
            }
        }
        let centre = self.pose.transform(self.centroid);
        let (own, target) = (self.query[query], self.map.points[map]);
        for a in 0..3 {
            batch.own[a][lane] = f64::from(own[a]) - self.centroid[a];
            batch.target[a][lane] = f64::from(target[a]) - centre[a];
        }
        batch.distance[lane] = f64::from(pair.distance_squared).sqrt();
        batch.taken[lane] = 1.0;
        true
    }
}

/// `2ε (Cₙ + Cₘ)⁻¹` of two surfaces with the normals `n` and `m` and the covariances `I − (1 − ε) nnᵀ`, `ε` the [`THICKNESS`], by
/// Woodbury's identity: the sum differs from `2I` in two directions only.
#[inline(always)]
fn plane_to_plane(n: &Lane3, m: &Lane3) -> [Lane; 6] {
    const S: f64 = 2.0 / (1.0 - THICKNESS);
    let (nn, mm, nm) = (dot(n, n), dot(m, m), dot(n, m));
    let mut out = [[0.0; LANES]; 6];
    for l in 0..LANES {
        let (a, b, c) = (S - nn[l], S - mm[l], nm[l]);
        let share = THICKNESS / (a * b - c * c);
        let (of_n, of_m, of_both) = (share * b, share * a, share * c);
        let entry = |i: usize, j: usize| {
            let (n, m) = ((n[i][l], n[j][l]), (m[i][l], m[j][l]));
            of_n * (n.0 * n.1) + of_m * (m.0 * m.1) + of_both * (n.0 * m.1 + m.0 * n.1)
        };
        out[0][l] = THICKNESS + entry(0, 0);
        out[1][l] = entry(0, 1);
        out[2][l] = entry(0, 2);
        out[3][l] = THICKNESS + entry(1, 1);
        out[4][l] = entry(1, 2);
        out[5][l] = THICKNESS + entry(2, 2);
    }
    out
}

#[inline(always)]
fn turned(rows: &[[f64; 3]; 3], v: &Lane3) -> Lane3 {
    rows.map(|r| std::array::from_fn(|l| r[0] * v[0][l] + r[1] * v[1][l] + r[2] * v[2][l]))
}

#[inline(always)]
fn minus(a: &Lane3, b: &Lane3) -> Lane3 {
    std::array::from_fn(|i| std::array::from_fn(|l| a[i][l] - b[i][l]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::fit_rigid;
    use crate::icp::pairs::Pairing;
    use crate::refine::spread;
    use crate::test_world::{drift, surface};

    #[test]
    fn point_to_point_is_the_fit_of_the_pairs() {
        let map = surface(&drift(20_000, 10.0, 0.3, 0.0, 1), 0.2);
        let query = surface(&drift(9_000, 10.0, 0.3, 0.01, 2), 0.2);
        let pose = Pose::from_rotation_vector([0.01, 0.0, 0.02], [0.02, 0.01, 0.0]);
        let pairs = Pairing::new(&map, &query.points).at(&pose, 0.3);
        let centroid = spread(&query.points).0;
        for kernel in [Kernel::None, Kernel::Huber, Kernel::GemanMcClure] {
            let problem = Problem {
                map: &map,
                query: &query.points,
                normals: &[],
                pairs: &pairs,
                pose: &pose,
                centroid,
                kernel,
                scale: 0.07,
            };
            let expected = fit_rigid(pairs.iter().map(|p| {
                let r = f64::from(p.distance_squared).sqrt();
                let w = match kernel {
                    Kernel::None => 1.0,
                    Kernel::Huber => (0.07 / r).min(1.0),
                    Kernel::GemanMcClure => (0.0049 / (0.0049 + r * r)).powi(2),
                };
                let from = query.points[p.query as usize].map(f64::from);
                (from, map.points[p.map as usize].map(f64::from), w)
            }));
            let (found, expected) = (problem.point_to_point().unwrap(), expected.unwrap());
            let apart = found.distance(&expected, centroid);
            assert!(
                apart.translation < 1e-12 && apart.rotation < 1e-9,
                "{apart:?}"
            );
            // The moments are those of the points at the pose.
            let centre = pose.transform(centroid);
            let xy: f64 = pairs
                .iter()
                .map(|p| {
                    let at = pose.transform(query.points[p.query as usize].map(f64::from));
                    (at[0] - centre[0]) * (at[1] - centre[1])
                })
                .sum();
            assert!((problem.moments()[0][1] - xy / pairs.len() as f64).abs() < 1e-9);
        }
    }

    /// The inverse of a sum of covariances by nalgebra.
    fn inverse(n: [f64; 3], m: [f64; 3]) -> Matrix3<f64> {
        let covariance = |n: [f64; 3]| {
            let n = Vector3::from(n);
            Matrix3::identity() - n * n.transpose() * (1.0 - THICKNESS)
        };
        (covariance(n) + covariance(m)).try_inverse().unwrap()
    }

    #[test]
    fn surfaces_weigh_by_the_inverse_of_their_covariances() {
        let normals = [
            ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
            ([0.0, 0.6, 0.8], [0.0, -0.6, -0.8]),
            ([1.0, 0.0, 0.0], [0.0, 0.6, 0.8]),
            ([0.36, 0.48, 0.8], [0.0, 0.6, 0.8]),
            ([0.0; 3], [0.0, 0.6, 0.8]),
            ([0.0; 3], [0.0; 3]),
        ];
        for (n, m) in normals {
            let b = plane_to_plane(&n.map(|v| [v; LANES]), &m.map(|v| [v; LANES]));
            let expected = inverse(n, m) * (2.0 * THICKNESS);
            for (e, (i, j)) in b
                .iter()
                .zip([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)])
            {
                assert!((e[3] - expected[(i, j)]).abs() < 1e-9, "{n:?} {m:?}");
            }
        }
        // Parallel surfaces a metre apart are a metre apart.
        let up = [[0.0; LANES], [0.0; LANES], [1.0; LANES]];
        assert!((plane_to_plane(&up, &up)[5][0] - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_generalized_system_is_that_of_the_cost_written_out() {
        let map = surface(&drift(20_000, 10.0, 0.3, 0.0, 1), 0.2);
        let query = surface(&drift(9_000, 10.0, 0.3, 0.01, 2), 0.2);
        let pose = Pose::from_rotation_vector([0.01, 0.0, 0.02], [0.02, 0.01, 0.0]);
        let pairs = Pairing::new(&map, &query.points).at(&pose, 0.3);
        let centroid = spread(&query.points).0;
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
        // The surfaces held as they lie, as Gauss-Newton has it.
        let inverses: Vec<Matrix3<f64>> = pairs
            .iter()
            .map(|p| {
                let n = map.normals[p.map as usize].map(f64::from);
                let m = query.normals[p.query as usize].map(f64::from);
                inverse(n, pose.rotate(m)) * (2.0 * THICKNESS)
            })
            .collect();
        let cost = |step: [f64; 6]| -> f64 {
            let [x, y, z, a, b, c] = step;
            let moved = pose.perturbed([x, y, z], [a, b, c], centre);
            let each = pairs.iter().zip(&inverses).map(|(p, inverse)| {
                let at = moved.transform(query.points[p.query as usize].map(f64::from));
                let to = map.points[p.map as usize].map(f64::from);
                let d = Vector3::from(at) - Vector3::from(to);
                d.dot(&(inverse * d))
            });
            each.sum()
        };
        let system = problem.generalized();
        assert_eq!(system.count, pairs.len());
        let matrix = system.matrix();
        assert!((system.cost - cost([0.0; 6])).abs() < 1e-6 * system.cost);
        let mut expected = nalgebra::SMatrix::<f64, 6, 6>::zeros();
        for (p, inverse) in pairs.iter().zip(&inverses) {
            let at = Vector3::from(pose.transform(query.points[p.query as usize].map(f64::from)));
            let mut j = nalgebra::SMatrix::<f64, 3, 6>::zeros();
            j.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            j.fixed_view_mut::<3, 3>(0, 3)
                .copy_from(&-crate::pose::skew(&(at - Vector3::from(centre))));
            expected += j.transpose() * inverse * j;
        }
        for i in 0..6 {
            for j in 0..6 {
                let size = (expected[(i, i)] * expected[(j, j)]).sqrt();
                assert!((matrix[i][j] - expected[(i, j)]).abs() < 1e-9 * size);
            }
        }
        for i in 0..6 {
            let h = 1e-4;
            let at = |by: f64| {
                let mut step = [0.0; 6];
                step[i] = by;
                cost(step)
            };
            let slope = (at(h) - at(-h)) / (2.0 * h);
            assert!(
                (slope - 2.0 * system.g[i]).abs() < 1e-3 * (1.0 + slope.abs()),
                "{i}: {slope} {}",
                2.0 * system.g[i]
            );
        }
    }
}
