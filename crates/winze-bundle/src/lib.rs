//! Incident bundles: one question, its answer, and as much of the map as it takes to ask again, in one file.
//!
//! A robot got lost, or got a strange answer. What it asked is in a [`Bundle`]: the query's file byte by byte, the settings, what was said
//! beforehand, the outcome, and the [part of the map](winze::part) that was looked at. Whoever gets it needs no map: [`Bundle::ask`]
//! answers as the robot was answered, to the bit.
//!
//! The file is a zip archive of JSON, TOML and NumPy arrays; `docs/bundle.md` describes it. It is data from outside: whatever it holds, reading it gives
//! a bundle or an [`Error`], never a panic, and nothing of it is written to disk. It takes memory in proportion to what the archive
//! unpacks to, which is at most a thousand times its size and 4 GiB.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

mod archive;
mod arrays;
mod bundle;
mod error;
mod manifest;
mod part;

pub use bundle::{Beforehand, Bundle, MapFile, QueryFile};
pub use error::{Error, Result};
