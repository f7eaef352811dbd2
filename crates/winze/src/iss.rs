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
use std::ops::Range;

use rayon::prelude::*;

use crate::columns::{Columns, Memory};
use crate::config::{IssCentre, IssConfig};
use crate::eigen3::{Symmetric3, eigen3};
use crate::kdtree::{KdTree, Neighbour};
use crate::neighbours::{GROUP, Neighbours};
use crate::parallel;
use crate::voxel::{Grid, pack};

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
    let mut chosen = cell_winners(points, tree, &saliency, config, voxel, columns)?;
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
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    saliency: &[f32],
    config: &IssConfig,
    voxel: f64,
    columns: &C,
) -> Result<C::Column<u32>, C::Error> {
    const NONE: [u64; 2] = [u64::MAX; 2];
    let cell = config.cell.metres(voxel);
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let non_max_radius = config.non_max_radius.metres(voxel) as f32;
    let mut keyed = columns.zeros::<[u64; 2]>(points.len())?;
    parallel::fill(
        &mut keyed,
        || (),
        |(), i| {
            let own = Saliency::decoded(saliency[i]);
            if own.value <= 0.0 || !is_local_maximum(points, tree, saliency, i, non_max_radius) {
                return NONE;
            }
            #[expect(clippy::cast_possible_truncation, reason = "saturates")]
            let at = points[i].map(|v| {
                if cell > 0.0 {
                    (f64::from(v) / cell).floor() as i32
                } else {
                    0
                }
            });
            #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
            pack(at, i as u32)
        },
    );
    keyed.par_sort_unstable();
    let candidates = &keyed[..keyed.partition_point(|k| *k != NONE)];
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
            let mut count = 0.0f32;
            tree.within(points[i], r, |_, _| count += 1.0);
            1.0 / count.max(1.0)
        },
    );
    let weights = config.density_weighting.then_some(&*weights);
    let mut coded = columns.zeros::<f32>(points.len())?;
    let gather = |near: &mut Neighbours, group: Range<usize>| {
        near.gather(tree, r, points[group].iter().copied());
    };
    parallel::fill_groups(&mut coded, GROUP, Neighbours::default, gather, |near, i| {
        let found = near.of(tree, points[i]);
        if found.len() <= config.min_neighbours {
            return Saliency::NONE.coded();
        }
        let scatter = scatter(points, i, found, weights, config.centre);
        let [l3, l2, l1] = eigen3(&scatter).values;
        let relief = l3 / (radius * radius);
        #[expect(clippy::cast_possible_truncation, reason = "a ratio")]
        let value = relief.max(0.0) as f32;
        let qualifies =
            relief > config.min_relief && l2 < config.gamma_21 * l1 && l3 < config.gamma_32 * l2;
        Saliency { value, qualifies }.coded()
    });
    Ok(coded)
}

/// The weighted scatter of the neighbours of point `i`, divided by their weight. The point itself
/// is among them and counts like the others.
fn scatter(
    points: &[[f32; 3]],
    i: usize,
    neighbours: &[Neighbour],
    weights: Option<&[f32]>,
    centre: IssCentre,
) -> Symmetric3 {
    let (mut total, mut mean, mut s) = (0.0f64, [0.0f64; 3], [0.0f64; 6]);
    for n in neighbours {
        let j = n.index as usize;
        let w = weights.map_or(1.0, |w| f64::from(w[j]));
        let d: [f64; 3] =
            std::array::from_fn(|a| f64::from(points[j][a]) - f64::from(points[i][a]));
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

fn is_local_maximum(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    saliency: &[f32],
    i: usize,
    radius: f32,
) -> bool {
    if radius <= 0.0 {
        return true;
    }
    let own = Saliency::decoded(saliency[i]);
    let mut maximum = true;
    tree.within(points[i], radius, |j, _| {
        let j = j as usize;
        let other = Saliency::decoded(saliency[j]);
        // Points that pass the test compete among themselves, as in the original.
        let competes = other.qualifies || !own.qualifies;
        if competes && (other.value > own.value || (other.value == own.value && j < i)) {
            maximum = false;
        }
    });
    maximum
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

    #[test]
    fn tiny_clouds_are_no_trouble() {
        for n in [0usize, 1, 3, 10] {
            let p: Vec<[f32; 3]> = (0..n).map(|i| [i as f32 * 0.01; 3]).collect();
            let found = keypoints(&p, &KdTree::build(&p), &config(), 0.1);
            assert_eq!(found.qualified, 0);
        }
    }
}
