//! The mean of each voxel's points.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering};

use rayon::prelude::*;

use crate::cancel;
use crate::cloud::Cloud;
use crate::simd::{bits, wide};

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
pub(super) struct Lattice {
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
    pub(super) fn of(cloud: &Cloud, voxel: f64) -> Option<Self> {
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
pub(super) fn by_bucket(cloud: &Cloud, lattice: &Lattice) -> Cloud {
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
pub(super) fn by_group(cloud: &Cloud, voxel: f64) -> Cloud {
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
