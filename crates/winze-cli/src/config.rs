//! `winze config`: the effective settings.

use std::process::ExitCode;

use winze_front::settings::{commented, effective};

use crate::args::Global;
use crate::output::print;

pub(crate) fn run(global: &Global) -> anyhow::Result<ExitCode> {
    print(&commented(&effective(&global.layers())?)?)?;
    Ok(ExitCode::SUCCESS)
}
