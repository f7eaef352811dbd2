//! The map as one Gaussian a cell.

use rustc_hash::FxHashMap;

use crate::eigen3::{Symmetric3, eigen3};
use crate::parallel;

/// One cell's Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NdtCell {
    /// Mean, offsets from the surface's origin, metres.
    pub mean: [f64; 3],
    /// Inverse covariance, m⁻².
    pub inverse_covariance: Symmetric3,
}

/// The Gaussians of a surface at one cell size.
#[derive(Debug, Clone, PartialEq)]
pub struct NdtCells {
    /// Edge length, metres.
    pub size: f64,
    cells: Vec<NdtCell>,
    index: FxHashMap<[i32; 3], u32>,
}

impl NdtCells {
    /// Gaussians of all cells of edge `size` (metres) that hold at least `min_points` points.
    ///
    /// Eigenvalues below `floor` times the largest are raised to it: a cell whose points lie in
    /// a plane or a line has no thickness of its own, and a Gaussian without thickness forgives
    /// nothing (Magnusson 2009, section 6.2).
    #[must_use]
    pub fn build(points: &[[f32; 3]], size: f64, min_points: usize, floor: f64) -> Self {
        let key = |p: &[f32; 3]| cell_of(p.map(f64::from), size);
        let mut keyed: Vec<([i32; 3], u32)> =
            (0u32..).zip(points).map(|(i, p)| (key(p), i)).collect();
        keyed.sort_unstable();
        let groups: Vec<&[([i32; 3], u32)]> = keyed
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|g| g.len() >= min_points.max(3))
            .collect();
        let gaussians = parallel::map_with(
            groups.len(),
            || (),
            |(), g| {
                let members = groups[g].iter().map(|&(_, i)| points[i as usize]);
                gaussian(members, groups[g].len(), floor)
            },
        );
        let mut cells = Vec::new();
        let mut index = FxHashMap::default();
        for (group, cell) in groups.iter().zip(gaussians) {
            if let (Some(cell), Ok(at)) = (cell, u32::try_from(cells.len())) {
                index.insert(group[0].0, at);
                cells.push(cell);
            }
        }
        Self { size, cells, index }
    }

    /// Number of Gaussians.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// No cell had enough points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Calls `each` for the Gaussians in the cell of `p` and, for 7 or 27 `neighbours`, in those
    /// that share a face or a corner with it.
    pub(super) fn around(&self, p: [f64; 3], neighbours: usize, mut each: impl FnMut(&NdtCell)) {
        let c = cell_of(p, self.size);
        let offsets = &NEIGHBOURS[..neighbours.clamp(1, NEIGHBOURS.len())];
        for o in offsets {
            let key = [
                c[0].saturating_add(o[0]),
                c[1].saturating_add(o[1]),
                c[2].saturating_add(o[2]),
            ];
            if let Some(&at) = self.index.get(&key) {
                each(&self.cells[at as usize]);
            }
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

fn cell_of(p: [f64; 3], size: f64) -> [i32; 3] {
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    p.map(|v| (v / size).floor() as i32)
}

fn gaussian(
    members: impl Iterator<Item = [f32; 3]> + Clone,
    count: usize,
    floor: f64,
) -> Option<NdtCell> {
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
    Some(NdtCell {
        mean,
        inverse_covariance: [
            entry(0, 0),
            entry(0, 1),
            entry(0, 2),
            entry(1, 1),
            entry(1, 2),
            entry(2, 2),
        ],
    })
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
        let cell = cells.cells[0];
        let variance = 4.0 * 0.4 * 0.4 / 5.0;
        for (a, b) in cell.mean.iter().zip([0.5, 0.5, 0.0]) {
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
        for (a, b) in cell.inverse_covariance.iter().zip(expected) {
            assert!((a - b).abs() < 1e-3, "{:?}", cell.inverse_covariance);
        }
        assert!(NdtCells::build(&points, 1.0, 7, 0.01).is_empty());
        assert!(
            NdtCells::build(&[[1.0; 3]; 9], 1.0, 6, 0.01).is_empty(),
            "no extent, no Gaussian"
        );
    }
}
