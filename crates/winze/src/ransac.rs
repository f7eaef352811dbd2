//! Poses from correspondences by random sampling (Fischler & Bolles 1981).
//!
//! Three correspondences give a pose. Most samples hold a wrong one; a sample whose triangle has
//! different edge lengths in the two clouds is thrown away before a pose is made of it (the
//! prerejection of Buch et al. 2013), which is what makes a million of them affordable. The poses
//! that survive are scored by their inlier correspondences and how tight these are, refined by a least-squares fit
//! on them, and the best distinct ones are kept: one answer would hide the rivals. Distinctness holds
//! within each block already, so that a place with much support cannot crowd out its twin.
//!
//! Samples are drawn in blocks, each from a random stream of its own, in rounds of so many blocks;
//! the round, not the thread, decides when to stop. The answer is therefore the same at any thread count.
//!
//! Edges and poses are looked at in `f32` first (`rough`), which dismisses nearly all; what is left is decided in `f64`.

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::cancel;
use crate::config::RansacConfig;
use crate::features::Features;
use crate::fit::fit_rigid;
use crate::matching::Correspondence;
use crate::pose::Pose;
use crate::rng::Rng;

mod rough;

use rough::Rough;

/// A pose that some correspondences agree on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hypothesis {
    /// Takes query points to the map.
    pub map_from_query: Pose,
    /// Correspondences within the inlier distance, a keypoint of the query counted once.
    pub inliers: usize,
    /// Root mean square distance of the inliers, metres.
    pub rmse: f64,
}

impl Hypothesis {
    /// `Σ (1 − d²/limit²)` over the inliers, by which hypotheses are ranked (MSAC, Torr & Zisserman
    /// 2000): of two with as many inliers the tighter one wins, and one more at the rim is worth little.
    pub(crate) fn support(&self, limit: f64) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let inliers = self.inliers as f64;
        inliers * (1.0 - self.rmse * self.rmse / (limit * limit))
    }

    /// The two poses differ by less than `merge` metres at the query's point `at`, and by less than 15°.
    pub(crate) fn same_place(&self, other: &Self, at: [f64; 3], merge: f64) -> bool {
        let (a, b) = (&self.map_from_query, &other.map_from_query);
        // The angle takes most of the time, and most poses lie apart.
        let apart = Vector3::from(a.transform(at)) - Vector3::from(b.transform(at));
        apart.norm() < merge && a.distance(b, at).rotation < SAME_ANGLE
    }
}

/// What sampling found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Estimate {
    /// Best supported first, distinct.
    pub hypotheses: Vec<Hypothesis>,
    /// Samples drawn.
    pub samples: u64,
}

/// Samples a block draws.
const BLOCK: u64 = 4_096;
/// Samples whose edges are looked at together.
const BATCH: usize = 128;
/// Blocks a round holds at most. Where less is asked for it starts with that, at least one, and grows with what was drawn.
const ROUND: u64 = 16;
/// Distinct candidates a block hands on.
const KEPT: usize = 8;
/// Poses that differ by less than this angle, radians (15°), and by less than the distinct distance are one.
const SAME_ANGLE: f64 = 0.261_799_388;

/// Three pairs.
type Sample = [u32; 3];

/// Pairs of points.
struct Pairs {
    query: Vec<[f64; 3]>,
    map: Vec<[f64; 3]>,
    /// Number of distinct query keypoints seen up to each pair; pairs of one keypoint are adjacent.
    keypoint: Vec<u32>,
    /// Mean of the query points: where poses are compared.
    middle: [f64; 3],
    /// Poses nearer than this there are one, metres.
    merge: f64,
    rough: Rough,
}

/// Poses for `correspondences` between the keypoints of `query` and `map`, at the pipeline's
/// `voxel` size (metres). Poses (`map_from_query`) that `plausible` refuses are not pursued: what is
/// known beforehand, such as which way is up, goes in there.
///
/// Fewer than three correspondences give no hypothesis.
#[must_use]
pub fn estimate(
    correspondences: &[Correspondence],
    query: &Features<'_>,
    map: &Features<'_>,
    config: &RansacConfig,
    voxel: f64,
    seed: u64,
    plausible: &(dyn Fn(&Pose) -> bool + Sync),
) -> Estimate {
    let plausible = |pose: &Pose| plausible(&pose.from_between_origins(map.origin, query.origin));
    let query_points: Vec<[f64; 3]> = correspondences
        .iter()
        .map(|c| query.points[c.query as usize].map(f64::from))
        .collect();
    let map_points: Vec<[f64; 3]> = correspondences
        .iter()
        .map(|c| map.points[c.map as usize].map(f64::from))
        .collect();
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let pairs = Pairs {
        middle: std::array::from_fn(|a| {
            query_points.iter().map(|p| p[a]).sum::<f64>() / query_points.len().max(1) as f64
        }),
        merge: config.distinct_distance.metres(voxel),
        rough: Rough::new(&query_points, &map_points),
        query: query_points,
        map: map_points,
        keypoint: correspondences.iter().map(|c| c.query).collect(),
    };
    let n = pairs.query.len();
    if n < 3 {
        return Estimate::default();
    }
    let limit = config.inlier_distance.metres(voxel);
    let max_samples = config.max_samples as u64;
    let mut pool: Vec<Hypothesis> = Vec::new();
    let (mut samples, mut needed, mut block) = (0, max_samples, 0);
    let first_round = config.min_samples as u64 / BLOCK;
    while samples < needed {
        let round = if first_round < ROUND {
            let enough = (needed - samples).div_ceil(BLOCK);
            block.max(first_round).min(enough).clamp(1, ROUND)
        } else {
            ROUND
        };
        let found: Vec<Vec<Hypothesis>> = (block..block + round)
            .into_par_iter()
            .map(|b| {
                cancel::check();
                let draws = max_samples.saturating_sub(b * BLOCK).min(BLOCK);
                let rng = Rng::new(seed, b);
                sample_block(&pairs, config, limit, voxel, rng, draws, &plausible)
            })
            .collect();
        block += round;
        samples = (samples + BLOCK * round).min(max_samples);
        pool.extend(found.into_iter().flatten());
        pool = distinct(pool, &pairs, limit, config.hypotheses);
        if let Some(best) = pool.first() {
            // Samples are drawn from all pairs, however many share a keypoint.
            let enough = samples_needed(best.inliers, n, config.confidence);
            needed = needed.min(enough.max(config.min_samples as u64));
        }
    }
    for h in &mut pool {
        h.map_from_query = h
            .map_from_query
            .from_between_origins(map.origin, query.origin);
    }
    Estimate {
        hypotheses: pool,
        samples,
    }
}

/// Samples after which one of three inliers was drawn with the given confidence.
fn samples_needed(inliers: usize, total: usize, confidence: f64) -> u64 {
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    let share = inliers as f64 / total.max(1) as f64;
    let good = share * share * share;
    if good >= 1.0 {
        return 0;
    }
    if good <= 0.0 {
        return u64::MAX;
    }
    let n = libm::log(1.0 - confidence) / libm::log1p(-good);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "saturates"
    )]
    let n = n.ceil() as u64;
    n
}

fn sample_block(
    pairs: &Pairs,
    config: &RansacConfig,
    limit: f64,
    voxel: f64,
    mut rng: Rng,
    draws: u64,
    plausible: &impl Fn(&Pose) -> bool,
) -> Vec<Hypothesis> {
    let n = u32::try_from(pairs.query.len()).unwrap_or(u32::MAX);
    let min_edge = config.min_edge.metres(voxel);
    let limits = pairs.rough.edge_limits(config.edge_similarity, min_edge);
    let mut block = Block {
        pairs,
        config,
        limit,
        kept: Vec::new(),
        within: Vec::new(),
    };
    let mut left = draws;
    let mut samples = [[0; 3]; BATCH];
    while left > 0 {
        let drawn = left.min(BATCH as u64);
        left -= drawn;
        let draw = || [rng.below(n), rng.below(n), rng.below(n)];
        let promising = pairs.rough.sift(drawn as usize, draw, &mut samples, limits);
        for sample in &samples[..promising] {
            let sample = sample.map(|i| i as usize);
            if edges_agree(pairs, sample, config.edge_similarity, min_edge) {
                block.pursue(sample, plausible);
            }
        }
    }
    block.kept
}

/// What a block has found, and what it needs.
struct Block<'a> {
    pairs: &'a Pairs,
    config: &'a RansacConfig,
    limit: f64,
    kept: Vec<Hypothesis>,
    /// Scratch: the pairs near enough under a pose.
    within: Vec<u32>,
}

impl Block<'_> {
    /// Makes a pose of a sample and keeps it, refined, where it is one of the best.
    fn pursue(&mut self, sample: [usize; 3], plausible: &impl Fn(&Pose) -> bool) {
        let (pairs, limit) = (self.pairs, self.limit);
        let Some(pose) = fit_rigid(sample.iter().map(|&i| (pairs.query[i], pairs.map[i], 1.0)))
        else {
            return;
        };
        if !plausible(&pose) {
            return;
        }
        let raw = hypothesis(pairs, pose, limit, &mut self.within);
        let enough = self.kept.len() < KEPT || raw.inliers > self.kept[self.kept.len() - 1].inliers;
        let better = |h: &Hypothesis, kept: &[Hypothesis]| {
            !kept
                .iter()
                .any(|k| k.support(limit) >= h.support(limit) && pairs.same_place(k, h))
        };
        if raw.inliers < self.config.min_inliers || !enough || !better(&raw, &self.kept) {
            return;
        }
        let refined = refit(pairs, raw, limit, &mut self.within);
        if !plausible(&refined.map_from_query) || !better(&refined, &self.kept) {
            return;
        }
        let kept = &mut self.kept;
        kept.retain(|h| !pairs.same_place(h, &refined));
        let at = kept.partition_point(|h| h.support(limit) >= refined.support(limit));
        kept.insert(at, refined);
        kept.truncate(KEPT);
    }
}

/// All three edges are long enough and similar in both clouds.
fn edges_agree(pairs: &Pairs, sample: [usize; 3], similarity: f64, min_edge: f64) -> bool {
    let [a, b, c] = sample;
    for (i, j) in [(a, b), (b, c), (c, a)] {
        let q = squared_distance(pairs.query[i], pairs.query[j]);
        let m = squared_distance(pairs.map[i], pairs.map[j]);
        let (short, long) = if q < m { (q, m) } else { (m, q) };
        if short < min_edge * min_edge || short < similarity * similarity * long {
            return false;
        }
    }
    true
}

/// Of the pairs `among`, inliers (a query keypoint counted once) and the sum of their squared distances.
fn score(pairs: &Pairs, pose: &Pose, limit: f64, among: &[u32]) -> (usize, f64) {
    let (r, t) = (pose.rotation(), pose.translation_vector());
    let limit2 = limit * limit;
    let (mut inliers, mut sum, mut last) = (0, 0.0, u32::MAX);
    for &i in among {
        let i = i as usize;
        let (q, m, k) = (&pairs.query[i], &pairs.map[i], pairs.keypoint[i]);
        let d2: f64 = (0..3)
            .map(|i| {
                let v = r[(i, 0)] * q[0] + r[(i, 1)] * q[1] + r[(i, 2)] * q[2] + t[i] - m[i];
                v * v
            })
            .sum();
        if d2 <= limit2 && k != last {
            inliers += 1;
            sum += d2;
            last = k;
        }
    }
    (inliers, sum)
}

/// Least-squares fits on the inliers, repeated while they gain inliers, from `best`, whose pairs `within` holds.
fn refit(pairs: &Pairs, mut best: Hypothesis, limit: f64, within: &mut Vec<u32>) -> Hypothesis {
    for _ in 0..8 {
        within.retain(|&i| {
            let i = i as usize;
            let p = best.map_from_query.transform(pairs.query[i]);
            squared_distance(p, pairs.map[i]) <= limit * limit
        });
        let inliers = within
            .iter()
            .map(|&i| (pairs.query[i as usize], pairs.map[i as usize], 1.0));
        let Some(pose) = fit_rigid(inliers) else {
            break;
        };
        let next = hypothesis(pairs, pose, limit, within);
        if next.support(limit) <= best.support(limit) {
            break;
        }
        best = next;
    }
    best
}

/// What a pose is worth. Pairs that may be within the limit are left in `within`.
fn hypothesis(pairs: &Pairs, pose: Pose, limit: f64, within: &mut Vec<u32>) -> Hypothesis {
    pairs.rough.within(&pose, limit, within);
    let (inliers, sum) = score(pairs, &pose, limit, within);
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let rmse = (sum / inliers.max(1) as f64).sqrt();
    Hypothesis {
        map_from_query: pose,
        inliers,
        rmse,
    }
}

impl Pairs {
    fn same_place(&self, a: &Hypothesis, b: &Hypothesis) -> bool {
        a.same_place(b, self.middle, self.merge)
    }
}

/// The best `keep` of `pool`, none at the same place as a better one.
fn distinct(mut pool: Vec<Hypothesis>, pairs: &Pairs, limit: f64, keep: usize) -> Vec<Hypothesis> {
    // Stable: of equal ones the first drawn comes first.
    pool.sort_by(|a, b| b.support(limit).total_cmp(&a.support(limit)));
    let mut out: Vec<Hypothesis> = Vec::new();
    for h in pool {
        if out.len() == keep {
            break;
        }
        if !out.iter().any(|o| pairs.same_place(o, &h)) {
            out.push(h);
        }
    }
    out
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d: [f64; 3] = std::array::from_fn(|i| a[i] - b[i]);
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `good` true correspondences under a known pose and `bad` random ones.
    fn problem(
        good: usize,
        bad: usize,
    ) -> (
        Vec<Correspondence>,
        Features<'static>,
        Features<'static>,
        Pose,
    ) {
        let mut rng = Rng::new(4, 0);
        let pose = Pose::from_rotation_vector([0.4, 2.0, -1.0], [12.0, -7.0, 3.0]);
        let mut place = || -> [f64; 3] {
            [
                rng.range(-20.0, 20.0),
                rng.range(-3.0, 3.0),
                rng.range(-2.0, 2.0),
            ]
        };
        let n = good + bad;
        let query: Vec<[f64; 3]> = (0..n).map(|_| place()).collect();
        let map: Vec<[f64; 3]> = (0..n)
            .map(|i| {
                if i < good {
                    pose.transform(query[i])
                } else {
                    pose.transform(place())
                }
            })
            .collect();
        let features = |p: &[[f64; 3]]| Features {
            points: p.iter().map(|p| p.map(|v| v as f32)).collect(),
            ..Features::default()
        };
        let pairs = (0..n as u32)
            .map(|i| Correspondence {
                query: i,
                map: i,
                distance: 0.0,
            })
            .collect();
        (pairs, features(&query), features(&map), pose)
    }

    #[test]
    fn finds_the_pose_among_nine_in_ten_outliers() {
        let (pairs, query, map, truth) = problem(30, 270);
        let found = estimate(
            &pairs,
            &query,
            &map,
            &RansacConfig::default(),
            0.3,
            1,
            &|_| true,
        );
        let best = found.hypotheses[0];
        let error = best.map_from_query.distance(&truth, [0.0; 3]);
        assert!(
            best.inliers >= 30 && error.translation < 0.05 && error.rotation < 0.005,
            "{best:?}"
        );
    }

    #[test]
    fn the_same_at_any_thread_count_and_another_for_another_seed() {
        let (pairs, query, map, _) = problem(12, 400);
        let run = |threads, seed| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                estimate(
                    &pairs,
                    &query,
                    &map,
                    &RansacConfig::default(),
                    0.3,
                    seed,
                    &|_| true,
                )
            })
        };
        assert_eq!(run(1, 0), run(5, 0));
        assert_ne!(run(1, 0), run(1, 1));
    }

    #[test]
    fn hypotheses_are_distinct_and_ordered() {
        let (pairs, query, map, _) = problem(10, 300);
        let config = RansacConfig {
            min_inliers: 3,
            ..RansacConfig::default()
        };
        let found = estimate(&pairs, &query, &map, &config, 0.5, 0, &|_| true).hypotheses;
        assert!(found.len() > 1 && found.len() <= config.hypotheses);
        assert!(
            found
                .windows(2)
                .all(|w| w[0].support(1.0) >= w[1].support(1.0))
        );
        let middle = |p: &Hypothesis| {
            let sum = query.points.iter().fold([0.0; 3], |s: [f64; 3], q| {
                std::array::from_fn(|a| s[a] + f64::from(q[a]))
            });
            p.map_from_query
                .transform(sum.map(|v| v / query.points.len() as f64))
        };
        for (i, a) in found.iter().enumerate() {
            for b in &found[..i] {
                let apart = squared_distance(middle(a), middle(b)).sqrt();
                let turned = a.map_from_query.distance(&b.map_from_query, [0.0; 3]);
                assert!(apart >= 2.5 || turned.rotation >= SAME_ANGLE, "{apart}");
            }
        }
    }

    #[test]
    fn a_place_with_much_support_does_not_hide_its_twin() {
        // Two in five keypoints match at one place, two more at another with a little less support.
        let (mut pairs, query, map, truth) = problem(250, 250);
        let twin = truth.compose(&Pose::from_translation([0.0, 40.0, 0.0]));
        let mut map = map;
        for i in 250..450 {
            map.points.to_mut()[i] = twin
                .transform(query.points[i].map(f64::from))
                .map(|v| v as f32);
        }
        pairs.truncate(500);
        let found = estimate(
            &pairs,
            &query,
            &map,
            &RansacConfig::default(),
            0.3,
            1,
            &|_| true,
        );
        let second = found.hypotheses[1];
        assert!(second.inliers >= 200, "{second:?}");
        assert!(second.map_from_query.distance(&twin, [0.0; 3]).translation < 0.1);
    }

    #[test]
    fn several_matches_a_keypoint_ask_for_more_samples_and_the_limit_holds() {
        let (pairs, query, map, _) = problem(60, 60);
        let estimate = |pairs: &[Correspondence], max_samples| {
            let config = RansacConfig {
                max_samples,
                ..RansacConfig::default()
            };
            estimate(pairs, &query, &map, &config, 0.3, 1, &|_| true).samples
        };
        // Each keypoint with its own match and nine of others': a tenth of the pairs is right at most.
        let many: Vec<Correspondence> = pairs
            .iter()
            .flat_map(|c| {
                (0..10).map(|k| Correspondence {
                    map: (c.map + 7 * k) % 120,
                    ..*c
                })
            })
            .collect();
        let (few, more) = (estimate(&pairs, 2_000_000), estimate(&many, 2_000_000));
        assert!(more >= few);
        let share = 60.0f64 / 1200.0;
        assert!(
            more as f64 >= (-6.9 / (1.0 - share.powi(3)).ln()).min(2e6) * 0.9,
            "{more}"
        );
        assert_eq!(estimate(&pairs, 1_000), 1_000);
    }

    #[test]
    fn what_is_known_beforehand_rules_poses_out() {
        let (pairs, query, map, truth) = problem(30, 270);
        let far = |p: &Pose| p.distance(&truth, [0.0; 3]).rotation > 0.5;
        let found = estimate(&pairs, &query, &map, &RansacConfig::default(), 0.3, 1, &far);
        assert!(found.hypotheses.iter().all(|h| far(&h.map_from_query)));
    }

    #[test]
    fn too_little_to_go_by_gives_nothing_and_ends() {
        let (pairs, query, map, _) = problem(3, 0);
        for n in 0..3 {
            assert!(
                estimate(
                    &pairs[..n],
                    &query,
                    &map,
                    &RansacConfig::default(),
                    0.3,
                    0,
                    &|_| true
                )
                .hypotheses
                .is_empty()
            );
        }
        // All keypoints on one spot: every sample is degenerate.
        let spot = Features {
            points: vec![[1.0; 3]; 3].into(),
            ..Features::default()
        };
        let config = RansacConfig {
            max_samples: 100_000,
            ..RansacConfig::default()
        };
        assert!(
            estimate(&pairs, &spot, &map, &config, 0.3, 0, &|_| true)
                .hypotheses
                .is_empty()
        );
    }

    #[test]
    fn the_number_of_samples_follows_the_usual_formula() {
        // 1 − (1 − 0.5³)ⁿ ≥ 0.99 from n = 35 on.
        assert_eq!(samples_needed(50, 100, 0.99), 35);
        assert_eq!(samples_needed(100, 100, 0.99), 0);
        assert_eq!(samples_needed(0, 100, 0.99), u64::MAX);
    }
}
