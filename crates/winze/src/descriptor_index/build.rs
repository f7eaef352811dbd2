//! Building the index.

use rayon::prelude::*;

use super::frame::{frame, project};
use super::{Block, COORDINATES, IndexColumns, LANES, Node, Order, is_usable};
use crate::cancel;
use crate::columns::Columns;
use crate::fpfh::Descriptor;

/// Descriptors that are projected as one piece of work.
const CHUNK: usize = 1024;
/// Subtrees of fewer leaves are built by one thread.
const PARALLEL: usize = 1024;

/// Coordinates of a descriptor, as bits, and its index; `u32::MAX` for one that is not usable.
type Item = [u32; COORDINATES + 1];

fn coordinate(item: &Item, axis: usize) -> f32 {
    f32::from_bits(item[axis])
}

/// The index over `descriptors`, built on all threads of the current pool, its long arrays and
/// what is needed on the way in columns of `columns`. Indices are 32-bit: descriptors beyond
/// 2³² − 1 are ignored.
///
/// # Errors
/// Where `columns` has no room.
pub fn build<C: Columns>(
    descriptors: &[Descriptor],
    columns: &C,
) -> Result<IndexColumns<C>, C::Error> {
    let descriptors = &descriptors[..descriptors.len().min(u32::MAX as usize)];
    let frame = frame(descriptors);
    let mut scratch = columns.zeros::<Item>(descriptors.len())?;
    scratch
        .par_chunks_mut(CHUNK)
        .zip(descriptors.par_chunks(CHUNK))
        .enumerate()
        .for_each(|(c, (items, descriptors))| {
            #[expect(clippy::cast_possible_truncation, reason = "below 2^32 descriptors")]
            for (i, (item, d)) in (c * CHUNK..).zip(items.iter_mut().zip(descriptors)) {
                let usable = is_usable(d);
                let at = if usable {
                    project(&frame, d).0
                } else {
                    [0.0; COORDINATES]
                };
                for (bits, v) in item.iter_mut().zip(at) {
                    *bits = v.to_bits();
                }
                item[COORDINATES] = if usable { i as u32 } else { u32::MAX };
            }
        });
    let items: &mut [Item] = &mut scratch;
    let mut count = 0;
    for i in 0..items.len() {
        if items[i][COORDINATES] != u32::MAX {
            items[count] = items[i];
            count += 1;
        }
    }
    let leaves = count.div_ceil(LANES);
    let mut nodes = columns.zeros::<Node>(leaves.saturating_sub(1))?;
    let mut blocks = columns.zeros::<Block>(leaves)?;
    let mut order = columns.zeros::<Order>(leaves)?;
    if count > 0 {
        split(&mut items[..count], &mut nodes, &mut blocks, &mut order);
    }
    Ok(IndexColumns {
        frame,
        nodes,
        blocks,
        order,
    })
}

/// Low and high corner of a box.
type Bounds = [[f32; COORDINATES]; 2];

fn bounds(items: &[Item]) -> Bounds {
    let mut low = [f32::INFINITY; COORDINATES];
    let mut high = [f32::NEG_INFINITY; COORDINATES];
    for item in items {
        for c in 0..COORDINATES {
            let v = coordinate(item, c);
            low[c] = if v < low[c] { v } else { low[c] };
            high[c] = if v > high[c] { v } else { high[c] };
        }
    }
    [low, high]
}

/// Orders `items` into the tree over `blocks.len()` leaves; the box around them.
fn split(
    items: &mut [Item],
    nodes: &mut [Node],
    blocks: &mut [Block],
    order: &mut [Order],
) -> Bounds {
    let bounds = bounds(items);
    let half = blocks.len() / 2;
    let Some((node, below)) = nodes.split_first_mut().filter(|_| half > 0) else {
        if let (Some(block), Some(order)) = (blocks.first_mut(), order.first_mut()) {
            fill(items, block, order);
        }
        return bounds;
    };
    let width = |c: usize| bounds[1][c] - bounds[0][c];
    let axis = (1..COORDINATES).fold(0, |best, c| if width(c) > width(best) { c } else { best });
    // Which items go where depends on no algorithm: indices break ties.
    items.select_nth_unstable_by(half * LANES, |a, b| {
        coordinate(a, axis)
            .total_cmp(&coordinate(b, axis))
            .then(a[COORDINATES].cmp(&b[COORDINATES]))
    });
    let parallel = blocks.len() > PARALLEL;
    let (left, right) = items.split_at_mut(half * LANES);
    let (left_nodes, right_nodes) = below.split_at_mut(half - 1);
    let (left_blocks, right_blocks) = blocks.split_at_mut(half);
    let (left_order, right_order) = order.split_at_mut(half);
    let mut a = || split(left, left_nodes, left_blocks, left_order);
    let mut b = || split(right, right_nodes, right_blocks, right_order);
    let ([low, high], [right_low, right_high]) = if parallel {
        cancel::check();
        rayon::join(a, b)
    } else {
        (a(), b())
    };
    *node = [low, high, right_low, right_high];
    bounds
}

/// Writes a leaf, its items by index.
fn fill(items: &mut [Item], block: &mut Block, order: &mut Order) {
    items.sort_unstable_by_key(|item| item[COORDINATES]);
    for l in 0..LANES {
        let item = items.get(l);
        order[l] = item.map_or(u32::MAX, |item| item[COORDINATES]);
        for c in 0..COORDINATES {
            block[c][l] = item.map_or(f32::INFINITY, |item| coordinate(item, c));
        }
    }
}
