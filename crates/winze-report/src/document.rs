//! The outcome as JSON, the contract that programs rely on.

use serde::Serialize;
use winze::degeneracy::Unobservable;
use winze::icp::Information;
use winze::outcome::Stage;
use winze::refine::StopReason;
use winze::{Outcome, Pose, PoseDistance, Verdict};

/// Where a cloud came from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Source {
    /// Its path as given; null where there was no file.
    pub path: Option<String>,
    /// Digest of the file's bytes.
    pub digest: Option<String>,
    /// Finite points used.
    pub points: usize,
}

/// One line of `hypotheses`.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct HypothesisRow {
    map_from_query: [[f64; 4]; 4],
    score: f64,
    median_point_to_plane: Option<f64>,
    inlier_fraction: f64,
    overlap: f64,
    /// Patches of wall asked whether it is the same rock, and those that say yes; null where none was asked.
    patches: Option<PatchesRow>,
    /// Whether it cannot be ruled out beside the first.
    rival: bool,
    stop: Option<StopReason>,
}

/// What the rock says of a place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct PatchesRow {
    asked: usize,
    confirmed: usize,
    /// How far off one rigid pose pieces of the query lie, root mean square, metres; null where that was not measured.
    bend: Option<f64>,
    /// How far off the query's centroid that may leave the pose, where part of the query is not on the map, metres; null likewise.
    beyond: Option<f64>,
    /// Share of the query's points in pieces that lie on the map by themselves; null likewise.
    followed: Option<f64>,
    /// Whether the patches were asked where those pieces lie.
    piecewise: bool,
}

/// What was known or said beforehand, in the document's `request`.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Asked {
    /// Both clouds were said to have z up.
    pub gravity_aligned: bool,
    /// Centre and radius of the search region, map frame, metres.
    pub near: Option<[f64; 4]>,
    /// The start pose, `map_from_query`.
    pub initial: Option<[[f64; 4]; 4]>,
}

impl From<&winze::Request<'_>> for Asked {
    fn from(request: &winze::Request<'_>) -> Self {
        Self {
            gravity_aligned: request.gravity_aligned,
            near: request.near.map(|n| {
                let [x, y, z] = n.centre;
                [x, y, z, n.radius]
            }),
            initial: request.initial.as_ref().map(Pose::to_matrix),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct ErrorRow {
    translation_m: f64,
    rotation_deg: f64,
}

/// The whole document, in the order it is written. What was not computed is null.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Document {
    winze: &'static str,
    verdict: Verdict,
    confidence: Option<f64>,
    reason: String,
    map_from_query: Option<[[f64; 4]; 4]>,
    covariance: Option<[[f64; 6]; 6]>,
    covariance_at: Option<[f64; 3]>,
    /// The same about where the pose puts the query's origin: what a message that holds a pose and its covariance wants.
    covariance_at_origin: Option<[[f64; 6]; 6]>,
    unobservable: Option<Vec<Unobservable>>,
    information: Option<Information>,
    hypotheses: Vec<HypothesisRow>,
    inlier_fraction: Option<f64>,
    inlier_rmse: Option<f64>,
    inlier_distance: f64,
    inlier_reference: &'static str,
    error: Option<ErrorRow>,
    voxel: Option<f64>,
    stages: Vec<Stage>,
    seconds: f64,
    method: &'static str,
    seed: u64,
    request: Asked,
    pub(crate) config_digest: String,
    pub(crate) map: Source,
    pub(crate) query: Source,
}

impl Document {
    /// Everything about one run.
    #[must_use]
    pub fn new(
        outcome: &Outcome,
        error: Option<&PoseDistance>,
        request: Asked,
        config_digest: String,
        map: Source,
        query: Source,
    ) -> Self {
        Self {
            winze: env!("CARGO_PKG_VERSION"),
            verdict: outcome.verdict,
            confidence: outcome.confidence,
            reason: outcome.reason.clone(),
            map_from_query: outcome.map_from_query.as_ref().map(Pose::to_matrix),
            covariance: outcome.covariance,
            covariance_at: outcome.covariance_at,
            covariance_at_origin: outcome.covariance().map(|c| {
                let pose = outcome.map_from_query.unwrap_or_default();
                c.about(pose.translation()).matrix
            }),
            unobservable: outcome.unobservable.clone(),
            information: outcome.information,
            hypotheses: outcome
                .hypotheses
                .iter()
                .map(|h| HypothesisRow {
                    map_from_query: h.map_from_query.to_matrix(),
                    score: h.score,
                    median_point_to_plane: h.median_point_to_plane,
                    inlier_fraction: h.inlier_fraction,
                    overlap: h.overlap,
                    patches: h.relief.map(|r| PatchesRow {
                        asked: r.asked,
                        confirmed: r.confirmed,
                        bend: r.bend,
                        beyond: r.beyond,
                        followed: r.followed,
                        piecewise: r.piecewise,
                    }),
                    rival: h.rival,
                    stop: h.stop,
                })
                .collect(),
            inlier_fraction: outcome.inlier_fraction,
            inlier_rmse: outcome.inlier_rmse,
            inlier_distance: outcome.inlier_distance,
            inlier_reference: outcome.inlier_reference,
            error: error.map(|e| ErrorRow {
                translation_m: e.translation,
                rotation_deg: e.rotation.to_degrees(),
            }),
            voxel: outcome.voxel,
            stages: outcome.stages.clone(),
            seconds: outcome.seconds,
            method: outcome.method,
            seed: outcome.seed,
            request,
            config_digest,
            map,
            query,
        }
    }

    /// The document as indented JSON text with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Only maps with keys that are no strings could fail, and there are none.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }
}
