//! An outcome held against the truth.

use winze::confidence::{Evidence, evidence};
use winze::config::VerifyConfig;
use winze::{Outcome, Pose};
use winze_io::CloudFile;
use winze_report::evaluation::{Case as Truth, Inliers, PoseError, Run, mark};

use super::cases::Case;

/// What an outcome's confidence rests on; nothing without a pose.
fn evidence_of(outcome: &Outcome, verify: &VerifyConfig) -> Option<Evidence> {
    let lead = outcome.hypotheses.first()?;
    evidence(
        outcome.verdict,
        lead.relief,
        outcome.unobservable.is_some(),
        verify,
    )
}

/// An outcome held against the truth.
pub(super) fn judged(
    case: &Case,
    truth: &Truth,
    query: &CloudFile,
    outcome: &Outcome,
    verify: &VerifyConfig,
) -> Run {
    let centroid = query.cloud.centroid().unwrap_or_default();
    let open = outcome.unobservable.as_deref().unwrap_or_default();
    let worth = |pose: Option<&Pose>| mark(truth, outcome.verdict, pose, open, centroid);
    Run {
        case: case.name.clone(),
        family: case.family.clone(),
        sensor: case.sensor.clone(),
        overlap: case.overlap,
        method: outcome.method.to_owned(),
        seed: outcome.seed,
        verdict: Some(outcome.verdict),
        reason: outcome.reason.clone(),
        map_from_query: outcome.map_from_query.as_ref().map(Pose::to_matrix),
        mark: worth(outcome.map_from_query.as_ref()),
        confidence: outcome.confidence,
        evidence: evidence_of(outcome, verify),
        patches: outcome
            .hypotheses
            .first()
            .and_then(|h| h.relief)
            .map(|r| [r.asked, r.confirmed]),
        pose_error: truth.truth.as_ref().and_then(|truth| {
            let (pose, covariance) = (outcome.map_from_query?, outcome.covariance()?);
            let information = outcome.information.as_ref();
            PoseError::of(&pose, &covariance, information, truth, centroid)
        }),
        hypotheses: outcome.hypotheses.len(),
        truth_weighed: truth.truth.is_some().then(|| {
            let mut places = outcome.hypotheses.iter();
            places.any(|h| worth(Some(&h.map_from_query)).pose_right)
        }),
        inliers: outcome.inlier_fraction.map(|fraction| Inliers {
            fraction,
            rmse: outcome.inlier_rmse,
        }),
        ceiling: None,
        voxel: outcome.voxel,
        seconds: outcome.seconds - outcome.map_seconds,
        query_kept: false,
        again: Vec::new(),
    }
}
