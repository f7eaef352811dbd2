//! Principal axes of descriptors, and coordinates along them.

use super::{COORDINATES, Seen, is_usable};
use crate::fpfh::{DIMENSIONS, Descriptor};
use crate::parallel;
use crate::simd;
use crate::symmetric::eigen;

/// Descriptors that the axes are computed from, at most: evenly drawn ones show them as well.
const SAMPLE: usize = 2048;
/// Axes; the last coordinate is the length of the rest.
const AXES: usize = COORDINATES - 1;
/// Rounds of orthogonal iteration. Any orthonormal axes would do: with more, hardly fewer descriptors are compared.
const ROUNDS: usize = 4;

/// Sums over usable descriptors, relative to some origin.
struct Moments {
    count: f64,
    sum: [f64; DIMENSIONS],
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
            for j in 0..DIMENSIONS {
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
                simd::wide(
                    #[inline(always)]
                    || {
                        for a in 0..DIMENSIONS {
                            for b in 0..DIMENSIONS {
                                m.products[a][b] += d[a] * d[b];
                            }
                        }
                    },
                );
            }
        },
        add,
    );
    #[expect(
        clippy::cast_possible_truncation,
        reason = "components of unit vectors"
    )]
    let widest = axes(scatter.products).map(|a| a.map(|v| v as f32));
    std::iter::once(centre).chain(widest).collect()
}

/// Orthonormal axes that hold most of a scatter matrix, widest first: the space that a few rounds of orthogonal
/// iteration find, and the principal axes within it.
fn axes(mut scatter: [[f64; DIMENSIONS]; DIMENSIONS]) -> [[f64; DIMENSIONS]; AXES] {
    let mut widest: [usize; DIMENSIONS] = std::array::from_fn(|i| i);
    widest.sort_by(|&a, &b| scatter[b][b].total_cmp(&scatter[a][a]));
    let mut axes: [[f64; DIMENSIONS]; AXES] = std::array::from_fn(|a| unit(widest[a]));
    let size: f64 = (0..DIMENSIONS).map(|i| scatter[i][i]).sum();
    if !(size > 0.0) {
        return axes;
    }
    for v in scatter.as_flattened_mut() {
        *v /= size;
    }
    let times = |axis: &[f64; DIMENSIONS]| {
        let mut out = [0.0; DIMENSIONS];
        for (row, v) in scatter.iter().zip(axis) {
            for (out, x) in out.iter_mut().zip(row) {
                *out += x * v;
            }
        }
        out
    };
    for _ in 0..ROUNDS {
        axes = orthonormal(axes.each_ref().map(times));
    }
    let turned = axes.each_ref().map(times);
    let found = eigen::<AXES>(std::array::from_fn(|i| {
        std::array::from_fn(|j| dot(&axes[i.max(j)], &turned[i.min(j)]))
    }));
    std::array::from_fn(|k| {
        let mut out = [0.0; DIMENSIONS];
        for (axis, share) in axes.iter().zip(found.vectors[AXES - 1 - k]) {
            along(&mut out, axis, share);
        }
        out
    })
}

/// The vectors, each freed of its parts along those before it, at length 1. One that has nothing left is replaced.
fn orthonormal(mut vectors: [[f64; DIMENSIONS]; AXES]) -> [[f64; DIMENSIONS]; AXES] {
    for a in 0..AXES {
        let (before, rest) = vectors.split_at_mut(a);
        let vector = &mut rest[0];
        let whole = dot(vector, vector);
        // Twice is enough.
        let clear = |v: &mut [f64; DIMENSIONS]| {
            for b in before.iter().chain(&*before) {
                let share = -dot(v, b);
                along(v, b, share);
            }
            dot(v, v)
        };
        let mut left = clear(vector);
        if !(left > 1e-24 * whole) || !(left > 1e-200) {
            let share = |i: usize| before.iter().map(|b| b[i] * b[i]).sum::<f64>();
            let freest = (1..DIMENSIONS).fold(0, |f, i| if share(i) < share(f) { i } else { f });
            *vector = unit(freest);
            left = clear(vector);
        }
        let length = left.sqrt();
        for v in vector {
            *v /= length;
        }
    }
    vectors
}

fn unit(i: usize) -> [f64; DIMENSIONS] {
    std::array::from_fn(|j| f64::from(u8::from(i == j)))
}

fn dot(a: &[f64; DIMENSIONS], b: &[f64; DIMENSIONS]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Adds `share` times `axis`.
fn along(to: &mut [f64; DIMENSIONS], axis: &[f64; DIMENSIONS], share: f64) {
    for (to, v) in to.iter_mut().zip(axis) {
        *to += share * v;
    }
}

/// Descriptors projected side by side.
pub(super) const GROUP: usize = 16;

/// Coordinates of descriptors in a frame, and their distances from the centre.
pub(super) fn project(frame: &[Descriptor], descriptors: [&Descriptor; GROUP]) -> [Seen; GROUP] {
    let Some((centre, axes)) = frame.split_first() else {
        return [Seen::default(); GROUP];
    };
    let mut lanes = [[0.0f32; COORDINATES + 1]; GROUP];
    simd::wide(
        #[inline(always)]
        || project_lanes(centre, axes, descriptors, &mut lanes),
    );
    lanes.map(|lane| Seen {
        at: std::array::from_fn(|c| lane[c]),
        reach: lane[COORDINATES],
    })
}

#[inline(always)]
fn project_lanes(
    centre: &Descriptor,
    axes: &[Descriptor],
    descriptors: [&Descriptor; GROUP],
    out: &mut [[f32; COORDINATES + 1]; GROUP],
) {
    let mut offset = [[0.0f32; GROUP]; DIMENSIONS];
    for (l, d) in descriptors.into_iter().enumerate() {
        for c in 0..DIMENSIONS {
            offset[c][l] = d[c] - centre[c];
        }
    }
    let mut shares = [[0.0f32; GROUP]; AXES];
    for (axis, share) in axes.iter().zip(&mut shares) {
        let mut sum = [0.0f32; GROUP];
        for c in 0..DIMENSIONS {
            for l in 0..GROUP {
                sum[l] += axis[c] * offset[c][l];
            }
        }
        *share = sum;
    }
    // Squares of what is large do not fit 32 bits.
    let (mut rest2, mut reach2) = ([0.0f64; GROUP], [0.0f64; GROUP]);
    for c in 0..DIMENSIONS {
        let mut rest = offset[c];
        for (axis, share) in axes.iter().zip(&shares) {
            for l in 0..GROUP {
                rest[l] -= axis[c] * share[l];
            }
        }
        for l in 0..GROUP {
            let (r, o) = (f64::from(rest[l]), f64::from(offset[c][l]));
            rest2[l] += r * r;
            reach2[l] += o * o;
        }
    }
    #[expect(clippy::cast_possible_truncation, reason = "lengths may be rounded")]
    for (l, out) in out.iter_mut().enumerate() {
        for a in 0..AXES {
            out[a] = shares[a][l];
        }
        out[AXES] = rest2[l].sqrt() as f32;
        out[COORDINATES] = reach2[l].sqrt() as f32;
    }
}

fn offset(centre: &Descriptor, d: &Descriptor) -> [f64; DIMENSIONS] {
    std::array::from_fn(|c| f64::from(d[c]) - f64::from(centre[c]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    /// Orthonormal they must be, whatever the scatter: answers hang on it.
    fn check(scatter: [[f64; DIMENSIONS]; DIMENSIONS]) -> [[f64; DIMENSIONS]; AXES] {
        let found = axes(scatter);
        for a in 0..AXES {
            for b in 0..=a {
                let expected = if a == b { 1.0 } else { 0.0 };
                assert!((dot(&found[a], &found[b]) - expected).abs() < 1e-13);
            }
        }
        found
    }

    #[test]
    fn the_widest_axes_of_a_known_scatter() {
        // Variances 2⁻ⁱ along the coordinates, in some order.
        let at = |i: usize| (i * 7) % DIMENSIONS;
        let mut scatter = [[0.0; DIMENSIONS]; DIMENSIONS];
        for i in 0..DIMENSIONS {
            scatter[at(i)][at(i)] = 0.5f64.powi(i as i32);
        }
        for (i, axis) in check(scatter).iter().enumerate() {
            assert!((axis[at(i)].abs() - 1.0).abs() < 1e-9, "{i} {axis:?}");
        }
    }

    #[test]
    fn orthonormal_where_the_scatter_is_flat_huge_or_nothing() {
        let mut rng = Rng::new(1, 0);
        for (rank, scale) in [
            (0, 1.0),
            (1, 1.0),
            (3, 1e-60),
            (5, 1e60),
            (20, 1.0),
            (40, 1e-9),
        ] {
            let mut scatter = [[0.0; DIMENSIONS]; DIMENSIONS];
            for _ in 0..rank {
                let v: [f64; DIMENSIONS] = std::array::from_fn(|_| rng.normal());
                for i in 0..DIMENSIONS {
                    for j in 0..DIMENSIONS {
                        scatter[i][j] += scale * v[i] * v[j];
                    }
                }
            }
            check(scatter);
        }
    }
}
