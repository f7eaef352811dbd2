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

use rayon::prelude::*;

use crate::columns::{Columns, Memory};
use crate::config::{DescriptorVariant, FpfhConfig};
use crate::kdtree::{KdTree, Neighbour};
use crate::neighbours::{GROUP, Neighbours};
use crate::parallel;
use crate::simd;

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
    // Where a point's SPFH is found in its block, one up; 0 for none.
    let mut slot = columns.zeros::<u32>(points.len())?;
    for (keypoints, out) in keypoints.chunks(BLOCK).zip(out.chunks_mut(BLOCK)) {
        // SPFHs are wanted at the keypoints and all their neighbours, each once.
        let at = |k: &u32| points[*k as usize];
        let mut near: Vec<Vec<Neighbour>> = vec![Vec::new(); keypoints.len()];
        // Keypoints lie apart: fewer of them share a walk.
        parallel::fill_groups(
            &mut near,
            GROUP / 4,
            Neighbours::default,
            |near, group| near.gather(tree, radius, keypoints[group].iter().map(at)),
            |near, k| near.of(tree, at(&keypoints[k])).to_vec(),
        );
        let mut needed: Vec<u32> = Vec::new();
        for n in near.iter().flatten() {
            let slot = &mut slot[n.index as usize];
            if *slot == 0 {
                *slot = 1;
                needed.push(n.index);
            }
        }
        // In memory order, so that those that follow each other share their neighbours.
        needed.sort_unstable();
        for (place, i) in (1u32..).zip(&needed) {
            slot[*i as usize] = place;
        }
        let mut spfh = vec![[0.0; DIMENSIONS]; needed.len()];
        parallel::fill_groups(
            &mut spfh,
            GROUP,
            Neighbours::default,
            |near, group| near.gather(tree, radius, needed[group].iter().map(at)),
            |near, s| {
                let i = needed[s] as usize;
                let found = near.of(tree, points[i]);
                self::spfh(points, normals, i, found, config.unsigned)
            },
        );
        let of = |i: u32| spfh.get((slot[i as usize] as usize).checked_sub(1)?);
        out.par_iter_mut()
            .zip(keypoints)
            .zip(&near)
            .for_each(|((out, &k), list)| {
                if normals[k as usize] == [0.0; 3] {
                    return;
                }
                // A point that is not even its own neighbour has no number for a place.
                let Some(own) = of(k) else {
                    return;
                };
                let others = list
                    .iter()
                    .filter(|n| n.index != k && normals[n.index as usize] != [0.0; 3])
                    .filter_map(|n| Some((n.distance_squared, of(n.index)?)));
                *out = weigh(own, others, config.variant);
            });
        for i in needed {
            slot[i as usize] = 0;
        }
    }
    Ok(out)
}

/// Sums neighbours' SPFHs, given with their squared distances, into one FPFH.
fn weigh<'a>(
    own: &Descriptor,
    others: impl Iterator<Item = (f32, &'a Descriptor)>,
    variant: DescriptorVariant,
) -> Descriptor {
    let mut sum = [0.0f32; DIMENSIONS];
    let mut count = 0.0f32;
    for (d2, spfh) in others {
        if d2 <= 0.0 {
            continue;
        }
        let weight = match variant {
            DescriptorVariant::Paper => 1.0 / d2.sqrt(),
            DescriptorVariant::Pcl | DescriptorVariant::Open3d => 1.0 / d2,
        };
        count += 1.0;
        for (s, v) in sum.iter_mut().zip(spfh) {
            *s += weight * v;
        }
    }
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

/// The simplified histogram of point `i`: its pairs with all neighbours, each part summing to 100
/// (less where a pair has no frame).
fn spfh(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    i: usize,
    neighbours: &[Neighbour],
    unsigned: bool,
) -> Descriptor {
    let mut counts = Counts::default();
    if normals[i] == [0.0; 3] {
        return [0.0; DIMENSIONS];
    }
    let others = simd::wide(
        #[inline(always)]
        || {
            if unsigned {
                count_pairs::<true>(points, normals, i, neighbours, &mut counts)
            } else {
                count_pairs::<false>(points, normals, i, neighbours, &mut counts)
            }
        },
    );
    #[expect(clippy::cast_precision_loss, reason = "counts of neighbours")]
    let scale = 100.0 / others.max(1) as f32;
    #[expect(clippy::cast_precision_loss, reason = "counts of neighbours")]
    std::array::from_fn(|k| {
        let (part, bin) = (k / BINS, k % BINS);
        counts.iter().map(|c| c[part][bin]).sum::<u32>() as f32 * scale
    })
}

/// Counts the pairs of point `i` with those neighbours that have a normal, and tells how many these are.
#[inline(always)]
fn count_pairs<const UNSIGNED: bool>(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    i: usize,
    neighbours: &[Neighbour],
    counts: &mut Counts,
) -> u32 {
    let (p, n) = (points[i], normals[i]);
    let mut batch = Batch::default();
    let (mut others, mut held) = (0u32, 0);
    for j in neighbours.iter().map(|n| n.index as usize) {
        let (q, m) = (points[j], normals[j]);
        if j == i || m == [0.0; 3] {
            continue;
        }
        others += 1;
        for a in 0..3 {
            batch.line[a][held] = q[a] - p[a];
            batch.normal[a][held] = m[a];
        }
        held += 1;
        if held == BATCH {
            batch.count::<UNSIGNED>(n, held, counts);
            held = 0;
        }
    }
    batch.count::<UNSIGNED>(n, held, counts);
    others
}

/// Slots of a histogram: its bins, and some that nobody reads.
const SLOTS: usize = 16;

/// Three histograms, twice: pairs take turns, so that one need not wait for the other's sum.
type Counts = [[[u32; SLOTS]; 3]; 2];

/// Neighbours whose angles are worked out side by side.
const BATCH: usize = 16;

/// Neighbours as lines from the point and normals, an array an axis, so that the loop over them
/// vectorises.
#[derive(Default)]
struct Batch {
    line: [[f32; BATCH]; 3],
    normal: [[f32; BATCH]; 3],
}

impl Batch {
    /// Counts the first `held` pairs with a point of normal `n` into their bins.
    #[inline(always)]
    fn count<const UNSIGNED: bool>(&self, n: [f32; 3], held: usize, counts: &mut Counts) {
        let angles = self.angles::<UNSIGNED>(n);
        let bins = [
            bins(&angles.theta, &angles.frame),
            bins(&angles.alpha, &angles.frame),
            bins(&angles.phi, &angles.frame),
        ];
        for k in 0..held.min(BATCH) {
            let counts = &mut counts[k % 2];
            for part in 0..3 {
                counts[part][bins[part][k] as usize % SLOTS] += 1;
            }
        }
    }

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
            crate::normals::orient_open_side(&p, &mut n, &tree, &p, 4.0);
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
