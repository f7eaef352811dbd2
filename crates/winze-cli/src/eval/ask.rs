//! Methods asked over cases, each in a process of its own or all in one.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use anyhow::Context as _;
use tempfile::TempDir;
use winze::{Config, Method};
use winze_front::evaluation::{self, Case, Found, Gathering, Job, Said, by_map, cost_name};
use winze_front::memory::half_of_what_is_free;
use winze_front::prior::is_built;
use winze_map::BuildOptions;
use winze_report::evaluation::{MapCost, MethodCost, Run, Trouble};

use super::commands::again;
use super::journal::Journal;
use super::{FIGURES, seeds, workers};
use crate::args::{Eval, Global};
use crate::output::talk;
use crate::progress::Progress;

/// What is asked, of every method alike.
pub(super) struct Asked<'a> {
    pub(super) args: &'a Eval,
    pub(super) global: &'a Global,
    pub(super) config: &'a Config,
    pub(super) cases: &'a [Case],
    pub(super) journal: Option<&'a Journal>,
}

impl Asked<'_> {
    fn seeds_of(&self, method: Method) -> Vec<u64> {
        evaluation::seeds_of(method, &seeds(self.args, self.config.seed))
    }

    /// What a journal has of methods on a case, where it has all of it.
    fn known(&self, case: &Case, methods: &[Method]) -> Option<Vec<Vec<Run>>> {
        let journal: &Journal = self.journal?;
        let of = |m: &Method| journal.runs(m.name(), &case.name, &self.seeds_of(*m));
        methods.iter().map(of).collect()
    }

    /// One process' methods on all cases.
    fn one(
        &self,
        first: bool,
        methods: &[Method],
        built: &Shared,
        threads: usize,
        progress: &Progress,
    ) -> anyhow::Result<(Vec<Run>, MethodCost, Vec<Trouble>)> {
        progress.say("read");
        let asked: Vec<(String, Vec<u64>)> = methods
            .iter()
            .map(|m| (m.name().to_owned(), self.seeds_of(*m)))
            .collect();
        let name = cost_name(&asked);
        let mut gathering = Gathering::new(self.cases, &asked);
        let mut left = Vec::new();
        for case in self.cases {
            match self.known(case, methods) {
                Some(known) => {
                    for run in known.into_iter().flatten() {
                        progress.step(&case.name);
                        gathering.run(run);
                    }
                }
                None => left.push(case.clone()),
            }
        }
        let job = Job {
            methods: asked.clone(),
            config: self.config.clone(),
            keep_query: methods.len() > 1,
            figures: self
                .args
                .figures
                .clone()
                .map(|folder| (FIGURES.name().to_owned(), folder)),
            built: built.files.clone(),
            cases: by_map(&left),
        };
        let mut noted = Ok(());
        let mut note = |journal: &dyn Fn(&Journal) -> anyhow::Result<()>| {
            if let (Some(own), Ok(())) = (self.journal, &noted) {
                noted = journal(own);
            }
        };
        // What the readers have to say of a file need not be said again for every method.
        let quiet = self.global.quiet || !first;
        let cost = workers::work(job, self.global, threads, quiet, |said| match said {
            Said::Run(mut run) => {
                if let Some(case) = self.cases.iter().find(|c| c.name == run.case) {
                    run.again = again(self.args, self.global, case, &run.method, run.seed);
                }
                progress.step(&format!("{}: {}", run.method, run.case));
                note(&|journal| journal.run(&run));
                gathering.run(*run);
            }
            Said::Trouble {
                case,
                method,
                message,
            } => gathering.trouble(&case, method.as_deref(), &message),
            Said::Map { cost, peak } => note(&|journal| journal.map(&name, &cost, peak)),
            Said::Over { .. } => {}
        })?;
        if let Err(e) = noted {
            // The tables do not depend on it.
            talk(&format!(
                "winze: note: {e:#}; runs are not noted any more\n"
            ));
        }
        let earlier = self.journal.and_then(|j| j.cost(&name)).cloned();
        let cost = earlier.map_or(cost.clone(), |mut earlier| {
            earlier.peak_memory_bytes = earlier.peak_memory_bytes.max(cost.peak_memory_bytes);
            earlier.add_maps(cost.maps);
            earlier.errors = cost.errors;
            earlier
        });
        let (runs, errors) = gathering.end()?;
        for broken in runs.iter().filter(|r| r.verdict.is_none()) {
            progress.step(&broken.case);
        }
        Ok((runs, cost, errors))
    }
}

/// Every method in a process of its own; unless several are asked for at once, one after another, so that
/// seconds are those of a machine with nothing else to do.
pub(super) fn ask(
    asked: &Asked<'_>,
    groups: &[Vec<Method>],
    (jobs, threads): (usize, usize),
) -> anyhow::Result<Found> {
    let total: usize = groups
        .iter()
        .flatten()
        .map(|m| asked.seeds_of(*m).len() * asked.cases.len())
        .sum();
    let progress = Progress::counted(asked.global.quiet, total);
    let mut shared = shared_maps(asked, groups, &progress)?;
    let next = AtomicUsize::new(0);
    let found = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    let Some(group) = groups.get(i) else {
                        return;
                    };
                    let answer = asked.one(i == 0, group, &shared, threads, &progress);
                    let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                    found.push((i, answer));
                }
            });
        }
    });
    progress.finish();
    let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.sort_by_key(|(i, _)| *i);
    let mut all = Found::default();
    for (_, answer) in found {
        let (own, cost, trouble) = answer?;
        all.runs.extend(own);
        all.costs.push(cost);
        all.errors.extend(trouble);
    }
    all.costs.extend(shared.cost.take());
    workers::remember(None);
    Ok(all)
}

/// The name under which the cost of building maps is told.
const BUILDING: &str = "map build";

/// Maps that several questions share, built once, by the clouds they are made of.
#[derive(Default)]
struct Shared {
    files: Vec<(PathBuf, PathBuf)>,
    cost: Option<MethodCost>,
    /// Where they are, while they are.
    _folder: Option<TempDir>,
}

/// Builds each map that is asked more than once.
fn shared_maps(
    asked: &Asked<'_>,
    groups: &[Vec<Method>],
    progress: &Progress,
) -> anyhow::Result<Shared> {
    let config = asked.config;
    let mut shared = Shared::default();
    // Clouds that are cleaned before they are thinned cannot be built in a stream.
    if config.prepare.denoise_first {
        return Ok(shared);
    }
    let mut questions: Vec<(&Path, usize)> = Vec::new();
    for case in groups.iter().flat_map(|group| {
        let left = move |c: &&Case| asked.known(c, group).is_none();
        asked.cases.iter().filter(left)
    }) {
        match questions.iter_mut().find(|(map, _)| *map == case.map) {
            Some((_, count)) => *count += 1,
            None => questions.push((&case.map, 1)),
        }
    }
    questions.retain(|(map, count)| *count > 1 && !is_built(map));
    if questions.is_empty() {
        return Ok(shared);
    }
    let folder = tempfile::tempdir().context("no folder for built maps")?;
    workers::remember(Some(folder.path()));
    let earlier = asked.journal.and_then(|j| j.cost(BUILDING)).cloned();
    let mut cost = earlier.unwrap_or_else(|| MethodCost {
        method: BUILDING.into(),
        ..MethodCost::default()
    });
    for (i, (map, _)) in questions.into_iter().enumerate() {
        progress.say(&format!("build {}", map.display()));
        let begun = Instant::now();
        let file = folder.path().join(format!("{i}.wmap"));
        let options = BuildOptions {
            memory: half_of_what_is_free(),
            ..BuildOptions::default()
        };
        match winze_map::build(&[map.to_owned()], &file, config, &options) {
            Ok(meta) => {
                let own = MapCost {
                    map: map.display().to_string(),
                    points: usize::try_from(meta.points).unwrap_or(usize::MAX),
                    read_seconds: 0.0,
                    work_seconds: begun.elapsed().as_secs_f64(),
                };
                if let Some(journal) = asked.journal {
                    journal.map(BUILDING, &own, None)?;
                }
                cost.add_maps([own]);
                shared.files.push((map.to_owned(), file));
            }
            // Every method prepares it for itself then, and tells what is wrong with the cloud, if anything.
            Err(e) => tracing::warn!("{}: not built beforehand: {e}", map.display()),
        }
    }
    shared.cost = Some(cost);
    shared._folder = Some(folder);
    Ok(shared)
}

/// How many methods run at once, and on how many threads each.
pub(super) fn shared_out(args: &Eval, global: &Global, processes: usize) -> (usize, usize) {
    let all = match global.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n,
    };
    let jobs = args.jobs.unwrap_or(1).clamp(1, processes.max(1));
    if jobs == 1 {
        return (1, global.threads);
    }
    (jobs, all.div_ceil(jobs))
}
