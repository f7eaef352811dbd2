//! Least squares in six dimensions: the normal equations that ICP and NDT fill and solve.
//!
//! A step is `[δt, δθ]` about a centre, see [`Pose::perturbed`](crate::Pose::perturbed).

use crate::symmetric::eigen;

/// Sums of `w JᵀJ` (upper triangle, row by row), `w Jᵀr` and the cost.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct System {
    /// Upper triangle of `Σ w JᵀJ`, row by row.
    pub h: [f64; 21],
    /// `Σ w Jᵀr`.
    pub g: [f64; 6],
    /// `Σ w r²`.
    pub cost: f64,
    /// `Σ w`.
    pub weight: f64,
    /// Rows added.
    pub count: usize,
}

impl System {
    /// Adds one scalar residual with its Jacobian row and weight.
    #[inline]
    pub fn add_row(&mut self, j: &[f64; 6], r: f64, w: f64) {
        let mut k = 0;
        for a in 0..6 {
            let wa = w * j[a];
            for b in a..6 {
                self.h[k] += wa * j[b];
                k += 1;
            }
            self.g[a] += wa * r;
        }
        self.cost += w * r * r;
        self.weight += w;
        self.count += 1;
    }

    /// The full symmetric matrix.
    #[must_use]
    pub fn matrix(&self) -> [[f64; 6]; 6] {
        let mut m = [[0.0; 6]; 6];
        let mut k = 0;
        for a in 0..6 {
            for b in a..6 {
                m[a][b] = self.h[k];
                m[b][a] = self.h[k];
                k += 1;
            }
        }
        m
    }

    /// The step that minimises the quadratic model, `−H⁺ g`. Rotations are measured in units of
    /// `length` metres of arc, so that both halves of the matrix compare; directions whose
    /// curvature is below `floor` times the largest are left alone, since the data say nothing
    /// about them. Negative curvature (NDT) counts by its size, which keeps the step downhill.
    #[must_use]
    pub fn step(&self, length: f64, floor: f64) -> Option<[f64; 6]> {
        let scale = |i: usize| if i < 3 { 1.0 } else { 1.0 / length };
        let mut m = self.matrix();
        for (i, row) in m.iter_mut().enumerate() {
            for (j, v) in row.iter_mut().enumerate() {
                *v *= scale(i) * scale(j);
            }
        }
        let e = eigen(m);
        let largest = e.values.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let mut step = [0.0; 6];
        for (value, vector) in e.values.iter().zip(&e.vectors) {
            if value.abs() < floor * largest {
                continue;
            }
            let along: f64 = (0..6).map(|i| vector[i] * self.g[i] * scale(i)).sum();
            for (i, s) in step.iter_mut().enumerate() {
                *s -= along / value.abs() * vector[i] * scale(i);
            }
        }
        step.iter().all(|v| v.is_finite()).then_some(step)
    }
}

/// Terms that are summed side by side.
pub(crate) const LANES: usize = 8;
/// A number for each of them.
pub(crate) type Lane = [f64; LANES];
/// A vector for each of them.
pub(crate) type Lane3 = [Lane; 3];

/// The sums of a [`System`], lane by lane, so that a processor can add several terms at once. Which term goes to which lane, and the
/// order in which lanes are joined, is fixed: it is part of the answer.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LaneSystem {
    h: [Lane; 21],
    g: [Lane; 6],
    pub(crate) cost: Lane,
    pub(crate) weight: Lane,
}

impl LaneSystem {
    /// As [`System::add_row`], a row a lane.
    #[inline(always)]
    pub(crate) fn add_rows(&mut self, j: &[Lane; 6], r: &Lane, w: &Lane) {
        let mut k = 0;
        for a in 0..6 {
            let wa = times(w, &j[a]);
            for b in a..6 {
                add_product(&mut self.h[k], &wa, &j[b]);
                k += 1;
            }
            add_product(&mut self.g[a], &wa, r);
        }
        let wr = times(w, r);
        add_product(&mut self.cost, &wr, r);
        for l in 0..LANES {
            self.weight[l] += w[l];
        }
    }

    /// Adds `JᵀBJ` and `Jᵀv` of points with the Jacobian `J = [I, −arm^]`, for a symmetric `B` (its upper triangle) and a
    /// vector `v`: by cross products with the arm, a fraction of what the 6×6 product takes.
    #[inline(always)]
    pub(crate) fn add_points(&mut self, arm: &Lane3, b: &[Lane; 6], v: &Lane3) {
        let [xx, xy, xz, yy, yz, zz] = *b;
        // Row r of B times −arm^ is arm × that row.
        let mixed = [
            cross(arm, &[xx, xy, xz]),
            cross(arm, &[xy, yy, yz]),
            cross(arm, &[xz, yz, zz]),
        ];
        let column = |c: usize| cross(arm, &[mixed[0][c], mixed[1][c], mixed[2][c]]);
        let turned = [column(0), column(1), column(2)];
        let turn = cross(arm, v);
        let upper: [&Lane; 21] = [
            &xx,
            &xy,
            &xz,
            &mixed[0][0],
            &mixed[0][1],
            &mixed[0][2],
            &yy,
            &yz,
            &mixed[1][0],
            &mixed[1][1],
            &mixed[1][2],
            &zz,
            &mixed[2][0],
            &mixed[2][1],
            &mixed[2][2],
            &turned[0][0],
            &turned[1][0],
            &turned[2][0],
            &turned[1][1],
            &turned[2][1],
            &turned[2][2],
        ];
        for (sum, term) in self.h.iter_mut().zip(upper) {
            add(sum, term);
        }
        for a in 0..3 {
            add(&mut self.g[a], &v[a]);
            add(&mut self.g[3 + a], &turn[a]);
        }
    }

    /// Adds to the turning half of the matrix what the curvature of a rotation brings: `v · ∂²p/∂θr∂θc`, which at zero is
    /// `½(vr armc + vc armr) − v·arm (r = c)`.
    #[inline(always)]
    pub(crate) fn add_curvature(&mut self, arm: &Lane3, v: &Lane3) {
        let p = |r: usize, c: usize| times(&v[r], &arm[c]);
        let (xx, yy, zz) = (p(0, 0), p(1, 1), p(2, 2));
        let (xy, yx) = (p(0, 1), p(1, 0));
        let (xz, zx) = (p(0, 2), p(2, 0));
        let (yz, zy) = (p(1, 2), p(2, 1));
        for l in 0..LANES {
            self.h[15][l] -= yy[l] + zz[l];
            self.h[16][l] += 0.5 * (xy[l] + yx[l]);
            self.h[17][l] += 0.5 * (xz[l] + zx[l]);
            self.h[18][l] -= xx[l] + zz[l];
            self.h[19][l] += 0.5 * (yz[l] + zy[l]);
            self.h[20][l] -= xx[l] + yy[l];
        }
    }

    /// Adds another's sums; the order of merging is part of the answer.
    pub(crate) fn merge(&mut self, other: Self) {
        for (a, b) in self.h.iter_mut().zip(&other.h) {
            add(a, b);
        }
        for (a, b) in self.g.iter_mut().zip(&other.g) {
            add(a, b);
        }
        add(&mut self.cost, &other.cost);
        add(&mut self.weight, &other.weight);
    }

    /// The lanes joined.
    pub(crate) fn joined(&self, count: usize) -> System {
        System {
            h: self.h.map(|l| joined(&l)),
            g: self.g.map(|l| joined(&l)),
            cost: joined(&self.cost),
            weight: joined(&self.weight),
            count,
        }
    }
}

/// The sum of all lanes, by halves.
#[inline(always)]
pub(crate) fn joined(l: &Lane) -> f64 {
    ((l[0] + l[4]) + (l[2] + l[6])) + ((l[1] + l[5]) + (l[3] + l[7]))
}

#[inline(always)]
pub(crate) fn times(a: &Lane, b: &Lane) -> Lane {
    std::array::from_fn(|l| a[l] * b[l])
}

#[inline(always)]
pub(crate) fn add(sum: &mut Lane, term: &Lane) {
    for l in 0..LANES {
        sum[l] += term[l];
    }
}

/// `sum += a b`.
#[inline(always)]
pub(crate) fn add_product(sum: &mut Lane, a: &Lane, b: &Lane) {
    for l in 0..LANES {
        sum[l] += a[l] * b[l];
    }
}

#[inline(always)]
pub(crate) fn dot(a: &Lane3, b: &Lane3) -> Lane {
    std::array::from_fn(|l| a[0][l] * b[0][l] + a[1][l] * b[1][l] + a[2][l] * b[2][l])
}

#[inline(always)]
pub(crate) fn cross(a: &Lane3, b: &Lane3) -> Lane3 {
    let part = |i: usize, k: usize| -> Lane {
        std::array::from_fn(|l| a[i][l] * b[k][l] - a[k][l] * b[i][l])
    };
    [part(1, 2), part(2, 0), part(0, 1)]
}

/// A symmetric matrix times a vector, lane by lane.
#[inline(always)]
pub(crate) fn applied(m: &[Lane; 6], v: &Lane3) -> Lane3 {
    let row = |a: usize, b: usize, c: usize| dot(&[m[a], m[b], m[c]], v);
    [row(0, 1, 2), row(1, 3, 4), row(2, 4, 5)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    #[test]
    fn solves_a_hand_made_system_and_ignores_blind_directions() {
        // Residuals see x by 2 and yaw by 3 (arc of 10 m); nothing else.
        let mut s = System::default();
        s.add_row(&[2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 4.0, 1.0);
        s.add_row(&[0.0, 0.0, 0.0, 0.0, 0.0, 3.0], -6.0, 0.5);
        let step = s.step(10.0, 1e-6).unwrap();
        let expected = [-2.0, 0.0, 0.0, 0.0, 0.0, 2.0];
        for (a, b) in step.iter().zip(expected) {
            assert!((a - b).abs() < 1e-12, "{step:?}");
        }
        assert!(System::default().step(1.0, 1e-6).is_none());
    }

    /// Against the products written out in full, a lane at a time.
    #[test]
    fn lanes_sum_what_the_full_products_are() {
        let mut rng = Rng::new(3, 0);
        let mut lane = || -> Lane { std::array::from_fn(|_| rng.range(-2.0, 2.0)) };
        let arm = [lane(), lane(), lane()];
        let b: [Lane; 6] = std::array::from_fn(|_| lane());
        let v = [lane(), lane(), lane()];
        let j: [Lane; 6] = std::array::from_fn(|_| lane());
        let (r, w) = (lane(), lane().map(f64::abs));
        let mut points = LaneSystem::default();
        points.add_points(&arm, &b, &v);
        let mut curved = points;
        curved.add_curvature(&arm, &v);
        let mut rows = LaneSystem::default();
        rows.add_rows(&j, &r, &w);
        let (mut of_points, mut of_curved) = ([[0.0; 7]; 6], [[0.0; 7]; 6]);
        let mut of_rows = System::default();
        for l in 0..LANES {
            let [x, y, z] = arm.map(|a| a[l]);
            // [I, −arm^], row by row.
            let jacobian = [
                [1.0, 0.0, 0.0, 0.0, z, -y],
                [0.0, 1.0, 0.0, -z, 0.0, x],
                [0.0, 0.0, 1.0, y, -x, 0.0],
            ];
            let m = b.map(|e| e[l]);
            let m = [[m[0], m[1], m[2]], [m[1], m[3], m[4]], [m[2], m[4], m[5]]];
            for p in 0..6 {
                for q in 0..6 {
                    let mut h = 0.0;
                    for i in 0..3 {
                        for k in 0..3 {
                            h += jacobian[i][p] * m[i][k] * jacobian[k][q];
                        }
                    }
                    of_points[p][q] += h;
                    of_curved[p][q] += h;
                    if p >= 3 && q >= 3 {
                        let (i, k) = (p - 3, q - 3);
                        let along: f64 = (0..3).map(|a| v[a][l] * arm[a][l]).sum();
                        let both = v[i][l] * arm[k][l] + v[k][l] * arm[i][l];
                        of_curved[p][q] += 0.5 * both - if i == k { along } else { 0.0 };
                    }
                }
                of_points[p][6] += (0..3).map(|i| jacobian[i][p] * v[i][l]).sum::<f64>();
            }
            of_rows.add_row(&j.map(|e| e[l]), r[l], w[l]);
        }
        let (points, curved) = (points.joined(0), curved.joined(0));
        for p in 0..6 {
            assert!((points.g[p] - of_points[p][6]).abs() < 1e-12);
            for q in 0..6 {
                assert!((points.matrix()[p][q] - of_points[p][q]).abs() < 1e-12);
                assert!((curved.matrix()[p][q] - of_curved[p][q]).abs() < 1e-12);
            }
        }
        let rows = rows.joined(LANES);
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        rows.h.iter().zip(of_rows.h).for_each(|(a, b)| close(*a, b));
        rows.g.iter().zip(of_rows.g).for_each(|(a, b)| close(*a, b));
        close(rows.cost, of_rows.cost);
        close(rows.weight, of_rows.weight);
        assert_eq!(rows.count, of_rows.count);
    }
}
