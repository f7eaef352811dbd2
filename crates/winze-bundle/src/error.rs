//! The one error type of this crate.
//!
//! A message is one line and says what is wrong, where (file and entry), and how to mend it.

/// What can go wrong with a bundle.
///
/// Each message is complete in itself, its cause included, so none has a
/// [`source`](std::error::Error::source).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The system refused to open, read or write a file, or the query in the bundle cannot be read.
    #[error("{0}")]
    Io(#[from] winze_io::Error),

    /// The library refused the question.
    #[error("{0}")]
    Winze(#[from] winze::Error),

    /// Not a bundle at all.
    #[error("{file}: is no bundle ({problem}); `winze locate --bundle FILE.zip` makes one")]
    NotABundle {
        /// The file, as given.
        file: String,
        /// What it lacks.
        problem: String,
    },

    /// Made by a winze to come.
    #[error(
        "{file}: has format version {version}, this winze reads version {known}; update winze (it was made by {winze})"
    )]
    Newer {
        /// The file, as given.
        file: String,
        /// Its format version.
        version: u32,
        /// The version that can be read.
        known: u32,
        /// The version of winze that made it.
        winze: String,
    },

    /// Something in it is not as it was written, or breaks the rules.
    #[error("{file}: {entry}: {problem}; get the bundle anew from whoever made it")]
    Damaged {
        /// The file, as given.
        file: String,
        /// The entry of the archive.
        entry: String,
        /// What is wrong with it.
        problem: String,
    },

    /// It cannot be put together.
    #[error("the bundle cannot be made: {0}")]
    Unwritable(String),
}

/// A result with this crate's [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// What is wrong with an entry, before anybody has said which file it is in.
#[derive(Debug)]
pub(crate) struct Fault {
    pub(crate) entry: String,
    pub(crate) problem: String,
}

impl Fault {
    pub(crate) fn new(entry: &str, problem: impl std::fmt::Display) -> Self {
        Self {
            entry: shown(entry),
            problem: shown(&problem.to_string()),
        }
    }

    pub(crate) fn of(self, file: &str) -> Error {
        Error::Damaged {
            file: file.into(),
            entry: self.entry,
            problem: self.problem,
        }
    }
}

/// The beginning of a text as it may stand on a terminal: parsers' messages may span lines, and both may quote what was found.
pub(crate) fn shown(text: &str) -> String {
    let clean = |c: char| if c.is_control() { ' ' } else { c };
    text.chars().map(clean).take(300).collect()
}
