//! The two streams: data on stdout, talk on stderr. And where files may be written.

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use crate::progress::BesideTheBar;

/// Writes data to stdout.
pub(crate) fn print(text: &str) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())
        .and_then(|()| out.flush())
        .context("stdout: cannot be written")
}

/// Writes talk to stderr; if that fails there is nobody left to tell.
pub(crate) fn talk(text: &str) {
    let _ = BesideTheBar.write_all(text.as_bytes());
}

/// An error in one line, causes after it.
pub(crate) fn complain(e: &anyhow::Error) {
    let message = format!("{e:#}").replace('\n', " ");
    talk(&format!("winze: error: {message}\n"));
}

/// Whoever read our stdout has gone; that is no fault of the run.
pub(crate) fn is_broken_pipe(e: &anyhow::Error) -> bool {
    e.chain()
        .filter_map(|c| c.downcast_ref::<io::Error>())
        .any(|c| c.kind() == io::ErrorKind::BrokenPipe)
}

/// Refuses at once what could not be written in the end, and what would overwrite an input or
/// another output.
pub(crate) fn check_outputs(outputs: &[&Path], inputs: &[&Path]) -> anyhow::Result<()> {
    let mut taken: Vec<(PathBuf, &Path)> = inputs.iter().map(|p| (identity(p), *p)).collect();
    for path in outputs {
        let at = path.display();
        if path.is_dir() {
            bail!("{at}: is a folder; name a file in it");
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
        if folder.is_some_and(|f| !f.is_dir()) {
            bail!("{at}: cannot be written: its folder does not exist; create it first");
        }
        let own = identity(path);
        if let Some((_, other)) = taken.iter().find(|(t, _)| *t == own) {
            bail!(
                "{at}: would overwrite {}; choose another name",
                other.display()
            );
        }
        // Several outputs may go down one pipe or into nothing.
        if path.is_file() || !path.exists() {
            taken.push((own, path));
        }
    }
    Ok(())
}

/// One name for a file however it is written, also where it does not exist yet.
fn identity(path: &Path) -> PathBuf {
    if let Ok(real) = path.canonicalize() {
        return real;
    }
    let folder = path
        .parent()
        .filter(|p| !p.as_os_str().is_empty())
        .unwrap_or_else(|| Path::new("."));
    match (folder.canonicalize(), path.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => path.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_and_other_outputs_are_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("map.pcd"), "x").unwrap();
        let (map, new) = (at("map.pcd"), at("new.ply"));
        let again = folder.path().join(".").join("map.pcd");
        assert!(check_outputs(&[&new], &[&map]).is_ok());
        for outputs in [
            &[again.as_path()][..],
            &[new.as_path(), new.as_path()],
            &[folder.path()],
            &[at("no").join("x.ply").as_path()],
        ] {
            assert!(check_outputs(outputs, &[&map]).is_err(), "{outputs:?}");
        }
        #[cfg(unix)]
        {
            let null = Path::new("/dev/null");
            assert!(check_outputs(&[null, null], &[&map]).is_ok());
        }
    }
}
