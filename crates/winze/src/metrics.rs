//! The paper's metrics, and pose error.

use crate::cloud::Cloud;
use crate::kdtree::{KdTree, Neighbour};
use crate::parallel;
use crate::pose::{Pose, PoseDistance};

/// Share of query points near the map, and how near those are: the paper's inlier % and
/// inlier RMSE.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InlierMetrics {
    /// Query points whose nearest map point is closer than the inlier distance, over all of them.
    pub fraction: f64,
    /// Root mean square distance of those, metres; `None` where there are none.
    pub rmse: Option<f64>,
}

/// The metrics of `query` at `map_from_query` against the points of `map_tree`, whose offsets count
/// from `map_origin`; nearest neighbours under `distance` metres (the paper uses 0.5).
///
/// They cannot tell a passage from its twin (see [`verify`](crate::verify)); they are reported, not
/// trusted.
#[must_use]
pub fn inliers(
    map_tree: &KdTree<'_>,
    map_origin: [f64; 3],
    query: &Cloud,
    map_from_query: &Pose,
    distance: f64,
) -> InlierMetrics {
    let near = near(map_tree, map_origin, query, map_from_query, distance);
    let (count, sum) = parallel::sum(
        query.len(),
        |(count, sum): &mut (usize, f64), i| {
            if let Some(n) = near(i) {
                *count += 1;
                *sum += f64::from(n.distance_squared);
            }
        },
        |a, b| {
            a.0 += b.0;
            a.1 += b.1;
        },
    );
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    InlierMetrics {
        fraction: count as f64 / query.len().max(1) as f64,
        rmse: (count > 0).then(|| (sum / count as f64).sqrt()),
    }
}

/// Which point of the map makes a point of the query an inlier, for all of these, by their indices.
pub(crate) fn near<'a>(
    map_tree: &'a KdTree<'_>,
    map_origin: [f64; 3],
    query: &'a Cloud,
    map_from_query: &Pose,
    distance: f64,
) -> impl Fn(usize) -> Option<Neighbour> + Sync + 'a {
    let pose = map_from_query.between_origins(map_origin, query.origin());
    #[expect(clippy::cast_possible_truncation, reason = "metres")]
    let radius = distance as f32;
    move |i| {
        let p = pose.transform(query.points()[i].map(f64::from));
        #[expect(
            clippy::cast_possible_truncation,
            reason = "offsets within f32's range"
        )]
        let p = p.map(|v| v as f32);
        let near = map_tree.nearest_within(p, radius)?;
        (near.distance_squared < radius * radius).then_some(near)
    }
}

/// How far `map_from_query` is from the `truth`: the displacement of the query's centroid (not of
/// its frame's origin, which may lie far from the points), and the rotation angle.
///
/// `None` for an empty query.
#[must_use]
pub fn pose_error(map_from_query: &Pose, truth: &Pose, query: &Cloud) -> Option<PoseDistance> {
    Some(map_from_query.distance(truth, query.centroid()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_counted_inliers() {
        let map: Vec<[f32; 3]> = (0..10).map(|i| [i as f32, 0.0, 0.0]).collect();
        let (query, _) = Cloud::from_points(&[
            [0.0, 0.3, 0.0],
            [1.0, 0.0, 0.4],
            [2.0, 0.5, 0.0],
            [30.0, 0.0, 0.0],
        ])
        .unwrap();
        let m = inliers(
            &KdTree::build(&map),
            [0.0; 3],
            &query,
            &Pose::identity(),
            0.5,
        );
        assert_eq!(m.fraction, 0.5, "exactly 0.5 m away is not an inlier");
        assert!((m.rmse.unwrap() - (0.125f64).sqrt()).abs() < 1e-7);
        let shifted = Pose::from_translation([0.0, 0.0, 100.0]);
        let none = inliers(&KdTree::build(&map), [0.0; 3], &query, &shifted, 0.5);
        assert_eq!((none.fraction, none.rmse), (0.0, None));
    }

    #[test]
    fn the_error_is_that_of_the_centroid() {
        let (query, _) = Cloud::from_points(&[[1000.0, 0.0, 0.0], [1002.0, 0.0, 0.0]]).unwrap();
        // Turned by 0.01 rad about its own centroid: the origin moves by 10 m, the query not at all.
        let truth = Pose::identity();
        let turned = truth.perturbed([0.0; 3], [0.0, 0.0, 0.01], [1001.0, 0.0, 0.0]);
        let e = pose_error(&turned, &truth, &query).unwrap();
        assert!(e.translation < 1e-9 && (e.rotation - 0.01).abs() < 1e-9);
        assert!(turned.translation()[1].abs() > 9.0);
    }
}
