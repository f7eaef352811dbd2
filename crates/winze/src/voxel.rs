//! Voxel downsampling: one point a cell, the centroid of the points in it.
//!
//! Two clouds of very different density come out comparable, since a cell counts once however
//! many points it holds. The grid is aligned to the cloud's coordinates (a cell is
//! `⌊p / voxel⌋`), not to its first point or its bounds, so that adding a stray point moves nothing.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use crate::cancel;
use crate::cloud::Cloud;
use crate::columns::Columns;
use crate::simd::{bits, wide};

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

/// The sums of a cell's points, added in the order of the cloud.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    offset: [f64; 3],
    intensity: f64,
    count: u32,
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, p: [f32; 3], intensity: f32) {
        for a in 0..3 {
            self.offset[a] += f64::from(p[a]);
        }
        self.intensity += f64::from(intensity);
        self.count += 1;
    }

    #[expect(clippy::cast_possible_truncation, reason = "means of f32 values")]
    fn mean(&self) -> ([f32; 3], f32) {
        let n = f64::from(self.count);
        (
            self.offset.map(|s| (s / n) as f32),
            (self.intensity / n) as f32,
        )
    }
}

/// The occupied box of cells, where a cell's row-major number within it is exact.
#[derive(Debug, Clone, Copy)]
struct Lattice {
    origin: [f64; 3],
    voxel: f64,
    low: [f64; 3],
    /// What a step along y and z adds to the number.
    stride: [f64; 2],
    /// Bits of a number that do not tell its bucket.
    low_bits: u32,
    buckets: usize,
}

/// About so many buckets: few enough for a processor's cache to write into all of them at a time.
const BUCKET_BITS: u32 = 12;

/// At most so many: their counts, for every [`CHUNK`] points, stay small.
const MOST_BUCKET_BITS: u32 = 14;

/// A bucket of up to two to this many cells has a table of them.
const TABLE_BITS: u32 = 18;

/// Points that are put into buckets together.
const CHUNK: usize = 1 << 17;

/// Buckets are summed in parts of about this many points, some parts at a time, so that little is held beside the answer.
const PART: usize = 1 << 15;
const PARTS_AT_A_TIME: usize = 16;

/// Points of a bucket that are looked at together.
const FETCHED: usize = 1 << 13;

impl Lattice {
    /// `None` where a number would not fit, or not be exact.
    fn of(cloud: &Cloud, voxel: f64) -> Option<Self> {
        /// Whole numbers up to here, their sums and differences are exact.
        const EXACT: f64 = (1u64 << 52) as f64;
        let (low, high) = extent(cloud.points());
        let origin = cloud.origin();
        // A cell's index grows with the offset, whatever is rounded, so the extent of the offsets tells that of the cells.
        let cell = |p: [f32; 3]| -> [f64; 3] {
            std::array::from_fn(|a| ((origin[a] + f64::from(p[a])) / voxel).floor())
        };
        let (low, high) = (cell(low), cell(high));
        if !low.iter().chain(&high).all(|c| c.abs() < EXACT) {
            return None;
        }
        let size: [f64; 3] = std::array::from_fn(|a| high[a] - low[a] + 1.0);
        let layer = size[0] * size[1];
        let last = layer * size[2] - 1.0;
        if last.is_nan() || last >= EXACT {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole number"
        )]
        let last = last as u64;
        let bits = u64::BITS - last.leading_zeros();
        let low_bits = bits
            .saturating_sub(BUCKET_BITS)
            .clamp(BUCKET_BITS, TABLE_BITS)
            .max(bits.saturating_sub(MOST_BUCKET_BITS));
        #[expect(clippy::cast_possible_truncation, reason = "MOST_BUCKET_BITS")]
        let buckets = (last >> low_bits) as usize + 1;
        Some(Self {
            origin,
            voxel,
            low,
            stride: [size[0], layer],
            low_bits,
            buckets,
        })
    }

    /// The number of a point's cell. All steps of it are exact but those of [`cells`].
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a whole number")]
    fn number(&self, p: [f32; 3]) -> u64 {
        let [x, y, z] = std::array::from_fn(|a| {
            ((self.origin[a] + f64::from(p[a])) / self.voxel).floor() - self.low[a]
        });
        ((z * self.stride[1] + y * self.stride[0] + x) as i64).cast_unsigned()
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "MOST_BUCKET_BITS")]
    fn bucket(&self, p: [f32; 3]) -> u16 {
        (self.number(p) >> self.low_bits) as u16
    }

    /// The buckets of some points, in `out`.
    fn buckets_of(&self, points: &[[f32; 3]], out: &mut Vec<u16>) {
        out.clear();
        out.resize(points.len(), 0);
        wide(
            #[inline(always)]
            || {
                for (out, p) in out.iter_mut().zip(points) {
                    *out = self.bucket(*p);
                }
            },
        );
    }
}

/// The smallest and the largest offset of each axis.
fn extent(points: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let none = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let join = |a: ([f32; 3], [f32; 3]), b: ([f32; 3], [f32; 3])| {
        (
            std::array::from_fn(|i| a.0[i].min(b.0[i])),
            std::array::from_fn(|i| a.1[i].max(b.1[i])),
        )
    };
    points
        .par_chunks(CHUNK)
        .map(|part| {
            cancel::check();
            wide(
                #[inline(always)]
                || {
                    let mut low = [[f32::INFINITY; 3]; 8];
                    let mut high = [[f32::NEG_INFINITY; 3]; 8];
                    let eights = part.chunks_exact(8);
                    let rest = eights.remainder();
                    for eight in eights {
                        for k in 0..8 {
                            for a in 0..3 {
                                let v = eight[k][a];
                                low[k][a] = if v < low[k][a] { v } else { low[k][a] };
                                high[k][a] = if v > high[k][a] { v } else { high[k][a] };
                            }
                        }
                    }
                    let of = |p: &[f32; 3]| (*p, *p);
                    let eights = low.into_iter().zip(high);
                    eights.chain(rest.iter().map(of)).fold(none, join)
                },
            )
        })
        .reduce(|| none, join)
}

/// Points go into buckets of neighbouring cells, in their order, and each bucket is summed on its own.
fn by_bucket(cloud: &Cloud, lattice: &Lattice) -> Cloud {
    let points = cloud.points();
    // How many points each chunk has for each bucket, and from that the place of its first one.
    let mut places: Vec<Vec<u32>> = points
        .par_chunks(CHUNK)
        .map_init(Vec::new, |buckets, part| {
            cancel::check();
            lattice.buckets_of(part, buckets);
            let mut counts = vec![0u32; lattice.buckets];
            for &b in &*buckets {
                counts[usize::from(b)] += 1;
            }
            counts
        })
        .collect();
    let mut ends = Vec::with_capacity(lattice.buckets);
    let mut place = 0u32;
    for b in 0..lattice.buckets {
        for chunk in &mut places {
            place += std::mem::replace(&mut chunk[b], place);
        }
        ends.push(place as usize);
    }
    // Each place is written once, by the one chunk that has it: in whatever order, the same comes out.
    let order: Vec<AtomicU32> = std::iter::repeat_with(|| AtomicU32::new(0))
        .take(points.len())
        .collect();
    points
        .par_chunks(CHUNK)
        .zip(&mut places)
        .enumerate()
        .for_each_init(Vec::new, |buckets, (c, (part, places))| {
            cancel::check();
            lattice.buckets_of(part, buckets);
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
            let first = (c * CHUNK) as u32;
            for (i, &b) in (first..).zip(&*buckets) {
                let place = &mut places[usize::from(b)];
                order[*place as usize].store(i, Ordering::Relaxed);
                *place += 1;
            }
        });
    drop(places);
    // Room for the most there can be, as growing it would copy it; what is not written takes no memory.
    let mut means = Means {
        points: Vec::with_capacity(points.len()),
        intensity: cloud.intensity().map(|i| Vec::with_capacity(i.len())),
    };
    for parts in parts(&ends).chunks(PARTS_AT_A_TIME) {
        let done: Vec<Means> = parts
            .par_iter()
            .map_init(Table::default, |table, part| {
                cancel::check();
                table.sum(cloud, lattice, &order, &ends, part.clone())
            })
            .collect();
        for part in done {
            means.points.extend(part.points);
            if let (Some(all), Some(part)) = (&mut means.intensity, part.intensity) {
                all.extend(part);
            }
        }
    }
    means.points.shrink_to_fit();
    if let Some(all) = &mut means.intensity {
        all.shrink_to_fit();
    }
    cloud.with_offsets(means.points, means.intensity)
}

/// Ranges of buckets of about [`PART`] points, all of them in order.
fn parts(ends: &[usize]) -> Vec<Range<usize>> {
    let mut parts = Vec::new();
    let (mut first, mut start) = (0, 0);
    for (b, &end) in ends.iter().enumerate() {
        if end - start >= PART || b + 1 == ends.len() {
            parts.push(first..b + 1);
            (first, start) = (b + 1, end);
        }
    }
    parts
}

/// Points of the answer.
struct Means {
    points: Vec<[f32; 3]>,
    intensity: Option<Vec<f32>>,
}

impl Means {
    fn push(&mut self, sums: &Sums) {
        let (point, intensity) = sums.mean();
        self.points.push(point);
        if let Some(all) = &mut self.intensity {
            all.push(intensity);
        }
    }
}

/// What a bucket is summed with.
#[derive(Default)]
struct Table {
    /// Which of the sums is a cell's, where the bucket has few enough cells.
    places: Vec<u32>,
    /// A bit for each of those that holds points, and one for each 64 of them.
    held: Vec<u64>,
    held_words: Vec<u64>,
    /// Of the cells that hold points, in the order in which the first one came.
    sums: Vec<Sums>,
    /// Some of the bucket's points with their cells and intensities.
    near: Vec<([f32; 3], u32)>,
    near_intensity: Vec<f32>,
    /// The cell and index of each point, where it has more.
    keyed: Vec<(u64, u32)>,
}

impl Table {
    fn sum(
        &mut self,
        cloud: &Cloud,
        lattice: &Lattice,
        order: &[AtomicU32],
        ends: &[usize],
        buckets: Range<usize>,
    ) -> Means {
        let mut means = Means {
            points: Vec::new(),
            intensity: cloud.intensity().map(|_| Vec::new()),
        };
        let mut start = buckets.start.checked_sub(1).map_or(0, |b| ends[b]);
        for b in buckets {
            let members = &order[start..ends[b]];
            start = ends[b];
            if members.is_empty() {
                continue;
            }
            if lattice.low_bits <= TABLE_BITS {
                self.sum_in_table(cloud, lattice, members, &mut means);
            } else {
                self.sum_sorted(cloud, lattice, members, &mut means);
            }
        }
        means
    }

    fn sum_in_table(
        &mut self,
        cloud: &Cloud,
        lattice: &Lattice,
        members: &[AtomicU32],
        means: &mut Means,
    ) {
        let cells = 1usize << lattice.low_bits;
        self.places.resize(cells, 0);
        self.held.resize(cells / 64, 0);
        self.held_words.resize(cells / 64 / 64, 0);
        self.sums.clear();
        // The points lie anywhere in memory. Fetched together they are waited for together, and not one by one, as where
        // the next step hangs on each.
        let mask = cells as u64 - 1;
        for part in members.chunks(FETCHED) {
            wide(
                #[inline(always)]
                || fetch(cloud.points(), lattice, part, mask, &mut self.near),
            );
            self.near_intensity.clear();
            if let Some(all) = cloud.intensity() {
                let of = |i: &AtomicU32| all[i.load(Ordering::Relaxed) as usize];
                self.near_intensity.extend(part.iter().map(of));
            }
            self.add();
        }
        for (w, word) in self.held_words.iter_mut().enumerate() {
            for w in bits(std::mem::take(word)).map(|bit| w * 64 + bit) {
                for cell in bits(std::mem::take(&mut self.held[w])).map(|bit| w * 64 + bit) {
                    means.push(&self.sums[self.places[cell] as usize]);
                }
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
    fn add(&mut self) {
        let intensity = self.near_intensity.iter().copied();
        let intensity = intensity.chain(std::iter::repeat(0.0));
        for (&(p, cell), intensity) in self.near.iter().zip(intensity) {
            let cell = cell as usize;
            let (word, bit) = (cell / 64, 1 << (cell % 64));
            if self.held[word] & bit == 0 {
                self.held[word] |= bit;
                self.held_words[word / 64] |= 1 << (word % 64);
                self.places[cell] = self.sums.len() as u32;
                self.sums.push(Sums::default());
            }
            self.sums[self.places[cell] as usize].add(p, intensity);
        }
    }

    fn sum_sorted(
        &mut self,
        cloud: &Cloud,
        lattice: &Lattice,
        members: &[AtomicU32],
        means: &mut Means,
    ) {
        let intensity = cloud.intensity();
        self.keyed.clear();
        self.keyed.extend(members.iter().map(|i| {
            let i = i.load(Ordering::Relaxed);
            (lattice.number(cloud.points()[i as usize]), i)
        }));
        // Pairs are distinct, so an unstable sort has one possible answer.
        self.keyed.sort_unstable();
        for cell in self.keyed.chunk_by(|a, b| a.0 == b.0) {
            let mut sums = Sums::default();
            for &(_, i) in cell {
                let i = i as usize;
                sums.add(cloud.points()[i], intensity.map_or(0.0, |v| v[i]));
            }
            means.push(&sums);
        }
    }
}

/// Points with their cells within the bucket.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "TABLE_BITS at most")]
fn fetch(
    points: &[[f32; 3]],
    lattice: &Lattice,
    members: &[AtomicU32],
    mask: u64,
    near: &mut Vec<([f32; 3], u32)>,
) {
    near.clear();
    near.resize(members.len(), ([0.0; 3], 0));
    for ((p, _), i) in near.iter_mut().zip(members) {
        *p = points[i.load(Ordering::Relaxed) as usize];
    }
    for (p, cell) in near {
        *cell = (lattice.number(*p) & mask) as u32;
    }
}

/// As [`by_bucket`], for any number of cells.
fn by_group(cloud: &Cloud, voxel: f64) -> Cloud {
    let groups = group(cloud, voxel);
    let intensity = cloud.intensity();
    let means: Vec<([f32; 3], f32)> = groups
        .par_iter()
        .map(|group| {
            cancel::check();
            let mut sums = Sums::default();
            for &i in group {
                let i = i as usize;
                sums.add(cloud.points()[i], intensity.map_or(0.0, |v| v[i]));
            }
            sums.mean()
        })
        .collect();
    cloud.with_offsets(
        means.iter().map(|(p, _)| *p).collect(),
        intensity.map(|_| means.iter().map(|(_, i)| *i).collect()),
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
fn group(cloud: &Cloud, voxel: f64) -> Vec<Vec<u32>> {
    let cells = cells(cloud, voxel);
    let mut keyed: Vec<([i64; 3], u32)> = (0u32..)
        .zip(&cells)
        .map(|(i, c)| ([c[2], c[1], c[0]], i))
        .collect();
    // Pairs are distinct, so an unstable sort has one possible answer.
    keyed.par_sort_unstable();
    keyed
        .chunk_by(|a, b| a.0 == b.0)
        .map(|g| g.iter().map(|&(_, i)| i).collect())
        .collect()
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
    fn buckets_tables_and_groups_give_the_same_bits() {
        let mut rng = Rng::new(4, 0);
        // The last are several chunks.
        for (half, origin, count) in [
            (3.0, [0.0; 3], 60_000),
            (40.0, [4.3e5, -4.5e6, 312.0], 60_000),
            (400.0, [0.0; 3], 60_000),
            (10.0, [0.0; 3], 300_000),
        ] {
            let points: Vec<[f64; 3]> = (0..count)
                .map(|_| std::array::from_fn(|a| origin[a] + rng.range(-half, half)))
                .collect();
            let intensity: Vec<f32> = (0..count).map(|i| (i % 251) as f32 * 0.1).collect();
            let (c, _) = Cloud::with_intensity(&points, Some(&intensity)).unwrap();
            for voxel in [0.01, 0.2, 0.7, 5.0, 1e4] {
                let lattice = Lattice::of(&c, voxel).unwrap();
                let expected = by_group(&c, voxel);
                assert_eq!(by_bucket(&c, &lattice), expected, "{half} {voxel}");
                assert_eq!(downsample(&c, voxel), expected);
            }
        }
    }

    #[test]
    fn the_same_bits_at_any_thread_count() {
        let mut rng = Rng::new(3, 0);
        let points: Vec<[f64; 3]> = (0..300_000)
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
