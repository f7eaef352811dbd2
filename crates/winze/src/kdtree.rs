//! The one neighbour structure: an immutable bucket k-d tree over `f32` points.
//!
//! Built once, never changed, three plain arrays: 16-byte nodes in preorder, coordinates in leaf
//! order (one array an axis, so that leaf loops vectorise), and the original index of each. Median
//! splits by count on the widest axis, so that equal or grid-snapped points cannot unbalance it.
//!
//! # What is guaranteed
//! * Answers are exact: the same as brute force over the same `f32` arithmetic, since a branch's
//!   bound is computed with the operations, in the order, of a point's distance, and rounding is
//!   monotone.
//! * Equal distances are ordered by original index, so answers do not depend on the build.
//! * Radii are inclusive. Queries that are not finite have no neighbours.

use std::borrow::Cow;

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16, u32x16};
use rayon::prelude::*;

use crate::cancel;
use crate::columns::{Columns, Memory};
use crate::simd::{bits, level};

/// A neighbour of a query point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// Index of the point in the slice that the tree was built from.
    pub index: u32,
    /// Squared distance, m².
    pub distance_squared: f32,
}

/// Points a leaf holds at most.
const LEAF: usize = 16;
/// Subtrees below this size are built by one thread.
const PARALLEL: usize = 16_384;
/// No tree over 2³² points is deeper.
const MAX_DEPTH: usize = 40;

/// A node as plain numbers, so that a tree can be kept in a file.
///
/// `[split, axis, a, b]`. An inner node's left side is `<= split` (the bits of an `f32`) on `axis` (0, 1 or
/// 2), its right side `>= split`; its left child follows at once, its right one `a` nodes further on. A
/// leaf (axis 3) holds the points `a..b`.
pub type Node = [u32; 4];

const LEAF_MARK: u32 = 3;

/// An immutable k-d tree, see the [module documentation](self). Its arrays are its own, or lie in a
/// mapped file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KdTree<'a> {
    nodes: Cow<'a, [Node]>,
    /// Coordinates in leaf order, an array an axis.
    axes: [Cow<'a, [f32]>; 3],
    /// Original indices in leaf order; empty where they are 0, 1, 2, ...
    order: Cow<'a, [u32]>,
}

/// The columns of a tree that was just built.
pub struct TreeColumns<C: Columns> {
    /// Nodes in preorder.
    pub nodes: C::Column<Node>,
    /// Coordinates in leaf order, an array an axis.
    pub axes: [C::Column<f32>; 3],
    /// Original indices in leaf order.
    pub order: C::Column<u32>,
}

impl<C: Columns> TreeColumns<C> {
    /// The tree.
    #[must_use]
    pub fn view(&self) -> KdTree<'_> {
        KdTree {
            nodes: Cow::Borrowed(&self.nodes),
            axes: self.axes.each_ref().map(|a| Cow::Borrowed(&**a)),
            order: Cow::Borrowed(&self.order),
        }
    }
}

impl TreeColumns<Memory> {
    /// The tree, with arrays of its own.
    #[must_use]
    pub fn into_tree(self) -> KdTree<'static> {
        KdTree {
            nodes: Cow::Owned(self.nodes),
            axes: self.axes.map(Cow::Owned),
            order: Cow::Owned(self.order),
        }
    }
}

/// A point's coordinates as numbers that are ordered as they are, and its index.
type Item = [u32; 4];

/// The bits of a float so that whole numbers are ordered as [`f32::total_cmp`] orders floats.
fn ordered(v: f32) -> u32 {
    let bits = v.to_bits();
    let negative = bits >> 31 == 1;
    bits ^ if negative { u32::MAX } else { 1 << 31 }
}

/// The float of [`ordered`] bits.
fn unordered(bits: u32) -> f32 {
    let negative = bits >> 31 == 0;
    f32::from_bits(bits ^ if negative { u32::MAX } else { 1 << 31 })
}

/// Builds the tree over `points` in `columns`, on all threads of the current pool, as
/// [`KdTree::build`] does.
///
/// # Errors
/// Where a column cannot be had.
pub fn build_in<C: Columns>(points: &[[f32; 3]], columns: &C) -> Result<TreeColumns<C>, C::Error> {
    let finite = |p: &[f32; 3]| p.iter().all(|v| v.is_finite());
    let points = &points[..points.len().min(u32::MAX as usize)];
    let count = points.iter().filter(|p| finite(p)).count();
    let mut items = columns.zeros::<Item>(count)?;
    let usable = (0u32..).zip(points).filter(|(_, p)| finite(p));
    for (item, (index, p)) in items.iter_mut().zip(usable) {
        *item = [ordered(p[0]), ordered(p[1]), ordered(p[2]), index];
    }
    let nodes = if count == 0 { 0 } else { node_count(count) };
    let mut nodes = columns.zeros::<Node>(nodes)?;
    if count > 0 {
        split(&mut items, 0, &mut nodes);
    }
    let mut axes = [
        columns.zeros(count)?,
        columns.zeros(count)?,
        columns.zeros(count)?,
    ];
    for (a, axis) in axes.iter_mut().enumerate() {
        axis.par_iter_mut()
            .zip(items.par_iter())
            .for_each(|(v, i)| *v = unordered(i[a]));
    }
    let mut order = columns.zeros(count)?;
    order
        .par_iter_mut()
        .zip(items.par_iter())
        .for_each(|(o, i)| *o = i[3]);
    Ok(TreeColumns { nodes, axes, order })
}

impl KdTree<'static> {
    /// The tree over `points`, built on all threads of the current pool. Points that are not
    /// finite are left out. Indices are 32-bit: at most 2³² − 1 points (more are ignored).
    #[must_use]
    pub fn build(points: &[[f32; 3]]) -> Self {
        let Ok(tree) = build_in(points, &Memory);
        tree.into_tree()
    }
}

impl<'a> KdTree<'a> {
    /// A tree whose points are stored in its own leaf order, from the arrays of one that was built before.
    ///
    /// `None` where they are none: whatever they hold, the tree that comes back answers without
    /// panic and in bounded time, and rightly if its coordinates are those it was built from.
    #[must_use]
    pub fn from_parts(nodes: &'a [Node], axes: [&'a [f32]; 3]) -> Option<Self> {
        let count = axes[0].len();
        let sound = axes.iter().all(|a| a.len() == count)
            && u32::try_from(count).is_ok()
            && is_tree(nodes, count);
        sound.then(|| Self {
            nodes: Cow::Borrowed(nodes),
            axes: axes.map(Cow::Borrowed),
            order: Cow::Borrowed(&[]),
        })
    }

    /// Nodes in preorder, and coordinates in leaf order.
    #[must_use]
    pub fn parts(&self) -> (&[Node], [&[f32]; 3]) {
        (&self.nodes, self.axes.each_ref().map(|a| &**a))
    }

    /// Number of points in the tree.
    #[must_use]
    pub fn len(&self) -> usize {
        self.axes[0].len()
    }

    /// No points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.axes[0].is_empty()
    }

    /// The original index of the point at a place in leaf order.
    #[inline]
    pub(crate) fn name(&self, place: usize) -> u32 {
        if self.order.is_empty() {
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
            return place as u32;
        }
        self.order[place]
    }

    /// Original indices in leaf order: neighbours in space are near each other in this list, so
    /// points stored in this order are found in cache. Empty where they are 0, 1, 2, ...
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Renames point `order[i]` to `i`: for a caller that has put its points in that order.
    #[must_use]
    pub(crate) fn with_points_in_leaf_order(mut self) -> Self {
        self.order = Cow::Borrowed(&[]);
        self
    }

    /// The nearest point to `query`.
    #[must_use]
    pub fn nearest(&self, query: [f32; 3]) -> Option<Neighbour> {
        self.nearest_within(query, f32::INFINITY)
    }

    /// The nearest point to `query` that is no further than `radius` (metres).
    #[must_use]
    pub fn nearest_within(&self, query: [f32; 3], radius: f32) -> Option<Neighbour> {
        let mut best = Neighbour {
            index: u32::MAX,
            distance_squared: radius * radius,
        };
        self.visit(query, best.distance_squared, |start, distances, within| {
            for i in bits(within) {
                let d = distances[i];
                if d <= best.distance_squared {
                    let index = self.name(start + i);
                    if d < best.distance_squared || index < best.index {
                        best = Neighbour {
                            index,
                            distance_squared: d,
                        };
                    }
                }
            }
            best.distance_squared
        });
        (best.index != u32::MAX && best.distance_squared.is_finite()).then_some(best)
    }

    /// The nearest point to `query` that does not lie at `query` itself.
    #[must_use]
    pub fn nearest_other(&self, query: [f32; 3]) -> Option<Neighbour> {
        let mut best = Neighbour {
            index: u32::MAX,
            distance_squared: f32::INFINITY,
        };
        self.visit(query, f32::INFINITY, |start, distances, within| {
            for i in bits(within) {
                let d = distances[i];
                let index = self.name(start + i);
                if d > 0.0
                    && (d < best.distance_squared
                        || (d == best.distance_squared && index < best.index))
                {
                    best = Neighbour {
                        index,
                        distance_squared: d,
                    };
                }
            }
            best.distance_squared
        });
        best.distance_squared.is_finite().then_some(best)
    }

    /// The `k` nearest points to `query` no further than `radius`, nearest first, into `found`
    /// (cleared first).
    pub fn knn(&self, query: [f32; 3], k: usize, radius: f32, found: &mut Vec<Neighbour>) {
        found.clear();
        if k == 0 {
            return;
        }
        let limit = radius * radius;
        self.visit(query, limit, |start, distances, within| {
            let mut worst = if found.len() == k {
                found[k - 1].distance_squared
            } else {
                limit
            };
            for i in bits(within) {
                let d = distances[i];
                if d <= worst {
                    let new = Neighbour {
                        index: self.name(start + i),
                        distance_squared: d,
                    };
                    if found.len() == k {
                        if !closer(&new, &found[k - 1]) {
                            continue;
                        }
                        found.pop();
                    }
                    // Insertion from the far end: most newcomers belong there.
                    let mut at = found.len();
                    while at > 0 && closer(&new, &found[at - 1]) {
                        at -= 1;
                    }
                    found.insert(at, new);
                    if found.len() == k {
                        worst = found[k - 1].distance_squared;
                    }
                }
            }
            worst
        });
        found.retain(|n| n.distance_squared.is_finite());
    }

    /// The three points nearest to `query` no further than `radius`, nearest first. Where there are fewer, [`NOWHERE`] stands for the rest.
    pub(crate) fn three_nearest(&self, query: [f32; 3], radius: f32) -> [Neighbour; 3] {
        let limit = radius * radius;
        let mut best = [NOWHERE; 3];
        self.visit(query, limit, |start, distances, within| {
            for i in bits(within) {
                let new = Neighbour {
                    index: self.name(start + i),
                    distance_squared: distances[i],
                };
                let [first, second, third] = best;
                if closer(&new, &first) {
                    best = [new, first, second];
                } else if closer(&new, &second) {
                    best = [first, new, second];
                } else if closer(&new, &third) {
                    best = [first, second, new];
                }
            }
            best[2].distance_squared.min(limit)
        });
        best
    }

    /// Calls `each(index, distance_squared)` for every point within `radius` of `query`, in leaf
    /// order.
    pub fn within(&self, query: [f32; 3], radius: f32, mut each: impl FnMut(u32, f32)) {
        let limit = radius * radius;
        self.visit(query, limit, |start, distances, within| {
            for i in bits(within) {
                if distances[i].is_finite() {
                    each(self.name(start + i), distances[i]);
                }
            }
            limit
        });
    }

    /// Calls `each` with the places of the points of every leaf that can hold points within `√limit` of the box
    /// from `low` to `high`, in order, while it says `true`.
    pub(crate) fn leaves_near(
        &self,
        low: [f32; 3],
        high: [f32; 3],
        limit: f32,
        mut each: impl FnMut(std::ops::Range<usize>) -> bool,
    ) {
        let finite = |v: &[f32; 3]| v.iter().all(|c| c.is_finite());
        if self.nodes.is_empty() || !finite(&low) || !finite(&high) {
            return;
        }
        let nodes: &[Node] = &self.nodes;
        // (node, distance of the box to its region along each axis)
        let mut stack = [(0u32, [0.0f32; 3]); MAX_DEPTH];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (mut at, mut cut) = stack[top];
            while squared(cut) <= limit {
                let [split, axis, a, b] = nodes[at as usize];
                if axis == LEAF_MARK {
                    if !each(a as usize..b as usize) {
                        return;
                    }
                    break;
                }
                let (axis, split) = (axis as usize, f32::from_bits(split));
                // To the right side by as much as the box ends before the split, to the left by as much as it
                // begins behind it.
                let right = with(cut, axis, |c| c.max(split - high[axis]));
                if top < MAX_DEPTH {
                    stack[top] = (at + a, right);
                    top += 1;
                }
                cut = with(cut, axis, |c| c.max(low[axis] - split));
                at += 1;
            }
        }
    }

    /// Walks the leaves that can hold points within `√limit`, near side first. `leaf` gets the first position, the squared
    /// distances of its points, and a bit for each of those within the limit; it answers the new limit.
    fn visit(&self, q: [f32; 3], limit: f32, leaf: impl FnMut(usize, &[f32; LEAF], u64) -> f32) {
        if self.nodes.is_empty() || !q.iter().all(|v| v.is_finite()) {
            return;
        }
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || self.walk(simd, q, limit, leaf)
        ));
    }

    #[inline(always)]
    fn walk<S: Simd>(
        &self,
        simd: S,
        q: [f32; 3],
        mut limit: f32,
        mut leaf: impl FnMut(usize, &[f32; LEAF], u64) -> f32,
    ) {
        let nodes: &[Node] = &self.nodes;
        let [xs, ys, zs]: [&[f32]; 3] = self.axes.each_ref().map(|a| &**a);
        // (node, distance to its region along each axis)
        let mut stack = [(0u32, [0.0f32; 3]); MAX_DEPTH];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (mut at, cut) = stack[top];
            if squared(cut) > limit {
                continue;
            }
            loop {
                let [split, axis, a, b] = nodes[at as usize];
                if axis == LEAF_MARK {
                    let (start, count) = (a as usize, (b - a) as usize);
                    let x = lanes(simd, xs, start, count) - q[0];
                    let y = lanes(simd, ys, start, count) - q[1];
                    let z = lanes(simd, zs, start, count) - q[2];
                    let d2 = (x * x + y * y) + z * z;
                    let within = d2.simd_le(f32x16::splat(simd, limit)).to_bitmask();
                    // What lies behind the leaf was looked at too.
                    let within = within & ((1 << count) - 1);
                    if within != 0 {
                        limit = leaf(start, &d2.into(), within);
                    }
                    break;
                }
                let axis = axis as usize;
                let offset = f32::from_bits(split) - q[axis];
                let (near, far) = if offset >= 0.0 {
                    (at + 1, at + a)
                } else {
                    (at + a, at + 1)
                };
                let far_cut = with(cut, axis, |_| offset);
                // Never deeper than the tree: one far child waits a level.
                if squared(far_cut) <= limit && top < MAX_DEPTH {
                    stack[top] = (far, far_cut);
                    top += 1;
                }
                at = near;
            }
        }
    }
}

/// The `count` coordinates from `start`, and some others behind them.
#[inline(always)]
fn lanes<S: Simd>(simd: S, axis: &[f32], start: usize, count: usize) -> f32x16<S> {
    if let Some(whole) = axis.get(start..start + LEAF) {
        return f32x16::from_slice(simd, whole);
    }
    let mut padded = [0.0; LEAF];
    padded[..count].copy_from_slice(&axis[start..start + count]);
    f32x16::from_slice(simd, &padded)
}

/// `cut` changed along one axis, without a detour through memory, which a store at a variable place would be.
#[inline(always)]
fn with(cut: [f32; 3], axis: usize, change: impl Fn(f32) -> f32) -> [f32; 3] {
    std::array::from_fn(|a| if a == axis { change(cut[a]) } else { cut[a] })
}

/// The order of operations matters: branch bounds and point distances must round alike.
#[inline]
pub(crate) fn squared(d: [f32; 3]) -> f32 {
    (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
}

/// No point.
pub(crate) const NOWHERE: Neighbour = Neighbour {
    index: u32::MAX,
    distance_squared: f32::INFINITY,
};

#[inline]
fn closer(a: &Neighbour, b: &Neighbour) -> bool {
    a.distance_squared < b.distance_squared
        || (a.distance_squared == b.distance_squared && a.index < b.index)
}

/// Nodes of the tree over `count` points (more than 0).
fn node_count(count: usize) -> usize {
    /// Of `n` and of `n + 1` points: halves never differ by more than one.
    fn of(n: usize) -> (usize, usize) {
        if n < LEAF {
            return (1, 1);
        }
        let (half, more) = of(n / 2);
        let even = n.is_multiple_of(2);
        let this = match n {
            LEAF => 1,
            _ if even => 1 + 2 * half,
            _ => 1 + half + more,
        };
        (this, if even { 1 + half + more } else { 1 + 2 * more })
    }
    of(count).0
}

/// Sorts `items`, which begin at place `start`, into leaf order and fills `nodes`.
fn split(items: &mut [Item], start: usize, nodes: &mut [Node]) {
    let Some((node, nodes)) = nodes.split_first_mut() else {
        return;
    };
    #[expect(clippy::cast_possible_truncation, reason = "at most 2^32 - 1 points")]
    if items.len() <= LEAF {
        *node = [0, LEAF_MARK, start as u32, (start + items.len()) as u32];
        return;
    }
    let axis = widest_axis(items);
    let middle = items.len() / 2;
    // By coordinate, then by index, as one number.
    let key = |item: &Item| u64::from(item[axis]) << 32 | u64::from(item[3]);
    let (_, pivot, _) = items.select_nth_unstable_by(middle, |a, b| key(a).cmp(&key(b)));
    let at = unordered(pivot[axis]).to_bits();
    let (left, right) = items.split_at_mut(middle);
    let (left_nodes, right_nodes) = nodes.split_at_mut(node_count(middle));
    #[expect(clippy::cast_possible_truncation, reason = "fewer nodes than points")]
    let skip = left_nodes.len() as u32 + 1;
    #[expect(clippy::cast_possible_truncation, reason = "0, 1 or 2")]
    let axis = axis as u32;
    *node = [at, axis, skip, 0];
    if left.len() > PARALLEL {
        cancel::check();
        rayon::join(
            || split(left, start, left_nodes),
            || split(right, start + middle, right_nodes),
        );
    } else {
        split(left, start, left_nodes);
        split(right, start + middle, right_nodes);
    }
}

/// Whether `nodes` are a tree over `count` points, each in one leaf, no deeper than a search can follow.
fn is_tree(nodes: &[Node], count: usize) -> bool {
    if nodes.is_empty() || count == 0 {
        return nodes.is_empty() && count == 0;
    }
    // In preorder leaves follow each other, and a right child begins where its left sibling ends. These
    // wait, with their depths.
    let mut waiting = [(0usize, 0usize); MAX_DEPTH];
    let mut top = 0;
    let (mut at, mut depth, mut placed) = (0usize, 0usize, 0usize);
    while let Some(&[split, axis, a, b]) = nodes.get(at) {
        at += 1;
        if axis == LEAF_MARK {
            let (a, b) = (a as usize, b as usize);
            if a != placed || b < a || b - a > LEAF {
                return false;
            }
            placed = b;
            if top == 0 {
                return at == nodes.len() && placed == count;
            }
            top -= 1;
            let (right, its_depth) = waiting[top];
            if right != at {
                return false;
            }
            depth = its_depth;
        } else {
            depth += 1;
            let sound = axis < LEAF_MARK && f32::from_bits(split).is_finite() && depth < MAX_DEPTH;
            if !sound || a < 2 {
                return false;
            }
            waiting[top] = (at - 1 + a as usize, depth);
            top += 1;
        }
    }
    false
}

/// The axis along which the items reach furthest.
fn widest_axis(items: &[Item]) -> usize {
    let (low, high) = dispatch!(level(), simd => simd.vectorize(
        #[inline(always)]
        || bounds(simd, items)
    ));
    let width = |axis: usize| unordered(high[axis]) - unordered(low[axis]);
    let mut axis = 0;
    for a in 1..3 {
        if width(a) > width(axis) {
            axis = a;
        }
    }
    axis
}

/// The least and the most of each number of the items, four items at a time.
#[inline(always)]
fn bounds<S: Simd>(simd: S, items: &[Item]) -> (Item, Item) {
    let (mut low, mut high) = (u32x16::splat(simd, u32::MAX), u32x16::splat(simd, u32::MIN));
    let (fours, rest) = items.as_flattened().as_chunks::<16>();
    for four in fours {
        let four = u32x16::from_slice(simd, four);
        low = low.min(four);
        high = high.max(four);
    }
    let (low, high): ([u32; 16], [u32; 16]) = (low.into(), high.into());
    let mut bounds = ([u32::MAX; 4], [u32::MIN; 4]);
    for (k, (low, high)) in low.iter().zip(&high).enumerate() {
        bounds.0[k % 4] = bounds.0[k % 4].min(*low);
        bounds.1[k % 4] = bounds.1[k % 4].max(*high);
    }
    for (k, v) in rest.iter().enumerate() {
        bounds.0[k % 4] = bounds.0[k % 4].min(*v);
        bounds.1[k % 4] = bounds.1[k % 4].max(*v);
    }
    bounds
}

#[cfg(test)]
mod tests;
