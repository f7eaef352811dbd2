//! Which of the joined sets of places is the inside of the mine.
//!
//! A shell also has an outside, on whose top a robot could stand, and the rock of a closed block is a hollow
//! as good as the drifts. The inside is where most rays end on a surface nearby; sets under a roof come
//! before those without; where the winding of the triangles tells air from rock, air comes before rock; then
//! the larger set comes first.

use winze::vec3::{cross, dot, norm, scale, sub};

use super::NONE;
use super::columns::Place;
use crate::error::{Error, Result};
use crate::raycast::Caster;

/// Sets smaller than this are not a mine.
const FEWEST: usize = 12;
/// So many of the largest sets are looked at.
const SETS: usize = 40;
/// Places of a set from which rays are sent.
const SAMPLES: usize = 64;
/// Surfaces further away than this do not enclose, metres.
const NEARBY: f64 = 60.0;
/// Share of the rays that end nearby, inside.
const ENCLOSED: f64 = 0.7;
/// Share of the surfaces seen from their front, where a set is air for sure.
const FRONT: f64 = 0.8;
/// A set of air comes before a larger one of rock from this share of its size.
const AIR: usize = 20;

/// What a set of places sees.
struct Seen {
    places: Vec<u32>,
    /// Share of places under a roof.
    roofed: f64,
    /// Share of level rays that end nearby.
    walls: f64,
    /// Share of all rays that end nearby.
    all: f64,
    /// Share of hit triangles that are wound to face the place.
    front: f64,
}

/// Indices of the places inside, in order.
///
/// # Errors
/// [`Error::NoFreeSpace`] where no set qualifies.
pub(super) fn choose(caster: &Caster, places: &[Place], links: &[[u32; 8]]) -> Result<Vec<u32>> {
    let mut sets = joined(links);
    sets.retain(|s| s.len() >= FEWEST);
    sets.sort_by(|a, b| b.len().cmp(&a.len()).then(a.first().cmp(&b.first())));
    sets.truncate(SETS);
    let largest = sets.first().map_or(0, Vec::len);
    let seen: Vec<Seen> = sets.into_iter().map(|s| look(caster, places, s)).collect();
    let roofed = |s: &Seen| s.roofed > 0.5 && s.all > ENCLOSED;
    let roofless = |s: &Seen| s.walls > ENCLOSED;
    let air = |s: &Seen| s.front > FRONT && s.places.len() * AIR >= largest;
    let best = seen
        .iter()
        .position(|s| roofed(s) && air(s))
        .or_else(|| seen.iter().position(roofed))
        .or_else(|| seen.iter().position(|s| roofless(s) && air(s)))
        .or_else(|| seen.iter().position(roofless));
    best.and_then(|i| seen.into_iter().nth(i))
        .map(|s| s.places)
        .ok_or_else(|| {
            Error::NoFreeSpace(format!(
                "a robot fits at {} places of the mesh, but they are not enclosed by walls, or fewer than {FEWEST} \
                 hang together (at most {largest}): is this a mine, in metres, with z upwards?",
                places.len()
            ))
        })
}

/// Sets of places that are joined, each in order.
fn joined(links: &[[u32; 8]]) -> Vec<Vec<u32>> {
    let mut met = vec![false; links.len()];
    let mut sets = Vec::new();
    for first in 0..links.len() {
        if met.get(first) != Some(&false) {
            continue;
        }
        let mut set = Vec::new();
        let mut open = vec![u32::try_from(first).unwrap_or(NONE)];
        while let Some(i) = open.pop() {
            let Some(seen) = met.get_mut(i as usize).filter(|seen| !**seen) else {
                continue;
            };
            *seen = true;
            set.push(i);
            let next = links.get(i as usize).into_iter().flatten();
            open.extend(next.filter(|n| met.get(**n as usize) == Some(&false)));
        }
        set.sort_unstable();
        sets.push(set);
    }
    sets
}

/// Sends rays from some places of a set.
fn look(caster: &Caster, places: &[Place], set: Vec<u32>) -> Seen {
    let (mut rays, mut hits, mut level, mut walls, mut front) = (0u32, 0u32, 0u32, 0u32, 0u32);
    let every = set.len().div_ceil(SAMPLES);
    let sample = set.iter().step_by(every.max(1));
    for place in sample.filter_map(|i| places.get(*i as usize)) {
        for d in directions() {
            rays += 1;
            level += u32::from(d[2] == 0.0);
            let Some(hit) = caster.cast(place.at, d, NEARBY) else {
                continue;
            };
            hits += 1;
            walls += u32::from(d[2] == 0.0);
            front += u32::from(faces_against(caster, hit.triangle, d));
        }
    }
    let under_roof = set
        .iter()
        .filter(|i| places.get(**i as usize).is_some_and(|p| p.roofed))
        .count();
    let share = |part: u32, whole: u32| f64::from(part) / f64::from(whole.max(1));
    #[expect(clippy::cast_precision_loss, reason = "a share")]
    let roofed = under_roof as f64 / set.len().max(1) as f64;
    Seen {
        roofed,
        walls: share(walls, level),
        all: share(hits, rays),
        front: share(front, hits),
        places: set,
    }
}

/// How many of the surfaces that rays from a point meet face it, and how many they meet.
pub(crate) fn faces(caster: &Caster, from: [f64; 3]) -> (u32, u32) {
    let (mut front, mut hits) = (0, 0);
    for d in directions() {
        if let Some(hit) = caster.cast(from, d, NEARBY) {
            hits += 1;
            front += u32::from(faces_against(caster, hit.triangle, d));
        }
    }
    (front, hits)
}

/// A triangle's winding faces whoever looks in a direction.
fn faces_against(caster: &Caster, triangle: u32, direction: [f64; 3]) -> bool {
    caster
        .mesh()
        .corners(triangle as usize)
        .is_some_and(|corners| {
            let [a, b, c] = corners.map(|v| v.map(f64::from));
            dot(cross(sub(b, a), sub(c, a)), direction) < 0.0
        })
}

/// The 26 directions to the neighbours in a cubic lattice.
fn directions() -> impl Iterator<Item = [f64; 3]> {
    const S: [f64; 3] = [-1.0, 0.0, 1.0];
    let all = S
        .into_iter()
        .flat_map(|x| S.into_iter().flat_map(move |y| S.map(|z| [x, y, z])));
    all.filter(|d| *d != [0.0; 3])
        .map(|d| scale(d, 1.0 / norm(d)))
}
