//! Voxel downsampling: one point a cell, the centroid of the points in it.
//!
//! Two clouds of very different density come out comparable, since a cell counts once however
//! many points it holds. The grid is aligned to the cloud's coordinates (a cell is
//! `⌊p / voxel⌋`), not to its first point or its bounds, so that adding a stray point moves nothing.

use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::columns::Columns;

mod means;
#[cfg(test)]
mod tests;

use means::{Lattice, by_bucket, by_group};

/// One point a voxel: the centroid of its points, summed in `f64` in the order of the cloud.
///
/// `voxel` is the edge length, metres. The answer is ordered by cell (z, then y, then x) and does
/// not depend on the number of threads. Keys are made from the occupied extent and widen by
/// themselves, so a map of any extent at any voxel size has its own cell for each place. A `voxel`
/// that is not positive and finite changes nothing: the cloud comes back as it is.
///
/// Intensities are averaged like coordinates.
#[must_use]
pub fn downsample(cloud: &Cloud, voxel: f64) -> Cloud {
    if !(voxel > 0.0 && voxel.is_finite()) || cloud.is_empty() {
        return cloud.clone();
    }
    let voxel = voxel.max(FINEST);
    match Lattice::of(cloud, voxel) {
        Some(lattice) => by_bucket(cloud, &lattice),
        None => by_group(cloud, voxel),
    }
}

/// One point a voxel, as [`downsample`], of offsets from `origin`, each of which stands for a number of
/// points (its weight; 1 where there are none). Ordered by cell: z, then y, then x.
///
/// # Errors
/// Where a column cannot be had.
pub fn thin<C: Columns>(
    points: &[[f32; 3]],
    weights: Option<&[u32]>,
    origin: [f64; 3],
    voxel: f64,
    columns: &C,
) -> Result<C::Column<[f32; 3]>, C::Error> {
    let grid = Grid::new(origin, voxel);
    let mut keyed = columns.zeros::<[u64; 2]>(points.len())?;
    keyed
        .par_iter_mut()
        .zip(points)
        .enumerate()
        .for_each(|(i, (k, p))| {
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
            let i = i as u32;
            *k = grid.key(*p, i);
        });
    // The index makes them distinct, so an unstable sort has one possible answer.
    keyed.par_sort_unstable();
    let groups = || keyed.chunk_by(Grid::same_cell);
    let mut out = columns.zeros(groups().count())?;
    for (place, group) in out.iter_mut().zip(groups()) {
        let (mut sum, mut total) = ([0.0f64; 3], 0.0f64);
        for key in group {
            let i = Grid::index(key);
            let weight = weights.map_or(1.0, |w| f64::from(w[i]));
            for a in 0..3 {
                sum[a] += weight * f64::from(points[i][a]);
            }
            total += weight;
        }
        #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 offsets")]
        let mean = sum.map(|s| (s / total) as f32);
        *place = mean;
    }
    Ok(out)
}

/// The voxel grid as seen from an origin: cells are numbered from the origin's own.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Grid {
    pub(crate) voxel: f64,
    origin: [f64; 3],
    first: [f64; 3],
}

impl Grid {
    pub(crate) fn new(origin: [f64; 3], voxel: f64) -> Self {
        let voxel = voxel.max(FINEST);
        Self {
            voxel,
            origin,
            first: origin.map(|o| (o / voxel).floor()),
        }
    }

    /// The cell of an offset. No offset of a cloud is so far out that it would saturate.
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    pub(crate) fn cell(&self, p: [f32; 3]) -> [i32; 3] {
        std::array::from_fn(|a| {
            (((self.origin[a] + f64::from(p[a])) / self.voxel).floor() - self.first[a]) as i32
        })
    }

    /// The lower corner of a cell as an offset.
    pub(crate) fn corner(&self, cell: [i32; 3]) -> [f64; 3] {
        std::array::from_fn(|a| (self.first[a] + f64::from(cell[a])) * self.voxel - self.origin[a])
    }

    /// Sorts by z, y, x and index.
    pub(crate) fn key(&self, p: [f32; 3], index: u32) -> [u64; 2] {
        pack(self.cell(p), index)
    }

    pub(crate) fn same_cell(a: &[u64; 2], b: &[u64; 2]) -> bool {
        a[0] == b[0] && a[1] >> 32 == b[1] >> 32
    }

    #[expect(clippy::cast_possible_truncation, reason = "the lower half")]
    pub(crate) fn index(key: &[u64; 2]) -> usize {
        key[1] as u32 as usize
    }
}

/// A cell and 32 more bits, sorted by z, y, x and those.
pub(crate) fn pack(cell: [i32; 3], low: u32) -> [u64; 2] {
    let [x, y, z] = cell.map(|c| u64::from(c.cast_unsigned() ^ 1 << 31));
    [z << 32 | y, x << 32 | u64::from(low)]
}

/// The cell that was packed.
#[expect(clippy::cast_possible_truncation, reason = "halves")]
pub(crate) fn unpack(key: [u64; 2]) -> [i32; 3] {
    [(key[1] >> 32) as u32, key[0] as u32, (key[0] >> 32) as u32]
        .map(|c| (c ^ 1 << 31).cast_signed())
}

/// Cells finer than this, metres, would split nothing that matters, and could not be counted in 32 bits.
pub(crate) const FINEST: f64 = 1e-5;
