//! Keypoints and their descriptors.

use std::borrow::Cow;

use crate::columns::{Columns, Memory};
use crate::config::Config;
use crate::fpfh::{self, Descriptor};
use crate::iss;
use crate::prepare::Surface;

/// What matching and estimation need of a cloud. Its arrays are its own, or lie in a mapped file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Features<'a> {
    /// Origin of the offsets, in the cloud's frame, metres.
    pub origin: [f64; 3],
    /// Keypoint positions as offsets.
    pub points: Cow<'a, [[f32; 3]]>,
    /// One descriptor a keypoint.
    pub descriptors: Cow<'a, [Descriptor]>,
    /// How many keypoints passed the ISS test; the rest were filled in by saliency.
    pub qualified: usize,
}

/// The columns of features that were just made, see [`Features`].
pub struct FeatureColumns<C: Columns> {
    /// Keypoint positions as offsets.
    pub points: C::Column<[f32; 3]>,
    /// One descriptor a keypoint.
    pub descriptors: C::Column<Descriptor>,
    /// How many keypoints passed the ISS test.
    pub qualified: usize,
}

/// ISS keypoints of a query's `surface`, at most [`IssConfig::max_keypoints`](crate::config::IssConfig), and
/// their FPFH descriptors.
#[must_use]
pub fn describe(surface: &Surface<'_>, config: &Config) -> Features<'static> {
    describe_all(surface, config, config.iss.max_keypoints)
}

/// As [`describe`], of a map: at most [`IssConfig::max_map_keypoints`](crate::config::IssConfig).
#[must_use]
pub fn describe_map(surface: &Surface<'_>, config: &Config) -> Features<'static> {
    describe_all(surface, config, config.iss.max_map_keypoints)
}

fn describe_all(surface: &Surface<'_>, config: &Config, most: usize) -> Features<'static> {
    let Ok(made) = describe_in(surface, config, most, &Memory);
    Features {
        origin: surface.origin,
        points: Cow::Owned(made.points),
        descriptors: Cow::Owned(made.descriptors),
        qualified: made.qualified,
    }
}

/// At most `most` (0: no limit) ISS keypoints of `surface` and their FPFH descriptors, in `columns`.
///
/// # Errors
/// Where a column cannot be had.
pub fn describe_in<C: Columns>(
    surface: &Surface<'_>,
    config: &Config,
    most: usize,
    columns: &C,
) -> Result<FeatureColumns<C>, C::Error> {
    let (points, tree, voxel) = (&surface.points, &surface.tree, surface.voxel);
    let keypoints = iss::keypoints_in(points, tree, &config.iss, most, voxel, columns)?;
    let descriptors = fpfh::descriptors_in(
        (points, &surface.normals),
        tree,
        &keypoints.indices,
        &config.fpfh,
        voxel,
        columns,
    )?;
    let mut at = columns.zeros(keypoints.indices.len())?;
    for (place, &i) in at.iter_mut().zip(keypoints.indices.iter()) {
        *place = points[i as usize];
    }
    Ok(FeatureColumns {
        points: at,
        descriptors,
        qualified: keypoints.qualified,
    })
}
