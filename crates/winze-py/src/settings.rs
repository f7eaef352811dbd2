//! Settings, as JSON of those that are not the default.

use pyo3::prelude::*;
use winze::Config;
use winze_front::settings;
use winze_map::Map;

use crate::error::raise;

/// The settings of a run: the defaults, or those that a map was built with, and over them what was set.
pub(crate) fn config(set: &str, built: Option<&Map>) -> PyResult<Config> {
    seeded(set, built, None)
}

/// The same with a seed, which TOML could not hold in full.
pub(crate) fn seeded(set: &str, built: Option<&Map>, seed: Option<u64>) -> PyResult<Config> {
    let set: toml::Table = serde_json::from_str(set).map_err(raise)?;
    let mut config = settings::from_table(built, set).map_err(raise)?;
    if let Some(seed) = seed {
        config.seed = seed;
    }
    Ok(config)
}

/// All settings as TOML with what each one means.
#[pyfunction]
#[pyo3(signature = (set, seed))]
pub(crate) fn config_text(set: &str, seed: Option<u64>) -> PyResult<String> {
    settings::commented(&seeded(set, None, seed)?).map_err(raise)
}

/// The settings of a TOML text, as JSON.
#[pyfunction]
pub(crate) fn parse_config(text: &str) -> PyResult<String> {
    let table = settings::from_file(text).map_err(raise)?;
    serde_json::to_string(&table).map_err(raise)
}
