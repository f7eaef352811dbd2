//! Neighbours of many points at once.
//!
//! Points that follow each other in memory are near each other, so they share most of what a search from the
//! root would find: a tree is walked once for a group of them, and each then picks its own from what was found.

use crate::kdtree::{KdTree, Neighbour};

/// Points that share a walk through the tree.
pub(crate) const GROUP: usize = 16;
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
}

impl Neighbours {
    /// Gathers what lies within `radius` of any of `members`.
    pub(crate) fn gather(
        &mut self,
        tree: &KdTree<'_>,
        radius: f32,
        members: impl Iterator<Item = [f32; 3]>,
    ) {
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
        tree.leaves_near(low, high, self.limit, |range| {
            for (own, axis) in self.axes.iter_mut().zip(axes) {
                own.extend_from_slice(&axis[range.clone()]);
            }
            self.names.extend(range.map(|place| tree.name(place)));
        });
    }

    /// The neighbours of `q`, one of the group's members, in the tree's leaf order, itself among them.
    pub(crate) fn of(&mut self, tree: &KdTree<'_>, q: [f32; 3]) -> &[Neighbour] {
        if !self.shared {
            self.collect(tree, q, q);
        }
        let [xs, ys, zs] = &self.axes;
        self.squared.clear();
        self.squared
            .extend(xs.iter().zip(ys).zip(zs).map(|((x, y), z)| {
                let d = [x - q[0], y - q[1], z - q[2]];
                // As the tree rounds it.
                (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
            }));
        // Written whether it belongs or not: that is quicker than asking first.
        let none = Neighbour {
            index: 0,
            distance_squared: 0.0,
        };
        self.found.resize(self.names.len(), none);
        let mut count = 0;
        for (&index, &distance_squared) in self.names.iter().zip(&self.squared) {
            self.found[count] = Neighbour {
                index,
                distance_squared,
            };
            count += usize::from(distance_squared <= self.limit);
        }
        &self.found[..count]
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
    fn an_empty_tree_has_no_neighbours() {
        let tree = KdTree::build(&[]);
        let mut near = Neighbours::default();
        near.gather(&tree, 1.0, [[0.0; 3]].into_iter());
        assert!(near.of(&tree, [0.0; 3]).is_empty());
    }
}
