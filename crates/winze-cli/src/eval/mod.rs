//! `winze eval`: methods over cases, the tables.

mod cases;
mod journal;
mod sheet;
mod worker;
mod workers;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, bail};
use winze::{Config, Method};
use winze_io::atomic;
use winze_report::evaluation::{
    CLOUDS, Evaluation, Labelled, MethodCost, Paper, Run, Trouble, accuracy, answers, costs,
    label_table, labels, summaries,
};

use crate::args::{Eval, Global};
use crate::config;
use crate::output::{check_outputs, print, talk};
use crate::progress::Progress;
use cases::{Case, Choice};
use journal::{Head, Journal};
use worker::{Job, Said};

pub(crate) use worker::run as run_worker;
pub(crate) use workers::stop;

/// Seeds where none are asked for: one, or as many as the paper's tables want.
const PAPER_SEEDS: u64 = 20;
/// The method whose pictures stand for the paper's figures.
const FIGURES: Method = Method::FpfhNdtIcp;

pub(crate) fn run(args: &Eval, global: &Global) -> anyhow::Result<ExitCode> {
    let config = config::effective(global)?;
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
    let share = shared_out(args, global, groups.len());
    let config_digest = config::digest(&config)?;
    let head = Head {
        winze: env!("CARGO_PKG_VERSION").to_owned(),
        config_digest: config_digest.clone(),
        cases_digest,
        together: groups.iter().any(|g| g.len() > 1),
        jobs: share.0,
        threads: share.1,
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
    let (runs, costs, errors) = ask(&asked, &groups, share)?;
    let truths = chosen
        .iter()
        .map(Case::truth)
        .collect::<anyhow::Result<Vec<_>>>()?;
    let with_truth = chosen.iter().zip(&truths);
    let evaluation = Evaluation {
        winze: env!("CARGO_PKG_VERSION"),
        command: command(),
        config_digest,
        seeds: seeds(args, config.seed),
        jobs: share.0,
        together: groups.iter().any(|g| g.len() > 1),
        threads: share.1,
        labels: labels(with_truth.map(|(c, truth)| Labelled {
            family: &c.family,
            truth,
            gravity_aligned: c.gravity_aligned,
            overlap: c.overlap,
            bend_rms_m: c.bend_rms_m,
        })),
        summaries: summaries(&runs),
        costs,
        errors,
        paper: args.paper.then(|| Paper::of(&runs)),
        runs,
    };
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

/// What is asked, of every method alike.
struct Asked<'a> {
    args: &'a Eval,
    global: &'a Global,
    config: &'a Config,
    cases: &'a [Case],
    journal: Option<&'a Journal>,
}

impl Asked<'_> {
    fn seeds_of(&self, method: Method) -> Vec<u64> {
        let mut seeds = seeds(self.args, self.config.seed);
        if !method.uses_features() {
            // Nothing is drawn at random: all seeds would say the same.
            seeds.truncate(1);
        }
        seeds
    }

    /// One process' methods on all cases.
    fn one(
        &self,
        first: bool,
        methods: &[Method],
        threads: usize,
        progress: &Progress,
    ) -> anyhow::Result<(Vec<Run>, MethodCost, Vec<Trouble>)> {
        progress.say("read");
        let asked: Vec<(String, Vec<u64>)> = methods
            .iter()
            .map(|m| (m.name().to_owned(), self.seeds_of(*m)))
            .collect();
        let name = workers::cost_name(&asked);
        let (mut runs, mut errors): (Vec<Run>, Vec<Trouble>) = Default::default();
        let mut left = Vec::new();
        for case in self.cases {
            let all = |journal: &Journal| -> Option<Vec<Vec<Run>>> {
                let of =
                    |(method, seeds): &(String, Vec<u64>)| journal.runs(method, &case.name, seeds);
                asked.iter().map(of).collect()
            };
            match self.journal.and_then(all) {
                Some(known) => {
                    for run in known.into_iter().flatten() {
                        progress.step(&case.name);
                        runs.push(run);
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
                runs.push(*run);
            }
            Said::Trouble {
                case,
                method,
                message,
            } => errors.extend(
                asked
                    .iter()
                    .filter(|(m, _)| method.as_ref().is_none_or(|own| own == m))
                    .map(|(m, _)| Trouble {
                        case: case.clone(),
                        method: m.clone(),
                        message: message.clone(),
                    }),
            ),
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
            earlier.maps.extend(cost.maps);
            earlier.errors = cost.errors;
            earlier
        });
        // Where a process that ran several died, those that had answered are in no trouble.
        errors.retain(|e| {
            let own = asked.iter().find(|(m, _)| *m == e.method);
            let answered = |seed: &u64| {
                let is = |r: &Run| r.case == e.case && r.method == e.method && r.seed == *seed;
                runs.iter().any(is)
            };
            !own.is_some_and(|(_, seeds)| seeds.iter().all(answered))
        });
        // What broke off stays in every denominator.
        for trouble in &errors {
            let case = self.cases.iter().find(|c| c.name == trouble.case);
            let own = asked.iter().find(|(m, _)| *m == trouble.method);
            let (Some(case), Some((method, seeds))) = (case, own) else {
                continue;
            };
            let truth = case.truth()?;
            for &seed in seeds {
                let is = |r: &Run| r.case == case.name && r.method == *method && r.seed == seed;
                if !runs.iter().any(is) {
                    let (name, family) = (&case.name, &case.family);
                    let why = &trouble.message;
                    runs.push(Run {
                        sensor: case.sensor.clone(),
                        overlap: case.overlap,
                        ..Run::broken(name, family, method, seed, &truth, why)
                    });
                    progress.step(name);
                }
            }
        }
        // Methods one after the other, each in the order of the file; seeds stay in theirs.
        runs.sort_by_key(|r| {
            (
                asked.iter().position(|(m, _)| *m == r.method),
                self.cases.iter().position(|c| c.name == r.case),
            )
        });
        Ok((runs, cost, errors))
    }
}

/// Every method in a process of its own; unless several are asked for at once, one after another, so that
/// seconds are those of a machine with nothing else to do.
fn ask(
    asked: &Asked<'_>,
    groups: &[Vec<Method>],
    (jobs, threads): (usize, usize),
) -> anyhow::Result<(Vec<Run>, Vec<MethodCost>, Vec<Trouble>)> {
    let total: usize = groups
        .iter()
        .flatten()
        .map(|m| asked.seeds_of(*m).len() * asked.cases.len())
        .sum();
    let progress = Progress::counted(asked.global.quiet, total);
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
                    let answer = asked.one(i == 0, group, threads, &progress);
                    let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                    found.push((i, answer));
                }
            });
        }
    });
    progress.finish();
    let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.sort_by_key(|(i, _)| *i);
    let (mut runs, mut costs, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    for (_, answer) in found {
        let (own, cost, trouble) = answer?;
        runs.extend(own);
        costs.push(cost);
        errors.extend(trouble);
    }
    Ok((runs, costs, errors))
}

/// How many methods run at once, and on how many threads each.
fn shared_out(args: &Eval, global: &Global, processes: usize) -> (usize, usize) {
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

/// Cases on one map together, maps in the order in which they first come.
fn by_map(cases: &[Case]) -> Vec<Case> {
    let mut maps: Vec<&Path> = Vec::new();
    for c in cases {
        if !maps.contains(&c.map.as_path()) {
            maps.push(&c.map);
        }
    }
    let mut sorted = cases.to_vec();
    sorted.sort_by_key(|c| maps.iter().position(|m| *m == c.map));
    sorted
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

fn text(e: &Evaluation) -> String {
    let mut out = String::new();
    if let Some(paper) = &e.paper {
        out += &paper.to_markdown();
    } else {
        let _ = writeln!(out, "{}", label_table(&e.labels).to_text());
        let _ = writeln!(out, "{}", answers(&e.summaries).to_text());
        let _ = writeln!(out, "{}", accuracy(&e.summaries).to_text());
        out += "m and °: errors of right poses, across what is unobservable; all m: of every pose of a query in the map.\n";
    }
    let _ = write!(out, "\n{}", costs(&e.costs).to_text());
    if e.jobs > 1 {
        let _ = writeln!(
            out,
            "\nSeconds were taken with {} methods running at once.",
            e.jobs
        );
    }
    if e.together && e.paper.is_none() {
        out += "\nMethods shared one process and its work: seconds are told of the first alone.\n";
    }
    if e.seeds.len() > 1 && e.paper.is_none() {
        let _ = writeln!(
            out,
            "\nIntervals take runs for independent, which several seeds on one case are not."
        );
    }
    out
}

/// Command lines that give one run again: as it was judged, and by `locate`.
fn again(args: &Eval, global: &Global, case: &Case, method: &str, seed: u64) -> Vec<String> {
    let mut settings = format!(" --method {method} --seed {seed}");
    if let Some(path) = &global.config {
        let _ = write!(
            settings,
            " --config {}",
            quoted(&path.display().to_string())
        );
    }
    for set in &global.set {
        let _ = write!(settings, " --set {}", quoted(set));
    }
    let path = |p: &Path| quoted(&p.display().to_string());
    let upright = if case.gravity_aligned {
        " --gravity-aligned"
    } else {
        ""
    };
    vec![
        format!(
            "winze eval {} --only {}{settings}",
            path(&args.cases),
            quoted(&case.name)
        ),
        format!(
            "winze locate {} {}{upright}{settings}",
            path(&case.map),
            path(&case.query)
        ),
    ]
}

/// The command line of this run.
fn command() -> String {
    let words = std::env::args().skip(1).map(|a| quoted(&a));
    std::iter::once("winze".to_owned())
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}

/// A word as a shell takes it for one.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./=+,:@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(quoted("paper/cloud_1"), "paper/cloud_1");
        assert_eq!(quoted("fpfh.radius=3 voxels"), "'fpfh.radius=3 voxels'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
