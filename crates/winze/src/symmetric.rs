//! Eigen-decomposition of small symmetric matrices by cyclic Jacobi rotations.
//!
//! Only additions, multiplications, divisions and square roots, in a fixed order: the same bits on
//! every processor.

/// Eigenvalues, ascending, and unit eigenvectors (`vectors[i]` belongs to `values[i]`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Eigen<const N: usize> {
    pub(crate) values: [f64; N],
    pub(crate) vectors: [[f64; N]; N],
}

/// The decomposition of the symmetric matrix `m` (both triangles filled).
#[expect(clippy::needless_range_loop, reason = "rows and columns of a matrix")]
pub(crate) fn eigen<const N: usize>(mut m: [[f64; N]; N]) -> Eigen<N> {
    // Row i of `v` turns into eigenvector i.
    let mut v = [[0.0; N]; N];
    for i in 0..N {
        v[i][i] = 1.0;
    }
    for _sweep in 0..32 {
        let (mut off, mut diagonal) = (0.0, 0.0);
        for i in 0..N {
            diagonal += m[i][i] * m[i][i];
            for j in 0..i {
                off += m[i][j] * m[i][j];
            }
        }
        // Not `>`: NaN must end the loop too.
        if !(off > 1e-32 * diagonal) {
            break;
        }
        for p in 0..N {
            for q in p + 1..N {
                let (c, s) = rotation(m[p][p], m[p][q], m[q][q]);
                for k in 0..N {
                    let (x, y) = (m[k][p], m[k][q]);
                    m[k][p] = c * x - s * y;
                    m[k][q] = s * x + c * y;
                }
                for k in 0..N {
                    let (x, y) = (m[p][k], m[q][k]);
                    m[p][k] = c * x - s * y;
                    m[q][k] = s * x + c * y;
                    let (x, y) = (v[p][k], v[q][k]);
                    v[p][k] = c * x - s * y;
                    v[q][k] = s * x + c * y;
                }
            }
        }
    }
    let mut order: [usize; N] = std::array::from_fn(|i| i);
    order.sort_by(|&a, &b| m[a][a].total_cmp(&m[b][b]));
    Eigen {
        values: order.map(|i| m[i][i]),
        vectors: order.map(|i| v[i]),
    }
}

/// Cosine and sine of the rotation that makes `b` vanish in `[[a, b], [b, d]]`.
#[inline]
pub(crate) fn rotation(a: f64, b: f64, d: f64) -> (f64, f64) {
    if b == 0.0 {
        return (1.0, 0.0);
    }
    let theta = (d - a) / (2.0 * b);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    (c, t * c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix6, SymmetricEigen};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_nalgebra(entries in proptest::collection::vec(-10.0..10.0f64, 36), scale in -8i32..8) {
            let a = Matrix6::from_iterator(entries) * 10f64.powi(scale);
            let sym = a * a.transpose();
            let e = eigen::<6>(std::array::from_fn(|i| std::array::from_fn(|j| sym[(i, j)])));
            let mut oracle: Vec<f64> = SymmetricEigen::new(sym).eigenvalues.iter().copied().collect();
            oracle.sort_by(f64::total_cmp);
            let size = oracle[5].abs();
            for i in 0..6 {
                prop_assert!((e.values[i] - oracle[i]).abs() <= 1e-12 * size);
                for r in 0..6 {
                    let av: f64 = (0..6).map(|c| sym[(r, c)] * e.vectors[i][c]).sum();
                    prop_assert!((av - e.values[i] * e.vectors[i][r]).abs() <= 1e-11 * size);
                }
            }
        }
    }

    #[test]
    fn zero_and_broken_matrices_end() {
        assert_eq!(eigen([[0.0; 4]; 4]).values, [0.0; 4]);
        assert!(eigen([[f64::NAN; 3]; 3]).values.iter().all(|v| v.is_nan()));
        let _ = eigen([[f64::INFINITY; 3]; 3]);
    }
}
