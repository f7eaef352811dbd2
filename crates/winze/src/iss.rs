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

use rustc_hash::FxHashMap;

use crate::config::{IssCentre, IssConfig};
use crate::eigen3::{Symmetric3, eigen3};
use crate::kdtree::{KdTree, Neighbour};
use crate::parallel;

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
pub fn keypoints(points: &[[f32; 3]], tree: &KdTree, config: &IssConfig, voxel: f64) -> Keypoints {
    let saliency = saliency(points, tree, config, voxel);
    let mut ranked: Vec<u32> = (0u32..)
        .zip(&saliency)
        .filter(|(_, s)| s.qualifies)
        .map(|(i, _)| i)
        .collect();
    let mut chosen = Chosen::new(points, tree, &saliency, config, voxel);
    rank(&mut ranked, &saliency);
    chosen.take(&ranked, config.max_keypoints);
    let qualified = chosen.indices.len();
    let budget = match config.max_keypoints {
        0 => config.min_keypoints,
        most => config.min_keypoints.min(most),
    };
    if qualified < budget {
        let mut rest: Vec<u32> = (0u32..)
            .zip(&saliency)
            .filter(|(_, s)| !s.qualifies && s.value > 0.0)
            .map(|(i, _)| i)
            .collect();
        rank(&mut rest, &saliency);
        chosen.take(&rest, budget);
    }
    let mut indices = chosen.indices;
    indices.sort_unstable();
    Keypoints {
        saliency: indices
            .iter()
            .map(|&i| saliency[i as usize].value)
            .collect(),
        indices,
        qualified,
    }
}

/// The test at every point.
#[must_use]
pub fn saliency(
    points: &[[f32; 3]],
    tree: &KdTree,
    config: &IssConfig,
    voxel: f64,
) -> Vec<Saliency> {
    let radius = config.salient_radius.metres(voxel);
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let r = radius as f32;
    let weights: Option<Vec<f32>> = config.density_weighting.then(|| {
        parallel::map_with(
            points.len(),
            || (),
            |(), i| {
                let mut count = 0.0f32;
                tree.within(points[i], r, |_, _| count += 1.0);
                1.0 / count.max(1.0)
            },
        )
    });
    parallel::map_with(points.len(), Vec::new, |found, i| {
        found.clear();
        tree.within(points[i], r, |index, distance_squared| {
            found.push(Neighbour {
                index,
                distance_squared,
            });
        });
        if found.len() <= config.min_neighbours {
            return Saliency {
                value: 0.0,
                qualifies: false,
            };
        }
        let scatter = scatter(points, i, found, weights.as_deref(), config.centre);
        let [l3, l2, l1] = eigen3(&scatter).values;
        let relief = l3 / (radius * radius);
        #[expect(clippy::cast_possible_truncation, reason = "a ratio")]
        Saliency {
            value: relief.max(0.0) as f32,
            qualifies: relief > config.min_relief
                && l2 < config.gamma_21 * l1
                && l3 < config.gamma_32 * l2,
        }
    })
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

/// Most salient first; ties by index.
fn rank(indices: &mut [u32], saliency: &[Saliency]) {
    indices.sort_unstable_by(|&a, &b| {
        saliency[b as usize]
            .value
            .total_cmp(&saliency[a as usize].value)
            .then(a.cmp(&b))
    });
}

/// The points taken so far, thinned to one a cell and, where asked, to local maxima.
struct Chosen<'a> {
    points: &'a [[f32; 3]],
    tree: &'a KdTree,
    saliency: &'a [Saliency],
    cell: f64,
    non_max_radius: f32,
    taken: FxHashMap<[i32; 3], ()>,
    indices: Vec<u32>,
}

impl<'a> Chosen<'a> {
    fn new(
        points: &'a [[f32; 3]],
        tree: &'a KdTree,
        saliency: &'a [Saliency],
        config: &IssConfig,
        voxel: f64,
    ) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
        Self {
            points,
            tree,
            saliency,
            cell: config.cell.metres(voxel),
            non_max_radius: config.non_max_radius.metres(voxel) as f32,
            taken: FxHashMap::default(),
            indices: Vec::new(),
        }
    }

    /// Takes from `ranked`, best first, until there are `limit` keypoints (0: no limit).
    fn take(&mut self, ranked: &[u32], limit: usize) {
        for &i in ranked {
            if limit > 0 && self.indices.len() >= limit {
                return;
            }
            if !self.is_local_maximum(i) {
                continue;
            }
            if self.cell > 0.0 {
                #[expect(clippy::cast_possible_truncation, reason = "saturates")]
                let cell =
                    self.points[i as usize].map(|v| (f64::from(v) / self.cell).floor() as i32);
                if self.taken.insert(cell, ()).is_some() {
                    continue;
                }
            }
            self.indices.push(i);
        }
    }

    fn is_local_maximum(&self, i: u32) -> bool {
        if self.non_max_radius <= 0.0 {
            return true;
        }
        let own = self.saliency[i as usize];
        let mut maximum = true;
        self.tree
            .within(self.points[i as usize], self.non_max_radius, |j, _| {
                let other = self.saliency[j as usize];
                // Points that pass the test compete among themselves, as in the original.
                let competes = other.qualifies || !own.qualifies;
                if competes && (other.value > own.value || (other.value == own.value && j < i)) {
                    maximum = false;
                }
            });
        maximum
    }
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
