//! What is done with everything around a group of points.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16};

use super::pairs::{BYTES, histograms};
use super::{BINS, DIMENSIONS, Described, Descriptor};
use crate::config::DescriptorVariant;
use crate::neighbours::{LANES, Neighbours, offsets};
use crate::simd::{bits, level};

/// Marks, a bit each, the places within `radius` of `q`.
pub(super) fn mark(axes: [&[f32]; 3], q: [f32; 3], radius: f32, within: &mut [u64]) {
    dispatch!(level(), simd => simd.vectorize(
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
pub(super) struct Search {
    pub(super) near: Neighbours,
    /// Of what was gathered: which of a block of places are near.
    pub(super) within: Vec<u64>,
    /// Of what was gathered: normals, an array an axis; NaN where undefined.
    normals: [Vec<f32>; 3],
    /// Of what was gathered: where its SPFH is.
    slots: Vec<u32>,
    /// Bins of a point's pairs, a list an angle.
    bins: [Vec<u8>; 3],
}

impl Search {
    pub(super) fn take_normals(&mut self, cloud: &Described<'_>) {
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

    pub(super) fn take_slots(&mut self, slot: &[u32]) {
        let (places, _) = self.near.gathered();
        self.slots.clear();
        let slots = places.iter().map(|place| slot[*place as usize]);
        self.slots.extend(slots);
    }

    /// The simplified histogram of a point at `q` with normal `n`: its pairs with all neighbours, each part summing to 100
    /// (less where a pair has no frame).
    pub(super) fn spfh(
        &mut self,
        q: [f32; 3],
        n: [f32; 3],
        radius: f32,
        unsigned: bool,
    ) -> Descriptor {
        let (_, axes) = self.near.gathered();
        let normals = self.normals.each_ref().map(|a| &a[..]);
        let limit = radius * radius;
        for bins in &mut self.bins {
            bins.resize(axes[0].len().next_multiple_of(BYTES), 0);
        }
        let bins = &mut self.bins;
        dispatch!(level(), simd => simd.vectorize(
            #[inline(always)]
            || if unsigned {
                histograms::<true, _>(simd, axes, normals, (q, n), limit, bins)
            } else {
                histograms::<false, _>(simd, axes, normals, (q, n), limit, bins)
            }
        ))
    }

    /// The weighted sum of the SPFHs around `q`, and how many these are.
    pub(super) fn weighed(
        &self,
        spfh: &[Descriptor],
        q: [f32; 3],
        radius: f32,
        variant: DescriptorVariant,
    ) -> (Descriptor, u32) {
        let (_, axes) = self.near.gathered();
        let (slots, limit) = (&self.slots[..], radius * radius);
        dispatch!(level(), simd => simd.vectorize(
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
    // So near that one over it would be no number.
    let same = f32x16::splat(simd, 1e-30);
    let (mut first, mut second, mut last, mut count) = (zero, zero, 0.0f32, 0);
    for (b, slots) in slots.chunks(LANES).enumerate() {
        let (_, d2) = offsets(simd, axes, b, q);
        let within = d2.simd_le(limit).to_bitmask() & d2.simd_gt(same).to_bitmask();
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
pub(super) fn finished(
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
