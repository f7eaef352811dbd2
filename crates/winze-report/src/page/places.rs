//! The places that were weighed, to be chosen from.

use std::fmt::Write as _;

use winze::outcome::RankedHypothesis;
use winze::{Outcome, Verdict};

use super::answer::length;
use crate::scene;

/// The list. What the scene's places are, in the same order.
pub(super) fn places(outcome: &Outcome) -> String {
    let shown = scene::shown(outcome);
    if shown.is_empty() {
        return String::new();
    }
    let mut out = String::from(
        "<section class=\"card\" aria-labelledby=\"weighed\"><h2 id=\"weighed\">Places weighed</h2>\
         <div id=\"places\" role=\"radiogroup\" aria-labelledby=\"weighed\">",
    );
    let believed = matches!(outcome.verdict, Verdict::Located | Verdict::Degenerate);
    for (row, (i, h)) in shown.iter().enumerate() {
        let (class, name) = match (i, h.rival) {
            (0, _) if believed => ("", "the answer"),
            (0, _) => ("", "the best guess"),
            (_, true) => (" rival", "cannot be ruled out"),
            (_, false) => ("", "ruled out"),
        };
        let _ = write!(
            out,
            "<button type=\"button\" role=\"radio\" class=\"place\" aria-checked=\"{}\" tabindex=\"{}\">\
             <span class=\"number\">{}</span><span class=\"name{class}\">{name}</span><span class=\"away\">{}</span>\
             <span class=\"numbers\">{}</span></button>",
            row == 0,
            if row == 0 { 0 } else { -1 },
            i + 1,
            away(outcome, h, *i),
            numbers(h)
        );
    }
    out += "</div>";
    let hidden = outcome.hypotheses.len() - shown.len();
    if hidden > 0 {
        let _ = write!(
            out,
            "<p class=\"faint\">and {hidden} more, ruled out, which the JSON has</p>"
        );
    }
    out + "</section>"
}

/// How far from the answer.
fn away(outcome: &Outcome, h: &RankedHypothesis, index: usize) -> String {
    let (Some(best), Some(at), true) = (outcome.map_from_query, outcome.covariance_at, index > 0)
    else {
        return String::new();
    };
    let centre = best.inverse().transform(at);
    let way = best.distance(&h.map_from_query, centre);
    format!(
        "{} and {:.0}° away",
        length(way.translation),
        way.rotation.to_degrees()
    )
}

fn numbers(h: &RankedHypothesis) -> String {
    let rock = h.relief.map_or_else(
        || "rock not asked".to_owned(),
        |r| {
            format!(
                "{} of {} patches ({:+.1} σ)",
                r.confirmed,
                r.asked,
                r.significance()
            )
        },
    );
    let off = h
        .median_point_to_plane
        .map_or_else(String::new, |m| format!(" · {} off", length(m)));
    format!("{rock} · {:.0} % on the map{off}", 100.0 * h.overlap)
}
