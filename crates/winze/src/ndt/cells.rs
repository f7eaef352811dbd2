//! The map as one Gaussian a cell.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::columns::{Columns, Memory};
use crate::eigen3::eigen3;
use crate::parallel;
use crate::voxel::{Grid, pack, unpack};

/// A Gaussian as plain numbers: its mean (offset from the surface's origin, metres), then the upper triangle of its inverse
/// covariance (m⁻²), row by row.
pub type Gaussian = [f64; 9];

/// The Gaussians of a surface at one cell size. Its arrays are its own, or lie in a mapped file.
#[derive(Debug, Clone, PartialEq)]
pub struct NdtCells<'a> {
    /// Edge length, metres.
    pub size: f64,
    gaussians: Cow<'a, [Gaussian]>,
    /// Each one's cell, ascending by z, y, x.
    places: Cow<'a, [[i32; 3]]>,
    /// Where to look for a cell: one up from its place among them; 0 for none. An open-addressed table
    /// of a power of two of slots, at most half of them taken.
    table: Cow<'a, [u32]>,
}

/// The columns of cells that were just made, see [`NdtCells::parts`].
pub struct NdtColumns<C: Columns> {
    /// Edge length, metres.
    pub size: f64,
    /// Gaussians.
    pub gaussians: C::Column<Gaussian>,
    /// Their cells.
    pub places: C::Column<[i32; 3]>,
    /// Where to look for a cell.
    pub table: C::Column<u32>,
}

/// As [`NdtCells::build`], in `columns`.
///
/// # Errors
/// Where a column cannot be had.
pub fn cells_in<C: Columns>(
    points: &[[f32; 3]],
    size: f64,
    min_points: usize,
    floor: f64,
    columns: &C,
) -> Result<NdtColumns<C>, C::Error> {
    let mut keyed = columns.zeros::<[u64; 2]>(points.len())?;
    parallel::fill(
        &mut keyed,
        || (),
        |(), i| {
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
            pack(cell_of(points[i].map(f64::from), size), i as u32)
        },
    );
    keyed.par_sort_unstable();
    let enough = min_points.max(3);
    let groups = || keyed.chunk_by(Grid::same_cell).map(<[_]>::len);
    // Where each begins among the keys, and how many points it has.
    let mut starts = columns.zeros::<[u32; 2]>(groups().filter(|n| *n >= enough).count())?;
    let mut first = 0;
    let begun = groups().filter_map(|n| {
        first += n;
        (n >= enough).then_some([first - n, n])
    });
    for (start, range) in starts.iter_mut().zip(begun) {
        #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
        let range = range.map(|v| v as u32);
        *start = range;
    }
    let mut all = columns.zeros::<Gaussian>(starts.len())?;
    parallel::fill(
        &mut all,
        || (),
        |(), g| {
            let [first, count] = starts[g].map(|v| v as usize);
            let members = keyed[first..first + count].iter();
            let members = members.map(|key| points[Grid::index(key)]);
            gaussian(members, count, floor).unwrap_or([f64::NAN; 9])
        },
    );
    let solid = |g: &Gaussian| !g[0].is_nan();
    let count = all.iter().filter(|g| solid(g)).count();
    let mut gaussians = columns.zeros::<Gaussian>(count)?;
    let mut places = columns.zeros::<[i32; 3]>(count)?;
    let kept = all.iter().zip(starts.iter()).filter(|(g, _)| solid(g));
    for ((out, place), (g, start)) in gaussians.iter_mut().zip(places.iter_mut()).zip(kept) {
        *out = *g;
        *place = unpack(keyed[start[0] as usize]);
    }
    let mut table = columns.zeros::<u32>(table_len(count))?;
    for (name, place) in (1u32..).zip(places.iter()) {
        let mut at = hash(*place) & (table.len() - 1);
        while table[at] != 0 {
            at = (at + 1) & (table.len() - 1);
        }
        table[at] = name;
    }
    Ok(NdtColumns {
        size,
        gaussians,
        places,
        table,
    })
}

/// Slots for so many cells.
fn table_len(count: usize) -> usize {
    (2 * count + 1).next_power_of_two()
}

/// Part of the file format: never to be changed without its version.
pub(super) fn hash(place: [i32; 3]) -> usize {
    let [x, y, z] = place.map(|v| u64::from(v.cast_unsigned()));
    let mixed = x.wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ y.wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ z.wrapping_mul(0x1656_67B1_9E37_79F9);
    let hash = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 32;
    hash as usize
}

impl NdtCells<'static> {
    /// Gaussians of all cells of edge `size` (metres) that hold at least `min_points` points.
    ///
    /// Eigenvalues below `floor` times the largest are raised to it: a cell whose points lie in
    /// a plane or a line has no thickness of its own, and a Gaussian without thickness forgives
    /// nothing (Magnusson 2009, section 6.2).
    #[must_use]
    pub fn build(points: &[[f32; 3]], size: f64, min_points: usize, floor: f64) -> Self {
        let Ok(made) = cells_in(points, size, min_points, floor, &Memory);
        Self {
            size,
            gaussians: Cow::Owned(made.gaussians),
            places: Cow::Owned(made.places),
            table: Cow::Owned(made.table),
        }
    }
}

impl<'a> NdtCells<'a> {
    /// Cells from the arrays of ones that were made before. `None` where they are none: whatever
    /// the arrays hold, what comes back answers without panic and in bounded time.
    #[must_use]
    pub fn from_parts(
        size: f64,
        gaussians: &'a [Gaussian],
        places: &'a [[i32; 3]],
        table: &'a [u32],
    ) -> Option<Self> {
        let count = gaussians.len();
        let taken = table.iter().filter(|t| **t != 0).count();
        let sound = size > 0.0
            && size.is_finite()
            && places.len() == count
            && table.len() == table_len(count)
            && taken == count
            && table.iter().all(|t| *t as usize <= count);
        sound.then_some(Self {
            size,
            gaussians: Cow::Borrowed(gaussians),
            places: Cow::Borrowed(places),
            table: Cow::Borrowed(table),
        })
    }

    /// Gaussians, their cells, and the table to look them up by.
    #[must_use]
    pub fn parts(&self) -> (&[Gaussian], &[[i32; 3]], &[u32]) {
        (&self.gaussians, &self.places, &self.table)
    }

    /// The Gaussian of a cell.
    #[inline]
    fn find(&self, place: [i32; 3]) -> Option<&Gaussian> {
        let (table, places): (&[u32], &[[i32; 3]]) = (&self.table, &self.places);
        let mask = table.len() - 1;
        let mut at = hash(place) & mask;
        // Half of the slots are empty, so this ends.
        loop {
            let name = (table[at] as usize).checked_sub(1)?;
            if places[name] == place {
                return Some(&self.gaussians[name]);
            }
            at = (at + 1) & mask;
        }
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.gaussians.len()
    }

    /// No cell had enough points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.gaussians.is_empty()
    }

    /// Adds the Gaussians of the cell `c` and, for 7 or 27 `neighbours`, of those that share a face or a corner with it.
    pub(super) fn around(&self, c: [i32; 3], neighbours: usize, to: &mut Vec<Gaussian>) {
        let offsets = &NEIGHBOURS[..neighbours.clamp(1, NEIGHBOURS.len())];
        for o in offsets {
            let place = [
                c[0].saturating_add(o[0]),
                c[1].saturating_add(o[1]),
                c[2].saturating_add(o[2]),
            ];
            to.extend(self.find(place));
        }
    }
}

/// Own cell, then face neighbours, then edges and corners.
const NEIGHBOURS: [[i32; 3]; 27] = [
    [0, 0, 0],
    [-1, 0, 0],
    [1, 0, 0],
    [0, -1, 0],
    [0, 1, 0],
    [0, 0, -1],
    [0, 0, 1],
    [-1, -1, 0],
    [-1, 1, 0],
    [1, -1, 0],
    [1, 1, 0],
    [-1, 0, -1],
    [-1, 0, 1],
    [1, 0, -1],
    [1, 0, 1],
    [0, -1, -1],
    [0, -1, 1],
    [0, 1, -1],
    [0, 1, 1],
    [-1, -1, -1],
    [-1, -1, 1],
    [-1, 1, -1],
    [-1, 1, 1],
    [1, -1, -1],
    [1, -1, 1],
    [1, 1, -1],
    [1, 1, 1],
];

pub(super) fn cell_of(p: [f64; 3], size: f64) -> [i32; 3] {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    p.map(|v| (v / size).floor() as i32)
}

fn gaussian(
    members: impl Iterator<Item = [f32; 3]> + Clone,
    count: usize,
    floor: f64,
) -> Option<Gaussian> {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = count as f64;
    let mut mean = [0.0f64; 3];
    for p in members.clone() {
        for a in 0..3 {
            mean[a] += f64::from(p[a]) / n;
        }
    }
    let mut s = [0.0f64; 6];
    for p in members {
        let d: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - mean[a]);
        let products = [
            d[0] * d[0],
            d[0] * d[1],
            d[0] * d[2],
            d[1] * d[1],
            d[1] * d[2],
            d[2] * d[2],
        ];
        for (out, v) in s.iter_mut().zip(products) {
            *out += v / (n - 1.0);
        }
    }
    let e = eigen3(&s);
    let largest = e.values[2];
    if !(largest > 1e-12) {
        return None;
    }
    let inverse = e.values.map(|v| 1.0 / v.max(floor * largest));
    let entry = |i: usize, j: usize| -> f64 {
        (0..3)
            .map(|k| inverse[k] * e.vectors[k][i] * e.vectors[k][j])
            .sum()
    };
    Some([
        mean[0],
        mean[1],
        mean[2],
        entry(0, 0),
        entry(0, 1),
        entry(0, 2),
        entry(1, 1),
        entry(1, 2),
        entry(2, 2),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_computed_cell() {
        // Four corners of a square and its centre twice, in the plane z = 0.
        let points = [
            [0.1f32, 0.1, 0.0],
            [0.9, 0.1, 0.0],
            [0.1, 0.9, 0.0],
            [0.9, 0.9, 0.0],
            [0.5, 0.5, 0.0],
            [0.5, 0.5, 0.0],
        ];
        let cells = NdtCells::build(&points, 1.0, 6, 0.01);
        assert_eq!(cells.len(), 1);
        let cell = cells.find([0; 3]).unwrap();
        let variance = 4.0 * 0.4 * 0.4 / 5.0;
        for (a, b) in cell[..3].iter().zip([0.5, 0.5, 0.0]) {
            assert!((a - b).abs() < 1e-7);
        }
        let expected = [
            1.0 / variance,
            0.0,
            0.0,
            1.0 / variance,
            0.0,
            100.0 / variance,
        ];
        for (a, b) in cell[3..].iter().zip(expected) {
            assert!((a - b).abs() < 1e-3, "{cell:?}");
        }
        assert!(NdtCells::build(&points, 1.0, 7, 0.01).is_empty());
        assert!(
            NdtCells::build(&[[1.0; 3]; 9], 1.0, 6, 0.01).is_empty(),
            "no extent, no Gaussian"
        );
    }
}
