//! `winze eval`: methods over cases, the tables.

mod ask;
mod commands;
mod journal;
mod sheet;
mod worker;
mod workers;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use winze::Method;
use winze_front::evaluation::{self, Case, Choice, assembled, cases, text};
use winze_front::settings;
use winze_io::atomic;
use winze_report::evaluation::{CLOUDS, Evaluation};

use crate::args::{Eval, Global};
use crate::command::command;
use crate::output::{check_outputs, print, talk};
use ask::{Asked, ask, shared_out};
use journal::{Head, Journal};

pub(crate) use worker::run as run_worker;
pub(crate) use workers::stop;

/// Seeds where none are asked for: one, or as many as the paper's tables want.
const PAPER_SEEDS: u64 = 20;
/// The method whose pictures stand for the paper's figures.
const FIGURES: Method = Method::FpfhNdtIcp;

pub(crate) fn run(args: &Eval, global: &Global) -> anyhow::Result<ExitCode> {
    let config = settings::effective(&global.layers())?;
    let file = cases::file_of(&args.cases);
    let (all, cases_digest) = cases::read(&file)?;
    let chosen = if args.paper {
        of_the_paper(all).with_context(|| file.display().to_string())?
    } else {
        let choice = Choice {
            only: &args.only,
            family: &args.family,
            every: args.every,
        };
        choice.of(all)
    };
    if chosen.is_empty() {
        bail!("{}: no case is left to run", file.display());
    }
    check(args, global, &file, &chosen)?;
    if let Some(folder) = &args.figures {
        let at = folder.display();
        std::fs::create_dir_all(folder).with_context(|| format!("{at}: cannot be made"))?;
    }
    let methods = methods(args);
    let groups: Vec<Vec<Method>> = if args.together || args.paper {
        vec![methods]
    } else {
        methods.into_iter().map(|m| vec![m]).collect()
    };
    let together = groups.iter().any(|g| g.len() > 1);
    let (jobs, threads) = shared_out(args, global, groups.len());
    let config_digest = settings::digest(&config)?;
    let head = Head {
        winze: env!("CARGO_PKG_VERSION").to_owned(),
        config_digest: config_digest.clone(),
        cases_digest,
        together,
        jobs,
        threads,
    };
    let journal = args.journal.as_deref();
    let journal = journal.map(|path| Journal::open(path, &head)).transpose()?;
    let asked = Asked {
        args,
        global,
        config: &config,
        cases: &chosen,
        journal: journal.as_ref(),
    };
    let found = ask(&asked, &groups, (jobs, threads))?;
    let how = evaluation::Asked {
        command: command(),
        config_digest,
        seeds: seeds(args, config.seed),
        jobs,
        together,
        threads,
        paper: args.paper,
    };
    let evaluation = assembled(how, &chosen, found)?;
    write(args, global, &evaluation, &chosen)?;
    for e in &evaluation.errors {
        talk(&format!(
            "winze: error: {} ({}): {}\n",
            e.case, e.method, e.message
        ));
    }
    if evaluation.errors.is_empty() {
        Ok(ExitCode::SUCCESS)
    } else {
        bail!(
            "{} cases gave no answer; all others are in the tables",
            evaluation.errors.len()
        )
    }
}

fn methods(args: &Eval) -> Vec<Method> {
    if args.paper {
        let mut methods = Method::ALL.to_vec();
        // Last: it is not the paper's.
        methods.rotate_left(1);
        return methods;
    }
    let mut methods: Vec<Method> = Vec::new();
    for m in &args.method {
        if !methods.contains(m) {
            methods.push(*m);
        }
    }
    methods
}

fn seeds(args: &Eval, first: u64) -> Vec<u64> {
    let n = args
        .seeds
        .unwrap_or(if args.paper { PAPER_SEEDS } else { 1 });
    (0..n).map(|i| first.saturating_add(i)).collect()
}

/// The six clouds in the paper's order.
fn of_the_paper(cases: Vec<Case>) -> anyhow::Result<Vec<Case>> {
    let find = |name: &str| cases.iter().find(|c| c.name == name).cloned();
    let missing: Vec<&str> = CLOUDS
        .iter()
        .map(|(name, _)| *name)
        .filter(|name| find(name).is_none())
        .collect();
    if !missing.is_empty() {
        bail!(
            "--paper: no case {}; `winze sim paper` makes all six",
            missing.join(", ")
        );
    }
    Ok(CLOUDS.iter().filter_map(|(name, _)| find(name)).collect())
}

/// Refuses at once what could not be written in the end.
fn check(args: &Eval, global: &Global, file: &Path, chosen: &[Case]) -> anyhow::Result<()> {
    let outputs: Vec<&Path> = [&args.json, &args.report, &args.journal]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .filter(|p| *p != Path::new("-"))
        .collect();
    let inputs: Vec<&Path> = global
        .config
        .iter()
        .map(PathBuf::as_path)
        .chain([file])
        .chain(
            chosen
                .iter()
                .flat_map(|c| [c.map.as_path(), c.query.as_path()]),
        )
        .collect();
    check_outputs(&outputs, &inputs)
}

/// Prints the tables and writes what was asked for.
fn write(
    args: &Eval,
    global: &Global,
    evaluation: &Evaluation,
    chosen: &[Case],
) -> anyhow::Result<()> {
    // Files first: whoever reads stdout may leave.
    if let Some(path) = args.json.as_deref().filter(|p| *p != Path::new("-")) {
        atomic::write_bytes(path, evaluation.to_json().as_bytes())?;
    }
    if let Some(path) = &args.report {
        let page = sheet::page(evaluation, chosen, args.figures.as_deref(), global)?;
        atomic::write_bytes(path, page.as_bytes())?;
    }
    let text = text(evaluation);
    if args.json.as_deref() == Some(Path::new("-")) {
        if !global.quiet {
            talk(&text);
        }
        print(&evaluation.to_json())?;
    } else {
        print(&text)?;
    }
    Ok(())
}
