//! `winze info`: what is in a cloud.

use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use serde::Serialize;
use winze::scale;
use winze_front::reading::read;

use crate::args::{Global, Info};
use crate::output::print;
use crate::progress::Progress;

/// Facts about one file, as `--json` writes them.
#[derive(Serialize)]
struct Facts {
    path: String,
    format: String,
    encoding: String,
    bytes: u64,
    digest: String,
    points_in_file: usize,
    points: usize,
    non_finite: usize,
    no_returns: usize,
    far: usize,
    fields: Vec<String>,
    organised: Option<(usize, usize)>,
    viewpoint: Option<[f64; 7]>,
    low: Option<[f64; 3]>,
    high: Option<[f64; 3]>,
    centroid: Option<[f64; 3]>,
    spacing: Option<f64>,
    passage_width: Option<f64>,
}

pub(crate) fn run(args: &Info, global: &Global) -> anyhow::Result<ExitCode> {
    for path in &args.files {
        let progress = Progress::new(global.quiet, 2);
        progress.say("read");
        let facts = facts(path, &progress)?;
        progress.finish();
        if args.json {
            print(&(serde_json::to_string(&facts)? + "\n"))?;
        } else {
            print(&table(&facts))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn facts(path: &Path, progress: &Progress) -> anyhow::Result<Facts> {
    let file = read(path)?;
    progress.say("measure");
    let (cloud, r) = (file.cloud, file.report);
    let bounds = cloud.bounds(0.0);
    let measure = scale::measure(&cloud);
    Ok(Facts {
        path: path.display().to_string(),
        format: r.format.to_string(),
        encoding: r.encoding,
        bytes: r.bytes,
        digest: r.digest,
        points_in_file: r.points_in_file,
        points: cloud.len(),
        non_finite: r.non_finite,
        no_returns: r.no_returns,
        far: r.far,
        fields: r.fields,
        organised: r.organised,
        viewpoint: r.viewpoint,
        low: bounds.map(|b| b.0),
        high: bounds.map(|b| b.1),
        centroid: cloud.centroid(),
        spacing: measure.map(|m| m.spacing),
        passage_width: measure.and_then(|m| m.width),
    })
}

fn table(f: &Facts) -> String {
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<14}{value}");
    };
    let place = |p: [f64; 3]| format!("{:.3} {:.3} {:.3}", p[0], p[1], p[2]);
    line("file", f.path.clone());
    line(
        "format",
        format!("{} {}, {} bytes", f.format, f.encoding, f.bytes),
    );
    line("digest", f.digest.clone());
    line("fields", f.fields.join(" "));
    let dropped = format!(
        "{} of {} ({} not finite, {} no-returns, {} too far off)",
        f.points, f.points_in_file, f.non_finite, f.no_returns, f.far
    );
    line("points", dropped);
    if let Some((w, h)) = f.organised {
        line("organised", format!("{w} x {h}"));
    }
    if let (Some(low), Some(high)) = (f.low, f.high) {
        line("from", format!("{} m", place(low)));
        line("to", format!("{} m", place(high)));
        line(
            "size",
            format!("{} m", place(std::array::from_fn(|a| high[a] - low[a]))),
        );
    }
    if let Some(s) = f.spacing {
        line(
            "spacing",
            format!("{s:.3} m from point to point, in the median"),
        );
    }
    if let Some(w) = f.passage_width {
        line("passages", format!("about {w:.1} m across"));
    }
    out.push('\n');
    out
}
