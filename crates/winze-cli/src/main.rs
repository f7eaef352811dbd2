//! `winze`: find a robot in its own map, underground.
//!
//! stdout is data, stderr is talk. Exit codes of `locate` and `replay`: 0 located, 1 answered but not located, 2
//! error; of every other verb: 0 done, 2 error.

mod args;
mod bundle;
mod command;
mod config;
mod convert;
mod demo;
mod eval;
mod generate;
mod info;
mod locate;
mod map;
mod output;
mod progress;
mod replay;
mod sim;

use std::process::ExitCode;

use anyhow::Context as _;
use clap::Parser as _;
use winze_front::settings;

use args::{Args, Verb};

fn main() -> ExitCode {
    let args = Args::parse();
    start_logging(&args);
    if let Err(e) = delete_half_written_files_when_stopped() {
        tracing::warn!("{e:#}");
    }
    match run(&args) {
        Ok(code) => code,
        Err(e) if output::is_broken_pipe(&e) => ExitCode::SUCCESS,
        Err(e) => {
            output::complain(&e);
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.global.threads)
        .build()
        .context("cannot start the threads")?;
    // Wrong settings are told of even by a verb that has no use for them.
    settings::effective(&args.global.layers())?;
    // Everything runs in this pool; the global one is left alone.
    pool.install(|| match &args.verb {
        Verb::Demo(a) => demo::run(a, &args.global),
        Verb::Locate(a) => locate::run(a, &args.global),
        Verb::Replay(a) => replay::run(a, &args.global),
        Verb::Map(a) => map::run(a, &args.global),
        Verb::Sim(a) => sim::run(a, &args.global),
        Verb::Eval(a) => eval::run(a, &args.global),
        Verb::EvalWorker => eval::run_worker(),
        Verb::Info(a) => info::run(a, &args.global),
        Verb::Convert(a) => convert::run(a, &args.global),
        Verb::Config => config::run(&args.global),
        Verb::Completions(a) => generate::completions(a),
        Verb::Man => generate::man(),
    })
}

fn start_logging(args: &Args) {
    let level = match (args.global.quiet, args.global.verbose) {
        (true, _) => tracing::Level::ERROR,
        (false, 0) => tracing::Level::WARN,
        (false, 1) => tracing::Level::INFO,
        (false, _) => tracing::Level::DEBUG,
    };
    tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(progress::BesideTheBar::default)
        .with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr()))
        .with_target(false)
        .without_time()
        .init();
}

/// Ctrl-C, or a request to stop, leaves no half-written file and no worker behind.
fn delete_half_written_files_when_stopped() -> anyhow::Result<()> {
    ctrlc::set_handler(|| {
        eval::stop();
        winze_io::atomic::remove_pending();
        #[expect(clippy::exit, reason = "the user asked for it")]
        std::process::exit(130);
    })
    .context("Ctrl-C may leave temporary files behind")
}
