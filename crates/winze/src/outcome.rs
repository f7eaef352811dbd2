//! The answer.

use crate::covariance::Covariance;
use crate::degeneracy::Unobservable;
use crate::icp::Information;
use crate::pose::{Pose, PoseDistance};
use crate::refine::StopReason;
use crate::relief::Relief;

/// What is known about where the query lies. Never an error: each is an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Verdict {
    /// Here it is.
    Located,
    /// Several places fit; they are among the hypotheses.
    Ambiguous,
    /// The place is known, but not along some directions; they are named.
    Degenerate,
    /// No place in this map fits well enough.
    NotFound,
    /// Too little geometry in the query.
    Insufficient,
}

impl Verdict {
    /// The name used in JSON and on the terminal.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Located => "located",
            Self::Ambiguous => "ambiguous",
            Self::Degenerate => "degenerate",
            Self::NotFound => "not_found",
            Self::Insufficient => "insufficient",
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// One stage of the run.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Stage {
    /// What it did.
    pub name: String,
    /// Wall time, seconds.
    pub seconds: f64,
    /// Things that went in: points, keypoints, correspondences or hypotheses.
    #[cfg_attr(feature = "serde", serde(rename = "in"))]
    pub count_in: usize,
    /// Things that came out.
    #[cfg_attr(feature = "serde", serde(rename = "out"))]
    pub count_out: usize,
}

/// A place that was weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RankedHypothesis {
    /// Takes query points to the map.
    pub map_from_query: Pose,
    /// Share of the query's prepared points that lie finely on the map's surface. Places are ranked by what the rock says, then
    /// by it.
    pub score: f64,
    /// Median distance of the overlapping points from the map's tangent planes, metres; `None`
    /// where nothing overlaps.
    pub median_point_to_plane: Option<f64>,
    /// Share of the query's prepared points within the inlier distance of a prepared map point.
    pub inlier_fraction: f64,
    /// Share of them with map surface within the overlap distance.
    pub overlap: f64,
    /// Whether it is the same rock, patch by patch; `None` where that was not asked.
    pub relief: Option<Relief>,
    /// Whether it cannot be ruled out beside the place answered.
    pub rival: bool,
    /// Why its refinement stopped; `None` where it was not refined.
    pub stop: Option<StopReason>,
}

/// Everything that is known after a run. What was not computed is `None`, never invented.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The answer in a word.
    pub verdict: Verdict,
    /// And in a sentence.
    pub reason: String,
    /// Probability that the pose is within 0.5 m and 5° of the truth, as [counted on simulated queries](crate::confidence); `None` without a pose,
    /// for verdicts given too rarely to count (`degenerate`, `insufficient`), and for methods and settings that were not counted.
    pub confidence: Option<f64>,
    /// The best pose found, whatever the verdict; takes query points to the map.
    pub map_from_query: Option<Pose>,
    /// [Covariance](crate::covariance) of a perturbation `[δt, δθ]` of the pose in map axes about `covariance_at`, m², m·rad and rad²; `None` where
    /// the fit was too poor to ask, or too little of the query lies on the map to tell. Of an answer that a bent query's pieces gave, residuals are taken
    /// at that one pose.
    pub covariance: Option<[[f64; 6]; 6]>,
    /// The query's centroid in the map at the pose, metres.
    pub covariance_at: Option<[f64; 3]>,
    /// Directions that the geometry leaves open at the pose; `None` where the fit was too poor to ask.
    pub unobservable: Option<Vec<Unobservable>>,
    /// What a point-to-plane fit says about the pose; `None` likewise.
    pub information: Option<Information>,
    /// Distinct places weighed, the one answered first.
    pub hypotheses: Vec<RankedHypothesis>,
    /// The paper's inlier share, over all finite points of the query as read.
    pub inlier_fraction: Option<f64>,
    /// And its inlier RMSE, metres; `None` where nothing is an inlier.
    pub inlier_rmse: Option<f64>,
    /// The distance below which a point is an inlier there, metres.
    pub inlier_distance: f64,
    /// What the query was held against for them.
    pub inlier_reference: &'static str,
    /// Voxel size that the answer was found at, metres.
    pub voxel: Option<f64>,
    /// Stages in the order they ran.
    pub stages: Vec<Stage>,
    /// Wall time of them all, seconds.
    pub seconds: f64,
    /// Of these, seconds spent on the map alone: what need not be done again for the next query, where
    /// the map is kept.
    pub map_seconds: f64,
    /// The method's name.
    pub method: &'static str,
    /// The seed.
    pub seed: u64,
    /// Points of the map as given.
    pub map_points: usize,
    /// Points of the query as given.
    pub query_points: usize,
}

impl Outcome {
    /// The covariance with the point that it is about, to be moved to another point or frame.
    #[must_use]
    pub fn covariance(&self) -> Option<Covariance> {
        Some(Covariance {
            matrix: self.covariance?,
            about: self.covariance_at?,
        })
    }

    /// The pose error against a known truth: the displacement of the query's centroid and the
    /// angle. `None` without a pose.
    #[must_use]
    pub fn error(&self, truth: &Pose, query: &crate::Cloud) -> Option<PoseDistance> {
        crate::metrics::pose_error(self.map_from_query.as_ref()?, truth, query)
    }
}
