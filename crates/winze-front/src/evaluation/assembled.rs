//! An evaluation, made of all its runs.

use winze_report::evaluation::{
    Evaluation, Labelled, MethodCost, Paper, Run, Trouble, calibrations, coverages, labels, steps,
    summaries,
};

use super::cases::Case;

/// What was asked, and how it was run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asked {
    /// The command line.
    pub command: String,
    /// Digest of the settings.
    pub config_digest: String,
    /// Seeds that each case was run with.
    pub seeds: Vec<u64>,
    /// Methods that ran at once.
    pub jobs: usize,
    /// Methods ran in one process and shared work.
    pub together: bool,
    /// Threads of each; 0 for all.
    pub threads: usize,
    /// The paper's tables are wanted.
    pub paper: bool,
}

/// What was found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Found {
    /// Every run, in the order of methods, then cases, then seeds.
    pub runs: Vec<Run>,
    /// Time on maps and memory, per method.
    pub costs: Vec<MethodCost>,
    /// Cases without an answer.
    pub errors: Vec<Trouble>,
}

/// The evaluation of what was found over `cases`: labels, rates, calibration, coverage, steps.
///
/// # Errors
/// As [`Case::truth`].
pub fn assembled(asked: Asked, cases: &[Case], found: Found) -> anyhow::Result<Evaluation> {
    let truths = cases
        .iter()
        .map(Case::truth)
        .collect::<anyhow::Result<Vec<_>>>()?;
    let with_truth = cases.iter().zip(&truths);
    let runs = found.runs;
    Ok(Evaluation {
        winze: env!("CARGO_PKG_VERSION"),
        command: asked.command,
        config_digest: asked.config_digest,
        seeds: asked.seeds,
        jobs: asked.jobs,
        together: asked.together,
        threads: asked.threads,
        labels: labels(with_truth.map(|(c, truth)| Labelled {
            family: &c.family,
            truth,
            gravity_aligned: c.gravity_aligned,
            overlap: c.overlap,
            bend_rms_m: c.bend_rms_m,
        })),
        summaries: summaries(&runs),
        calibrations: calibrations(&runs),
        coverages: coverages(&runs),
        steps: steps(&runs),
        costs: found.costs,
        errors: found.errors,
        paper: asked.paper.then(|| Paper::of(&runs)),
        runs,
    })
}
