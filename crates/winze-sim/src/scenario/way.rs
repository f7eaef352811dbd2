//! Where surveys and drives go.

use std::collections::BTreeSet;

use winze::rng::Rng;

use super::{MapSpec, Place};
use crate::error::{Error, Result};
use crate::free_space::FreeSpace;
use crate::raycast::Caster;
use crate::vec3::{add, distance, scale, sub};

/// Drives tried before a place is given up.
const ATTEMPTS: usize = 80;
/// A drive of the unmapped part keeps this far from the mapped one, metres.
const MARGIN: f64 = 12.0;
/// Share of a drive on the border that lies in the mapped part.
const ON_BORDER: [f64; 2] = [0.1, 0.6];

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
    #[expect(clippy::cast_possible_truncation, reason = "metres")]
    places.retain(|p| taken.insert(p.map(|v| v.floor() as i64)));
    places
}

/// Refuses a line that a scenario gives where it meets a surface of the mine.
///
/// # Errors
/// [`Error::NoFreeSpace`] with the place.
pub(super) fn check(caster: &Caster, line: &[[f64; 3]]) -> Result<()> {
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

/// A drive of about `length` metres at a kind of place.
///
/// # Errors
/// [`Error::NoFreeSpace`] where none was found.
pub(super) fn drive(
    free: &FreeSpace<'_>,
    border: Option<Border>,
    place: Place,
    length: f64,
    rng: &mut Rng,
) -> Result<Vec<[f64; 3]>> {
    let hopeful: Vec<[f64; 3]> = free
        .places()
        .iter()
        .filter(|p| {
            let near = border.map_or(-1.0, |b| b.beyond(**p));
            match place {
                Place::Mapped => near <= 0.0,
                Place::Border => near.abs() <= length,
                Place::Unmapped => near >= MARGIN,
            }
        })
        .copied()
        .collect();
    let count = u32::try_from(hopeful.len()).unwrap_or(u32::MAX);
    for _ in 0..ATTEMPTS {
        let start = if count > 0 { rng.below(count) } else { 0 };
        let Some(&from) = hopeful.get(start as usize) else {
            break;
        };
        let way = free.wander(from, length, rng)?;
        if border.is_none_or(|b| suits(&b, place, &way)) {
            return Ok(way);
        }
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

fn suits(border: &Border, place: Place, way: &[[f64; 3]]) -> bool {
    let mapped = way.iter().filter(|p| border.mapped(**p)).count();
    #[expect(clippy::cast_precision_loss, reason = "a share")]
    let share = mapped as f64 / way.len().max(1) as f64;
    match place {
        Place::Mapped => share > 0.999,
        Place::Border => (ON_BORDER[0]..=ON_BORDER[1]).contains(&share),
        Place::Unmapped => way.iter().all(|p| border.beyond(*p) >= MARGIN),
    }
}
