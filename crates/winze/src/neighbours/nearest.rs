//! The nearest neighbours of points that share a walk.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16};

use super::moments::{Moments, Sums};
use super::{LANES, Neighbours, offsets};
use crate::kdtree::{KdTree, Neighbour};
use crate::simd::level;

/// Points that a group looks at together, at most: where more lie near, as within a stray's reach, each is looked up alone.
const MOST: usize = 4096;
/// How much further than its neighbours' a point's neighbours are looked for.
const FURTHER: f32 = 1.3;

/// The nearest neighbours of groups of points, each of which lies near the one before.
#[derive(Debug, Default)]
pub(crate) struct Nearest {
    near: Neighbours,
    /// Of the last group: the largest squared distance of a point to the last of its neighbours.
    widest: f32,
    /// Within which squared distance the last point's neighbours were.
    last: f32,
    found: Vec<Neighbour>,
}

impl Nearest {
    /// Gathers what the `count` nearest within `radius` of the first of `members` are probably among, as [`Neighbours::gather`] does.
    pub(crate) fn gather(
        &mut self,
        tree: &KdTree<'_>,
        (count, radius): (usize, f32),
        members: Range<usize>,
        at: impl Fn(usize) -> [f32; 3],
    ) -> Range<usize> {
        // Its neighbours' neighbours are about as far.
        let mut reach = std::mem::take(&mut self.widest);
        if reach <= 0.0 {
            self.look_up(tree, at(members.start), (count, radius));
            reach = self.found.last().map_or(0.0, |n| n.distance_squared);
        }
        let reach = (FURTHER * reach.sqrt()).min(radius);
        let most = MOST.max(8 * count);
        self.near.gather_up_to(most, tree, reach, members, at)
    }

    /// What `ask` finds among what was gathered, with the guess of a squared distance that it is given; it tells in which the
    /// nearest were, or nothing where they must be looked up.
    pub(crate) fn ask<T>(
        &mut self,
        ask: impl FnOnce(&mut Neighbours, f32) -> Option<(T, f32)>,
    ) -> Option<T> {
        let (found, limit) = ask(&mut self.near, self.last)?;
        self.widest = self.widest.max(limit);
        self.last = limit;
        Some(found)
    }

    /// The `count` nearest within `radius` of `q`, wherever it lies.
    pub(crate) fn look_up(
        &mut self,
        tree: &KdTree<'_>,
        q: [f32; 3],
        (count, radius): (usize, f32),
    ) -> &[Neighbour] {
        tree.knn(q, count, radius, &mut self.found);
        &self.found
    }
}

/// See [`Neighbours::room`].
type Room<'a> = ([&'a [f32]; 3], &'a mut [f32], &'a mut [u32], f32);

impl Neighbours {
    /// What is gathered, an array an axis; room for the distances of its blocks and for their numbers; and the squared
    /// radius. `None` where too many were near.
    fn room(&mut self) -> Option<Room<'_>> {
        if self.over {
            return None;
        }
        self.squared.resize(self.axes[0].len(), 0.0);
        self.blocks.resize(self.axes[0].len() / LANES, 0);
        let axes = self.axes.each_ref().map(|a| &a[..]);
        Some((axes, &mut self.squared, &mut self.blocks, self.limit))
    }

    /// Sums over the `count` nearest to `q`, one of the group's members, itself among them, and a squared distance within
    /// which they lie and no others; `None` where fewer lie within the radius, too many were near, or the last one is as
    /// far as the next. `guess` is the squared distance that is tried first.
    pub(crate) fn moments_of_nearest(
        &mut self,
        q: [f32; 3],
        count: usize,
        guess: f32,
    ) -> Option<(Moments, f32)> {
        let (axes, squared, blocks, limit) = self.room()?;
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let sought = (limit, count, guess);
                let (kept, limit) = limit_of_nearest(simd, axes, q, sought, squared, blocks)?;
                let mut sums = Sums::zero(simd);
                for &b in &blocks[..kept] {
                    sums.add(simd, axes, b as usize, q, limit);
                }
                Some((sums.total(), limit))
            }
        ))
    }

    /// The sum of the distances of the `count` nearest to `q`, and the squared distance as in
    /// [`Neighbours::moments_of_nearest`]; `None` as there.
    pub(crate) fn distance_sum_of_nearest(
        &mut self,
        q: [f32; 3],
        count: usize,
        guess: f32,
    ) -> Option<(f64, f32)> {
        let (axes, squared, blocks, limit) = self.room()?;
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let sought = (limit, count, guess);
                let (kept, limit) = limit_of_nearest(simd, axes, q, sought, squared, blocks)?;
                Some((root_sum(simd, &squared[..kept * LANES], limit), limit))
            }
        ))
    }
}

/// Squared distances and numbers of the blocks that may hold the `count` nearest, how many blocks these are, and a squared distance
/// within which the nearest lie and no others. At most `limit` is looked at, and `guess` first.
#[inline(always)]
fn limit_of_nearest<S: Simd>(
    simd: S,
    axes: [&[f32]; 3],
    q: [f32; 3],
    (limit, count, guess): (f32, usize, f32),
    squared: &mut [f32],
    blocks: &mut [u32],
) -> Option<(usize, f32)> {
    let (kept, within) = near_blocks(simd, axes, q, limit, squared, blocks);
    let squared = &squared[..kept * LANES];
    let limit = threshold(simd, squared, (limit, within), count, guess)?;
    Some((kept, limit))
}

/// Squared distances from `q` of those blocks that hold one of at most `limit`, and which blocks these are; tells how many
/// they are, and how many such distances.
#[inline(always)]
fn near_blocks<S: Simd>(
    simd: S,
    axes: [&[f32]; 3],
    q: [f32; 3],
    limit: f32,
    squared: &mut [f32],
    blocks: &mut [u32],
) -> (usize, usize) {
    let limit = f32x16::splat(simd, limit);
    let (mut kept, mut within) = (0, 0);
    for b in 0..blocks.len() {
        let (_, d2) = offsets(simd, axes, b, q);
        let near = d2.simd_le(limit).to_bitmask().count_ones() as usize;
        // Written whether it is kept or not: that is quicker than asking first.
        d2.store_slice(&mut squared[kept * LANES..(kept + 1) * LANES]);
        #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
        let number = b as u32;
        blocks[kept] = number;
        kept += usize::from(near > 0);
        within += near;
    }
    (kept, within)
}

/// The sum of the square roots of what is at most `limit`.
#[inline(always)]
fn root_sum<S: Simd>(simd: S, squared: &[f32], limit: f32) -> f64 {
    let zero = f32x16::splat(simd, 0.0);
    let limit = f32x16::splat(simd, limit);
    let mut sum = zero;
    for block in squared.chunks_exact(LANES) {
        let d2 = f32x16::from_slice(simd, block);
        sum += d2.simd_le(limit).select(d2, zero).sqrt();
    }
    let sum: [f32; LANES] = sum.into();
    sum.iter().map(|v| f64::from(*v)).sum()
}

/// A value that `count` of those within `limit` do not exceed; `None` where there is none.
///
/// Where numbers lie evenly, as squared distances on a surface do, the place of the one sought is nearly told by how many
/// there are: a few counts narrow it down.
#[inline(always)]
pub(super) fn threshold<S: Simd>(
    simd: S,
    squared: &[f32],
    (limit, within): (f32, usize),
    count: usize,
    guess: f32,
) -> Option<f32> {
    if within <= count {
        return (within == count).then_some(limit);
    }
    let (mut low, mut below) = (0.0f32, 0);
    let (mut high, mut within) = (limit, within);
    for step in 0..STEPS {
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let share = ((count - below) as f32 + 0.5) / ((within - below) as f32 + 1.0);
        let mut middle = match step {
            0 => guess,
            _ if step % 4 == 0 => low + (high - low) * 0.5,
            _ => low + (high - low) * share,
        };
        if step == 0 && !(middle > low && middle < high) {
            middle = low + (high - low) * share;
        }
        if !(middle > low && middle < high) {
            return None;
        }
        let found = count_up_to(simd, squared, middle);
        match found.cmp(&count) {
            std::cmp::Ordering::Equal => return Some(middle),
            std::cmp::Ordering::Less => (low, below) = (middle, found),
            std::cmp::Ordering::Greater => (high, within) = (middle, found),
        }
    }
    None
}

/// How many are at most `limit`.
#[inline(always)]
fn count_up_to<S: Simd>(simd: S, squared: &[f32], limit: f32) -> usize {
    let limit = f32x16::splat(simd, limit);
    let mut count = 0;
    for block in squared.chunks_exact(LANES) {
        let d2 = f32x16::from_slice(simd, block);
        count += d2.simd_le(limit).to_bitmask().count_ones() as usize;
    }
    count
}

/// Counts after which a number is taken for one that occurs twice.
const STEPS: usize = 32;
