//! Settings, as JSON of those that are not the default.

use pyo3::prelude::*;
use winze::Config;
use winze_front::settings;
use winze_map::Map;

use crate::error::raise;

/// The settings of a run: the defaults, or those that a map was built with, and over them what was set.
pub(crate) fn config(set: &str, built: Option<&Map>) -> PyResult<Config> {
    let set: toml::Table = serde_json::from_str(set).map_err(raise)?;
    settings::from_table(built, set).map_err(raise)
}

/// Raises where a value is outside its domain.
#[pyfunction]
pub(crate) fn check_config(set: &str) -> PyResult<()> {
    config(set, None).map(|_| ())
}

/// All settings as TOML with what each one means.
#[pyfunction]
pub(crate) fn config_text(set: &str) -> PyResult<String> {
    settings::commented(&config(set, None)?).map_err(raise)
}

/// The settings of a TOML text, as JSON.
#[pyfunction]
pub(crate) fn parse_config(text: &str) -> PyResult<String> {
    let table = settings::from_file(text).map_err(raise)?;
    serde_json::to_string(&table).map_err(raise)
}
