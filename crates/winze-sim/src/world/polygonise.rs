//! The rock's surface as triangles: surface nets in blocks, without cracks between them.
//!
//! Only blocks that the surface may cross are sampled. The samples' signs are mended until no face of a
//! cell has its corners in the open and in the rock crosswise: then every edge of the net has two
//! triangles, and the rock is closed. The net's vertices, one in each cell, are moved onto the surface.

use std::collections::BTreeMap;

use fast_surface_nets::ndshape::{ConstShape, ConstShape3u32};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::field::Field;
use crate::error::{Error, Result};

/// Cells along the edge of a block, and of the bricks in which it is sampled.
const BLOCK: i32 = 16;
const BRICK: i32 = 4;
/// Samples of a block with those of its neighbours that its triangles need.
type Padded = ConstShape3u32<18, 18, 18>;
/// No plan's clearance changes faster than this.
const STEEPEST: f64 = 1.25;
/// Steps of a sample's quantised value a cell: its sign is exact, its size only guides the net.
const QUANTA: f64 = 4096.0;

/// A surface of triangles.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Surface {
    pub(super) vertices: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// A block of samples, or that it has none because all of it is open or rock.
enum Block {
    Open,
    Rock,
    Samples(Vec<i16>),
}

type Key = [i32; 3];

/// The surface of the rock. `progress` hears of the share that is done.
///
/// # Errors
/// [`Error::TooLarge`] where vertices can't be counted.
pub(super) fn polygonise(field: &Field, progress: &(dyn Fn(f64) + Sync)) -> Result<Surface> {
    let cell = field.relief.rock().cell;
    let keys = candidates(field, cell);
    let mut blocks = BTreeMap::new();
    // In portions, for the sake of progress.
    for (i, portion) in keys.chunks(2048).enumerate() {
        progress(0.6 * share(i * 2048, keys.len()));
        let sampled: Vec<(Key, Block)> = portion
            .par_iter()
            .map(|key| (*key, sample(field, *key, cell)))
            .collect();
        blocks.extend(sampled);
    }
    mend(&mut blocks);
    let crossed: Vec<Key> = blocks
        .iter()
        .filter(|(_, b)| matches!(b, Block::Samples(_)))
        .map(|(k, _)| *k)
        .collect();
    let mut surface = Surface::default();
    let mut index: FxHashMap<Key, u32> = FxHashMap::default();
    let mut pieces: Vec<(Key, Vec<[u16; 3]>)> = Vec::new();
    for (i, portion) in crossed.chunks(1024).enumerate() {
        progress(0.6 + 0.4 * share(i * 1024, crossed.len()));
        let nets: Vec<Net> = portion
            .par_iter()
            .map_init(SurfaceNetsBuffer::default, |buffer, key| {
                net(field, &blocks, *key, cell, buffer)
            })
            .collect();
        for (block, net) in portion.iter().zip(nets) {
            for (key, vertex) in net.vertices {
                let next = u32::try_from(surface.vertices.len())
                    .map_err(|_| Error::TooLarge { what: "vertices" })?;
                index.insert(key, next);
                surface.vertices.push(vertex);
            }
            pieces.push((*block, net.triangles));
        }
    }
    drop(blocks);
    // Triangles at the border of what was looked at, where a patch of wall ends, lack a corner.
    let resolved: Vec<Vec<[u32; 3]>> = pieces
        .into_par_iter()
        .map(|(block, triangles)| {
            let vertex = |cell: u16| index.get(&cell_of(block, cell)).copied();
            let resolved = triangles.iter().filter_map(|t| {
                let [a, b, c] = t.map(vertex);
                Some([a?, b?, c?])
            });
            resolved.collect()
        })
        .collect();
    surface.triangles = resolved.concat();
    progress(1.0);
    Ok(surface)
}

#[expect(clippy::cast_precision_loss, reason = "a share for the eye")]
fn share(done: usize, of: usize) -> f64 {
    done as f64 / of.max(1) as f64
}

/// Blocks within reach of the plan's boxes, in order, each once.
fn candidates(field: &Field, cell: f64) -> Vec<Key> {
    let edge = cell * f64::from(BLOCK);
    let margin = field.relief.most() + 2.0 * cell;
    let mut keys = Vec::new();
    for bounds in field.plan.boxes() {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "worlds are smaller than 60 km, cells larger than 1 cm"
        )]
        let number = |v: f64| (v / edge).floor() as i32;
        let low = bounds[0].map(|v| number(v - margin));
        let high = bounds[1].map(|v| number(v + margin));
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    keys.push([x, y, z]);
                }
            }
        }
    }
    keys.sort_unstable();
    keys.dedup();
    keys
}

fn place(at: Key, cell: f64) -> [f64; 3] {
    at.map(|v| f64::from(v) * cell)
}

/// Where a sample of a block stands in it.
fn offset(local: Key) -> usize {
    let [x, y, z] = local;
    usize::try_from((z * BLOCK + y) * BLOCK + x).unwrap_or(0)
}

/// Samples a block.
fn sample(field: &Field, key: Key, cell: f64) -> Block {
    let origin = key.map(|k| k * BLOCK);
    // The last cells end at the neighbours' first samples.
    let bounds = [place(origin, cell), place(origin.map(|o| o + BLOCK), cell)];
    let near = field.near(bounds);
    // Further than this from the walls at its middle, a cube of `cells` is not crossed.
    let clear = |low: Key, cells: i32| {
        let half = 0.5 * f64::from(cells) * cell;
        let middle = place(low, cell).map(|v| v + half);
        let clearance = field.plan.at(middle, &near).clearance;
        let safe = STEEPEST * 3f64.sqrt() * half + field.relief.most();
        (clearance.abs() > safe).then_some(clearance > 0.0)
    };
    match clear(origin, BLOCK) {
        Some(true) => return Block::Open,
        Some(false) => return Block::Rock,
        None => {}
    }
    let mut samples = vec![0i16; offset([0, 0, BLOCK])];
    let bricks = BLOCK / BRICK;
    for brick in 0..bricks * bricks * bricks {
        let number = [
            brick % bricks,
            brick / bricks % bricks,
            brick / bricks / bricks,
        ];
        let low = number.map(|n| n * BRICK);
        let known = clear(std::array::from_fn(|a| origin[a] + low[a]), BRICK);
        for z in low[2]..low[2] + BRICK {
            for y in low[1]..low[1] + BRICK {
                for x in low[0]..low[0] + BRICK {
                    let value = match known {
                        Some(true) => i16::MAX,
                        Some(false) => -i16::MAX,
                        None => {
                            let at = [origin[0] + x, origin[1] + y, origin[2] + z];
                            quantised(field.at(place(at, cell), &near), cell)
                        }
                    };
                    if let Some(slot) = samples.get_mut(offset([x, y, z])) {
                        *slot = value;
                    }
                }
            }
        }
    }
    Block::Samples(samples)
}

/// A distance in 4096ths of a cell, positive in the open, never zero.
fn quantised(distance: f64, cell: f64) -> i16 {
    let steps = (distance / cell * QUANTA).clamp(-32_767.0, 32_767.0);
    #[expect(clippy::cast_possible_truncation, reason = "clamped")]
    let steps = steps as i16;
    match steps {
        0 if distance < 0.0 => -1,
        0 => 1,
        other => other,
    }
}

/// Opens rock samples until no face is crosswise. Each round opens, of every such face, the corner that lies
/// least deep; as samples are only ever opened, this ends.
fn mend(blocks: &mut BTreeMap<Key, Block>) {
    let mut suspects: Vec<Key> = blocks
        .iter()
        .filter(|(_, b)| matches!(b, Block::Samples(_)))
        .map(|(k, _)| *k)
        .collect();
    while !suspects.is_empty() {
        let found: Vec<Vec<Key>> = suspects.par_iter().map(|k| crosswise(blocks, *k)).collect();
        let mut opened: Vec<Key> = found.into_iter().flatten().collect();
        opened.sort_unstable();
        opened.dedup();
        suspects.clear();
        for at in opened {
            let local = at.map(|v| v.rem_euclid(BLOCK));
            if let Some(Block::Samples(samples)) = blocks.get_mut(&at.map(|v| v.div_euclid(BLOCK)))
                && let Some(slot) = samples.get_mut(offset(local))
            {
                *slot = 1;
                // Faces that hold this corner belong to blocks up to one sample before it.
                for n in 0..8 {
                    let by = [n & 1, n >> 1 & 1, n >> 2];
                    let first: Key = std::array::from_fn(|a| at[a] - by[a]);
                    suspects.push(first.map(|v| v.div_euclid(BLOCK)));
                }
            }
        }
        suspects.sort_unstable();
        suspects.dedup();
    }
}

/// The corners to open in the faces of a block's cells.
fn crosswise(blocks: &BTreeMap<Key, Block>, key: Key) -> Vec<Key> {
    let Some(padded) = padded(blocks, key, 0) else {
        return Vec::new();
    };
    let size = BLOCK + 2;
    let strides = [1, size, size * size];
    let at = |i: i32| {
        let i = usize::try_from(i).unwrap_or(0);
        padded.get(i).copied().unwrap_or(-1.0)
    };
    let mut out = Vec::new();
    for z in 0..BLOCK {
        for y in 0..BLOCK {
            for x in 0..BLOCK {
                let local = [x, y, z];
                let i = x + size * (y + size * z);
                for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                    let corners = [0, strides[a], strides[a] + strides[b], strides[b]];
                    let v = corners.map(|c| at(i + c));
                    let rock = v.map(|v| v < 0.0);
                    if rock[0] != rock[2] || rock[1] != rock[3] || rock[0] == rock[1] {
                        continue;
                    }
                    let mut at: Key = std::array::from_fn(|n| key[n] * BLOCK + local[n]);
                    // Of the two in the rock, which stand opposite each other.
                    let pair = usize::from(rock[1]);
                    let second = v[pair + 2] > v[pair];
                    let chosen = if second { pair + 2 } else { pair };
                    if chosen == 1 || chosen == 2 {
                        at[a] += 1;
                    }
                    if chosen >= 2 {
                        at[b] += 1;
                    }
                    out.push(at);
                }
            }
        }
    }
    out
}

/// A block's samples with neighbours', from `before` (0 or 1) samples before its first; `None` without samples.
fn padded(blocks: &BTreeMap<Key, Block>, key: Key, before: i32) -> Option<Vec<f32>> {
    let Some(Block::Samples(own)) = blocks.get(&key) else {
        return None;
    };
    let size = BLOCK + 2;
    // Those of the 27 blocks around that the padding reaches are looked up once.
    let around: Vec<Option<&Block>> = (0..27)
        .map(|n| {
            let by = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            blocks.get(&std::array::from_fn(|a| key[a] + by[a]))
        })
        .collect();
    let mut out = Vec::with_capacity(Padded::USIZE);
    for z in 0..size {
        for y in 0..size {
            for x in 0..size {
                let local = [x - before, y - before, z - before];
                let v = if local.iter().all(|v| (0..BLOCK).contains(v)) {
                    own.get(offset(local)).copied().unwrap_or(-1)
                } else {
                    let by = local.map(|v| v.div_euclid(BLOCK) + 1);
                    let number = usize::try_from(by[0] + 3 * by[1] + 9 * by[2]).unwrap_or(0);
                    match around.get(number) {
                        Some(Some(Block::Samples(samples))) => {
                            let local = local.map(|v| v.rem_euclid(BLOCK));
                            samples.get(offset(local)).copied().unwrap_or(-1)
                        }
                        Some(Some(Block::Open)) => i16::MAX,
                        // Rock, where nobody looked too.
                        _ => -i16::MAX,
                    }
                };
                out.push(f32::from(v));
            }
        }
    }
    Some(out)
}

/// A block's share of the net: the vertices of its cells, and its triangles by the numbers of their corners'
/// cells among the block's padded ones.
#[derive(Default)]
struct Net {
    vertices: Vec<(Key, [f32; 3])>,
    triangles: Vec<[u16; 3]>,
}

/// The cell of the whole grid that a padded block's number stands for.
fn cell_of(block: Key, number: u16) -> Key {
    let (n, size) = (i32::from(number), BLOCK + 2);
    let local = [n % size, n / size % size, n / size / size];
    std::array::from_fn(|a| block[a] * BLOCK + local[a] - 1)
}

fn net(
    field: &Field,
    blocks: &BTreeMap<Key, Block>,
    key: Key,
    cell: f64,
    buffer: &mut SurfaceNetsBuffer,
) -> Net {
    let Some(samples) = padded(blocks, key, 1) else {
        return Net::default();
    };
    let last = 17;
    surface_nets(&samples, &Padded {}, [0; 3], [last; 3], buffer);
    let origin = key.map(|k| k * BLOCK);
    let bounds = [place(origin, cell), place(origin.map(|o| o + BLOCK), cell)];
    let near = field.near(bounds);
    let mut net = Net::default();
    let number = |stride: u32| u16::try_from(stride).unwrap_or(0);
    let cells = buffer.surface_points.iter().zip(&buffer.surface_strides);
    for ((local, stride), position) in cells.zip(&buffer.positions) {
        // Those before the first belong to neighbours.
        if local.contains(&0) {
            continue;
        }
        let at = cell_of(key, number(*stride));
        let within = std::array::from_fn(|a| f64::from(position[a]) - f64::from(local[a]));
        net.vertices
            .push((at, settled(field, at, within, cell, &near)));
    }
    for t in buffer.indices.chunks_exact(3) {
        let corner = |i: usize| {
            let point = t.get(i).map_or(0, |v| *v as usize);
            buffer.surface_strides.get(point).map_or(0, |s| number(*s))
        };
        net.triangles.push([corner(0), corner(1), corner(2)]);
    }
    net
}

/// The place of a cell's vertex on the surface: Newton steps along the gradient from `within` the cell
/// (0 to 1 along each axis), not leaving it.
fn settled(field: &Field, at: Key, within: [f64; 3], cell: f64, near: &[u32]) -> [f32; 3] {
    const INSIDE: [f64; 2] = [0.03, 0.97];
    let h = 0.2 * cell;
    let mut v = within.map(|w| w.clamp(INSIDE[0], INSIDE[1]));
    let position =
        |v: [f64; 3]| -> [f64; 3] { std::array::from_fn(|a| (f64::from(at[a]) + v[a]) * cell) };
    let p = position(v);
    let mut value = field.at(p, near);
    let gradient: [f64; 3] = std::array::from_fn(|a| {
        let mut q = p;
        q[a] += h;
        (field.at(q, near) - value) / h
    });
    let steep: f64 = gradient.iter().map(|g| g * g).sum();
    if steep > 0.04 {
        for _ in 0..2 {
            for a in 0..3 {
                v[a] = (v[a] - value * gradient[a] / steep / cell).clamp(INSIDE[0], INSIDE[1]);
            }
            value = field.at(position(v), near);
        }
    }
    #[expect(clippy::cast_possible_truncation, reason = "metres near the origin")]
    position(v).map(|c| c as f32)
}
