//! One method over all cases, in a process of its own, so that its memory is its own; or several, which share work.
//!
//! The job comes as JSON on stdin, what is found goes as one JSON line each to stdout.

use std::io::{self, Write as _};
use std::process::ExitCode;

use anyhow::Context as _;
use winze_front::evaluation::{Job, Said, work};

pub(crate) fn run() -> anyhow::Result<ExitCode> {
    let job: Job = serde_json::from_reader(io::stdin().lock()).context("eval-worker: its job")?;
    work(&job, &mut |said| say(&said))?;
    Ok(ExitCode::SUCCESS)
}

fn say(said: &Said) -> anyhow::Result<()> {
    let mut line = serde_json::to_vec(said)?;
    line.push(b'\n');
    let mut out = io::stdout().lock();
    out.write_all(&line)
        .and_then(|()| out.flush())
        .context("eval-worker: stdout")
}
