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

    /// Adds another's sums; the order of merging is part of the answer.
    pub fn merge(&mut self, other: Self) {
        for (a, b) in self.h.iter_mut().zip(other.h) {
            *a += b;
        }
        for (a, b) in self.g.iter_mut().zip(other.g) {
            *a += b;
        }
        self.cost += other.cost;
        self.weight += other.weight;
        self.count += other.count;
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
