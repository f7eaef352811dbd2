//! Eigenvalues and eigenvectors of symmetric 3×3 matrices, in closed form.
//!
//! Normals, ISS and NDT each solve one of these a point, so it is the innermost kernel of all.
//! The trigonometric solution of the characteristic cubic (Smith 1961), in `f64` after scaling,
//! with eigenvectors as cross products of rows; where two eigenvalues are too close for that, cyclic
//! Jacobi rotations, which always give an orthonormal basis.

use crate::symmetric::{eigen, rotation};
use crate::vec3::{add, cross, dot, scale};

/// Eigenvalues in ascending order and their unit eigenvectors (`vectors[i]` belongs to `values[i]`),
/// a right-handed basis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eigen3 {
    /// Ascending.
    pub values: [f64; 3],
    /// Orthonormal; each one's sign is arbitrary.
    pub vectors: [[f64; 3]; 3],
}

/// A symmetric 3×3 matrix as `[xx, xy, xz, yy, yz, zz]`.
pub type Symmetric3 = [f64; 6];

/// The decomposition of `m`. A matrix with an entry that is not finite gives NaN eigenvalues.
#[must_use]
pub fn eigen3(m: &Symmetric3) -> Eigen3 {
    let scale = m.iter().fold(0.0f64, |a, v| a.max(v.abs()));
    if !(scale > 0.0 && scale.is_finite()) {
        let value = if scale == 0.0 && m.iter().all(|v| *v == 0.0) {
            0.0
        } else {
            f64::NAN
        };
        return Eigen3 {
            values: [value; 3],
            vectors: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
    }
    let a = m.map(|v| v / scale);
    let values = eigenvalues(&a);
    // The vector of the eigenvalue that stands furthest apart is the best determined one.
    let (low_gap, high_gap) = (values[1] - values[0], values[2] - values[1]);
    let spread = values[2] - values[0];
    let found = if low_gap.max(high_gap) < 1e-5 * spread.max(f64::MIN_POSITIVE) || spread < 1e-7 {
        None
    } else if low_gap >= high_gap {
        basis_from(&a, &values, 0)
    } else {
        basis_from(&a, &values, 2)
    };
    let (values, vectors) = found.unwrap_or_else(|| {
        let e = eigen([[a[0], a[1], a[2]], [a[1], a[3], a[4]], [a[2], a[4], a[5]]]);
        (e.values, right_handed(e.vectors))
    });
    Eigen3 {
        values: values.map(|v| v * scale),
        vectors,
    }
}

/// Roots of the characteristic polynomial, ascending.
fn eigenvalues(a: &Symmetric3) -> [f64; 3] {
    let [xx, xy, xz, yy, yz, zz] = *a;
    let mean = (xx + yy + zz) / 3.0;
    let (dx, dy, dz) = (xx - mean, yy - mean, zz - mean);
    let off = xy * xy + xz * xz + yz * yz;
    let p = ((dx * dx + dy * dy + dz * dz + 2.0 * off) / 6.0).sqrt();
    if p == 0.0 {
        return [mean; 3];
    }
    let determinant =
        dx * (dy * dz - yz * yz) - xy * (xy * dz - yz * xz) + xz * (xy * yz - dy * xz);
    let r = (determinant / (2.0 * p * p * p)).clamp(-1.0, 1.0);
    let phi = libm::acos(r) / 3.0;
    let high = mean + 2.0 * p * libm::cos(phi);
    let low = mean + 2.0 * p * libm::cos(phi + std::f64::consts::TAU / 3.0);
    [low, 3.0 * mean - low - high, high]
}

/// The eigenvector of `values[which]` (0 or 2) from the cross products of the rows of `A − λI`,
/// then the other two from the 2×2 problem in the plane across it.
fn basis_from(
    a: &Symmetric3,
    values: &[f64; 3],
    which: usize,
) -> Option<([f64; 3], [[f64; 3]; 3])> {
    let [xx, xy, xz, yy, yz, zz] = *a;
    let l = values[which];
    let rows = [[xx - l, xy, xz], [xy, yy - l, yz], [xz, yz, zz - l]];
    let crosses = [
        cross(rows[0], rows[1]),
        cross(rows[0], rows[2]),
        cross(rows[1], rows[2]),
    ];
    let norms = crosses.map(|c| dot(c, c));
    let mut best = 0;
    for i in 1..3 {
        if norms[i] > norms[best] {
            best = i;
        }
    }
    if norms[best] < 1e-20 {
        return None;
    }
    let w = scale(crosses[best], 1.0 / norms[best].sqrt());
    // Any orthonormal u, v across w.
    let u = if w[0].abs() > w[1].abs() {
        scale([-w[2], 0.0, w[0]], 1.0 / (w[0] * w[0] + w[2] * w[2]).sqrt())
    } else {
        scale([0.0, w[2], -w[1]], 1.0 / (w[1] * w[1] + w[2] * w[2]).sqrt())
    };
    let v = cross(w, u);
    let (au, av) = (times(a, u), times(a, v));
    let (uu, uv, vv) = (dot(u, au), dot(u, av), dot(v, av));
    // One Jacobi rotation solves the 2×2 problem exactly.
    let (c, s) = rotation(uu, uv, vv);
    let first = add(scale(u, c), scale(v, -s));
    let second = add(scale(u, s), scale(v, c));
    let rayleigh = |x: [f64; 3]| dot(x, times(a, x));
    let (mut p, mut q) = ((rayleigh(first), first), (rayleigh(second), second));
    if p.0 > q.0 {
        std::mem::swap(&mut p, &mut q);
    }
    let own = (rayleigh(w), w);
    let order = if which == 0 { [own, p, q] } else { [p, q, own] };
    Some((order.map(|o| o.0), right_handed(order.map(|o| o.1))))
}

fn right_handed(mut v: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    if dot(cross(v[0], v[1]), v[2]) < 0.0 {
        v[2] = scale(v[2], -1.0);
    }
    v
}

/// Matrices that are solved side by side.
pub(crate) const BATCH: usize = 16;

/// Positive semidefinite matrices, an array an entry (see [`Symmetric3`]), so that a loop over them vectorises.
pub(crate) type Batch = [[f64; BATCH]; 6];

/// What [`solve`] finds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Solved {
    /// Ascending.
    pub(crate) values: [[f64; BATCH]; 3],
    /// The unit eigenvector of the smallest one.
    pub(crate) least: [[f64; BATCH]; 3],
    /// 1 where the values are right to about 10⁻⁸ of the trace, the worst where two nearly coincide, and far better elsewhere.
    pub(crate) sure: [f64; BATCH],
    /// 1 where the vector is right to about 10⁻⁹ too.
    pub(crate) vector_sure: [f64; BATCH],
}

/// Newton's steps: they begin below the smallest root, where they cannot overshoot it, and the error is squared each time.
const STEPS: usize = 7;

/// Eigenvalues and the smallest one's vector. Where it is not sure of them, as where all three values are nearly alike,
/// [`eigen3`] has to be asked.
#[inline(always)]
pub(crate) fn solve(m: &Batch) -> Solved {
    let mut a = [[0.0; BATCH]; 6];
    let mut trace = [0.0; BATCH];
    // Characteristic polynomial of a / trace: d - c λ + λ² - λ³.
    let (mut c, mut d) = ([0.0; BATCH], [0.0; BATCH]);
    for k in 0..BATCH {
        trace[k] = m[0][k] + m[3][k] + m[5][k];
        let inverse = 1.0 / trace[k];
        for e in 0..6 {
            a[e][k] = m[e][k] * inverse;
        }
        let [xx, xy, xz, yy, yz, zz] = [a[0][k], a[1][k], a[2][k], a[3][k], a[4][k], a[5][k]];
        let (x, y, z) = (yy * zz - yz * yz, xy * zz - yz * xz, xy * yz - yy * xz);
        c[k] = x + (xx * zz - xz * xz) + (xx * yy - xy * xy);
        d[k] = xx * x - xy * y + xz * z;
    }
    let (mut root, mut step) = ([0.0; BATCH], [0.0; BATCH]);
    for _ in 0..STEPS {
        for k in 0..BATCH {
            let l: f64 = root[k];
            let value = ((1.0 - l) * l - c[k]) * l + d[k];
            let slope = (2.0 - 3.0 * l) * l - c[k];
            step[k] = value / slope;
            root[k] = l - step[k];
        }
    }
    let mut out = Solved {
        values: [[0.0; BATCH]; 3],
        least: [[0.0; BATCH]; 3],
        sure: [0.0; BATCH],
        vector_sure: [0.0; BATCH],
    };
    for k in 0..BATCH {
        let l = root[k];
        // The other two have this sum and this product.
        let sum = 1.0 - l;
        let product = c[k] - l * sum;
        let root = (sum * sum - 4.0 * product).max(0.0).sqrt();
        let high = 0.5 * (sum + root);
        let middle = product / high;
        out.values[0][k] = l * trace[k];
        out.values[1][k] = middle * trace[k];
        out.values[2][k] = high * trace[k];
        let sure = step[k].abs() < 1e-9 && middle >= l;
        out.sure[k] = if sure { 1.0 } else { 0.0 };
        // Rows of A - λI, across all of which the vector lies: the longest of their cross products.
        let r = [a[0][k] - l, a[1][k], a[2][k]];
        let s = [a[1][k], a[3][k] - l, a[4][k]];
        let t = [a[2][k], a[4][k], a[5][k] - l];
        let (u, v, w) = (cross(r, s), cross(r, t), cross(s, t));
        let (uu, vv, ww) = (dot(u, u), dot(v, v), dot(w, w));
        let second = vv > uu;
        let best = if second { vv } else { uu };
        let third = ww > best;
        let best = if third { ww } else { best };
        let scale = 1.0 / best.sqrt();
        for e in 0..3 {
            let one = if second { v[e] } else { u[e] };
            let one = if third { w[e] } else { one };
            out.least[e][k] = one * scale;
        }
        out.vector_sure[k] = if sure && best > 1e-13 { 1.0 } else { 0.0 };
    }
    out
}

pub(crate) fn times(a: &Symmetric3, v: [f64; 3]) -> [f64; 3] {
    [
        a[0] * v[0] + a[1] * v[1] + a[2] * v[2],
        a[1] * v[0] + a[3] * v[1] + a[4] * v[2],
        a[2] * v[0] + a[4] * v[1] + a[5] * v[2],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, SymmetricEigen};
    use proptest::prelude::*;

    fn check(m: &Symmetric3) {
        let e = eigen3(m);
        let scale = m
            .iter()
            .fold(0.0f64, |a, v| a.max(v.abs()))
            .max(f64::MIN_POSITIVE);
        for i in 0..3 {
            let av = times(m, e.vectors[i]);
            for k in 0..3 {
                let residual = (av[k] - e.values[i] * e.vectors[i][k]).abs() / scale;
                assert!(residual < 1e-9, "residual {residual:e} for {m:?}: {e:?}");
            }
            for j in 0..3 {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!(
                    (dot(e.vectors[i], e.vectors[j]) - expected).abs() < 1e-9,
                    "{m:?}: {e:?}"
                );
            }
        }
        assert!(
            e.values[0] <= e.values[1] + 1e-12 * scale
                && e.values[1] <= e.values[2] + 1e-12 * scale
        );
        let full = Matrix3::new(m[0], m[1], m[2], m[1], m[3], m[4], m[2], m[4], m[5]);
        let mut oracle: Vec<f64> = SymmetricEigen::new(full)
            .eigenvalues
            .iter()
            .copied()
            .collect();
        oracle.sort_by(f64::total_cmp);
        for (a, b) in e.values.iter().zip(oracle) {
            assert!((a - b).abs() < 1e-9 * scale, "{m:?}: {:?}", e.values);
        }
    }

    #[test]
    fn degenerate_matrices() {
        check(&[0.0; 6]);
        check(&[1.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
        check(&[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        check(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        check(&[1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
        check(&[2.0, 0.0, 0.0, 1.0, 0.0, 1.0]);
        check(&[1.0, 1e-9, 0.0, 1.0 + 1e-9, 1e-10, 1.0]);
        check(&[1e-300, 0.0, 0.0, 2e-300, 0.0, 3e-300]);
        check(&[1e30, 1e29, 0.0, 2e30, 0.0, 3e-30]);
        assert!(eigen3(&[f64::NAN; 6]).values[0].is_nan());
        assert!(eigen3(&[f64::INFINITY, 0.0, 0.0, 0.0, 0.0, 0.0]).values[0].is_nan());
    }

    #[test]
    fn a_hand_computed_matrix() {
        // [[2, 1, 0], [1, 2, 0], [0, 0, 5]] has eigenvalues 1, 3, 5.
        let e = eigen3(&[2.0, 1.0, 0.0, 2.0, 0.0, 5.0]);
        for (a, b) in e.values.iter().zip([1.0, 3.0, 5.0]) {
            assert!((a - b).abs() < 1e-14);
        }
        assert!((e.vectors[0][0] + e.vectors[0][1]).abs() < 1e-14);
    }

    /// Those that are solved side by side beside those that are solved alone; how many it was sure of.
    fn check_batch(matrices: &[Symmetric3]) -> usize {
        let mut sure = 0;
        for part in matrices.chunks(BATCH) {
            let mut batch = [[0.0; BATCH]; 6];
            for (k, m) in part.iter().enumerate() {
                (0..6).for_each(|e| batch[e][k] = m[e]);
            }
            let found = solve(&batch);
            for (k, m) in part.iter().enumerate() {
                let e = eigen3(m);
                let trace = m[0] + m[3] + m[5];
                if found.sure[k] > 0.0 {
                    for i in 0..3 {
                        let error = (found.values[i][k] - e.values[i]).abs() / trace;
                        assert!(error < 1e-7, "{m:?}: {error:e}");
                    }
                }
                if found.vector_sure[k] > 0.0 {
                    let v = [found.least[0][k], found.least[1][k], found.least[2][k]];
                    assert!(dot(v, e.vectors[0]).abs() > 1.0 - 1e-9, "{m:?}");
                    sure += 1;
                }
            }
        }
        sure
    }

    #[test]
    fn side_by_side_as_alone() {
        let mut rng = crate::rng::Rng::new(3, 0);
        // Of clouds of every shape, from balls to lines and planes.
        let mut matrices = Vec::new();
        for i in 0..3000 {
            let shape = [
                1.0,
                [1.0, 0.3, 1e-2, 1e-4][i % 4],
                [1.0, 0.1, 1e-3, 0.0][i / 4 % 4],
            ];
            let axes: [[f64; 3]; 3] =
                std::array::from_fn(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0)));
            let mut m = [0.0; 6];
            for (axis, s) in axes.iter().zip(shape) {
                let p = axis.map(|v| v * s);
                let upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
                for (m, (a, b)) in m.iter_mut().zip(upper) {
                    *m += p[a] * p[b];
                }
            }
            matrices.push(m);
        }
        // Nearly lines, one in sixteen or so, it leaves to the other.
        assert!(check_batch(&matrices) > 2500);
        let hard = [
            [0.0; 6],
            [1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [1.0, 1.0, 1.0, 1.0, 1.0, 1.0],
            [f64::NAN; 6],
        ];
        assert!(check_batch(&hard) <= 1);
    }

    proptest! {
        #[test]
        fn random_matrices(v in proptest::array::uniform6(-10.0..10.0f64)) {
            check(&v);
        }

        #[test]
        fn covariances_of_planes_and_lines(
            a in proptest::array::uniform3(-1.0..1.0f64),
            b in proptest::array::uniform3(-1.0..1.0f64),
            thin in 0.0..1e-6f64,
        ) {
            let outer = |v: [f64; 3], s: f64| [v[0]*v[0]*s, v[0]*v[1]*s, v[0]*v[2]*s, v[1]*v[1]*s, v[1]*v[2]*s, v[2]*v[2]*s];
            let (p, q) = (outer(a, 1.0), outer(b, thin));
            check(&std::array::from_fn(|i| p[i] + q[i]));
        }
    }
}
