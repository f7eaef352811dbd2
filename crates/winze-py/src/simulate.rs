//! Simulated mines.

use std::path::PathBuf;

use numpy::PyArray2;
use pyo3::prelude::*;
use winze_front::mines::{self, Told};
use winze_sim::scenario::{self, Scenario};

use crate::arrays;
use crate::cloud::Cloud;
use crate::error::raise;
use crate::work;

/// The built-in scenarios with what each is about and how many cases it has.
#[pyfunction]
pub(crate) fn scenarios() -> PyResult<Vec<(String, String, usize)>> {
    scenario::builtin::names()
        .map(|name| {
            let scenario = Scenario::open(name).map_err(raise)?;
            let cases = scenario.cases();
            Ok((name.to_owned(), scenario.about, cases))
        })
        .collect()
}

/// The demo's mine: map, query and `map_from_query`.
#[pyfunction]
pub(crate) fn demo(
    py: Python<'_>,
    seed: u64,
) -> PyResult<(Cloud, Cloud, Bound<'_, PyArray2<f64>>)> {
    let scene = work::run(py, 0, None, |_| winze_sim::demo(seed).map_err(raise))?;
    let pose = arrays::matrix(py, &scene.map_from_query)?;
    Ok((
        Cloud::made(scene.map, false),
        Cloud::made(scene.query, false),
        pose,
    ))
}

/// Plays a scenario into a folder; notes on it.
#[pyfunction]
#[pyo3(signature = (scenario, out, *, seed, count, mesh, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "named in Python")]
pub(crate) fn simulate(
    py: Python<'_>,
    scenario: &str,
    out: PathBuf,
    seed: u64,
    count: Option<usize>,
    mesh: bool,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<String>> {
    let mut scenario = Scenario::open(scenario).map_err(raise)?;
    if let Some(count) = count {
        scenario.limit(count);
    }
    let all = scenario.cases().max(1);
    work::run(py, threads, progress.as_ref(), |told| {
        #[expect(clippy::cast_precision_loss, reason = "a share")]
        let say = |t: Told<'_>| {
            if let Told::Step(step) = t {
                told.say(step.what, Some(step.done as f64 / all as f64));
            }
        };
        let played = mines::simulate(&scenario, seed, &out, mesh, &say).map_err(raise)?;
        Ok(played.notes)
    })
}
