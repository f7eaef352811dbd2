//! From a raw cloud to a [`Surface`]: range limits, one point a voxel, outliers out, neighbour tree,
//! normals.
//!
//! Thinning comes before outlier removal (unless asked otherwise), so that the statistics of a
//! dense scan and of a sparse map compare, and so that the costly step sees the fewer points.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::columns::{Columns, Memory};
use crate::config::{Orientation, PrepareConfig};
use crate::denoise;
use crate::kdtree::{self, KdTree, TreeColumns};
use crate::normals::{self, Neighbourhood};
use crate::voxel;

/// A prepared cloud: points at one voxel size with normals and a neighbour tree. Its arrays are its
/// own, or lie in a mapped file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface<'a> {
    /// Origin of all offsets, in the cloud's frame, metres.
    pub origin: [f64; 3],
    /// Voxel size the points were thinned to, metres.
    pub voxel: f64,
    /// Offsets from the origin in the tree's leaf order: neighbours in space are neighbours in
    /// memory.
    pub points: Cow<'a, [[f32; 3]]>,
    /// Unit normals, oriented by one rule; `[0, 0, 0]` where undefined.
    pub normals: Cow<'a, [[f32; 3]]>,
    /// Neighbours; its indices are those of `points`.
    pub tree: KdTree<'a>,
}

impl Surface<'_> {
    /// All points in the cloud's frame, `f64`.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        let of = |p: &[f32; 3]| std::array::from_fn(|a| self.origin[a] + f64::from(p[a]));
        self.points.iter().map(of)
    }

    /// The mean point in the cloud's frame, `None` where there are no points.
    #[must_use]
    pub fn centroid(&self) -> Option<[f64; 3]> {
        crate::cloud::centroid(&self.points).map(|c| std::array::from_fn(|a| c[a] + self.origin[a]))
    }
}

/// The columns of a surface that was just made.
pub struct SurfaceColumns<C: Columns> {
    /// See [`Surface::origin`].
    pub origin: [f64; 3],
    /// See [`Surface::voxel`].
    pub voxel: f64,
    /// See [`Surface::points`].
    pub points: C::Column<[f32; 3]>,
    /// See [`Surface::normals`].
    pub normals: C::Column<[f32; 3]>,
    /// The tree over points in another order, which `points` no longer have.
    tree: TreeColumns<C>,
}

impl<C: Columns> SurfaceColumns<C> {
    /// The surface.
    #[must_use]
    pub fn view(&self) -> Surface<'_> {
        Surface {
            origin: self.origin,
            voxel: self.voxel,
            points: Cow::Borrowed(&self.points),
            normals: Cow::Borrowed(&self.normals),
            tree: self.tree.view().with_points_in_leaf_order(),
        }
    }
}

impl SurfaceColumns<Memory> {
    /// The surface, with arrays of its own.
    #[must_use]
    pub fn into_surface(self) -> Surface<'static> {
        Surface {
            origin: self.origin,
            voxel: self.voxel,
            points: Cow::Owned(self.points),
            normals: Cow::Owned(self.normals),
            tree: self.tree.into_tree().with_points_in_leaf_order(),
        }
    }
}

/// Where offsets count from and from where they were seen, in the cloud's frame, metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    /// Origin of all offsets.
    pub origin: [f64; 3],
    /// Where the one sensor stood, where there was one.
    pub viewpoint: Option<[f64; 3]>,
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
pub fn prepare(cloud: &Cloud, config: &PrepareConfig, voxel: f64) -> Surface<'static> {
    let frame = Frame {
        origin: cloud.origin(),
        viewpoint: cloud.viewpoint(),
    };
    let thinned = if config.denoise_first {
        voxel::downsample(&remove_outliers(cloud, config, voxel), voxel)
    } else {
        voxel::downsample(cloud, voxel)
    };
    let Ok(surface) = prepare_in(thinned.into_points(), frame, config, voxel, &Memory);
    surface.into_surface()
}

/// Prepares points that were thinned to `voxel` metres already: outliers out (unless they were to go before,
/// [`PrepareConfig::denoise_first`]), tree, normals.
///
/// # Errors
/// Where a column cannot be had.
pub fn prepare_in<C: Columns>(
    mut points: C::Column<[f32; 3]>,
    frame: Frame,
    config: &PrepareConfig,
    voxel: f64,
    columns: &C,
) -> Result<SurfaceColumns<C>, C::Error> {
    let denoise = !config.denoise_first;
    if denoise && config.statistical_neighbours > 0 {
        let tree = kdtree::build_in(&points, columns)?;
        points = in_leaf_order(&points, &tree, columns)?;
        let tree = tree.view().with_points_in_leaf_order();
        let mut keep = columns.zeros::<u8>(points.len())?;
        keep.fill(1);
        let mut distances = columns.zeros(points.len())?;
        let limits = (config.statistical_neighbours, config.statistical_deviations);
        denoise::mark_statistical(&mut keep, &mut distances, &tree, limits);
        points = select(&points, &keep, columns)?;
    }
    if denoise && config.radius_neighbours > 0 {
        let tree = kdtree::build_in(&points, columns)?;
        let mut keep = columns.zeros::<u8>(points.len())?;
        let limits = (
            config.outlier_radius.metres(voxel),
            config.radius_neighbours,
        );
        denoise::mark_radius(&mut keep, &points, &tree.view(), limits);
        points = select(&points, &keep, columns)?;
    }
    surface_in(points, frame, config, voxel, columns)
}

/// The points of a tree over them, in the order of its leaves.
fn in_leaf_order<C: Columns>(
    points: &[[f32; 3]],
    tree: &TreeColumns<C>,
    columns: &C,
) -> Result<C::Column<[f32; 3]>, C::Error> {
    let mut out = columns.zeros::<[f32; 3]>(tree.order.len())?;
    out.par_iter_mut()
        .zip(tree.order.par_iter())
        .for_each(|(place, &i)| *place = points[i as usize]);
    Ok(out)
}

/// The points that are marked, in order.
fn select<C: Columns>(
    points: &[[f32; 3]],
    keep: &[u8],
    columns: &C,
) -> Result<C::Column<[f32; 3]>, C::Error> {
    let mut out = columns.zeros(keep.iter().filter(|k| **k != 0).count())?;
    let kept = points.iter().zip(keep).filter(|(_, k)| **k != 0);
    for (place, (p, _)) in out.iter_mut().zip(kept) {
        *place = *p;
    }
    Ok(out)
}

/// Tree and normals.
fn surface_in<C: Columns>(
    thinned: C::Column<[f32; 3]>,
    frame: Frame,
    config: &PrepareConfig,
    voxel: f64,
    columns: &C,
) -> Result<SurfaceColumns<C>, C::Error> {
    let tree = kdtree::build_in(&thinned, columns)?;
    let points = in_leaf_order(&thinned, &tree, columns)?;
    let around = Neighbourhood {
        radius: config.normal_radius.metres(voxel),
        least: config.normal_least,
        most: config.normal_most,
    };
    let mut normals = columns.zeros::<[f32; 3]>(points.len())?;
    let named = tree.view().with_points_in_leaf_order();
    normals::estimate_into(&mut normals, &points, &named, around);
    match (config.orientation, frame.viewpoint) {
        (Orientation::Auto, Some(viewpoint)) => {
            let viewpoint = std::array::from_fn(|a| viewpoint[a] - frame.origin[a]);
            normals::orient_towards(&points, &mut normals, viewpoint);
        }
        _ => {
            let radius = config.open_side_radius.metres(voxel);
            let coarse = voxel::thin(&thinned, None, frame.origin, radius / 4.0, columns)?;
            let tree = kdtree::build_in(&coarse, columns)?;
            normals::orient_open_side(&points, &mut normals, &tree.view(), radius);
        }
    }
    Ok(SurfaceColumns {
        origin: frame.origin,
        voxel,
        points,
        normals,
        tree,
    })
}

/// Statistical, then radius outlier removal, each only where it is switched on.
#[must_use]
pub fn remove_outliers(cloud: &Cloud, config: &PrepareConfig, voxel: f64) -> Cloud {
    cloud.select(&confirmed(cloud, config, voxel))
}

/// Indices of the points that [`remove_outliers`] keeps, ascending.
#[must_use]
pub fn confirmed(cloud: &Cloud, config: &PrepareConfig, voxel: f64) -> Vec<u32> {
    #[expect(clippy::cast_possible_truncation, reason = "a cloud's size")]
    let mut kept: Vec<u32> = (0..cloud.len() as u32).collect();
    if config.statistical_neighbours > 0 {
        let tree = KdTree::build(cloud.points());
        kept = denoise::statistical(
            cloud.points(),
            &tree,
            config.statistical_neighbours,
            config.statistical_deviations,
        );
    }
    if config.radius_neighbours > 0 {
        let left: Vec<[f32; 3]> = kept.iter().map(|&i| cloud.points()[i as usize]).collect();
        let stay = denoise::radius(
            &left,
            &KdTree::build(&left),
            config.outlier_radius.metres(voxel),
            config.radius_neighbours,
        );
        kept = stay.into_iter().map(|i| kept[i as usize]).collect();
    }
    kept
}

/// A unit normal for each point of `cloud` as it is, fitted and turned as [`prepare`] does it for one that was seen from
/// `viewpoint` (the cloud's frame, metres; `None`: its own); `[0, 0, 0]` where undefined. The lengths of `config` count in `voxel`
/// metres, or about the spacing of its points.
#[must_use]
pub fn normals(
    cloud: &Cloud,
    config: &PrepareConfig,
    voxel: f64,
    viewpoint: Option<[f64; 3]>,
) -> Vec<[f32; 3]> {
    let frame = Frame {
        origin: cloud.origin(),
        viewpoint: viewpoint.or(cloud.viewpoint()),
    };
    let made = surface_in(cloud.points().to_vec(), frame, config, voxel, &Memory);
    let Ok(SurfaceColumns {
        normals: in_leaf_order,
        tree,
        ..
    }) = made;
    let mut normals = vec![[0.0; 3]; cloud.len()];
    for (&i, normal) in tree.order.iter().zip(in_leaf_order) {
        normals[i as usize] = normal;
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_world::{cloud, drift};

    #[test]
    fn normals_of_a_cloud_are_in_its_order() {
        let points = drift(6_000, 12.0, 0.3, 0.005, 4);
        let cloud = cloud(&points);
        let config = PrepareConfig {
            statistical_neighbours: 0,
            ..PrepareConfig::default()
        };
        let thinned = voxel::downsample(&cloud, 0.2);
        let surface = prepare(&cloud, &config, 0.2);
        let normals = normals(&thinned, &config, 0.2, None);
        assert_eq!(normals.len(), thinned.len());
        for (p, n) in surface.points.iter().zip(surface.normals.iter()) {
            let i = thinned.points().iter().position(|q| q == p).unwrap();
            assert_eq!(normals[i], *n);
        }
    }

    #[test]
    fn confirmed_points_are_those_that_stay() {
        let mut points = drift(6_000, 12.0, 0.3, 0.005, 4);
        points.insert(100, [6.0, 0.0, 40.0]);
        let cloud = cloud(&points);
        let config = PrepareConfig {
            radius_neighbours: 2,
            ..PrepareConfig::default()
        };
        let kept = confirmed(&cloud, &config, 0.2);
        assert!(!kept.contains(&100) && kept.len() > 5_500 && kept.is_sorted());
        assert_eq!(cloud.select(&kept), remove_outliers(&cloud, &config, 0.2));
    }

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
        for (i, p) in (0u32..).zip(s.points.iter()) {
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
            .zip(s.normals.iter())
            .filter(|(p, n)| n[0] * (3.0 - p[0]) - n[1] * p[1] - n[2] * p[2] >= 0.0);
        assert_eq!(facing.count(), s.points.len());
    }
}
