//! What can go wrong in a simulation.

use std::path::PathBuf;

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// What can go wrong in a simulation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh has more parts, vertices or triangles than can be counted.
    #[error("the mesh has too many {what}; split it or make it coarser")]
    TooLarge {
        /// What there is too much of.
        what: &'static str,
    },
    /// A mesh without a triangle that could be hit.
    #[error(
        "the mesh has no triangle that could be hit ({broken} broken, {degenerate} without area)"
    )]
    EmptyMesh {
        /// Triangles with a corner that is not finite or does not exist.
        broken: usize,
        /// Triangles without area.
        degenerate: usize,
    },
    /// A mesh file that cannot be read.
    #[error("{}: {why}", path.display())]
    MeshFile {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, where, and how to mend it.
        why: String,
    },
    /// There is no room for a robot.
    #[error("{0}")]
    NoFreeSpace(String),
    /// A setting outside its domain.
    #[error("{key}: {why}")]
    Setting {
        /// Its place in the scenario.
        key: String,
        /// What is wrong with it.
        why: String,
    },
    /// A scenario that cannot be read.
    #[error("{place}: {why}")]
    Scenario {
        /// The file, or the name of a built-in one.
        place: String,
        /// What is wrong with it and where.
        why: String,
    },
    /// The library refused.
    #[error(transparent)]
    Winze(#[from] winze::Error),
}

impl Error {
    /// The same, with the place in a scenario that it comes from.
    pub(crate) fn at(self, place: &str) -> Self {
        match self {
            Self::Setting { key, why } => Self::Setting {
                key: format!("{place}: {key}"),
                why,
            },
            Self::NoFreeSpace(why) => Self::NoFreeSpace(format!("{place}: {why}")),
            other => other,
        }
    }
}

/// Refuses a number outside its domain, NaN included.
pub(crate) fn within(key: &str, value: f64, low: f64, high: f64) -> Result<()> {
    if value >= low && value <= high {
        return Ok(());
    }
    Err(Error::Setting {
        key: key.into(),
        why: format!("must lie between {low} and {high}, is {value}"),
    })
}
