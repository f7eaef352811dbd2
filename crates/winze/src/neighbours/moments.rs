//! Sums over the neighbours of a point.

use fearless_simd::prelude::*;
use fearless_simd::{Simd, f32x16};

use super::{LANES, offsets};
use crate::eigen3::Symmetric3;
use crate::kdtree::Neighbour;

/// Sums over neighbours of a point, of their offsets from it and of these offsets' products.
///
/// Each is summed in [`LANES`] lanes, a neighbour in that of its place among all that the group has gathered, and the lanes
/// are then added in pairs: an order that hangs on points and tree alone.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Moments {
    /// How many neighbours there are, the point itself among them.
    pub(crate) count: u32,
    /// x, y, z.
    pub(crate) sum: [f64; 3],
    /// xx, xy, xz, yy, yz, zz.
    pub(crate) square: [f64; 6],
}

impl Moments {
    /// Over neighbours of `q` that were looked up, one after the other in 64 bits: they may be anywhere.
    pub(crate) fn of(points: &[[f32; 3]], q: [f32; 3], neighbours: &[Neighbour]) -> Self {
        let mut out = Self::default();
        for n in neighbours {
            let p = points[n.index as usize];
            let [x, y, z]: [f64; 3] = std::array::from_fn(|a| f64::from(p[a]) - f64::from(q[a]));
            out.count += 1;
            let products = [x * x, x * y, x * z, y * y, y * z, z * z];
            out.sum.iter_mut().zip([x, y, z]).for_each(|(s, v)| *s += v);
            out.square
                .iter_mut()
                .zip(products)
                .for_each(|(s, v)| *s += v);
        }
        out
    }

    /// Covariance (divided by the count) about the neighbourhood's own mean. Offsets are from one of its points: raw
    /// coordinates squared would lose all their digits.
    pub(crate) fn covariance(&self) -> Symmetric3 {
        let inverse = 1.0 / f64::from(self.count.max(1));
        let [x, y, z] = self.sum.map(|v| v * inverse);
        let means = [x * x, x * y, x * z, y * y, y * z, z * z];
        std::array::from_fn(|e| self.square[e] * inverse - means[e])
    }

    /// Second moment (divided by the count) about the point itself.
    pub(crate) fn scatter(&self) -> Symmetric3 {
        let inverse = 1.0 / f64::from(self.count.max(1));
        self.square.map(|v| v * inverse)
    }
}

/// Blocks that are summed in 32 bits before they go to a sum in 64, which any number of neighbours fits.
const BLOCKS: u32 = 64;

/// What becomes [`Moments`], in lanes.
pub(super) struct Sums<S: Simd> {
    /// Of the blocks before the last few.
    earlier: Moments,
    /// Blocks that are in the lanes.
    blocks: u32,
    count: u32,
    sum: [f32x16<S>; 3],
    square: [f32x16<S>; 6],
}

impl<S: Simd> Sums<S> {
    #[inline(always)]
    pub(super) fn zero(simd: S) -> Self {
        let zero = f32x16::splat(simd, 0.0);
        Self {
            earlier: Moments::default(),
            blocks: 0,
            count: 0,
            sum: [zero; 3],
            square: [zero; 6],
        }
    }

    /// Adds what of a block of places lies no further than `√limit` from `q`.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        simd: S,
        axes: [&[f32]; 3],
        block: usize,
        q: [f32; 3],
        limit: f32,
    ) {
        let ([x, y, z], d2) = offsets(simd, axes, block, q);
        let within = d2.simd_le(f32x16::splat(simd, limit));
        let bits = within.to_bitmask();
        if bits == 0 {
            return;
        }
        let zero = f32x16::splat(simd, 0.0);
        let x = within.select(x, zero);
        let y = within.select(y, zero);
        let z = within.select(z, zero);
        self.count += bits.count_ones();
        self.sum[0] += x;
        self.sum[1] += y;
        self.sum[2] += z;
        self.square[0] += x * x;
        self.square[1] += x * y;
        self.square[2] += x * z;
        self.square[3] += y * y;
        self.square[4] += y * z;
        self.square[5] += z * z;
        self.blocks += 1;
        if self.blocks == BLOCKS {
            *self = Self {
                earlier: self.total(),
                ..Self::zero(simd)
            };
        }
    }

    #[inline(always)]
    pub(super) fn total(&self) -> Moments {
        let (before, sum, square) = (&self.earlier, self.sum, self.square);
        Moments {
            count: before.count + self.count,
            sum: [
                before.sum[0] + total(sum[0]),
                before.sum[1] + total(sum[1]),
                before.sum[2] + total(sum[2]),
            ],
            square: [
                before.square[0] + total(square[0]),
                before.square[1] + total(square[1]),
                before.square[2] + total(square[2]),
                before.square[3] + total(square[3]),
                before.square[4] + total(square[4]),
                before.square[5] + total(square[5]),
            ],
        }
    }
}

/// The sum of a vector's lanes, in pairs, for sums in 64 bits.
#[inline(always)]
pub(super) fn total<S: Simd>(v: f32x16<S>) -> f64 {
    f64::from(lanes_in_pairs(v))
}

/// The sum of a vector's lanes, in pairs.
#[inline(always)]
pub(super) fn lanes_in_pairs<S: Simd>(v: f32x16<S>) -> f32 {
    let mut v: [f32; LANES] = v.into();
    let mut width = LANES / 2;
    while width > 0 {
        for k in 0..width {
            v[k] += v[k + width];
        }
        width /= 2;
    }
    v[0]
}
