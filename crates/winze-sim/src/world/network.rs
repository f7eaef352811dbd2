//! Drifts that grow into a network.

use std::collections::VecDeque;

use winze::rng::Rng;

use super::kinds::Drifts;
use super::plan::{Leg, between};
use super::{Layout, Mark, Run, Station, plan::Plan};

/// Length of a step of growth, metres.
const STEP: f64 = 8.0;
/// Rock that is left between drifts, metres.
const BETWEEN: f64 = 4.0;

/// The end of a drift that still grows.
struct Head {
    station: Station,
    azimuth: f64,
    grade: f64,
    drift: usize,
    /// Steps done and to do.
    done: u32,
    left: u32,
    /// Distance to the next branch, metres.
    to_branch: f64,
}

/// A network under growth.
struct Growth<'a> {
    spec: &'a Drifts,
    rng: Rng,
    legs: Vec<Leg>,
    /// Stations of each drift.
    drifts: Vec<Vec<Station>>,
    heads: VecDeque<Head>,
    marks: Vec<Mark>,
    /// Where drifts may meet, and the azimuth there.
    junctions: Vec<([f64; 3], f64)>,
    length: f64,
}

/// Grows a network of drifts from the origin.
pub(super) fn grow(spec: &Drifts, seed: u64) -> Layout {
    let mut growth = Growth {
        spec,
        rng: Rng::new(seed, 0x6E65_7477),
        legs: Vec::new(),
        drifts: Vec::new(),
        heads: VecDeque::new(),
        marks: Vec::new(),
        junctions: Vec::new(),
        length: 0.0,
    };
    let azimuth = growth.rng.range(0.0, std::f64::consts::TAU);
    let first = Station {
        floor: [0.0; 3],
        width: growth.between(spec.width),
        height: growth.between(spec.height),
    };
    growth.marks.push(Mark {
        name: "start".into(),
        floor: first.floor,
        azimuth,
    });
    growth.start(first, azimuth, u32::MAX);
    growth.start(first, azimuth + std::f64::consts::PI, u32::MAX);
    let mut restarts = 0;
    while growth.length < spec.length - 1.0 && restarts < 400 {
        if let Some(head) = growth.heads.pop_front() {
            growth.advance(head);
        } else {
            restarts += 1;
            growth.restart();
        }
    }
    growth.finish()
}

impl Growth<'_> {
    fn between(&mut self, range: [f64; 2]) -> f64 {
        self.rng.range(range[0], range[1])
    }

    /// A new drift.
    fn start(&mut self, station: Station, azimuth: f64, left: u32) {
        let steepest = if left > 8 {
            self.spec.grade
        } else {
            0.03f64.min(self.spec.grade)
        };
        let grade = self.rng.range(-steepest, steepest);
        let to_branch = self.spec.branching * self.rng.range(0.4, 1.2);
        self.drifts.push(vec![station]);
        self.heads.push_back(Head {
            station,
            azimuth,
            grade,
            drift: self.drifts.len() - 1,
            done: 0,
            left,
            to_branch,
        });
    }

    /// A branch off an old drift, when every end has stopped.
    fn restart(&mut self) {
        let many = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let drift = self.rng.below(many(self.drifts.len())) as usize;
        let stations = self.drifts.get(drift).map_or(0, Vec::len);
        let at = self.rng.below(many(stations)) as usize;
        let station = self.drifts.get(drift).and_then(|d| d.get(at)).copied();
        let before = self
            .drifts
            .get(drift)
            .and_then(|d| d.get(at.checked_sub(1)?))
            .copied();
        let side = if self.rng.uniform() < 0.5 { 1.0 } else { -1.0 };
        let turn = side * self.rng.range(1.2, 1.9);
        if let Some((station, before)) = station.zip(before) {
            let (a, b) = (before.floor, station.floor);
            let azimuth = libm::atan2(b[1] - a[1], b[0] - a[0]);
            self.start(station, azimuth + turn, 12);
        }
    }

    /// One step of a head.
    fn advance(&mut self, mut head: Head) {
        let spec = self.spec;
        let step = STEP.min(spec.length - self.length);
        for attempt in 0..6u32 {
            let wider = 1.0 + f64::from(attempt);
            let turn = wider * spec.bend * self.rng.normal();
            let azimuth = head.azimuth + turn.clamp(-0.8, 0.8);
            let drifted = head.grade + 0.2 * spec.grade * self.rng.normal();
            let grade = drifted.clamp(-spec.grade, spec.grade);
            let mut vary = |v: f64, range: [f64; 2]| {
                let by = 0.25 * (range[1] - range[0]) * self.rng.normal();
                (v + by).clamp(range[0], range[1])
            };
            let (from, at) = (head.station, head.station.floor);
            let to = Station {
                floor: [
                    at[0] + step * libm::cos(azimuth),
                    at[1] + step * libm::sin(azimuth),
                    at[2] + step * grade,
                ],
                width: vary(from.width, spec.width),
                height: vary(from.height, spec.height),
            };
            let leg = self.leg(from, to, head.drift);
            if !self.is_clear(&leg, head.done < 2, None) {
                continue;
            }
            self.add(leg, to);
            head.station = to;
            head.azimuth = azimuth;
            head.grade = grade;
            head.done += 1;
            head.left = head.left.saturating_sub(1);
            head.to_branch -= step;
            if head.to_branch <= 0.0 {
                self.branch(&mut head);
            }
            if head.left > 0 {
                self.heads.push_back(head);
            }
            return;
        }
        self.hole_through(&head);
    }

    /// Lets a branch start where a head is.
    fn branch(&mut self, head: &mut Head) {
        head.to_branch = self.spec.branching * self.rng.range(0.6, 1.4);
        let side = if self.rng.uniform() < 0.5 { 1.0 } else { -1.0 };
        let turn = side * self.rng.range(1.05, 1.75);
        let kind = self.rng.uniform();
        let steps = if kind < 0.4 {
            1 + self.rng.below(3)
        } else if kind < 0.8 {
            4 + self.rng.below(7)
        } else {
            u32::MAX
        };
        self.junctions.push((head.station.floor, head.azimuth));
        self.start(head.station, head.azimuth + turn, steps);
    }

    /// Joins a head that cannot go on to another drift ahead, where there is one.
    fn hole_through(&mut self, head: &Head) {
        let at = head.station.floor;
        let mut best: Option<(f64, Station)> = None;
        for (drift, stations) in self.drifts.iter().enumerate() {
            if drift == head.drift {
                continue;
            }
            for station in stations {
                let d: [f64; 3] = std::array::from_fn(|a| station.floor[a] - at[a]);
                let far = (d[0] * d[0] + d[1] * d[1]).sqrt();
                let ahead = d[0] * libm::cos(head.azimuth) + d[1] * libm::sin(head.azimuth);
                let gentle = d[2].abs() <= self.spec.grade.max(0.05) * far;
                let nearer = best.is_none_or(|b| far < b.0);
                if far > 4.0 && far < 30.0 && ahead > 0.4 * far && gentle && nearer {
                    best = Some((far, *station));
                }
            }
        }
        let Some((far, station)) = best else { return };
        let leg = self.leg(head.station, station, head.drift);
        if self.length + far > self.spec.length
            || !self.is_clear(&leg, head.done < 2, Some(station.floor))
        {
            return;
        }
        self.junctions.push((station.floor, head.azimuth));
        self.add(leg, station);
    }

    fn leg(&self, from: Station, to: Station, drift: usize) -> Leg {
        Leg {
            ends: [from.floor, to.floor],
            width: [from.width, to.width],
            height: [from.height, to.height],
            arch: self.spec.arch,
            face: [false; 2],
            drift,
        }
    }

    fn add(&mut self, leg: Leg, to: Station) {
        self.length += leg.length();
        if let Some(stations) = self.drifts.get_mut(leg.drift) {
            stations.push(to);
        }
        self.legs.push(leg);
    }

    /// Whether a leg leaves rock between itself and all others, but for its own drift's last, those around
    /// its drift's start, if that is a `fresh` branch, and those around where it is to end.
    fn is_clear(&self, leg: &Leg, fresh: bool, end: Option<[f64; 3]>) -> bool {
        let own = self.drifts.get(leg.drift);
        let start = own.and_then(|d| d.first()).map_or(leg.ends[0], |s| s.floor);
        self.legs.iter().all(|other| {
            let meets = |p: [f64; 3]| apart(&[p, p], &other.ends) < 1.3 * STEP;
            let joined = (other.drift == leg.drift && meets(leg.ends[0]))
                || (fresh && meets(start))
                || end.is_some_and(meets);
            let wide = leg.width[1].max(leg.width[0]) + other.width[1].max(other.width[0]);
            joined || apart(&leg.ends, &other.ends) > 0.5 * wide + BETWEEN
        })
    }

    /// Marks the junctions and closes the ends with faces.
    fn finish(mut self) -> Layout {
        let mut junctions = 0;
        for (floor, azimuth) in std::mem::take(&mut self.junctions) {
            let mut here = self
                .legs
                .iter()
                .filter(|l| apart(&[floor; 2], &l.ends) < 1.0);
            // A branch may have found no room.
            let first = here.next().map(|l| l.drift);
            if here.any(|l| Some(l.drift) != first) && self.marks.iter().all(|m| m.floor != floor) {
                junctions += 1;
                self.marks.push(Mark {
                    name: format!("junction {junctions}"),
                    floor,
                    azimuth,
                });
            }
        }
        let mut runs = Vec::new();
        let mut headings = 0;
        for (drift, stations) in self.drifts.into_iter().enumerate() {
            let last = self.legs.iter().rposition(|l| l.drift == drift);
            let Some((last, end)) = last.zip(stations.last()) else {
                continue;
            };
            let holed = |l: &Leg| l.drift != drift && apart(&[end.floor; 2], &l.ends) < 1.0;
            let mut heading = None;
            if !self.legs.iter().any(holed) {
                heading = Some(last);
                headings += 1;
                if let Some(leg) = self.legs.get_mut(last) {
                    leg.face[1] = true;
                    let back = (1.0 - 3.0 / leg.length().max(3.0)).max(0.0);
                    let [a, b] = leg.ends;
                    self.marks.push(Mark {
                        name: format!("heading {headings}"),
                        floor: between(&leg.ends, back),
                        azimuth: libm::atan2(a[1] - b[1], a[0] - b[0]),
                    });
                }
            }
            runs.push(Run { stations, heading });
        }
        Layout {
            plan: Plan::Legs(self.legs),
            runs,
            marks: self.marks,
            length: self.length,
        }
    }
}

/// Distance between two stretches in plan, metres.
fn apart(a: &[[f64; 3]; 2], b: &[[f64; 3]; 2]) -> f64 {
    let cross = |o: [f64; 3], p: [f64; 3], q: [f64; 3]| {
        (p[0] - o[0]) * (q[1] - o[1]) - (p[1] - o[1]) * (q[0] - o[0])
    };
    let sides = |l: &[[f64; 3]; 2], m: &[[f64; 3]; 2]| {
        cross(l[0], l[1], m[0]) * cross(l[0], l[1], m[1]) < 0.0
    };
    if sides(a, b) && sides(b, a) {
        return 0.0;
    }
    let to = |p: [f64; 3], l: &[[f64; 3]; 2]| {
        let d = [l[1][0] - l[0][0], l[1][1] - l[0][1]];
        let n = (d[0] * d[0] + d[1] * d[1]).max(1e-12);
        let t = (((p[0] - l[0][0]) * d[0] + (p[1] - l[0][1]) * d[1]) / n).clamp(0.0, 1.0);
        let off = [p[0] - l[0][0] - t * d[0], p[1] - l[0][1] - t * d[1]];
        (off[0] * off[0] + off[1] * off[1]).sqrt()
    };
    to(a[0], b)
        .min(to(a[1], b))
        .min(to(b[0], a))
        .min(to(b[1], a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_has_its_length_and_keeps_rock_between_drifts() {
        for seed in 0..6 {
            let spec = Drifts {
                length: 900.0,
                ..Drifts::default()
            };
            let layout = grow(&spec, seed);
            assert!((layout.length - 900.0).abs() < 5.0, "{}", layout.length);
            let Plan::Legs(legs) = &layout.plan else {
                panic!("drifts");
            };
            assert!(legs.iter().all(|l| l.width[0] >= 3.6 && l.width[1] <= 5.2));
            let kinds = |k: &str| {
                layout
                    .marks
                    .iter()
                    .filter(|m| m.name.starts_with(k))
                    .count()
            };
            assert!(kinds("junction") > 5 && kinds("heading") > 4);
            // Every drift hangs together with the first.
            let mut seen = vec![false; legs.len()];
            let mut open = vec![0];
            while let Some(i) = open.pop() {
                if std::mem::replace(&mut seen[i], true) {
                    continue;
                }
                open.extend((0..legs.len()).filter(|j| apart(&legs[i].ends, &legs[*j].ends) < 1.0));
            }
            assert!(seen.iter().all(|s| *s), "seed {seed}");
            let near: Vec<u32> = (0..legs.len() as u32).collect();
            for mark in &layout.marks {
                let [x, y, z] = mark.floor;
                assert!(
                    layout.plan.at([x, y, z + 1.4], &near).clearance > 1.0,
                    "{mark:?}"
                );
            }
        }
        let spec = Drifts::default();
        assert_ne!(grow(&spec, 1), grow(&spec, 2));
        assert_eq!(grow(&spec, 1), grow(&spec, 1));
    }

    #[test]
    fn stretches_apart() {
        let a = [[0.0; 3], [10.0, 0.0, 0.0]];
        assert_eq!(apart(&a, &[[5.0, -1.0, 0.0], [5.0, 4.0, 9.0]]), 0.0);
        assert_eq!(apart(&a, &[[5.0, 3.0, 0.0], [5.0, 4.0, 9.0]]), 3.0);
        assert_eq!(apart(&a, &[[13.0, 4.0, 0.0], [20.0, 4.0, 0.0]]), 5.0);
    }
}
