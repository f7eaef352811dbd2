//! The settings of the protocol (`bench/README.md`) as winze's own.

use winze::config::{
    Config, DescriptorVariant, FpfhConfig, IcpConfig, IcpMetric, IssCentre, IssConfig, Kernel,
    Length, MatchingConfig, NdtConfig, PrepareConfig, RansacConfig,
};
use winze::normals::Neighbourhood;

/// Nearest neighbours that are asked for, and that a normal is fitted to.
pub(crate) const NEAREST: usize = 20;
/// Radius of a search, voxels.
pub(crate) const SEARCH_RADIUS: f64 = 3.0;
/// Radius that a normal is fitted to, voxels.
const NORMAL_RADIUS: f64 = 2.5;
/// Seed of RANSAC.
pub(crate) const SEED: u64 = 0;

/// A normal of the nearest points.
pub(crate) fn nearest_normal() -> Neighbourhood {
    Neighbourhood {
        radius: 0.0,
        least: 0,
        most: NEAREST,
    }
}

/// A normal of all points within a radius.
pub(crate) fn radius_normal(voxel: f64) -> Neighbourhood {
    Neighbourhood {
        radius: NORMAL_RADIUS * voxel,
        least: 0,
        most: 0,
    }
}

/// Outlier removal and normals, turned to the open side, which FPFH needs.
pub(crate) fn prepare() -> PrepareConfig {
    PrepareConfig {
        denoise_first: true,
        statistical_neighbours: 20,
        statistical_deviations: 2.0,
        normal_radius: Length::Voxels(NORMAL_RADIUS),
        ..PrepareConfig::default()
    }
}

/// The same with normals of the nearest points, as the others' chains have them.
fn prepare_in_chain() -> PrepareConfig {
    PrepareConfig {
        normal_radius: Length::Voxels(0.0),
        normal_least: 0,
        normal_most: NEAREST,
        ..prepare()
    }
}

pub(crate) fn iss() -> IssConfig {
    IssConfig {
        salient_radius: Length::Voxels(6.0),
        non_max_radius: Length::Voxels(4.0),
        gamma_21: 0.975,
        gamma_32: 0.975,
        min_neighbours: 5,
        // What the others do not have.
        min_relief: 0.0,
        cell: Length::Voxels(0.0),
        min_keypoints: 0,
        max_keypoints: 0,
        ..IssConfig::default()
    }
}

/// The same about the neighbourhood's mean, as Open3D takes the scatter.
pub(crate) fn iss_about_mean() -> IssConfig {
    IssConfig {
        centre: IssCentre::Centroid,
        ..iss()
    }
}

/// The keypoints that are described and matched: one a cell, as the paper keeps them and as `locate` has them. Those of `iss`
/// are so few that matching them would measure nothing.
pub(crate) fn described() -> IssConfig {
    IssConfig {
        max_keypoints: 0,
        ..IssConfig::default()
    }
}

/// In PCL's variant, so that the numbers compare.
pub(crate) fn fpfh() -> FpfhConfig {
    FpfhConfig {
        radius: Length::Voxels(5.0),
        variant: DescriptorVariant::Pcl,
        ..FpfhConfig::default()
    }
}

pub(crate) fn matching(mutual: bool) -> MatchingConfig {
    MatchingConfig {
        neighbours: 1,
        mutual,
        ratio: 1.0,
    }
}

pub(crate) fn ransac() -> RansacConfig {
    RansacConfig {
        inlier_distance: Length::Voxels(2.0),
        edge_similarity: 0.9,
        // What the others do not have.
        min_edge: Length::Voxels(0.0),
        min_inliers: 3,
        max_samples: 100_000,
        min_samples: 1,
        confidence: 0.999,
        hypotheses: 1,
        ..RansacConfig::default()
    }
}

pub(crate) fn ndt() -> NdtConfig {
    NdtConfig {
        coarsest: Length::Metres(1.0),
        finest: Length::Metres(1.0),
        max_points: 0,
        max_iterations: 30,
        translation_epsilon: 0.001,
        ..NdtConfig::default()
    }
}

pub(crate) fn icp(metric: IcpMetric) -> IcpConfig {
    IcpConfig {
        metric,
        max_distance: Length::Metres(1.0),
        final_distance: Length::Metres(1.0),
        kernel: Kernel::None,
        max_points: 0,
        max_iterations: 50,
        translation_epsilon: 0.0005,
        rotation_epsilon: 0.00005,
        ..IcpConfig::default()
    }
}

/// The paper's chain.
pub(crate) fn chain() -> Config {
    Config {
        seed: SEED,
        prepare: prepare_in_chain(),
        iss: iss(),
        fpfh: FpfhConfig {
            variant: DescriptorVariant::Paper,
            ..fpfh()
        },
        matching: matching(false),
        ransac: ransac(),
        ndt: ndt(),
        icp: icp(IcpMetric::PointToPoint),
        ..Config::default()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_settings_are_valid() {
        chain().validate().unwrap();
    }
}
