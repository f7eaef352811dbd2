//! `winze convert`: from one format to another.

use std::process::ExitCode;

use winze_front::reading::read;
use winze_io::{Format, WriteOptions, write_cloud};

use crate::args::{Convert, Global};
use crate::output::check_outputs;
use crate::progress::Progress;

pub(crate) fn run(args: &Convert, global: &Global) -> anyhow::Result<ExitCode> {
    Format::for_writing(&args.output)?;
    check_outputs(&[&args.output], &[&args.input])?;
    let progress = Progress::new(global.quiet, 2);
    progress.say("read");
    let file = read(&args.input)?;
    let lost = file.report.unread_fields();
    if !lost.is_empty() {
        tracing::warn!(
            "{}: coordinates and intensity are kept, these fields are not: {}",
            args.output.display(),
            lost.join(", ")
        );
    }
    progress.say("write");
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
