//! Neighbours of many points at once.
//!
//! Points that follow each other in memory are near each other, so they share most of what a search from the
//! root would find: a tree is walked once for a group of them, and each then picks its own from what was found.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16};

use crate::kdtree::{KdTree, Neighbour};
use crate::simd::level;

mod moments;
mod nearest;
#[cfg(test)]
mod tests;

pub(crate) use moments::Moments;
use moments::{Sums, lanes_in_pairs};
pub(crate) use nearest::Nearest;

/// Points that share a walk through the tree.
pub(crate) const GROUP: usize = 32;
/// Places that are looked at together.
pub(crate) const LANES: usize = 16;
/// A group wider than this many radii is no group.
const WIDEST: f32 = 3.0;

/// What lies near a group of points, and scratch space.
#[derive(Debug, Default)]
pub(crate) struct Neighbours {
    /// Coordinates, up to a whole number of [`LANES`] with some that are near nothing.
    axes: [Vec<f32>; 3],
    /// Where each is in the tree's leaf order.
    places: Vec<u32>,
    squared: Vec<f32>,
    /// Blocks of which one at least was near.
    blocks: Vec<u32>,
    found: Vec<Neighbour>,
    limit: f32,
    /// Places that are gathered at most, and whether there were more.
    most: usize,
    over: bool,
}

impl Neighbours {
    /// Gathers what lies within `radius` of the first of `members`, as many of them as lie together, and tells how many
    /// these are. A member is told by its number.
    pub(crate) fn gather(
        &mut self,
        tree: &KdTree<'_>,
        radius: f32,
        members: Range<usize>,
        at: impl Fn(usize) -> [f32; 3],
    ) -> Range<usize> {
        self.gather_up_to(usize::MAX, tree, radius, members, at)
    }

    /// The same for what asks for nearest ones alone, which finds nothing where there is more than about `most`: a
    /// radius that was guessed too wide must not hold the whole cloud.
    pub(crate) fn gather_up_to(
        &mut self,
        most: usize,
        tree: &KdTree<'_>,
        radius: f32,
        mut members: Range<usize>,
        at: impl Fn(usize) -> [f32; 3],
    ) -> Range<usize> {
        self.most = most;
        self.limit = radius * radius;
        loop {
            let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
            for p in members.clone().map(&at) {
                for a in 0..3 {
                    low[a] = low[a].min(p[a]);
                    high[a] = high[a].max(p[a]);
                }
            }
            let together = (0..3).all(|a| high[a] - low[a] <= WIDEST * radius);
            if together || members.len() <= 1 {
                self.collect(tree, low, high);
                return members;
            }
            members.end = members.start + members.len() / 2;
        }
    }

    fn collect(&mut self, tree: &KdTree<'_>, low: [f32; 3], high: [f32; 3]) {
        self.axes.iter_mut().for_each(Vec::clear);
        self.places.clear();
        let (_, axes) = tree.parts();
        let most = self.most;
        let mut take = |range: Range<usize>| {
            for (own, axis) in self.axes.iter_mut().zip(axes) {
                own.extend_from_slice(&axis[range.clone()]);
            }
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
            self.places.extend(range.start as u32..range.end as u32);
        };
        // Leaves that follow each other are copied together.
        let mut run = 0..0;
        let mut count = 0;
        tree.leaves_near(low, high, self.limit, |range| {
            count += range.len();
            if count > most {
                return false;
            }
            if range.start == run.end {
                run.end = range.end;
            } else {
                take(std::mem::replace(&mut run, range));
            }
            true
        });
        take(run);
        self.over = count > most;
        let whole = self.places.len().next_multiple_of(LANES);
        self.axes.iter_mut().for_each(|a| a.resize(whole, f32::NAN));
    }

    /// Where the gathered points are in the tree's leaf order, and their coordinates, an array an axis: a whole number of
    /// [`LANES`], filled up with NaN.
    pub(crate) fn gathered(&self) -> (&[u32], [&[f32]; 3]) {
        (&self.places, self.axes.each_ref().map(|a| &a[..]))
    }

    /// The neighbours of `q`, one of the group's members, in the tree's leaf order, itself among them.
    pub(crate) fn of(&mut self, tree: &KdTree<'_>, q: [f32; 3]) -> &[Neighbour] {
        let none = Neighbour {
            index: 0,
            distance_squared: 0.0,
        };
        self.found.resize(self.places.len(), none);
        self.squared.resize(self.axes[0].len(), 0.0);
        let mut count = 0;
        let (found, squared, limit) = (&mut self.found[..], &mut self.squared[..], self.limit);
        let axes = self.axes.each_ref().map(|a| &a[..]);
        let places = &self.places[..];
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || distances(simd, axes, q, squared)
        ));
        for (places, squared) in places.chunks(LANES).zip(squared.chunks(LANES)) {
            // Most blocks lie wholly outside.
            let within: u32 = squared.iter().map(|d| u32::from(*d <= limit)).sum();
            if within == 0 {
                continue;
            }
            // Written whether it belongs or not: that is quicker than asking first.
            for (&place, &distance_squared) in places.iter().zip(squared) {
                found[count] = Neighbour {
                    index: tree.name(place as usize),
                    distance_squared,
                };
                count += usize::from(distance_squared <= limit);
            }
        }
        &self.found[..count]
    }

    /// Sums over all neighbours of `q`, one of the group's members, within the radius.
    pub(crate) fn moments_within(&self, q: [f32; 3]) -> Moments {
        let axes = self.axes.each_ref().map(|a| &a[..]);
        let limit = self.limit;
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let mut sums = Sums::zero(simd);
                for b in 0..axes[0].len() / LANES {
                    sums.add(simd, axes, b, q, limit);
                }
                sums.total()
            }
        ))
    }

    /// The sum, over all neighbours of `q`, one of the group's members, within the radius, of how far each lies out along `n`,
    /// of which up to `most` counts. In lanes as [`Moments`] are.
    pub(crate) fn balance(&self, q: [f32; 3], n: [f32; 3], most: f32) -> f32 {
        let axes = self.axes.each_ref().map(|a| &a[..]);
        let limit = self.limit;
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let zero = f32x16::splat(simd, 0.0);
                let limit = f32x16::splat(simd, limit);
                let (least, most) = (f32x16::splat(simd, -most), f32x16::splat(simd, most));
                let mut sum = zero;
                for b in 0..axes[0].len() / LANES {
                    let ([x, y, z], d2) = offsets(simd, axes, b, q);
                    let out = (x * n[0] + y * n[1]) + z * n[2];
                    sum += d2.simd_le(limit).select(out.max(least).min(most), zero);
                }
                lanes_in_pairs(sum)
            }
        ))
    }
}

/// The squared distance of each place from `q`, as the tree rounds it.
#[inline(always)]
fn distances<S: Simd>(simd: S, axes: [&[f32]; 3], q: [f32; 3], squared: &mut [f32]) {
    for (b, out) in squared.chunks_exact_mut(LANES).enumerate() {
        let (_, d2) = offsets(simd, axes, b, q);
        d2.store_slice(out);
    }
}

/// Offsets from `q` of a block of places, and their squares, as the tree rounds them.
#[inline(always)]
pub(crate) fn offsets<S: Simd>(
    simd: S,
    axes: [&[f32]; 3],
    block: usize,
    q: [f32; 3],
) -> ([f32x16<S>; 3], f32x16<S>) {
    let at = block * LANES..(block + 1) * LANES;
    let x = f32x16::from_slice(simd, &axes[0][at.clone()]) - q[0];
    let y = f32x16::from_slice(simd, &axes[1][at.clone()]) - q[1];
    let z = f32x16::from_slice(simd, &axes[2][at]) - q[2];
    ([x, y, z], (x * x + y * y) + z * z)
}
