//! The nearest of a few descriptors, by looking at all of them.
//!
//! Below a thousand or two no index earns what it costs to build. Distances are summed as the index sums them, so
//! answers are the same to the bit.

use crate::descriptor_index::{before, is_usable, offer};
use crate::fpfh::{DIMENSIONS, Descriptor};
use crate::simd;

/// Descriptors of a tile: several vectors of the widest, since one sum alone waits for each of its additions.
const LANES: usize = 64;
/// Of a tile, those that are looked at again together.
const PART: usize = 16;

/// Descriptors side by side, a row a dimension. Lanes to spare hold infinity.
type Tile = [[f32; LANES]; DIMENSIONS];

/// Descriptors arranged for comparison with one after the other.
pub(super) struct Tiles {
    tiles: Vec<Tile>,
    /// Which descriptors they are, ascending: those that can be near anything.
    order: Vec<u32>,
}

impl Tiles {
    pub(super) fn of(descriptors: &[Descriptor]) -> Self {
        let (mut tiles, mut order) = (Vec::new(), Vec::new());
        for (i, d) in (0u32..).zip(descriptors).filter(|(_, d)| is_usable(d)) {
            let lane = order.len() % LANES;
            if lane == 0 {
                tiles.push([[f32::INFINITY; LANES]; DIMENSIONS]);
            }
            if let Some(tile) = tiles.last_mut() {
                for (row, v) in tile.iter_mut().zip(d) {
                    row[lane] = *v;
                }
            }
            order.push(i);
        }
        Self { tiles, order }
    }

    /// As [`DescriptorIndex::nearest_within`](crate::descriptor_index::DescriptorIndex::nearest_within).
    pub(super) fn nearest_within(
        &self,
        query: &Descriptor,
        k: usize,
        limit: f32,
        found: &mut Vec<(f32, u32)>,
    ) {
        found.clear();
        if k == 0 || !is_usable(query) {
            return;
        }
        self.each(
            query,
            limit,
            #[inline(always)]
            |near| {
                if near.0 < f32::INFINITY {
                    offer(found, k, near);
                }
                found.get(k - 1).map_or(limit, |last| last.0)
            },
        );
    }

    /// Whether a descriptor comes before `than` (squared distance, index) among those near `query`.
    pub(super) fn any_before(&self, query: &Descriptor, than: (f32, u32)) -> bool {
        let mut any = false;
        if is_usable(query) {
            self.each(
                query,
                than.0,
                #[inline(always)]
                |near| {
                    any |= before(near, than);
                    if any { -1.0 } else { than.0 }
                },
            );
        }
        any
    }

    /// Shows `near` all (squared distance, index) that are not above a limit, which it answers with from there on.
    #[inline(always)]
    fn each(&self, query: &Descriptor, limit: f32, mut near: impl FnMut((f32, u32)) -> f32) {
        simd::wide(
            #[inline(always)]
            || {
                let mut limit = limit;
                for (tile, order) in self.tiles.iter().zip(self.order.chunks(LANES)) {
                    let mut sums = [0.0f32; LANES];
                    for (row, x) in tile.iter().zip(query) {
                        for l in 0..LANES {
                            let d = row[l] - x;
                            sums[l] += d * d;
                        }
                    }
                    for (sums, order) in sums.chunks_exact(PART).zip(order.chunks(PART)) {
                        let mut any = false;
                        for sum in sums {
                            any |= *sum <= limit;
                        }
                        if !any {
                            continue;
                        }
                        for (sum, &index) in sums.iter().zip(order) {
                            if *sum <= limit {
                                limit = near((*sum, index));
                            }
                        }
                        if limit < 0.0 {
                            return;
                        }
                    }
                }
            },
        );
    }
}
