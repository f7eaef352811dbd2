//! One page to look at in a browser or to send on: no network, no scripts.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use winze::{Outcome, PoseDistance, Verdict};

use crate::document::Document;
use crate::summary::summary;

pub(crate) const STYLE: &str = "
:root { color-scheme: light dark; --ink: #16181d; --paper: #fbfbfc; --faint: #5b6070; --bar: #8a63d2; }
@media (prefers-color-scheme: dark) { :root { --ink: #ececf1; --paper: #0f1115; --faint: #9a9fae; --bar: #b79af0; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  margin: 0 auto; padding: 1.2rem; max-width: 82rem; }
h1 { margin: 0; font-size: 2rem; } h2 { font-size: 1.1rem; margin: 2rem 0 .5rem; }
.located { color: #1f9d48; } .ambiguous, .degenerate { color: #c98500; } .not_found, .insufficient { color: #d63a34; }
p { margin: .3rem 0; max-width: 60rem; } img { width: 100%; height: auto; border-radius: 6px; }
pre { overflow-x: auto; background: color-mix(in srgb, var(--ink) 6%, transparent); padding: .8rem; border-radius: 6px; }
table { border-collapse: collapse; width: 100%; max-width: 60rem; } td, th { padding: .15rem .6rem; text-align: right; }
td:first-child, th:first-child { text-align: left; } .bar { background: var(--bar); height: .8rem; border-radius: 2px; min-width: 1px; }
td.wide { width: 40%; }";

/// The whole page; `png` is the picture before and after.
#[must_use]
pub fn page(
    outcome: &Outcome,
    error: Option<&PoseDistance>,
    document: &Document,
    png: &[u8],
) -> String {
    let verdict = outcome.verdict.name();
    let mut out = String::new();
    let _ = write!(
        out,
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>winze: {verdict}</title><style>{STYLE}</style></head><body>\
         <h1 class=\"{verdict}\">{verdict}</h1><p>{}</p><p>{}</p>",
        escape(&outcome.reason),
        meaning(outcome.verdict)
    );
    let _ = write!(
        out,
        "<h2>Before and after</h2><img alt=\"The map in magenta and the query in green, before and after\" \
         src=\"data:image/png;base64,{}\">",
        STANDARD.encode(png)
    );
    let longest = outcome
        .stages
        .iter()
        .map(|s| s.seconds)
        .fold(1e-9, f64::max);
    out += "<h2>Stages</h2><table><tr><th>stage</th><th>seconds</th><th>in</th><th>out</th><th></th></tr>";
    for s in &outcome.stages {
        let _ = write!(
            out,
            "<tr><td>{}</td><td>{:.3}</td><td>{}</td><td>{}</td><td class=\"wide\"><div class=\"bar\" style=\"width:{:.1}%\"></div></td></tr>",
            escape(&s.name),
            s.seconds,
            s.count_in,
            s.count_out,
            100.0 * s.seconds / longest
        );
    }
    let _ = writeln!(
        out,
        "</table><h2>Summary</h2><pre>{}</pre><details><summary>The outcome as JSON</summary><pre>{}</pre></details></body></html>",
        escape(&summary(outcome, error)),
        escape(&document.to_json())
    );
    out
}

fn meaning(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Located => "The pose below is where the query lies in the map.",
        Verdict::Ambiguous => {
            "Several places in the map fit. Drive on a little and ask again; do not act on the first of them."
        }
        Verdict::Degenerate => {
            "The query could slide or turn along the directions named. Trust the rest of the pose where the rock confirms the place; where it rests on its shape alone, another passage of that shape would answer alike."
        }
        Verdict::NotFound => {
            "No pose can be believed: no place in this map has the query's shape, or none its rock, or the query is too bent for one pose. The pose shown is only the best of those tried."
        }
        Verdict::Insufficient => {
            "The query holds too little geometry, or too little wall to ask, to say where it is."
        }
    }
}

pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_break_out() {
        assert_eq!(
            escape("<a href=\"x\">&"),
            "&lt;a href=&quot;x&quot;&gt;&amp;"
        );
    }
}
