//! The plan of a world: how far a place is from the planned walls, before any relief.

use winze::vec3::distance;

use super::rooms::RoomPlan;
use super::slab::SlabPlan;

/// How a place lies to the planned walls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Distance to the walls, metres: positive in the open, negative within the rock. A lower bound of the
    /// exact distance up to a factor of 1.25.
    pub(super) clearance: f64,
    /// Height above the floor, metres.
    pub(super) up: f64,
}

/// A straight stretch of drift between two points of its floor, with plan-view round ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Leg {
    /// Ends of the floor's centreline.
    pub(super) ends: [[f64; 3]; 2],
    /// Width at either end, metres.
    pub(super) width: [f64; 2],
    /// Height at either end, metres.
    pub(super) height: [f64; 2],
    /// How round the back is, 0 to 1.
    pub(super) arch: f64,
    /// Whether an end is a face rather than a joint.
    pub(super) face: [bool; 2],
    /// The drift it belongs to; legs of one drift meet sharply, drifts meet smoothly.
    pub(super) drift: usize,
}

/// A stretch of cave: a sphere swept along a line, flattened, its bottom filled with sediment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tube {
    /// Ends of its axis.
    pub(super) ends: [[f64; 3]; 2],
    /// Half width at either end, metres.
    pub(super) radius: [f64; 2],
    /// Half height over half width.
    pub(super) flatness: f64,
    /// Depth of the floor below the axis, as a share of the half height.
    pub(super) floor: f64,
}

/// The openings of a world.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Plan {
    /// Drifts.
    Legs(Vec<Leg>),
    /// A cave.
    Tubes(Vec<Tube>),
    /// Rooms and pillars.
    Rooms(RoomPlan),
    /// A patch of wall.
    Slab(SlabPlan),
}

/// Lower and upper corner of a box.
pub(super) type Bounds = [[f64; 3]; 2];

impl Plan {
    /// Over what distance openings melt into each other, metres.
    fn blend(&self) -> f64 {
        match self {
            Self::Legs(_) => 0.8,
            Self::Tubes(_) => 1.6,
            Self::Rooms(_) | Self::Slab(_) => 0.0,
        }
    }

    /// The numbers, in order, of the openings that matter in a box for places at most `within` metres from
    /// the walls. What is left out does not change [`Plan::at`] there by a bit.
    pub(super) fn near(&self, bounds: Bounds, within: f64) -> Vec<u32> {
        let reach = within + 3.0 * self.blend() + 1.0;
        let touches = |b: Bounds| {
            (0..3).all(|a| b[0][a] - reach <= bounds[1][a] && b[1][a] + reach >= bounds[0][a])
        };
        match self {
            Self::Legs(legs) => numbers(legs, |l| touches(l.bounds())),
            Self::Tubes(tubes) => numbers(tubes, |t| touches(t.bounds())),
            Self::Rooms(_) | Self::Slab(_) => Vec::new(),
        }
    }

    /// Boxes that hold all of the planned walls.
    pub(super) fn boxes(&self) -> Vec<Bounds> {
        match self {
            Self::Legs(legs) => legs.iter().map(Leg::bounds).collect(),
            Self::Tubes(tubes) => tubes.iter().map(Tube::bounds).collect(),
            Self::Rooms(rooms) => vec![rooms.bounds()],
            Self::Slab(slab) => slab.bounds(),
        }
    }

    /// Area of the planned walls, square metres, about.
    pub(super) fn area(&self) -> f64 {
        match self {
            Self::Legs(legs) => legs.iter().map(Leg::area).sum(),
            Self::Tubes(tubes) => tubes.iter().map(Tube::area).sum(),
            Self::Rooms(rooms) => rooms.area(),
            Self::Slab(slab) => slab.area(),
        }
    }

    /// Where `p` lies, judged by the openings `near`. Far within the rock where there are none.
    pub(super) fn at(&self, p: [f64; 3], near: &[u32]) -> Place {
        match self {
            Self::Legs(legs) => {
                let mut of_drift: Option<(usize, Place)> = None;
                let mut all: Option<Place> = None;
                let near = near.iter().filter_map(|i| legs.get(*i as usize));
                for leg in near {
                    let here = leg.at(p);
                    of_drift = Some(match of_drift {
                        Some((drift, best)) if drift == leg.drift => {
                            let better = if here.clearance > best.clearance {
                                here
                            } else {
                                best
                            };
                            (drift, better)
                        }
                        Some((_, best)) => {
                            all = Some(joined(all, best, self.blend()));
                            (leg.drift, here)
                        }
                        None => (leg.drift, here),
                    });
                }
                match of_drift {
                    Some((_, best)) => joined(all, best, self.blend()),
                    None => SOLID,
                }
            }
            Self::Tubes(tubes) => near
                .iter()
                .filter_map(|i| tubes.get(*i as usize))
                .fold(None, |all, tube| {
                    Some(joined(all, tube.at(p), self.blend()))
                })
                .unwrap_or(SOLID),
            Self::Rooms(rooms) => rooms.at(p),
            Self::Slab(slab) => slab.at(p),
        }
    }
}

/// Nothing is open anywhere near.
const SOLID: Place = Place {
    clearance: -1e3,
    up: 0.0,
};

#[expect(clippy::cast_possible_truncation, reason = "a few thousand openings")]
fn numbers<T>(items: &[T], wanted: impl Fn(&T) -> bool) -> Vec<u32> {
    let some = items.iter().enumerate().filter(|(_, item)| wanted(item));
    some.map(|(i, _)| i as u32).collect()
}

/// The union of two openings, rounded where they meet over `k` metres (the polynomial smooth minimum of
/// I. Quilez, which is exact where the two differ by more than `k`).
fn joined(a: Option<Place>, b: Place, k: f64) -> Place {
    let Some(a) = a else { return b };
    let t = 0.5 + 0.5 * (a.clearance - b.clearance) / k;
    // To the bit: what is far does not count.
    if t >= 1.0 {
        return a;
    }
    if t <= 0.0 {
        return b;
    }
    let up = mix(b.up, a.up, t);
    // The floors of two drifts meet without a trench.
    let clearance = (mix(b.clearance, a.clearance, t) + k * t * (1.0 - t)).min(up);
    Place { clearance, up }
}

/// The lesser of two clearances, the edge between them rounded over `k` metres.
pub(super) fn lesser(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * k * h * h
}

pub(super) fn mix(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// `a` at 0, `b` at 1, exactly.
pub(super) fn between(ends: &[[f64; 3]; 2], t: f64) -> [f64; 3] {
    std::array::from_fn(|a| ends[0][a] + t * (ends[1][a] - ends[0][a]))
}

/// Distance outside (positive) or inside a rectangle of half sizes `half` with corners of `radius`.
pub(super) fn rectangle(p: [f64; 2], half: [f64; 2], radius: f64) -> f64 {
    let q = [p[0].abs() - half[0] + radius, p[1].abs() - half[1] + radius];
    let out = [q[0].max(0.0), q[1].max(0.0)];
    q[0].max(q[1]).min(0.0) + (out[0] * out[0] + out[1] * out[1]).sqrt() - radius
}

impl Leg {
    /// Length in plan, metres.
    pub(super) fn length(&self) -> f64 {
        let d = [
            self.ends[1][0] - self.ends[0][0],
            self.ends[1][1] - self.ends[0][1],
        ];
        (d[0] * d[0] + d[1] * d[1]).sqrt()
    }

    fn bounds(&self) -> Bounds {
        let wide = 0.5 * self.width[0].max(self.width[1]);
        let high = self.height[0].max(self.height[1]);
        let [a, b] = self.ends;
        [
            [a[0].min(b[0]) - wide, a[1].min(b[1]) - wide, a[2].min(b[2])],
            [
                a[0].max(b[0]) + wide,
                a[1].max(b[1]) + wide,
                a[2].max(b[2]) + high,
            ],
        ]
    }

    fn area(&self) -> f64 {
        self.length() * (self.width[0] + self.width[1] + self.height[0] + self.height[1])
    }

    fn at(&self, p: [f64; 3]) -> Place {
        let length = self.length().max(1e-9);
        let [from, to] = self.ends;
        let along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
        let d = [p[0] - from[0], p[1] - from[1]];
        let s = d[0] * along[0] + d[1] * along[1];
        let aside = d[1] * along[0] - d[0] * along[1];
        let t = (s / length).clamp(0.0, 1.0);
        // Beyond a joint the section turns about it; beyond a face it goes on, and the face cuts it off.
        let beyond = match s {
            s if s < 0.0 && !self.face[0] => s,
            s if s > length && !self.face[1] => s - length,
            _ => 0.0,
        };
        let across = (aside * aside + beyond * beyond).sqrt();
        let width = mix(self.width[0], self.width[1], t);
        let height = mix(self.height[0], self.height[1], t);
        let up = p[2] - mix(from[2], to[2], t);
        let high = up - 0.5 * height;
        let radius = if high > 0.0 {
            (0.5 * self.arch * width).min(0.5 * height)
        } else {
            0.3f64.min(0.5 * height)
        };
        let half = [0.5 * width, 0.5 * height];
        let mut clearance = -rectangle([across, high], half, radius);
        for (face, inside) in [(self.face[0], s), (self.face[1], length - s)] {
            if face {
                clearance = lesser(clearance, inside, 0.8);
            }
        }
        Place { clearance, up }
    }
}

impl Tube {
    fn bounds(&self) -> Bounds {
        let wide = self.radius[0].max(self.radius[1]) * self.flatness.max(1.0);
        let [a, b] = self.ends;
        [
            std::array::from_fn(|i| a[i].min(b[i]) - wide),
            std::array::from_fn(|i| a[i].max(b[i]) + wide),
        ]
    }

    fn area(&self) -> f64 {
        let radius = 0.5 * (self.radius[0] + self.radius[1]);
        let length = distance(self.ends[0], self.ends[1]) + 0.5 * radius;
        std::f64::consts::TAU * radius * length
    }

    /// Height of the floor above the axis at the share `t` of it; negative.
    pub(super) fn floor_at(&self, t: f64) -> f64 {
        -self.floor * self.flatness * mix(self.radius[0], self.radius[1], t)
    }

    fn at(&self, p: [f64; 3]) -> Place {
        let [from, to] = self.ends;
        let d: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
        let n = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let dot: f64 = (0..3).map(|a| (p[a] - from[a]) * d[a]).sum();
        let t = (dot / n.max(1e-12)).clamp(0.0, 1.0);
        let axis = between(&self.ends, t);
        let off = [
            p[0] - axis[0],
            p[1] - axis[1],
            (p[2] - axis[2]) / self.flatness,
        ];
        let away = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt();
        let tube = (mix(self.radius[0], self.radius[1], t) - away) * self.flatness.min(1.0);
        let up = p[2] - axis[2] - self.floor_at(t);
        Place {
            clearance: lesser(tube, up, 0.6),
            up,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn leg(from: [f64; 3], to: [f64; 3], drift: usize) -> Leg {
        Leg {
            ends: [from, to],
            width: [4.0; 2],
            height: [4.0; 2],
            arch: 0.5,
            face: [false; 2],
            drift,
        }
    }

    #[test]
    fn clearance_in_a_plain_drift() {
        let plan = Plan::Legs(vec![leg([0.0; 3], [50.0, 0.0, 5.0], 0)]);
        let at = |x: f64, y: f64, up: f64| plan.at([x, y, 0.1 * x + up], &[0]);
        assert!(
            (at(25.0, 0.0, 1.0).clearance - 1.0).abs() < 1e-9,
            "above the floor"
        );
        assert!((at(25.0, 0.0, 1.0).up - 1.0).abs() < 1e-9);
        assert!(
            (at(25.0, -1.5, 2.0).clearance - 0.5).abs() < 1e-9,
            "from the rib"
        );
        assert!((at(25.0, 2.5, 2.0).clearance + 0.5).abs() < 1e-9);
        // The corner of the back has a radius of 1 m: 1.3 m of diagonal are beyond it.
        let corner = at(25.0, 2.0, 4.0).clearance;
        assert!((corner + 2f64.sqrt() - 1.0).abs() < 1e-9);
        assert!(at(52.5, 0.0, 2.0).clearance < 0.0, "a round end");
        assert!((plan.at([51.0, 0.0, 7.0], &[0]).clearance - 1.0).abs() < 1e-9);
        assert_eq!(plan.at([0.0; 3], &[]), SOLID);
    }

    #[test]
    fn a_face_is_flat() {
        let mut with_face = leg([0.0; 3], [50.0, 0.0, 0.0], 0);
        with_face.face = [false, true];
        let plan = Plan::Legs(vec![with_face]);
        for y in [-1.0, 0.0, 1.0] {
            assert!(plan.at([49.9, y, 2.0], &[0]).clearance > 0.0);
            assert!((plan.at([50.0, y, 2.0], &[0]).clearance).abs() < 1e-9);
        }
    }

    #[test]
    fn what_is_not_near_does_not_count() {
        let legs = (0..12u32).map(|i| {
            let x = 9.0 * f64::from(i);
            leg([x, 0.0, 0.0], [x + 4.0, 11.0, 1.0], i as usize)
        });
        let plan = Plan::Legs(legs.collect());
        let everything: Vec<u32> = (0..12).collect();
        let bounds = [[40.0, 0.0, 0.0], [44.0, 4.0, 4.0]];
        let near = plan.near(bounds, 0.5);
        assert!(near.len() < 5 && !near.is_empty());
        for i in 0..4000u32 {
            let [x, y, z] = [i % 20, i / 20 % 20, i / 400].map(|v| 0.2 * f64::from(v));
            let p = [40.0 + x, y, z];
            let (some, all) = (plan.at(p, &near), plan.at(p, &everything));
            if all.clearance.abs() < 0.5 {
                assert_eq!(some, all);
            }
        }
    }

    #[test]
    fn junctions_are_rounded_and_never_narrower() {
        let (a, b) = (
            leg([0.0; 3], [20.0, 0.0, 0.0], 0),
            leg([10.0, 0.0, 0.0], [10.0, 20.0, 0.0], 1),
        );
        let both = Plan::Legs(vec![a, b]);
        for i in 0..400u32 {
            let p = [0.05 * f64::from(i), 2.3, 1.0];
            let alone = Plan::Legs(vec![a]).at(p, &[0]).clearance;
            let other = Plan::Legs(vec![b]).at(p, &[0]).clearance;
            let joint = both.at(p, &[0, 1]).clearance;
            assert!(joint >= alone.max(other) && joint <= alone.max(other) + 0.2 + 1e-9);
        }
    }
}
