//! Poses from correspondences that agree with each other, pair by pair.
//!
//! Two right correspondences keep the distance of their points, the angle between their normals, and the angles of both with
//! the line that joins them. Two wrong ones seldom do all of it, so in the graph that joins the pairs which do, the right
//! ones form clusters even where they are one in a hundred. A correspondence that has many common neighbours with its own
//! neighbours (second-order compatibility: Chen et al. 2022, SC²-PCR) is the seed of such a cluster; its pose is fitted to it, then to all
//! correspondences that agree with that pose.
//!
//! Places that look alike are clusters of their own: every seed that no better supported pose explains gives another one. Nothing is
//! drawn at random.
//!
//! Rows of the graph are bit sets, so common neighbours are counted 64 at a time.

use rayon::prelude::*;

use crate::cancel;
use crate::config::GraphConfig;
use crate::features::Features;
use crate::fit::fit_rigid;
use crate::matching::Correspondence;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::ransac::Hypothesis;
use crate::simd::bits;
use crate::vec3::{cross, dot, sub};

/// A correspondence between two points of surfaces, offsets in metres, with the surfaces' unit normals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedPair {
    /// The query's keypoint, by its index.
    pub keypoint: u32,
    /// Its place, and its surface's normal.
    pub query: [[f64; 3]; 2],
    /// Those of the map's keypoint.
    pub map: [[f64; 3]; 2],
}

/// At most `most` of `correspondences`, those whose descriptors are nearest, with the normals of the surfaces that the features
/// were taken from. Those without a normal on either side are left out.
#[must_use]
pub fn oriented(
    correspondences: &[Correspondence],
    query: (&Features<'_>, &Surface<'_>),
    map: (&Features<'_>, &Surface<'_>),
    most: usize,
) -> Vec<OrientedPair> {
    let mut nearest = correspondences.to_vec();
    nearest.sort_by(|a, b| {
        let distance = a.distance.total_cmp(&b.distance);
        distance.then((a.query, a.map).cmp(&(b.query, b.map)))
    });
    nearest.truncate(most);
    nearest.sort_unstable_by_key(|c| (c.query, c.map));
    let at = |(features, surface): (&Features<'_>, &Surface<'_>), i: u32| {
        let p = *features.points.get(i as usize)?;
        let n = surface.normals[surface.tree.nearest(p)?.index as usize];
        (n != [0.0; 3]).then(|| [p.map(f64::from), n.map(f64::from)])
    };
    nearest
        .par_iter()
        .map(|c| {
            Some(OrientedPair {
                keypoint: c.query,
                query: at(query, c.query)?,
                map: at(map, c.map)?,
            })
        })
        .collect::<Vec<_>>()
        .into_iter()
        .flatten()
        .collect()
}

/// Normals of an inlier agree to within the arc cosine of this (about 30°).
const NORMALS_AGREE: f64 = 0.866;
/// Seeds that are followed at most.
const SEEDS: usize = 2_000;
/// Fits of a pose to its inliers.
const FITS: usize = 6;

/// The poses that `pairs` support at the pipeline's `voxel` size (metres), best supported first, distinct, those
/// alone that `plausible` allows.
///
/// Offsets are taken as they are: the poses take the query's to the map's.
#[must_use]
pub fn poses(
    pairs: &[OrientedPair],
    config: &GraphConfig,
    voxel: f64,
    plausible: &(dyn Fn(&Pose) -> bool + Sync),
) -> Vec<Hypothesis> {
    let graph = Graph::of(pairs, config, voxel);
    let limit = config.inlier_distance.metres(voxel);
    let merge = config.distinct_distance.metres(voxel);
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let middle: [f64; 3] = std::array::from_fn(|a| {
        pairs.iter().map(|p| p.query[0][a]).sum::<f64>() / pairs.len().max(1) as f64
    });
    let mut kept: Vec<Hypothesis> = Vec::new();
    let mut explained = vec![false; pairs.len()];
    for seed in graph.seeds() {
        if explained[seed] {
            continue;
        }
        let cluster = graph.cluster(seed);
        let weighted = cluster
            .iter()
            .map(|&(i, w)| (pairs[i].query[0], pairs[i].map[0], w));
        let Some(start) = fit_rigid(weighted) else {
            continue;
        };
        let Some((found, inliers)) = fitted(pairs, &start, limit, config.min_inliers) else {
            continue;
        };
        explained[seed] = true;
        if !plausible(&found.map_from_query) {
            continue;
        }
        for &i in &inliers {
            explained[i] = true;
        }
        if !kept.iter().any(|k| k.same_place(&found, middle, merge)) {
            kept.push(found);
        }
    }
    let support = |h: &Hypothesis| h.support(limit);
    kept.sort_by(|a, b| support(b).total_cmp(&support(a)));
    kept.truncate(config.hypotheses);
    kept
}

/// Pairs joined where they agree.
struct Graph {
    words: usize,
    /// A row of bits a pair.
    rows: Vec<u64>,
    count: usize,
}

impl Graph {
    fn of(pairs: &[OrientedPair], config: &GraphConfig, voxel: f64) -> Self {
        let words = pairs.len().div_ceil(64).max(1);
        let mut rows = vec![0u64; words * pairs.len()];
        let agree = Agreement {
            tolerance: config.inlier_distance.metres(voxel),
            stretch: config.stretch,
            shortest: config.min_edge.metres(voxel),
            angle: config.angle_tolerance,
        };
        // Agreement is mutual, to the bit: half of it is asked and then mirrored.
        rows.par_chunks_mut(words)
            .zip(pairs)
            .enumerate()
            .for_each(|(i, (row, one))| {
                cancel::check();
                for (j, other) in pairs.iter().enumerate().skip(i + 1) {
                    if agree.holds(one, other) {
                        row[j / 64] |= 1 << (j % 64);
                    }
                }
            });
        let mut graph = Self {
            words,
            rows,
            count: pairs.len(),
        };
        for i in 0..graph.count {
            // Those after it alone: what was mirrored into this row lies before.
            for w in i / 64..words {
                let mut after = graph.rows[i * words + w];
                if w == i / 64 {
                    after &= (!0 << (i % 64)) << 1;
                }
                for j in bits(after) {
                    graph.rows[(64 * w + j) * words + i / 64] |= 1 << (i % 64);
                }
            }
        }
        graph
    }

    fn row(&self, i: usize) -> &[u64] {
        &self.rows[i * self.words..(i + 1) * self.words]
    }

    fn neighbours(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let words = self.row(i).iter().enumerate();
        words.flat_map(|(w, &word)| bits(word).map(move |b| 64 * w + b))
    }

    fn common(&self, i: usize, j: usize) -> u32 {
        let both = self.row(i).iter().zip(self.row(j));
        both.map(|(a, b)| (a & b).count_ones()).sum()
    }

    /// Pairs that are in triangles, those in most of them first.
    fn seeds(&self) -> Vec<usize> {
        let triangles: Vec<u64> = (0..self.count)
            .into_par_iter()
            .map(|i| {
                cancel::check();
                let common = self.neighbours(i).map(|j| u64::from(self.common(i, j)));
                common.sum()
            })
            .collect();
        let mut seeds: Vec<usize> = (0..self.count).filter(|i| triangles[*i] > 0).collect();
        seeds.sort_by(|a, b| triangles[*b].cmp(&triangles[*a]).then(a.cmp(b)));
        seeds.truncate(SEEDS);
        seeds
    }

    /// A seed and the neighbours that it has most in common with, each with its weight.
    fn cluster(&self, seed: usize) -> Vec<(usize, f64)> {
        let mut members: Vec<(usize, u32)> = self
            .neighbours(seed)
            .map(|j| (j, self.common(seed, j)))
            .collect();
        let most = members.iter().map(|m| m.1).max().unwrap_or(0);
        members.retain(|m| 2 * m.1 >= most && m.1 > 0);
        let others = members.into_iter().map(|(j, c)| (j, f64::from(c)));
        std::iter::once((seed, f64::from(most)))
            .chain(others)
            .collect()
    }
}

/// When two pairs agree.
struct Agreement {
    /// By how much the distances may differ, metres, and by how much for each metre more.
    tolerance: f64,
    stretch: f64,
    /// Points nearer than this say nothing about a pose.
    shortest: f64,
    /// By how much the cosines of angles may differ.
    angle: f64,
}

impl Agreement {
    fn holds(&self, a: &OrientedPair, b: &OrientedPair) -> bool {
        let (q, m) = (sub(b.query[0], a.query[0]), sub(b.map[0], a.map[0]));
        let (q2, m2) = (dot(q, q), dot(m, m));
        if q2 < self.shortest * self.shortest || m2 < self.shortest * self.shortest {
            return false;
        }
        let (ql, ml) = (q2.sqrt(), m2.sqrt());
        let tolerance = self.tolerance + self.stretch * ql;
        if (ql - ml).abs() > tolerance {
            return false;
        }
        let (qa, qb) = (a.query[1], b.query[1]);
        let (ma, mb) = (a.map[1], b.map[1]);
        // A point off by the tolerance turns the line by so much.
        let turned = self.angle + tolerance / ql;
        (dot(qa, qb) - dot(ma, mb)).abs() <= self.angle
            && (dot(qa, q) / ql - dot(ma, m) / ml).abs() <= turned
            && (dot(qb, q) / ql - dot(mb, m) / ml).abs() <= turned
            && (dot(cross(qa, qb), q) / ql - dot(cross(ma, mb), m) / ml).abs() <= turned
    }
}

/// The pose fitted to what agrees with `start`, repeatedly, and the pairs that agree with it; `None` for fewer
/// than `least` keypoints.
fn fitted(
    pairs: &[OrientedPair],
    start: &Pose,
    limit: f64,
    least: usize,
) -> Option<(Hypothesis, Vec<usize>)> {
    // Wide at first: a pose from a few keypoints a voxel off turns far points by more.
    let mut pose = *start;
    let mut best: Option<(Hypothesis, Vec<usize>)> = None;
    for round in 0..FITS {
        let wide = if round < 2 { 2.0 * limit } else { limit };
        let inliers = inliers(pairs, &pose, wide);
        if round >= 2 {
            let found = hypothesis(pairs, &pose, &inliers);
            let better = best
                .as_ref()
                .is_none_or(|(b, _)| found.support(limit) > b.support(limit));
            if !better {
                break;
            }
            best = Some((found, inliers.clone()));
        }
        let chosen = inliers
            .iter()
            .map(|&i| (pairs[i].query[0], pairs[i].map[0], 1.0));
        let Some(next) = fit_rigid(chosen) else { break };
        pose = next;
    }
    best.filter(|(h, _)| h.inliers >= least)
}

fn inliers(pairs: &[OrientedPair], pose: &Pose, limit: f64) -> Vec<usize> {
    let agrees = |p: &&OrientedPair| {
        let d = sub(pose.transform(p.query[0]), p.map[0]);
        dot(d, d) <= limit * limit && dot(pose.rotate(p.query[1]), p.map[1]) >= NORMALS_AGREE
    };
    let found = pairs.iter().enumerate().filter(|(_, p)| agrees(p));
    found.map(|(i, _)| i).collect()
}

fn hypothesis(pairs: &[OrientedPair], pose: &Pose, inliers: &[usize]) -> Hypothesis {
    let (mut count, mut sum, mut last) = (0usize, 0.0, u32::MAX);
    for &i in inliers {
        let p = &pairs[i];
        // Pairs of one keypoint follow each other.
        if p.keypoint != last {
            let d = sub(pose.transform(p.query[0]), p.map[0]);
            sum += dot(d, d);
            count += 1;
            last = p.keypoint;
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let rmse = (sum / count.max(1) as f64).sqrt();
    Hypothesis {
        map_from_query: *pose,
        inliers: count,
        rmse,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    /// `good` pairs under each of `poses`, and `bad` ones that belong to none.
    fn pairs(poses: &[Pose], good: usize, bad: usize, noise: f64) -> Vec<OrientedPair> {
        let mut rng = Rng::new(5, 0);
        let mut out = Vec::new();
        let place = |rng: &mut Rng| {
            [
                rng.range(-15.0, 15.0),
                rng.range(-3.0, 3.0),
                rng.range(-2.0, 2.0),
            ]
        };
        for pose in poses {
            for _ in 0..good {
                let (p, n) = (place(&mut rng), rng.direction());
                let m: [f64; 3] = pose.transform(p).map(|v| v + noise * rng.normal());
                out.push(([p, n], [m, pose.rotate(n)]));
            }
        }
        for _ in 0..bad {
            let q = [place(&mut rng), rng.direction()];
            let m = place(&mut rng).map(|v| 3.0 * v);
            out.push((q, [m, rng.direction()]));
        }
        (0..)
            .zip(out)
            .map(|(keypoint, (query, map))| OrientedPair {
                keypoint,
                query,
                map,
            })
            .collect()
    }

    fn anything(_: &Pose) -> bool {
        true
    }

    #[test]
    fn agreement_is_mutual() {
        let pose = Pose::from_rotation_vector([0.4, 2.0, -1.0], [12.0, -7.0, 3.0]);
        let pairs = pairs(&[pose], 70, 130, 0.1);
        let config = GraphConfig::default();
        let graph = Graph::of(&pairs, &config, 0.2);
        let agree = Agreement {
            tolerance: config.inlier_distance.metres(0.2),
            stretch: config.stretch,
            shortest: config.min_edge.metres(0.2),
            angle: config.angle_tolerance,
        };
        let mut edges = 0;
        for (i, a) in pairs.iter().enumerate() {
            let expected: Vec<usize> = (0..pairs.len())
                .filter(|&j| i != j && agree.holds(a, &pairs[j]))
                .collect();
            assert_eq!(graph.neighbours(i).collect::<Vec<_>>(), expected, "{i}");
            edges += expected.len();
        }
        assert!(edges > 1000, "{edges}");
    }

    #[test]
    fn one_right_pair_in_fifty_is_enough() {
        let truth = Pose::from_rotation_vector([0.4, 2.0, -1.0], [12.0, -7.0, 3.0]);
        let all = pairs(&[truth], 30, 1_470, 0.05);
        let found = poses(&all, &GraphConfig::default(), 0.2, &anything);
        let off = found[0].map_from_query.distance(&truth, [0.0; 3]);
        assert!(off.translation < 0.1 && off.rotation < 0.02, "{off:?}");
        assert!((28..=34).contains(&found[0].inliers), "{found:?}");
        assert!(found[1..].iter().all(|h| h.inliers < 12), "{found:?}");
    }

    #[test]
    fn a_twin_is_a_cluster_of_its_own() {
        let twins = [
            Pose::from_translation([0.0, 40.0, 0.0]),
            Pose::from_rotation_vector([0.0, 0.0, std::f64::consts::PI], [30.0, 0.0, 0.0]),
        ];
        let all = pairs(&twins, 25, 500, 0.05);
        let found = poses(&all, &GraphConfig::default(), 0.2, &anything);
        for twin in &twins {
            let near =
                |h: &&Hypothesis| h.map_from_query.distance(twin, [0.0; 3]).translation < 0.1;
            assert!(found[..2].iter().any(|h| near(&h)), "{found:?}");
        }
        // What is not plausible is left out, and the other one stays.
        let only = |p: &Pose| p.translation()[1] > 20.0;
        let found = poses(&all, &GraphConfig::default(), 0.2, &only);
        let off = found[0].map_from_query.distance(&twins[0], [0.0; 3]);
        assert!(off.translation < 0.1, "{off:?}");
    }

    #[test]
    fn neither_nothing_nor_noise_is_a_place() {
        let config = GraphConfig::default();
        assert!(poses(&[], &config, 0.2, &anything).is_empty());
        let noise = pairs(&[], 0, 400, 0.0);
        let found = poses(&noise, &config, 0.2, &anything);
        assert!(found.iter().all(|h| h.inliers < 10), "{found:?}");
        let one = pairs(&[Pose::identity()], 1, 0, 0.0);
        assert!(poses(&one, &config, 0.2, &anything).is_empty());
        // The same pair many times over.
        assert!(poses(&vec![one[0]; 100], &config, 0.2, &anything).is_empty());
    }

    #[test]
    fn threads_change_nothing() {
        let all = pairs(&[Pose::from_translation([1.0, 2.0, 3.0])], 40, 800, 0.05);
        let run = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| poses(&all, &GraphConfig::default(), 0.2, &anything))
        };
        assert_eq!(run(1), run(3));
    }
}
