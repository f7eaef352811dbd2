//! `winze demo`: the whole of it, with no data at hand.

use std::process::ExitCode;

use std::path::Path;

use winze::{KeptMap, KeptQuery, Request, outcome::Stage};
use winze_front::claim::claim_folder;
use winze_front::{Page, settings};
use winze_io::{write_cloud, write_transform};
use winze_report::{Document, Source};

use crate::args::{Demo, Global, Outputs};
use crate::command::quoted;
use crate::locate::Answer;
use crate::output::talk;
use crate::progress::Progress;

pub(crate) fn run(args: &Demo, global: &Global) -> anyhow::Result<ExitCode> {
    let config = settings::effective(&global.layers())?;
    let progress = Progress::new(global.quiet, 16);
    let out = &args.out;
    claim(out)?;
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
    let mut kept_map = KeptMap::new(&scene.map);
    let mut kept_query = KeptQuery::new(&scene.query);
    let outcome = winze::locate_in(&mut kept_map, &mut kept_query, &config, &request)?;
    let error = outcome.error(&scene.map_from_query, &scene.query);
    let source = |points| Source {
        path: None,
        digest: None,
        points,
    };
    let document = Document::new(
        &outcome,
        error.as_ref(),
        (&request).into(),
        settings::digest(&config)?,
        source(scene.map.len()),
        source(scene.query.len()),
    );
    progress.say("draw");
    let again = format!(
        "winze locate {} {} --truth {} --seed {}",
        shell(&map),
        shell(&query),
        shell(&truth),
        config.seed
    );
    let kept = (&mut kept_map, &mut kept_query);
    let page = Page::of(&scene.map, kept, &outcome, &config, again)?;
    let answer = Answer {
        map: &scene.map,
        query: &scene.query,
        outcome: &outcome,
        error,
        document,
        page: Some(page),
    };
    let wanted = Outputs {
        json: Some(out.join("outcome.json")),
        report: Some(out.join("report.html")),
        picture: Some(out.join("before_and_after.png")),
        save_aligned: Some(out.join("aligned.pcd")),
    };
    progress.finish();
    answer.tell(global.quiet, false)?;
    answer.write(&wanted)?;
    if !global.quiet {
        talk(&format!(
            "\nlook at {0}/before_and_after.png or {0}/report.html; the same again from the files:\n  winze locate {1} {2} --truth {3}\n",
            out.display(),
            map.display(),
            query.display(),
            truth.display()
        ));
    }
    Ok(ExitCode::SUCCESS)
}

/// A path as a word of a shell.
fn shell(path: &Path) -> String {
    quoted(&path.display().to_string())
}

/// What is in a folder of the demo, and the sign that it is one.
const CONTENTS: &str = "Made by `winze demo`, which writes over these files when it is run again.

map.pcd               the prior map: a small simulated mine
query.pcd             a drive through a part of it, in a frame of its own
truth.txt             the true map_from_query, a 4x4 matrix that takes query points to the map
outcome.json          the answer, for programs
before_and_after.png  the answer, to look at
report.html           the answer as a page: the mine to be turned, and why
aligned.pcd           the query as it lies in the map
";
const SIGN: &str = "README.txt";

/// Makes the folder; one that holds somebody's own files is left alone.
fn claim(out: &Path) -> anyhow::Result<()> {
    claim_folder(out, SIGN, |sign| sign == CONTENTS)?;
    winze_io::atomic::write_bytes(&out.join(SIGN), CONTENTS.as_bytes())?;
    Ok(())
}
