//! The rock of a world as a field: its plan with its relief.

use super::plan::{Bounds, Plan};
use super::relief::Relief;

/// The rock of a world.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub(super) plan: Plan,
    pub(super) relief: Relief,
}

impl Field {
    /// Distance from the planned walls within which [`Field::at`] shows relief, metres.
    pub(super) fn within(&self) -> f64 {
        self.relief.most() + 2.0 * self.relief.rock().cell
    }

    /// The openings that matter for [`Field::at`] in a box.
    pub(super) fn near(&self, bounds: Bounds) -> Vec<u32> {
        self.plan.near(bounds, self.within())
    }

    /// Distance to the rock, about, metres: positive in the open.
    pub(super) fn at(&self, p: [f64; 3], near: &[u32]) -> f64 {
        let place = self.plan.at(p, near);
        // Far from the walls their relief does not matter, and it is the costly part.
        if place.clearance.abs() > self.within() {
            return place.clearance - place.clearance.signum() * self.relief.most();
        }
        place.clearance + self.relief.offset(p, place.up)
    }

    /// How far one can go from `from` along the unit vector `along` before the rock, at most `most` metres.
    pub(super) fn reach(
        &self,
        from: [f64; 3],
        along: [f64; 3],
        most: f64,
        near: &[u32],
    ) -> Option<f64> {
        let at = |s: f64| self.at(std::array::from_fn(|a| from[a] + s * along[a]), near);
        let (mut s, mut last) = (0.0, 0.0);
        while s <= most {
            let clear = at(s);
            if clear < 0.0 {
                // Between the last place in the open and this one.
                let (mut open, mut rock) = (last, s);
                for _ in 0..12 {
                    let middle = 0.5 * (open + rock);
                    if at(middle) < 0.0 {
                        rock = middle;
                    } else {
                        open = middle;
                    }
                }
                return Some(open);
            }
            last = s;
            s += (0.6 * clear).clamp(0.03, 1.0);
        }
        None
    }
}
