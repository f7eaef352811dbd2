//! The sections: one plain struct a stage.

use super::Rule::{self, Any, Between, NonNegative, OneOf, Positive, UpTo};
use super::choices::{DescriptorVariant, IcpMetric, IssCentre, Kernel, NdtForm, Orientation};
use super::length::Length;
use super::schema::{Checked, section};

/// No length is longer than this, in metres or in voxels: a mistyped one must not look at the whole
/// map from every point.
const LONGEST: f64 = 1000.0;

section! {
    /// The length scale that everything follows from.
    pub struct ScaleConfig("scale") {
        /// Voxel size in metres; 0 takes it from the data (point spacing, passage width, extent).
        voxel: f64 = 0.0, Between(0.0, 1e6);
        /// How many scales `auto` tries before it gives up.
        tries: usize = 3, Between(1.0, 8.0);
    }
}

section! {
    /// From a raw cloud to an even one with normals.
    pub struct PrepareConfig("prepare") {
        /// Query points nearer to the sensor than this are dropped (the robot itself), metres; 0: none.
        min_range: f64 = 0.0, NonNegative;
        /// Query points further from the sensor than this are dropped, metres; 0: none.
        max_range: f64 = 0.0, NonNegative;
        /// Remove outliers before thinning, as the paper does; else after, where densities are even.
        denoise_first: bool = false, Any;
        /// Neighbours of the statistical outlier test; 0 switches it off.
        statistical_neighbours: usize = 12, Between(0.0, 1000.0);
        /// A point stays while its mean neighbour distance is below mean + this many deviations.
        statistical_deviations: f64 = 3.0, NonNegative;
        /// Radius of the radius outlier test.
        outlier_radius: Length = Length::Voxels(3.0), Between(0.0, LONGEST);
        /// Neighbours a point must have within that radius; 0 switches the test off.
        radius_neighbours: usize = 0, Between(0.0, 1000.0);
        /// Radius of the neighbourhood a normal is fitted to.
        normal_radius: Length = Length::Voxels(3.5), Between(0.0, LONGEST);
        /// Nearest neighbours that it takes even beyond the radius, where rings or rows lie far apart.
        normal_least: usize = 16, Between(0.0, 1000.0);
        /// Nearest neighbours that it takes at most; 0: all within the radius.
        normal_most: usize = 0, Between(0.0, 1000.0);
        /// Where the sign of a normal comes from.
        orientation: Orientation = Orientation::OpenSide, OneOf(Orientation::NAMES);
        /// Radius within which the open side of a surface is judged: about a passage's width.
        open_side_radius: Length = Length::Voxels(16.0), UpTo(LONGEST);
    }
}

section! {
    /// ISS keypoints.
    pub struct IssConfig("iss") {
        /// Radius of the neighbourhood whose scatter is taken.
        salient_radius: Length = Length::Voxels(6.0), UpTo(LONGEST);
        /// Bound on λ2/λ1, the paper's γ21.
        gamma_21: f64 = 0.975, Between(0.0, 1.0);
        /// Bound on λ3/λ2, the paper's γ32.
        gamma_32: f64 = 0.975, Between(0.0, 1.0);
        /// λ3 over the squared radius must exceed this: how much relief a keypoint needs.
        min_relief: f64 = 0.0005, NonNegative;
        /// Neighbours a point must have within the salient radius.
        min_neighbours: usize = 5, Any;
        /// What the scatter is taken about.
        centre: IssCentre = IssCentre::Point, OneOf(IssCentre::NAMES);
        /// Weigh each neighbour by the inverse of its own number of neighbours.
        density_weighting: bool = false, Any;
        /// One keypoint a cell of this size is kept; 0: no cells.
        cell: Length = Length::Voxels(3.0), Between(0.0, LONGEST);
        /// A keypoint must be the most salient within this radius; 0: no such test.
        non_max_radius: Length = Length::Voxels(0.0), Between(0.0, LONGEST);
        /// Where fewer keypoints qualify, the most salient others fill up to this many.
        min_keypoints: usize = 2000, Any;
        /// At most this many keypoints of a query, the most salient; 0: no limit.
        max_keypoints: usize = 20_000, Any;
        /// At most this many of a map, at each of its scales; 0: no limit.
        max_map_keypoints: usize = 0, Any;
    }
}

section! {
    /// FPFH descriptors.
    pub struct FpfhConfig("fpfh") {
        /// Radius of the neighbourhood that is described.
        radius: Length = Length::Voxels(6.0), UpTo(LONGEST);
        /// How neighbours' histograms are summed.
        variant: DescriptorVariant = DescriptorVariant::Paper, OneOf(DescriptorVariant::NAMES);
        /// Describe without regard to the signs of normals.
        unsigned: bool = false, Any;
    }
}

section! {
    /// Descriptor matching of the paper's methods (`auto` takes all nearest, see `[graph]`).
    pub struct MatchingConfig("matching") {
        /// Nearest map descriptors taken for each query descriptor.
        neighbours: usize = 1, Between(1.0, 64.0);
        /// Keep a match only if it is one seen from the map as well.
        mutual: bool = true, Any;
        /// Drop a match that is not closer than this times the next best; 1: keep all.
        ratio: f64 = 1.0, Between(0.0, 1.0);
    }
}

section! {
    /// RANSAC over correspondences, in the paper's methods (`auto`: `[graph]`).
    pub struct RansacConfig("ransac") {
        /// A correspondence is an inlier of a pose within this distance.
        inlier_distance: Length = Length::Voxels(2.0), UpTo(LONGEST);
        /// Ratio of an edge's lengths in the two clouds below which a sample is thrown away.
        edge_similarity: f64 = 0.9, Between(0.0, 1.0);
        /// Edges of a sample must be longer than this.
        min_edge: Length = Length::Voxels(4.0), Between(0.0, LONGEST);
        /// Samples drawn at most.
        max_samples: usize = 2_000_000, Between(1.0, 1e12);
        /// Samples drawn at least: rivals have less support than the best pose and show later.
        min_samples: usize = 500_000, Between(1.0, 1e12);
        /// Sampling ends when a better pose would have been drawn with this probability.
        confidence: f64 = 0.999, Between(0.0, 0.999_999_999);
        /// Inliers a pose must have.
        min_inliers: usize = 4, Between(3.0, 1e9);
        /// Distinct poses kept.
        hypotheses: usize = 32, Between(1.0, 1000.0);
        /// Poses nearer than this (and 15 degrees) are one.
        distinct_distance: Length = Length::Voxels(5.0), Between(0.0, LONGEST);
    }
}

section! {
    /// Poses from correspondences that agree pair by pair (`auto`).
    pub struct GraphConfig("graph") {
        /// Nearest map descriptors taken for each query descriptor.
        neighbours: usize = 2, Between(1.0, 64.0);
        /// Correspondences used at most, those whose descriptors are nearest.
        max_pairs: usize = 4000, Between(3.0, 20_000.0);
        /// Distances of two correspondences may differ by this much,
        inlier_distance: Length = Length::Voxels(1.5), UpTo(LONGEST);
        /// and by this share of themselves, since odometry stretches a query.
        stretch: f64 = 0.01, Between(0.0, 0.5);
        /// Correspondences nearer to each other than this say nothing about a pose.
        min_edge: Length = Length::Voxels(4.0), Between(0.0, LONGEST);
        /// Cosines of the angles between normals and the line that joins them may differ by this much.
        angle_tolerance: f64 = 0.25, Between(0.0, 2.0);
        /// Keypoints that must agree with a pose.
        min_inliers: usize = 4, Between(3.0, 1e9);
        /// Distinct poses kept.
        hypotheses: usize = 64, Between(1.0, 1000.0);
        /// Poses nearer than this (and 15 degrees) are one.
        distinct_distance: Length = Length::Voxels(5.0), Between(0.0, LONGEST);
    }
}

section! {
    /// NDT refinement.
    pub struct NdtConfig("ndt") {
        /// Cell size to begin with.
        coarsest: Length = Length::Voxels(8.0), Between(0.01, LONGEST);
        /// Cell size to end with; sizes halve in between.
        finest: Length = Length::Voxels(4.0), Between(0.01, LONGEST);
        /// Cells that a point looks at: its own (1), with face (7) or corner (27) neighbours.
        neighbours: usize = 7, OneOf(&["1", "7", "27"]);
        /// Points a cell must hold to have a Gaussian.
        min_points: usize = 6, Between(3.0, 1e9);
        /// Eigenvalues of a Gaussian are raised to this share of its largest.
        eigenvalue_floor: f64 = 0.01, Between(1e-9, 1.0);
        /// The objective.
        form: NdtForm = NdtForm::Mixture, OneOf(NdtForm::NAMES);
        /// Expected share of points that belong to no Gaussian (mixture form).
        outlier_ratio: f64 = 0.55, Between(0.01, 0.99);
        /// Query points used at most, evenly drawn; 0: all.
        max_points: usize = 4000, Any;
        /// Query points that must meet a Gaussian.
        min_pairs: usize = 20, Any;
        /// Iterations at each cell size.
        max_iterations: usize = 30, Between(1.0, 1e6);
        /// In the paper's methods, NDT is followed from a pose that features found only where it gains more than noise
        /// gives (`ndt+icp` begins with a guess; `auto` weighs many places instead).
        keep_better: bool = true, Any;
        /// Ends when a step is shorter than this, metres,
        translation_epsilon: f64 = 0.001, NonNegative;
        /// and turns less than this, radians.
        rotation_epsilon: f64 = 0.0001, NonNegative;
    }
}

section! {
    /// ICP refinement.
    pub struct IcpConfig("icp") {
        /// What is minimised (`auto` always ends with point-to-plane).
        metric: IcpMetric = IcpMetric::PointToPoint, OneOf(IcpMetric::NAMES);
        /// Pairs further apart than this do not count at first;
        max_distance: Length = Length::Voxels(4.0), UpTo(LONGEST);
        /// once the pose has settled within it, the bound shrinks by this factor an iteration,
        shrink: f64 = 0.8, Between(0.01, 0.99);
        /// down to this.
        final_distance: Length = Length::Voxels(1.5), UpTo(LONGEST);
        /// How residuals are weighted.
        kernel: Kernel = Kernel::None, OneOf(Kernel::NAMES);
        /// The kernel's scale as a share of the current bound.
        kernel_scale: f64 = 0.3, Positive;
        /// Share of the pairs kept, the closest; 1: all.
        trim: f64 = 1.0, Between(0.01, 1.0);
        /// Query points used at most, evenly drawn; 0: all.
        max_points: usize = 10_000, Any;
        /// Pairs that must be found.
        min_pairs: usize = 20, Any;
        /// Iterations at most.
        max_iterations: usize = 50, Between(1.0, 1e6);
        /// Ends when a step is shorter than this, metres,
        translation_epsilon: f64 = 0.0005, NonNegative;
        /// and turns less than this, radians.
        rotation_epsilon: f64 = 0.00005, NonNegative;
        /// Keep the pose it began with unless the query then lies more finely on the map, by more than noise gives;
        /// `false` runs the paper's bare chain.
        keep_better: bool = true, Any;
    }
}

section! {
    /// Verification and verdict.
    pub struct VerifyConfig("verify") {
        /// The paper's inlier distance, metres, for its metrics alone: the verdict does not use it.
        inlier_distance: f64 = 0.5, Positive;
        /// A query point overlaps the map where map surface lies within this distance.
        overlap_distance: Length = Length::Voxels(1.5), UpTo(LONGEST);
        /// And fits finely within this distance of its tangent plane.
        fine_tolerance: Length = Length::Voxels(0.25), UpTo(LONGEST);
        /// Where the rock does not tell: overlap below which no place counts as fitting.
        min_overlap: f64 = 0.5, Between(0.0, 1.0);
        /// Share of the overlapping points that must fit finely.
        min_fine_share: f64 = 0.5, Between(0.0, 1.0);
        /// A rival's overlap, as a share of the best's, from which it makes the answer ambiguous,
        rival_overlap: f64 = 0.5, Between(0.0, 1.0);
        /// where its median point-to-plane residual is below this many times the best's.
        rival_residual: f64 = 1.6, NonNegative;
        /// Places that a first refinement leaves at more than this many times the finest one's residual are
        /// weighed as they are: the last refinement is not spent on them.
        hopeless_residual: f64 = 4.0, Between(1.0, 1e6);
        /// Information (a pair's share) below which a direction is unobservable.
        min_information: f64 = 0.01, Between(0.0, 1.0);
        /// The same where the rock has confirmed the place, and so resists.
        min_information_confirmed: f64 = 0.001, Between(0.0, 1.0);
        /// Size of the patches of wall that are asked whether they lie on the rock they were seen on,
        patch_size: Length = Length::Voxels(10.0), UpTo(LONGEST);
        /// but at least this share of the passages' width (the step grows with it),
        patch_width: f64 = 0.3, Between(0.0, 10.0);
        /// how far each is moved to see whether it lies as finely there,
        patch_step: Length = Length::Voxels(5.0), UpTo(LONGEST);
        /// how far from it the map's surface may lie,
        patch_reach: Length = Length::Voxels(4.0), UpTo(LONGEST);
        /// size of the pieces of a bent query, each of which finds its own place,
        piece_size: Length = Length::Voxels(40.0), UpTo(LONGEST);
        /// how far off one rigid pose the pieces must lie for it to count as bent,
        straight: Length = Length::Voxels(0.5), UpTo(LONGEST);
        /// share of the query that must lie in pieces on the map for their rigid fit to be an answer,
        min_followed: f64 = 0.6, Between(0.0, 1.0);
        /// how far off the query's centroid, metres, a bend may leave the answer where the rest of the query bends on alike,
        max_beyond: f64 = 0.25, Positive;
        /// and how many patches are asked at most.
        patches: usize = 300, Between(1.0, 1e6);
        /// Patches that must have been asked for a place to be believed,
        min_patches: usize = 15, Between(1.0, 1e6);
        /// and the standard deviations by which those that say yes must exceed chance,
        min_significance: f64 = 3.0, NonNegative;
        /// short of so many, no other place may fit better by its shape; a place that has so many is a rival of any other,
        sure_significance: f64 = 4.0, NonNegative;
        /// and so is one with this share of the best place's excess over chance: the answer is ambiguous.
        rival_excess: f64 = 0.4, Between(0.0, 1.0);
        /// Overlap below which no place is believed, whatever the rock says.
        least_overlap: f64 = 0.1, Between(0.0, 1.0);
        /// Refined poses nearer than this are one place, if
        merge_distance: Length = Length::Voxels(1.5), Between(0.0, LONGEST);
        /// they also differ by less than this angle, degrees.
        merge_angle: f64 = 5.0, Between(0.0, 180.0);
        /// Query points used at most, evenly drawn; 0: all.
        max_points: usize = 8_000, Any;
        /// Prepared query points below which the answer is `insufficient`.
        min_points: usize = 100, Any;
        /// Hypotheses that are refined to the end: those of which, at first sight, most of the query lies
        refined: usize = 8, Between(1.0, 1000.0);
        /// within this distance of the map.
        first_look_distance: Length = Length::Voxels(3.0), UpTo(LONGEST);
    }
}

section! {
    /// How the SLAM that made the query errs, one standard deviation each. For the covariance alone. All but `map`: where part of the query is not in the map,
    /// it hangs on the rest by these.
    pub struct OdometryConfig("odometry") {
        /// Scale of its steps, a share.
        scale: f64 = 0.003, Between(0.0, 1.0);
        /// Constant turn of its heading, degrees a metre.
        turn: f64 = 0.01, Between(0.0, 90.0);
        /// Random walk of its heading, degrees after one metre.
        turn_walk: f64 = 0.02, Between(0.0, 90.0);
        /// Random walk of its position about each axis, metres after one metre.
        walk: f64 = 0.003, Between(0.0, 10.0);
        /// How far off the pose may be as a whole, metres, for what no residual shows: the map was made by some odometry too, and the fit clings to some
        /// walls more than to others. Level; upright by the share of `tilt`, where the map's z is up.
        map: f64 = 0.01, Between(0.0, 10.0);
        /// How much of the turns also tilts, away from the map's z: little where the SLAM knows gravity and z is up.
        tilt: f64 = 0.1, Between(0.0, 1.0);
    }
}

impl VerifyConfig {
    /// The settings at a voxel size, metres, in a map whose passages are so many metres wide, where that was measured: patches and pieces, and
    /// how far a patch is moved, are lengths in metres, grown alike until a patch is [`patch_width`](Self::patch_width) of the width.
    #[must_use]
    pub fn at(&self, voxel: f64, width: Option<f64>) -> Self {
        let (size, step) = (self.patch_size.metres(voxel), self.patch_step.metres(voxel));
        let wider = (width.unwrap_or(0.0) * self.patch_width / size).max(1.0);
        Self {
            patch_size: Length::Metres(size * wider),
            patch_step: Length::Metres(step * wider),
            piece_size: Length::Metres(self.piece_size.metres(voxel) * wider),
            ..self.clone()
        }
    }
}
