//! The answer as a person reads it on a terminal.

use std::fmt::Write as _;

use winze::confidence::{DEGREES, METRES};
use winze::outcome::RankedHypothesis;
use winze::{Outcome, PoseDistance};

/// Verdict, pose, metrics and the table of stages, as plain text. `error` is the distance from a
/// known truth.
#[must_use]
pub fn summary(outcome: &Outcome, error: Option<&PoseDistance>) -> String {
    let mut out = String::new();
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(out, "{name:<14}{value}");
    };
    line("verdict", outcome.verdict.name());
    line("because", &outcome.reason);
    if let Some(pose) = &outcome.map_from_query {
        let t = pose.translation();
        let [yaw, pitch, roll] = pose.yaw_pitch_roll().map(f64::to_degrees);
        line(
            "translation",
            &format!("{:.3} {:.3} {:.3} m", t[0], t[1], t[2]),
        );
        line(
            "attitude",
            &format!("yaw {yaw:.3}°  pitch {pitch:.3}°  roll {roll:.3}°"),
        );
        if let Some(c) = outcome.covariance_at {
            line(
                "query lies at",
                &format!(
                    "{:.3} {:.3} {:.3} m in the map (its centroid)",
                    c[0], c[1], c[2]
                ),
            );
        }
    }
    if let Some(confidence) = outcome.confidence {
        // Rounded down: no more is said than was counted.
        let percent = (1000.0 * confidence).floor() / 10.0;
        line(
            "confidence",
            &format!(
                "{percent:.1} %, by the share of simulated answers with like evidence that were within {METRES} m and {DEGREES}°"
            ),
        );
    }
    if let Some(covariance) = outcome.covariance() {
        let [x, y, z, a, b, c] = std::array::from_fn(|i| covariance.matrix[i][i].sqrt());
        let [a, b, c] = [a, b, c].map(f64::to_degrees);
        line(
            "uncertainty",
            &format!(
                "{x:.3} {y:.3} {z:.3} m along the map's axes, {a:.3}° {b:.3}° {c:.3}° about them (one standard deviation, there)"
            ),
        );
    }
    if let Some(fraction) = outcome.inlier_fraction {
        let text = format!(
            "{:.2} % of the query within {} m of the {}{}",
            100.0 * fraction,
            outcome.inlier_distance,
            outcome.inlier_reference,
            outcome
                .inlier_rmse
                .map_or_else(String::new, |rmse| format!(", RMSE {rmse:.4} m"))
        );
        line("inliers", &text);
    }
    if let Some(e) = error {
        line(
            "error",
            &format!(
                "{:.3} m, {:.3}° from the truth given",
                e.translation,
                e.rotation.to_degrees()
            ),
        );
    }
    if let Some(voxel) = outcome.voxel {
        line("voxel", &format!("{voxel:.3} m"));
    }
    if outcome.hypotheses.len() > 1 {
        let _ = writeln!(
            out,
            "\nplaces weighed   overlap  finely  median residual      same rock   rival   centroid in the map"
        );
        let shown = |(i, h): &(usize, &RankedHypothesis)| *i < 8 || h.rival;
        for (_, h) in outcome.hypotheses.iter().enumerate().filter(shown) {
            let at = centre(outcome, h);
            let _ = writeln!(
                out,
                "               {:>7.1} % {:>5.1} %   {:>12} m   {:>12}   {:>5}   {at}",
                100.0 * h.overlap,
                100.0 * h.score,
                h.median_point_to_plane
                    .map_or("-".into(), |m| format!("{m:.4}")),
                h.relief
                    .map_or("-".into(), |r| format!("{} of {}", r.confirmed, r.asked)),
                if h.rival { "yes" } else { "" },
            );
        }
    }
    let _ = writeln!(
        out,
        "\n{:<18}{:>9}{:>12}{:>12}",
        "stage", "seconds", "in", "out"
    );
    for s in &outcome.stages {
        let _ = writeln!(
            out,
            "{:<18}{:>9.3}{:>12}{:>12}",
            s.name, s.seconds, s.count_in, s.count_out
        );
    }
    let _ = writeln!(out, "{:<18}{:>9.3}", "all", outcome.seconds);
    out
}

/// Where a hypothesis puts the query's centroid.
fn centre(outcome: &Outcome, h: &RankedHypothesis) -> String {
    let (Some(at), Some(best)) = (outcome.covariance_at, &outcome.map_from_query) else {
        return String::new();
    };
    let p = h.map_from_query.transform(best.inverse().transform(at));
    format!("{:.2} {:.2} {:.2}", p[0], p[1], p[2])
}
