//! The one error type of this crate.
//!
//! A message is one line and says what is wrong, where (file and section), and how to mend it.

use std::io;
use std::path::Path;

/// What can go wrong with a prepared map.
///
/// Each message is complete in itself, its cause included, so none has a
/// [`source`](std::error::Error::source).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The system refused to open, read, map or write a file.
    #[error("{0}")]
    Io(winze_io::Error),

    /// The library refused points or options.
    #[error("{0}")]
    Winze(winze::Error),

    /// Not a prepared map at all.
    #[error("{file}: is no prepared map ({problem}); make one from a cloud with `winze map build`")]
    NotAMap {
        /// The file, as given.
        file: String,
        /// What it is instead, or what it lacks.
        problem: String,
    },

    /// Made by a winze to come.
    #[error(
        "{file}: has format version {version}, this winze reads up to {known}; update winze, or \
         build the map again from its cloud with `winze map build`"
    )]
    Newer {
        /// The file, as given.
        file: String,
        /// Its format version.
        version: u32,
        /// The newest version that can be read.
        known: u32,
    },

    /// Made by a winze that is too old.
    #[error(
        "{file}: has format version {version}, which is no longer read (the oldest is {known}); \
         build the map again from its cloud with `winze map build`"
    )]
    Older {
        /// The file, as given.
        file: String,
        /// Its format version.
        version: u32,
        /// The oldest version that can be read.
        known: u32,
    },

    /// Made on a machine that stores numbers the other way round.
    #[error(
        "{file}: was made on a machine of the other byte order; build the map again on this kind \
         of machine with `winze map build`"
    )]
    ByteOrder {
        /// The file, as given.
        file: String,
    },

    /// The file does not end where it should.
    #[error(
        "{file}: {problem}; copy the file again, or build the map again from its cloud with \
         `winze map build`"
    )]
    CutShort {
        /// The file, as given.
        file: String,
        /// What was expected and what is there.
        problem: String,
    },

    /// Bytes are not those that were written.
    #[error(
        "{file}: {section}: damaged, its checksum does not match; copy the file again, or build \
         the map again from its cloud with `winze map build`"
    )]
    Damaged {
        /// The file, as given.
        file: String,
        /// Which part, or parts.
        section: String,
    },

    /// The checksums match, but what is there breaks the rules of the format.
    #[error(
        "{file}: {place}: {problem}; build the map again from its cloud with `winze map build`"
    )]
    Malformed {
        /// The file, as given.
        file: String,
        /// The section, or the part of the container, and the offset where there is one.
        place: String,
        /// What is wrong.
        problem: String,
    },

    /// Something that was asked for is not in the file.
    #[error(
        "{file}: has no section {section}; build the map again from its cloud with \
         `winze map build`"
    )]
    MissingSection {
        /// The file, as given.
        file: String,
        /// What was asked for.
        section: String,
    },

    /// The file is there already.
    #[error("{file}: exists; give --force to replace it, or name another file")]
    Exists {
        /// The file, as given.
        file: String,
    },

    /// Too little to make a map of.
    #[error(
        "{file}: usable points, no two of them at one place: {points}, at least {least} are needed; check the cloud"
    )]
    TooFew {
        /// The clouds, as given.
        file: String,
        /// Points found, 1 where they all coincide.
        points: u64,
        /// How many are needed.
        least: u64,
    },

    /// Smaller than what a descriptor describes.
    #[error(
        "{file}: is {size:.3} m across, smaller than the {radius:.3} m around a point that a descriptor describes; \
         give a larger cloud, or set a smaller scale.voxel"
    )]
    TooSmall {
        /// The clouds, as given.
        file: String,
        /// Its largest extent, metres.
        size: f64,
        /// Radius of a descriptor at the finest level, metres.
        radius: f64,
    },

    /// The map's file cannot be written.
    #[error("{0}")]
    Write(io::Error),

    /// There is no room for a column of numbers while a map is made.
    #[error("{folder}: no scratch file of {bytes} bytes: {}", scratch_hint(.cause))]
    Scratch {
        /// The folder for scratch files.
        folder: String,
        /// How large the file was to be, or had become.
        bytes: u64,
        /// What the system said.
        cause: io::Error,
    },
}

/// A result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// The system's refusal to do something (such as `be read`) to a file, in the words of
    /// `winze-io`.
    pub(crate) fn io(path: &Path, action: &'static str, cause: io::Error) -> Self {
        Self::Io(winze_io::Error::Io {
            file: path.display().to_string(),
            action,
            cause,
        })
    }
}

impl Error {
    /// For code that reads clouds to pass on; `Error::from` unwraps it again.
    pub(crate) fn into_read(self) -> winze_io::Error {
        winze_io::Error::Io {
            file: String::new(),
            action: "be read",
            cause: self.into(),
        }
    }
}

impl From<winze::Error> for Error {
    fn from(cause: winze::Error) -> Self {
        Self::Winze(cause)
    }
}

/// Unwraps what [`io::Error::from`] has wrapped.
impl From<winze_io::Error> for Error {
    fn from(error: winze_io::Error) -> Self {
        match error {
            winze_io::Error::Io {
                file,
                action,
                cause,
            } => match cause.downcast::<Self>() {
                Ok(own) => own,
                Err(cause) => Self::Io(winze_io::Error::Io {
                    file,
                    action,
                    cause,
                }),
            },
            error => Self::Io(error),
        }
    }
}

/// Lets `?` carry this crate's errors through code that only knows those of the system.
impl From<Error> for io::Error {
    fn from(error: Error) -> Self {
        match error {
            // As the system gave it.
            Error::Write(cause) => cause,
            error => Self::other(error),
        }
    }
}

/// The usual causes in words, with a remedy.
fn scratch_hint(cause: &io::Error) -> String {
    let reason = match cause.kind() {
        io::ErrorKind::NotFound => "there is no such folder; create it".into(),
        io::ErrorKind::NotADirectory => "it is no folder".into(),
        io::ErrorKind::PermissionDenied => "permission denied; check who may write there".into(),
        io::ErrorKind::ReadOnlyFilesystem => "it is read-only".into(),
        io::ErrorKind::StorageFull => "the disk is full; make room".into(),
        io::ErrorKind::QuotaExceeded => "the quota is used up; make room".into(),
        _ => cause.to_string(),
    };
    format!("{reason}, or name another folder for scratch files")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_and_name_file_place_and_remedy() {
        let error = Error::Damaged {
            file: "mine.wmap".into(),
            section: "section PNTS 2".into(),
        };
        assert_eq!(
            error.to_string(),
            "mine.wmap: section PNTS 2: damaged, its checksum does not match; copy the file again, \
             or build the map again from its cloud with `winze map build`"
        );
        let error = Error::Scratch {
            folder: "/scratch".into(),
            bytes: 12,
            cause: io::ErrorKind::StorageFull.into(),
        };
        assert_eq!(
            error.to_string(),
            "/scratch: no scratch file of 12 bytes: the disk is full; make room, or name another \
             folder for scratch files"
        );
    }

    #[test]
    fn an_error_comes_out_of_an_atomic_write_as_it_went_in() {
        let folder = tempfile::tempdir().unwrap();
        let failed = winze_io::atomic::write(&folder.path().join("a"), |_| {
            Err(Error::ByteOrder { file: "b".into() }.into())
        });
        assert!(matches!(
            Error::from(failed.unwrap_err()),
            Error::ByteOrder { file } if file == "b"
        ));
        let failed = winze_io::atomic::write(&folder.path().join("a"), |_| {
            Err(io::ErrorKind::StorageFull.into())
        });
        let told = Error::from(failed.unwrap_err()).to_string();
        assert!(told.ends_with("a: cannot be written: the disk is full; make room"));
    }
}
