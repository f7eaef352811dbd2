//! What a built map says of itself, for programs.

use std::path::Path;

use serde::Serialize;
use winze_map::{Map, Meta};

/// Facts about a built map.
#[derive(Debug, Clone, Serialize)]
pub struct Facts<'a> {
    /// Its file, as it was named.
    pub path: String,
    /// Length of that, bytes.
    pub bytes: u64,
    /// Digest of its contents.
    pub digest: String,
    /// What it was made of, and with what; among the other fields where it is written down.
    #[serde(flatten)]
    pub meta: &'a Meta,
    /// Its parts in the order of the file.
    pub sections: Vec<Section>,
}

/// A part of a built map's file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Section {
    /// Four letters that say what it is.
    pub tag: String,
    /// Which of those with that tag.
    pub number: u32,
    /// Length, bytes.
    pub bytes: u64,
    /// Whether this version of winze has a use for it.
    pub known: bool,
}

impl<'a> Facts<'a> {
    /// Of a map that was opened from `path`.
    #[must_use]
    pub fn of(path: &Path, map: &'a Map) -> Self {
        let unknown: Vec<_> = map.unknown_sections().map(|e| e.id).collect();
        Self {
            path: path.display().to_string(),
            bytes: map.length(),
            digest: map.digest(),
            meta: map.meta(),
            sections: map
                .sections()
                .map(|e| Section {
                    tag: e.id.tag.escape_ascii().to_string(),
                    number: e.id.number,
                    bytes: e.length,
                    known: !unknown.contains(&e.id),
                })
                .collect(),
        }
    }
}
