//! From a raw cloud to a [`Surface`]: range limits, one point a voxel, outliers out, neighbour tree,
//! normals.
//!
//! Thinning comes before outlier removal (unless asked otherwise), so that the statistics of a
//! dense scan and of a sparse map compare, and so that the costly step sees the fewer points.

use crate::cloud::Cloud;
use crate::config::{Orientation, PrepareConfig};
use crate::denoise;
use crate::kdtree::KdTree;
use crate::normals::{self, Neighbourhood};
use crate::voxel;

/// A prepared cloud: points at one voxel size with normals and a neighbour tree.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// Origin of all offsets, in the cloud's frame, metres.
    pub origin: [f64; 3],
    /// Voxel size the points were thinned to, metres.
    pub voxel: f64,
    /// Offsets from the origin in the tree's leaf order: neighbours in space are neighbours in
    /// memory.
    pub points: Vec<[f32; 3]>,
    /// Unit normals, oriented by one rule; `[0, 0, 0]` where undefined.
    pub normals: Vec<[f32; 3]>,
    /// Neighbours; its indices are those of `points`.
    pub tree: KdTree,
}

impl Surface {
    /// The mean point in the cloud's frame, `None` where there are no points.
    #[must_use]
    pub fn centroid(&self) -> Option<[f64; 3]> {
        crate::cloud::centroid(&self.points).map(|c| std::array::from_fn(|a| c[a] + self.origin[a]))
    }
}

/// The query's range limits: points nearer than `min_range` or further than `max_range` from the
/// sensor (the cloud's viewpoint, else its frame's origin) are dropped.
#[must_use]
pub fn limit_range(cloud: &Cloud, config: &PrepareConfig) -> Cloud {
    if config.min_range <= 0.0 && config.max_range <= 0.0 {
        return cloud.clone();
    }
    let centre = cloud.viewpoint().unwrap_or([0.0; 3]);
    cloud.select(&denoise::within_range(
        cloud,
        centre,
        config.min_range,
        config.max_range,
    ))
}

/// Prepares `cloud` at `voxel` metres.
#[must_use]
pub fn prepare(cloud: &Cloud, config: &PrepareConfig, voxel: f64) -> Surface {
    let thinned = if config.denoise_first {
        voxel::downsample(&remove_outliers(cloud, config, voxel), voxel)
    } else {
        remove_outliers(&voxel::downsample(cloud, voxel), config, voxel)
    };
    let tree = KdTree::build(thinned.points());
    let points: Vec<[f32; 3]> = tree
        .order()
        .iter()
        .map(|&i| thinned.points()[i as usize])
        .collect();
    let tree = tree.with_points_in_leaf_order();
    let around = Neighbourhood {
        radius: config.normal_radius.metres(voxel),
        least: config.normal_least,
        most: config.normal_most,
    };
    let mut normals = normals::estimate(&points, &tree, around);
    match (config.orientation, thinned.viewpoint()) {
        (Orientation::Auto, Some(viewpoint)) => {
            let origin = thinned.origin();
            normals::orient_towards(
                &points,
                &mut normals,
                std::array::from_fn(|a| viewpoint[a] - origin[a]),
            );
        }
        _ => orient_open_side(
            &thinned,
            &points,
            &mut normals,
            config.open_side_radius.metres(voxel),
        ),
    }
    Surface {
        origin: thinned.origin(),
        voxel,
        points,
        normals,
        tree,
    }
}

/// Statistical, then radius outlier removal, each only where it is switched on.
#[must_use]
pub fn remove_outliers(cloud: &Cloud, config: &PrepareConfig, voxel: f64) -> Cloud {
    let mut cloud = cloud.clone();
    if config.statistical_neighbours > 0 {
        let tree = KdTree::build(cloud.points());
        cloud = cloud.select(&denoise::statistical(
            cloud.points(),
            &tree,
            config.statistical_neighbours,
            config.statistical_deviations,
        ));
    }
    if config.radius_neighbours > 0 {
        let tree = KdTree::build(cloud.points());
        cloud = cloud.select(&denoise::radius(
            cloud.points(),
            &tree,
            config.outlier_radius.metres(voxel),
            config.radius_neighbours,
        ));
    }
    cloud
}

fn orient_open_side(thinned: &Cloud, points: &[[f32; 3]], normals: &mut [[f32; 3]], radius: f64) {
    let coarse = voxel::downsample(thinned, radius / 4.0);
    let tree = KdTree::build(coarse.points());
    normals::orient_open_side(points, normals, &tree, coarse.points(), radius);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_world::{cloud, drift};

    #[test]
    fn strays_go_and_walls_stay() {
        let mut points = drift(60_000, 20.0, 0.2, 0.01, 1);
        points.extend((0..20).map(|i| [f64::from(i), 0.0, 30.0 + 3.0 * f64::from(i)]));
        let s = prepare(&cloud(&points), &PrepareConfig::default(), 0.2);
        assert!(s.points.iter().all(|p| p[2] < 5.0));
        let none = PrepareConfig {
            statistical_neighbours: 0,
            ..PrepareConfig::default()
        };
        let all = prepare(&cloud(&points), &none, 0.2);
        assert!(s.points.len() as f64 > 0.97 * all.points.len() as f64);
        assert_eq!(
            (s.points.len(), s.normals.len()),
            (s.tree.len(), s.tree.len())
        );
        let first = PrepareConfig {
            denoise_first: true,
            ..PrepareConfig::default()
        };
        assert!(
            prepare(&cloud(&points), &first, 0.2)
                .points
                .iter()
                .all(|p| p[2] < 5.0)
        );
    }

    #[test]
    fn the_tree_speaks_of_the_surface_s_own_points() {
        let s = prepare(
            &cloud(&drift(5_000, 5.0, 0.2, 0.01, 1)),
            &PrepareConfig::default(),
            0.2,
        );
        for (i, p) in (0u32..).zip(&s.points) {
            assert_eq!(s.tree.nearest(*p).unwrap().index, i);
        }
    }

    #[test]
    fn range_limits_count_from_the_sensor() {
        let c = cloud(&[[0.1, 0.0, 0.0], [3.0, 0.0, 0.0], [90.0, 0.0, 0.0]]);
        let config = PrepareConfig {
            min_range: 0.5,
            max_range: 60.0,
            ..PrepareConfig::default()
        };
        assert_eq!(limit_range(&c, &config).len(), 1);
        let seen = c.seen_from(Some([90.0, 0.0, 0.0]));
        assert_eq!(limit_range(&seen, &config).len(), 0);
    }

    #[test]
    fn normals_face_a_known_sensor() {
        let c = cloud(&drift(20_000, 6.0, 0.1, 0.0, 1)).seen_from(Some([3.0, 0.0, 0.0]));
        let config = PrepareConfig {
            orientation: Orientation::Auto,
            ..PrepareConfig::default()
        };
        let s = prepare(&c, &config, 0.2);
        let facing = s
            .points
            .iter()
            .zip(&s.normals)
            .filter(|(p, n)| n[0] * (3.0 - p[0]) - n[1] * p[1] - n[2] * p[2] >= 0.0);
        assert_eq!(facing.count(), s.points.len());
    }
}
