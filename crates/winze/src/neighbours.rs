//! Neighbours of many points at once.
//!
//! Points that follow each other in memory are near each other, so they share most of what a search from the
//! root would find: a tree is walked once for a group of them, and each then picks its own from what was found.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x16};

use crate::eigen3::Symmetric3;
use crate::kdtree::{KdTree, Neighbour};

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

/// Sums over neighbours of a point, of their offsets from it and of these offsets' products.
///
/// Each is summed in [`LANES`] lanes, a neighbour in that of its place among all that the group has gathered, and the lanes
/// are then added in pairs: an order that hangs on points and tree alone.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Moments {
    /// How many neighbours there are, the point itself among them.
    pub(crate) count: u32,
    /// x, y, z.
    pub(crate) sum: [f64; 3],
    /// xx, xy, xz, yy, yz, zz.
    pub(crate) square: [f64; 6],
}

impl Moments {
    /// Over neighbours of `q` that were looked up, one after the other in 64 bits: they may be anywhere.
    pub(crate) fn of(points: &[[f32; 3]], q: [f32; 3], neighbours: &[Neighbour]) -> Self {
        let mut out = Self::default();
        for n in neighbours {
            let p = points[n.index as usize];
            let [x, y, z]: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - f64::from(q[a]));
            out.count += 1;
            let products = [x * x, x * y, x * z, y * y, y * z, z * z];
            out.sum.iter_mut().zip([x, y, z]).for_each(|(s, v)| *s += v);
            out.square
                .iter_mut()
                .zip(products)
                .for_each(|(s, v)| *s += v);
        }
        out
    }

    /// Covariance (divided by the count) about the neighbourhood's own mean. Offsets are from one of its points: raw
    /// coordinates squared would lose all their digits.
    pub(crate) fn covariance(&self) -> Symmetric3 {
        let inverse = 1.0 / f64::from(self.count.max(1));
        let [x, y, z] = self.sum.map(|v| v * inverse);
        let means = [x * x, x * y, x * z, y * y, y * z, z * z];
        std::array::from_fn(|e| self.square[e] * inverse - means[e])
    }

    /// Second moment (divided by the count) about the point itself.
    pub(crate) fn scatter(&self) -> Symmetric3 {
        let inverse = 1.0 / f64::from(self.count.max(1));
        self.square.map(|v| v * inverse)
    }
}

/// See [`Neighbours::room`].
type Room<'a> = ([&'a [f32]; 3], &'a mut [f32], &'a mut [u32], f32);

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
        dispatch!(Level::new(), simd => simd.vectorize(
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
        dispatch!(Level::new(), simd => simd.vectorize(
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
        dispatch!(Level::new(), simd => simd.vectorize(
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
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let (kept, within) = near_blocks(simd, axes, q, limit, squared, blocks);
                let squared = &squared[..kept * LANES];
                let limit = threshold(simd, squared, (limit, within), count, guess)?;
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
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || {
                let (kept, within) = near_blocks(simd, axes, q, limit, squared, blocks);
                let squared = &squared[..kept * LANES];
                let limit = threshold(simd, squared, (limit, within), count, guess)?;
                Some((root_sum(simd, squared, limit), limit))
            }
        ))
    }
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

/// Blocks that are summed in 32 bits before they go to a sum in 64, which any number of neighbours fits.
const BLOCKS: u32 = 64;

/// What becomes [`Moments`], in lanes.
struct Sums<S: Simd> {
    /// Of the blocks before the last few.
    earlier: Moments,
    /// Blocks that are in the lanes.
    blocks: u32,
    count: u32,
    sum: [f32x16<S>; 3],
    square: [f32x16<S>; 6],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    fn zero(simd: S) -> Self {
        let zero = f32x16::splat(simd, 0.0);
        Self {
            earlier: Moments::default(),
            blocks: 0,
            count: 0,
            sum: [zero; 3],
            square: [zero; 6],
        }
    }

    /// Adds what of a block of places lies no further than `√limit` from `q`.
    #[inline(always)]
    fn add(&mut self, simd: S, axes: [&[f32]; 3], block: usize, q: [f32; 3], limit: f32) {
        let ([x, y, z], d2) = offsets(simd, axes, block, q);
        let within = d2.simd_le(f32x16::splat(simd, limit));
        let bits = within.to_bitmask();
        if bits == 0 {
            return;
        }
        let zero = f32x16::splat(simd, 0.0);
        let x = within.select(x, zero);
        let y = within.select(y, zero);
        let z = within.select(z, zero);
        self.count += bits.count_ones();
        self.sum[0] += x;
        self.sum[1] += y;
        self.sum[2] += z;
        self.square[0] += x * x;
        self.square[1] += x * y;
        self.square[2] += x * z;
        self.square[3] += y * y;
        self.square[4] += y * z;
        self.square[5] += z * z;
        self.blocks += 1;
        if self.blocks == BLOCKS {
            *self = Self {
                earlier: self.total(),
                ..Self::zero(simd)
            };
        }
    }

    #[inline(always)]
    fn total(&self) -> Moments {
        let (before, sum, square) = (&self.earlier, self.sum, self.square);
        Moments {
            count: before.count + self.count,
            sum: [
                before.sum[0] + total(sum[0]),
                before.sum[1] + total(sum[1]),
                before.sum[2] + total(sum[2]),
            ],
            square: [
                before.square[0] + total(square[0]),
                before.square[1] + total(square[1]),
                before.square[2] + total(square[2]),
                before.square[3] + total(square[3]),
                before.square[4] + total(square[4]),
                before.square[5] + total(square[5]),
            ],
        }
    }
}

/// The sum of a vector's lanes, in pairs, for sums in 64 bits.
#[inline(always)]
fn total<S: Simd>(v: f32x16<S>) -> f64 {
    f64::from(lanes_in_pairs(v))
}

/// The sum of a vector's lanes, in pairs.
#[inline(always)]
fn lanes_in_pairs<S: Simd>(v: f32x16<S>) -> f32 {
    let mut v: [f32; LANES] = v.into();
    let mut width = LANES / 2;
    while width > 0 {
        for k in 0..width {
            v[k] += v[k + width];
        }
        width /= 2;
    }
    v[0]
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
fn threshold<S: Simd>(
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_world::{drift, surface};

    #[test]
    fn a_group_finds_what_each_of_its_points_would() {
        let s = surface(&drift(20_000, 12.0, 0.3, 0.0, 1), 0.2);
        let mut near = Neighbours::default();
        for radius in [0.05, 0.5, 1.3] {
            // Neighbours in memory, then points from all over the place.
            for step in [1, 97] {
                let group: Vec<[f32; 3]> = s
                    .points
                    .iter()
                    .skip(500)
                    .step_by(step)
                    .take(GROUP)
                    .copied()
                    .collect();
                let mut left = 0..group.len();
                while !left.is_empty() {
                    let together = near.gather(&s.tree, radius, left.clone(), |k| group[k]);
                    left.start = together.end;
                    for p in &group[together] {
                        let mut expected = Vec::new();
                        s.tree.within(*p, radius, |index, distance_squared| {
                            expected.push(Neighbour {
                                index,
                                distance_squared,
                            });
                        });
                        expected.sort_unstable_by_key(|n| n.index);
                        assert_eq!(near.of(&s.tree, *p), expected);
                    }
                }
            }
        }
    }

    #[test]
    fn the_nearest_of_a_group_are_those_of_the_tree() {
        let s = surface(&drift(20_000, 12.0, 0.3, 0.0, 1), 0.2);
        let mut near = Neighbours::default();
        let mut expected = Vec::new();
        // Neighbours in memory, then points from all over the place, then a few of one place.
        let neighbours = s.points.chunks(GROUP).step_by(40).map(<[_]>::to_vec);
        let scattered: Vec<[f32; 3]> = s.points.iter().step_by(97).copied().collect();
        let same = vec![s.points[7]; 3];
        for group in neighbours.chain([scattered, same]) {
            let together = near.gather(&s.tree, 0.6, 0..group.len(), |k| group[k]);
            for p in &group[together] {
                for count in [1, 9, 20] {
                    s.tree.knn(*p, count, f32::INFINITY, &mut expected);
                    expected.retain(|n| n.distance_squared <= 0.6 * 0.6);
                    let found = near.distance_sum_of_nearest(*p, count, 0.1);
                    let moments = near.moments_of_nearest(*p, count, 0.1);
                    if found.is_none() || moments.is_none() {
                        assert!(expected.len() < count && found.is_none() && moments.is_none());
                        continue;
                    }
                    let sum: f64 = expected
                        .iter()
                        .map(|n| f64::from(n.distance_squared).sqrt())
                        .sum();
                    let (found, limit) = found.unwrap();
                    assert!((found - sum).abs() <= 1e-6 * sum);
                    assert!(expected.iter().all(|n| n.distance_squared <= limit));
                    check(&moments.unwrap().0, &s.points, *p, &expected);
                }
                let expected: Vec<Neighbour> = near.of(&s.tree, *p).to_vec();
                let out = |n: &Neighbour| {
                    let q = s.points[n.index as usize];
                    f64::from(0.6 * (q[0] - p[0]) + 0.8 * (q[2] - p[2])).clamp(-0.2, 0.2)
                };
                let balance: f64 = expected.iter().map(out).sum();
                let found = f64::from(near.balance(*p, [0.6, 0.0, 0.8], 0.2));
                assert!((found - balance).abs() < 1e-5 * (1.0 + expected.len() as f64));
                check(&near.moments_within(*p), &s.points, *p, &expected);
            }
        }
        let first = s.points[0];
        assert!(near.distance_sum_of_nearest(first, 0, 0.1).is_none());
        near.gather_up_to(100, &s.tree, 1e3, 0..1, |_| first);
        assert!(near.distance_sum_of_nearest(first, 9, 0.1).is_none());
        assert!(near.places.len() <= 100);
        near.gather(&s.tree, 1e3, 0..1, |_| first);
        assert!(near.distance_sum_of_nearest(first, 9, 0.1).is_some());
    }

    /// Against sums in 64 bits.
    fn check(moments: &Moments, points: &[[f32; 3]], p: [f32; 3], neighbours: &[Neighbour]) {
        assert_eq!(moments.count as usize, neighbours.len());
        let (mut sum, mut square) = ([0.0f64; 3], [0.0f64; 6]);
        for n in neighbours {
            let q = points[n.index as usize];
            let d: [f64; 3] = std::array::from_fn(|a| f64::from(q[a] - p[a]));
            let products = [
                d[0] * d[0],
                d[0] * d[1],
                d[0] * d[2],
                d[1] * d[1],
                d[1] * d[2],
                d[2] * d[2],
            ];
            sum.iter_mut().zip(d).for_each(|(s, d)| *s += d);
            square.iter_mut().zip(products).for_each(|(s, d)| *s += d);
        }
        let scale = 1e-6 * (1.0 + square[0] + square[3] + square[5]);
        for (a, b) in moments.sum.iter().zip(sum) {
            assert!((a - b).abs() < 10.0 * scale, "{a} {b}");
        }
        for (a, b) in moments.square.iter().zip(square) {
            assert!((a - b).abs() < scale, "{a} {b}");
        }
    }

    #[test]
    fn numbers_that_occur_twice_have_no_threshold_between_them() {
        let squared: Vec<f32> = (0..64).map(|i| (i / 4) as f32).collect();
        for count in 1..=64 {
            let found =
                dispatch!(Level::new(), simd => threshold(simd, &squared, (20.0, 64), count, 9.0));
            match found {
                Some(limit) => {
                    let within = squared.iter().filter(|d| **d <= limit).count();
                    assert_eq!(within, count);
                }
                None => assert_ne!(count % 4, 0),
            }
        }
    }

    #[test]
    fn an_empty_tree_has_no_neighbours() {
        let tree = KdTree::build(&[]);
        let mut near = Neighbours::default();
        near.gather(&tree, 1.0, 0..1, |_| [0.0; 3]);
        assert!(near.of(&tree, [0.0; 3]).is_empty());
    }
}
