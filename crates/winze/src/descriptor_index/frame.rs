//! Principal axes of descriptors, and coordinates along them.

use super::{COORDINATES, is_usable};
use crate::fpfh::{DIMENSIONS, Descriptor};
use crate::parallel;
use crate::symmetric::eigen;

/// Descriptors that the axes are computed from, at most: evenly drawn ones show them as well.
const SAMPLE: usize = 65_536;

/// Sums over usable descriptors, relative to some origin.
struct Moments {
    count: f64,
    sum: [f64; DIMENSIONS],
    /// Lower triangle alone.
    products: [[f64; DIMENSIONS]; DIMENSIONS],
}

impl Default for Moments {
    fn default() -> Self {
        Self {
            count: 0.0,
            sum: [0.0; DIMENSIONS],
            products: [[0.0; DIMENSIONS]; DIMENSIONS],
        }
    }
}

/// The centre of `descriptors`, then their principal axes, widest first: [`COORDINATES`] rows.
pub(super) fn frame(descriptors: &[Descriptor]) -> Vec<Descriptor> {
    let step = descriptors.len().div_ceil(SAMPLE).max(1);
    let drawn = descriptors.len().div_ceil(step);
    let usable = |i: usize| Some(&descriptors[i * step]).filter(|d| is_usable(d));
    let add = |t: &mut Moments, m: Moments| {
        t.count += m.count;
        for i in 0..DIMENSIONS {
            t.sum[i] += m.sum[i];
            for j in 0..=i {
                t.products[i][j] += m.products[i][j];
            }
        }
    };
    let first = parallel::sum(
        drawn,
        |m: &mut Moments, i| {
            if let Some(d) = usable(i) {
                m.count += 1.0;
                for c in 0..DIMENSIONS {
                    m.sum[c] += f64::from(d[c]);
                }
            }
        },
        add,
    );
    #[expect(clippy::cast_possible_truncation, reason = "any centre will do")]
    let centre = first.sum.map(|s| (s / first.count.max(1.0)) as f32);
    let scatter = parallel::sum(
        drawn,
        |m: &mut Moments, i| {
            if let Some(d) = usable(i) {
                let d = offset(&centre, d);
                for a in 0..DIMENSIONS {
                    for b in 0..=a {
                        m.products[a][b] += d[a] * d[b];
                    }
                }
            }
        },
        add,
    );
    let full =
        std::array::from_fn(|i| std::array::from_fn(|j| scatter.products[i.max(j)][i.min(j)]));
    let axes = eigen::<DIMENSIONS>(full).vectors;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "components of unit vectors"
    )]
    let widest = axes.iter().rev().map(|a| a.map(|v| v as f32));
    std::iter::once(centre)
        .chain(widest)
        .take(COORDINATES)
        .collect()
}

/// Coordinates of `d` in a frame, and its distance from the centre.
pub(super) fn project(frame: &[Descriptor], d: &Descriptor) -> ([f32; COORDINATES], f32) {
    let mut out = [0.0f32; COORDINATES];
    let Some((centre, axes)) = frame.split_first() else {
        return (out, 0.0);
    };
    let offset = offset(centre, d);
    let mut rest = offset;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "coordinates may be rounded"
    )]
    for (axis, out) in axes.iter().zip(&mut out) {
        let mut along = 0.0;
        for c in 0..DIMENSIONS {
            along += f64::from(axis[c]) * offset[c];
        }
        for c in 0..DIMENSIONS {
            rest[c] -= f64::from(axis[c]) * along;
        }
        *out = along as f32;
    }
    out[COORDINATES - 1] = length(&rest);
    (out, length(&offset))
}

fn offset(centre: &Descriptor, d: &Descriptor) -> [f64; DIMENSIONS] {
    std::array::from_fn(|c| f64::from(d[c]) - f64::from(centre[c]))
}

#[expect(clippy::cast_possible_truncation, reason = "lengths may be rounded")]
fn length(v: &[f64; DIMENSIONS]) -> f32 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt() as f32
}
