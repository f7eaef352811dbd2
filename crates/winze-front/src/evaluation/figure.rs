//! Pictures of cases, before and after.

use std::path::Path;

use winze::Outcome;
use winze_io::{CloudFile, atomic};

use super::cases::Case;
use crate::Prior;

/// Draws an outcome into `folder`.
pub(super) fn draw(
    folder: &Path,
    case: &Case,
    map: &Prior,
    query: &CloudFile,
    outcome: &Outcome,
) -> anyhow::Result<()> {
    let png = winze_report::before_and_after(map.picture()?.as_ref(), &query.cloud, outcome)?;
    Ok(atomic::write_bytes(
        &folder.join(figure_name(&case.name)),
        &png,
    )?)
}

/// The file of a case's picture.
#[must_use]
pub fn figure_name(case: &str) -> String {
    case.replace(['/', '\\', ':'], "_") + ".png"
}
