//! Keypoints and their descriptors.

use crate::config::Config;
use crate::fpfh::{self, Descriptor};
use crate::iss;
use crate::prepare::Surface;

/// What matching and estimation need of a cloud.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Features {
    /// Origin of the offsets, in the cloud's frame, metres.
    pub origin: [f64; 3],
    /// Keypoint positions as offsets.
    pub points: Vec<[f32; 3]>,
    /// One descriptor a keypoint.
    pub descriptors: Vec<Descriptor>,
    /// How many keypoints passed the ISS test; the rest were filled in by saliency.
    pub qualified: usize,
}

/// ISS keypoints of `surface` and their FPFH descriptors.
#[must_use]
pub fn describe(surface: &Surface, config: &Config) -> Features {
    let keypoints = iss::keypoints(&surface.points, &surface.tree, &config.iss, surface.voxel);
    let descriptors = fpfh::descriptors(
        &surface.points,
        &surface.normals,
        &surface.tree,
        &keypoints.indices,
        &config.fpfh,
        surface.voxel,
    );
    Features {
        origin: surface.origin,
        points: keypoints
            .indices
            .iter()
            .map(|&i| surface.points[i as usize])
            .collect(),
        descriptors,
        qualified: keypoints.qualified,
    }
}
