//! The one error type of this crate.
//!
//! A message is one line and says what is wrong, where (file, and byte or line), and how to mend it.

use std::fmt;
use std::io;
use std::path::Path;

/// Where in a file something is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The file as a whole.
    File,
    /// A line, counted from 1.
    Line(usize),
    /// A byte, counted from 0.
    Byte(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File => Ok(()),
            Self::Line(n) => write!(f, "line {n}: "),
            Self::Byte(n) => write!(f, "byte {n}: "),
        }
    }
}

/// What can go wrong between a file and a cloud.
///
/// Each message is complete in itself, its cause included, so none has a
/// [`source`](std::error::Error::source).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The system refused to open, read or write.
    #[error("{file}: cannot {action}: {}", hint(.cause, .action))]
    Io {
        /// The file, as given.
        file: String,
        /// What was tried, such as `be read`.
        action: &'static str,
        /// What the system said.
        cause: io::Error,
    },

    /// A folder where a file should be.
    #[error("{file}: is a folder; name a file")]
    Folder {
        /// The path, as given.
        file: String,
    },

    /// A file that is not to be changed where one should be written.
    #[error("{file}: is read-only; make it writable, or name another file")]
    ReadOnly {
        /// The path, as given.
        file: String,
    },

    /// Neither the name nor the content tells the format, or the format cannot be written.
    #[error("{file}: unknown format; known are {known}")]
    UnknownFormat {
        /// The file, as given.
        file: String,
        /// The extensions that would do.
        known: &'static str,
    },

    /// The format cannot be written in this encoding.
    #[error("{file}: {problem}")]
    Encoding {
        /// The file, as given.
        file: String,
        /// What does not go together, and what does.
        problem: String,
    },

    /// The content breaks the rules of its format.
    #[error("{file}: {place}{problem}")]
    Malformed {
        /// The file, as given.
        file: String,
        /// Where.
        place: Place,
        /// What is wrong and how to mend it.
        problem: String,
    },

    /// The file ends before what it announces.
    #[error("{file}: {place}{problem}; the file is cut short, copy it again")]
    Truncated {
        /// The file, as given.
        file: String,
        /// Where the claim stands, or where the data ends.
        place: Place,
        /// What was announced and what is there.
        problem: String,
    },

    /// A text file without a single point. (PCD and PLY files that announce no points give an
    /// empty cloud instead: they say that they are meant to be empty.)
    #[error("{file}: holds no points; a text cloud has one point a line, x y z")]
    Empty {
        /// The file, as given.
        file: String,
    },

    /// A file that is read several times was not the same each time.
    #[error("{file}: changed while it was read; wait until it is complete, then start again")]
    Changed {
        /// The file, as given.
        file: String,
    },

    /// The values were read, but make no cloud or no transform.
    #[error("{file}: {cause}")]
    Rejected {
        /// The file, as given.
        file: String,
        /// Why.
        cause: winze::Error,
    },
}

/// A result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn io(path: &Path, action: &'static str, cause: io::Error) -> Self {
        Self::Io {
            file: path.display().to_string(),
            action,
            cause,
        }
    }
}

/// The usual causes in words, with a remedy; all others as the system puts them.
fn hint(cause: &io::Error, action: &str) -> String {
    let reading = action.ends_with("read");
    match cause.kind() {
        io::ErrorKind::NotFound if reading => "no such file; check the path".into(),
        io::ErrorKind::NotFound => "its folder does not exist; create it first".into(),
        io::ErrorKind::PermissionDenied if reading => {
            "permission denied; check who may read it".into()
        }
        io::ErrorKind::PermissionDenied => {
            "permission denied; check who may write there, or choose another folder".into()
        }
        io::ErrorKind::StorageFull => "the disk is full; make room".into(),
        _ => cause.to_string(),
    }
}

/// What is wrong with some bytes, before anybody has said which file they come from.
#[derive(Debug)]
pub(crate) enum Fault {
    Malformed(Place, String),
    Truncated(Place, String),
    Empty,
    Rejected(winze::Error),
    Io(io::Error),
    /// The file is not the one that was looked at first.
    Changed,
    /// From whoever took the points: complete as it is.
    Passed(Box<Error>),
}

impl From<io::Error> for Fault {
    /// Lengths are checked before anything is read: a file that ends early became shorter.
    fn from(cause: io::Error) -> Self {
        if cause.kind() == io::ErrorKind::UnexpectedEof {
            Self::Changed
        } else {
            Self::Io(cause)
        }
    }
}

impl Fault {
    pub(crate) fn malformed(place: Place, problem: impl Into<String>) -> Self {
        Self::Malformed(place, problem.into())
    }

    pub(crate) fn truncated(place: Place, problem: impl Into<String>) -> Self {
        Self::Truncated(place, problem.into())
    }

    /// The error a user sees.
    pub(crate) fn of(self, file: &str) -> Error {
        let file = file.to_owned();
        match self {
            Self::Malformed(place, problem) => Error::Malformed {
                file,
                place,
                problem,
            },
            Self::Truncated(place, problem) => Error::Truncated {
                file,
                place,
                problem,
            },
            Self::Empty => Error::Empty { file },
            Self::Rejected(cause) => Error::Rejected { file, cause },
            Self::Io(cause) => Error::Io {
                file,
                action: "be read",
                cause,
            },
            Self::Changed => Error::Changed { file },
            Self::Passed(error) => *error,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_are_one_line_and_name_file_place_and_remedy() {
        let text = Fault::truncated(
            Place::Line(9),
            "POINTS says 4000 but the file holds 120 points",
        )
        .of("map.pcd")
        .to_string();
        assert_eq!(
            text,
            "map.pcd: line 9: POINTS says 4000 but the file holds 120 points; \
             the file is cut short, copy it again"
        );
        let missing = Error::io(
            Path::new("a.pcd"),
            "be read",
            io::ErrorKind::NotFound.into(),
        );
        assert_eq!(
            missing.to_string(),
            "a.pcd: cannot be read: no such file; check the path"
        );
    }
}
