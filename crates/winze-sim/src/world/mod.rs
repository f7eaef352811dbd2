//! Procedural worlds: mines, a cave, a wall, as triangle meshes of named parts.
//!
//! A world has a plan (how far a place is from the planned walls) and relief (how the rock strays from it);
//! their sum is polygonised, the rock's triangles are told apart by what they are, and fittings are put
//! in. The same settings and seed give the same bits at any thread count.

mod cave;
mod field;
mod fittings;
mod kinds;
mod network;
mod parallel;
mod plan;
mod polygonise;
mod relief;
mod rooms;
mod runs;
mod settings;
mod slab;
mod solids;
mod spec;
mod split;
mod vehicles;

pub use kinds::{Cave, Change, Drifts, Fittings, Parallel, Rock, Rooms, Wall};
pub use spec::WorldSpec;

use crate::error::Result;
use crate::mesh::Mesh;
use field::Field;
use plan::{Leg, Plan, between};
use relief::Relief;
use runs::{Run, Station};
use winze::rng::Rng;

/// A world.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Its surfaces.
    pub mesh: Mesh,
    /// Length of its drifts or tubes together, metres; zero for rooms and walls.
    pub drift_length: f64,
    /// Named places on its floor, in the open, useful as starts and to tell of regions.
    pub marks: Vec<Mark>,
}

/// A named place.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Its name, such as `heading 3`.
    pub name: String,
    /// The planned floor there, metres.
    pub floor: [f64; 3],
    /// A direction in which there is something to see, radians from x towards y.
    pub azimuth: f64,
}

/// The plan of a world and what goes with it.
#[derive(Debug, Clone, PartialEq)]
struct Layout {
    plan: Plan,
    /// Ways through it, along which fittings are put.
    runs: Vec<Run>,
    marks: Vec<Mark>,
    length: f64,
}

/// More triangles than this are refused.
const MOST_TRIANGLES: f64 = 4e7;

/// Builds a world. Without `change` the same seed gives the same world; with it the rock is the same where
/// nothing changed, and parts that are new or stand elsewhere have [`Part::new`](crate::mesh::Part::new).
/// `progress` hears of the share that is done.
///
/// # Errors
/// [`Error::Setting`](crate::Error::Setting) for settings outside their domain and for worlds that are too
/// large; [`Error::TooLarge`](crate::Error::TooLarge) where a mesh can't be counted.
pub fn build(
    spec: &WorldSpec,
    seed: u64,
    change: Option<&Change>,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<World> {
    spec.validate()?;
    if let Some(change) = change {
        change.validate()?;
    }
    check_size(spec)?;
    let rock = spec.rock();
    let (layout, longest, bed) = match spec {
        WorldSpec::Drifts(w) => (network::grow(w, seed), 3.5, 0.6),
        WorldSpec::Parallel(w) => (parallel::lay_out(w), 3.5, 0.6),
        WorldSpec::Cave(w) => (cave::grow(w, seed), 6.0, 0.9),
        WorldSpec::Rooms(w) => {
            let plan = rooms::RoomPlan::new(w, seed);
            let (runs, marks) = (plan.runs(), plan.marks());
            (Layout::of(Plan::Rooms(plan), runs, marks), 3.5, 0.6)
        }
        WorldSpec::Wall(w) => {
            let plan = slab::SlabPlan::new(w);
            let (runs, marks) = (plan.runs(), plan.marks());
            (Layout::of(Plan::Slab(plan), runs, marks), 2.0, w.bed)
        }
    };
    refuse_too_large(layout.plan.area(), rock.cell)?;
    let before = Field {
        plan: layout.plan,
        relief: Relief::new(rock, longest, bed, seed ^ 0x7265_6C69),
    };
    let advanced = change.map_or_else(Vec::new, |c| advance(&before.plan, &layout.runs, c, seed));
    let mut now = before.clone();
    if let Plan::Legs(legs) = &mut now.plan {
        legs.extend(advanced.iter().copied());
    }
    let surface = polygonise::polygonise(&now, &|share| progress(0.9 * share))?;
    let mut mesh = Mesh::default();
    split::add_rock(
        &mut mesh,
        &surface,
        &now,
        (!advanced.is_empty()).then_some(&before),
    )?;
    drop(surface);
    progress(0.95);
    let fittings = match spec {
        WorldSpec::Drifts(w) => w.fittings.clone(),
        WorldSpec::Rooms(w) => w.fittings.clone(),
        WorldSpec::Parallel(w) => w.fittings.clone(),
        WorldSpec::Cave(w) => Fittings {
            muck: w.rockfall,
            ..Fittings::default()
        },
        WorldSpec::Wall(_) => Fittings::default(),
    };
    fittings::add(&mut mesh, &before, &layout.runs, &fittings, change, seed)?;
    progress(1.0);
    Ok(World {
        mesh,
        drift_length: layout.length,
        marks: layout.marks,
    })
}

impl Layout {
    fn of(plan: Plan, runs: Vec<Run>, marks: Vec<Mark>) -> Self {
        Self {
            plan,
            runs,
            marks,
            length: 0.0,
        }
    }
}

/// The headings that were advanced, as drifts of their own that go through the old face.
fn advance(plan: &Plan, runs: &[Run], change: &Change, seed: u64) -> Vec<Leg> {
    let Plan::Legs(legs) = plan else {
        return Vec::new();
    };
    let mut out = Vec::new();
    for (run, number) in runs.iter().zip(0u64..) {
        let mut rng = Rng::new(seed, 0x626C_6173 ^ (number << 32));
        let chosen = rng.uniform() < change.headings;
        let Some(old) = run.heading.and_then(|i| legs.get(i)).filter(|_| chosen) else {
            continue;
        };
        let length = old.length().max(0.1);
        let side = rng.range(-0.04, 0.04);
        let on = |share: f64| between(&old.ends, share);
        let from = on((1.0 - 1.2 / length).max(0.0));
        let mut to = on(1.0 + change.advance * rng.range(0.7, 1.0) / length);
        to[0] -= side * (to[1] - from[1]);
        to[1] += side * (to[0] - from[0]);
        let scale = rng.range(0.94, 1.0);
        out.push(Leg {
            ends: [from, to],
            width: [scale * old.width[1]; 2],
            height: [scale * old.height[1]; 2],
            arch: old.arch,
            face: [true; 2],
            drift: legs.len() + out.len(),
        });
    }
    out
}

/// Refuses a world whose settings alone say that it has too many triangles, before it is laid out.
fn check_size(spec: &WorldSpec) -> Result<()> {
    let area = match spec {
        WorldSpec::Drifts(w) => w.length * (w.width[0] + w.width[1] + w.height[0] + w.height[1]),
        WorldSpec::Cave(w) => w.length * 3.0 * (w.radius[0] + w.radius[1]),
        WorldSpec::Rooms(w) => w.extent_x * w.extent_y,
        WorldSpec::Parallel(w) => {
            let crosscuts = f64::from((w.drifts - 1) * w.crosscuts) * w.spacing;
            (f64::from(w.drifts) * w.length + crosscuts) * 2.0 * (w.width + w.height)
        }
        WorldSpec::Wall(w) => w.width * w.height,
    };
    refuse_too_large(area, spec.rock().cell)
}

fn refuse_too_large(area: f64, cell: f64) -> Result<()> {
    // Two triangles a cell, and relief makes half as many again.
    let triangles = 3.0 * area / (cell * cell);
    if triangles <= MOST_TRIANGLES {
        return Ok(());
    }
    let why = format!(
        "the world would have about {:.0} million triangles, at most {:.0} are made: make it smaller, or cell at least {:.3}",
        triangles * 1e-6,
        MOST_TRIANGLES * 1e-6,
        (3.0 * area / MOST_TRIANGLES).sqrt() + 0.0005,
    );
    Err(settings::refused("cell", why))
}

#[cfg(test)]
mod tests;
