//! Where surveys and drives go.

use std::collections::BTreeSet;

use winze::rng::Rng;
use winze::vec3::{add, distance, line_length, scale, sub, voxel_of};

use super::{MapSpec, Place, QuerySpec};
use crate::error::{Error, Result};
use crate::free_space::{self, FreeSpace};
use crate::raycast::Caster;

/// Drives tried before a place is given up.
const ATTEMPTS: usize = 80;
/// A drive of the unmapped part keeps this far from the mapped one, metres.
const MARGIN: f64 = 12.0;
/// A drive of less than this share of the length that was asked for is taken only where none is longer.
const LONG_ENOUGH: f64 = 0.8;

/// Where the mapped part of a mine ends: across its longer side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Border {
    axis: usize,
    at: f64,
}

impl Border {
    /// The border that leaves out the map's share of all places; `None` for a map of the whole mine.
    pub(super) fn of(free: &FreeSpace<'_>, map: &MapSpec) -> Option<Self> {
        if map.leave_out <= 0.0 {
            return None;
        }
        let places = free.places();
        let sorted = |axis: usize| {
            let mut v: Vec<f64> = places.iter().map(|p| p[axis]).collect();
            v.sort_by(f64::total_cmp);
            v
        };
        let [x, y] = [sorted(0), sorted(1)];
        let extent =
            |v: &[f64]| v.last().copied().unwrap_or(0.0) - v.first().copied().unwrap_or(0.0);
        let axis = usize::from(extent(&y) > extent(&x));
        let along = if axis == 0 { x } else { y };
        #[expect(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count"
        )]
        let index = ((1.0 - map.leave_out) * along.len() as f64) as usize;
        let at = *along.get(index)?;
        Some(Self { axis, at })
    }

    /// Metres beyond the border; negative in the mapped part.
    fn beyond(&self, p: [f64; 3]) -> f64 {
        p[self.axis] - self.at
    }

    /// The point lies in the mapped part.
    pub(super) fn mapped(&self, p: [f64; 3]) -> bool {
        self.beyond(p) <= 0.0
    }
}

/// The legs of a survey of the mapped part.
pub(super) fn survey(
    free: &FreeSpace<'_>,
    border: Option<Border>,
    spacing: f64,
) -> Result<Vec<Vec<[f64; 3]>>> {
    let mapped = |p: &[f64; 3]| border.is_none_or(|b| b.mapped(*p));
    let legs = free
        .tour(spacing)?
        .iter()
        // A leg across the border ends there, and may come back.
        .flat_map(|leg| {
            leg.split(|p| !mapped(p))
                .map(<[_]>::to_vec)
                .collect::<Vec<_>>()
        })
        .filter(|leg| !leg.is_empty())
        .collect();
    Ok(legs)
}

/// Places a metre apart or a little more.
pub(super) fn every_metre(free: &FreeSpace<'_>) -> Vec<[f64; 3]> {
    let mut taken = BTreeSet::new();
    let mut places = free.places().to_vec();
    places.retain(|p| taken.insert(voxel_of(*p, 1.0)));
    places
}

/// Refuses a line that a scenario gives where it meets a surface of the mine, or where it begins in rock: there
/// most surfaces in sight show their backs. `wound` tells whether the mesh's triangles are known to face the air.
///
/// # Errors
/// [`Error::NoFreeSpace`] with the place.
pub(super) fn check(caster: &Caster, line: &[[f64; 3]], wound: bool) -> Result<()> {
    if let Some(start) = line.first().filter(|_| wound) {
        let (front, hits) = free_space::faces(caster, *start);
        if hits > 0 && 2 * front < hits {
            return Err(Error::NoFreeSpace(format!(
                "through: the line begins in the rock, at {:.2}, {:.2}, {:.2}",
                start[0], start[1], start[2]
            )));
        }
    }
    for ends in line.windows(2) {
        let [a, b] = ends else { continue };
        let length = distance(*a, *b);
        if length <= 0.0 {
            continue;
        }
        let direction = scale(sub(*b, *a), 1.0 / length);
        if let Some(hit) = caster.cast(*a, direction, length) {
            let at = add(*a, scale(direction, hit.range));
            return Err(Error::NoFreeSpace(format!(
                "through: the line meets rock, or what stands before it, at {:.2}, {:.2}, {:.2}",
                at[0], at[1], at[2]
            )));
        }
    }
    Ok(())
}

/// The way past given places, from each to the next through free space.
///
/// # Errors
/// [`Error::NoFreeSpace`] where the robot cannot be at one of them.
pub(super) fn past(free: &FreeSpace<'_>, places: &[[f64; 3]]) -> Result<Vec<[f64; 3]>> {
    let mut way: Vec<[f64; 3]> = Vec::new();
    for ends in places.windows(2) {
        let [from, to] = ends else { continue };
        let leg = free.path(*from, *to)?;
        way.extend(leg.iter().skip(usize::from(!way.is_empty())));
    }
    Ok(way)
}

/// A drive of about `length` metres at the kind of place that the queries ask for.
///
/// # Errors
/// [`Error::NoFreeSpace`] where none was found.
pub(super) fn drive(
    free: &FreeSpace<'_>,
    border: Option<Border>,
    spec: &QuerySpec,
    length: f64,
    rng: &mut Rng,
) -> Result<Vec<[f64; 3]>> {
    let place = spec.place;
    let hopeful: Vec<[f64; 3]> = free
        .places()
        .iter()
        .filter(|p| {
            let near = border.map_or(-1.0, |b| b.beyond(**p));
            match place {
                Place::Mapped => near <= 0.0,
                // As deep in the mapped part as the drive may begin there.
                Place::Border => near <= 0.0 && -near <= spec.mapped_share[1] * length,
                Place::Unmapped => near >= MARGIN,
            }
        })
        .copied()
        .collect();
    let count = u32::try_from(hopeful.len()).unwrap_or(u32::MAX);
    let mut best: Option<(f64, Vec<[f64; 3]>)> = None;
    for _ in 0..ATTEMPTS {
        let start = if count > 0 { rng.below(count) } else { 0 };
        let Some(&from) = hopeful.get(start as usize) else {
            break;
        };
        let mut way = free.wander(from, length, rng)?;
        if place == Place::Border && rng.below(2) == 1 {
            way.reverse();
        }
        if !border.is_none_or(|b| suits(&b, spec, &way)) {
            continue;
        }
        let long = line_length(&way);
        if long >= LONG_ENOUGH * length {
            return Ok(way);
        }
        if best.as_ref().is_none_or(|(longest, _)| long > *longest) {
            best = Some((long, way));
        }
    }
    // The mine is too small for longer ones.
    if let Some((_, way)) = best {
        return Ok(way);
    }
    Err(Error::NoFreeSpace(format!(
        "no drive of {length:.0} m was found in the {} part of the mine in {ATTEMPTS} attempts; choose shorter ones, or another share that is left out of the map",
        match place {
            Place::Mapped => "mapped",
            Place::Border => "partly mapped",
            Place::Unmapped => "unmapped",
        }
    )))
}

fn suits(border: &Border, spec: &QuerySpec, way: &[[f64; 3]]) -> bool {
    let mapped = way.iter().filter(|p| border.mapped(**p)).count();
    #[expect(clippy::cast_precision_loss, reason = "a share")]
    let share = mapped as f64 / way.len().max(1) as f64;
    match spec.place {
        Place::Mapped => share > 0.999,
        Place::Border => (spec.mapped_share[0]..=spec.mapped_share[1]).contains(&share),
        Place::Unmapped => way.iter().all(|p| border.beyond(*p) >= MARGIN),
    }
}
