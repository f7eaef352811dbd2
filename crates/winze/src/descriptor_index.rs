//! The nearest descriptors among a million: an exact index that is nothing but plain arrays.
//!
//! Descriptors are seen along the principal axes of their own scatter. The first few axes hold
//! most of a distance, and what they leave out is summed up in one more coordinate, the length of the
//! rest. By the triangle inequality two descriptors are never nearer than their coordinates are, so
//! a tree of boxes over the coordinates dismisses nearly all descriptors, and only the few left are
//! compared in full.
//!
//! # Layout
//! Sixteen descriptors a leaf, all leaves full but the last. A node over `c` leaves gives its left
//! child the first `c / 2`, and inner nodes lie in preorder: the left child of node `i` is `i + 1`,
//! the right one `i + c / 2`. There are no pointers, so that no file can hold wrong ones.
//!
//! # What is guaranteed
//! * Answers are those of brute force, bit for bit, over squared distances summed in `f32`
//!   dimension after dimension. Equal distances are ordered by index.
//! * Descriptors that are all zero, or not finite, are near nothing.
//! * The index has the same bits at any number of threads and on any processor.

use std::borrow::Cow;

use crate::columns::{Columns, Memory};
use crate::fpfh::{DIMENSIONS, Descriptor};

mod build;
mod frame;
#[cfg(test)]
mod tests;

pub use build::build;
use frame::project;

/// Coordinates of a descriptor in the index: principal axes, and the length of the rest.
/// Of 8, 12 and 16, twelve answered fastest among a million; eight do nearly as well.
pub const COORDINATES: usize = 12;
/// Descriptors of a leaf.
pub const LANES: usize = 16;

/// Boxes around the two children of a node: low and high corner of the left, then of the right.
pub type Node = [[f32; COORDINATES]; 4];
/// Coordinates of a leaf's descriptors, a row a coordinate. Lanes to spare hold infinity.
pub type Block = [[f32; LANES]; COORDINATES];
/// Indices of a leaf's descriptors. Lanes to spare hold `u32::MAX`.
pub type Order = [u32; LANES];

/// 2³² indices at sixteen a leaf.
const MAX_LEAVES: usize = 1 << 28;
/// Halving so many leaves ends after 28 levels, and one node waits a level.
const MAX_DEPTH: usize = 32;

/// An exact index over descriptors, see the [module documentation](self). It holds no descriptors:
/// queries bring the slice that it was built from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DescriptorIndex<'a> {
    frame: Cow<'a, [Descriptor]>,
    nodes: Cow<'a, [Node]>,
    blocks: Cow<'a, [Block]>,
    order: Cow<'a, [Order]>,
}

/// An index whose long arrays lie where `C` put them.
pub struct IndexColumns<C: Columns> {
    frame: Vec<Descriptor>,
    nodes: C::Column<Node>,
    blocks: C::Column<Block>,
    order: C::Column<Order>,
}

impl<C: Columns> IndexColumns<C> {
    /// The index, borrowed.
    #[must_use]
    pub fn view(&self) -> DescriptorIndex<'_> {
        DescriptorIndex {
            frame: Cow::Borrowed(&self.frame),
            nodes: Cow::Borrowed(&self.nodes),
            blocks: Cow::Borrowed(&self.blocks),
            order: Cow::Borrowed(&self.order),
        }
    }
}

impl IndexColumns<Memory> {
    /// The index, owned.
    #[must_use]
    pub fn into_index(self) -> DescriptorIndex<'static> {
        DescriptorIndex {
            frame: Cow::Owned(self.frame),
            nodes: Cow::Owned(self.nodes),
            blocks: Cow::Owned(self.blocks),
            order: Cow::Owned(self.order),
        }
    }
}

impl<'a> DescriptorIndex<'a> {
    /// An index of parts that were kept, for `descriptors` descriptors. `None` where the parts do not
    /// belong together; whatever else they hold, queries then end without a panic, though only the
    /// parts of an index built from the same descriptors give the right answers.
    #[must_use]
    pub fn from_parts(
        frame: Cow<'a, [Descriptor]>,
        nodes: Cow<'a, [Node]>,
        blocks: Cow<'a, [Block]>,
        order: Cow<'a, [Order]>,
        descriptors: usize,
    ) -> Option<Self> {
        let leaves = order.len();
        let shape = frame.len() == COORDINATES
            && leaves <= MAX_LEAVES
            && blocks.len() == leaves
            && nodes.len() == leaves.saturating_sub(1);
        // All lanes are in use, up to the last leaf's spare ones.
        let full = |i: u32| i != u32::MAX && (i as usize) < descriptors;
        let indices = || match order.split_last() {
            None => true,
            Some((last, before)) => {
                let used = last.partition_point(|i| *i != u32::MAX);
                used > 0
                    && before
                        .iter()
                        .flatten()
                        .chain(&last[..used])
                        .all(|i| full(*i))
                    && last[used..].iter().all(|i| *i == u32::MAX)
            }
        };
        (shape && indices()).then_some(Self {
            frame,
            nodes,
            blocks,
            order,
        })
    }

    /// The centre of the descriptors, then the principal axes, widest first: [`COORDINATES`] rows.
    #[must_use]
    pub fn frame(&self) -> &[Descriptor] {
        &self.frame
    }

    /// Inner nodes in preorder, one less than leaves.
    #[must_use]
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Coordinates, one block a leaf.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// Descriptor indices, sixteen a leaf.
    #[must_use]
    pub fn order(&self) -> &[Order] {
        &self.order
    }

    /// The `k` descriptors nearest to `query`, as (squared distance, index), nearest first and equal
    /// ones by index, into `found` (cleared first). `descriptors` is what the index was built from.
    /// Distances that overflow are none.
    pub fn nearest(
        &self,
        descriptors: &[Descriptor],
        query: &Descriptor,
        k: usize,
        found: &mut Vec<(f32, u32)>,
    ) {
        self.nearest_within(descriptors, query, k, f32::INFINITY, found);
    }

    /// [`nearest`](Self::nearest), of those whose squared distance is not above `limit`.
    pub fn nearest_within(
        &self,
        descriptors: &[Descriptor],
        query: &Descriptor,
        k: usize,
        limit: f32,
        found: &mut Vec<(f32, u32)>,
    ) {
        found.clear();
        if k == 0 || self.order.is_empty() || !is_usable(query) {
            return;
        }
        let (at, reach) = project(&self.frame, query);
        let mut bound = bound(limit, reach);
        // (distance of the box, node, first leaf, leaves)
        let mut stack = [(0.0f32, 0usize, 0usize, 0usize); MAX_DEPTH];
        stack[0].3 = self.order.len();
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (mut distance, mut node, mut first, mut leaves) = stack[top];
            // `>`, here and below: at the bound a lower index can still win.
            while leaves > 1 && !(distance > bound) {
                let half = leaves / 2;
                let [low, high, right_low, right_high] = &self.nodes[node];
                let left = (box_distance(&at, low, high), node + 1, first, half);
                let right = (
                    box_distance(&at, right_low, right_high),
                    node + half,
                    first + half,
                    leaves - half,
                );
                let (near, far) = if right.0 < left.0 {
                    (right, left)
                } else {
                    (left, right)
                };
                stack[top] = far;
                top += 1;
                (distance, node, first, leaves) = near;
            }
            if distance > bound {
                continue;
            }
            let lower = lane_distances(&at, &self.blocks[first]);
            for (lower, &index) in lower.iter().zip(&self.order[first]) {
                if *lower > bound {
                    continue;
                }
                let Some(row) = descriptors.get(index as usize) else {
                    continue;
                };
                let new = (squared_distance(query, row), index);
                if new.0 <= limit && new.0 < f32::INFINITY && offer(found, k, new) {
                    bound = self::bound(found[k - 1].0, reach);
                }
            }
        }
    }
}

/// Whether a descriptor can be near anything: not all zero, and finite.
fn is_usable(d: &Descriptor) -> bool {
    d.iter().any(|v| *v != 0.0) && d.iter().all(|v| v.is_finite())
}

/// The squared distance, summed over the dimensions in order.
#[inline]
fn squared_distance(query: &Descriptor, row: &Descriptor) -> f32 {
    let mut sum = 0.0;
    for d in 0..DIMENSIONS {
        let d = row[d] - query[d];
        sum += d * d;
    }
    sum
}

/// Puts `new` into the list of at most `k`. Whether the list is full and its last has changed.
#[inline]
fn offer(found: &mut Vec<(f32, u32)>, k: usize, new: (f32, u32)) -> bool {
    let before = |a: (f32, u32), b: (f32, u32)| a.0 < b.0 || (a.0 == b.0 && a.1 < b.1);
    if found.len() == k {
        match found.last() {
            Some(last) if before(new, *last) => found.pop(),
            _ => return false,
        };
    }
    let mut at = found.len();
    while at > 0 && before(new, found[at - 1]) {
        at -= 1;
    }
    found.insert(at, new);
    found.len() == k
}

/// Squared distance of coordinates above which no descriptor is within `limit` (squared) of a query
/// that lies `reach` from the centre.
///
/// Exact coordinates would need no margin. In the way are, relative to the distance: the axes'
/// rounding to `f32` (their directions err by 2·10⁻⁷ in all), and the rounding of both sums (33 and
/// 12 terms, 2·10⁻⁶ of a square): 10⁻⁵ covers them several times. And relative to the
/// coordinates: theirs to `f32`, 6·10⁻⁸ of the length of each of the two, in each of 12 places, below
/// 5·10⁻⁷ of the longer. A descriptor within the limit lies no further out than `reach` plus the
/// distance, so that 10⁻⁶ of this covers them. The last term stands for squares that underflow.
fn bound(limit: f32, reach: f32) -> f32 {
    let distance = limit.sqrt();
    let margin = 1e-5 * distance + 1e-6 * (reach + distance) + 1e-18;
    let radius = distance + margin;
    radius * radius
}

/// Squared distance of coordinates from a box. NaN counts as inside.
#[inline]
fn box_distance(
    at: &[f32; COORDINATES],
    low: &[f32; COORDINATES],
    high: &[f32; COORDINATES],
) -> f32 {
    // Four sums side by side; the order is free, as only a bound comes of it.
    let mut sums = [0.0f32; 4];
    for c in 0..COORDINATES {
        let (below, above) = (low[c] - at[c], at[c] - high[c]);
        let outside = if below > above { below } else { above };
        let outside = if outside > 0.0 { outside } else { 0.0 };
        sums[c % 4] += outside * outside;
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

/// Squared distances of coordinates from those of a leaf.
#[inline]
fn lane_distances(at: &[f32; COORDINATES], block: &Block) -> [f32; LANES] {
    let mut sums = [0.0f32; LANES];
    for (x, row) in at.iter().zip(block) {
        for l in 0..LANES {
            let d = row[l] - x;
            sums[l] += d * d;
        }
    }
    sums
}
