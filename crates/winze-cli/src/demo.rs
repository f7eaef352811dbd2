//! `winze demo`: the whole of it, with no data at hand.

use std::process::ExitCode;

use anyhow::Context as _;
use winze::{Request, outcome::Stage};
use winze_io::{write_cloud, write_transform};
use winze_report::{Document, Source};

use crate::args::{Demo, Global, Locate};
use crate::config;
use crate::locate::{Answer, exit_code};
use crate::output::talk;
use crate::progress::Progress;

pub(crate) fn run(args: &Demo, global: &Global) -> anyhow::Result<ExitCode> {
    let config = config::effective(global)?;
    let progress = Progress::new(global.quiet);
    let out = &args.out;
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
    if !global.quiet {
        talk("simulating a mine and a drive through it ...\n");
    }
    progress.say("simulate");
    let scene = winze_sim::demo(config.seed)?;
    let (map, query, truth) = (
        out.join("map.pcd"),
        out.join("query.pcd"),
        out.join("truth.txt"),
    );
    write_cloud(&map, &scene.map, &Default::default())?;
    write_cloud(&query, &scene.query, &Default::default())?;
    write_transform(&truth, &scene.map_from_query)?;
    let told = |name: &str, stage: Option<&Stage>| progress.told(name, stage);
    let request = Request {
        progress: Some(&told),
        ..Request::default()
    };
    let outcome = winze::locate_by(&scene.map, &scene.query, &config, &request)?;
    let error = outcome.error(&scene.map_from_query, &scene.query);
    let source = |points| Source {
        path: None,
        digest: None,
        points,
    };
    let document = Document::new(
        &outcome,
        error.as_ref(),
        config::digest(&config)?,
        source(scene.map.len()),
        source(scene.query.len()),
    );
    progress.say("draw");
    let answer = Answer {
        map: &scene.map,
        query: &scene.query,
        outcome: &outcome,
        error,
        document,
    };
    let wanted = Locate {
        map: map.clone(),
        query: query.clone(),
        method: winze::Method::Auto,
        gravity_aligned: false,
        near: None,
        initial: None,
        truth: None,
        json: Some(out.join("outcome.json")),
        report: Some(out.join("report.html")),
        picture: Some(out.join("before_and_after.png")),
        save_aligned: Some(out.join("aligned.pcd")),
    };
    answer.write(&wanted)?;
    progress.finish();
    answer.tell(global.quiet, false)?;
    if !global.quiet {
        talk(&format!(
            "\nlook at {0}/before_and_after.png or {0}/report.html; the same again from the files:\n  winze locate {1} {2} --truth {3}\n",
            out.display(),
            map.display(),
            query.display(),
            truth.display()
        ));
    }
    Ok(exit_code(&outcome))
}
