//! Folders to write in, which may hold somebody's own files.

use std::path::Path;

use anyhow::{Context as _, bail};

/// Makes a folder to write in. One that holds files is refused, unless a file `sign` in it says that it is
/// `ours` to write over.
///
/// # Errors
/// Where it holds somebody else's files, or cannot be made or read.
pub fn claim_folder(out: &Path, sign: &str, ours: impl Fn(&str) -> bool) -> anyhow::Result<()> {
    let at = out.display();
    std::fs::create_dir_all(out).with_context(|| format!("{at}: cannot be made"))?;
    let empty = std::fs::read_dir(out)
        .with_context(|| format!("{at}: cannot be read"))?
        .next()
        .is_none();
    let ours = std::fs::read_to_string(out.join(sign)).is_ok_and(|t| ours(&t));
    if !empty && !ours {
        bail!("{at}: holds other files; give --out a folder that is new or empty");
    }
    Ok(())
}
