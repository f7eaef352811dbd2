//! The base of a map: one point a fine voxel, with how many raw points it stands for.
//!
//! All that is prepared of a map is prepared from its base, whatever size the map has and however it
//! was read. Points come in pieces of any size; each gives a sorted [run()] of cells, and runs are
//! [merged](merge()). Sums are whole numbers, so neither the pieces nor their order change a bit.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::voxel::{Grid, pack, unpack};

/// A cell as plain numbers, so that runs can be kept in a file: its place and the count of its points
/// packed in two, then the sum of their offsets from its corner along each axis, in units of 2⁻³⁰ of the
/// cell.
pub type Cell = [u64; 5];

/// Steps of an offset in a cell.
const STEPS: f64 = (1u64 << 30) as f64;

/// Base points in the order of their cells: z, then y, then x.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Base {
    /// Centroids as offsets from the map's origin, metres.
    pub points: Vec<[f32; 3]>,
    /// Raw points that each stands for.
    pub weights: Vec<u32>,
}

/// The base of a cloud in cells of `voxel` metres.
#[must_use]
pub fn base_of(cloud: &Cloud, voxel: f64) -> Base {
    let cells = run(cloud.points(), cloud.origin(), voxel);
    let mut base = Base {
        points: Vec::with_capacity(cells.len()),
        weights: Vec::with_capacity(cells.len()),
    };
    let to = BasePoints::new(cloud.origin(), voxel);
    for cell in &cells {
        let (point, weight) = to.point(cell);
        base.points.push(point);
        base.weights.push(weight);
    }
    base
}

/// The occupied cells of `points`, offsets from `origin`, sorted.
#[must_use]
pub fn run(points: &[[f32; 3]], origin: [f64; 3], voxel: f64) -> Vec<Cell> {
    let grid = Grid::new(origin, voxel);
    let mut keyed: Vec<[u64; 2]> = Vec::with_capacity(points.len());
    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
    points
        .par_iter()
        .enumerate()
        .map(|(i, p)| grid.key(*p, i as u32))
        .collect_into_vec(&mut keyed);
    keyed.par_sort_unstable();
    // Pieces that begin with a cell are summed side by side.
    let piece = 1 << 16;
    let mut starts: Vec<usize> = (0..keyed.len())
        .step_by(piece)
        .map(|s| {
            let same = |i: &usize| {
                *i > 0
                    && keyed
                        .get(*i)
                        .is_some_and(|k| Grid::same_cell(k, &keyed[*i - 1]))
            };
            (s..).find(|i| !same(i)).unwrap_or(s)
        })
        .collect();
    starts.dedup();
    starts.push(keyed.len());
    let parts: Vec<Vec<Cell>> = starts
        .par_windows(2)
        .map(|w| {
            keyed[w[0]..w[1]]
                .chunk_by(Grid::same_cell)
                .map(|group| {
                    let place = unpack(group[0]);
                    let corner = grid.corner(place);
                    let mut sums = [0u64; 3];
                    for key in group {
                        let p = points[Grid::index(key)];
                        for a in 0..3 {
                            let at = (f64::from(p[a]) - corner[a]) / grid.voxel * STEPS;
                            #[expect(
                                clippy::cast_possible_truncation,
                                clippy::cast_sign_loss,
                                reason = "clamped"
                            )]
                            let at = at.clamp(0.0, STEPS).round() as u64;
                            sums[a] += at;
                        }
                    }
                    let count = u32::try_from(group.len()).unwrap_or(u32::MAX);
                    let [high, low] = pack(place, count);
                    [high, low, sums[0], sums[1], sums[2]]
                })
                .collect()
        })
        .collect();
    parts.concat()
}

/// Merges sorted runs: each cell once, in order.
///
/// # Errors
/// The first one of a run, or of `each`.
pub fn merge<R, E>(runs: Vec<R>, mut each: impl FnMut(Cell) -> Result<(), E>) -> Result<(), E>
where
    R: Iterator<Item = Result<Cell, E>>,
{
    let mut runs = runs;
    let mut heads = BinaryHeap::with_capacity(runs.len());
    for (i, run) in runs.iter_mut().enumerate() {
        if let Some(cell) = run.next() {
            heads.push(Reverse((cell?, i)));
        }
    }
    let mut open: Option<Cell> = None;
    while let Some(mut head) = heads.peek_mut() {
        let Reverse((cell, i)) = *head;
        match runs[i].next() {
            Some(next) => *head = Reverse((next?, i)),
            None => {
                std::collections::binary_heap::PeekMut::pop(head);
            }
        }
        open = Some(match open {
            Some(one) if place(&one) == place(&cell) => joined(one, cell),
            Some(one) => {
                each(one)?;
                cell
            }
            None => cell,
        });
    }
    open.map_or(Ok(()), each)
}

/// What tells cells apart.
fn place(cell: &Cell) -> (u64, u64) {
    (cell[0], cell[1] >> 32)
}

fn count(cell: &Cell) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "the lower half")]
    let count = cell[1] as u32;
    count
}

/// One cell's points in two runs.
fn joined(a: Cell, b: Cell) -> Cell {
    let total = u64::from(count(&a).saturating_add(count(&b)));
    let sum = |i: usize| a[i].saturating_add(b[i]);
    [a[0], a[1] >> 32 << 32 | total, sum(2), sum(3), sum(4)]
}

/// From cells to base points.
#[derive(Debug, Clone, Copy)]
pub struct BasePoints {
    grid: Grid,
}

impl BasePoints {
    /// For cells of `voxel` metres of offsets from `origin`.
    #[must_use]
    pub fn new(origin: [f64; 3], voxel: f64) -> Self {
        Self {
            grid: Grid::new(origin, voxel),
        }
    }

    /// The centroid of a cell's points, as an offset, and their number.
    #[must_use]
    pub fn point(&self, cell: &Cell) -> ([f32; 3], u32) {
        let corner = self.grid.corner(unpack([cell[0], cell[1]]));
        let count = count(cell);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            reason = "a mean of f32 offsets"
        )]
        let point = std::array::from_fn(|a| {
            (corner[a] + cell[2 + a] as f64 / f64::from(count.max(1)) / STEPS * self.grid.voxel)
                as f32
        });
        (point, count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::voxel;
    use std::convert::Infallible;

    fn points(n: usize, seed: u64) -> Vec<[f32; 3]> {
        let mut rng = Rng::new(seed, 0);
        (0..n)
            .map(|_| rng.direction().map(|v| (3.0 * v) as f32))
            .collect()
    }

    #[test]
    fn pieces_and_their_order_change_no_bit() {
        let all = points(20_000, 1);
        let origin = [431_000.3, -77.7, 0.0];
        let whole = run(&all, origin, 0.13);
        for pieces in [1, 2, 7, 100] {
            let mut runs: Vec<_> = all
                .chunks(all.len().div_ceil(pieces))
                .map(|piece| run(piece, origin, 0.13))
                .collect();
            runs.reverse();
            let runs = runs
                .into_iter()
                .map(|r| r.into_iter().map(Ok::<_, Infallible>))
                .collect();
            let mut merged = Vec::new();
            let Ok(()) = merge(runs, |cell| {
                merged.push(cell);
                Ok(())
            });
            assert_eq!(merged, whole, "{pieces}");
        }
    }

    #[test]
    fn base_points_are_the_centroids_of_their_voxels() {
        let all = points(5_000, 2);
        let wide: Vec<[f64; 3]> = all.iter().map(|p| p.map(f64::from)).collect();
        let cloud = Cloud::from_points(&wide).unwrap().0;
        let base = base_of(&cloud, 0.25);
        let expected = voxel::downsample(&cloud, 0.25);
        assert_eq!(base.points.len(), expected.len());
        for (a, b) in base.points.iter().zip(expected.points()) {
            for i in 0..3 {
                assert!((a[i] - b[i]).abs() < 1e-6, "{a:?} {b:?}");
            }
        }
        assert_eq!(base.weights.iter().sum::<u32>(), 5_000);
    }

    /// A hundred kilometres of points, and cells of a billion.
    #[test]
    fn keys_and_counts_hold_for_what_is_wide_and_what_is_dense() {
        let ends: Vec<[f32; 3]> = [-50_000.0f32, -49_999.9, 0.0, 49_999.9, 50_000.0]
            .iter()
            .flat_map(|x| [[*x, -*x, 0.5], [-*x, *x, -0.5], [*x, *x, 900.0]])
            .collect();
        let cells = run(&ends, [431_000.0, 5_600_000.0, 300.0], 0.05);
        assert!(cells.is_sorted());
        assert_eq!(cells.len(), 15);
        let to = BasePoints::new([431_000.0, 5_600_000.0, 300.0], 0.05);
        for p in &ends {
            let near = |c: &&Cell| {
                let (q, _) = to.point(c);
                (0..3).all(|a| (q[a] - p[a]).abs() <= 0.05)
            };
            assert!(cells.iter().any(|c| near(&c)), "{p:?}");
        }
        let half = STEPS as u64 / 2;
        let billion = |n: u64| -> Cell {
            let [high, low] = pack([7, -3, 0], n as u32);
            [high, low, n * half, n * half, n * half]
        };
        let mut merged = Vec::new();
        let runs: Vec<_> = (0..3)
            .map(|_| vec![Ok::<_, Infallible>(billion(1_000_000_000))].into_iter())
            .collect();
        let Ok(()) = merge(runs, |cell| {
            merged.push(cell);
            Ok(())
        });
        let (point, weight) = BasePoints::new([0.0; 3], 2.0).point(&merged[0]);
        assert_eq!((merged.len(), weight), (1, 3_000_000_000));
        assert_eq!(point, [15.0, -5.0, 1.0]);
    }

    #[test]
    fn no_points_no_base() {
        assert!(run(&[], [0.0; 3], 0.1).is_empty());
        let none: Vec<std::vec::IntoIter<Result<Cell, Infallible>>> = Vec::new();
        let Ok(()) = merge(none, |_| Ok(()));
        assert_eq!(base_of(&Cloud::default(), 0.1), Base::default());
    }
}
