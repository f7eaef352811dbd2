//! Outlier removal: points that too few others confirm.
//!
//! Dust, stray returns and flying pixels are isolated; walls are not. Each function answers the
//! indices to keep, ascending.

use crate::cloud::Cloud;
use crate::kdtree::KdTree;
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
        points,
        tree,
        (neighbours, deviations),
    );
    kept(&keep)
}

/// As [`statistical`] with its `(neighbours, deviations)`: sets to 0 the marks of the points that go.
/// `mean_distance` is scratch space, one a point.
pub(crate) fn mark_statistical(
    keep: &mut [u8],
    mean_distance: &mut [f64],
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    (neighbours, deviations): (usize, f64),
) {
    if neighbours == 0 || points.len() < 2 {
        return;
    }
    parallel::fill(mean_distance, Vec::new, |found, i| {
        // One more than asked: the point finds itself.
        tree.knn(
            points[i],
            neighbours.saturating_add(1),
            f32::INFINITY,
            found,
        );
        let mut sum = 0.0f64;
        let mut count = 0.0f64;
        let mut own = false;
        for n in found.iter() {
            if !own && n.index as usize == i {
                own = true;
                continue;
            }
            sum += f64::from(n.distance_squared).sqrt();
            count += 1.0;
        }
        if !own && count > neighbours as f64 {
            // So many duplicates that the point itself was not among them: all at distance 0.
            return 0.0;
        }
        sum / count.max(1.0)
    });
    let mean_distance = &*mean_distance;
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = mean_distance.len() as f64;
    let add = |a: &mut f64, b: f64| *a += b;
    let mean = parallel::sum(points.len(), |a: &mut f64, i| *a += mean_distance[i], add) / n;
    let square =
        |a: &mut f64, i: usize| *a += (mean_distance[i] - mean) * (mean_distance[i] - mean);
    let variance = parallel::sum(points.len(), square, add) / (n - 1.0);
    let limit = mean + deviations * variance.sqrt();
    for (keep, d) in keep.iter_mut().zip(mean_distance) {
        *keep &= u8::from(*d <= limit);
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
