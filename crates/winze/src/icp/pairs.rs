//! Each query point's nearest map point, at one pose after another.
//!
//! A refiner asks for the same points' neighbours again and again, at poses that differ less and less. A search that tells the two
//! nearest map points, and how near any *third* one lies, holds for more than its own pose: as long as the point has moved less than
//! what lies between, one of the two is still the nearest, and nothing needs to be searched. Answers are those of
//! [`KdTree::nearest_within`](crate::kdtree::KdTree::nearest_within) to the bit, whichever way they were found.

use rayon::prelude::*;

use crate::cancel;
use crate::kdtree::{NOWHERE, squared};
use crate::pose::Pose;
use crate::prepare::Surface;

/// No map point.
const NONE: u32 = NOWHERE.index;
/// Points that a thread takes at a time.
const CHUNK: usize = 1024;
/// What rounding of single-precision distances may take from a bound, as a share of it.
const ROUNDING: f32 = 1e-5;

/// A query point and its nearest map point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    pub(super) query: u32,
    pub(super) map: u32,
    pub(super) distance_squared: f32,
}

/// What the last search for a query point told.
#[derive(Debug, Clone, Copy)]
struct Known {
    /// Where the point was.
    at: [f32; 3],
    /// What was nearest and second nearest.
    nearest: [u32; 2],
    /// No other map point lies nearer to that place than this, metres.
    others: f32,
}

/// The pairs of a query with a map, see the [module documentation](self).
pub(super) struct Pairing<'a> {
    map: &'a Surface<'a>,
    query: &'a [[f32; 3]],
    known: Vec<Known>,
    /// The pose was not yet asked about: the next one may lie far from it.
    first: bool,
}

impl<'a> Pairing<'a> {
    pub(super) fn new(map: &'a Surface<'a>, query: &'a [[f32; 3]]) -> Self {
        let nothing = Known {
            at: [0.0; 3],
            nearest: [NONE; 2],
            others: -1.0,
        };
        Self {
            map,
            query,
            known: vec![nothing; query.len()],
            first: true,
        }
    }

    pub(super) fn map(&self) -> &'a Surface<'a> {
        self.map
    }

    pub(super) fn query(&self) -> &'a [[f32; 3]] {
        self.query
    }

    /// The pairs no further apart than `distance` metres with the query at `pose`, in the order of the query's points.
    pub(super) fn at(&mut self, pose: &Pose, distance: f64) -> Vec<Pair> {
        #[expect(clippy::cast_possible_truncation, reason = "metres")]
        let radius = distance as f32;
        let search = Search {
            map: self.map,
            radius,
            reach: 1.125 * radius,
            first: std::mem::replace(&mut self.first, false),
        };
        let parts: Vec<Vec<Pair>> = self
            .known
            .par_chunks_mut(CHUNK)
            .zip(self.query.par_chunks(CHUNK))
            .enumerate()
            .map(|(c, (known, points))| {
                cancel::check();
                #[expect(clippy::cast_possible_truncation, reason = "fewer than 2^32 points")]
                let first = (c * CHUNK) as u32;
                search.chunk(known, points, pose, first)
            })
            .collect();
        parts.concat()
    }
}

/// Keeps the closest `share` of the pairs.
pub(super) fn trim(pairs: &mut Vec<Pair>, share: f64) {
    if share >= 1.0 || pairs.is_empty() {
        return;
    }
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a count"
    )]
    let keep = ((pairs.len() as f64 * share).ceil() as usize).clamp(1, pairs.len());
    let mut distances: Vec<f32> = pairs.iter().map(|p| p.distance_squared).collect();
    let limit = *distances.select_nth_unstable_by(keep - 1, f32::total_cmp).1;
    pairs.retain(|p| p.distance_squared <= limit);
}

/// How pairs are looked for at one pose.
struct Search<'a> {
    map: &'a Surface<'a>,
    radius: f32,
    /// Searched further than asked, so that what lies beyond the radius need not be searched again at once.
    reach: f32,
    first: bool,
}

impl Search<'_> {
    /// The pairs of points that follow each other, the first of which is point `first` of the query.
    fn chunk(
        &self,
        known: &mut [Known],
        points: &[[f32; 3]],
        pose: &Pose,
        first: u32,
    ) -> Vec<Pair> {
        let limit = self.radius * self.radius;
        let mut pairs = Vec::with_capacity(points.len());
        // What is nearest to one point is near the next.
        let mut hint = NONE;
        for (query, (known, p)) in (first..).zip(known.iter_mut().zip(points)) {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "offsets within f32's range"
            )]
            let at = pose.transform(p.map(f64::from)).map(|v| v as f32);
            let (mut map, mut d) = self.nearer(known, at);
            if !self.holds(known, at, d) {
                (*known, map, d) = self.searched(known, at, hint);
            }
            hint = map;
            if d <= limit && map != NONE {
                pairs.push(Pair {
                    query,
                    map,
                    distance_squared: d,
                });
            }
        }
        pairs
    }

    /// The nearer one of the two that were nearest, and its squared distance.
    #[inline]
    fn nearer(&self, known: &Known, at: [f32; 3]) -> (u32, f32) {
        let [a, b] = known.nearest.map(|name| self.squared(name, at));
        let [first, second] = known.nearest;
        if b < a || (b == a && second < first) {
            (second, b)
        } else {
            (first, a)
        }
    }

    /// Whether no other can be as near.
    #[inline]
    fn holds(&self, known: &Known, at: [f32; 3], nearest: f32) -> bool {
        let moved = squared_apart(at, known.at).sqrt();
        // Beyond the radius nothing counts.
        let reached = nearest.sqrt().min(self.radius);
        (reached + moved) * (1.0 + ROUNDING) < known.others
    }

    /// By a walk through the tree, no further than to what is known to be near.
    fn searched(&self, known: &Known, at: [f32; 3], hint: u32) -> (Known, u32, f32) {
        let near = self.nearer(known, at).1.min(self.squared(hint, at)).sqrt();
        let near = near * (1.0 + ROUNDING);
        let (reach, found, other) = if self.first {
            // From here the pose goes far, so that no bound would hold: the nearest alone is asked for.
            let reach = near.min(self.reach);
            let nearest = self.map.tree.nearest_within(at, reach).unwrap_or(NOWHERE);
            (reach, [nearest, NOWHERE], nearest)
        } else {
            #[expect(clippy::cast_possible_truncation, reason = "metres")]
            let reach = (near + self.map.voxel as f32).min(self.reach);
            let [first, second, third] = self.map.tree.three_nearest(at, reach);
            (reach, [first, second], third)
        };
        let others = other.distance_squared.sqrt().min(reach);
        let known = Known {
            at,
            nearest: found.map(|n| n.index),
            others: others * (1.0 - ROUNDING),
        };
        (known, found[0].index, found[0].distance_squared)
    }

    #[inline]
    fn squared(&self, name: u32, at: [f32; 3]) -> f32 {
        let point = self.map.points.get(name as usize);
        point.map_or(f32::INFINITY, |p| squared_apart(*p, at))
    }
}

/// The squared distance of two points, as the tree rounds it.
#[inline]
fn squared_apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    squared([a[0] - b[0], a[1] - b[1], a[2] - b[2]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use crate::test_world::{drift, surface};

    /// What a search for each point alone finds.
    fn alone(map: &Surface<'_>, query: &[[f32; 3]], pose: &Pose, distance: f32) -> Vec<Pair> {
        (0u32..)
            .zip(query)
            .filter_map(|(i, p)| {
                let at = pose.transform(p.map(f64::from)).map(|v| v as f32);
                map.tree.nearest_within(at, distance).map(|n| Pair {
                    query: i,
                    map: n.index,
                    distance_squared: n.distance_squared,
                })
            })
            .collect()
    }

    #[test]
    fn pairs_at_one_pose_after_another_are_those_of_searches_alone() {
        let map = surface(&drift(40_000, 14.0, 0.3, 0.0, 1), 0.2);
        let query = surface(&drift(30_000, 18.0, 0.3, 0.01, 2), 0.2);
        // Its own points among them, where second neighbours tie, and some from all over the place.
        let mut points = query.points.to_vec();
        points.extend(map.points.iter().step_by(3));
        points.extend(map.points.iter().step_by(97));
        points.push([500.0, 0.0, 0.0]);
        points.push([f32::NAN; 3]);
        let mut rng = Rng::new(4, 0);
        let mut pairing = Pairing::new(&map, &points);
        let mut pose = Pose::identity();
        let mut compared = 0;
        for step in [
            0.0, 0.5, 0.3, 0.05, 0.02, 0.01, 0.01, 0.003, 1e-3, 1e-5, 0.0, 2.0, 0.01,
        ] {
            let (t, r) = (rng.direction(), rng.direction());
            pose = pose.perturbed(
                t.map(|v| v * step),
                r.map(|v| 0.1 * v * step),
                [7.0, 0.0, 0.0],
            );
            for distance in [1.0, 0.3, 0.11, 0.4] {
                let expected = alone(&map, &points, &pose, distance);
                assert_eq!(pairing.at(&pose, f64::from(distance)), expected);
                compared += expected.len();
            }
        }
        assert!(compared > 100_000);
    }

    #[test]
    fn a_grid_s_ties_go_to_the_first() {
        let grid: Vec<[f64; 3]> = (0..4000)
            .map(|i| {
                [
                    f64::from(i % 20),
                    f64::from(i / 20 % 20),
                    f64::from(i / 400),
                ]
            })
            .collect();
        let map = surface(&grid, 1.0);
        let points: Vec<[f32; 3]> = (0..2000)
            .map(|i| {
                [
                    (i % 37) as f32 * 0.5,
                    (i / 37) as f32 * 0.25,
                    (i % 11) as f32 * 0.5,
                ]
            })
            .collect();
        let mut pairing = Pairing::new(&map, &points);
        for x in [0.0, 0.25, 0.5, 0.5, 1.0] {
            let pose = Pose::from_translation([x, 0.0, 0.0]);
            assert_eq!(pairing.at(&pose, 2.0), alone(&map, &points, &pose, 2.0));
        }
    }

    #[test]
    fn no_map_no_pairs() {
        let map = Surface::default();
        assert_eq!(
            Pairing::new(&map, &[[0.0; 3]]).at(&Pose::identity(), 1.0),
            []
        );
    }
}
