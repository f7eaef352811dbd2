//! What the verdict rests on: numbers beside their thresholds.

use std::fmt::Write as _;

use super::{Report, escape};
use crate::criteria::{Criterion, criteria};

/// The list of criteria, and the sentence.
pub(super) fn why(report: &Report<'_>) -> String {
    let mut out = String::from(
        "<section class=\"card\" aria-labelledby=\"why\"><h2 id=\"why\">Why</h2><ul class=\"why\">",
    );
    let mut rows = criteria(report.outcome, report.verify, report.with_normal);
    // What decides is read first.
    rows.sort_by_key(|c| !c.decides);
    for c in rows {
        let (class, mark, word) = match c.met {
            Some(true) => ("yes", "✓", "met"),
            Some(false) => ("no", "✕", "not met"),
            None => ("none", "–", "not asked"),
        };
        let decides = if c.decides { " decides" } else { "" };
        let _ = write!(
            out,
            "<li class=\"{class}{decides}\"><span class=\"met\" role=\"img\" aria-label=\"{word}\">{mark}</span><div>\
             <div class=\"asks\">{}</div>{}<div class=\"found\">{} <span class=\"wanted\">{}</span></div></div></li>",
            c.asks,
            gauge(&c),
            escape(&c.found),
            escape(&c.wanted)
        );
    }
    let _ = write!(
        out,
        "</ul><details><summary>In one sentence</summary><p class=\"because\">{}</p></details></section>",
        escape(&report.outcome.reason)
    );
    out
}

/// A bar with a tick where the threshold lies.
fn gauge(criterion: &Criterion) -> String {
    let Some(g) = criterion.gauge else {
        return String::new();
    };
    let at = |v: f64| 100.0 * (v / g.end.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    format!(
        "<div class=\"gauge\" aria-hidden=\"true\"><i style=\"width:{:.1}%\"></i><b style=\"left:{:.1}%\"></b></div>",
        at(g.value),
        at(g.threshold).min(99.5)
    )
}
