//! What the run took, and what gives it again.

use std::fmt::Write as _;

use winze::Outcome;

use super::{Report, escape};
use crate::summary::summary;

/// A stage's times and counts, all its turns together.
struct Spent<'a> {
    name: &'a str,
    seconds: f64,
    times: usize,
    count_in: usize,
    count_out: usize,
}

/// Stage times as bars.
pub(super) fn stages(outcome: &Outcome) -> String {
    let mut spent: Vec<Spent<'_>> = Vec::new();
    for s in &outcome.stages {
        if let Some(known) = spent.iter_mut().find(|k| k.name == s.name) {
            known.seconds += s.seconds;
            known.times += 1;
            (known.count_in, known.count_out) = (s.count_in, s.count_out);
        } else {
            spent.push(Spent {
                name: &s.name,
                seconds: s.seconds,
                times: 1,
                count_in: s.count_in,
                count_out: s.count_out,
            });
        }
    }
    let longest = spent.iter().map(|s| s.seconds).fold(1e-9, f64::max);
    let mut out = format!(
        "<section class=\"card stages\"><h2>Where {:.2} s went</h2><table><tr><th>stage</th><th>seconds</th><th></th>\
         <th class=\"count\">in</th><th class=\"count\">out</th></tr>",
        outcome.seconds
    );
    for s in spent {
        let times = if s.times > 1 {
            format!(" <span class=\"faint\">× {}</span>", s.times)
        } else {
            String::new()
        };
        let _ = write!(
            out,
            "<tr><td>{}{times}</td><td>{:.3}</td><td class=\"wide\"><div class=\"bar\" style=\"width:{:.1}%\"></div></td>\
             <td class=\"count\">{}</td><td class=\"count\">{}</td></tr>",
            escape(s.name),
            s.seconds,
            100.0 * s.seconds / longest,
            s.count_in,
            s.count_out
        );
    }
    out + "</table></section>"
}

/// Command, digests, versions, seed; the summary and the JSON.
pub(super) fn again(report: &Report<'_>) -> String {
    let d = report.document;
    let mut out = format!(
        "<section class=\"card again\"><h2>Run it again</h2><pre id=\"command\">{}</pre>\
         <button type=\"button\" class=\"copy\" data-copy=\"command\">Copy</button><dl>",
        escape(report.command)
    );
    let mut row = |name: &str, value: &str| {
        let _ = write!(out, "<dt>{name}</dt><dd>{}</dd>", escape(value));
    };
    row("winze", env!("CARGO_PKG_VERSION"));
    row("method", report.outcome.method);
    row("seed", &report.outcome.seed.to_string());
    row("settings", &d.config_digest);
    for (name, source) in [("map", &d.map), ("query", &d.query)] {
        let path = source.path.as_deref().unwrap_or("in memory");
        let digest = source.digest.as_deref().unwrap_or("no digest");
        row(name, &format!("{path}, {} points, {digest}", source.points));
    }
    let _ = write!(
        out,
        "</dl><details><summary>The answer as text</summary><pre>{}</pre></details>\
         <details><summary>The outcome as JSON</summary><button type=\"button\" class=\"copy\" data-copy=\"json\">Copy</button>\
         <pre id=\"json\">{}</pre></details></section>",
        escape(&summary(report.outcome, report.error)),
        escape(&d.to_json())
    );
    out
}
