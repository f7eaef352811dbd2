//! Building the index.

use rayon::prelude::*;

use super::frame::{GROUP, frame, project};
use super::{Block, COORDINATES, IndexColumns, LANES, Node, Order, Seen, is_usable};
use crate::cancel;
use crate::columns::{Columns, Memory};
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
            let groups = items.chunks_mut(GROUP).zip(descriptors.chunks(GROUP));
            for (g, (items, descriptors)) in groups.enumerate() {
                let seen = see(&frame, descriptors);
                for (l, (d, seen)) in descriptors.iter().zip(&seen).enumerate() {
                    items[l] = item(c * CHUNK + g * GROUP + l, d, seen);
                }
            }
        });
    arrange(frame, &mut scratch, columns)
}

/// The index over descriptors that were `seen` in `frame`.
pub(super) fn build_seen(
    frame: &[Descriptor],
    descriptors: &[Descriptor],
    seen: &[Seen],
) -> IndexColumns<Memory> {
    let both = descriptors.iter().zip(seen).take(u32::MAX as usize);
    let mut items: Vec<Item> = both
        .enumerate()
        .map(|(i, (d, seen))| item(i, d, seen))
        .collect();
    let Ok(index) = arrange(frame.to_vec(), &mut items, &Memory);
    index
}

/// How at most [`GROUP`] descriptors are seen in a frame.
fn see(frame: &[Descriptor], group: &[Descriptor]) -> [Seen; GROUP] {
    match group.split_first() {
        Some((first, _)) => project(
            frame,
            std::array::from_fn(|l| group.get(l).unwrap_or(first)),
        ),
        None => [Seen::default(); GROUP],
    }
}

/// How descriptors are seen in a frame.
pub(super) fn see_all(frame: &[Descriptor], descriptors: &[Descriptor]) -> Vec<Seen> {
    let mut out = vec![Seen::default(); descriptors.len()];
    out.par_chunks_mut(CHUNK)
        .zip(descriptors.par_chunks(CHUNK))
        .for_each(|(out, descriptors)| {
            cancel::check();
            for (out, group) in out.chunks_mut(GROUP).zip(descriptors.chunks(GROUP)) {
                out.copy_from_slice(&see(frame, group)[..group.len()]);
            }
        });
    out
}

fn item(i: usize, d: &Descriptor, seen: &Seen) -> Item {
    let mut item = [0; COORDINATES + 1];
    if is_usable(d) {
        for (bits, v) in item.iter_mut().zip(seen.at) {
            *bits = v.to_bits();
        }
        #[expect(clippy::cast_possible_truncation, reason = "below 2^32 descriptors")]
        let i = i as u32;
        item[COORDINATES] = i;
    } else {
        item[COORDINATES] = u32::MAX;
    }
    item
}

/// The index over `items`.
fn arrange<C: Columns>(
    frame: Vec<Descriptor>,
    items: &mut [Item],
    columns: &C,
) -> Result<IndexColumns<C>, C::Error> {
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
