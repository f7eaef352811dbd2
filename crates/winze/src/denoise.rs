//! Outlier removal: points that too few others confirm.
//!
//! Dust, stray returns and flying pixels are isolated; walls are not. Each function answers the
//! indices to keep, ascending.

use crate::cloud::Cloud;
use crate::kdtree::KdTree;
use crate::neighbours::{GROUP, Nearest};
use crate::parallel;

/// Points whose distance from `centre` (the cloud's frame, metres) lies in `[min, max]`. A bound
/// of 0 is no bound.
#[must_use]
pub fn within_range(cloud: &Cloud, centre: [f64; 3], min: f64, max: f64) -> Vec<u32> {
    (0u32..)
        .zip(cloud.iter())
        .filter(|(_, p)| {
            let d2: f64 = (0..3)
                .map(|a| (p[a] - centre[a]) * (p[a] - centre[a]))
                .sum();
            d2 >= min * min && (max <= 0.0 || d2 <= max * max)
        })
        .map(|(i, _)| i)
        .collect()
}

/// Statistical outlier removal (Rusu et al. 2008): a point is kept while the mean distance to its
/// `neighbours` nearest others is at most the cloud's mean of that figure plus `deviations` of its
/// standard deviations (over n − 1).
///
/// Mean and deviation are over the whole cloud, so densities should be even: downsample first.
#[must_use]
pub fn statistical(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    neighbours: usize,
    deviations: f64,
) -> Vec<u32> {
    let mut keep = vec![1; points.len()];
    mark_statistical(
        &mut keep,
        &mut vec![0.0; points.len()],
        tree,
        (neighbours, deviations),
    );
    kept(&keep)
}

/// As [`statistical`] with its `(neighbours, deviations)`: sets to 0 the marks of the points that go.
/// `mean_distance` is scratch space, one a point: of those in the tree, in its leaf order.
pub(crate) fn mark_statistical(
    keep: &mut [u8],
    mean_distance: &mut [f64],
    tree: &KdTree<'_>,
    (neighbours, deviations): (usize, f64),
) {
    if neighbours == 0 || tree.len() < 2 {
        return;
    }
    // Points that are not finite are not in the tree, and have no say.
    let mean_distance = &mut mean_distance[..tree.len()];
    // One more than asked: the point finds itself, at no distance.
    let count = neighbours.saturating_add(1).min(tree.len());
    let mean = |sum: f64, found: usize| {
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let others = (found.max(2) - 1) as f64;
        sum / others
    };
    let (_, [xs, ys, zs]) = tree.parts();
    let at = |place: usize| [xs[place], ys[place], zs[place]];
    // In the tree's order, in which points that follow each other are near each other.
    let sought = (count, f32::INFINITY);
    parallel::fill_groups(
        mean_distance,
        GROUP,
        Nearest::default,
        |nearest, group, means| {
            let first = group.start;
            let mut left = group;
            while !left.is_empty() {
                let together = nearest.gather(tree, sought, left.clone(), at);
                left.start = together.end;
                for place in together {
                    let q = at(place);
                    let sum =
                        nearest.ask(|near, guess| near.distance_sum_of_nearest(q, count, guess));
                    means[place - first] = sum.map_or_else(
                        || {
                            let found = nearest.look_up(tree, q, sought);
                            let distances =
                                found.iter().map(|n| f64::from(n.distance_squared).sqrt());
                            mean(distances.sum(), found.len())
                        },
                        |sum| mean(sum, count),
                    );
                }
            }
        },
    );
    let mean_distance = &*mean_distance;
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = tree.len() as f64;
    let add = |a: &mut f64, b: f64| *a += b;
    let mean = parallel::sum(tree.len(), |a: &mut f64, i| *a += mean_distance[i], add) / n;
    let square =
        |a: &mut f64, i: usize| *a += (mean_distance[i] - mean) * (mean_distance[i] - mean);
    let variance = parallel::sum(tree.len(), square, add) / (n - 1.0);
    let limit = mean + deviations * variance.sqrt();
    for (place, d) in mean_distance.iter().enumerate() {
        if let Some(keep) = keep.get_mut(tree.name(place) as usize) {
            *keep &= u8::from(*d <= limit);
        }
    }
}

/// Radius outlier removal: a point is kept while at least `min_neighbours` others lie within
/// `radius` metres.
#[must_use]
pub fn radius(
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    radius: f64,
    min_neighbours: usize,
) -> Vec<u32> {
    let mut keep = vec![1; points.len()];
    mark_radius(&mut keep, points, tree, (radius, min_neighbours));
    kept(&keep)
}

/// As [`radius`] with its `(radius, min_neighbours)`: sets the marks of the points that stay to 1,
/// of the others to 0.
pub(crate) fn mark_radius(
    keep: &mut [u8],
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    (radius, min_neighbours): (f64, usize),
) {
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let radius = radius as f32;
    parallel::fill(keep, Vec::new, |found, i| {
        if min_neighbours == 0 {
            return 1;
        }
        // The nearest few decide; there is no need to count a crowd.
        tree.knn(points[i], min_neighbours.saturating_add(1), radius, found);
        u8::from(found.len() > min_neighbours)
    });
}

fn kept(marks: &[u8]) -> Vec<u32> {
    (0u32..)
        .zip(marks)
        .filter(|(_, keep)| **keep != 0)
        .map(|(i, _)| i)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid_with_strays() -> Vec<[f32; 3]> {
        let mut points: Vec<[f32; 3]> = (0..400)
            .map(|i| [(i % 20) as f32 * 0.1, (i / 20) as f32 * 0.1, 0.0])
            .collect();
        points.push([1.0, 1.0, 3.0]);
        points.push([-5.0, 0.0, 0.0]);
        points
    }

    #[test]
    fn both_filters_drop_exactly_the_strays() {
        let points = grid_with_strays();
        let tree = KdTree::build(&points);
        let expected: Vec<u32> = (0..400).collect();
        assert_eq!(statistical(&points, &tree, 8, 3.0), expected);
        assert_eq!(radius(&points, &tree, 0.25, 3), expected);
    }

    /// Strays, whose reach holds the whole cloud, and points in any order: the figure is that of the tree's own search.
    #[test]
    fn strays_far_out_change_nothing_for_the_others() {
        let mut points: Vec<[f32; 3]> = crate::test_world::drift(9_000, 12.0, 0.2, 0.01, 1)
            .iter()
            .map(|p| p.map(|v| v as f32))
            .collect();
        for i in 0..40 {
            points.insert(
                200 * i,
                [1_000.0 + 200.0 * i as f32, 70.0 * i as f32, -500.0],
            );
        }
        let tree = KdTree::build(&points);
        let mut mean = vec![0.0; points.len()];
        mark_statistical(&mut vec![1; points.len()], &mut mean, &tree, (12, 3.0));
        let mut found = Vec::new();
        // One a point, in the tree's order.
        for (i, mean) in tree.order().iter().zip(mean) {
            tree.knn(points[*i as usize], 13, f32::INFINITY, &mut found);
            let sum: f64 = found
                .iter()
                .map(|n| f64::from(n.distance_squared).sqrt())
                .sum();
            assert!((mean - sum / 12.0).abs() < 1e-6 * mean);
        }
    }

    #[test]
    fn switched_off_or_too_small_they_keep_everything() {
        let points = grid_with_strays();
        let tree = KdTree::build(&points);
        assert_eq!(statistical(&points, &tree, 0, 1.0).len(), 402);
        assert_eq!(radius(&points, &tree, 0.1, 0).len(), 402);
        assert_eq!(
            statistical(&points[..1], &KdTree::build(&points[..1]), 8, 1.0),
            [0]
        );
        let one = [[1.0; 3], [f32::NAN; 3]];
        assert_eq!(statistical(&one, &KdTree::build(&one), 8, 1.0), [0, 1]);
        assert!(statistical(&[], &KdTree::build(&[]), 8, 1.0).is_empty());
    }

    #[test]
    fn identical_points_are_no_outliers() {
        let points = vec![[1.0f32; 3]; 100];
        let tree = KdTree::build(&points);
        assert_eq!(statistical(&points, &tree, 8, 1.0).len(), 100);
        assert_eq!(radius(&points, &tree, 0.1, 5).len(), 100);
    }

    #[test]
    fn range_limits() {
        let (cloud, _) =
            Cloud::from_points(&[[0.2, 0.0, 0.0], [2.0, 0.0, 0.0], [50.0, 0.0, 0.0]]).unwrap();
        assert_eq!(within_range(&cloud, [0.0; 3], 0.5, 30.0), [1]);
        assert_eq!(within_range(&cloud, [0.0; 3], 0.5, 0.0), [1, 2]);
        assert_eq!(within_range(&cloud, [0.0; 3], 0.0, 0.0), [0, 1, 2]);
    }
}
