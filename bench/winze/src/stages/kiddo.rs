//! The searches of kiddo: its immutable tree and its batch queries, which its documentation recommends for points and probes that are
//! known.

use std::num::NonZero;
use std::sync::atomic::{AtomicU32, Ordering};

use anyhow::Context as _;
use kiddo::{ImmutableKdTree, SquaredEuclidean};

use super::Done;
use super::search::search_radius;
use crate::inputs::Inputs;
use crate::measure::Bench;
use crate::settings::NEAREST;

/// Probes that tell how many points are to be expected.
const FEW: usize = 1000;

type Points = Vec<[f32; 3]>;
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
    let points: Points = inputs.rows("map.f32")?;
    let tree = bench.run(|| build(&points))?;
    Ok(Done {
        count: tree.size(),
        ..Done::default()
    })
}

/// The tree and the probes.
fn given(inputs: &Inputs) -> anyhow::Result<(Tree, Points)> {
    let points: Points = inputs.rows("map.f32")?;
    Ok((build(&points)?, inputs.rows("probes.f32")?))
}

/// A number for each probe, as its bits. A batch runs on the threads of the current pool and tells its answers in any order.
fn batched(bench: &mut Bench, probes: usize, ask: impl Fn(&[AtomicU32])) -> anyhow::Result<Done> {
    let answers = bench.run(|| {
        let answers: Vec<AtomicU32> = (0..probes).map(|_| AtomicU32::new(0)).collect();
        ask(&answers);
        Ok(answers)
    })?;
    let bits: Vec<u32> = answers.into_iter().map(AtomicU32::into_inner).collect();
    Ok(Done::numbers(&bits).noted("query_batch"))
}

pub(super) fn nearest(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (tree, probes) = given(inputs)?;
    batched(bench, probes.len(), |answers| {
        let nearest = tree.query_batch(&probes).nearest_one::<Distance>();
        nearest.for_each(|i, n| answers[i].store(n.distance.sqrt().to_bits(), Ordering::Relaxed));
    })
}

pub(super) fn knn(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (tree, probes) = given(inputs)?;
    let k = NonZero::new(NEAREST).context("no neighbours")?;
    batched(bench, probes.len(), |answers| {
        let nearest = tree.query_batch(&probes).nearest_n::<Distance>(k);
        nearest.for_each(|i, found| {
            let sum = found.iter().map(|n| n.distance.sqrt()).sum::<f32>();
            answers[i].store(sum.to_bits(), Ordering::Relaxed);
        });
    })
}

pub(super) fn radius(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (tree, probes) = given(inputs)?;
    let radius = search_radius(inputs);
    let squared = radius * radius;
    // Its documentation recommends room for as many as are expected.
    let few = &probes[..probes.len().min(FEW)];
    let found = few.iter().map(|p| {
        let within = tree.query(p).within::<Distance>(squared);
        within.unsorted().execute().len()
    });
    let expected = found.sum::<usize>() / few.len().max(1);
    batched(bench, probes.len(), |answers| {
        let within = tree.query_batch(&probes).within::<Distance>(squared);
        let within = within.unsorted().with_result_capacity(expected);
        within.for_each(|i, found| {
            let count = u32::try_from(found.len()).unwrap_or(u32::MAX);
            answers[i].store(count, Ordering::Relaxed);
        });
    })
}
