//! The searches of kiddo: its immutable tree, which its documentation recommends for points that are known.

use std::num::NonZero;

use anyhow::Context as _;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::Done;
use super::search::{probed, search_radius};
use crate::inputs::Inputs;
use crate::measure::Bench;
use crate::settings::NEAREST;

type Tree = ImmutableKdTree<f32, 3>;
type Distance = SquaredEuclidean<f32>;

/// By the constructor for as many threads as there are.
fn build(points: &[[f32; 3]]) -> anyhow::Result<Tree> {
    let tree = if rayon::current_num_threads() > 1 {
        Tree::new_from_slice_parallel(points)
    } else {
        Tree::new_from_slice(points)
    };
    tree.ok().context("kiddo builds no tree of these points")
}

pub(super) fn tree(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let points: Vec<[f32; 3]> = inputs.rows("map.f32")?;
    let tree = bench.run(|| build(&points))?;
    Ok(Done {
        count: tree.size(),
        ..Done::default()
    })
}

fn built(inputs: &Inputs) -> anyhow::Result<Tree> {
    let points: Vec<[f32; 3]> = inputs.rows("map.f32")?;
    build(&points)
}

pub(super) fn nearest(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let tree = built(inputs)?;
    let room = || ();
    probed(inputs, bench, room, |(), p| {
        tree.query(&p)
            .nearest_one::<Distance>()
            .execute()
            .distance
            .sqrt()
    })
}

pub(super) fn knn(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let tree = built(inputs)?;
    let room = || ();
    let k = NonZero::new(NEAREST).context("no neighbours")?;
    probed(inputs, bench, room, |(), p| {
        let found = tree.query(&p).nearest_n::<Distance>(k).execute();
        found.iter().map(|n| n.distance.sqrt()).sum::<f32>()
    })
}

pub(super) fn radius(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (tree, radius) = (built(inputs)?, search_radius(inputs));
    let room = || ();
    probed(inputs, bench, room, |(), p| {
        let within = tree.query(&p).within::<Distance>(radius * radius);
        u32::try_from(within.unsorted().execute().len()).unwrap_or(u32::MAX)
    })
}
