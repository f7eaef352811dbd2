//! `winze convert`: from one format to another.

use std::process::ExitCode;

use winze_io::{WriteOptions, write_cloud};

use crate::args::Convert;
use crate::locate::read;

pub(crate) fn run(args: &Convert) -> anyhow::Result<ExitCode> {
    let file = read(&args.input)?;
    let report = write_cloud(
        &args.output,
        &file.cloud,
        &WriteOptions {
            encoding: args.encoding,
        },
    )?;
    for warning in &report.warnings {
        tracing::warn!("{}: {warning}", args.output.display());
    }
    tracing::info!(
        "{}: {} points, {} bytes",
        args.output.display(),
        report.points,
        report.bytes
    );
    Ok(ExitCode::SUCCESS)
}
