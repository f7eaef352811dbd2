//! One page to look at in a browser or to send on: the query in the map, to be turned and looked at, and why the verdict is what it is.
//! All of it is in the one file; nothing is fetched from anywhere.

mod answer;
mod places;
mod run;
pub(crate) mod view;
mod why;

use std::fmt::Write as _;

use winze::config::VerifyConfig;
use winze::{Outcome, PoseDistance};

use crate::document::Document;
use crate::scene::Scene;

pub(crate) const STYLE: &str = include_str!("../../assets/viewer/page.css");
/// three.js, the parts that are used.
const THREE: &str = include_str!("../../assets/three/three.min.js");
const THREE_LICENCE: &str = include_str!("../../assets/three/LICENSE-three.txt");
/// The viewer's own files, in an order in which each knows those before it.
const VIEWER: &[&str] = &[
    include_str!("../../assets/viewer/decode.js"),
    include_str!("../../assets/viewer/materials.js"),
    include_str!("../../assets/viewer/stage.js"),
    include_str!("../../assets/viewer/clouds.js"),
    include_str!("../../assets/viewer/marks.js"),
    include_str!("../../assets/viewer/overlay.js"),
    include_str!("../../assets/viewer/view.js"),
    include_str!("../../assets/viewer/panel.js"),
    include_str!("../../assets/viewer/keys.js"),
    include_str!("../../assets/viewer/main.js"),
];
/// A browser that reads this fetches nothing, whatever else the page says.
const POLICY: &str =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// What a page is made of.
#[derive(Debug, Clone, Copy)]
pub struct Report<'a> {
    /// The answer.
    pub outcome: &'a Outcome,
    /// Its distance from a known truth.
    pub error: Option<&'a PoseDistance>,
    /// The answer as JSON.
    pub document: &'a Document,
    /// What it was verified by.
    pub verify: &'a VerifyConfig,
    /// How many of the query's prepared points have a surface normal; `None` where it was not prepared.
    pub with_normal: Option<usize>,
    /// The command line that gives it again.
    pub command: &'a str,
    /// What is drawn.
    pub scene: &'a Scene,
    /// The [picture before and after](crate::before_and_after()) as PNG bytes, for browsers without WebGL and for paper.
    pub png: &'a [u8],
}

/// The whole page.
#[must_use]
pub fn page(report: &Report<'_>) -> String {
    let outcome = report.outcome;
    let mut out = head(&format!("winze: {}", outcome.verdict), "");
    let _ = write!(
        out,
        "<a class=\"skip\" href=\"#view\">To the view</a>{}<div class=\"work\">{}<main>{}</main><div class=\"side\">{}{}</div>\
         <div class=\"below\">{}{}</div></div>{}</body></html>",
        answer::answer(outcome, report.verify),
        answer::fact_list(outcome, report.error),
        view::view(report),
        why::why(report),
        places::places(outcome),
        run::stages(outcome),
        run::again(report),
        scripts(&[report.scene]),
    );
    out
}

/// A page up to its body's first element.
pub(crate) fn head(title: &str, more_style: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <title>{}</title><style>{STYLE}{more_style}</style></head><body>",
        escape(title)
    )
}

/// Scenes, the first of them shown, and what draws them.
pub(crate) fn scripts(scenes: &[&Scene]) -> String {
    let mut out = String::new();
    for (i, scene) in scenes.iter().enumerate() {
        let json = in_script(&serde_json::to_string(scene).unwrap_or_default());
        let _ = writeln!(
            out,
            "<script type=\"application/json\" id=\"scene-{i}\">{json}</script>"
        );
    }
    let _ = write!(
        out,
        "<script>/*\n{THREE_LICENCE}*/\n{THREE}</script>\n<script>(function () {{\n'use strict';\n{}}})();</script>",
        VIEWER.concat()
    );
    out
}

/// JSON that cannot end the element it stands in.
fn in_script(json: &str) -> String {
    json.replace('<', "\\u003c")
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
        assert_eq!(
            in_script("{\"a\":\"</script>\"}"),
            "{\"a\":\"\\u003c/script>\"}"
        );
        assert!(!THREE.contains("</script") && !VIEWER.concat().contains("</script"));
    }
}
