//! Neighbours of many points at once.
//!
//! Points that follow each other in memory are near each other, so they share most of what a search from the
//! root would find: a tree is walked once for a group of them, and each then picks its own from what was found.

use std::ops::Range;

use crate::kdtree::{KdTree, Neighbour};
use crate::simd;

/// Points that share a walk through the tree.
pub(crate) const GROUP: usize = 16;
/// Places that are looked at together.
const BLOCK: usize = 16;
/// A group wider than this many radii is no group: its points are looked up one by one.
const WIDEST: f32 = 2.0;

/// What lies near a group of points, and scratch space.
#[derive(Debug, Default)]
pub(crate) struct Neighbours {
    axes: [Vec<f32>; 3],
    names: Vec<u32>,
    squared: Vec<f32>,
    found: Vec<Neighbour>,
    limit: f32,
    shared: bool,
    /// Places that are gathered at most, and whether there were more.
    most: usize,
    over: bool,
}

impl Neighbours {
    /// Gathers what lies within `radius` of any of `members`.
    pub(crate) fn gather(
        &mut self,
        tree: &KdTree<'_>,
        radius: f32,
        members: impl Iterator<Item = [f32; 3]>,
    ) {
        self.gather_up_to(usize::MAX, tree, radius, members);
    }

    /// The same for [`Neighbours::nearest_of`] alone, which finds nothing where there is more than about `most`: a
    /// radius that was guessed too wide must not hold the whole cloud.
    pub(crate) fn gather_up_to(
        &mut self,
        most: usize,
        tree: &KdTree<'_>,
        radius: f32,
        members: impl Iterator<Item = [f32; 3]>,
    ) {
        self.most = most;
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for p in members {
            for a in 0..3 {
                low[a] = low[a].min(p[a]);
                high[a] = high[a].max(p[a]);
            }
        }
        self.limit = radius * radius;
        self.shared = (0..3).all(|a| high[a] - low[a] <= WIDEST * radius);
        if self.shared {
            self.collect(tree, low, high);
        }
    }

    fn collect(&mut self, tree: &KdTree<'_>, low: [f32; 3], high: [f32; 3]) {
        self.axes.iter_mut().for_each(Vec::clear);
        self.names.clear();
        let (_, axes) = tree.parts();
        let most = self.most;
        let mut take = |range: Range<usize>| {
            for (own, axis) in self.axes.iter_mut().zip(axes) {
                own.extend_from_slice(&axis[range.clone()]);
            }
            tree.names(range, &mut self.names);
        };
        // Leaves that follow each other are copied together.
        let mut run = 0..0;
        let mut count = 0;
        tree.leaves_near(low, high, self.limit, |range| {
            count += range.len();
            if count > most {
                return;
            }
            if range.start == run.end {
                run.end = range.end;
            } else {
                take(std::mem::replace(&mut run, range));
            }
        });
        take(run);
        self.over = count > most;
    }

    /// The neighbours of `q`, one of the group's members, in the tree's leaf order, itself among them.
    pub(crate) fn of(&mut self, tree: &KdTree<'_>, q: [f32; 3]) -> &[Neighbour] {
        if !self.shared {
            self.collect(tree, q, q);
        }
        let none = Neighbour {
            index: 0,
            distance_squared: 0.0,
        };
        self.found.resize(self.names.len(), none);
        self.squared.resize(self.names.len(), 0.0);
        let (found, limit) = (&mut self.found[..], self.limit);
        let (axes, names, squared) = (&self.axes, &self.names[..], &mut self.squared[..]);
        let count = simd::wide(
            #[inline(always)]
            || {
                distances(axes, q, squared);
                let mut count = 0;
                for (names, squared) in names.chunks(BLOCK).zip(squared.chunks(BLOCK)) {
                    // Most blocks lie wholly outside.
                    let within: u32 = squared.iter().map(|d| u32::from(*d <= limit)).sum();
                    if within == 0 {
                        continue;
                    }
                    // Written whether it belongs or not: that is quicker than asking first.
                    for (&index, &distance_squared) in names.iter().zip(squared) {
                        found[count] = Neighbour {
                            index,
                            distance_squared,
                        };
                        count += usize::from(distance_squared <= limit);
                    }
                }
                count
            },
        );
        &self.found[..count]
    }

    /// The squared distances of the `count` nearest to `q`, one of the group's members, itself among them, ascending; or
    /// `None` where fewer lie within the radius, or too many were near.
    pub(crate) fn nearest_of(
        &mut self,
        tree: &KdTree<'_>,
        q: [f32; 3],
        count: usize,
    ) -> Option<&[f32]> {
        if !self.shared {
            self.collect(tree, q, q);
        }
        if self.over {
            return None;
        }
        self.squared.resize(self.names.len(), 0.0);
        let (axes, squared, limit) = (&self.axes, &mut self.squared[..], self.limit);
        let within = simd::wide(
            #[inline(always)]
            || {
                distances(axes, q, squared);
                let mut within = 0;
                for k in 0..squared.len() {
                    let d = squared[k];
                    squared[within] = d;
                    within += usize::from(d <= limit);
                }
                within
            },
        );
        let squared = &mut squared[..within];
        let last = count.checked_sub(1).filter(|_| count <= within)?;
        squared.select_nth_unstable_by(last, f32::total_cmp);
        let nearest = &mut squared[..count];
        nearest.sort_unstable_by(f32::total_cmp);
        Some(nearest)
    }
}

/// The squared distance of each place from `q`, as the tree rounds it.
#[inline(always)]
fn distances([xs, ys, zs]: &[Vec<f32>; 3], q: [f32; 3], squared: &mut [f32]) {
    for (((out, x), y), z) in squared.iter_mut().zip(xs).zip(ys).zip(zs) {
        let d = [x - q[0], y - q[1], z - q[2]];
        *out = (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_world::{drift, surface};

    #[test]
    fn a_group_finds_what_each_of_its_points_would() {
        let s = surface(&drift(20_000, 12.0, 0.3, 0.0, 1), 0.2);
        let mut near = Neighbours::default();
        for radius in [0.05, 0.5, 1.3] {
            // Neighbours in memory, then points from all over the place.
            for step in [1, 97] {
                let group: Vec<[f32; 3]> = s
                    .points
                    .iter()
                    .skip(500)
                    .step_by(step)
                    .take(GROUP)
                    .copied()
                    .collect();
                near.gather(&s.tree, radius, group.iter().copied());
                for p in &group {
                    let mut expected = Vec::new();
                    s.tree.within(*p, radius, |index, distance_squared| {
                        expected.push(Neighbour {
                            index,
                            distance_squared,
                        });
                    });
                    expected.sort_unstable_by_key(|n| n.index);
                    assert_eq!(near.of(&s.tree, *p), expected);
                }
            }
        }
    }

    #[test]
    fn the_nearest_of_a_group_are_those_of_the_tree() {
        let s = surface(&drift(20_000, 12.0, 0.3, 0.0, 1), 0.2);
        let mut near = Neighbours::default();
        let mut expected = Vec::new();
        // Neighbours in memory, then points from all over the place, then a few of one place.
        let neighbours = s.points.chunks(GROUP).step_by(40).map(<[_]>::to_vec);
        let scattered: Vec<[f32; 3]> = s.points.iter().step_by(97).copied().collect();
        let same = vec![s.points[7]; 3];
        for group in neighbours.chain([scattered, same]) {
            near.gather(&s.tree, 0.6, group.iter().copied());
            for p in &group {
                for count in [1, 9, 20] {
                    s.tree.knn(*p, count, f32::INFINITY, &mut expected);
                    let mut expected: Vec<f32> =
                        expected.iter().map(|n| n.distance_squared).collect();
                    expected.retain(|d| *d <= 0.6 * 0.6);
                    match near.nearest_of(&s.tree, *p, count) {
                        Some(found) => assert_eq!(found, expected),
                        None => assert!(expected.len() < count),
                    }
                }
            }
        }
        assert!(near.nearest_of(&s.tree, s.points[0], 0).is_none());
        let all = [s.points[0]];
        near.gather_up_to(100, &s.tree, 1e3, all.into_iter());
        assert!(near.nearest_of(&s.tree, s.points[0], 9).is_none());
        assert!(near.names.len() <= 100);
        near.gather(&s.tree, 1e3, all.into_iter());
        assert!(near.nearest_of(&s.tree, s.points[0], 9).is_some());
    }

    #[test]
    fn an_empty_tree_has_no_neighbours() {
        let tree = KdTree::build(&[]);
        let mut near = Neighbours::default();
        near.gather(&tree, 1.0, [[0.0; 3]].into_iter());
        assert!(near.of(&tree, [0.0; 3]).is_empty());
    }
}
