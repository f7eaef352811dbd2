//! The evaluation as one page to look at in a browser or to send on, all in one file.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::reliability::reliability;
use super::tables::{
    accuracy, answers, bin_table, calibration_table, costs, coverage_table, label_table, step_table,
};
use super::{Class, Evaluation, Run};
use crate::page::{escape, head, scripts, view};
use crate::scene::Scene;

const OWN_STYLE: &str = "
h2 { margin-top: 2rem; }
.scroll { overflow-x: auto; } .scroll table { max-width: none; width: auto; white-space: nowrap; font-variant-numeric: tabular-nums; }
th.text, td.text { text-align: left; } tr:nth-child(even) td { background: color-mix(in srgb, var(--ink) 5%, transparent); }
figure { margin: 1.4rem 0; } figcaption { margin: .3rem 0; } figure img { max-width: 924px; } figure pre { margin: .3rem 0; font-size: .85rem; }
.wrong_accept { color: var(--bad); } .wrong_pose { color: var(--doubt); } .runs { display: none; } .live .runs { display: block; }
.run-list { display: flex; flex-wrap: wrap; gap: .4rem; margin: .6rem 0; } .run-list button { border: 1px solid var(--line); background: var(--card); border-radius: 8px; padding: .3rem .7rem; cursor: pointer; font-size: .88rem; }
.run-list button[aria-pressed=\"true\"] { border-color: var(--accent); box-shadow: inset 0 -3px 0 var(--accent); }
#places .place { display: block; width: auto; border-radius: 0; } #places { display: inline-flex; gap: 0; padding: 0; }";

/// A failure and its picture.
#[derive(Debug, Clone)]
pub struct Exhibit<'a> {
    /// The run.
    pub run: &'a Run,
    /// Its [`thumbnail`](crate::thumbnail()) as PNG bytes.
    pub png: Vec<u8>,
}

/// A run to be turned and looked at.
#[derive(Debug, Clone)]
pub struct RunView<'a> {
    /// The run.
    pub run: &'a Run,
    /// Where it was put, and where it is.
    pub scene: Scene,
}

/// The whole page: tables, then the failures, the worst first. `failures` is how many there were, of which
/// the exhibits show some. `views` are runs of note, to be turned. `figures` are pictures to show beside the paper's tables, with their names.
#[must_use]
pub fn evaluation_page(
    evaluation: &Evaluation,
    exhibits: &[Exhibit<'_>],
    failures: usize,
    views: &[RunView<'_>],
    figures: &[(String, Vec<u8>)],
) -> String {
    let e = evaluation;
    let mut out = head("winze eval", OWN_STYLE);
    let _ = write!(
        out,
        "<h1>winze eval</h1><pre>{}</pre><p>winze {}, settings {}</p>",
        escape(&e.command),
        escape(e.winze),
        escape(&e.config_digest)
    );
    if let Some(paper) = &e.paper {
        let _ = write!(out, "<h2>The paper's tables</h2>{}", paper.to_html());
    }
    for (name, png) in figures {
        let _ = write!(
            out,
            "<figure><figcaption><b>{}</b>, before and after</figcaption>\
             <img alt=\"before and after\" loading=\"lazy\" src=\"data:image/png;base64,{}\"></figure>",
            escape(name),
            STANDARD.encode(png)
        );
    }
    let parts = [
        (
            "Cases",
            "Labels computed from the noise-free geometry.",
            label_table(&e.labels),
        ),
        ("Answers", ANSWERS, answers(&e.summaries)),
        ("Accuracy and time", ACCURACY, accuracy(&e.summaries)),
        ("Confidence in bins", CONFIDENCE, bin_table(&e.calibrations)),
        (
            "Confidence in scores",
            SCORES,
            calibration_table(&e.calibrations),
        ),
        ("Covariance", COVARIANCE, coverage_table(&e.coverages)),
        ("What each refiner does", STEPS, step_table(&e.steps)),
        (
            "Maps and memory",
            if e.together { TOGETHER } else { APART },
            costs(&e.costs),
        ),
    ];
    for (title, note, table) in parts {
        if table.is_empty() {
            continue;
        }
        let _ = write!(out, "<h2>{title}</h2><p>{note}</p>{}", table.to_html());
    }
    for c in e.calibrations.iter().filter(|c| c.family.is_none()) {
        // Within a page it needs no name of its own.
        let svg =
            reliability(c).map(|svg| svg.replace(" xmlns=\"http://www.w3.org/2000/svg\"", ""));
        let _ = write!(
            out,
            "<figure><figcaption>Confidence of <b>{}</b> against the share that was right</figcaption>{}</figure>",
            escape(&c.method),
            svg.unwrap_or_else(|e| escape(&e.to_string()))
        );
    }
    if !e.errors.is_empty() {
        out += "<h2>Cases without an answer</h2><ul>";
        for t in &e.errors {
            let _ = write!(
                out,
                "<li>{} ({}): {}</li>",
                escape(&t.case),
                escape(&t.method),
                escape(&t.message)
            );
        }
        out += "</ul>";
    }
    run_views(&mut out, views);
    let _ = write!(
        out,
        "<h2>Failures</h2><p>{} of {failures} shown: wrong accepts first, then wrong poses, then refusals. \
         The map in magenta, the query in green, from above; after the first panel only what lies around the query.</p>",
        exhibits.len()
    );
    for exhibit in exhibits {
        figure(&mut out, exhibit);
    }
    let scenes: Vec<&Scene> = views.iter().map(|v| &v.scene).collect();
    if !scenes.is_empty() {
        out += &scripts(&scenes);
    }
    out + "</body></html>\n"
}

/// One view, and the runs that it can show.
fn run_views(out: &mut String, views: &[RunView<'_>]) {
    if views.is_empty() {
        return;
    }
    *out += "<section class=\"runs\"><h2>Runs of note, in the map around them</h2>\
             <p>What went wrong first. Green is the query where it is chosen to lie, amber where else.</p>\
             <div class=\"run-list\" role=\"group\" aria-label=\"Runs\">";
    for (i, v) in views.iter().enumerate() {
        let (class, words) = worth(v.run);
        let _ = write!(
            out,
            "<button type=\"button\" data-run=\"{i}\" aria-pressed=\"{}\"><b class=\"{class}\">{words}</b> {}, {}</button>",
            i == 0,
            escape(&v.run.case),
            escape(&v.run.method)
        );
    }
    *out += "</div>";
    for (i, v) in views.iter().enumerate() {
        let hidden = if i > 0 { " hidden" } else { "" };
        let verdict = v.run.verdict.map_or("broken off", winze::Verdict::name);
        let _ = write!(
            out,
            "<p data-about=\"{i}\"{hidden}><b>{verdict}</b>{}: {}</p>",
            error(v.run),
            escape(&v.run.reason)
        );
    }
    let _ = write!(
        out,
        "<div class=\"tools\"><div class=\"group\" id=\"places\" role=\"radiogroup\" aria-label=\"The query\">\
         <button type=\"button\" role=\"radio\" class=\"place\">1: where it was put</button>\
         <button type=\"button\" role=\"radio\" class=\"place\">2: where it is</button></div>{}{}</div>{}</section>",
        view::looks(),
        view::CUT,
        view::stage("The query has no pose here: it is drawn as it came.")
    );
}

const ANSWERS: &str = "Recall: located within the case's tolerance, of the cases whose query is in the map, at a place \
     that is neither ambiguous nor unobservable. Wrong accept: located or degenerate at a wrong place, or in a map that \
     does not hold the query. Refused: not answered though an answer was there to be had. Right: the right thing said. \
     Pose right: the best pose is within tolerance, whatever the verdict. Wilson 95 % intervals, which take runs as \
     independent.";
const CONFIDENCE: &str = "Every answer with a confidence, and the share of them whose pose lay within 0.5 m and 5° of the truth. They agree where the mean \
     confidence lies within the Wilson interval of that share.";
const SCORES: &str = "Brier: mean square difference of the confidence from what came true (1 or 0). ECE, the expected calibration error: mean difference of \
     confidence and share right over the bins. Overconfidence: the most by which a bin's mean confidence lies above its interval.";
const COVARIANCE: &str = "Errors of located poses in units of their covariance. Covered: those within 5 m of the truth that have one; they are what is \
     looked at. NEES: the normalised estimation error squared, 6 on average and 5.35 in the median where the covariance is right; and the share of x, y, z, and of \
     the angles about them, within one and two standard deviations (68 and 95 %). H⁻¹: by the inverse Hessian of the fit.";
const STEPS: &str = "Right poses of the method before, in pairs of case and seed: nearer to the truth after the refiner or \
     further from it, by more than 2 mm across what is unobservable; right no more (lost), or only now (won).";
const APART: &str =
    "Each method in a process of its own; a map that several cases share is prepared once.";
const TOGETHER: &str = "All methods in one process, which does the work that they share once: seconds are \
     told of the first alone, memory is that of all.";
const ACCURACY: &str = "Errors are those of the query's centroid, over the runs whose pose is right, across what is \
     unobservable. Inliers and RMSE are the paper's, medians over all runs with a pose. Seconds are an answer's, the map at hand, \
     files read. All: displacement over every pose of a query that is in the map, right or wrong.";

/// What a run is worth, as a class and in words.
fn worth(run: &Run) -> (&'static str, &'static str) {
    match run.mark.class {
        Class::WrongAccept => ("wrong_accept", "wrong accept"),
        Class::Right => ("located", "right"),
        Class::Refusal if !run.mark.pose_right && run.mark.has_truth => {
            ("wrong_pose", "wrong pose")
        }
        Class::Refusal => ("refusal", "refusal"),
    }
}

/// How far from the truth, where both are known.
fn error(run: &Run) -> String {
    match (run.mark.translation_m, run.mark.rotation_deg) {
        (Some(m), Some(deg)) => format!(", {m:.2} m and {deg:.1}° from the truth"),
        _ => String::new(),
    }
}

fn figure(out: &mut String, exhibit: &Exhibit<'_>) {
    let run = exhibit.run;
    let (class, words) = worth(run);
    let error = error(run);
    let alternative = if run.mark.at_alternative {
        ", at an alternative that the case lists"
    } else {
        ""
    };
    let _ = write!(
        out,
        "<figure><figcaption><b>{}</b>, {}, seed {}: <b class=\"{class}\">{words}</b> ({}{error}{alternative}). {}</figcaption>\
         <img alt=\"before, found, true\" loading=\"lazy\" src=\"data:image/png;base64,{}\"><pre>{}</pre></figure>",
        escape(&run.case),
        escape(&run.method),
        run.seed,
        run.verdict.map_or("broken off", winze::Verdict::name),
        escape(&run.reason),
        STANDARD.encode(&exhibit.png),
        escape(&run.again.join("\n"))
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{Mark, calibrations, labels, steps, summaries, tests::run};

    #[test]
    fn the_page_is_whole_and_offline() {
        let mut wrong = run("auto", "a<b", Class::WrongAccept, Mark::default());
        wrong.again = vec!["winze eval x --only 'a<b/1'".into()];
        wrong.confidence = Some(0.998);
        let runs = vec![wrong];
        let evaluation = Evaluation {
            jobs: 1,
            together: false,
            threads: 0,
            winze: "0",
            command: "winze eval x".into(),
            config_digest: "sha256:0".into(),
            seeds: vec![0],
            labels: labels([]),
            summaries: summaries(&runs),
            calibrations: calibrations(&runs),
            coverages: Vec::new(),
            steps: steps(&runs),
            costs: Vec::new(),
            errors: Vec::new(),
            paper: None,
            runs: runs.clone(),
        };
        let exhibit = Exhibit {
            run: &runs[0],
            png: vec![1, 2, 3],
        };
        let page = evaluation_page(&evaluation, &[exhibit], 1, &[], &[]);
        for part in [
            "1 of 1 shown",
            "wrong accept",
            "<svg",
            "too sure",
            "--only 'a&lt;b/1'",
            "data:image/png;base64,AQID",
        ] {
            assert!(page.contains(part), "{part}");
        }
        assert!(!page.contains("src=\"http") && !page.contains("<script") && !page.contains("a<b"));
    }
}
