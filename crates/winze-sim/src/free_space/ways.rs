//! Ways through the places: from one to another, about a length, past all.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use pathfinding::directed::astar::astar;
use pathfinding::directed::dijkstra::dijkstra_reach;
use winze::rng::Rng;
use winze::vec3::{add, distance, line_length, scale, sub};

use super::{FreeSpace, NONE, ROOM};
use crate::error::{Error, Result};

/// Points of a way, metres apart.
const STEP: f64 = 0.25;
/// Rounds in which a way is smoothed: its corners are rounded over about the root of it in steps.
const ROUNDS: usize = 40;
/// The most legs of a tour.
const MAX_LEGS: usize = 500;

impl FreeSpace<'_> {
    /// A way of the sensor from one point to another, through the middle of the passages where there is
    /// one, smoothed, a point every 0.25 m. Nothing lies between two points of it, and every corner that
    /// was rounded stays clear by the robot's radius.
    ///
    /// # Errors
    /// [`Error::NoFreeSpace`] where an end is in rock, outside, or too near to a wall.
    pub fn path(&self, from: [f64; 3], to: [f64; 3]) -> Result<Vec<[f64; 3]>> {
        let (start, end) = (self.end(from, "starts")?, self.end(to, "ends")?);
        let mut points = self.way(start, end)?;
        points.reverse();
        self.begin(&mut points, to);
        points.reverse();
        self.begin(&mut points, from);
        Ok(self.smooth(&points))
    }

    /// A drive of about `length` metres to a place drawn at random from those whose way is about that long.
    /// Where the mine is too small for that, to the farthest place: its length then says so.
    ///
    /// # Errors
    /// As [`FreeSpace::path`]; [`Error::Setting`] for a length that is not positive.
    pub fn wander(&self, from: [f64; 3], length: f64, rng: &mut Rng) -> Result<Vec<[f64; 3]>> {
        if !(length > 0.0 && length.is_finite()) {
            return Err(Error::Setting {
                key: "length".into(),
                why: format!("{length} m is no length of a drive"),
            });
        }
        let start = self.end(from, "starts")?;
        let mut lengths = vec![0.0; self.places().len()];
        let (mut fitting, mut closest) = (Vec::new(), (length, start));
        for item in dijkstra_reach(&start, |place| self.costs(*place)) {
            let Some(before) = item.parent else { continue };
            let step = distance(self.at(before), self.at(item.node));
            let so_far = lengths.get(before as usize).copied().unwrap_or(0.0) + step;
            if let Some(slot) = lengths.get_mut(item.node as usize) {
                *slot = so_far;
            }
            if (so_far - length).abs() < closest.0 {
                closest = ((so_far - length).abs(), item.node);
            }
            // Smoothing takes a few percent off.
            if so_far >= length && so_far <= 1.1 * length + self.cell() {
                fitting.push(item.node);
            }
            if f64::from(item.total_cost) > 1000.0 * PENALTY * (1.2 * length + 5.0) {
                break;
            }
        }
        let count = u32::try_from(fitting.len()).unwrap_or(u32::MAX);
        let end = fitting.get(rng.below(count) as usize).copied();
        let end = end.unwrap_or(closest.1);
        let mut points = self.way(start, end)?;
        self.begin(&mut points, from);
        Ok(self.smooth(&points))
    }

    /// Ways that together come within about `spacing` metres of every place, for a survey: the first through
    /// the whole mine, each other from a point of an earlier one.
    ///
    /// # Errors
    /// [`Error::Setting`] for a spacing below a metre.
    pub fn tour(&self, spacing: f64) -> Result<Vec<Vec<[f64; 3]>>> {
        if !(spacing >= 1.0) {
            return Err(Error::Setting {
                key: "spacing".into(),
                why: format!("{spacing} m is below a metre"),
            });
        }
        let far_from = |place: u32| {
            let mut reached = self.unreached();
            self.reach(&mut reached, &[place]);
            farthest(&reached)
        };
        let (_, first) = far_from(0);
        let (_, last) = far_from(first);
        let mut reached = self.unreached();
        let (mut start, mut end) = (first, last);
        let mut legs = Vec::new();
        loop {
            if legs.len() == MAX_LEGS {
                return Err(Error::NoFreeSpace(format!(
                    "a survey at {spacing} m takes more than {MAX_LEGS} legs; raise the spacing"
                )));
            }
            let way = self.way(start, end)?;
            legs.push(self.smooth(&way));
            let nodes = self.nodes(start, end)?;
            self.reach(&mut reached, &nodes);
            let (left, place) = farthest(&reached);
            if f64::from(left) <= 1000.0 * spacing {
                break;
            }
            end = place;
            start = reached.get(place as usize).map_or(place, |r| r.1);
        }
        Ok(legs)
    }

    /// Puts a point before a way, in the place of the way's first where that would be a detour.
    fn begin(&self, way: &mut Vec<[f64; 3]>, from: [f64; 3]) {
        if let [_, second, ..] = *way.as_slice() {
            let middle = scale(add(from, second), 0.5);
            if self.is_open(from, second) && self.is_clear(middle) {
                way.remove(0);
            }
        }
        way.insert(0, from);
    }

    /// The place that an end of a way belongs to.
    fn end(&self, point: [f64; 3], which: &str) -> Result<u32> {
        let place = self.nearby(point).filter(|_| self.is_clear(point));
        place.ok_or_else(|| {
            let p = point.map(|v| format!("{v:.2}")).join(" ");
            let n = self.nearest_place(point);
            let n = n.map(|v| format!("{v:.2}")).join(" ");
            Error::NoFreeSpace(format!(
                "the way {which} at {p}, where the robot cannot be: in rock, outside or less than {:.2} m from \
                 a wall; the nearest place where it can is {n}",
                self.robot.clearance()
            ))
        })
    }

    fn way(&self, start: u32, end: u32) -> Result<Vec<[f64; 3]>> {
        let nodes = self.nodes(start, end)?;
        Ok(nodes.into_iter().map(|n| self.at(n)).collect())
    }

    /// The cheapest way: millimetres, dearer near walls.
    fn nodes(&self, start: u32, end: u32) -> Result<Vec<u32>> {
        let goal = self.at(end);
        astar(
            &start,
            |place| self.costs(*place),
            |place| millimetres(distance(self.at(*place), goal)),
            |place| *place == end,
        )
        .map(|(nodes, _)| nodes)
        .ok_or_else(|| Error::NoFreeSpace("there is no way between two places".into()))
    }

    fn costs(&self, place: u32) -> Vec<(u32, u32)> {
        self.next(place)
            .map(|(n, d)| {
                let room = self.room.get(n as usize).copied().unwrap_or(0);
                let narrow = 1.0 - f64::from(room) / f64::from(ROOM);
                (n, millimetres(d * (1.0 + (PENALTY - 1.0) * narrow)) + 1)
            })
            .collect()
    }

    /// Rounds the corners of a way where that stays clear, and spaces its points evenly.
    fn smooth(&self, way: &[[f64; 3]]) -> Vec<[f64; 3]> {
        let even = spaced(way);
        let mut smooth = even.clone();
        for _ in 0..ROUNDS {
            let last = smooth.clone();
            for (p, w) in smooth.iter_mut().skip(1).zip(last.windows(3)) {
                if let [a, b, c] = w {
                    let mean = scale(add(add(*a, *c), scale(*b, 2.0)), 0.25);
                    if self.is_clear(mean) {
                        *p = mean;
                    }
                }
            }
        }
        let smooth = spaced(&smooth);
        let open = smooth.windows(2).all(|w| match w {
            [a, b] => self.is_open(*a, *b),
            _ => true,
        });
        if open { smooth } else { even }
    }

    fn unreached(&self) -> Vec<(u32, u32)> {
        vec![(u32::MAX, NONE); self.places().len()]
    }

    /// Lowers, for every place, the length of the way to the nearest of some places, and which that is,
    /// where `sources` are nearer than what is there.
    fn reach(&self, reached: &mut [(u32, u32)], sources: &[u32]) {
        let mut open: BinaryHeap<Reverse<(u32, u32, u32)>> =
            sources.iter().map(|s| Reverse((0, *s, *s))).collect();
        while let Some(Reverse((length, place, source))) = open.pop() {
            let Some(slot) = reached.get_mut(place as usize) else {
                continue;
            };
            if slot.0 <= length {
                continue;
            }
            *slot = (length, source);
            for (n, d) in self.next(place) {
                let there = length.saturating_add(millimetres(d));
                if reached.get(n as usize).is_some_and(|r| there < r.0) {
                    open.push(Reverse((there, n, source)));
                }
            }
        }
    }
}

/// A step along a wall costs this many times one in the middle.
const PENALTY: f64 = 4.0;

/// The greatest length and its place, the first of equals.
fn farthest(reached: &[(u32, u32)]) -> (u32, u32) {
    let mut best = (0, 0);
    for (place, (length, _)) in (0u32..).zip(reached) {
        if *length != u32::MAX && *length > best.0 {
            best = (*length, place);
        }
    }
    best
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "steps are short, and a cast saturates"
)]
fn millimetres(metres: f64) -> u32 {
    (1000.0 * metres) as u32
}

/// Points along a line of points, [`STEP`] apart, both ends included.
fn spaced(line: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let total = line_length(line);
    let (Some(first), Some(last)) = (line.first(), line.last()) else {
        return Vec::new();
    };
    let steps = (total / STEP).round().max(1.0);
    let step = total / steps;
    let mut out = vec![*first];
    let mut owed = step;
    for w in line.windows(2) {
        let [a, b] = w else { continue };
        let length = distance(*a, *b);
        // The last point is the end itself.
        while owed <= length && length > 0.0 && total > 0.0 {
            out.push(add(*a, scale(sub(*b, *a), owed / length)));
            owed += step;
        }
        owed -= length;
    }
    match out.last_mut() {
        Some(end) if distance(*end, *last) < 0.5 * step => *end = *last,
        _ => out.push(*last),
    }
    out
}
