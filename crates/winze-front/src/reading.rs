//! Cloud files read, and what their reader had to say.

use std::path::Path;

use winze_io::{CloudFile, ReadOptions, read_bytes, read_cloud_as};

/// Reads a cloud and tells `tracing` what its reader had to say.
///
/// # Errors
/// A [`winze_io::Error`] where the file cannot be read or holds no cloud.
pub fn read(path: &Path) -> anyhow::Result<CloudFile> {
    read_as(path, &read_bytes(path)?)
}

/// The same of its bytes; `path` is for messages and says the format.
///
/// # Errors
/// As [`read`].
pub fn read_as(path: &Path, bytes: &[u8]) -> anyhow::Result<CloudFile> {
    let file = read_cloud_as(path, bytes, &ReadOptions::default())?;
    let r = &file.report;
    tracing::info!(
        "{}: {} {}, {} points, {} not finite, {} no-returns",
        path.display(),
        r.format,
        r.encoding,
        r.points_in_file,
        r.non_finite,
        r.no_returns
    );
    if r.non_finite > 0 {
        tracing::warn!(
            "{}: {} of {} points are not finite and were dropped",
            path.display(),
            r.non_finite,
            r.points_in_file
        );
    }
    for warning in &r.warnings {
        tracing::warn!("{}: {warning}", path.display());
    }
    Ok(file)
}
