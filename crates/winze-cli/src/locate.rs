//! `winze locate`: one answer.

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use anyhow::bail;
use winze::outcome::Stage;
use winze::{Cloud, Outcome, PoseDistance, Request, Verdict};
use winze_io::{CloudFile, Format, ReadOptions, atomic, read_cloud, read_transform, write_cloud};
use winze_report::{Document, Source};

use crate::args::{Global, Locate};
use crate::config;
use crate::output::{print, talk};
use crate::progress::Progress;

pub(crate) fn run(args: &Locate, global: &Global) -> anyhow::Result<ExitCode> {
    let config = config::effective(global)?;
    check_outputs(args)?;
    let progress = Progress::new(global.quiet);
    let mut reading = Vec::new();
    let mut read_timed = |name: &str, path: &Path| -> anyhow::Result<CloudFile> {
        progress.say(name);
        let begun = Instant::now();
        let file = read(path)?;
        reading.push(Stage {
            name: name.into(),
            seconds: begun.elapsed().as_secs_f64(),
            count_in: file.report.points_in_file,
            count_out: file.cloud.len(),
        });
        Ok(file)
    };
    let map = read_timed("read map", &args.map)?;
    let query = read_timed("read query", &args.query)?;
    let initial = args.initial.as_deref().map(read_transform).transpose()?;
    let truth = args.truth.as_deref().map(read_transform).transpose()?;
    let told = |name: &str, stage: Option<&Stage>| progress.told(name, stage);
    let request = Request {
        method: args.method,
        initial,
        gravity_aligned: args.gravity_aligned,
        near: args.near,
        progress: Some(&told),
    };
    let mut outcome = winze::locate_by(&map.cloud, &query.cloud, &config, &request)?;
    outcome.seconds += reading.iter().map(|s| s.seconds).sum::<f64>();
    outcome.stages.splice(0..0, reading);
    let error = truth.and_then(|t| outcome.error(&t, &query.cloud));
    let source = |path: &Path, file: &CloudFile| Source {
        path: Some(path.display().to_string()),
        digest: Some(file.report.digest.clone()),
        points: file.cloud.len(),
    };
    let document = Document::new(
        &outcome,
        error.as_ref(),
        config::digest(&config)?,
        source(&args.map, &map),
        source(&args.query, &query),
    );
    progress.say("write");
    let answer = Answer {
        map: &map.cloud,
        query: &query.cloud,
        outcome: &outcome,
        error,
        document,
    };
    answer.write(args)?;
    progress.finish();
    answer.tell(global.quiet, args.json.as_deref() == Some(Path::new("-")))?;
    Ok(exit_code(&outcome))
}

/// Refuses at once what could not be written in the end.
fn check_outputs(args: &Locate) -> anyhow::Result<()> {
    if let Some(path) = &args.save_aligned
        && Format::from_extension(path).is_none()
    {
        bail!(
            "{}: unknown format; a cloud is written as .pcd, .ply, .xyz, .txt or .csv",
            path.display()
        );
    }
    for path in [&args.json, &args.report, &args.picture, &args.save_aligned]
        .into_iter()
        .flatten()
    {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
        if folder.is_some_and(|f| !f.is_dir()) {
            bail!(
                "{}: cannot be written: its folder does not exist; create it first",
                path.display()
            );
        }
    }
    Ok(())
}

/// 0 located, 1 answered but not located.
pub(crate) fn exit_code(outcome: &Outcome) -> ExitCode {
    ExitCode::from(u8::from(outcome.verdict != Verdict::Located))
}

/// Reads a cloud and tells what its reader had to say.
pub(crate) fn read(path: &Path) -> anyhow::Result<CloudFile> {
    let file = read_cloud(path, &ReadOptions::default())?;
    let r = &file.report;
    tracing::info!(
        "{}: {} {}, {} points, {} not finite, {} no-returns",
        path.display(),
        r.format,
        r.encoding,
        r.points_in_file,
        r.non_finite,
        r.no_returns
    );
    if r.non_finite > 0 {
        tracing::warn!(
            "{}: {} of {} points are not finite and were dropped",
            path.display(),
            r.non_finite,
            r.points_in_file
        );
    }
    for warning in &r.warnings {
        tracing::warn!("{}: {warning}", path.display());
    }
    Ok(file)
}

/// One run with everything that can be made of it.
pub(crate) struct Answer<'a> {
    pub(crate) map: &'a Cloud,
    pub(crate) query: &'a Cloud,
    pub(crate) outcome: &'a Outcome,
    pub(crate) error: Option<PoseDistance>,
    pub(crate) document: Document,
}

impl Answer<'_> {
    /// Writes the files that were asked for.
    pub(crate) fn write(&self, args: &Locate) -> anyhow::Result<()> {
        if let Some(path) = args.json.as_deref().filter(|p| *p != Path::new("-")) {
            atomic::write_bytes(path, self.document.to_json().as_bytes())?;
        }
        let picture = if args.picture.is_some() || args.report.is_some() {
            Some(winze_report::before_and_after(
                self.map,
                self.query,
                self.outcome,
            )?)
        } else {
            None
        };
        if let (Some(path), Some(png)) = (&args.picture, &picture) {
            atomic::write_bytes(path, png)?;
        }
        if let (Some(path), Some(png)) = (&args.report, &picture) {
            let page = winze_report::page(self.outcome, self.error.as_ref(), &self.document, png);
            atomic::write_bytes(path, page.as_bytes())?;
        }
        if let Some(path) = &args.save_aligned {
            match &self.outcome.map_from_query {
                Some(pose) => {
                    let report =
                        write_cloud(path, &self.query.transformed(pose)?, &Default::default())?;
                    for warning in report.warnings {
                        tracing::warn!("{}: {warning}", path.display());
                    }
                }
                None => tracing::warn!("{}: not written, no pose was found", path.display()),
            }
        }
        Ok(())
    }

    /// The summary for a person, or the JSON on stdout and the summary beside it.
    pub(crate) fn tell(&self, quiet: bool, json: bool) -> anyhow::Result<()> {
        let summary = winze_report::summary(self.outcome, self.error.as_ref());
        if json {
            print(&self.document.to_json())?;
            if !quiet {
                talk(&summary);
            }
        } else if !quiet {
            print(&summary)?;
        }
        Ok(())
    }
}
