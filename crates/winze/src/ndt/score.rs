//! The score of a pose and its derivatives: sums over the query's points and the Gaussians around them.

use crate::parallel;
use crate::pose::Pose;
use crate::simd;
use crate::solve::{LANES, Lane, Lane3, LaneSystem, System, add_product, applied, dot};

use super::cells::{Gaussian, NdtCells, cell_of, hash};

/// What is summed.
#[derive(Clone, Copy)]
pub(super) struct Score<'a> {
    pub(super) cells: &'a NdtCells<'a>,
    pub(super) points: &'a [[f32; 3]],
    /// Of the points, in their frame: what steps turn about.
    pub(super) centroid: [f64; 3],
    /// Cells that a point looks at.
    pub(super) neighbours: usize,
    /// The bell's height and `d2`.
    pub(super) height: f64,
    pub(super) d2: f64,
}

impl Score<'_> {
    /// The score's negative as `cost`, its gradient and Hessian about the moved centroid, and the number of points that met a
    /// Gaussian.
    pub(super) fn derivatives(&self, pose: &Pose) -> System {
        let centre = pose.transform(self.centroid);
        let parts = parallel::chunks(self.points.len(), |range| {
            let points = &self.points[range];
            let mut groups = Groups::default();
            groups.of(points, pose, self.cells.size);
            let mut sums = LaneSystem::default();
            let mut count = 0;
            let mut around = Vec::new();
            for group in &groups.groups {
                around.clear();
                self.cells.around(group.cell, self.neighbours, &mut around);
                if around.is_empty() {
                    continue;
                }
                let members = groups.members(group);
                count += members.len();
                simd::wide(
                    #[inline(always)]
                    || {
                        for members in members.chunks(LANES) {
                            self.add(&mut sums, members, centre, &around);
                        }
                    },
                );
            }
            (sums, count)
        });
        let (mut sums, mut count) = (LaneSystem::default(), 0);
        for (part, n) in parts {
            sums.merge(part);
            count += n;
        }
        sums.joined(count)
    }

    /// Adds the parts of points of one cell, at these places, under the Gaussians around it.
    ///
    /// With `e = exp(−d2/2 xᵀBx)`, `B = Σ⁻¹` and the point's Jacobian `J = [I, −arm^]`: gradient `Jᵀv`, Hessian `JᵀWJ + v·∂²p`, where
    /// `v` sums `k B x` and `W` sums `k (B − d2 Bx xᵀB)` over the Gaussians, `k = height d2 e` (equations 6.12 and 6.13).
    #[inline(always)]
    fn add(
        &self,
        sums: &mut LaneSystem,
        members: &[[f64; 3]],
        centre: [f64; 3],
        around: &[Gaussian],
    ) {
        let mut p: Lane3 = [[0.0; LANES]; 3];
        let mut taken: Lane = [0.0; LANES];
        // Lanes that are left over repeat a point, and count for nothing.
        for l in 0..LANES {
            let member = members.get(l).unwrap_or(&members[0]);
            taken[l] = if l < members.len() { self.height } else { 0.0 };
            for a in 0..3 {
                p[a][l] = member[a];
            }
        }
        let mut w = [[0.0; LANES]; 6];
        let mut v: Lane3 = [[0.0; LANES]; 3];
        for [mx, my, mz, b @ ..] in around {
            let mut x = p;
            for (x, m) in x.iter_mut().zip([mx, my, mz]) {
                x.iter_mut().for_each(|x| *x -= m);
            }
            let bx = applied(&b.map(|e| [e; LANES]), &x);
            let e = falling(&dot(&x, &bx).map(|q| 0.5 * self.d2 * q));
            let mut k = [0.0; LANES];
            for l in 0..LANES {
                let he = taken[l] * e[l];
                sums.cost[l] -= he;
                k[l] = he * self.d2;
            }
            for a in 0..3 {
                add_product(&mut v[a], &k, &bx[a]);
            }
            let kd = k.map(|k| k * self.d2);
            let mut at = 0;
            for i in 0..3 {
                for j in i..3 {
                    for l in 0..LANES {
                        w[at][l] += k[l] * b[at] - kd[l] * (bx[i][l] * bx[j][l]);
                    }
                    at += 1;
                }
            }
        }
        let mut arm = p;
        for (arm, c) in arm.iter_mut().zip(centre) {
            arm.iter_mut().for_each(|a| *a -= c);
        }
        sums.add_points(&arm, &w, &v);
        sums.add_curvature(&arm, &v);
    }
}

/// `exp(−y)` for `y ≥ 0`, to 1e-12 of itself down to `2^−1000`, where it stays: two to a whole power, put together of bits, times the
/// exponential's series over what is left, at most half an octave.
#[inline(always)]
fn falling(y: &Lane) -> Lane {
    /// Added and taken away again, it rounds to whole numbers, which it leaves in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let t = -std::f64::consts::LOG2_E * y[l];
        let t = if t > -1000.0 { t } else { -1000.0 };
        let rounded = t + ROUND;
        let z = (t - (rounded - ROUND)) * std::f64::consts::LN_2;
        let mut series = 1.0 / 3_628_800.0;
        for factorial in [
            362_880.0, 40_320.0, 5_040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0,
        ] {
            series = series * z + 1.0 / factorial;
        }
        out[l] = series * f64::from_bits(rounded.to_bits().wrapping_add(1023) << 52);
    }
    out
}

/// Points of a chunk by the cell that they lie in: neighbours in memory are neighbours in space, so a cell's Gaussians are looked up
/// once for many of them.
#[derive(Default)]
struct Groups {
    /// In the order in which their first points come.
    groups: Vec<Group>,
    /// Points at the pose, group by group, in their order within each.
    sorted: Vec<[f64; 3]>,
}

struct Group {
    cell: [i32; 3],
    /// Where its points end among the sorted ones, and how many they are.
    end: usize,
    count: usize,
}

impl Groups {
    /// Slots to look groups up by, more than twice the points of a chunk.
    const SLOTS: usize = 4096;

    fn of(&mut self, points: &[[f32; 3]], pose: &Pose, size: f64) {
        let mut slots = [u16::MAX; Self::SLOTS];
        let mut moved = Vec::with_capacity(points.len());
        let mut last = 0;
        for p in points {
            let at = pose.transform(p.map(f64::from));
            let cell = cell_of(at, size);
            if self.groups.get(last).is_none_or(|g| g.cell != cell) {
                last = self.find(&mut slots, cell);
            }
            self.groups[last].count += 1;
            moved.push((at, last));
        }
        let mut end = 0;
        for group in &mut self.groups {
            group.end = end;
            end += group.count;
        }
        self.sorted.resize(points.len(), [0.0; 3]);
        for (at, group) in moved {
            let place = &mut self.groups[group].end;
            self.sorted[*place] = at;
            *place += 1;
        }
    }

    /// The group of a cell, a new one where there is none yet.
    fn find(&mut self, slots: &mut [u16; Self::SLOTS], cell: [i32; 3]) -> usize {
        let mut at = hash(cell) % Self::SLOTS;
        // Most of the slots are empty, so this ends.
        loop {
            let group = usize::from(slots[at]);
            match self.groups.get(group) {
                Some(g) if g.cell == cell => return group,
                Some(_) => at = (at + 1) % Self::SLOTS,
                None => break,
            }
        }
        let group = self.groups.len();
        #[expect(
            clippy::cast_possible_truncation,
            reason = "no more than a chunk's points"
        )]
        let name = group as u16;
        slots[at] = name;
        self.groups.push(Group {
            cell,
            end: 0,
            count: 0,
        });
        group
    }

    fn members(&self, group: &Group) -> &[[f64; 3]] {
        &self.sorted[group.end - group.count..group.end]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};

    #[test]
    fn the_exponential_is_that_of_libm() {
        let mut rng = Rng::new(1, 0);
        for i in 0..20_000 {
            let y: Lane = std::array::from_fn(|_| rng.range(0.0, [1.0, 40.0, 690.0][i % 3]));
            for (y, e) in y.iter().zip(falling(&y)) {
                let expected = libm::exp(-y);
                assert!(
                    (e - expected).abs() <= 1e-12 * expected,
                    "{y}: {e} {expected}"
                );
            }
        }
        let ends = falling(&[0.0, 1e-300, 700.0, 1e4, 1e300, f64::INFINITY, 0.5, 1.0]);
        assert_eq!(ends[..2], [1.0, 1.0]);
        assert!(ends[3..6].iter().all(|e| *e < 1e-300));
    }

    /// Every point alone with every Gaussian around it, and the 6×6 product in full.
    #[test]
    fn the_sums_are_those_of_each_point_and_gaussian_written_out() {
        let map = surface(&drift(30_000, 10.0, 0.3, 0.0, 1), 0.2);
        let query = surface(&drift(20_000, 12.0, 0.3, 0.01, 2), 0.2);
        let cells = NdtCells::build(&map.points, 0.7, 6, 0.01);
        let pose = Pose::from_rotation_vector([0.02, -0.01, 0.03], [0.05, 0.02, -0.04]);
        for neighbours in [1, 7, 27] {
            let score = Score {
                cells: &cells,
                points: &query.points,
                centroid: [6.0, 0.1, -0.1],
                neighbours,
                height: 1.7,
                d2: 0.4,
            };
            let found = score.derivatives(&pose);
            let centre = pose.transform(score.centroid);
            let (mut cost, mut g, mut h, mut count) = (0.0, [0.0; 6], [[0.0; 6]; 6], 0);
            for p in query.points.iter() {
                let p = pose.transform(p.map(f64::from));
                let [x, y, z]: [f64; 3] = std::array::from_fn(|a| p[a] - centre[a]);
                // Columns of J: the axes, then axis × arm.
                let j = [
                    [1.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0],
                    [0.0, 0.0, 1.0],
                    [0.0, -z, y],
                    [z, 0.0, -x],
                    [-y, x, 0.0],
                ];
                let mut around = Vec::new();
                cells.around(cell_of(p, cells.size), neighbours, &mut around);
                count += usize::from(!around.is_empty());
                for [mx, my, mz, b @ ..] in around {
                    let b = [[b[0], b[1], b[2]], [b[1], b[3], b[4]], [b[2], b[4], b[5]]];
                    let d = [p[0] - mx, p[1] - my, p[2] - mz];
                    let times = |v: [f64; 3]| b.map(|r| crate::vec3::dot(r, v));
                    let bx = times(d);
                    let e = libm::exp(-0.5 * 0.4 * crate::vec3::dot(d, bx));
                    let k = 1.7 * 0.4 * e;
                    cost -= 1.7 * e;
                    let along = j.map(|column| crate::vec3::dot(column, bx));
                    for r in 0..6 {
                        g[r] += k * along[r];
                        for c in 0..6 {
                            let mut v = crate::vec3::dot(j[r], times(j[c]));
                            v -= 0.4 * along[r] * along[c];
                            if r >= 3 && c >= 3 {
                                let (i, l, arm) = (r - 3, c - 3, [x, y, z]);
                                v += 0.5 * (bx[i] * arm[l] + bx[l] * arm[i]);
                                v -= if i == l {
                                    crate::vec3::dot(bx, arm)
                                } else {
                                    0.0
                                };
                            }
                            h[r][c] += k * v;
                        }
                    }
                }
            }
            assert_eq!(found.count, count);
            assert!((found.cost - cost).abs() < 1e-9 * cost.abs());
            for r in 0..6 {
                assert!((found.g[r] - g[r]).abs() < 1e-9 * h[r][r].abs());
                for c in 0..6 {
                    let size = (h[r][r] * h[c][c]).abs().sqrt();
                    assert!((found.matrix()[r][c] - h[r][c]).abs() < 1e-9 * size);
                }
            }
        }
    }
}
