//! The top of the page: the verdict, what it means, and the numbers that are asked for first.

use std::fmt::Write as _;

use winze::config::VerifyConfig;
use winze::{Outcome, PoseDistance, Verdict};

use super::escape;
use crate::criteria::meaning;
use crate::scene::ellipsoid;

/// The verdict in large, and what it means.
pub(super) fn answer(outcome: &Outcome, verify: &VerifyConfig) -> String {
    let verdict = outcome.verdict;
    format!(
        "<header><div class=\"answer\"><h1 class=\"{}\"><span class=\"mark\" aria-hidden=\"true\"><b>{}</b></span>{}</h1>\
         <p class=\"meaning\">{}</p></div></header>",
        verdict.name(),
        mark(verdict),
        title(verdict),
        meaning(outcome, verify)
    )
}

/// The numbers that are asked for first.
pub(super) fn fact_list(outcome: &Outcome, error: Option<&PoseDistance>) -> String {
    let facts = facts(outcome, error);
    if facts.is_empty() {
        return String::new();
    }
    let mut out = String::from("<dl class=\"facts\">");
    for (name, value, small) in facts {
        let _ = write!(
            out,
            "<div><dt>{name}</dt><dd>{}<small>{}</small></dd></div>",
            escape(&value),
            escape(&small)
        );
    }
    out + "</dl>"
}

fn title(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Located => "Located",
        Verdict::Ambiguous => "Ambiguous",
        Verdict::Degenerate => "Degenerate",
        Verdict::NotFound => "Not found",
        Verdict::Insufficient => "Insufficient",
    }
}

fn mark(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Located => "✓",
        Verdict::Ambiguous => "?",
        Verdict::Degenerate => "↔",
        Verdict::NotFound => "✕",
        Verdict::Insufficient => "…",
    }
}

/// Name, value, and a remark.
fn facts(outcome: &Outcome, error: Option<&PoseDistance>) -> Vec<(&'static str, String, String)> {
    let mut facts = Vec::new();
    let believed = matches!(outcome.verdict, Verdict::Located | Verdict::Degenerate);
    let guess = if believed {
        String::new()
    } else {
        " of the best guess, not to be relied on".to_owned()
    };
    if let Some(confidence) = outcome.confidence {
        let digits = if confidence > 0.99 { 2 } else { 1 };
        facts.push((
            "Confidence",
            format!("{:.digits$} %", 100.0 * confidence),
            "that the pose is right".into(),
        ));
    }
    if let Some([x, y, z]) = outcome.covariance_at {
        facts.push((
            "The query's centre in the map",
            format!("{x:.2}, {y:.2}, {z:.2} m"),
            format!("x, y, z{guess}"),
        ));
    }
    if let Some(pose) = &outcome.map_from_query {
        let [yaw, pitch, roll] = pose.yaw_pitch_roll().map(f64::to_degrees);
        let [x, y, z] = pose.translation();
        facts.push((
            "Its frame's attitude and origin",
            format!("{yaw:.1}°, {pitch:.1}°, {roll:.1}°"),
            format!("yaw, pitch, roll; {x:.2}, {y:.2}, {z:.2} m{guess}"),
        ));
    }
    if let (Some(e), Some(c)) = (ellipsoid(outcome), outcome.covariance) {
        let [a, b, c_] = e.half.map(length);
        let long = if outcome.verdict == Verdict::Degenerate {
            let [x, y, z] = e.long();
            format!(", the longest along ({x:.2}, {y:.2}, {z:.2})")
        } else {
            String::new()
        };
        let turn = (c[3][3] + c[4][4] + c[5][5]).max(0.0).sqrt().to_degrees();
        facts.push((
            "Uncertainty, 95 %",
            format!("± {c_}, {b}, {a}"),
            format!("half axes of the ellipsoid{long}; turned by {turn:.2}° (1 σ){guess}"),
        ));
    }
    if let Some(fraction) = outcome.inlier_fraction {
        facts.push((
            "Near the map",
            format!("{:.1} %", 100.0 * fraction),
            format!(
                "of the query within {} m of the {}{}",
                outcome.inlier_distance,
                outcome.inlier_reference,
                outcome
                    .inlier_rmse
                    .map_or_else(String::new, |r| format!(", RMSE {r:.3} m"))
            ),
        ));
    }
    if let Some(e) = error {
        facts.push((
            "Off the truth given",
            length(e.translation),
            format!("and {:.3}°", e.rotation.to_degrees()),
        ));
    }
    facts
}

/// A length as people say it.
pub(super) fn length(metres: f64) -> String {
    if metres < 0.0995 {
        format!("{:.1} cm", 100.0 * metres)
    } else if metres < 100.0 {
        format!("{metres:.2} m")
    } else {
        format!("{metres:.0} m")
    }
}
