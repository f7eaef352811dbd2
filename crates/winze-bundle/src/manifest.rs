//! The entry that tells what the others are, and what was asked.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use winze::Pose;
use winze::locate::Near;

use crate::bundle::{Beforehand, MapFile};
use crate::error::Fault;

/// Its name.
pub(crate) const NAME: &str = "manifest.json";

/// The version of the format.
pub(crate) const FORMAT: u32 = 1;

/// What is read first, whatever the version.
#[derive(Debug, Deserialize)]
pub(crate) struct Version {
    pub(crate) format: u32,
    pub(crate) winze: String,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Manifest {
    pub(crate) format: u32,
    /// The version of winze that made it.
    pub(crate) winze: String,
    pub(crate) query: QueryRow,
    pub(crate) map: MapRow,
    pub(crate) request: RequestRow,
    /// All other entries.
    pub(crate) entries: BTreeMap<String, EntryRow>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct EntryRow {
    pub(crate) bytes: u64,
    pub(crate) digest: String,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct QueryRow {
    pub(crate) path: String,
    pub(crate) entry: String,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct MapRow {
    path: String,
    digest: String,
    points_in_file: usize,
}

impl From<&MapFile> for MapRow {
    fn from(map: &MapFile) -> Self {
        Self {
            path: map.path.clone(),
            digest: map.digest.clone(),
            points_in_file: map.points_in_file,
        }
    }
}

impl MapRow {
    pub(crate) fn read(self) -> Result<MapFile, Fault> {
        let Self {
            path,
            digest,
            points_in_file,
        } = self;
        let digest = printable(NAME, digest)?;
        Ok(MapFile {
            path,
            digest,
            points_in_file,
        })
    }
}

/// A pose as its matrix, row by row.
pub(crate) type Matrix = [[f64; 4]; 4];

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct RequestRow {
    method: String,
    gravity_aligned: bool,
    near: Option<[f64; 4]>,
    initial: Option<Matrix>,
    truth: Option<Matrix>,
}

impl From<&Beforehand> for RequestRow {
    fn from(asked: &Beforehand) -> Self {
        Self {
            method: asked.method.to_string(),
            gravity_aligned: asked.gravity_aligned,
            near: asked.near.map(|near| {
                let [x, y, z] = near.centre;
                [x, y, z, near.radius]
            }),
            initial: asked.initial.as_ref().map(Pose::to_matrix),
            truth: asked.truth.as_ref().map(Pose::to_matrix),
        }
    }
}

impl RequestRow {
    pub(crate) fn read(self) -> Result<Beforehand, Fault> {
        let fault = |problem: &dyn std::fmt::Display| Fault::new(NAME, problem);
        let near = match self.near {
            None => None,
            Some([x, y, z, radius]) => {
                let within = |v: f64| v.abs() <= FAR;
                if !([x, y, z, radius].into_iter().all(within) && radius > 0.0) {
                    return Err(fault(&"request.near is no ball"));
                }
                Some(Near {
                    centre: [x, y, z],
                    radius,
                })
            }
        };
        Ok(Beforehand {
            method: self.method.parse().map_err(|e| fault(&e))?,
            gravity_aligned: self.gravity_aligned,
            near,
            initial: self.initial.map(|m| pose(NAME, m)).transpose()?,
            truth: self.truth.map(|m| pose(NAME, m)).transpose()?,
        })
    }
}

/// No coordinate is further from any frame's origin, metres.
pub(crate) const FAR: f64 = 1e9;

/// A pose to the bit.
pub(crate) fn pose(entry: &str, matrix: Matrix) -> Result<Pose, Fault> {
    let fault = |problem: &dyn std::fmt::Display| Fault::new(entry, problem);
    let pose = Pose::from_exact_matrix(matrix).map_err(|e| fault(&e))?;
    if pose.translation().iter().all(|v| v.abs() <= FAR) {
        Ok(pose)
    } else {
        Err(fault(&"a pose lies too far out"))
    }
}

/// Text that may be shown on a terminal.
pub(crate) fn printable(entry: &str, text: String) -> Result<String, Fault> {
    if text.len() <= 4096 && !text.chars().any(char::is_control) {
        Ok(text)
    } else {
        Err(Fault::new(entry, "holds a text that cannot be shown"))
    }
}
