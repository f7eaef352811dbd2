//! The rigid transform between paired points, in closed form.

use nalgebra::{Matrix3, Vector3};

use crate::pose::Pose;
use crate::symmetric::eigen;

/// The rotation that maximises `tr(Rᵀ m)`: the one closest to `m` in the Frobenius norm, and the
/// least-squares rotation where `m` is the cross-covariance `Σ to fromᵀ` (Horn 1987, by the dominant
/// eigenvector of a 4×4 matrix, which cannot come out as a reflection).
///
/// `None` where the optimum is not unique.
pub(crate) fn best_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let s = |i: usize, j: usize| m[(j, i)];
    let (xx, yy, zz) = (s(0, 0), s(1, 1), s(2, 2));
    let (a, b, c) = (s(1, 2) - s(2, 1), s(2, 0) - s(0, 2), s(0, 1) - s(1, 0));
    let (d, e, f) = (s(0, 1) + s(1, 0), s(2, 0) + s(0, 2), s(1, 2) + s(2, 1));
    let n = [
        [xx + yy + zz, a, b, c],
        [a, xx - yy - zz, d, e],
        [b, d, yy - xx - zz, f],
        [c, e, f, zz - xx - yy],
    ];
    let found = eigen(n);
    let (top, second) = (found.values[3], found.values[2]);
    let size = top.abs().max(found.values[0].abs());
    if !(top - second > 1e-9 * size) {
        return None;
    }
    let [w, x, y, z] = found.vectors[3];
    Some(Matrix3::new(
        w * w + x * x - y * y - z * z,
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        w * w - x * x + y * y - z * z,
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        w * w - x * x - y * y + z * z,
    ))
}

/// The rigid transform that best takes each first point to its second in the least-squares sense
/// (Horn 1987), each pair with its weight. Sums run in the order given.
///
/// Returns `None` for fewer than three pairs or where either set spans no triangle, since the
/// rotation is then not determined.
#[must_use]
pub fn fit_rigid(pairs: impl Iterator<Item = ([f64; 3], [f64; 3], f64)> + Clone) -> Option<Pose> {
    let (mut count, mut weight) = (0usize, 0.0);
    let (mut mean_from, mut mean_to) = (Vector3::zeros(), Vector3::zeros());
    for (from, to, w) in pairs.clone() {
        count += usize::from(w > 0.0);
        weight += w;
        mean_from += Vector3::from(from) * w;
        mean_to += Vector3::from(to) * w;
    }
    if count < 3 || !(weight > 0.0) {
        return None;
    }
    mean_from /= weight;
    mean_to /= weight;
    let mut cross = Matrix3::zeros();
    for (from, to, w) in pairs {
        cross += (Vector3::from(to) - mean_to) * (Vector3::from(from) - mean_from).transpose() * w;
    }
    let rotation = best_rotation(&cross)?;
    Some(Pose::from_parts(rotation, mean_to - rotation * mean_from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn fit_rigid_refuses_a_line_and_two_points() {
        let line: Vec<_> = (0..5)
            .map(|i| ([f64::from(i), 0.0, 0.0], [0.0, f64::from(i), 0.0], 1.0))
            .collect();
        assert!(fit_rigid(line.iter().copied()).is_none());
        assert!(fit_rigid(line[..2].iter().copied()).is_none());
    }

    fn tangent() -> impl Strategy<Value = [f64; 6]> {
        let t = -50.0..50.0;
        let r = -1.8..1.8;
        (t.clone(), t.clone(), t, r.clone(), r.clone(), r)
            .prop_map(|(a, b, c, d, e, f)| [a, b, c, d, e, f])
    }

    proptest! {
        #[test]
        fn fit_rigid_finds_the_transform(x in tangent(), points in proptest::collection::vec((-9.0..9.0f64, -9.0..9.0f64, -9.0..9.0f64), 4..20)) {
            let pose = Pose::exp(x);
            let pairs: Vec<_> = points.iter().map(|&(a, b, c)| ([a, b, c], pose.transform([a, b, c]), 1.0)).collect();
            // Points at random span a plane, but now and then hardly.
            let found = fit_rigid(pairs.iter().copied());
            prop_assume!(found.is_some());
            for (from, to, _) in &pairs {
                let p = found.as_ref().map_or([f64::NAN; 3], |f| f.transform(*from));
                for i in 0..3 {
                    prop_assert!((p[i] - to[i]).abs() < 1e-6);
                }
            }
        }
    }
}
