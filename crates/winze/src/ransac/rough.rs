//! Pairs of points seen roughly, in `f32` and many at a time, to leave out what cannot count.
//!
//! Nothing is decided here that rounding could turn: what a rough look does not rule out with a margin is
//! looked at again in `f64`, so that answers are those of `f64` alone.

use super::{BATCH, Sample};
use crate::pose::Pose;
use crate::simd;

/// Pairs of a tile.
const LANES: usize = 32;

/// Query x, y, z and map x, y, z about the two centres. Lanes to spare hold infinity on the map's side.
type Tile = [[f32; LANES]; 6];

/// The pairs, arranged for rough looks.
pub(super) struct Rough {
    /// A pair's points side by side, so that an edge is two lines of cache.
    ends: Vec<[[f32; 4]; 2]>,
    tiles: Vec<Tile>,
    query_centre: [f64; 3],
    map_centre: [f64; 3],
    /// Largest sum of absolute coordinates about the centres, of both sides together.
    reach: f64,
    /// Points lie so far out that nothing is said of edges.
    far: bool,
}

/// When an edge is surely no good: squared, with a margin.
#[derive(Clone, Copy)]
pub(super) struct EdgeLimits {
    similarity: f32,
    shortest: f32,
}

/// Beyond this length of an edge squares might leave the range of `f32`, metres.
const FAR: f64 = 1e15;

impl Rough {
    /// `query[i]` and `map[i]` are a pair.
    pub(super) fn new(query: &[[f64; 3]], map: &[[f64; 3]]) -> Self {
        let (query_centre, map_centre) = (mean(query), mean(map));
        #[expect(clippy::cast_possible_truncation, reason = "rough")]
        let about = |p: &[f64; 3], c: &[f64; 3]| -> [f32; 3] {
            std::array::from_fn(|a| (p[a] - c[a]) as f32)
        };
        let pairs = || query.iter().zip(map);
        let mut reach = [0.0f64; 2];
        for (q, m) in pairs() {
            for (reach, (p, c)) in reach.iter_mut().zip([(q, &query_centre), (m, &map_centre)]) {
                *reach = reach.max((0..3).map(|a| (p[a] - c[a]).abs()).sum());
            }
        }
        let mut tiles = vec![[[0.0; LANES]; 6]; query.len().div_ceil(LANES)];
        for tile in &mut tiles {
            tile[3] = [f32::INFINITY; LANES];
        }
        for (i, (q, m)) in pairs().enumerate() {
            let (q, m) = (about(q, &query_centre), about(m, &map_centre));
            for (row, v) in tiles[i / LANES].iter_mut().zip(q.into_iter().chain(m)) {
                row[i % LANES] = v;
            }
        }
        #[expect(clippy::cast_possible_truncation, reason = "f32 before they were f64")]
        let end = |p: &[f64; 3]| [p[0] as f32, p[1] as f32, p[2] as f32, 0.0];
        Self {
            ends: pairs().map(|(q, m)| [end(q), end(m)]).collect(),
            tiles,
            query_centre,
            map_centre,
            reach: reach[0] + reach[1],
            far: query.iter().chain(map).flatten().any(|v| !(v.abs() < FAR)),
        }
    }

    /// Limits that an edge `similarity` alike and `shortest` metres long keeps.
    ///
    /// A squared length in `f32` errs by 4·10⁻⁷ of itself at most (differences of the `f32` that came in are
    /// rounded once): 10⁻⁵ covers the two of them and the limits' own rounding.
    pub(super) fn edge_limits(&self, similarity: f64, shortest: f64) -> EdgeLimits {
        #[expect(clippy::cast_possible_truncation, reason = "rough")]
        let limit = |v: f64| {
            if self.far {
                0.0
            } else {
                (v * v * (1.0 - 1e-5)) as f32
            }
        };
        EdgeLimits {
            similarity: limit(similarity),
            shortest: limit(shortest),
        }
    }

    /// Whether the edge between two pairs is too short or of too different lengths, for sure.
    #[inline(always)]
    fn edge_fails(&self, i: u32, j: u32, limits: EdgeLimits) -> bool {
        let ([q, m], [r, n]) = (self.ends[i as usize], self.ends[j as usize]);
        let square = |a: [f32; 4], b: [f32; 4]| {
            let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        };
        let (q, m) = (square(q, r), square(m, n));
        let (short, long) = if q < m { (q, m) } else { (m, q) };
        // What underflows is a length of 10⁻¹⁵ m.
        let short = short + 1e-30;
        (short < limits.shortest) | (short < limits.similarity * long)
    }

    /// Of so many samples drawn with `draw`, those that may pass, in order, at the front of `samples`; how many.
    #[inline]
    pub(super) fn sift(
        &self,
        drawn: usize,
        mut draw: impl FnMut() -> Sample,
        samples: &mut [Sample; BATCH],
        limits: EdgeLimits,
    ) -> usize {
        // Most fail at their first edge. No branch depends on it: none would be foreseen.
        let mut kept = 0;
        for _ in 0..drawn.min(BATCH) {
            let [a, b, c] = draw();
            samples[kept] = [a, b, c];
            kept += usize::from(!self.edge_fails(a, b, limits));
        }
        let mut left = 0;
        for s in 0..kept {
            let [a, b, c] = samples[s];
            samples[left] = [a, b, c];
            left += usize::from(!self.edge_fails(b, c, limits) & !self.edge_fails(c, a, limits));
        }
        left
    }

    /// The pairs that `pose` may take to within `limit` metres of each other, in order, into `found`.
    pub(super) fn within(&self, pose: &Pose, limit: f64, found: &mut Vec<u32>) {
        let r = pose.rotation();
        let centre = pose.transform(self.query_centre);
        let t: [f64; 3] = std::array::from_fn(|a| centre[a] - self.map_centre[a]);
        // Each coordinate of a difference is a sum of five terms, rounded when made, multiplied and added: less than
        // eight roundings of 6·10⁻⁸ of their sizes, that of its length √3 times as much. 2·10⁻⁶ covers them twice.
        let sum = |v: [f64; 3]| v.iter().map(|v| v.abs()).sum::<f64>();
        let size = self.reach + sum(t);
        // And what f64 makes of points far from their origins.
        let far = sum(centre) + sum(self.map_centre) + sum(pose.translation());
        let limit = limit + 2e-6 * size + 1e-13 * far;
        #[expect(clippy::cast_possible_truncation, reason = "rough")]
        let (limit, t) = ((limit * limit * (1.0 + 1e-6)) as f32, t.map(|v| v as f32));
        #[expect(clippy::cast_possible_truncation, reason = "rough")]
        let r: [[f32; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| r[(i, j)] as f32));
        found.clear();
        #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 pairs")]
        let pairs = self.ends.len() as u32;
        simd::wide(
            #[inline(always)]
            || {
                for (first, tile) in (0u32..).step_by(LANES).zip(&self.tiles) {
                    let squares = squares(tile, &r, &t);
                    let mut any = 0u32;
                    for d in &squares {
                        // Not `<=`: NaN must be looked at again.
                        any |= u32::from(!(*d > limit));
                    }
                    if any == 0 {
                        continue;
                    }
                    for (i, d) in (first..pairs).zip(&squares) {
                        if !(*d > limit) {
                            found.push(i);
                        }
                    }
                }
            },
        );
    }
}

/// Squared distances of a tile's pairs under a pose.
#[inline(always)]
fn squares(tile: &Tile, r: &[[f32; 3]; 3], t: &[f32; 3]) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for l in 0..LANES {
        let mut sum = 0.0;
        for i in 0..3 {
            let turned = r[i][0] * tile[0][l] + r[i][1] * tile[1][l] + r[i][2] * tile[2][l];
            let d = turned + (t[i] - tile[3 + i][l]);
            sum += d * d;
        }
        out[l] = sum;
    }
    out
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = points.len().max(1) as f64;
    std::array::from_fn(|a| points.iter().map(|p| p[a]).sum::<f64>() / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ransac::squared_distance;
    use crate::rng::Rng;
    use proptest::prelude::*;

    /// Pairs that a pose takes onto each other, to within about `off` metres, `far` from the origins.
    fn pairs(seed: u64, n: usize, off: f64, far: f64) -> (Vec<[f64; 3]>, Vec<[f64; 3]>, Pose) {
        let mut rng = Rng::new(seed, 0);
        let turn = std::array::from_fn(|_| rng.range(-2.0, 2.0));
        let pose = Pose::from_rotation_vector(turn, [far, -far, 0.3 * far]);
        // As f32, which is what features are.
        let f32s = |p: [f64; 3]| p.map(|v| f64::from(v as f32));
        let query: Vec<[f64; 3]> = (0..n)
            .map(|_| f32s(std::array::from_fn(|_| rng.range(-30.0, 30.0))))
            .collect();
        let map = query
            .iter()
            .map(|q| f32s(pose.transform(*q).map(|v| v + off * rng.normal())))
            .collect();
        (query, map, pose)
    }

    proptest! {
        #[test]
        fn nothing_within_the_limit_is_left_out(seed in 0u64..500, n in 0usize..200, limit in 1e-4..2.0f64, far in 0.0..3e4f64) {
            let (query, map, pose) = pairs(seed, n, limit, far);
            let mut found = vec![7];
            Rough::new(&query, &map).within(&pose, limit, &mut found);
            let within = |i: &u32| {
                let i = *i as usize;
                squared_distance(pose.transform(query[i]), map[i]) <= limit * limit
            };
            let expected: Vec<u32> = (0..n as u32).filter(within).collect();
            prop_assert!(found.is_sorted() && found.iter().all(|i| (*i as usize) < n));
            prop_assert!(expected.iter().all(|i| found.contains(i)));
            // And few that are not: the margin is a hair.
            if far < 100.0 && limit > 0.01 {
                prop_assert!(found.len() <= expected.len() + 2 + n / 50, "{} {}", found.len(), expected.len());
            }
        }

        #[test]
        fn no_sample_whose_edges_agree_is_sifted_out(seed in 0u64..500, n in 3usize..60, off in 0.0..3.0f64, similarity in 0.0..1.0f64, shortest in 0.0..5.0f64) {
            let (query, map, _) = pairs(seed, n, off, 100.0);
            let rough = Rough::new(&query, &map);
            let mut rng = Rng::new(seed, 1);
            let drawn: Vec<Sample> = (0..BATCH)
                .map(|_| std::array::from_fn(|_| rng.below(n as u32)))
                .collect();
            let agrees = |s: &&Sample| {
                [(0, 1), (1, 2), (2, 0)].iter().all(|&(i, j)| {
                    let (i, j) = (s[i] as usize, s[j] as usize);
                    let (q, m) = (squared_distance(query[i], query[j]), squared_distance(map[i], map[j]));
                    let (short, long) = (q.min(m), q.max(m));
                    short >= shortest * shortest && short >= similarity * similarity * long
                })
            };
            let mut next = drawn.iter();
            let mut samples = [[0; 3]; BATCH];
            let limits = rough.edge_limits(similarity, shortest);
            let left = rough.sift(BATCH, || *next.next().unwrap(), &mut samples, limits);
            let mut kept = samples[..left].iter();
            for sample in drawn.iter().filter(agrees) {
                prop_assert!(kept.any(|k| k == sample), "{sample:?} is gone");
            }
        }
    }
}
