//! Voxel downsampling: one point a cell, the centroid of the points in it.
//!
//! Two clouds of very different density come out comparable, since a cell counts once however
//! many points it holds. The grid is aligned to the cloud's coordinates (a cell is
//! `⌊p / voxel⌋`), not to its first point or its bounds, so that adding a stray point moves nothing.

use rayon::prelude::*;

use crate::cancel;
use crate::cloud::Cloud;
use crate::columns::Columns;

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
    let groups = group(cloud, voxel);
    let centroid = |group: &[u32]| -> ([f64; 3], f32) {
        cancel::check();
        let (mut sum, mut intensity) = ([0.0f64; 3], 0.0f64);
        for &i in group {
            let p = cloud.points()[i as usize];
            for a in 0..3 {
                sum[a] += f64::from(p[a]);
            }
            intensity += cloud.intensity().map_or(0.0, |v| f64::from(v[i as usize]));
        }
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let n = group.len() as f64;
        #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 values")]
        let mean = (intensity / n) as f32;
        (sum.map(|s| s / n), mean)
    };
    let means: Vec<([f64; 3], f32)> = groups.par_iter().map(|g| centroid(g)).collect();
    cloud.with_offsets(
        #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 offsets")]
        means.iter().map(|(p, _)| p.map(|v| v as f32)).collect(),
        cloud
            .intensity()
            .map(|_| means.iter().map(|(_, i)| *i).collect()),
    )
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

/// Indices of the points of each occupied voxel, voxels in key order, indices ascending.
pub(crate) fn group(cloud: &Cloud, voxel: f64) -> Vec<Vec<u32>> {
    let cells = cells(cloud, voxel.max(FINEST));
    let (mut low, mut high) = ([i64::MAX; 3], [i64::MIN; 3]);
    for c in &cells {
        for a in 0..3 {
            low[a] = low[a].min(c[a]);
            high[a] = high[a].max(c[a]);
        }
    }
    // A row-major number within the occupied box sorts fastest, where it fits 64 bits.
    let size: [u64; 3] = std::array::from_fn(|a| high[a].abs_diff(low[a]).saturating_add(1));
    let row = size[0].checked_mul(size[1]);
    if row.and_then(|r| r.checked_mul(size[2])).is_some() {
        let at = |c: &[i64; 3], a: usize| c[a].abs_diff(low[a]);
        by_key(&cells, |c| {
            (at(c, 2) * size[1] + at(c, 1)) * size[0] + at(c, 0)
        })
    } else {
        by_key(&cells, |c| [c[2], c[1], c[0]])
    }
}

/// Cells finer than this, metres, would split nothing that matters, and could not be counted in 32 bits.
const FINEST: f64 = 1e-5;

/// Cell indices, from absolute coordinates so that the grid does not hang on the origin.
fn cells(cloud: &Cloud, voxel: f64) -> Vec<[i64; 3]> {
    let origin = cloud.origin();
    cloud
        .points()
        .par_iter()
        .map(|p| {
            std::array::from_fn(|a| {
                #[expect(clippy::cast_possible_truncation, reason = "saturates")]
                let cell = ((origin[a] + f64::from(p[a])) / voxel).floor() as i64;
                cell
            })
        })
        .collect()
}

fn by_key<K: Ord + Send + Copy>(
    cells: &[[i64; 3]],
    key: impl Fn(&[i64; 3]) -> K + Sync,
) -> Vec<Vec<u32>> {
    let mut keyed: Vec<(K, u32)> = (0u32..).zip(cells).map(|(i, c)| (key(c), i)).collect();
    // Pairs are distinct, so an unstable sort has one possible answer.
    keyed.par_sort_unstable();
    keyed
        .chunk_by(|a, b| a.0 == b.0)
        .map(|g| g.iter().map(|&(_, i)| i).collect())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    fn cloud(points: &[[f64; 3]]) -> Cloud {
        Cloud::from_points(points).unwrap().0
    }

    #[test]
    fn centroids_of_a_hand_made_cloud() {
        let c = cloud(&[
            [0.1, 0.1, 0.1],
            [0.3, 0.1, 0.1],
            [1.1, 0.0, 0.0],
            [-0.1, 0.0, 0.0],
        ]);
        let d = downsample(&c, 1.0);
        assert_eq!(d.len(), 3);
        let expected = [[-0.1f32, 0.0, 0.0], [0.2, 0.1, 0.1], [1.1, 0.0, 0.0]];
        for (a, b) in d.points().iter().zip(&expected) {
            for i in 0..3 {
                assert!((a[i] - b[i]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn density_does_not_matter() {
        let mut rng = Rng::new(1, 0);
        let mut plane = |n: usize| {
            let p: Vec<[f64; 3]> = (0..n)
                .map(|_| [rng.range(0.0, 10.0), rng.range(0.0, 10.0), 0.05])
                .collect();
            downsample(&cloud(&p), 0.5).len()
        };
        assert_eq!((plane(200_000), plane(20_000)), (400, 400));
    }

    #[test]
    fn no_extent_or_voxel_size_makes_keys_collide() {
        // 30 km at a tenth of a millimetre: 3e8 cells an axis, 2.7e25 in all.
        let points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i) * 150.0; 3]).collect();
        assert_eq!(downsample(&cloud(&points), 1e-4).len(), 100);
        assert_eq!(downsample(&cloud(&points), 1e-300).len(), 100);
        assert_eq!(downsample(&cloud(&points), 1e300).len(), 1);
        assert_eq!(downsample(&cloud(&points), 0.0).len(), 100);
        assert_eq!(downsample(&cloud(&points), f64::NAN).len(), 100);
    }

    #[test]
    fn cells_do_not_hang_on_the_origin_or_on_a_stray_point() {
        let mut rng = Rng::new(2, 0);
        let mut points: Vec<[f64; 3]> = (0..5000)
            .map(|_| std::array::from_fn(|_| rng.range(0.0, 20.0)))
            .collect();
        let before = downsample(&cloud(&points), 0.5);
        points.push([-700.3, 0.0, 0.0]);
        let after = downsample(&cloud(&points), 0.5);
        assert_eq!(after.len(), before.len() + 1);
        assert!(before.points().iter().all(|p| after.points().contains(p)));
    }

    #[test]
    fn the_same_bits_at_any_thread_count() {
        let mut rng = Rng::new(3, 0);
        let points: Vec<[f64; 3]> = (0..50_000)
            .map(|_| std::array::from_fn(|_| rng.range(0.0, 20.0)))
            .collect();
        let c = cloud(&points);
        let run = |n| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap();
            pool.install(|| downsample(&c, 0.3))
        };
        assert_eq!(run(1), run(5));
    }

    #[test]
    fn intensities_are_averaged() {
        let (c, _) =
            Cloud::with_intensity(&[[0.1; 3], [0.2; 3], [5.0; 3]], Some(&[1.0, 3.0, 7.0])).unwrap();
        assert_eq!(downsample(&c, 1.0).intensity(), Some(&[2.0, 7.0][..]));
    }
}
