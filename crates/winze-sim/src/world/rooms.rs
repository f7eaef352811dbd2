//! The plan of a room-and-pillar mine.

use winze::rng::Rng;

use super::kinds::Rooms;
use super::plan::{Bounds, Place, lesser, rectangle};
use super::{Mark, Run, Station};
use crate::noise;

/// A pillar of rectangular plan.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pillar {
    centre: [f64; 2],
    half: [f64; 2],
    /// Direction of its first edge.
    along: [f64; 2],
}

/// Rooms between pillars in a rolling seam.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RoomPlan {
    extent: [f64; 2],
    pitch: f64,
    height: f64,
    dip: f64,
    roll: f64,
    seed: u64,
    /// Row by row.
    pillars: Vec<Pillar>,
    /// Pillars along x and y.
    counts: [usize; 2],
}

/// Length of the seam's rolls, metres.
const ROLL_LENGTH: f64 = 70.0;

impl RoomPlan {
    /// Lays the pillars out.
    pub(super) fn new(spec: &Rooms, seed: u64) -> Self {
        let extent = [spec.extent_x, spec.extent_y];
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "extent and pitch were checked: at most 750"
        )]
        let counts = extent.map(|e| (e / spec.pitch).floor() as usize);
        let mut rng = Rng::new(seed, 0x0070_0015);
        let mut pillars = Vec::with_capacity(counts[0] * counts[1]);
        let uneven = spec.irregular;
        for j in 0..counts[1] {
            for i in 0..counts[0] {
                // Centred, with the border rooms as wide as their neighbours or wider.
                let middle = |a: usize, n: usize| {
                    #[expect(clippy::cast_precision_loss, reason = "small counts")]
                    let from_centre = n as f64 + 0.5 - 0.5 * counts[a] as f64;
                    0.5 * extent[a] + spec.pitch * from_centre
                };
                let mut size = || 0.5 * spec.pillar * (1.0 + uneven * rng.range(-1.0, 1.0));
                let half = [size(), size()];
                // Moved by no more than what keeps neighbours apart.
                let slack = 0.5 * (0.5 * spec.pillar * (1.0 + uneven) - half[0].max(half[1]));
                let centre = [
                    middle(0, i) + slack * rng.range(-1.0, 1.0),
                    middle(1, j) + slack * rng.range(-1.0, 1.0),
                ];
                let turn = 0.3 * uneven * rng.range(-1.0, 1.0);
                pillars.push(Pillar {
                    centre,
                    half,
                    along: [libm::cos(turn), libm::sin(turn)],
                });
            }
        }
        Self {
            extent,
            pitch: spec.pitch,
            height: spec.height,
            dip: spec.dip,
            roll: spec.roll,
            seed,
            pillars,
            counts,
        }
    }

    /// Height of the floor, metres.
    fn floor(&self, x: f64, y: f64) -> f64 {
        let rolls = noise::value(
            [x / ROLL_LENGTH, y / ROLL_LENGTH, 0.5],
            self.seed ^ 0x0070_0016,
        );
        self.dip * x + self.roll * rolls
    }

    pub(super) fn bounds(&self) -> Bounds {
        let ends = [0.0, self.dip * self.extent[0]];
        [
            [0.0, 0.0, ends[0].min(ends[1]) - self.roll],
            [
                self.extent[0],
                self.extent[1],
                ends[0].max(ends[1]) + self.roll + self.height,
            ],
        ]
    }

    pub(super) fn area(&self) -> f64 {
        let pillars = self
            .pillars
            .iter()
            .map(|p| 4.0 * (p.half[0] + p.half[1]) * self.height - 8.0 * p.half[0] * p.half[1]);
        2.0 * self.extent[0] * self.extent[1]
            + 2.0 * (self.extent[0] + self.extent[1]) * self.height
            + pillars.sum::<f64>()
    }

    pub(super) fn at(&self, p: [f64; 3]) -> Place {
        let up = p[2] - self.floor(p[0], p[1]);
        let mut sideways = f64::INFINITY;
        for a in 0..2 {
            sideways = sideways.min(p[a]).min(self.extent[a] - p[a]);
        }
        for pillar in self.pillars_by([p[0], p[1]]) {
            let d = [p[0] - pillar.centre[0], p[1] - pillar.centre[1]];
            let [c, s] = pillar.along;
            let q = [c * d[0] + s * d[1], c * d[1] - s * d[0]];
            sideways = sideways.min(rectangle(q, pillar.half, 0.8f64.min(pillar.half[0])));
        }
        let upright = up.min(self.height - up);
        Place {
            clearance: lesser(sideways, upright, 0.5),
            up,
        }
    }

    /// The pillars that may be nearest to `p`.
    fn pillars_by(&self, p: [f64; 2]) -> impl Iterator<Item = &Pillar> {
        let range = |a: usize| {
            #[expect(clippy::cast_precision_loss, reason = "small counts")]
            let place = (p[a] - 0.5 * self.extent[a]) / self.pitch + 0.5 * self.counts[a] as f64;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "clamped to the counts"
            )]
            let clamped = |v: f64| v.clamp(0.0, 1e6) as usize;
            clamped(place.floor() - 1.0)..clamped(place.floor() + 2.0).min(self.counts[a])
        };
        let columns = range(0);
        range(1).flat_map(move |j| {
            let row = j * self.counts[0];
            self.pillars
                .get(row + columns.start.min(self.counts[0])..row + columns.end)
                .unwrap_or_default()
        })
    }

    /// The streets along x and along y between the pillars.
    pub(super) fn runs(&self) -> Vec<Run> {
        let mut runs = Vec::new();
        for a in 0..2 {
            for n in 0..=self.counts[1 - a] {
                let side = self.street_at(1 - a, n);
                let mut stations = Vec::new();
                let mut s = 2.0;
                while s <= self.extent[a] - 2.0 {
                    let [x, y] = if a == 0 { [s, side] } else { [side, s] };
                    stations.push(Station {
                        floor: [x, y, self.floor(x, y)],
                        width: self.street(),
                        height: self.height,
                    });
                    s += 4.0;
                }
                runs.push(Run {
                    stations,
                    heading: None,
                });
            }
        }
        runs
    }

    /// Where the middle of street `n` across axis `a` lies.
    fn street_at(&self, a: usize, n: usize) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "small counts")]
        let (n, count) = (n as f64, self.counts[a] as f64);
        let first = 0.5 * (self.extent[a] - count * self.pitch);
        // Along the border there is half a room and what the pitch leaves over.
        let border = 0.5 * (first + 0.5 * self.street());
        if n < 0.5 {
            border
        } else if n > count - 0.5 {
            self.extent[a] - border
        } else {
            first + n * self.pitch
        }
    }

    /// Width of the rooms, metres, at their narrowest.
    fn street(&self) -> f64 {
        let widest = self.pillars.iter().map(|p| p.half[0].max(p.half[1]));
        (self.pitch - 2.0 * widest.fold(0.0, f64::max)).max(1.0)
    }

    /// Every crossing of streets.
    pub(super) fn marks(&self) -> Vec<Mark> {
        let mut marks = Vec::new();
        for j in 0..=self.counts[1] {
            for i in 0..=self.counts[0] {
                let (x, y) = (self.street_at(0, i), self.street_at(1, j));
                marks.push(Mark {
                    name: format!("crossing {i} {j}"),
                    floor: [x, y, self.floor(x, y)],
                    azimuth: 0.0,
                });
            }
        }
        marks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pillars_stand_at_their_pitch_and_rooms_are_open() {
        let spec = Rooms {
            irregular: 0.0,
            dip: 0.0,
            roll: 0.0,
            ..Rooms::default()
        };
        let plan = RoomPlan::new(&spec, 1);
        assert_eq!(plan.counts, [13, 7]);
        // The mine is 150 m wide: seven pillars, the border rooms 5 m wider.
        let street = plan.at([130.0, 15.0 + 60.0 - 10.0, 1.9]);
        assert!((street.clearance - 1.9).abs() < 1e-9, "{street:?}");
        assert!(plan.at([130.0, 75.0, 1.9]).clearance < -5.0, "a pillar");
        assert!((plan.at([20.0, 65.0, 1.0]).up - 1.0).abs() < 1e-9);
        assert!(plan.at([-1.0, 65.0, 1.0]).clearance < -0.9);
        for mark in plan.marks() {
            let [x, y, z] = mark.floor;
            assert!(plan.at([x, y, z + 1.5]).clearance > 1.0, "{mark:?}");
        }
    }

    #[test]
    fn irregular_pillars_leave_streets() {
        let spec = Rooms {
            irregular: 0.5,
            ..Rooms::default()
        };
        let plan = RoomPlan::new(&spec, 3);
        assert!(plan.street() > 1.9, "{}", plan.street());
        for run in plan.runs() {
            for s in run.stations {
                let [x, y, z] = s.floor;
                assert!(plan.at([x, y, z + 1.9]).clearance > 0.4);
            }
        }
    }
}
