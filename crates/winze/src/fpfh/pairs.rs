//! The features of pairs of points, and a point's own histogram of them.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16, u8x64};

use super::{BINS, DIMENSIONS, Descriptor};
use crate::neighbours::{LANES, offsets};

/// Bins of a list that are counted together.
pub(super) const BYTES: usize = 64;

#[inline(always)]
pub(super) fn histograms<const UNSIGNED: bool, S: Simd>(
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
pub(super) const BATCH: usize = LANES;

/// Neighbours as lines from the point and normals, an array an axis, so that the loop over them
/// vectorises.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) line: [[f32; BATCH]; 3],
    pub(super) normal: [[f32; BATCH]; 3],
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
    pub(super) fn angles<const UNSIGNED: bool>(&self, n: [f32; 3]) -> Angles {
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
            let mut upright = dot(cross(line, n), m);
            if UNSIGNED && c == 0.0 {
                // At right angles, neither normal lies on the side of the other.
                upright = upright.abs();
            }
            out.alpha[k] = (upright / norm + 1.0) * 0.5;
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
pub(super) struct Angles {
    pub(super) theta: [f32; BATCH],
    pub(super) alpha: [f32; BATCH],
    pub(super) phi: [f32; BATCH],
    /// 0 where a pair has no frame.
    pub(super) frame: [f32; BATCH],
}

/// The bins of values scaled to `[0, 1]`; one that nobody reads for pairs without a frame.
#[inline(always)]
pub(super) fn bins(unit: &[f32; BATCH], frame: &[f32; BATCH]) -> [u32; BATCH] {
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
pub(super) fn atan2(y: f32, x: f32) -> f32 {
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
