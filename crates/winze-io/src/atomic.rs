//! Files that appear whole or not at all.
//!
//! What is written goes into a temporary file beside the target, which takes the target's name once
//! everything is on the disk. Whoever reads the target meanwhile, or finds it after a crash, sees
//! the old content or the new, never half of it.
//!
//! A program that is told to stop should call [`remove_pending`] on its way out: the temporary
//! files of writes under way are then deleted, and none comes after them.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};

use crate::error::{Error, Result};

/// The writes of the whole process.
static WRITES: Writes = Writes::new();

/// Makes the names of temporary files differ within the process.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// A path is followed through this many symbolic links, as on Linux.
const MOST_LINKS: usize = 40;

/// Writes the file `path` with `fill`, which gets a buffered writer.
///
/// A file that exists keeps its permissions; a read-only one is left alone. A symbolic link keeps
/// pointing where it points, and what is written goes there, whether or not there is a file yet.
/// What is no regular file (a pipe, a terminal) or open already (`/dev/stdout`) cannot be replaced:
/// it is written straight to, behind what it holds.
///
/// # Errors
/// Where the file is read-only or cannot be created, where `fill` fails, where the disk is full. The
/// target is then as it was, unless written straight to, and no temporary file is left.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    WRITES.write(path, fill)
}

/// Like [`write()`], with all content at hand.
///
/// # Errors
/// As [`write()`].
pub fn write_bytes(path: &Path, content: &[u8]) -> Result<()> {
    write(path, |w| w.write_all(content))
}

/// Deletes the temporary files beside `path` that were left there when processes that wrote to it were killed. Writes
/// under way, here or elsewhere, are not disturbed: they hold locks on theirs.
///
/// Does nothing where files cannot be locked, nor on Windows.
pub fn remove_abandoned(path: &Path) {
    let Ok(Target::Name(target)) = follow(path) else {
        return;
    };
    let folder = target.parent().filter(|f| !f.as_os_str().is_empty());
    let (Some(prefix), Ok(entries)) = (
        temporary_prefix(&target),
        fs::read_dir(folder.unwrap_or(Path::new("."))),
    ) else {
        return;
    };
    let numbers = |rest: &str| rest.chars().all(|c| c.is_ascii_digit() || c == '-');
    for entry in entries.flatten() {
        let name = entry.file_name();
        let rest = name.to_str().and_then(|n| n.strip_prefix(&prefix));
        if cfg!(unix)
            && rest.is_some_and(numbers)
            && entry.file_type().is_ok_and(|t| t.is_file())
            && let Ok(file) = OpenOptions::new().write(true).open(entry.path())
            && file.try_lock().is_ok()
        {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// What the names of temporary files for `target` begin with.
fn temporary_prefix(target: &Path) -> Option<String> {
    // Room for the suffix, where the name is about as long as a file system allows.
    let name: String = target
        .file_name()?
        .to_string_lossy()
        .chars()
        .take(50)
        .collect();
    Some(format!(".{name}.winze-tmp-"))
}

/// Deletes the temporary files of all writes under way. From then on no write of this process
/// begins or ends: threads that get there wait until the process is gone. For a handler of Ctrl-C,
/// which has to end the process right after.
pub fn remove_pending() {
    WRITES.stop();
}

/// Writes that are under way, by their temporary files.
struct Writes {
    /// Locked while a temporary file is made or renamed, and for good once stopped.
    pending: Mutex<BTreeSet<PathBuf>>,
    stopped: Once,
}

/// A temporary file that is deleted when dropped, unless it was renamed before.
struct Temporary<'a> {
    path: PathBuf,
    writes: &'a Writes,
}

impl Drop for Temporary<'_> {
    fn drop(&mut self) {
        if self.writes.pending().remove(&self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

impl Writes {
    const fn new() -> Self {
        Self {
            pending: Mutex::new(BTreeSet::new()),
            stopped: Once::new(),
        }
    }

    fn pending(&self) -> MutexGuard<'_, BTreeSet<PathBuf>> {
        self.pending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Deletes all temporary files and stays locked: a writer that went on could make another one,
    /// or report that its own is gone, before the process ends.
    fn stop(&self) {
        self.stopped.call_once(|| {
            let mut pending = self.pending();
            for path in std::mem::take(&mut *pending) {
                // Nothing is left to be done about a file that will not go.
                let _ = fs::remove_file(path);
            }
            std::mem::forget(pending);
        });
    }

    fn write(
        &self,
        path: &Path,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<()> {
        let refused = |cause| Error::io(path, "be written", cause);
        let file = || path.display().to_string();
        let existing = fs::metadata(path).ok();
        if let Some(existing) = &existing {
            if existing.is_dir() {
                return Err(Error::Folder { file: file() });
            }
            if existing.is_file() && existing.permissions().readonly() {
                return Err(Error::ReadOnly { file: file() });
            }
        }
        let regular = existing.as_ref().is_none_or(fs::Metadata::is_file);
        match follow(path).map_err(refused)? {
            Target::Name(name) if regular => {
                let permissions = existing.map(|e| e.permissions());
                self.replace(&name, permissions, fill).map_err(refused)
            }
            _ => straight(path, fill).map_err(refused),
        }
    }

    fn replace(
        &self,
        target: &Path,
        permissions: Option<fs::Permissions>,
        fill: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<()> {
        let (temporary, file) = self.create_beside(target)?;
        let mut writer = BufWriter::with_capacity(1 << 16, file);
        fill(&mut writer)?;
        let file = writer
            .into_inner()
            .map_err(io::IntoInnerError::into_error)?;
        if let Some(permissions) = permissions {
            file.set_permissions(permissions)?;
        }
        file.sync_all()?;
        // Locked until it has its name; Windows does not rename what is open.
        let _held = cfg!(unix).then_some(file);
        // Unlocked before `temporary` is dropped, which locks again.
        let mut pending = self.pending();
        fs::rename(&temporary.path, target)?;
        pending.remove(&temporary.path);
        Ok(())
    }

    /// Creates and registers a temporary file in the target's folder, so that renaming it never
    /// crosses file systems.
    fn create_beside(&self, target: &Path) -> io::Result<(Temporary<'_>, File)> {
        let prefix = temporary_prefix(target).ok_or_else(|| {
            io::Error::new(
                io::ErrorKind::InvalidInput,
                "the path does not end in a file name",
            )
        })?;
        loop {
            let number = COUNTER.fetch_add(1, Ordering::Relaxed);
            let id = std::process::id();
            let path = target.with_file_name(format!("{prefix}{id}-{number}"));
            // Locked until it is registered, so that an interrupt in between leaves nothing behind.
            let mut pending = self.pending();
            match File::create_new(&path) {
                // Somebody was quicker to lock it, and deletes it for a leftover.
                Ok(file) if !lock(&file, &path) => {}
                Ok(file) => {
                    pending.insert(path.clone());
                    return Ok((Temporary { path, writes: self }, file));
                }
                // Left behind by a process of the same number that was killed.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
    }
}

/// Locks a temporary file that was just made, for as long as it is open, where that can be done. Whether it is still
/// there.
fn lock(file: &File, path: &Path) -> bool {
    if !cfg!(unix) {
        return true;
    }
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => false,
        _ => path.exists(),
    }
}

/// What a path leads to.
#[derive(Debug, PartialEq, Eq)]
enum Target {
    /// This name, which is no link, whether or not a file has it yet.
    Name(PathBuf),
    /// A file that some process has open; giving its name to another would not change that.
    Open,
}

/// Follows symbolic links for as long as there are any.
fn follow(path: &Path) -> io::Result<Target> {
    let mut path = path.to_owned();
    for _ in 0..=MOST_LINKS {
        let Ok(next) = fs::read_link(&path) else {
            return Ok(Target::Name(path));
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        // `/dev/stdout` and `/dev/fd/1` lead here on Linux.
        if folder
            .canonicalize()
            .is_ok_and(|folder| folder.starts_with("/proc"))
        {
            return Ok(Target::Open);
        }
        path = folder.join(next);
    }
    Err(io::Error::other(
        "its symbolic links lead in a circle; name the file itself",
    ))
}

fn straight(path: &Path, fill: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let file = OpenOptions::new().append(true).open(path)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    fill(&mut writer)?;
    writer.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::time::Duration;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    #[test]
    fn a_file_is_created_and_replaced() {
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
        // Where the new file cannot take its name, the next write is none the worse.
        let taken = folder.path().join("b");
        write(&taken, |_| fs::create_dir(&taken)).unwrap_err();
        write_bytes(&path, b"two").unwrap();
        assert_eq!(names(folder.path()).len(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn what_a_killed_process_left_behind_is_deleted_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let others = [".b.txt.winze-tmp-1-2", "a.txt.winze-tmp-1-2"];
        let left = [".a.txt.winze-tmp-1-2", ".a.txt.winze-tmp-77-0"];
        for name in others.iter().chain(&left) {
            fs::write(folder.path().join(name), "half").unwrap();
        }
        fs::create_dir(folder.path().join(".a.txt.winze-tmp-5-5")).unwrap();
        write(&path, |w| {
            remove_abandoned(&path);
            let there = names(folder.path());
            assert!(left.iter().all(|l| !there.contains(&(*l).to_owned())));
            assert_eq!(there.len(), 4, "its own stays: {there:?}");
            w.write_all(b"new")
        })
        .unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        remove_abandoned(&folder.path().join("no/such"));
        remove_abandoned(Path::new("/"));
        assert_eq!(names(folder.path()).len(), 4);
    }

    #[test]
    fn once_stopped_no_write_begins_or_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "one").unwrap();
        // Never freed: the threads below wait for ever.
        let writes: &Writes = Box::leak(Box::new(Writes::new()));
        let (half, is_half) = mpsc::channel();
        let (resume, resumed) = mpsc::channel::<()>();
        let (ended, end) = mpsc::channel();
        let (first, second) = (path.clone(), folder.path().join("b.txt"));
        let first_ended = ended.clone();
        std::thread::spawn(move || {
            let outcome = writes.write(&first, |w| {
                w.write_all(b"half")?;
                half.send(()).unwrap();
                resumed.recv().unwrap();
                Ok(())
            });
            first_ended.send(outcome).unwrap();
        });
        is_half.recv().unwrap();
        let there = names(folder.path());
        assert!(there.iter().any(|n| n.starts_with(".a.txt.winze-tmp-")));
        writes.stop();
        writes.stop();
        assert_eq!(names(folder.path()), ["a.txt"]);
        resume.send(()).unwrap();
        std::thread::spawn(move || ended.send(writes.write(&second, |_| Ok(()))).unwrap());
        let nothing = end.recv_timeout(Duration::from_millis(300));
        assert!(nothing.is_err(), "{nothing:?}");
        assert_eq!(names(folder.path()), ["a.txt"]);
        assert_eq!(fs::read(&path).unwrap(), b"one");
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
        write_bytes(&long, b"1").unwrap();
    }

    #[test]
    fn a_read_only_file_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_bytes(&path, b"one").unwrap();
        let mut permissions = fs::metadata(&path).unwrap().permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).unwrap();
        let error = write_bytes(&path, b"two").unwrap_err().to_string();
        let told = "a.txt: is read-only; make it writable, or name another file";
        assert!(error.ends_with(told), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"one");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[cfg(unix)]
    #[test]
    fn links_and_permissions_stay_what_they_are() {
        use std::os::unix::fs::{PermissionsExt, symlink};
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
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_file_that_is_yet_to_come_is_followed() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let place = |name: &str| folder.path().join(name);
        fs::create_dir(place("deep")).unwrap();
        symlink("deep/second", place("first")).unwrap();
        symlink("../new.txt", place("deep/second")).unwrap();
        write_bytes(&place("first"), b"new").unwrap();
        assert_eq!(fs::read(place("new.txt")).unwrap(), b"new");
        for link in ["first", "deep/second"] {
            assert!(fs::symlink_metadata(place(link)).unwrap().is_symlink());
        }
        symlink("no/such.txt", place("lost")).unwrap();
        let error = write_bytes(&place("lost"), b"").unwrap_err().to_string();
        assert!(
            error.contains("lost: cannot be written: its folder does not exist"),
            "{error}"
        );
        symlink("round", place("round")).unwrap();
        let error = write_bytes(&place("round"), b"").unwrap_err().to_string();
        assert!(error.contains("links lead in a circle"), "{error}");
        assert!(fs::symlink_metadata(place("round")).unwrap().is_symlink());
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_devices_are_written_straight_to() {
        use std::os::unix::fs::FileTypeExt;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.unwrap().success());
        let reader = std::thread::spawn({
            let pipe = pipe.clone();
            move || fs::read(pipe).unwrap()
        });
        write_bytes(&pipe, b"through").unwrap();
        assert_eq!(reader.join().unwrap(), b"through");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
        assert_eq!(names(folder.path()), ["pipe"]);
        write_bytes(Path::new("/dev/null"), b"gone").unwrap();
        let null = fs::metadata("/dev/null").unwrap();
        assert!(null.file_type().is_char_device());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn files_open_already_are_written_straight_to() {
        use std::os::fd::AsRawFd;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.txt");
        let mut open = File::create(&path).unwrap();
        open.write_all(b"one ").unwrap();
        for fd in ["/proc/self/fd", "/dev/fd"] {
            let fd = Path::new(fd).join(open.as_raw_fd().to_string());
            write_bytes(&fd, b"two ").unwrap();
        }
        let mut held = String::new();
        let mut opened = File::open(format!("/proc/self/fd/{}", open.as_raw_fd())).unwrap();
        io::Read::read_to_string(&mut opened, &mut held).unwrap();
        assert_eq!(held, "one two two ");
        assert_eq!(fs::read(&path).unwrap(), held.as_bytes());
        assert_eq!(names(folder.path()), ["out.txt"]);
        let full = write_bytes(Path::new("/dev/full"), b"1").unwrap_err();
        assert!(full.to_string().contains("the disk is full"), "{full}");
    }
}
