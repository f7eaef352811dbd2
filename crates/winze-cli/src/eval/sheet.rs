//! The failures as pictures, and runs of note to be turned, for the page.

use std::path::{Path, PathBuf};

use winze::Pose;
use winze_front::evaluation::{Case, figure_name};
use winze_front::reading::read;
use winze_report::evaluation::{Class, Evaluation, Exhibit, Run, RunView};
use winze_report::{Limits, evaluation_page, scene_of_run, thumbnail};

use crate::args::Global;
use crate::progress::Progress;

/// Pictures on a page at most.
const MOST: usize = 36;
/// Runs on it that can be turned, at most; so many of them failures.
const VIEWS: usize = 8;
const FAILED_VIEWS: usize = 6;

/// The page, with a picture of each of the worst failures.
pub(super) fn page(
    evaluation: &Evaluation,
    chosen: &[Case],
    figures: Option<&Path>,
    global: &Global,
) -> anyhow::Result<String> {
    let failures = failures(&evaluation.runs);
    let viewed = of_note(&failures, &evaluation.runs);
    let unseen = viewed.iter().skip(failures.len().min(FAILED_VIEWS));
    let mut shown: Vec<(usize, &Run, &Case)> = failures
        .iter()
        .take(MOST)
        .chain(unseen)
        .enumerate()
        .filter_map(|(i, r)| Some((i, *r, chosen.iter().find(|c| c.name == r.case)?)))
        .collect();
    // A map is read once for all of its pictures.
    shown.sort_by(|a, b| a.2.map.cmp(&b.2.map));
    let progress = Progress::counted(global.quiet, shown.len());
    let mut exhibits: Vec<(usize, Exhibit<'_>)> = Vec::new();
    let mut views: Vec<(usize, RunView<'_>)> = Vec::new();
    for group in shown.chunk_by(|a, b| a.2.map == b.2.map) {
        let Some(map) = group.first().and_then(|g| read_again(g.2, |c| &c.map)) else {
            continue;
        };
        for (i, run, case) in group {
            progress.step("draw");
            let Some(query) = read_again(case, |c| &c.query) else {
                continue;
            };
            let found = run.map_from_query.map(Pose::from_matrix).transpose()?;
            let truth = case.truth()?.truth;
            let poses = (found.as_ref(), truth.as_ref());
            if viewed.iter().any(|v| std::ptr::eq(*v, *run)) {
                let scene = scene_of_run(&map.cloud, &query.cloud, poses.0, poses.1, Limits::RUN);
                views.push((*i, RunView { run, scene }));
            }
            if run.mark.class != Class::Right {
                let png = thumbnail(&map.cloud, &query.cloud, poses.0, poses.1)?;
                exhibits.push((*i, Exhibit { run, png }));
            }
        }
    }
    progress.finish();
    exhibits.sort_by_key(|(i, _)| *i);
    let exhibits: Vec<Exhibit<'_>> = exhibits.into_iter().map(|(_, e)| e).collect();
    views.sort_by_key(|(i, _)| *i);
    let views: Vec<RunView<'_>> = views.into_iter().map(|(_, v)| v).collect();
    let drawn = |case: &Case| {
        let png = std::fs::read(figures?.join(figure_name(&case.name))).ok()?;
        Some((case.name.clone(), png))
    };
    let figures: Vec<(String, Vec<u8>)> = chosen.iter().filter_map(drawn).collect();
    Ok(evaluation_page(
        evaluation,
        &exhibits,
        failures.len(),
        &views,
        &figures,
    ))
}

/// A file that has gone since it was evaluated costs its picture, not the page.
fn read_again(case: &Case, path: impl Fn(&Case) -> &PathBuf) -> Option<winze_io::CloudFile> {
    read(path(case))
        .inspect_err(|e| tracing::warn!("no picture of {}: {e:#}", case.name))
        .ok()
}

/// The worst failures, then right answers, one of each family and method.
fn of_note<'a>(failures: &[&'a Run], runs: &'a [Run]) -> Vec<&'a Run> {
    let mut chosen: Vec<&Run> = failures.iter().copied().take(FAILED_VIEWS).collect();
    let right = runs.iter().filter(|r| r.mark.class == Class::Right);
    let mut kinds: Vec<(&str, &str)> = Vec::new();
    for run in right {
        let kind = (run.family.as_str(), run.method.as_str());
        if chosen.len() < VIEWS && !kinds.contains(&kind) {
            kinds.push(kind);
            chosen.push(run);
        }
    }
    chosen
}

/// What went wrong, the worst first: wrong accepts, wrong poses, refusals; within each the methods by
/// turns. Of the seeds of one case the first that failed so stands for all.
fn failures(runs: &[Run]) -> Vec<&Run> {
    let mut seen: Vec<(usize, &str, &str)> = Vec::new();
    let mut ranked: Vec<(usize, usize, &Run)> = Vec::new();
    for run in runs {
        let rank = match run.mark.class {
            Class::Right => continue,
            Class::WrongAccept => 0,
            Class::Refusal if run.mark.has_truth && !run.mark.pose_right => 1,
            Class::Refusal => 2,
        };
        let key = (rank, run.method.as_str(), run.case.as_str());
        if seen.contains(&key) {
            continue;
        }
        let turn = seen
            .iter()
            .filter(|(r, m, _)| (*r, *m) == (rank, key.1))
            .count();
        seen.push(key);
        ranked.push((rank, turn, run));
    }
    ranked.sort_by_key(|(rank, turn, _)| (*rank, *turn));
    ranked.into_iter().map(|(_, _, r)| r).collect()
}
