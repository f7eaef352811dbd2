//! Prepared maps for winze: everything that is done once for a prior map, in one file.
//!
//! The file is mapped into memory, so that opening it takes milliseconds whatever its size, and is
//! replaced as a whole or not at all. `docs/map-format.md` gives its layout byte by byte.
//!
//! * [`build`] makes a map of clouds, in bounded memory; [`Map`] opens it, and is what
//!   [`winze::KeptMap::prepared`] asks.
//! * [`container`]: named sections in a file, checked; it knows nothing of what they mean.
//! * [`Scratch`]: long columns kept in a folder instead of memory while a map is made.
//!
//! Files are data from outside: whatever they hold, opening them gives a map or an [`Error`] that
//! says where the file is wrong, and never panics.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

mod build;
pub mod container;
mod error;
mod map;
mod mapping;
mod meta;
mod scratch;
mod sections;
mod settings;

pub use build::{BuildOptions, Progress, build};
pub use container::is_map;
pub use error::{Error, Result};
pub use map::Map;
pub use meta::{LevelMeta, Measured, Meta, SourceMeta};
pub use scratch::{Column, Scratch, ScratchWriter};
