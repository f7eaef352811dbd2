//! Workers as their parent sees them: watched, and never left behind.

use std::io::{BufRead as _, BufReader, Write as _};
use std::mem;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, bail};
use winze_front::evaluation::{Job, Said, cost_name};
use winze_report::evaluation::MethodCost;

use crate::args::Global;
use crate::output::talk;

/// The workers that are at it.
static WORKERS: Mutex<Vec<Child>> = Mutex::new(Vec::new());

/// For a handler of Ctrl-C: ends the workers, and lets none come after them.
pub(crate) fn stop() {
    let mut workers = WORKERS.lock().unwrap_or_else(PoisonError::into_inner);
    for child in workers.iter_mut() {
        // Gone already is as good.
        let _ = child.kill();
        let _ = child.wait();
    }
    mem::forget(workers);
    let folder = FOLDER.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(folder) = &*folder {
        // Nothing is left to be done about a folder that will not go.
        let _ = std::fs::remove_dir_all(folder);
    }
    mem::forget(folder);
}

/// A folder that is to go when all is stopped.
static FOLDER: Mutex<Option<PathBuf>> = Mutex::new(None);

/// For a handler of Ctrl-C: this folder goes, or none.
pub(super) fn remember(folder: Option<&Path>) {
    let mut known = FOLDER.lock().unwrap_or_else(PoisonError::into_inner);
    *known = folder.map(Path::to_owned);
}

/// Has `job` done and hands on what is said. Where a worker dies over a case, that case is in
/// trouble, and another worker does the rest. `threads` as on the command line.
pub(super) fn work(
    mut job: Job,
    global: &Global,
    threads: usize,
    quiet: bool,
    mut heard: impl FnMut(Said),
) -> anyhow::Result<MethodCost> {
    let mut cost = MethodCost {
        method: cost_name(&job.methods),
        ..MethodCost::default()
    };
    while !job.cases.is_empty() {
        let mut over = 0;
        let died = watch(&job, global, threads, quiet, &mut |said| match said {
            Said::Over { peak, .. } => {
                over += 1;
                cost.peak_memory_bytes = cost.peak_memory_bytes.max(peak);
            }
            said => {
                match &said {
                    Said::Map { cost: map, peak } => {
                        cost.add_maps([map.clone()]);
                        cost.peak_memory_bytes = cost.peak_memory_bytes.max(*peak);
                    }
                    Said::Trouble { .. } => cost.errors += 1,
                    _ => {}
                }
                heard(said);
            }
        })?;
        let rest = job.cases.split_off(over.min(job.cases.len()));
        job.cases = rest;
        match (died, job.cases.is_empty()) {
            (_, true) => {}
            (None, false) => bail!("a worker ended before its work did"),
            (Some(how), false) => {
                let case = job.cases.remove(0).name;
                cost.errors += 1;
                heard(Said::Trouble {
                    case,
                    method: None,
                    message: format!("the process that ran it ended: {how}"),
                });
            }
        }
    }
    Ok(cost)
}

/// One worker from beginning to end; how it died, where it did.
fn watch(
    job: &Job,
    global: &Global,
    threads: usize,
    quiet: bool,
    heard: &mut dyn FnMut(Said),
) -> anyhow::Result<Option<String>> {
    let program = own_file()?;
    let mut command = Command::new(program);
    command
        .arg("eval-worker")
        .arg("--threads")
        .arg(threads.to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    if quiet {
        command.arg("--quiet");
    } else {
        command.args((0..global.verbose).map(|_| "--verbose"));
    }
    // Held until the worker is on record, so that it cannot be missed when all is stopped.
    let mut record = WORKERS.lock().unwrap_or_else(PoisonError::into_inner);
    let mut child = command.spawn().context("cannot start a worker")?;
    let (input, output, talked) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
    let id = child.id();
    record.push(child);
    drop(record);
    let (Some(mut input), Some(output), Some(talked)) = (input, output, talked) else {
        bail!("a worker cannot be talked with");
    };
    let text = serde_json::to_vec(job).context("a job cannot be written down")?;
    let talker = std::thread::spawn(move || {
        for line in BufReader::new(talked).lines().map_while(Result::ok) {
            talk(&format!("{line}\n"));
        }
    });
    // One that dies at once does not read its job; how it ended is told below.
    let _ = input.write_all(&text);
    drop(input);
    let mut odd = None;
    for line in BufReader::new(output).lines().map_while(Result::ok) {
        match serde_json::from_str(&line) {
            Ok(said) => heard(said),
            Err(e) => {
                odd = Some(e);
                break;
            }
        }
    }
    let mut record = WORKERS.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(at) = record.iter().position(|c| c.id() == id) else {
        return Ok(None);
    };
    let mut child = record.swap_remove(at);
    drop(record);
    if let Some(e) = odd {
        let _ = child.kill();
        let _ = child.wait();
        bail!("a worker said what cannot be understood: {e}");
    }
    let _ = talker.join();
    let status = child.wait().context("a worker's end")?;
    Ok((!status.success()).then(|| status.to_string()))
}

/// The file of this program; on Linux the very one that runs, also where it was replaced meanwhile.
fn own_file() -> anyhow::Result<PathBuf> {
    let running = PathBuf::from("/proc/self/exe");
    if running.exists() {
        return Ok(running);
    }
    std::env::current_exe().context("cannot find this program's own file")
}
