//! Where a robot can be in a mesh, and ways between such places.
//!
//! Nothing is asked of the mesh but triangles: it may have holes, be wound either way, be a shell with an
//! outside, or lack its roof. A grid of vertical columns is looked through from above; each gap between two
//! surfaces that the robot fits into is a place, on its floor. Neighbouring places that differ by a small
//! step and see each other are joined; the largest joined set that is inside the mine is kept (`inside`).

mod columns;
mod inside;
mod ways;

use serde::{Deserialize, Serialize};
use winze::rng::Rng;
use winze::vec3::{distance, scale, sub};

pub(crate) use inside::faces;

use crate::error::{Error, Result};
use crate::raycast::Caster;

/// The room that a robot takes up around its sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Robot {
    /// Nothing is nearer to its sensor than this, metres.
    pub radius: f64,
    /// Height of its sensor above the floor, metres; of a flying robot, too, which keeps to it.
    pub height: f64,
}

impl Default for Robot {
    fn default() -> Self {
        Self {
            radius: 0.6,
            height: 1.4,
        }
    }
}

impl Robot {
    /// What the sensor keeps clear of everything, metres: the radius, but no more than leaves it room above
    /// its own floor where that slopes.
    fn clearance(&self) -> f64 {
        self.radius.min(0.8 * self.height)
    }
}

/// The places of a mine where a robot's sensor can be.
pub struct FreeSpace<'c> {
    caster: &'c Caster,
    robot: Robot,
    cell: f64,
    places: Vec<[f64; 3]>,
    /// The places that can be gone to from each.
    links: Vec<[u32; 8]>,
    /// Steps from each place to the nearest that lacks a neighbour, at most [`ROOM`].
    room: Vec<u8>,
}

/// No place.
const NONE: u32 = u32::MAX;
/// This many steps from the walls is middle enough.
const ROOM: u8 = 4;

impl<'c> FreeSpace<'c> {
    /// Finds the places. Seconds for a large mine; the same at any number of threads.
    ///
    /// # Errors
    /// [`Error::Setting`] for a robot without size, [`Error::NoFreeSpace`] where it fits nowhere.
    pub fn measure(caster: &'c Caster, robot: &Robot) -> Result<Self> {
        for (key, v) in [("radius", robot.radius), ("height", robot.height)] {
            if !(v > 0.0 && v < 100.0) {
                return Err(Error::Setting {
                    key: format!("robot.{key}"),
                    why: format!("{v} is not between 0 and 100 m"),
                });
            }
        }
        let grid = columns::Grid::over(caster);
        let all = columns::places(caster, robot, &grid);
        if all.is_empty() {
            return Err(Error::NoFreeSpace(format!(
                "nowhere in the mesh is there a floor with {:.2} m of room around a point {:.2} m above it: is \
                 it in metres, with z upwards, and the robot small enough?",
                robot.clearance(),
                robot.height
            )));
        }
        let links = columns::links(caster, robot, &grid, &all);
        let kept = inside::choose(caster, &all, &links)?;
        let mut new_index = vec![NONE; all.len()];
        for (new, old) in (0u32..).zip(&kept) {
            if let Some(slot) = new_index.get_mut(*old as usize) {
                *slot = new;
            }
        }
        let renamed = |i: u32| new_index.get(i as usize).copied().unwrap_or(NONE);
        let of = |old: &u32| links.get(*old as usize).copied().unwrap_or([NONE; 8]);
        let links: Vec<[u32; 8]> = kept.iter().map(|old| of(old).map(renamed)).collect();
        Ok(Self {
            caster,
            robot: *robot,
            cell: grid.cell,
            places: kept
                .iter()
                .filter_map(|old| all.get(*old as usize).map(|p| p.at))
                .collect(),
            room: room(&links),
            links,
        })
    }

    /// Distance between neighbouring columns, metres: 0.5, more where there would be over two million.
    #[must_use]
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// The places of the sensor: its height above the floor, clear by the robot's radius, all of them
    /// joined.
    #[must_use]
    pub fn places(&self) -> &[[f64; 3]] {
        &self.places
    }

    /// A place drawn at random.
    pub fn random_place(&self, rng: &mut Rng) -> [f64; 3] {
        let count = u32::try_from(self.places.len()).unwrap_or(u32::MAX);
        self.at(rng.below(count))
    }

    /// The place nearest to a point.
    #[must_use]
    pub fn nearest_place(&self, point: [f64; 3]) -> [f64; 3] {
        self.at(self.nearest_index(point))
    }

    /// Whether the robot's sensor can be at a point: clear by its radius and in sight of a place nearby.
    #[must_use]
    pub fn is_free(&self, point: [f64; 3]) -> bool {
        self.is_clear(point) && self.nearby(point).is_some()
    }

    fn at(&self, place: u32) -> [f64; 3] {
        self.places.get(place as usize).copied().unwrap_or_default()
    }

    fn is_clear(&self, point: [f64; 3]) -> bool {
        point.iter().all(|v| v.is_finite())
            && self.caster.nearest(point, self.robot.clearance()).is_none()
    }

    /// Whether nothing lies between two points.
    fn is_open(&self, from: [f64; 3], to: [f64; 3]) -> bool {
        is_open(self.caster, from, to)
    }

    /// The nearest place, if it is within two columns and in sight.
    fn nearby(&self, point: [f64; 3]) -> Option<u32> {
        let place = self.nearest_index(point);
        let at = self.at(place);
        let reach = 2.0 * self.cell.max(0.5 * self.robot.height);
        (distance(at, point) <= reach && self.is_open(point, at)).then_some(place)
    }

    fn nearest_index(&self, point: [f64; 3]) -> u32 {
        let mut best = (f64::INFINITY, 0);
        for (i, at) in (0u32..).zip(&self.places) {
            let d = distance(*at, point);
            if d < best.0 {
                best = (d, i);
            }
        }
        best.1
    }

    /// The places that can be gone to from one, and how far that is, metres.
    fn next(&self, place: u32) -> impl Iterator<Item = (u32, f64)> {
        let links = self.links.get(place as usize).copied().unwrap_or([NONE; 8]);
        let from = self.at(place);
        links
            .into_iter()
            .filter(|n| *n != NONE)
            .map(move |n| (n, distance(from, self.at(n))))
    }
}

/// Whether nothing lies between two points.
fn is_open(caster: &Caster, from: [f64; 3], to: [f64; 3]) -> bool {
    let d = distance(from, to);
    d == 0.0
        || caster
            .cast(from, scale(sub(to, from), 1.0 / d), d)
            .is_none()
}

/// Steps to the nearest place that lacks a neighbour, at most [`ROOM`].
fn room(links: &[[u32; 8]]) -> Vec<u8> {
    let mut room: Vec<u8> = links
        .iter()
        .map(|l| if l.contains(&NONE) { 0 } else { ROOM })
        .collect();
    for step in 0..ROOM - 1 {
        let last = room.clone();
        for (r, l) in room.iter_mut().zip(links) {
            let beside = |n: &u32| last.get(*n as usize) == Some(&step);
            if *r > step + 1 && l.iter().any(beside) {
                *r = step + 1;
            }
        }
    }
    room
}

#[cfg(test)]
mod tests;
