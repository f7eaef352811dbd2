//! Neighbours.

use rayon::prelude::*;
use winze::kdtree::KdTree;

use super::Done;
use crate::arrays::Number;
use crate::inputs::Inputs;
use crate::measure::Bench;
use crate::settings::{NEAREST, SEARCH_RADIUS};

/// Probes that a thread takes at a time at least.
const AT_A_TIME: usize = 256;

/// A number for each probe: `ask` gives it, with room to work in that `room` makes once a thread.
fn probed<T: Number + Send, R>(
    inputs: &Inputs,
    bench: &mut Bench,
    room: impl Fn() -> R + Sync + Send,
    ask: impl Fn(&mut R, [f32; 3]) -> T + Sync + Send,
) -> anyhow::Result<Done> {
    let probes: Vec<[f32; 3]> = inputs.rows("probes.f32")?;
    let answers = bench.run(|| {
        let probes = probes.par_iter().with_min_len(AT_A_TIME);
        Ok(probes
            .map_init(&room, |room, p| ask(room, *p))
            .collect::<Vec<T>>())
    })?;
    Ok(Done::numbers(&answers))
}

/// The radius of a search, metres.
#[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
pub(super) fn search_radius(inputs: &Inputs) -> f32 {
    (SEARCH_RADIUS * inputs.voxel) as f32
}

pub(super) fn tree(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let points: Vec<[f32; 3]> = inputs.rows("map.f32")?;
    let tree = bench.run(|| Ok(KdTree::build(&points)))?;
    Ok(Done {
        count: tree.len(),
        ..Done::default()
    })
}

fn built(inputs: &Inputs) -> anyhow::Result<KdTree<'static>> {
    let points: Vec<[f32; 3]> = inputs.rows("map.f32")?;
    Ok(KdTree::build(&points))
}

pub(super) fn nearest(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let tree = built(inputs)?;
    let room = || ();
    probed(inputs, bench, room, |(), p| {
        tree.nearest(p)
            .map_or(f32::NAN, |n| n.distance_squared.sqrt())
    })
}

pub(super) fn knn(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let tree = built(inputs)?;
    probed(inputs, bench, Vec::new, |found, p| {
        tree.knn(p, NEAREST, f32::INFINITY, found);
        found.iter().map(|n| n.distance_squared.sqrt()).sum::<f32>()
    })
}

pub(super) fn radius(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (tree, radius) = (built(inputs)?, search_radius(inputs));
    // Listed, as the others list them.
    probed(inputs, bench, Vec::new, |found: &mut Vec<(u32, f32)>, p| {
        found.clear();
        tree.within(p, radius, |i, d| found.push((i, d)));
        u32::try_from(found.len()).unwrap_or(u32::MAX)
    })
}
