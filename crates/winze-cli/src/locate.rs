//! `winze locate`: one answer.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::bail;
use winze::outcome::Stage;
use winze::{Cloud, KeptQuery, Outcome, PoseDistance, Request, Verdict};
use winze_bundle::{Beforehand, MapFile, QueryFile};
use winze_front::reading::read_as;
use winze_front::{Page, Prior, settings};
use winze_io::{Format, atomic, read_bytes, read_transform, write_cloud};
use winze_report::{Document, Source};

use crate::args::{Global, Locate, Outputs};
use crate::bundle::{self, Seen};
use crate::command;
use crate::output::{check_outputs, is_broken_pipe, print, talk};
use crate::progress::Progress;

pub(crate) fn run(args: &Locate, global: &Global) -> anyhow::Result<ExitCode> {
    check(args, global)?;
    let initial = args.initial.as_deref().map(read_transform).transpose()?;
    let truth = args.truth.as_deref().map(read_transform).transpose()?;
    if initial.is_some() && args.method.uses_features() {
        bail!(
            "--initial: the method {} does not start from a pose; give --method ndt+icp, or --near to say roughly where",
            args.method
        );
    }
    let progress = Progress::new(global.quiet, steps(args.method));
    let mut reading = Vec::new();
    let mut timed = |stage: Stage| {
        progress.told(&stage.name.clone(), Some(&stage));
        reading.push(stage);
    };
    progress.say("read map");
    let begun = Instant::now();
    let map = Prior::open(&args.map)?;
    timed(map.stage(begun.elapsed().as_secs_f64()));
    let config = map.config(&global.layers())?;
    progress.say("read query");
    let begun = Instant::now();
    let bytes = read_bytes(&args.query)?;
    let query = read_as(&args.query, &bytes)?;
    // A pipe cannot be read twice.
    let bytes = args.bundle.as_ref().map(|_| bytes);
    timed(Stage {
        name: "read query".into(),
        seconds: begun.elapsed().as_secs_f64(),
        count_in: query.report.points_in_file,
        count_out: query.cloud.len(),
    });
    let told = |name: &str, stage: Option<&Stage>| progress.told(name, stage);
    let request = Request {
        method: args.method,
        initial,
        gravity_aligned: args.gravity_aligned,
        near: args.near,
        progress: Some(&told),
    };
    let (mut kept_map, mut kept_query) = (map.kept(), KeptQuery::new(&query.cloud));
    let (mut outcome, trail) =
        winze::locate_traced(&mut kept_map, &mut kept_query, &config, &request).map_err(|e| {
            let of_map = matches!(e, winze::Error::EmptyMap { .. });
            let file = of_map.then(|| args.map.display().to_string());
            let option = matches!(e, winze::Error::EmptyRegion { .. }).then(|| "--near".to_owned());
            match file.or(option) {
                Some(place) => anyhow::Error::new(e).context(place),
                None => e.into(),
            }
        })?;
    outcome.seconds += reading.iter().map(|s| s.seconds).sum::<f64>();
    outcome.stages.splice(0..0, reading);
    let error = truth.and_then(|t| outcome.error(&t, &query.cloud));
    let document = Document::new(
        &outcome,
        error.as_ref(),
        (&request).into(),
        settings::digest(&config)?,
        map.source(&args.map),
        Source {
            path: Some(args.query.display().to_string()),
            digest: Some(query.report.digest.clone()),
            points: query.cloud.len(),
        },
    );
    let drawn = args.outputs.drawn();
    let picture = if drawn {
        map.picture()?
    } else {
        Cow::Owned(Cloud::default())
    };
    let page = match args.outputs.report {
        Some(_) => {
            progress.say("draw");
            let command = command::command();
            let kept = (&mut kept_map, &mut kept_query);
            Some(Page::of(&picture, kept, &outcome, &config, command)?)
        }
        None => None,
    };
    let answer = Answer {
        map: &picture,
        query: &query.cloud,
        outcome: &outcome,
        error,
        document,
        page,
    };
    // Files last: a full disk must not cost the answer.
    progress.finish();
    answer.tell(global.quiet, args.outputs.json_to_stdout())?;
    let written = answer.write(&args.outputs);
    // A file that cannot be written must not cost the bundle.
    if let (Some(path), Some(bytes)) = (&args.bundle, bytes) {
        let seen = Seen {
            map: &mut kept_map,
            query: &mut kept_query,
            config: &config,
            traced: (&trail, &outcome),
        };
        let asked = Beforehand {
            method: args.method,
            gravity_aligned: args.gravity_aligned,
            near: args.near,
            initial,
            truth,
        };
        let query = QueryFile {
            path: args.query.display().to_string(),
            bytes,
        };
        let map = MapFile {
            path: args.map.display().to_string(),
            digest: map.digest(),
            points_in_file: map.stage(0.0).count_in,
        };
        bundle::write(path, seen, asked, map, query, &answer.document, global)?;
    }
    written?;
    Ok(exit_code(&outcome))
}

/// Stages that a run by `method` has at one voxel size, with reading.
pub(crate) fn steps(method: winze::Method) -> u64 {
    2 + method.stages()
}

/// Refuses at once what could not be written in the end.
fn check(args: &Locate, global: &Global) -> anyhow::Result<()> {
    if let Some(path) = &args.outputs.save_aligned {
        Format::for_writing(path)?;
    }
    if args.bundle.as_deref() == Some(Path::new("-")) {
        bail!("--bundle: cannot go to stdout; name a file");
    }
    let mut outputs = args.outputs.files();
    outputs.extend(args.bundle.as_deref());
    let inputs: Vec<&Path> = [&args.initial, &args.truth, &global.config]
        .into_iter()
        .flatten()
        .chain([&args.map, &args.query])
        .map(PathBuf::as_path)
        .collect();
    check_outputs(&outputs, &inputs)
}

/// 0 located, 1 answered but not located.
pub(crate) fn exit_code(outcome: &Outcome) -> ExitCode {
    ExitCode::from(u8::from(outcome.verdict != Verdict::Located))
}

/// One run with everything that can be made of it.
pub(crate) struct Answer<'a> {
    pub(crate) map: &'a Cloud,
    pub(crate) query: &'a Cloud,
    pub(crate) outcome: &'a Outcome,
    pub(crate) error: Option<PoseDistance>,
    pub(crate) document: Document,
    /// What the page shows besides, where one is asked for.
    pub(crate) page: Option<Page>,
}

impl Answer<'_> {
    /// Writes the files that were asked for, each whether or not another one could be written; the first
    /// trouble is told of.
    pub(crate) fn write(&self, wanted: &Outputs) -> anyhow::Result<()> {
        let mut trouble = Ok(());
        let mut note = |result: anyhow::Result<()>| {
            if trouble.is_ok() {
                trouble = result;
            }
        };
        let file = |path: &Path, bytes: &[u8]| Ok(atomic::write_bytes(path, bytes)?);
        if let Some(path) = wanted.json.as_deref().filter(|p| *p != Path::new("-")) {
            note(file(path, self.document.to_json().as_bytes()));
        }
        if let Some(path) = &wanted.save_aligned {
            note(self.write_aligned(path));
        }
        if wanted.picture.is_some() || wanted.report.is_some() {
            let png = winze_report::before_and_after(self.map, self.query, self.outcome)?;
            if let Some(path) = &wanted.picture {
                note(file(path, &png));
            }
            if let (Some(path), Some(page)) = (&wanted.report, &self.page) {
                note(file(
                    path,
                    page.html(self.outcome, self.error.as_ref(), &self.document, &png)
                        .as_bytes(),
                ));
            }
        }
        trouble
    }

    fn write_aligned(&self, path: &Path) -> anyhow::Result<()> {
        let Some(pose) = &self.outcome.map_from_query else {
            tracing::warn!("{}: not written, no pose was found", path.display());
            return Ok(());
        };
        let report = write_cloud(path, &self.query.transformed(pose)?, &Default::default())?;
        for warning in report.warnings {
            tracing::warn!("{}: {warning}", path.display());
        }
        Ok(())
    }

    /// The summary for a person, or the JSON on stdout and the summary beside it.
    pub(crate) fn tell(&self, quiet: bool, json: bool) -> anyhow::Result<()> {
        let summary = winze_report::summary(self.outcome, self.error.as_ref());
        let told = if json {
            if !quiet {
                talk(&summary);
            }
            print(&self.document.to_json())
        } else if quiet {
            Ok(())
        } else {
            print(&summary)
        };
        // Nobody may be reading; the exit code still says how it ended.
        told.or_else(|e| if is_broken_pipe(&e) { Ok(()) } else { Err(e) })
    }
}
