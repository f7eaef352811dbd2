//! A mine as a signed distance: drifts cut out of solid rock.

use crate::noise::relief;

/// A straight drift of rectangular section with an arched back, rounded by the rock's relief.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drift {
    /// One end of the floor's centreline, metres.
    pub from: [f64; 3],
    /// The other end.
    pub to: [f64; 3],
    /// Width, metres.
    pub width: f64,
    /// Height, metres.
    pub height: f64,
}

/// Drifts in rough rock.
#[derive(Debug, Clone, PartialEq)]
pub struct Mine {
    /// The openings.
    pub drifts: Vec<Drift>,
    /// How far the walls stray from their plan, metres: 0.05 for shotcrete, 0.4 for blasted rock.
    pub roughness: f64,
    /// Seed of the relief.
    pub seed: u64,
}

impl Mine {
    /// Distance from `p` to the rock, metres: positive in the open, negative within the rock. A
    /// lower bound rather than the exact distance; following it along a ray is safe.
    #[must_use]
    pub fn clearance(&self, p: [f64; 3]) -> f64 {
        let plan = self
            .drifts
            .iter()
            .map(|d| d.clearance(p))
            .fold(f64::NEG_INFINITY, f64::max);
        // Far from the walls their relief does not matter, and it is the costly part.
        if plan.abs() > self.roughness + 0.1 {
            return plan - plan.signum() * self.roughness;
        }
        // Traffic flattens the floor.
        let above_floor = self
            .drifts
            .iter()
            .map(|d| d.above_floor(p))
            .fold(f64::INFINITY, f64::min);
        let worn = if above_floor < 0.3 { 0.25 } else { 1.0 };
        plan + relief(p, worn * self.roughness, 3.5, 5, self.seed)
    }
}

impl Drift {
    /// Place along the drift (0 to its length), across it and above its floor, metres.
    fn local(&self, p: [f64; 3]) -> ([f64; 3], f64) {
        let along: [f64; 3] = std::array::from_fn(|a| self.to[a] - self.from[a]);
        let length = (along[0] * along[0] + along[1] * along[1] + along[2] * along[2])
            .sqrt()
            .max(1e-9);
        let flat = (along[0] * along[0] + along[1] * along[1]).sqrt().max(1e-9);
        let d: [f64; 3] = std::array::from_fn(|a| p[a] - self.from[a]);
        let s = (d[0] * along[0] + d[1] * along[1]) / flat;
        let across = (d[1] * along[0] - d[0] * along[1]) / flat;
        // Floors follow the grade, walls stand upright.
        let up = d[2] - s.clamp(0.0, flat) * along[2] / flat;
        ([s, across, up], length)
    }

    fn above_floor(&self, p: [f64; 3]) -> f64 {
        let ([s, across, up], length) = self.local(p);
        if s < 0.0 || s > length || across.abs() > 0.5 * self.width {
            f64::INFINITY
        } else {
            up
        }
    }

    /// Distance to the drift's own walls, positive inside.
    fn clearance(&self, p: [f64; 3]) -> f64 {
        let ([s, across, up], length) = self.local(p);
        let half = [0.5 * length, 0.5 * self.width, 0.5 * self.height];
        let q = [
            (s - half[0]).abs() - half[0],
            across.abs() - half[1],
            (up - half[2]).abs() - half[2],
        ];
        let outside: f64 = q
            .iter()
            .map(|v| v.max(0.0) * v.max(0.0))
            .sum::<f64>()
            .sqrt();
        let inside = q.iter().fold(f64::NEG_INFINITY, |a, v| a.max(*v)).min(0.0);
        let rectangle = -(outside + inside);
        // The back is arched: a circle through the springing lines bounds it from above.
        let radius = 0.62 * self.width;
        let centre = self.height - radius;
        let arch = if up > centre.max(0.0) {
            radius - (across * across + (up - centre) * (up - centre)).sqrt()
        } else {
            f64::INFINITY
        };
        rectangle.min(arch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(roughness: f64) -> Mine {
        let drift = Drift {
            from: [0.0; 3],
            to: [50.0, 0.0, 5.0],
            width: 4.0,
            height: 4.0,
        };
        Mine {
            drifts: vec![drift],
            roughness,
            seed: 1,
        }
    }

    #[test]
    fn clearance_in_a_plain_drift() {
        let mine = straight(0.0);
        assert!(
            (mine.clearance([25.0, 0.0, 2.5 + 1.0]) - 1.0).abs() < 1e-9,
            "a metre above the floor"
        );
        assert!(
            (mine.clearance([25.0, 1.5, 2.5 + 1.0]) - 0.5).abs() < 1e-9,
            "half a metre from the rib"
        );
        assert!(mine.clearance([25.0, 2.5, 2.5 + 1.0]) < 0.0);
        assert!(mine.clearance([25.0, 0.0, 2.5 - 0.5]) < 0.0);
        assert!(
            mine.clearance([25.0, 1.9, 2.5 + 3.9]) < 0.0,
            "the arch rounds the corner off"
        );
        assert!(mine.clearance([-3.0, 0.0, 1.0]) < 0.0);
    }

    #[test]
    fn relief_moves_walls_by_no_more_than_it_may() {
        let (plain, rough) = (straight(0.0), straight(0.3));
        for i in 0..3000 {
            let p = [
                5.0 + f64::from(i % 100) * 0.4,
                -3.0 + f64::from(i / 100) * 0.2,
                2.0,
            ];
            assert!((plain.clearance(p) - rough.clearance(p)).abs() <= 0.3 + 1e-9);
        }
    }
}
