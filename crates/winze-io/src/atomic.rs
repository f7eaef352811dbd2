//! Files that appear whole or not at all.
//!
//! What is written goes into a temporary file beside the target, which takes the target's name once
//! everything is on the disk. Whoever reads the target meanwhile, or finds it after a crash, sees
//! the old content or the new, never half of it.
//!
//! A program that is told to stop should call [`remove_pending`] on its way out: the temporary
//! files of writes under way are then deleted.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::error::{Error, Result};

/// Temporary files of writes that are under way, in the whole process.
static PENDING: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Makes the names of temporary files differ within the process.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Writes the file `path` with `fill`, which gets a buffered writer.
///
/// A file that exists keeps its permissions, and a symbolic link keeps pointing where it points.
/// Where `path` is no regular file (`/dev/stdout`, a pipe), it is written straight to.
///
/// # Errors
/// Where the file cannot be created, where `fill` fails, where the disk is full. The target is
/// then as it was, and no temporary file is left.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let refused = |cause| Error::io(path, "be written", cause);
    match fs::metadata(path) {
        Ok(existing) if existing.is_dir() => Err(Error::Folder {
            file: path.display().to_string(),
        }),
        Ok(existing) if existing.is_file() => {
            // A link stays a link: the file it points to is replaced.
            let target = fs::canonicalize(path).map_err(refused)?;
            replace(&target, Some(existing.permissions()), fill).map_err(refused)
        }
        Ok(_) => straight(path, fill).map_err(refused),
        Err(_) => replace(path, None, fill).map_err(refused),
    }
}

/// Like [`write()`], with all content at hand.
///
/// # Errors
/// As [`write()`].
pub fn write_bytes(path: &Path, content: &[u8]) -> Result<()> {
    write(path, |w| w.write_all(content))
}

/// Deletes the temporary files of all writes under way. Those writes then fail. For a handler of
/// Ctrl-C, just before the process ends.
pub fn remove_pending() {
    for path in std::mem::take(&mut *pending()) {
        // Nothing is left to be done about a file that will not go.
        let _ = fs::remove_file(path);
    }
}

fn pending() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    PENDING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A temporary file that is deleted when dropped, unless it was renamed before.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        if pending().remove(&self.0) {
            let _ = fs::remove_file(&self.0);
        }
    }
}

fn replace(
    target: &Path,
    permissions: Option<fs::Permissions>,
    fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> io::Result<()> {
    let (temporary, file) = create_beside(target)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    fill(&mut writer)?;
    let file = writer
        .into_inner()
        .map_err(io::IntoInnerError::into_error)?;
    if let Some(permissions) = permissions {
        file.set_permissions(permissions)?;
    }
    file.sync_all()?;
    drop(file);
    let mut pending = pending();
    fs::rename(&temporary.0, target)?;
    pending.remove(&temporary.0);
    Ok(())
}

fn straight(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let file = OpenOptions::new().write(true).open(path)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    fill(&mut writer)?;
    writer.flush()
}

/// Creates and registers a temporary file in the target's folder, so that renaming it never
/// crosses file systems.
fn create_beside(target: &Path) -> io::Result<(Temporary, File)> {
    let name = target.file_name().ok_or_else(|| {
        io::Error::new(
            io::ErrorKind::InvalidInput,
            "the path does not end in a file name",
        )
    })?;
    // Room for the suffix, where the name is about as long as a file system allows.
    let name: String = name.to_string_lossy().chars().take(50).collect();
    loop {
        let number = COUNTER.fetch_add(1, Ordering::Relaxed);
        let id = std::process::id();
        let mut temporary = OsString::from(".");
        temporary.push(&name);
        temporary.push(format!(".winze-tmp-{id}-{number}"));
        let path = target.with_file_name(temporary);
        // Locked until it is registered, so that an interrupt in between leaves nothing behind.
        let mut pending = pending();
        match File::create_new(&path) {
            Ok(file) => {
                pending.insert(path.clone());
                return Ok((Temporary(path), file));
            }
            // Left behind by a process of the same number that was killed.
            Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [`remove_pending`] is for the whole process, so these tests take turns.
    static TURN: Mutex<()> = Mutex::new(());

    fn turn() -> MutexGuard<'static, ()> {
        TURN.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn a_file_is_created_and_replaced() {
        let _turn = turn();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes(&path, b"one").unwrap();
        write(&path, |w| {
            assert_eq!(
                fs::read(&path)?,
                b"one",
                "the old content stays until the end"
            );
            w.write_all(b"two")
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_no_other() {
        let _turn = turn();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes(&path, b"one").unwrap();
        let failed = write(&path, |w| {
            w.write_all(b"half")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert!(failed.unwrap_err().to_string().contains("disk is full"));
        assert_eq!(fs::read(&path).unwrap(), b"one");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn pending_files_can_be_removed_from_outside() {
        let _turn = turn();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let interrupted = write(&path, |w| {
            w.write_all(b"half")?;
            assert!(names(folder.path())[0].starts_with(".a.txt.winze-tmp-"));
            remove_pending();
            Ok(())
        });
        assert!(interrupted.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn folders_and_missing_folders_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let error = write_bytes(folder.path(), b"").unwrap_err().to_string();
        assert!(error.contains("is a folder"), "{error}");
        let error = write_bytes(&folder.path().join("no/such.txt"), b"")
            .unwrap_err()
            .to_string();
        assert!(error.contains("its folder does not exist"), "{error}");
        let long = folder.path().join("n".repeat(250));
        let _turn = turn();
        write_bytes(&long, b"1").unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn links_permissions_and_devices_stay_what_they_are() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let _turn = turn();
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("a.txt"), folder.path().join("link"));
        write_bytes(&file, b"one").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        symlink(&file, &link).unwrap();
        write_bytes(&link, b"two").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"two");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(
            fs::metadata(&file).unwrap().permissions().mode() & 0o777,
            0o640
        );
        write_bytes(Path::new("/dev/null"), b"gone").unwrap();
        assert!(fs::metadata("/dev/null").unwrap().permissions().mode() & 0o222 != 0);
    }
}
