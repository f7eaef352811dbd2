//! An evaluation in the process that calls for it.

use anyhow::bail;
use winze::{Config, Method};
use winze_report::Evaluation;
use winze_report::evaluation::MethodCost;

use super::assembled::{Asked, Found, assembled};
use super::cases::Case;
use super::gathering::Gathering;
use super::job::{Job, Said, by_map, cost_name, seeds_of};
use super::work::work;
use crate::settings::digest;

/// Asks `methods`, each with every one of `seeds`, over `cases`, in this process and the pool of threads that the caller
/// is in; the methods share work, so that seconds are no method's own. A case without an answer is among the errors and
/// stays in every denominator. Memory is not told: it is the caller's as well.
///
/// `command` says in the evaluation how to get it again. `told` hears after each run of the case, how many runs are done,
/// and how many there are.
///
/// # Errors
/// Where there is nothing to ask, and what `told` gives back, which ends the evaluation.
pub fn evaluate(
    cases: &[Case],
    methods: &[Method],
    seeds: &[u64],
    config: &Config,
    command: String,
    told: &mut dyn FnMut(&str, usize, usize) -> anyhow::Result<()>,
) -> anyhow::Result<Evaluation> {
    let (methods, seeds) = (once(methods), once(seeds));
    for (what, none) in [
        ("cases", cases.is_empty()),
        ("methods", methods.is_empty()),
        ("seeds", seeds.is_empty()),
    ] {
        if none {
            bail!("{what}: none is given");
        }
    }
    let asked: Vec<(String, Vec<u64>)> = methods
        .iter()
        .map(|m| (m.name().to_owned(), seeds_of(*m, &seeds)))
        .collect();
    let together = methods.len() > 1;
    let job = Job {
        methods: asked.clone(),
        config: config.clone(),
        keep_query: together,
        figures: None,
        built: Vec::new(),
        cases: by_map(cases),
    };
    let each: usize = asked.iter().map(|(_, seeds)| seeds.len()).sum();
    let all = each * cases.len();
    let mut gathering = Gathering::new(cases, &asked);
    let mut cost = MethodCost {
        method: cost_name(&asked),
        ..MethodCost::default()
    };
    let (mut done, mut over) = (0, 0);
    work(&job, &mut |said| {
        match said {
            Said::Run(run) => {
                done += 1;
                told(&run.case, done, all)?;
                gathering.run(*run);
            }
            Said::Trouble {
                case,
                method,
                message,
            } => {
                cost.errors += 1;
                gathering.trouble(&case, method.as_deref(), &message);
            }
            Said::Over { case, .. } => {
                over += each;
                // Runs that broke off are done too.
                if done < over {
                    done = over;
                    told(&case, done, all)?;
                }
            }
            Said::Map { cost: map, .. } => cost.add_maps([map]),
        }
        Ok(())
    })?;
    let (runs, errors) = gathering.end()?;
    let asked = Asked {
        command,
        config_digest: digest(config)?,
        seeds,
        jobs: 1,
        together,
        threads: rayon::current_num_threads(),
        paper: false,
    };
    let found = Found {
        runs,
        costs: vec![cost],
        errors,
    };
    assembled(asked, cases, found)
}

/// Each but once, in the order in which they first come.
fn once<T: Copy + PartialEq>(all: &[T]) -> Vec<T> {
    let mut kept = Vec::new();
    for one in all {
        if !kept.contains(one) {
            kept.push(*one);
        }
    }
    kept
}
