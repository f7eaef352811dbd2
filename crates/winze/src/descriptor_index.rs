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
use crate::simd;

mod build;
mod frame;
#[cfg(test)]
mod tests;

pub use build::build;
use frame::GROUP;

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

/// A descriptor as an index sees it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Seen {
    at: [f32; COORDINATES],
    /// Distance from the centre.
    reach: f32,
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
        let [seen, ..] = frame::project(&self.frame, [query; GROUP]);
        self.nearest_seen(descriptors, (query, &seen), k, limit, found);
    }

    /// How this index sees descriptors, its own or others.
    pub(crate) fn see(&self, descriptors: &[Descriptor]) -> Vec<Seen> {
        build::see_all(&self.frame, descriptors)
    }

    /// An index over other descriptors, which this one has seen.
    pub(crate) fn over_seen(
        &self,
        descriptors: &[Descriptor],
        seen: &[Seen],
    ) -> IndexColumns<Memory> {
        build::build_seen(&self.frame, descriptors, seen)
    }

    /// [`nearest_within`](Self::nearest_within) of a query that this index has seen.
    pub(crate) fn nearest_seen(
        &self,
        descriptors: &[Descriptor],
        (query, seen): (&Descriptor, &Seen),
        k: usize,
        limit: f32,
        found: &mut Vec<(f32, u32)>,
    ) {
        found.clear();
        if k == 0 || self.order.is_empty() || !is_usable(query) {
            return;
        }
        simd::wide(
            #[inline(always)]
            || {
                let start = bound(limit, seen.reach);
                self.walk(
                    &seen.at,
                    start,
                    #[inline(always)]
                    |lower, order, mut bound| {
                        for (lower, &index) in lower.iter().zip(order) {
                            if *lower > bound {
                                continue;
                            }
                            let Some(row) = descriptors.get(index as usize) else {
                                continue;
                            };
                            let most = found.get(k - 1).map_or(limit, |last| last.0);
                            let new = (squared_distance(query, row, most), index);
                            if new.0 <= most && new.0 < f32::INFINITY && offer(found, k, new) {
                                bound = self::bound(found[k - 1].0, seen.reach);
                            }
                        }
                        bound
                    },
                );
            },
        );
    }

    /// An order in which queries that this index has seen follow each other as their first leaves do.
    pub(crate) fn in_order(&self, seen: &[Seen]) -> Vec<u32> {
        let leaf = |seen: &Seen| {
            let (mut node, mut first, mut leaves) = (0, 0, self.order.len());
            while leaves > 1 {
                let half = leaves / 2;
                let [low, high, right_low, right_high] = &self.nodes[node];
                let left = box_distance(&seen.at, low, high);
                if box_distance(&seen.at, right_low, right_high) < left {
                    (node, first, leaves) = (node + half, first + half, leaves - half);
                } else {
                    (node, leaves) = (node + 1, half);
                }
            }
            first
        };
        let mut keyed: Vec<(usize, u32)> = seen.iter().map(leaf).zip(0u32..).collect();
        keyed.sort_unstable();
        keyed.into_iter().map(|(_, i)| i).collect()
    }

    /// Whether a descriptor comes before `than` (squared distance, index) among those near a query
    /// that this index has seen.
    pub(crate) fn any_before(
        &self,
        descriptors: &[Descriptor],
        (query, seen): (&Descriptor, &Seen),
        than: (f32, u32),
    ) -> bool {
        if self.order.is_empty() || !is_usable(query) {
            return false;
        }
        let mut any = false;
        simd::wide(
            #[inline(always)]
            || {
                let start = bound(than.0, seen.reach);
                self.walk(
                    &seen.at,
                    start,
                    #[inline(always)]
                    |lower, order, bound| {
                        for (lower, &index) in lower.iter().zip(order) {
                            if *lower > bound {
                                continue;
                            }
                            let Some(row) = descriptors.get(index as usize) else {
                                continue;
                            };
                            if before((squared_distance(query, row, than.0), index), than) {
                                any = true;
                                return NOTHING;
                            }
                        }
                        bound
                    },
                );
            },
        );
        any
    }

    /// Shows `leaf` the leaves that may hold descriptors whose coordinates lie within `bound` (squared) of `at`,
    /// near ones mostly first: squared distances of the coordinates, and the indices. It answers with the bound from there on.
    #[inline(always)]
    fn walk(
        &self,
        at: &[f32; COORDINATES],
        mut bound: f32,
        mut leaf: impl FnMut(&[f32; LANES], &Order, f32) -> f32,
    ) {
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
                let left = (box_distance(at, low, high), node + 1, first, half);
                let right = (
                    box_distance(at, right_low, right_high),
                    node + half,
                    first + half,
                    leaves - half,
                );
                let (near, far) = if right.0 < left.0 {
                    (right, left)
                } else {
                    (left, right)
                };
                // NaN counts as near.
                if !(far.0 > bound) {
                    stack[top] = far;
                    top += 1;
                }
                (distance, node, first, leaves) = near;
            }
            if distance > bound {
                continue;
            }
            let lower = lane_distances(at, &self.blocks[first]);
            let mut any = false;
            for lower in &lower {
                any |= !(*lower > bound);
            }
            if any {
                bound = leaf(&lower, &self.order[first], bound);
            }
        }
    }
}

/// A bound that nothing is within.
const NOTHING: f32 = -1.0;

/// Whether a descriptor can be near anything: not all zero, and finite.
pub(crate) fn is_usable(d: &Descriptor) -> bool {
    // Without branches, so that it is done many at a time.
    const EXPONENT: u32 = 0x7F80_0000;
    let (mut any, mut broken) = (0u32, 0u32);
    for v in d {
        let size = v.to_bits() << 1;
        any |= size;
        broken |= u32::from(size >= EXPONENT << 1);
    }
    any != 0 && broken == 0
}

/// The squared distance, summed over the dimensions in order; some value above `most` where it is above.
#[inline(always)]
fn squared_distance(query: &Descriptor, row: &Descriptor, most: f32) -> f32 {
    const PART: usize = DIMENSIONS / 3;
    let mut sum = 0.0;
    for part in 0..3 {
        for d in part * PART..(part + 1) * PART {
            let d = row[d] - query[d];
            sum += d * d;
        }
        // It only grows.
        if sum > most {
            break;
        }
    }
    sum
}

/// The order of those near: by squared distance, then by index.
#[inline(always)]
pub(crate) fn before(a: (f32, u32), b: (f32, u32)) -> bool {
    a.0 < b.0 || (a.0 == b.0 && a.1 < b.1)
}

/// Puts `new` into the list of at most `k`. Whether the list is full and its last has changed.
#[inline]
pub(crate) fn offer(found: &mut Vec<(f32, u32)>, k: usize, new: (f32, u32)) -> bool {
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
/// length of what is projected, that it is projected in `f32`: each of 11 coordinates is a sum of 33 products, off by at most
/// 35·6·10⁻⁸, together by 7·10⁻⁶ of it; of each of 33 numbers of the rest 11 products are taken off, together by 5·10⁻⁶, to which those 7·10⁻⁶ are
/// added; in all below 2·10⁻⁵. A descriptor within the limit lies no further out than `reach` plus the
/// distance, so that 5·10⁻⁵ of this covers both sides. The last term stands for squares that underflow.
#[inline(always)]
fn bound(limit: f32, reach: f32) -> f32 {
    let distance = limit.sqrt();
    let margin = 1e-5 * distance + 5e-5 * (reach + distance) + 1e-18;
    let radius = distance + margin;
    radius * radius
}

/// Squared distance of coordinates from a box. NaN counts as inside.
#[inline(always)]
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
#[inline(always)]
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
