//! Methods over cases.

use std::path::PathBuf;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use winze::Method;
use winze_front::evaluation;

use crate::error::raise;
use crate::work;

/// The evaluation as JSON, and its tables as text.
#[pyfunction]
#[pyo3(signature = (cases, *, methods, seeds, only, family, every, set, seed, command, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "named in Python")]
pub(crate) fn evaluate(
    py: Python<'_>,
    cases: PathBuf,
    methods: Vec<String>,
    seeds: u64,
    only: Vec<String>,
    family: Vec<String>,
    every: usize,
    set: &str,
    seed: Option<u64>,
    command: String,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, String)> {
    let parse = |name: &String| -> PyResult<Method> {
        name.parse()
            .map_err(|e| PyValueError::new_err(format!("methods: {e}")))
    };
    let methods = methods
        .iter()
        .map(parse)
        .collect::<PyResult<Vec<Method>>>()?;
    let config = crate::settings::seeded(set, None, seed)?;
    work::run(py, threads, progress.as_ref(), |told| {
        let file = evaluation::cases::file_of(&cases);
        let (all, _) = evaluation::cases::read(&file).map_err(raise)?;
        let choice = evaluation::cases::Choice {
            only: &only,
            family: &family,
            every,
        };
        let chosen = choice.of(all);
        if chosen.is_empty() {
            return Err(PyValueError::new_err(format!(
                "{}: no case is left to run",
                file.display()
            )));
        }
        #[expect(clippy::cast_precision_loss, reason = "a share")]
        let mut say = |case: &str, done: usize, all: usize| {
            told.say(case, Some(done as f64 / all.max(1) as f64));
            Ok(())
        };
        let seeds: Vec<u64> = (0..seeds).map(|i| config.seed.saturating_add(i)).collect();
        let evaluation =
            evaluation::evaluate(&chosen, &methods, &seeds, &config, command, &mut say)
                .map_err(raise)?;
        Ok((evaluation.to_json(), evaluation::text(&evaluation)))
    })
}

/// The cases of a file, or of the folder that holds one, checked, as JSON; paths count from where the program runs.
#[pyfunction]
pub(crate) fn read_cases(path: PathBuf) -> PyResult<String> {
    let file = evaluation::cases::file_of(&path);
    let (cases, _) = evaluation::cases::read(&file).map_err(raise)?;
    serde_json::to_string(&cases).map_err(raise)
}
