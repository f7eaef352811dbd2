//! Fast point feature histograms (Rusu, Blodow & Beetz 2009), 33 numbers a keypoint.
//!
//! For each pair of a point and a neighbour within the radius, three angles between their normals
//! and the line that joins them go into three histograms of eleven bins: the point's SPFH. The FPFH of a
//! keypoint sums the SPFHs of its neighbours, nearer ones more ([`DescriptorVariant`]).
//!
//! Neighbours come from the whole prepared cloud, not from the keypoints alone. Normals that are
//! undefined (`[0, 0, 0]`) take no part.
//!
//! Order of the 33 numbers, as in PCL and Open3D: eleven bins of θ = atan2(w·n, u·n) over ±π, of
//! α = v·n over ±1, of φ = u·d over ±1, in the Darboux frame u, v = d×u, w = u×v of the pair.

use std::sync::atomic::{AtomicU64, Ordering};

use fearless_simd::prelude::*;
use fearless_simd::{Level, Simd, dispatch, f32x16, u8x64};
use rayon::prelude::*;

use crate::cancel;
use crate::columns::{Columns, Memory};
use crate::config::{DescriptorVariant, FpfhConfig};
use crate::kdtree::KdTree;
use crate::neighbours::{GROUP, LANES, Neighbours, offsets};
use crate::simd::bits;

/// Bins of one histogram.
pub const BINS: usize = 11;
/// Numbers of one descriptor: three histograms.
pub const DIMENSIONS: usize = 3 * BINS;

/// One descriptor; each of its three parts sums to 100, or 200 in the variant of Open3D.
pub type Descriptor = [f32; DIMENSIONS];

/// Descriptors at `keypoints` (indices into `points`) at the pipeline's `voxel` size (metres).
///
/// `normals` must be unit or zero, one a point, oriented by one rule for the whole cloud; with
/// [`FpfhConfig::unsigned`] their signs do not matter. A keypoint whose own normal is undefined or
/// that has no neighbour with a normal gets a zero descriptor.
#[must_use]
pub fn descriptors(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    tree: &KdTree<'_>,
    keypoints: &[u32],
    config: &FpfhConfig,
    voxel: f64,
) -> Vec<Descriptor> {
    let Ok(found) = descriptors_in((points, normals), tree, keypoints, config, voxel, &Memory);
    found
}

/// Keypoints described at a time: their neighbours' SPFHs are held meanwhile.
const BLOCK: usize = 1 << 14;

/// As [`descriptors`] of `(points, normals)`, in `columns`.
///
/// # Errors
/// Where a column cannot be had.
pub fn descriptors_in<C: Columns>(
    (points, normals): (&[[f32; 3]], &[[f32; 3]]),
    tree: &KdTree<'_>,
    keypoints: &[u32],
    config: &FpfhConfig,
    voxel: f64,
    columns: &C,
) -> Result<C::Column<Descriptor>, C::Error> {
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let radius = config.radius.metres(voxel) as f32;
    let mut out = columns.zeros::<Descriptor>(keypoints.len())?;
    // Where a point's SPFH is found in its block, one up; 0 for none. By its place in the tree's leaf order.
    let mut slot = columns.zeros::<u32>(tree.len())?;
    let ordered = by_place(keypoints, points.len(), tree, columns)?;
    let seen: Vec<AtomicU64> = (0..tree.len().div_ceil(64)).map(|_| 0.into()).collect();
    let cloud = Described {
        normals,
        tree,
        radius,
    };
    for block in ordered.chunks(BLOCK) {
        let places: Vec<u32> = block.iter().map(|[place, _]| *place).collect();
        // SPFHs are wanted at the keypoints and all their neighbours, each once, in memory order, so that those that
        // follow each other share their neighbours.
        let needed = cloud.neighbours_of(&places, &seen);
        for (number, place) in (1u32..).zip(&needed) {
            slot[*place as usize] = number;
        }
        let mut spfh = vec![[0.0; DIMENSIONS]; needed.len()];
        cloud.by_groups(&needed, &mut spfh, |search, places, rows| {
            search.take_normals(&cloud);
            for (place, row) in places.iter().zip(rows) {
                *row = search.spfh(
                    cloud.at(*place),
                    cloud.normal(*place),
                    radius,
                    config.unsigned,
                );
            }
        });
        let mut made = vec![[0.0; DIMENSIONS]; places.len()];
        cloud.by_groups(&places, &mut made, |search, places, made| {
            search.take_slots(&slot);
            for (place, made) in places.iter().zip(made) {
                // A keypoint without a normal has no number for a place.
                let own = slot[*place as usize] as usize;
                if let Some(own) = own.checked_sub(1).and_then(|own| spfh.get(own)) {
                    let (sum, count) =
                        search.weighed(&spfh, cloud.at(*place), radius, config.variant);
                    *made = finished(sum, count, own, config.variant);
                }
            }
        });
        for ([_, which], made) in block.iter().zip(made) {
            out[*which as usize] = made;
        }
        for place in needed {
            slot[place as usize] = 0;
        }
    }
    Ok(out)
}

/// The places of keypoints in the tree's leaf order, ascending, and where each stands in `keypoints`. Those that are not in
/// the tree, for they are not finite, are left out.
fn by_place<C: Columns>(
    keypoints: &[u32],
    points: usize,
    tree: &KdTree<'_>,
    columns: &C,
) -> Result<C::Column<[u32; 2]>, C::Error> {
    const NOWHERE: u32 = u32::MAX;
    let mut places = columns.zeros::<u32>(if tree.order().is_empty() { 0 } else { points })?;
    places.fill(NOWHERE);
    for (place, name) in (0u32..).zip(tree.order()) {
        places[*name as usize] = place;
    }
    let place = |name: u32| {
        if !places.is_empty() {
            places[name as usize]
        } else if (name as usize) < tree.len() {
            name
        } else {
            NOWHERE
        }
    };
    let found = keypoints.iter().filter(|k| place(**k) != NOWHERE).count();
    let mut ordered = columns.zeros::<[u32; 2]>(found)?;
    let known = (0u32..)
        .zip(keypoints)
        .filter(|(_, k)| place(**k) != NOWHERE);
    for (out, (which, k)) in ordered.iter_mut().zip(known) {
        *out = [place(*k), which];
    }
    ordered.par_sort_unstable();
    Ok(ordered)
}

/// What is described.
struct Described<'a> {
    normals: &'a [[f32; 3]],
    tree: &'a KdTree<'a>,
    radius: f32,
}

impl Described<'_> {
    fn at(&self, place: u32) -> [f32; 3] {
        let (_, axes) = self.tree.parts();
        axes.map(|a| a[place as usize])
    }

    fn normal(&self, place: u32) -> [f32; 3] {
        self.normals[self.tree.name(place as usize) as usize]
    }

    /// Fills `out`, one value a place (they ascend), by groups that lie together; `f` finds what lies near them gathered.
    fn by_groups<T: Send>(
        &self,
        places: &[u32],
        out: &mut [T],
        f: impl Fn(&mut Search, &[u32], &mut [T]) + Sync,
    ) {
        let near = |a: &u32, b: &u32| *a as usize / GROUP == *b as usize / GROUP;
        let mut rest = out;
        let mut groups = Vec::new();
        for group in places.chunk_by(near) {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(group.len());
            groups.push((group, own));
            rest = others;
        }
        groups.into_par_iter().with_min_len(16).for_each_init(
            Search::default,
            |search, (group, out)| {
                cancel::check();
                let mut left = 0..group.len();
                while !left.is_empty() {
                    let at = |k: usize| self.at(group[k]);
                    let together = search.near.gather(self.tree, self.radius, left.clone(), at);
                    left.start = together.end;
                    f(search, &group[together.clone()], &mut out[together]);
                }
            },
        );
    }

    /// The places that have a normal and lie near any of `places`, ascending. `seen` is a bit a place, all 0 before and after.
    fn neighbours_of(&self, places: &[u32], seen: &[AtomicU64]) -> Vec<u32> {
        self.by_groups(places, &mut vec![(); places.len()], |search, places, _| {
            let (all, axes) = search.near.gathered();
            search.within.clear();
            search.within.resize(axes[0].len() / LANES, 0);
            for place in places {
                mark(axes, self.at(*place), self.radius, &mut search.within);
            }
            for (block, within) in all.chunks(LANES).zip(&search.within) {
                for k in bits(*within) {
                    let place = block[k] as usize;
                    let (word, bit) = (&seen[place / 64], 1 << (place % 64));
                    if word.load(Ordering::Relaxed) & bit == 0 {
                        word.fetch_or(bit, Ordering::Relaxed);
                    }
                }
            }
        });
        let mut needed = Vec::new();
        for (first, word) in (0u32..).step_by(64).zip(seen) {
            let marked = word.load(Ordering::Relaxed);
            if marked == 0 {
                continue;
            }
            word.store(0, Ordering::Relaxed);
            for place in bits(marked).map(|k| first + k as u32) {
                if self.normal(place) != [0.0; 3] {
                    needed.push(place);
                }
            }
        }
        needed
    }
}

/// Marks, a bit each, the places within `radius` of `q`.
fn mark(axes: [&[f32]; 3], q: [f32; 3], radius: f32, within: &mut [u64]) {
    dispatch!(Level::new(), simd => simd.vectorize(
        #[inline(always)]
        || {
            let limit = f32x16::splat(simd, radius * radius);
            for (b, within) in within.iter_mut().enumerate() {
                let (_, d2) = offsets(simd, axes, b, q);
                *within |= d2.simd_le(limit).to_bitmask();
            }
        }
    ));
}

/// What a thread keeps from group to group.
#[derive(Default)]
struct Search {
    near: Neighbours,
    /// Of what was gathered: which of a block of places are near.
    within: Vec<u64>,
    /// Of what was gathered: normals, an array an axis; NaN where undefined.
    normals: [Vec<f32>; 3],
    /// Of what was gathered: where its SPFH is.
    slots: Vec<u32>,
    /// Bins of a point's pairs, a list an angle.
    bins: [Vec<u8>; 3],
}

impl Search {
    fn take_normals(&mut self, cloud: &Described<'_>) {
        let (places, [xs, ..]) = self.near.gathered();
        for axis in &mut self.normals {
            axis.clear();
            axis.resize(xs.len(), f32::NAN);
        }
        for (k, place) in places.iter().enumerate() {
            let normal = cloud.normal(*place);
            if normal != [0.0; 3] {
                for a in 0..3 {
                    self.normals[a][k] = normal[a];
                }
            }
        }
    }

    fn take_slots(&mut self, slot: &[u32]) {
        let (places, _) = self.near.gathered();
        self.slots.clear();
        let slots = places.iter().map(|place| slot[*place as usize]);
        self.slots.extend(slots);
    }

    /// The simplified histogram of a point at `q` with normal `n`: its pairs with all neighbours, each part summing to 100
    /// (less where a pair has no frame).
    fn spfh(&mut self, q: [f32; 3], n: [f32; 3], radius: f32, unsigned: bool) -> Descriptor {
        let (_, axes) = self.near.gathered();
        let normals = self.normals.each_ref().map(|a| &a[..]);
        let limit = radius * radius;
        for bins in &mut self.bins {
            bins.resize(axes[0].len().next_multiple_of(BYTES), 0);
        }
        let bins = &mut self.bins;
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || if unsigned {
                histograms::<true, _>(simd, axes, normals, (q, n), limit, bins)
            } else {
                histograms::<false, _>(simd, axes, normals, (q, n), limit, bins)
            }
        ))
    }

    /// The weighted sum of the SPFHs around `q`, and how many these are.
    fn weighed(
        &self,
        spfh: &[Descriptor],
        q: [f32; 3],
        radius: f32,
        variant: DescriptorVariant,
    ) -> (Descriptor, u32) {
        let (_, axes) = self.near.gathered();
        let (slots, limit) = (&self.slots[..], radius * radius);
        dispatch!(Level::new(), simd => simd.vectorize(
            #[inline(always)]
            || weigh(simd, axes, slots, spfh, (q, limit), variant)
        ))
    }
}

/// Sums SPFHs, nearer ones more, in the order of their places.
#[inline(always)]
fn weigh<S: Simd>(
    simd: S,
    axes: [&[f32]; 3],
    slots: &[u32],
    spfh: &[Descriptor],
    (q, limit): ([f32; 3], f32),
    variant: DescriptorVariant,
) -> (Descriptor, u32) {
    let zero = f32x16::splat(simd, 0.0);
    let one = f32x16::splat(simd, 1.0);
    let limit = f32x16::splat(simd, limit);
    let (mut first, mut second, mut last, mut count) = (zero, zero, 0.0f32, 0);
    for (b, slots) in slots.chunks(LANES).enumerate() {
        let (_, d2) = offsets(simd, axes, b, q);
        let within = d2.simd_le(limit).to_bitmask() & d2.simd_gt(zero).to_bitmask();
        if within == 0 {
            continue;
        }
        let weights: [f32; LANES] = match variant {
            DescriptorVariant::Paper => (one / d2.sqrt()).into(),
            DescriptorVariant::Pcl | DescriptorVariant::Open3d => (one / d2).into(),
        };
        for k in bits(within) {
            let slot = (slots[k] as usize).wrapping_sub(1);
            let Some(row) = spfh.get(slot) else {
                continue;
            };
            let weight = weights[k];
            count += 1;
            first += f32x16::from_slice(simd, &row[..LANES]) * weight;
            second += f32x16::from_slice(simd, &row[LANES..2 * LANES]) * weight;
            last += row[2 * LANES] * weight;
        }
    }
    let mut sum = [0.0; DIMENSIONS];
    first.store_slice(&mut sum[..LANES]);
    second.store_slice(&mut sum[LANES..2 * LANES]);
    sum[2 * LANES] = last;
    (sum, count)
}

/// The FPFH of a point with this SPFH from the weighted sum of its neighbours'.
fn finished(
    mut sum: Descriptor,
    count: u32,
    own: &Descriptor,
    variant: DescriptorVariant,
) -> Descriptor {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let count = count as f32;
    if count == 0.0 {
        return [0.0; DIMENSIONS];
    }
    if variant == DescriptorVariant::Paper {
        for (s, o) in sum.iter_mut().zip(own) {
            *s = *s / count + o;
        }
    }
    for part in sum.chunks_exact_mut(BINS) {
        let total: f32 = part.iter().sum();
        if total > 0.0 {
            let scale = 100.0 / total;
            part.iter_mut().for_each(|v| *v *= scale);
        }
    }
    if variant == DescriptorVariant::Open3d {
        for (s, o) in sum.iter_mut().zip(own) {
            *s += o;
        }
    }
    sum
}

/// Bins of a list that are counted together.
const BYTES: usize = 64;

#[inline(always)]
fn histograms<const UNSIGNED: bool, S: Simd>(
    simd: S,
    axes: [&[f32]; 3],
    normals: [&[f32]; 3],
    (q, n): ([f32; 3], [f32; 3]),
    limit: f32,
    lists: &mut [Vec<u8>; 3],
) -> Descriptor {
    let zero = f32x16::splat(simd, 0.0);
    let limit = f32x16::splat(simd, limit);
    let mut batch = Batch::default();
    let (mut others, mut listed) = (0u32, 0);
    for b in 0..axes[0].len() / LANES {
        let at = b * LANES..(b + 1) * LANES;
        let (line, d2) = offsets(simd, axes, b, q);
        let x = f32x16::from_slice(simd, &normals[0][at.clone()]);
        let within = d2.simd_le(limit) & x.simd_eq(x);
        let bits = within.to_bitmask();
        if bits == 0 {
            continue;
        }
        others += bits.count_ones();
        for a in 0..3 {
            // Without a line there is no frame: the others count nowhere.
            within.select(line[a], zero).store_slice(&mut batch.line[a]);
            batch.normal[a].copy_from_slice(&normals[a][at.clone()]);
        }
        let angles = batch.angles::<UNSIGNED>(n);
        let units = [&angles.theta, &angles.alpha, &angles.phi];
        for part in 0..3 {
            let found = bins(units[part], &angles.frame);
            let list = &mut lists[part][listed..listed + LANES];
            for k in 0..LANES {
                list[k] = found[k] as u8;
            }
        }
        listed += LANES;
    }
    // The point itself is among them.
    let others = others.saturating_sub(1).max(1);
    #[expect(clippy::cast_precision_loss, reason = "counts of neighbours")]
    let scale = 100.0 / others as f32;
    let mut row = [0.0; DIMENSIONS];
    let whole = listed.next_multiple_of(BYTES);
    for part in 0..3 {
        let list = &mut lists[part][..whole];
        list[listed..].fill(SLOTS as u8 - 1);
        let mut counts = [0u32; BINS];
        for block in list.chunks_exact(BYTES) {
            let block = u8x64::from_slice(simd, block);
            for (bin, count) in (0u8..).zip(&mut counts) {
                *count += block
                    .simd_eq(u8x64::splat(simd, bin))
                    .to_bitmask()
                    .count_ones();
            }
        }
        for (out, count) in row[part * BINS..].iter_mut().zip(counts) {
            #[expect(clippy::cast_precision_loss, reason = "counts of neighbours")]
            let count = count as f32;
            *out = count * scale;
        }
    }
    row
}

/// Slots of a histogram: its bins, and some that nobody reads.
const SLOTS: usize = 16;

/// Neighbours whose angles are worked out side by side.
const BATCH: usize = LANES;

/// Neighbours as lines from the point and normals, an array an axis, so that the loop over them
/// vectorises.
#[derive(Default)]
struct Batch {
    line: [[f32; BATCH]; 3],
    normal: [[f32; BATCH]; 3],
}

impl Batch {
    /// The three features of each pair, scaled to `[0, 1]`.
    ///
    /// Of the two points the one whose normal is closer to the line is the frame's source. With
    /// `UNSIGNED`, the second normal is first turned to the side of the first, and then the sign
    /// that flipping both would change is dropped, |θ| and |φ|: nothing depends on either normal's
    /// sign.
    ///
    /// With u the source's normal, o the other one and d the line, u·u = 1 gives v·o = det(d, u, o) / |d × u|,
    /// w·o = (d·o − (u·d)(u·o)) / |d × u| and |d × u|² = |d|² − (u·d)², so that no frame need be built.
    #[inline(always)]
    fn angles<const UNSIGNED: bool>(&self, n: [f32; 3]) -> Angles {
        let mut out = Angles::default();
        for k in 0..BATCH {
            let line = [self.line[0][k], self.line[1][k], self.line[2][k]];
            let mut m = [self.normal[0][k], self.normal[1][k], self.normal[2][k]];
            if UNSIGNED {
                let side = if dot(n, m) < 0.0 { -1.0 } else { 1.0 };
                m = m.map(|c| c * side);
            }
            let (a, b, c) = (dot(n, line), dot(m, line), dot(n, m));
            let squared = dot(line, line);
            // acos(|a|) > acos(|b|) without the arc cosines, |line| cancelling.
            let swap = a.abs() < b.abs();
            // The source's normal along the line, and the other one, the line pointing away from the source.
            let (own, other) = if swap { (-b, -a) } else { (a, b) };
            let across = squared - own * own;
            let norm = across.max(0.0).sqrt();
            let theta = atan2(other - own * c, c * norm);
            let phi = own / squared.sqrt();
            out.alpha[k] = (dot(cross(line, n), m) / norm + 1.0) * 0.5;
            if UNSIGNED {
                // Both normals lie on one side, so |θ| ends at a quarter turn but for rounding.
                out.theta[k] = theta.abs() * std::f32::consts::FRAC_2_PI;
                out.phi[k] = phi.abs();
            } else {
                out.theta[k] = (theta + std::f32::consts::PI) * (0.5 * std::f32::consts::FRAC_1_PI);
                out.phi[k] = (phi + 1.0) * 0.5;
            }
            // The line runs along the normal, to within rounding, or is none: no frame.
            out.frame[k] = if across > PARALLEL * squared {
                1.0
            } else {
                0.0
            };
        }
        out
    }
}

/// Squared sine below which a line runs along a normal as far as 32 bits tell.
const PARALLEL: f32 = 1e-6;

/// Features of a batch.
#[derive(Default)]
struct Angles {
    theta: [f32; BATCH],
    alpha: [f32; BATCH],
    phi: [f32; BATCH],
    /// 0 where a pair has no frame.
    frame: [f32; BATCH],
}

/// The bins of values scaled to `[0, 1]`; one that nobody reads for pairs without a frame.
#[inline(always)]
fn bins(unit: &[f32; BATCH], frame: &[f32; BATCH]) -> [u32; BATCH] {
    /// Added to a number from 0 to 15, it leaves the number, rounded, in the lowest bits.
    const SHIFT: f32 = 12_582_912.0;
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    let (count, last, none) = (BINS as f32, (BINS - 1) as f32, (SLOTS - 1) as f32);
    let mut bins = [0; BATCH];
    for k in 0..BATCH {
        let at = if frame[k] > 0.0 {
            (unit[k] * count).min(last).max(0.0)
        } else {
            none
        };
        let rounded = at + SHIFT;
        // To the floor: conversions to whole numbers do not vectorise, this does.
        let above = if rounded - SHIFT > at { 1.0 } else { 0.0 };
        bins[k] = (rounded - above).to_bits() & (SLOTS as u32 - 1);
    }
    bins
}

/// The angle of `(x, y)` to within 2·10⁻⁶ rad, far finer than a bin: a polynomial for the arc tangent on
/// `[0, 1]` (Abramowitz & Stegun 4.4.49), folded over the eight octants.
#[inline(always)]
fn atan2(y: f32, x: f32) -> f32 {
    use std::f32::consts::{FRAC_PI_2, PI};
    let (ax, ay) = (x.abs(), y.abs());
    let (low, high) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let t = if high > 0.0 { low / high } else { 0.0 };
    let s = t * t;
    let poly = 1.0
        + s * (-0.333_331_45
            + s * (0.199_935_51
                + s * (-0.142_089
                    + s * (0.106_562_64
                        + s * (-0.075_289_64
                            + s * (0.042_909_614 + s * (-0.016_165_737 + s * 0.002_866_225_7)))))));
    let mut angle = t * poly;
    if ax < ay {
        angle = FRAC_PI_2 - angle;
    }
    if x < 0.0 {
        angle = PI - angle;
    }
    if y < 0.0 { -angle } else { angle }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Length;
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};

    fn config(variant: DescriptorVariant, unsigned: bool) -> FpfhConfig {
        FpfhConfig {
            radius: Length::Metres(1.0),
            variant,
            unsigned,
        }
    }

    #[test]
    fn the_arc_tangent_is_good_to_two_millionths() {
        for i in 0..=10_000 {
            let a = (f64::from(i) / 5_000.0 - 1.0) * std::f64::consts::PI;
            let (y, x) = ((3.0 * a.sin()) as f32, (3.0 * a.cos()) as f32);
            let error = (f64::from(atan2(y, x)) - f64::from(y).atan2(f64::from(x))).abs();
            assert!(
                error.min(std::f64::consts::TAU - error) < 2e-6,
                "{a}: {error:e}"
            );
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }

    #[test]
    fn a_descriptor_does_not_hang_on_what_else_is_described() {
        let s = surface(&drift(60_000, 12.0, 0.3, 0.0, 1), 0.08);
        let n = s.points.len() as u32;
        assert!(n as usize > BLOCK + BLOCK / 4, "{n}");
        let config = FpfhConfig {
            radius: Length::Metres(0.3),
            ..config(DescriptorVariant::Paper, false)
        };
        let at = |keypoints: &[u32]| {
            descriptors(&s.points, &s.normals, &s.tree, keypoints, &config, 0.08)
        };
        let all = at(&(0..n).collect::<Vec<_>>());
        assert!(all.iter().filter(|d| **d != [0.0; DIMENSIONS]).count() as u32 > n / 2);
        // One alone, from both ends, and many backwards, one of them twice.
        for k in [0, 1, n / 2, n - 1] {
            assert_eq!(at(&[k])[0], all[k as usize]);
        }
        let some: Vec<u32> = (0..n).rev().step_by(7).chain([5]).collect();
        for (d, k) in at(&some).iter().zip(&some) {
            assert_eq!(*d, all[*k as usize]);
        }
    }

    #[test]
    fn points_that_are_nowhere_have_no_descriptor() {
        let points = [[f32::NAN; 3]];
        let tree = KdTree::build(&points);
        let config = config(DescriptorVariant::Paper, false);
        let found = descriptors(&points, &[[0.0, 0.0, 1.0]], &tree, &[0], &config, 0.2);
        assert_eq!(found, [[0.0; DIMENSIONS]]);
    }

    /// One pair's `[θ, α, φ]`, scaled to `[0, 1]`.
    fn pair_angles(p: [f32; 3], n: [f32; 3], q: [f32; 3], m: [f32; 3]) -> Option<[f32; 3]> {
        let mut batch = Batch::default();
        for a in 0..3 {
            batch.line[a][0] = q[a] - p[a];
            batch.normal[a][0] = m[a];
        }
        let found = batch.angles::<false>(n);
        (found.frame[0] > 0.0).then(|| [found.theta[0], found.alpha[0], found.phi[0]])
    }

    #[test]
    fn a_hand_computed_pair() {
        // Both normals up, the second point level with the first: θ = 0, α = 0, φ = 0.
        let level =
            pair_angles([0.0; 3], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]).unwrap();
        for v in level {
            assert!((v - 0.5).abs() < 1e-6, "{level:?}");
        }
        // The second normal tilted 45° away: the source is the tilted one (closer to the line), so the
        // frame is u = (1,0,1)/√2, d = (−1,0,0), φ = −1/√2; θ is the quarter turn's half, ±45°.
        let s = 0.5f32.sqrt();
        let [theta, alpha, phi] =
            pair_angles([0.0; 3], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [s, 0.0, s]).unwrap();
        assert!((alpha - 0.5).abs() < 1e-6);
        assert!((phi - (1.0 - s) * 0.5).abs() < 1e-6);
        let angle = ((theta - 0.5) * 2.0 * std::f32::consts::PI).abs();
        assert!((angle - std::f32::consts::FRAC_PI_4).abs() < 1e-5);
        // No frame where the line runs along the normal, or without a line.
        assert!(pair_angles([0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).is_none());
        assert!(pair_angles([0.0; 3], [1.0, 0.0, 0.0], [0.0; 3], [1.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn bins_are_those_of_the_floor() {
        let frame = [1.0; BATCH];
        for i in 0..=22_000 {
            let unit = i as f32 / 22_000.0;
            let expected = ((unit * BINS as f32).floor() as u32).min(BINS as u32 - 1);
            assert_eq!(bins(&[unit; BATCH], &frame)[0], expected, "{unit}");
        }
        for (unit, bin) in [(-0.1, 0), (1.1, 10), (f32::NAN, 10)] {
            assert_eq!(bins(&[unit; BATCH], &frame)[3], bin, "{unit}");
        }
        assert_eq!(bins(&[0.5; BATCH], &[0.0; BATCH])[3], 15);
    }

    #[test]
    fn unsigned_descriptors_do_not_see_the_signs() {
        let s = surface(&drift(30_000, 10.0, 0.3, 0.0, 1), 0.2);
        let keypoints: Vec<u32> = (0..s.points.len() as u32).step_by(37).collect();
        let mut rng = Rng::new(9, 0);
        let flipped: Vec<[f32; 3]> = s
            .normals
            .iter()
            .map(|n| if rng.below(2) == 0 { n.map(|c| -c) } else { *n })
            .collect();
        let c = config(DescriptorVariant::Pcl, true);
        let a = descriptors(&s.points, &s.normals, &s.tree, &keypoints, &c, s.voxel);
        assert_eq!(
            a,
            descriptors(&s.points, &flipped, &s.tree, &keypoints, &c, s.voxel)
        );
        let signed = config(DescriptorVariant::Pcl, false);
        let b = descriptors(&s.points, &s.normals, &s.tree, &keypoints, &signed, s.voxel);
        assert_ne!(
            b,
            descriptors(&s.points, &flipped, &s.tree, &keypoints, &signed, s.voxel)
        );
    }

    #[test]
    fn parts_sum_to_a_hundred_and_zero_normals_to_nothing() {
        let mut s = surface(&drift(20_000, 8.0, 0.3, 0.0, 1), 0.2);
        s.normals.to_mut()[5] = [0.0; 3];
        for variant in [DescriptorVariant::Pcl, DescriptorVariant::Paper] {
            let d = descriptors(
                &s.points,
                &s.normals,
                &s.tree,
                &[3, 5, 90],
                &config(variant, false),
                s.voxel,
            );
            assert_eq!(d[1], [0.0; DIMENSIONS]);
            for part in d[0].chunks(BINS).chain(d[2].chunks(BINS)) {
                assert!((part.iter().sum::<f32>() - 100.0).abs() < 1e-3);
            }
        }
        assert!(
            descriptors(
                &[],
                &[],
                &KdTree::build(&[]),
                &[],
                &config(DescriptorVariant::Pcl, false),
                0.1
            )
            .is_empty()
        );
    }

    #[test]
    fn a_turned_cloud_has_the_same_descriptors() {
        let points = drift(30_000, 10.0, 0.3, 0.0, 1);
        let pose = crate::Pose::from_rotation_vector([0.3, -1.0, 0.7], [4.0, 5.0, 6.0]);
        let turned: Vec<[f64; 3]> = points.iter().map(|p| pose.transform(*p)).collect();
        let describe = |p: &[[f64; 3]]| {
            let p: Vec<[f32; 3]> = p.iter().step_by(4).map(|p| p.map(|v| v as f32)).collect();
            let tree = KdTree::build(&p);
            let mut n = crate::normals::estimate(
                &p,
                &tree,
                crate::normals::Neighbourhood {
                    radius: 0.6,
                    least: 0,
                    most: 0,
                },
            );
            crate::normals::orient_open_side(&p, &mut n, &tree, 4.0);
            descriptors(
                &p,
                &n,
                &tree,
                &[10, 200, 3000],
                &config(DescriptorVariant::Paper, false),
                0.1,
            )
        };
        for (a, b) in describe(&points).iter().zip(describe(&turned)) {
            let l1: f32 = a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum();
            assert!(l1 < 6.0, "{l1} of 300");
        }
    }
}
