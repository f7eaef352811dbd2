//! The plan of a wall patch: a slab of rock to be looked at from one side.

use super::kinds::Wall;
use super::plan::{Bounds, Place, lesser};
use super::{Mark, Run, Station};

/// Thickness of the rock behind the wall, metres: more than its relief.
const BEHIND: f64 = 2.5;
/// How far the floor reaches out in front, metres.
const IN_FRONT: f64 = 6.0;
/// How far back and ribs do.
const AROUND: f64 = 2.5;

/// Blocks of rock in the open.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SlabPlan {
    blocks: Vec<Bounds>,
    size: [f64; 2],
    floor: bool,
}

impl SlabPlan {
    pub(super) fn new(spec: &Wall) -> Self {
        let (w, h) = (spec.width, spec.height);
        // Neighbours overlap deeply, so that relief opens no crack where they meet.
        let foot = if spec.floor { -BEHIND } else { 0.0 };
        let top = if spec.back { h + BEHIND } else { h };
        let beside = if spec.ribs { BEHIND } else { 0.0 };
        let (left, right) = (-beside, w + beside);
        let mut blocks = vec![[[left, 0.0, foot], [right, BEHIND, top]]];
        if spec.floor {
            blocks.push([[left, -IN_FRONT, foot], [right, BEHIND, 0.0]]);
        }
        if spec.back {
            blocks.push([[left, -AROUND, h], [right, BEHIND, top]]);
        }
        if spec.ribs {
            blocks.push([[left, -AROUND, foot], [0.0, BEHIND, top]]);
            blocks.push([[w, -AROUND, foot], [right, BEHIND, top]]);
        }
        Self {
            blocks,
            size: [w, h],
            floor: spec.floor,
        }
    }

    /// The sides of the blocks that are seen from the front; the others are left open.
    pub(super) fn bounds(&self) -> Vec<Bounds> {
        let [w, h] = self.size;
        let seen = [
            [0.0, if self.floor { -IN_FRONT } else { -AROUND }, 0.0],
            [w, 0.0, h],
        ];
        self.blocks
            .iter()
            .map(|b| {
                [
                    std::array::from_fn(|a| b[0][a].max(seen[0][a])),
                    std::array::from_fn(|a| b[1][a].min(seen[1][a])),
                ]
            })
            .collect()
    }

    pub(super) fn area(&self) -> f64 {
        let area = |b: &Bounds| {
            let s: [f64; 3] = std::array::from_fn(|a| b[1][a] - b[0][a]);
            s[0] * s[1] + s[1] * s[2] + s[2] * s[0]
        };
        self.bounds().iter().map(area).sum()
    }

    pub(super) fn at(&self, p: [f64; 3]) -> Place {
        let clearance = self
            .blocks
            .iter()
            .map(|b| outside(b, p))
            .reduce(|a, b| lesser(a, b, 0.15))
            .unwrap_or(1e3);
        let up = if self.floor { p[2] } else { 1e3 };
        Place { clearance, up }
    }

    /// In front of the wall, from its left to its right end.
    pub(super) fn runs(&self) -> Vec<Run> {
        let station = |x: f64| Station {
            floor: [x, -0.5 * IN_FRONT, 0.0],
            width: IN_FRONT,
            height: self.size[1],
        };
        vec![Run {
            stations: vec![station(0.0), station(self.size[0])],
            heading: None,
        }]
    }

    /// In front of its middle and its ends, looking at it.
    pub(super) fn marks(&self) -> Vec<Mark> {
        let at = |name: &str, share: f64| Mark {
            name: name.into(),
            floor: [share * self.size[0], -0.5 * IN_FRONT, 0.0],
            azimuth: std::f64::consts::FRAC_PI_2,
        };
        vec![at("left", 0.1), at("middle", 0.5), at("right", 0.9)]
    }
}

/// Distance from a box, negative within it.
fn outside(b: &Bounds, p: [f64; 3]) -> f64 {
    let q: [f64; 3] = std::array::from_fn(|a| (b[0][a] - p[a]).max(p[a] - b[1][a]));
    let out = q.map(|v| v.max(0.0));
    let far = (out[0] * out[0] + out[1] * out[1] + out[2] * out[2]).sqrt();
    far + q[0].max(q[1]).max(q[2]).min(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wall_faces_its_marks() {
        let plan = SlabPlan::new(&Wall::default());
        assert!((plan.at([5.0, -1.0, 1.5]).clearance - 1.0).abs() < 1e-12);
        assert!((plan.at([5.0, 1.0, 1.5]).clearance + 1.0).abs() < 1e-12);
        assert!((plan.at([5.0, -3.0, 0.5]).clearance - 0.5).abs() < 1e-12);
        for mark in plan.marks() {
            assert!(plan.at(mark.floor).clearance.abs() < 1e-12);
        }
        let bare = SlabPlan::new(&Wall {
            floor: false,
            ..Wall::default()
        });
        assert!(bare.at([5.0, -3.0, -2.0]).clearance > 2.0);
    }
}
