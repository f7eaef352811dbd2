//! Intrinsic shape signatures: keypoints where the surface varies in all three directions
//! (Zhong 2009; the paper's equation 1).
//!
//! For each point the scatter of its neighbours within the salient radius has eigenvalues
//! λ1 ≥ λ2 ≥ λ3. A point qualifies where λ3 exceeds a threshold (there is relief) and
//! λ2/λ1 < γ21 and λ3/λ2 < γ32 (no two directions are alike, so that a frame could be fixed). The
//! paper prints the ratios with eigenvalues in ascending order, which contradicts its own
//! words, "to exclude points with two similar eigenvalues"; the words are the original method,
//! PCL's and Open3D's, and ours.
//!
//! The scatter is divided by the neighbours' weight and λ3 by the squared radius, so that
//! thresholds depend neither on point density nor on scale. Of the points that qualify one a cell is
//! kept, the one of the largest λ3 (the saliency).
//!
//! Rough rock is rough everywhere and often passes or fails as a whole. Where fewer than
//! [`IssConfig::min_keypoints`] qualify, the most salient of the other points with relief fill the
//! budget, cell by cell; [`Keypoints::qualified`] tells how many came from the test itself.

use std::cmp::Reverse;

use fearless_simd::prelude::*;
use fearless_simd::{Simd, dispatch, f32x16};
use rayon::prelude::*;

use crate::columns::{Columns, Memory};
use crate::config::{IssCentre, IssConfig};
use crate::eigen3::{BATCH, Symmetric3, eigen3, solve};
use crate::kdtree::{KdTree, Neighbour};
use crate::neighbours::{GROUP, LANES, Neighbours, offsets};
use crate::parallel;
use crate::simd;
use crate::voxel::{FINEST, Grid, pack};

/// Keypoints of one cloud.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Keypoints {
    /// Indices into the cloud, ascending.
    pub indices: Vec<u32>,
    /// λ3 over the squared salient radius of each.
    pub saliency: Vec<f32>,
    /// How many passed the test; the rest were filled in by saliency alone.
    pub qualified: usize,
}

/// What the test says of one point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Saliency {
    /// λ3 over the squared salient radius; 0 where there are too few neighbours.
    pub value: f32,
    /// The threshold and both ratios hold.
    pub qualifies: bool,
}

/// ISS keypoints of `points` at the pipeline's `voxel` size (metres).
#[must_use]
pub fn keypoints(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    config: &IssConfig,
    voxel: f64,
) -> Keypoints {
    let most = config.max_keypoints;
    let Ok(found) = keypoints_in(points, tree, config, most, voxel, &Memory);
    Keypoints {
        indices: found.indices,
        saliency: found.saliency,
        qualified: found.qualified,
    }
}

/// The columns of keypoints just found, see [`Keypoints`].
pub struct KeypointColumns<C: Columns> {
    /// Indices into the cloud, ascending.
    pub indices: C::Column<u32>,
    /// λ3 over the squared salient radius of each.
    pub saliency: C::Column<f32>,
    /// How many passed the test.
    pub qualified: usize,
}

/// As [`keypoints`], but at most `most` (0: no limit), in `columns`.
///
/// # Errors
/// Where a column cannot be had.
pub fn keypoints_in<C: Columns>(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    config: &IssConfig,
    most: usize,
    voxel: f64,
    columns: &C,
) -> Result<KeypointColumns<C>, C::Error> {
    let saliency = coded_saliency(points, tree, config, voxel, columns)?;
    let mut chosen = cell_winners(tree, &saliency, config, voxel, columns)?;
    // Those that pass the test first, then the most salient; ties by index.
    let rank = |i: u32| {
        let s = Saliency::decoded(saliency[i as usize]);
        (!s.qualifies, Reverse(s.value.to_bits()), i)
    };
    chosen.sort_unstable_by_key(|i| rank(*i));
    let qualifying = chosen.partition_point(|i| !rank(*i).0);
    let limit = if most == 0 { usize::MAX } else { most };
    let qualified = qualifying.min(limit);
    let count = qualified
        .max(config.min_keypoints.min(limit))
        .min(chosen.len());
    chosen[..count].sort_unstable();
    let mut indices = columns.zeros(count)?;
    indices.copy_from_slice(&chosen[..count]);
    let mut values = columns.zeros(count)?;
    for (value, i) in values.iter_mut().zip(indices.iter()) {
        *value = Saliency::decoded(saliency[*i as usize]).value;
    }
    Ok(KeypointColumns {
        indices,
        saliency: values,
        qualified,
    })
}

/// The best point of each cell, in the order of cells: one that passes the test where there is one, else
/// the most salient with relief. Only local maxima take part, where they are asked for.
fn cell_winners<C: Columns>(
    tree: &KdTree<'_>,
    saliency: &[f32],
    config: &IssConfig,
    voxel: f64,
    columns: &C,
) -> Result<C::Column<u32>, C::Error> {
    const NONE: [u64; 2] = [u64::MAX; 2];
    let mut cell = config.cell.metres(voxel);
    if cell > 0.0 {
        cell = cell.max(FINEST);
    }
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let non_max_radius = config.non_max_radius.metres(voxel) as f32;
    let limit = non_max_radius * non_max_radius;
    let mut keyed = columns.zeros::<[u64; 2]>(tree.len())?;
    let (_, [xs, ys, zs]) = tree.parts();
    let at = |place: usize| [xs[place], ys[place], zs[place]];
    let key = |place: usize| {
        let cell = at(place).map(|v| {
            if cell > 0.0 {
                #[expect(clippy::cast_possible_truncation, reason = "saturates")]
                let cell = (f64::from(v) / cell).floor() as i32;
                cell
            } else {
                0
            }
        });
        pack(cell, tree.name(place))
    };
    let own = |place: usize| Saliency::decoded(saliency[tree.name(place) as usize]);
    // Of equal ones the first is the maximum.
    let is_first = |place: usize, own: Saliency| {
        let name = tree.name(place);
        let mut first = true;
        tree.within(at(place), non_max_radius, |j, _| {
            let other = Saliency::decoded(saliency[j as usize]);
            let competes = other.qualifies || !own.qualifies;
            first &= !(competes && other.value == own.value && j < name);
        });
        first
    };
    let search = <(Neighbours, Vec<f32>)>::default;
    parallel::fill_groups(&mut keyed, GROUP, search, |(near, codes), group, keyed| {
        let first = group.start;
        let mut left = group;
        while !left.is_empty() {
            let together = if non_max_radius > 0.0 {
                near.gather(tree, non_max_radius, left.clone(), at)
            } else {
                left.clone()
            };
            left.start = together.end;
            codes.clear();
            for place in together {
                keyed[place - first] = NONE;
                let own = own(place);
                if own.value <= 0.0 {
                    continue;
                }
                if non_max_radius > 0.0 {
                    let (places, axes) = near.gathered();
                    if codes.is_empty() {
                        let name = |p: &u32| tree.name(*p as usize) as usize;
                        codes.extend(places.iter().map(|p| saliency[name(p)]));
                        codes.resize(axes[0].len(), 0.0);
                    }
                    let (higher, alike) = rivals(axes, codes, at(place), limit, own);
                    if higher || (alike > 1 && !is_first(place, own)) {
                        continue;
                    }
                }
                keyed[place - first] = key(place);
            }
        }
    });
    // Those that are none go, before it is sorted.
    let mut count = 0;
    for i in 0..keyed.len() {
        keyed[count] = keyed[i];
        count += usize::from(keyed[i] != NONE);
    }
    let candidates = &mut keyed[..count];
    candidates.par_sort_unstable();
    let candidates = &*candidates;
    let cells = || candidates.chunk_by(|a, b| cell > 0.0 && Grid::same_cell(a, b));
    let mut winners = columns.zeros::<u32>(cells().count())?;
    for (winner, group) in winners.iter_mut().zip(cells()) {
        let better = |a: &Saliency, b: &Saliency| (a.qualifies, a.value) > (b.qualifies, b.value);
        let mut best = (Grid::index(&group[0]), Saliency::NONE);
        for key in group {
            // Ascending indices: of equal ones the first stays.
            let own = Saliency::decoded(saliency[Grid::index(key)]);
            if better(&own, &best.1) {
                best = (Grid::index(key), own);
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
        let index = best.0 as u32;
        *winner = index;
    }
    Ok(winners)
}

impl Saliency {
    const NONE: Self = Self {
        value: 0.0,
        qualifies: false,
    };

    /// As one number, negative where the test fails.
    fn coded(self) -> f32 {
        if self.qualifies {
            self.value
        } else {
            -self.value
        }
    }

    fn decoded(code: f32) -> Self {
        Self {
            value: code.abs(),
            qualifies: code > 0.0,
        }
    }
}

/// The test at every point.
#[must_use]
pub fn saliency(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    config: &IssConfig,
    voxel: f64,
) -> Vec<Saliency> {
    let Ok(coded) = coded_saliency(points, tree, config, voxel, &Memory);
    coded.into_iter().map(Saliency::decoded).collect()
}

fn coded_saliency<C: Columns>(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    config: &IssConfig,
    voxel: f64,
    columns: &C,
) -> Result<C::Column<f32>, C::Error> {
    let radius = config.salient_radius.metres(voxel);
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let r = radius as f32;
    let mut weights = columns.zeros::<f32>(if config.density_weighting {
        points.len()
    } else {
        0
    })?;
    parallel::fill(
        &mut weights,
        || (),
        |(), i| {
            let mut count = 0u32;
            tree.within(points[i], r, |_, _| count += 1);
            #[expect(clippy::cast_precision_loss, reason = "a count")]
            let count = count.max(1) as f32;
            1.0 / count
        },
    );
    let weights = config.density_weighting.then_some(&*weights);
    let mut coded = columns.zeros::<f32>(points.len())?;
    if tree.order().is_empty() {
        code_in_leaf_order(
            &mut coded[..tree.len()],
            points,
            tree,
            config,
            radius,
            weights,
        );
        return Ok(coded);
    }
    let mut made = columns.zeros::<f32>(tree.len())?;
    code_in_leaf_order(&mut made, points, tree, config, radius, weights);
    for (&i, &code) in tree.order().iter().zip(made.iter()) {
        coded[i as usize] = code;
    }
    Ok(coded)
}

/// Of each place in the tree's leaf order, in which points that follow each other are near each other.
fn code_in_leaf_order(
    coded: &mut [f32],
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    config: &IssConfig,
    radius: f64,
    weights: Option<&[f32]>,
) {
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let r = radius as f32;
    let (_, [xs, ys, zs]) = tree.parts();
    let at = |place: usize| [xs[place], ys[place], zs[place]];
    let search = <(Neighbours, Vec<(Symmetric3, usize)>)>::default;
    parallel::fill_groups(coded, GROUP, search, |(near, scatters), group, coded| {
        scatters.clear();
        let mut left = group;
        while !left.is_empty() {
            let together = near.gather(tree, r, left.clone(), at);
            left.start = together.end;
            for q in together.map(at) {
                if weights.is_some() {
                    let found = near.of(tree, q);
                    let scatter = scatter(points, q, found, weights, config.centre);
                    scatters.push((scatter, found.len()));
                } else {
                    let moments = near.moments_within(q);
                    let scatter = match config.centre {
                        IssCentre::Point => moments.scatter(),
                        IssCentre::Centroid => moments.covariance(),
                    };
                    scatters.push((scatter, moments.count as usize));
                }
            }
        }
        for (scatters, coded) in scatters.chunks(BATCH).zip(coded.chunks_mut(BATCH)) {
            let mut batch = [[0.0; BATCH]; 6];
            for (k, (scatter, _)) in scatters.iter().enumerate() {
                (0..6).for_each(|e| batch[e][k] = scatter[e]);
            }
            let solved = simd::wide(
                #[inline(always)]
                || solve(&batch),
            );
            for (k, ((scatter, count), coded)) in scatters.iter().zip(coded).enumerate() {
                let mut values = solved.values.map(|v| v[k]);
                if solved.sure[k] == 0.0 {
                    values = eigen3(scatter).values;
                }
                let enough = *count > config.min_neighbours;
                let saliency = enough.then(|| tested(values, config, radius));
                *coded = saliency.unwrap_or(Saliency::NONE).coded();
            }
        }
    });
}

/// The test of a scatter's eigenvalues, which ascend.
fn tested([l3, l2, l1]: [f64; 3], config: &IssConfig, radius: f64) -> Saliency {
    let relief = l3 / (radius * radius);
    #[expect(clippy::cast_possible_truncation, reason = "a ratio")]
    let value = relief.max(0.0) as f32;
    let qualifies =
        relief > config.min_relief && l2 < config.gamma_21 * l1 && l3 < config.gamma_32 * l2;
    Saliency { value, qualifies }
}

/// The weighted scatter of the neighbours of `q`, divided by their weight. The point itself
/// is among them and counts like the others.
fn scatter(
    points: &[[f32; 3]],
    q: [f32; 3],
    neighbours: &[Neighbour],
    weights: Option<&[f32]>,
    centre: IssCentre,
) -> Symmetric3 {
    let (mut total, mut mean, mut s) = (0.0f64, [0.0f64; 3], [0.0f64; 6]);
    for n in neighbours {
        let j = n.index as usize;
        let w = weights.map_or(1.0, |w| f64::from(w[j]));
        let d: [f64; 3] = std::array::from_fn(|a| f64::from(points[j][a]) - f64::from(q[a]));
        total += w;
        for a in 0..3 {
            mean[a] += w * d[a];
        }
        for (out, (a, b)) in s.iter_mut().zip(UPPER) {
            *out += w * d[a] * d[b];
        }
    }
    let m = match centre {
        IssCentre::Point => [0.0; 3],
        IssCentre::Centroid => mean.map(|v| v / total),
    };
    for (out, (a, b)) in s.iter_mut().zip(UPPER) {
        *out = *out / total - m[a] * m[b];
    }
    s
}

const UPPER: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// Whether a point at `q` has a rival within `√limit` that is more salient, and how many there are that are as salient as it
/// is, itself among them.
fn rivals(axes: [&[f32]; 3], codes: &[f32], q: [f32; 3], limit: f32, own: Saliency) -> (bool, u32) {
    dispatch!(simd::level(), simd => simd.vectorize(
        #[inline(always)]
        || compare(simd, axes, codes, q, limit, own)
    ))
}

#[inline(always)]
fn compare<S: Simd>(
    simd: S,
    axes: [&[f32]; 3],
    codes: &[f32],
    q: [f32; 3],
    limit: f32,
    own: Saliency,
) -> (bool, u32) {
    let limit = f32x16::splat(simd, limit);
    let value = f32x16::splat(simd, own.value);
    let none = f32x16::splat(simd, -1.0);
    let (mut higher, mut alike) = (0, 0);
    for (b, codes) in codes.chunks_exact(LANES).enumerate() {
        let (_, d2) = offsets(simd, axes, b, q);
        let code = f32x16::from_slice(simd, codes);
        // Points that pass the test, whose code is positive, compete among themselves, as in the original.
        let theirs = if own.qualifies { code } else { code.abs() };
        let theirs = d2.simd_le(limit).select(theirs, none);
        higher |= theirs.simd_gt(value).to_bitmask();
        alike += theirs.simd_eq(value).to_bitmask().count_ones();
    }
    (higher != 0, alike)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Length;
    use crate::test_world::{drift, surface};

    fn config() -> IssConfig {
        IssConfig {
            salient_radius: Length::Metres(1.0),
            cell: Length::Metres(0.5),
            min_keypoints: 0,
            ..IssConfig::default()
        }
    }

    fn grid(f: impl Fn(f64, f64) -> f64) -> Vec<[f32; 3]> {
        (0..41 * 41)
            .map(|i| {
                let (x, y) = (f64::from(i % 41) * 0.1, f64::from(i / 41) * 0.1);
                [x as f32, y as f32, f(x, y) as f32]
            })
            .collect()
    }

    #[test]
    fn a_plane_has_no_keypoints_and_a_bump_has_them_on_it() {
        let plane = grid(|_, _| 0.0);
        let found = keypoints(&plane, &KdTree::build(&plane), &config(), 0.1);
        assert!(found.indices.is_empty(), "{found:?}");
        // A hand-made spike, long in x so that its directions differ.
        let bump =
            grid(|x, y| 0.8 * (-((x - 2.0) / 0.6).powi(2) - ((y - 2.0) / 0.3).powi(2)).exp());
        let found = keypoints(&bump, &KdTree::build(&bump), &config(), 0.1);
        assert!(!found.indices.is_empty());
        let best = (0..found.indices.len())
            .max_by(|&a, &b| found.saliency[a].total_cmp(&found.saliency[b]))
            .unwrap();
        let p = bump[found.indices[best] as usize];
        assert!(
            (p[0] - 2.0).abs() < 0.5 && (p[1] - 2.0).abs() < 0.5,
            "{p:?}"
        );
    }

    #[test]
    fn one_keypoint_a_cell() {
        let s = surface(&drift(40_000, 20.0, 0.3, 0.0, 1), 0.2);
        let found = keypoints(&s.points, &s.tree, &config(), 0.2);
        assert!(found.indices.len() > 100);
        let mut cells: Vec<[i32; 3]> = found
            .indices
            .iter()
            .map(|&i| s.points[i as usize].map(|v| (v / 0.5).floor() as i32))
            .collect();
        cells.sort_unstable();
        let n = cells.len();
        cells.dedup();
        assert_eq!(cells.len(), n);
        assert!(found.indices.is_sorted());
    }

    #[test]
    fn too_few_are_filled_up_by_saliency_and_too_many_cut() {
        let s = surface(&drift(40_000, 20.0, 0.3, 0.0, 1), 0.2);
        let strict = IssConfig {
            gamma_21: 0.3,
            gamma_32: 0.3,
            ..config()
        };
        let few = keypoints(&s.points, &s.tree, &strict, 0.2);
        let filled = keypoints(
            &s.points,
            &s.tree,
            &IssConfig {
                min_keypoints: 300,
                ..strict.clone()
            },
            0.2,
        );
        assert!(few.indices.len() < 300);
        assert_eq!(
            (filled.indices.len(), filled.qualified),
            (300, few.qualified)
        );
        assert!(few.indices.iter().all(|i| filled.indices.contains(i)));
        let cut = keypoints(
            &s.points,
            &s.tree,
            &IssConfig {
                max_keypoints: 50,
                ..config()
            },
            0.2,
        );
        assert_eq!(cut.indices.len(), 50);
    }

    #[test]
    fn density_does_not_move_the_thresholds() {
        let count = |n: usize| {
            let p: Vec<[f32; 3]> = drift(n, 6.0, 0.3, 0.0, 3)
                .iter()
                .map(|p| p.map(|v| v as f32))
                .collect();
            let all = saliency(&p, &KdTree::build(&p), &config(), 0.1);
            all.iter().filter(|s| s.qualifies).count() as f64 / n as f64
        };
        let (dense, sparse) = (count(30_000), count(6_000));
        assert!((dense - sparse).abs() < 0.1, "{dense} and {sparse}");
    }

    /// Against the plain rule, where many are equally salient too.
    #[test]
    fn local_maxima_have_no_rival() {
        let bumps = |x: f64, y: f64| 0.2 * (5.0 * x).sin() * (3.0 * y).cos();
        let mirrored = grid(|x, y| bumps((x - 2.0).abs(), (y - 2.0).abs()));
        let rough: Vec<[f32; 3]> = surface(&drift(20_000, 8.0, 0.3, 0.0, 1), 0.2)
            .points
            .to_vec();
        for (points, voxel) in [(mirrored, 0.1), (rough, 0.2)] {
            let tree = KdTree::build(&points);
            let config = IssConfig {
                non_max_radius: Length::Metres(0.5),
                cell: Length::Metres(0.0),
                min_keypoints: 1_000_000,
                ..config()
            };
            let found = keypoints(&points, &tree, &config, voxel).indices;
            let all = saliency(&points, &tree, &config, voxel);
            let apart = |i: usize, j: usize| {
                let d: [f32; 3] = std::array::from_fn(|a| points[i][a] - points[j][a]);
                (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
            };
            let is_maximum = |i: usize| {
                let beaten = |j: usize| {
                    (all[j].qualifies || !all[i].qualifies)
                        && (all[j].value > all[i].value || (all[j].value == all[i].value && j < i))
                };
                !(0..points.len()).any(|j| beaten(j) && apart(i, j) <= 0.25)
            };
            let best = (0..points.len()).filter(|i| all[*i].value > 0.0 && is_maximum(*i));
            let best: Vec<u32> = best.map(|i| i as u32).collect();
            assert!(
                best.len() > 10 && found == best,
                "{} {}",
                best.len(),
                found.len()
            );
        }
    }

    #[test]
    fn tiny_clouds_are_no_trouble() {
        for n in [0usize, 1, 3, 10] {
            let p: Vec<[f32; 3]> = (0..n).map(|i| [i as f32 * 0.01; 3]).collect();
            let found = keypoints(&p, &KdTree::build(&p), &config(), 0.1);
            assert_eq!(found.qualified, 0);
        }
    }
}
