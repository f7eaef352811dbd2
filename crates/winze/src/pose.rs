//! Rigid transforms in three dimensions, SE(3), in `f64`.
//!
//! A pose named `map_from_query` takes points of the query frame to the map frame:
//! `p_map = map_from_query.transform(p_query)`. Composition reads the same way:
//! `map_from_query = map_from_base.compose(&base_from_query)`.
//!
//! * **Parameters**: rotation matrix `R` (orthonormal, determinant 1) and translation `t`, metres.
//! * **Action**: `p ↦ R p + t`.
//! * **Tangent**: `[ρ, θ]`, translation part first (metres), rotation vector second (radians).
//! * **Group operation**: `(R₁, t₁)(R₂, t₂) = (R₁R₂, R₁t₂ + t₁)`.
//! * **Inverse**: `(Rᵀ, −Rᵀt)`.
//!
//! Sines and the like come from `libm`, not from the platform, so that processors agree on every bit.

use nalgebra::{Matrix3, Vector3};

use crate::error::{Error, Result};
use crate::fit::best_rotation;

/// A rigid transform, see the [module documentation](self).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

/// How far one pose is from another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseDistance {
    /// Displacement of the chosen point, metres.
    pub translation: f64,
    /// Rotation angle, radians.
    pub rotation: f64,
}

impl Default for Pose {
    fn default() -> Self {
        Self::identity()
    }
}

impl Pose {
    /// The transform that changes nothing.
    #[must_use]
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation: Vector3::zeros(),
        }
    }

    /// A pure translation, metres.
    #[must_use]
    pub fn from_translation(translation: [f64; 3]) -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation: translation.into(),
        }
    }

    /// From a rotation vector (axis times angle, radians) and a translation (metres).
    #[must_use]
    pub fn from_rotation_vector(rotation: [f64; 3], translation: [f64; 3]) -> Self {
        Self {
            rotation: so3_exp(&rotation.into()),
            translation: translation.into(),
        }
    }

    /// From yaw about z, pitch about y and roll about x (radians, applied roll first) and a
    /// translation (metres): `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    #[must_use]
    pub fn from_yaw_pitch_roll(yaw: f64, pitch: f64, roll: f64, translation: [f64; 3]) -> Self {
        let rz = so3_exp(&Vector3::new(0.0, 0.0, yaw));
        let ry = so3_exp(&Vector3::new(0.0, pitch, 0.0));
        let rx = so3_exp(&Vector3::new(roll, 0.0, 0.0));
        Self {
            rotation: rz * ry * rx,
            translation: translation.into(),
        }
    }

    /// Yaw, pitch and roll in radians, the inverse of [`Pose::from_yaw_pitch_roll`]. At a pitch of
    /// ±90° yaw and roll are not unique; roll is then taken as zero.
    #[must_use]
    pub fn yaw_pitch_roll(&self) -> [f64; 3] {
        let r = &self.rotation;
        let cos_pitch = (r[(0, 0)] * r[(0, 0)] + r[(1, 0)] * r[(1, 0)]).sqrt();
        let pitch = libm::atan2(-r[(2, 0)], cos_pitch);
        if cos_pitch < 1e-9 {
            return [libm::atan2(-r[(0, 1)], r[(1, 1)]), pitch, 0.0];
        }
        [
            libm::atan2(r[(1, 0)], r[(0, 0)]),
            pitch,
            libm::atan2(r[(2, 1)], r[(2, 2)]),
        ]
    }

    /// From a row-major 4×4 matrix.
    ///
    /// The rotation is projected onto the nearest orthonormal matrix, since text files carry few
    /// digits.
    ///
    /// # Errors
    /// [`Error::NotRigid`] where an entry is not finite, the last row is not `0 0 0 1`, the upper
    /// left block is further than 1 % from a rotation, or it is a reflection.
    pub fn from_matrix(matrix: [[f64; 4]; 4]) -> Result<Self> {
        let as_given = Self::from_exact_matrix(matrix)?;
        let m = as_given.rotation;
        Ok(Self {
            rotation: best_rotation(&m).unwrap_or(m),
            ..as_given
        })
    }

    /// From a row-major 4×4 matrix that [`Pose::to_matrix`] gave: the same pose, to the bit. Nothing is projected.
    ///
    /// # Errors
    /// As [`Pose::from_matrix`].
    pub fn from_exact_matrix(matrix: [[f64; 4]; 4]) -> Result<Self> {
        if matrix.iter().flatten().any(|v| !v.is_finite()) {
            return Err(Error::NotRigid("an entry is not a finite number".into()));
        }
        if matrix[3]
            .iter()
            .zip([0.0, 0.0, 0.0, 1.0])
            .any(|(a, b)| (a - b).abs() > 1e-6)
        {
            return Err(Error::NotRigid(format!(
                "the last row is {:?} and should be [0, 0, 0, 1]",
                matrix[3]
            )));
        }
        let m = Matrix3::from_fn(|i, j| matrix[i][j]);
        let off = (m.transpose() * m - Matrix3::identity()).abs().max();
        if off > 0.02 {
            return Err(Error::NotRigid(format!(
                "the upper left 3x3 block is not orthonormal (off by {off:.3}); scale and shear are not allowed"
            )));
        }
        if m.determinant() < 0.0 {
            return Err(Error::NotRigid(
                "the upper left 3x3 block mirrors (its determinant is -1)".into(),
            ));
        }
        Ok(Self {
            rotation: m,
            translation: Vector3::new(matrix[0][3], matrix[1][3], matrix[2][3]),
        })
    }

    /// As a row-major 4×4 matrix.
    #[must_use]
    pub fn to_matrix(&self) -> [[f64; 4]; 4] {
        let (r, t) = (&self.rotation, &self.translation);
        let row = |i: usize| [r[(i, 0)], r[(i, 1)], r[(i, 2)], t[i]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    pub(crate) fn from_parts(rotation: Matrix3<f64>, translation: Vector3<f64>) -> Self {
        Self {
            rotation,
            translation,
        }
    }

    pub(crate) fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    pub(crate) fn translation_vector(&self) -> &Vector3<f64> {
        &self.translation
    }

    /// The translation, metres.
    #[must_use]
    pub fn translation(&self) -> [f64; 3] {
        self.translation.into()
    }

    /// The rotation's angle, radians, in `[0, π]`.
    #[must_use]
    pub fn angle(&self) -> f64 {
        so3_log(&self.rotation).norm()
    }

    /// The rotation as axis times angle, radians (what [`Pose::from_rotation_vector`] takes).
    #[must_use]
    pub fn rotation_vector(&self) -> [f64; 3] {
        so3_log(&self.rotation).into()
    }

    /// `R p + t`.
    #[must_use]
    pub fn transform(&self, p: [f64; 3]) -> [f64; 3] {
        (self.rotation * Vector3::from(p) + self.translation).into()
    }

    /// `R v`: directions turn, they do not move.
    #[must_use]
    pub fn rotate(&self, v: [f64; 3]) -> [f64; 3] {
        (self.rotation * Vector3::from(v)).into()
    }

    /// `self ∘ other`: first `other`, then `self`.
    #[must_use]
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            translation: self.rotation * other.translation + self.translation,
        }
    }

    /// The transform that undoes this one.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    /// The exponential of a tangent vector `[ρ, θ]`: `R = exp(θ^)`, `t = V(θ) ρ` with the left
    /// Jacobian `V` of SO(3).
    #[must_use]
    pub fn exp(tangent: [f64; 6]) -> Self {
        let rho = Vector3::new(tangent[0], tangent[1], tangent[2]);
        let theta = Vector3::new(tangent[3], tangent[4], tangent[5]);
        let (_, b, c) = so3_coefficients(theta.norm());
        let hat = skew(&theta);
        let v = Matrix3::identity() + hat * b + hat * hat * c;
        Self {
            rotation: so3_exp(&theta),
            translation: v * rho,
        }
    }

    /// The tangent vector `[ρ, θ]` whose exponential is this pose; `|θ| ≤ π`.
    #[must_use]
    pub fn log(&self) -> [f64; 6] {
        let theta = so3_log(&self.rotation);
        let angle = theta.norm();
        let (a, b, _) = so3_coefficients(angle);
        let hat = skew(&theta);
        // V⁻¹ = I − θ^/2 + (1/|θ|²)(1 − a / 2b) θ^²
        let d = if angle < SERIES {
            let q = angle * angle;
            1.0 / 12.0 + q / 720.0 + q * q / 30240.0
        } else {
            (1.0 - a / (2.0 * b)) / (angle * angle)
        };
        let rho = (Matrix3::identity() - hat * 0.5 + hat * hat * d) * self.translation;
        [rho[0], rho[1], rho[2], theta[0], theta[1], theta[2]]
    }

    /// The adjoint: `T exp(x) = exp(Ad_T x) T` for tangent vectors `x = [ρ, θ]`.
    #[must_use]
    pub fn adjoint(&self) -> [[f64; 6]; 6] {
        let r = self.rotation;
        let tr = skew(&self.translation) * r;
        std::array::from_fn(|i| {
            std::array::from_fn(|j| match (i < 3, j < 3) {
                (true, true) | (false, false) => r[(i % 3, j % 3)],
                (true, false) => tr[(i, j - 3)],
                (false, true) => 0.0,
            })
        })
    }

    /// Turns by the rotation vector `rotation` (radians) about the point `centre`, then moves by
    /// `translation` (metres); both in the axes of the outer frame:
    /// `p ← exp(δθ)(p − c) + c + δt` after this pose.
    ///
    /// All solvers of this crate step this way, and the covariance of an
    /// [`Outcome`](crate::Outcome) is stated in these terms: about the query's centroid a step's
    /// two halves hardly touch each other, however far the frames' origins lie.
    #[must_use]
    pub fn perturbed(&self, translation: [f64; 3], rotation: [f64; 3], centre: [f64; 3]) -> Self {
        let turn = so3_exp(&rotation.into());
        let c = Vector3::from(centre);
        Self {
            rotation: turn * self.rotation,
            translation: turn * (self.translation - c) + c + Vector3::from(translation),
        }
    }

    /// How far `self` and `other` put the point `at` (of the inner frame) from each other, and the
    /// angle between their rotations. The displacement of an origin that lies far from all points
    /// says little; ask about the cloud's centroid.
    #[must_use]
    pub fn distance(&self, other: &Self, at: [f64; 3]) -> PoseDistance {
        let p = Vector3::from(at);
        let a = self.rotation * p + self.translation;
        let b = other.rotation * p + other.translation;
        PoseDistance {
            translation: (a - b).norm(),
            rotation: so3_log(&(self.rotation.transpose() * other.rotation)).norm(),
        }
    }

    /// The same transform between frames whose origins were shifted: for points given as offsets
    /// from `inner_origin`, answering offsets from `outer_origin`.
    #[must_use]
    pub fn between_origins(&self, outer_origin: [f64; 3], inner_origin: [f64; 3]) -> Self {
        Self {
            rotation: self.rotation,
            translation: self.rotation * Vector3::from(inner_origin) + self.translation
                - Vector3::from(outer_origin),
        }
    }

    /// Undoes [`Pose::between_origins`].
    #[must_use]
    pub fn from_between_origins(&self, outer_origin: [f64; 3], inner_origin: [f64; 3]) -> Self {
        Self {
            rotation: self.rotation,
            translation: self.translation - self.rotation * Vector3::from(inner_origin)
                + Vector3::from(outer_origin),
        }
    }
}

/// The matrix of the cross product: `skew(a) b = a × b`.
pub(crate) fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Below this angle (radians) the closed forms lose digits to cancellation and three terms of their
/// series are exact to the last bit or two.
const SERIES: f64 = 0.01;

/// `sin θ/θ`, `(1 − cos θ)/θ²` and `(θ − sin θ)/θ³`, by series near zero.
fn so3_coefficients(angle: f64) -> (f64, f64, f64) {
    let q = angle * angle;
    if angle < SERIES {
        return (
            1.0 - q / 6.0 + q * q / 120.0,
            0.5 - q / 24.0 + q * q / 720.0,
            1.0 / 6.0 - q / 120.0 + q * q / 5040.0,
        );
    }
    let (sin, cos) = (libm::sin(angle), libm::cos(angle));
    (sin / angle, (1.0 - cos) / q, (angle - sin) / (q * angle))
}

/// Rodrigues' formula.
pub(crate) fn so3_exp(theta: &Vector3<f64>) -> Matrix3<f64> {
    let (a, b, _) = so3_coefficients(theta.norm());
    let hat = skew(theta);
    Matrix3::identity() + hat * a + hat * hat * b
}

/// The rotation vector of a rotation matrix, by way of the quaternion (Shepperd's method), which
/// stays accurate at small angles and at half turns alike.
pub(crate) fn so3_log(r: &Matrix3<f64>) -> Vector3<f64> {
    let [w, x, y, z] = quaternion(r);
    let v = Vector3::new(x, y, z);
    let n = v.norm();
    if n < 1e-12 {
        return v * 2.0;
    }
    v * (2.0 * libm::atan2(n, w) / n)
}

/// Unit quaternion `[w, x, y, z]`, `w ≥ 0`, of a rotation matrix.
fn quaternion(r: &Matrix3<f64>) -> [f64; 4] {
    let trace = r[(0, 0)] + r[(1, 1)] + r[(2, 2)];
    // The largest of the four squares decides which root is safe to take.
    let candidates = [trace, r[(0, 0)], r[(1, 1)], r[(2, 2)]];
    let mut best = 0;
    for i in 1..4 {
        if candidates[i] > candidates[best] {
            best = i;
        }
    }
    let mut q = [0.0; 4];
    if best == 0 {
        q[0] = 1.0 + trace;
        q[1] = r[(2, 1)] - r[(1, 2)];
        q[2] = r[(0, 2)] - r[(2, 0)];
        q[3] = r[(1, 0)] - r[(0, 1)];
    } else {
        let i = best - 1;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        q[0] = r[(k, j)] - r[(j, k)];
        q[i + 1] = 1.0 + r[(i, i)] - r[(j, j)] - r[(k, k)];
        q[j + 1] = r[(j, i)] + r[(i, j)];
        q[k + 1] = r[(k, i)] + r[(i, k)];
    }
    let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
    let sign = if q[0] < 0.0 { -norm } else { norm };
    q.map(|c| c / sign)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn close(a: &Pose, b: &Pose, tolerance: f64) -> bool {
        a.to_matrix()
            .iter()
            .flatten()
            .zip(b.to_matrix().iter().flatten())
            .all(|(x, y)| (x - y).abs() < tolerance)
    }

    /// Elements that break careless formulas: zero, tiny, quarter, nearly half and half turns.
    fn nasty() -> Vec<[f64; 6]> {
        let mut out = vec![[0.0; 6]];
        for angle in [
            1e-12,
            1e-8,
            1e-5,
            1e-3,
            0.00999,
            0.01001,
            0.5,
            PI / 2.0,
            3.0,
            PI - 1e-6,
            PI - 1e-9,
        ] {
            for axis in [
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [0.0, 0.0, -1.0],
                [0.6, 0.0, 0.8],
            ] {
                let t = axis.map(|a: f64| a * angle);
                out.push([1.0, -2.0, 3.0, t[0], t[1], t[2]]);
                out.push([-1e3, 0.0, 1e-3, t[0], t[1], t[2]]);
            }
        }
        out
    }

    #[test]
    fn exp_and_log_are_inverse_on_nasty_elements() {
        for x in nasty() {
            let pose = Pose::exp(x);
            let back = pose.log();
            for (a, b) in x.iter().zip(back) {
                assert!(
                    (a - b).abs() < 1e-6 * (1.0 + a.abs()),
                    "{x:?} came back as {back:?}"
                );
            }
            assert!(close(&Pose::exp(back), &pose, 1e-7), "{x:?}");
        }
    }

    #[test]
    fn a_half_turn_has_a_log() {
        for axis in [[PI, 0.0, 0.0], [0.0, PI, 0.0], [0.0, 0.0, PI]] {
            let pose = Pose::from_rotation_vector(axis, [1.0, 2.0, 3.0]);
            assert!((pose.angle() - PI).abs() < 1e-12);
            assert!(close(&Pose::exp(pose.log()), &pose, 1e-9));
        }
    }

    #[test]
    fn yaw_pitch_roll_of_a_hand_computed_rotation() {
        // Yaw 90° takes x to y; then pitch about the new y takes x down.
        let pose = Pose::from_yaw_pitch_roll(PI / 2.0, 0.0, 0.0, [0.0; 3]);
        let p = pose.transform([1.0, 0.0, 0.0]);
        assert!((p[1] - 1.0).abs() < 1e-12 && p[0].abs() < 1e-12);
        let gimbal = Pose::from_yaw_pitch_roll(0.3, PI / 2.0, 0.0, [0.0; 3]);
        let [y, p, r] = gimbal.yaw_pitch_roll();
        assert!(close(
            &Pose::from_yaw_pitch_roll(y, p, r, [0.0; 3]),
            &gimbal,
            1e-9
        ));
    }

    #[test]
    fn matrices_that_are_not_rigid_are_refused() {
        let mut m = Pose::identity().to_matrix();
        m[0][0] = 2.0;
        assert!(matches!(Pose::from_matrix(m), Err(Error::NotRigid(_))));
        m[0][0] = -1.0;
        assert!(matches!(Pose::from_matrix(m), Err(Error::NotRigid(_))));
        m[0][0] = f64::NAN;
        assert!(matches!(Pose::from_matrix(m), Err(Error::NotRigid(_))));
        m[0][0] = 1.0;
        m[3] = [0.0, 0.0, 1.0, 1.0];
        assert!(matches!(Pose::from_matrix(m), Err(Error::NotRigid(_))));
    }

    #[test]
    fn rounded_digits_are_projected_back_to_a_rotation() {
        let pose = Pose::exp([1.0, 2.0, 3.0, 0.3, -0.2, 2.0]);
        let rounded = pose.to_matrix().map(|r| r.map(|v| (v * 1e4).round() / 1e4));
        let back = Pose::from_matrix(rounded).unwrap();
        let r = back.rotation();
        assert!((r.transpose() * r - Matrix3::identity()).abs().max() < 1e-14);
        assert!(close(&back, &pose, 2e-4));
    }

    fn tangent() -> impl Strategy<Value = [f64; 6]> {
        let t = -50.0..50.0;
        let r = -1.8..1.8;
        (t.clone(), t.clone(), t, r.clone(), r.clone(), r)
            .prop_map(|(a, b, c, d, e, f)| [a, b, c, d, e, f])
    }

    proptest! {
        #[test]
        fn group_laws(x in tangent(), y in tangent(), z in tangent()) {
            let (a, b, c) = (Pose::exp(x), Pose::exp(y), Pose::exp(z));
            prop_assert!(close(&a.compose(&b).compose(&c), &a.compose(&b.compose(&c)), 1e-9));
            prop_assert!(close(&a.compose(&a.inverse()), &Pose::identity(), 1e-9));
        }

        #[test]
        fn adjoint_moves_a_tangent_across(x in tangent(), y in tangent()) {
            let (t, small) = (Pose::exp(x), y.map(|v| v * 1e-2));
            let ad = t.adjoint();
            let moved: [f64; 6] = std::array::from_fn(|i| (0..6).map(|j| ad[i][j] * small[j]).sum());
            prop_assert!(close(&t.compose(&Pose::exp(small)), &Pose::exp(moved).compose(&t), 1e-9));
        }

        #[test]
        fn perturbed_leaves_the_centre_but_for_the_translation(x in tangent(), y in tangent()) {
            let pose = Pose::exp(x);
            let c = pose.transform([y[0], y[1], y[2]]);
            let moved = pose.perturbed([0.1, -0.2, 0.3], [y[3], y[4], y[5]], c).transform([y[0], y[1], y[2]]);
            prop_assert!((moved[0] - c[0] - 0.1).abs() < 1e-9);
            prop_assert!((moved[1] - c[1] + 0.2).abs() < 1e-9);
            prop_assert!((moved[2] - c[2] - 0.3).abs() < 1e-9);
        }

        #[test]
        fn origins_can_be_shifted_and_shifted_back(x in tangent(), y in tangent()) {
            let pose = Pose::exp(x);
            let (outer, inner) = ([5e5, 4.5e6, 300.0], [y[0], y[1], y[2]]);
            let local = pose.between_origins(outer, inner);
            prop_assert!(close(&local.from_between_origins(outer, inner), &pose, 1e-8));
            let p = local.transform([1.0, 2.0, 3.0]);
            let q = pose.transform([inner[0] + 1.0, inner[1] + 2.0, inner[2] + 3.0]);
            for i in 0..3 {
                prop_assert!((p[i] + outer[i] - q[i]).abs() < 1e-8);
            }
        }
    }
}
