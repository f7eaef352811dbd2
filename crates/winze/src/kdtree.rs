//! The one neighbour structure: an immutable bucket k-d tree over `f32` points.
//!
//! Built once, never changed, three plain arrays: 16-byte nodes in preorder, coordinates in leaf
//! order (one array an axis, so that leaf loops vectorise), and the original index of each. Median
//! splits by count on the widest axis, so that equal or grid-snapped points cannot unbalance it.
//!
//! # What is guaranteed
//! * Answers are exact: the same as brute force over the same `f32` arithmetic, since a branch's
//!   bound is computed with the operations, in the order, of a point's distance, and rounding is
//!   monotone.
//! * Equal distances are ordered by original index, so answers do not depend on the build.
//! * Radii are inclusive. Queries that are not finite have no neighbours.

/// A neighbour of a query point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbour {
    /// Index of the point in the slice that the tree was built from.
    pub index: u32,
    /// Squared distance, m².
    pub distance_squared: f32,
}

/// Points a leaf holds at most.
const LEAF: usize = 16;
/// Subtrees below this size are built by one thread.
const PARALLEL: usize = 16_384;
/// No tree over 2³² points is deeper.
const MAX_DEPTH: usize = 40;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Node {
    /// Inner node: the left side is `<= split` on `axis`, the right side `>= split`.
    split: f32,
    /// 0, 1 or 2; [`Node::LEAF_MARK`] for a leaf.
    axis: u32,
    /// Inner: distance in nodes to the right child (the left one follows at once). Leaf: first point.
    a: u32,
    /// Leaf: one past the last point.
    b: u32,
}

impl Node {
    const LEAF_MARK: u32 = 3;
}

/// An immutable k-d tree, see the [module documentation](self).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KdTree {
    nodes: Vec<Node>,
    xs: Vec<f32>,
    ys: Vec<f32>,
    zs: Vec<f32>,
    order: Vec<u32>,
}

#[derive(Clone, Copy)]
struct Item {
    p: [f32; 3],
    index: u32,
}

impl KdTree {
    /// The tree over `points`, built on all threads of the current pool. Points that are not
    /// finite are left out. Indices are 32-bit: at most 2³² − 1 points (more are ignored).
    #[must_use]
    pub fn build(points: &[[f32; 3]]) -> Self {
        let mut items: Vec<Item> = (0u32..)
            .zip(points)
            .filter(|(_, p)| p.iter().all(|v| v.is_finite()))
            .map(|(index, &p)| Item { p, index })
            .collect();
        if items.is_empty() {
            return Self::default();
        }
        let nodes = build(&mut items, 0);
        Self {
            nodes,
            xs: items.iter().map(|i| i.p[0]).collect(),
            ys: items.iter().map(|i| i.p[1]).collect(),
            zs: items.iter().map(|i| i.p[2]).collect(),
            order: items.iter().map(|i| i.index).collect(),
        }
    }

    /// Number of points in the tree.
    #[must_use]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// No points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.order.is_empty()
    }

    /// Original indices in leaf order: neighbours in space are near each other in this list, so
    /// points stored in this order are found in cache.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Renames point `order[i]` to `i`: for a caller that has put its points in that order.
    #[must_use]
    pub(crate) fn with_points_in_leaf_order(mut self) -> Self {
        for (i, o) in (0u32..).zip(&mut self.order) {
            *o = i;
        }
        self
    }

    /// The nearest point to `query`.
    #[must_use]
    pub fn nearest(&self, query: [f32; 3]) -> Option<Neighbour> {
        self.nearest_within(query, f32::INFINITY)
    }

    /// The nearest point to `query` that is no further than `radius` (metres).
    #[must_use]
    pub fn nearest_within(&self, query: [f32; 3], radius: f32) -> Option<Neighbour> {
        let mut best = Neighbour {
            index: u32::MAX,
            distance_squared: radius * radius,
        };
        self.visit(query, best.distance_squared, |start, distances| {
            for (i, &d) in distances.iter().enumerate() {
                if d <= best.distance_squared {
                    let index = self.order[start + i];
                    if d < best.distance_squared || index < best.index {
                        best = Neighbour {
                            index,
                            distance_squared: d,
                        };
                    }
                }
            }
            best.distance_squared
        });
        (best.index != u32::MAX && best.distance_squared.is_finite()).then_some(best)
    }

    /// The `k` nearest points to `query` no further than `radius`, nearest first, into `found`
    /// (cleared first).
    pub fn knn(&self, query: [f32; 3], k: usize, radius: f32, found: &mut Vec<Neighbour>) {
        found.clear();
        if k == 0 {
            return;
        }
        let limit = radius * radius;
        self.visit(query, limit, |start, distances| {
            let mut worst = if found.len() == k {
                found[k - 1].distance_squared
            } else {
                limit
            };
            for (i, &d) in distances.iter().enumerate() {
                if d <= worst {
                    let new = Neighbour {
                        index: self.order[start + i],
                        distance_squared: d,
                    };
                    if found.len() == k {
                        if !closer(&new, &found[k - 1]) {
                            continue;
                        }
                        found.pop();
                    }
                    // Insertion from the far end: most newcomers belong there.
                    let mut at = found.len();
                    while at > 0 && closer(&new, &found[at - 1]) {
                        at -= 1;
                    }
                    found.insert(at, new);
                    if found.len() == k {
                        worst = found[k - 1].distance_squared;
                    }
                }
            }
            worst
        });
        found.retain(|n| n.distance_squared.is_finite());
    }

    /// Calls `each(index, distance_squared)` for every point within `radius` of `query`, in leaf
    /// order.
    pub fn within(&self, query: [f32; 3], radius: f32, mut each: impl FnMut(u32, f32)) {
        let limit = radius * radius;
        self.visit(query, limit, |start, distances| {
            for (i, &d) in distances.iter().enumerate() {
                if d <= limit && d.is_finite() {
                    each(self.order[start + i], d);
                }
            }
            limit
        });
    }

    /// Walks the leaves that can hold points within `√limit`, near side first. `leaf` gets the
    /// first position and the squared distances of its points, and answers the new limit.
    fn visit(&self, q: [f32; 3], mut limit: f32, mut leaf: impl FnMut(usize, &[f32]) -> f32) {
        if self.nodes.is_empty() || !q.iter().all(|v| v.is_finite()) {
            return;
        }
        // (node, distance to its region along each axis)
        let mut stack = [(0u32, [0.0f32; 3]); MAX_DEPTH];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (mut at, mut cut) = stack[top];
            if squared(cut) > limit {
                continue;
            }
            loop {
                let node = self.nodes[at as usize];
                if node.axis == Node::LEAF_MARK {
                    let (start, end) = (node.a as usize, node.b as usize);
                    let mut distances = [0.0f32; LEAF];
                    let distances = &mut distances[..end - start];
                    for (((d, x), y), z) in distances
                        .iter_mut()
                        .zip(&self.xs[start..end])
                        .zip(&self.ys[start..end])
                        .zip(&self.zs[start..end])
                    {
                        *d = squared([x - q[0], y - q[1], z - q[2]]);
                    }
                    limit = leaf(start, distances);
                    break;
                }
                let axis = node.axis as usize;
                let offset = node.split - q[axis];
                let (near, far) = if offset >= 0.0 {
                    (at + 1, at + node.a)
                } else {
                    (at + node.a, at + 1)
                };
                let near_cut = cut;
                cut[axis] = offset;
                // Never deeper than the tree: one far child waits a level.
                if squared(cut) <= limit && top < MAX_DEPTH {
                    stack[top] = (far, cut);
                    top += 1;
                }
                cut = near_cut;
                at = near;
            }
        }
    }
}

/// The order of operations matters: branch bounds and point distances must round alike.
#[inline]
fn squared(d: [f32; 3]) -> f32 {
    (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
}

#[inline]
fn closer(a: &Neighbour, b: &Neighbour) -> bool {
    a.distance_squared < b.distance_squared
        || (a.distance_squared == b.distance_squared && a.index < b.index)
}

fn build(items: &mut [Item], start: usize) -> Vec<Node> {
    #[expect(clippy::cast_possible_truncation, reason = "at most 2^32 - 1 points")]
    if items.len() <= LEAF {
        return vec![Node {
            split: 0.0,
            axis: Node::LEAF_MARK,
            a: start as u32,
            b: (start + items.len()) as u32,
        }];
    }
    let axis = widest_axis(items);
    let middle = items.len() / 2;
    let (_, pivot, _) = items.select_nth_unstable_by(middle, |a, b| {
        a.p[axis].total_cmp(&b.p[axis]).then(a.index.cmp(&b.index))
    });
    let split = pivot.p[axis];
    let (left, right) = items.split_at_mut(middle);
    let (left, right) = if left.len() > PARALLEL {
        rayon::join(|| build(left, start), || build(right, start + middle))
    } else {
        (build(left, start), build(right, start + middle))
    };
    let mut nodes = Vec::with_capacity(1 + left.len() + right.len());
    #[expect(clippy::cast_possible_truncation, reason = "fewer nodes than points")]
    nodes.push(Node {
        split,
        axis: axis as u32,
        a: left.len() as u32 + 1,
        b: 0,
    });
    nodes.extend(left);
    nodes.extend(right);
    nodes
}

fn widest_axis(items: &[Item]) -> usize {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for item in items {
        for a in 0..3 {
            low[a] = low[a].min(item.p[a]);
            high[a] = high[a].max(item.p[a]);
        }
    }
    let mut axis = 0;
    for a in 1..3 {
        if high[a] - low[a] > high[axis] - low[axis] {
            axis = a;
        }
    }
    axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use proptest::prelude::*;

    fn brute(points: &[[f32; 3]], q: [f32; 3]) -> Vec<Neighbour> {
        let mut all: Vec<Neighbour> = (0u32..)
            .zip(points)
            .map(|(index, p)| Neighbour {
                index,
                distance_squared: squared([p[0] - q[0], p[1] - q[1], p[2] - q[2]]),
            })
            .collect();
        all.sort_by(|a, b| {
            a.distance_squared
                .total_cmp(&b.distance_squared)
                .then(a.index.cmp(&b.index))
        });
        all
    }

    fn check(points: &[[f32; 3]], q: [f32; 3], k: usize, radius: f32) {
        let tree = KdTree::build(points);
        let expected = brute(points, q);
        assert_eq!(tree.nearest(q), expected.first().copied());
        let mut found = Vec::new();
        tree.knn(q, k, f32::INFINITY, &mut found);
        assert_eq!(found, expected[..k.min(expected.len())]);
        let inside: Vec<Neighbour> = expected
            .iter()
            .copied()
            .filter(|n| n.distance_squared <= radius * radius)
            .collect();
        tree.knn(q, points.len(), radius, &mut found);
        assert_eq!(found, inside);
        found.clear();
        tree.within(q, radius, |index, distance_squared| {
            found.push(Neighbour {
                index,
                distance_squared,
            });
        });
        found.sort_by(|a, b| {
            a.distance_squared
                .total_cmp(&b.distance_squared)
                .then(a.index.cmp(&b.index))
        });
        assert_eq!(found, inside);
        assert_eq!(tree.nearest_within(q, radius), inside.first().copied());
    }

    fn cloud(n: usize, snap: f32, seed: u64) -> Vec<[f32; 3]> {
        let mut rng = Rng::new(seed, 0);
        (0..n)
            .map(|_| {
                std::array::from_fn(|a| {
                    let v = rng.range(-5.0, 5.0) as f32 * [10.0, 1.0, 0.2][a];
                    if snap > 0.0 {
                        (v / snap).round() * snap
                    } else {
                        v
                    }
                })
            })
            .collect()
    }

    #[test]
    fn empty_single_and_broken() {
        let tree = KdTree::build(&[]);
        assert!(tree.is_empty() && tree.nearest([0.0; 3]).is_none());
        let tree = KdTree::build(&[[f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]]);
        assert_eq!(tree.len(), 1);
        assert_eq!(tree.nearest([0.0; 3]).unwrap().index, 1);
        assert!(tree.nearest([f32::NAN, 0.0, 0.0]).is_none());
        assert!(tree.nearest([f32::INFINITY, 0.0, 0.0]).is_none());
        assert!(
            tree.nearest([f32::MAX, 0.0, 0.0]).is_none(),
            "its distance overflows"
        );
        assert!(tree.nearest_within([0.0; 3], 0.5).is_none());
    }

    #[test]
    fn identical_points_are_told_apart_by_index() {
        let points = vec![[1.0, 2.0, 3.0]; 1000];
        let tree = KdTree::build(&points);
        assert_eq!(tree.nearest([1.0, 2.0, 3.0]).unwrap().index, 0);
        let mut found = Vec::new();
        tree.knn([0.0; 3], 7, f32::INFINITY, &mut found);
        assert_eq!(
            found.iter().map(|n| n.index).collect::<Vec<_>>(),
            [0, 1, 2, 3, 4, 5, 6]
        );
    }

    #[test]
    fn the_parallel_build_is_the_serial_build() {
        let points = cloud(100_000, 0.01, 3);
        let pool = |n| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap()
        };
        let one = pool(1).install(|| KdTree::build(&points));
        assert_eq!(one, pool(4).install(|| KdTree::build(&points)));
    }

    #[test]
    fn agrees_with_kiddo_on_a_tunnel() {
        let points = cloud(20_000, 0.0, 5);
        let tree = KdTree::build(&points);
        let oracle = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&points).unwrap();
        for q in cloud(500, 0.0, 6) {
            let theirs = oracle
                .query(&q)
                .nearest_one::<kiddo::SquaredEuclidean<f32>>()
                .execute();
            let ours = tree.nearest(q).unwrap();
            assert!(
                (ours.distance_squared - theirs.distance).abs() <= 1e-6 * theirs.distance.max(1e-3)
            );
        }
    }

    proptest! {
        #[test]
        fn exact_on_random_clouds(seed in 0u64..10_000, n in 1usize..400, k in 1usize..40, r in 0.05f32..20.0) {
            check(&cloud(n, 0.0, seed), cloud(1, 0.0, seed + 1)[0], k, r);
        }

        #[test]
        fn exact_on_grid_snapped_clouds_full_of_ties(seed in 0u64..10_000, n in 1usize..400, k in 1usize..40, r in 0u8..12) {
            check(&cloud(n, 0.5, seed), cloud(1, 0.5, seed + 1)[0], k, f32::from(r) * 0.5);
        }
    }
}
