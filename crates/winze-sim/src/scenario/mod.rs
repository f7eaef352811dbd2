//! A scenario: which mines, how they were mapped, and who asks where he is, with what in the air.
//!
//! One TOML file says it all; [`builtin`] holds those that ship with winze, [`simulate`] plays one.

pub mod builtin;
mod check;
mod frame;
mod play;
mod way;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::dust::Dust;
use crate::error::{Error, Result};
use crate::free_space::Robot;
use crate::motion::{Drift, Motion};
use crate::sensor::SensorSpec;
use crate::world::{Change, WorldSpec};

pub use play::{Made, MadeMap, MadeQuery, Step, simulate};

/// A scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Its name, with which the names of its families begin.
    pub name: String,
    /// What it is for, in a sentence.
    #[serde(default)]
    pub about: String,
    /// The mines, each with its map and its queries.
    #[serde(rename = "mine")]
    pub mines: Vec<Mine>,
}

/// A mine, its map, its queries.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mine {
    /// Its name, which its files bear.
    pub name: String,
    /// What it is made of; give this or `mesh`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub world: Option<WorldSpec>,
    /// A triangle mesh in PLY, STL or OBJ, in metres, z up; a path relative to the scenario's file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PathBuf>,
    /// Size of the robot that must fit through.
    #[serde(default)]
    pub robot: Robot,
    /// How it was mapped; without a map its queries must ask in another mine's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<MapSpec>,
    /// Its queries.
    #[serde(default, rename = "query")]
    pub queries: Vec<QuerySpec>,
}

/// How a mine was mapped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapSpec {
    /// With which sensor.
    pub sensor: SensorSpec,
    /// How it was carried.
    #[serde(default = "survey_motion")]
    pub motion: Motion,
    /// What hung in the air.
    #[serde(default)]
    pub dust: Dust,
    /// Distance between the legs of the survey, metres.
    #[serde(default = "leg_spacing")]
    pub spacing: f64,
    /// The lines that the sensor followed, metres, instead of a survey of all that can be reached.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub through: Option<Vec<Vec<[f64; 3]>>>,
    /// The places that the sensor went past by ways through free space, metres, instead of a survey of all.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub via: Option<Vec<[f64; 3]>>,
    /// One point a cube of this edge, metres.
    #[serde(default = "map_voxel")]
    pub voxel: f64,
    /// Share of the mine, at one end of it, that was never mapped.
    #[serde(default)]
    pub leave_out: f64,
    /// What loop closures left of the survey's own drift: smooth displacements over tens of metres, one
    /// standard deviation, metres.
    #[serde(default)]
    pub warp: f64,
    /// Where the world's origin lies in the map's frame, metres, such as an easting, a northing and a height.
    #[serde(default)]
    pub origin: [f64; 3],
    /// Write intensities.
    #[serde(default)]
    pub intensity: bool,
}

/// Queries of one family.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QuerySpec {
    /// The family's name, after the scenario's.
    pub name: String,
    /// How many.
    #[serde(default = "one")]
    pub count: usize,
    /// The sensors that take turns.
    pub sensors: Vec<SensorSpec>,
    /// How they are carried.
    #[serde(default)]
    pub motion: Motion,
    /// What hangs in the air.
    #[serde(default)]
    pub dust: Dust,
    /// How odometry errs.
    #[serde(default)]
    pub drift: Drift,
    /// What is different from when the map was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<Change>,
    /// For a mine from a mesh: its mesh as these queries found it, in the same frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub later_mesh: Option<PathBuf>,
    /// The mine in whose map the queries ask; their own where it is not given. They are nowhere in another mine's map: their
    /// truth is null.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asks_in: Option<String>,
    /// Where the drives lie.
    #[serde(default)]
    pub place: Place,
    /// Least and greatest share of a drive on the border that lies in the mapped part.
    #[serde(default = "mapped_share")]
    pub mapped_share: [f64; 2],
    /// Shortest and longest drive, metres.
    #[serde(default = "drive_length")]
    pub length: [f64; 2],
    /// The line that the sensor follows, metres, instead of a drive from a random place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub through: Option<Vec<[f64; 3]>>,
    /// The places that the sensor goes past by ways through free space, metres, instead of a drive from a
    /// random place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub via: Option<Vec<[f64; 3]>>,
    /// One point a cube of this edge, metres.
    #[serde(default = "query_voxel")]
    pub voxel: f64,
    /// Attitude of the query's frame.
    #[serde(default)]
    pub frame: Frame,
    /// How far the frame's origin lies from the drive's start at most, metres.
    #[serde(default)]
    pub away: f64,
    /// The true `map_from_query` as x, y, z in metres and yaw, pitch, roll in degrees, instead of a drawn frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_from_query: Option<[f64; 6]>,
    /// A pose is right within this, metres and degrees.
    #[serde(default = "tolerance")]
    pub tolerance: [f64; 2],
    /// Write intensities.
    #[serde(default)]
    pub intensity: bool,
    /// Only the first so many are made; set by [`Scenario::limit`].
    #[serde(skip)]
    pub first: Option<usize>,
}

impl QuerySpec {
    /// Queries that are made.
    #[must_use]
    pub fn made(&self) -> usize {
        self.first.map_or(self.count, |first| first.min(self.count))
    }
}

/// Where drives lie, in a mine of which a part was never mapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// Where the mine was mapped.
    #[default]
    Mapped,
    /// Partly there.
    Border,
    /// Where it was not.
    Unmapped,
}

/// The attitude of a query's frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Frame {
    /// Level and tilted by turns, so that half the cases have z up.
    #[default]
    Mixed,
    /// z up, any yaw.
    Level,
    /// Any attitude.
    Tilted,
    /// That of the sensor's first pose, levelled.
    FirstPose,
}

fn survey_motion() -> Motion {
    Motion {
        scan_every: 2.0,
        wobble: 0.5,
        ..Motion::default()
    }
}

fn leg_spacing() -> f64 {
    6.0
}

fn map_voxel() -> f64 {
    0.1
}

fn query_voxel() -> f64 {
    0.05
}

fn one() -> usize {
    1
}

fn mapped_share() -> [f64; 2] {
    [0.1, 0.6]
}

fn drive_length() -> [f64; 2] {
    [5.0, 60.0]
}

fn tolerance() -> [f64; 2] {
    [0.5, 5.0]
}

impl Scenario {
    /// From the text of a TOML file; `place` is its name in messages.
    ///
    /// # Errors
    /// [`Error::Scenario`] with line and key of what is not understood, [`Error::Setting`] for a value outside
    /// its domain.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let deserializer = toml::Deserializer::parse(text).map_err(|e| scenario(place, &e))?;
        let scenario: Self =
            serde_path_to_error::deserialize(deserializer).map_err(|e| Error::Scenario {
                place: place.into(),
                why: format!("{}: {}", e.path(), line(text, e.inner())),
            })?;
        scenario.validate()?;
        Ok(scenario)
    }

    /// A built-in scenario by its name, or one from a file. Meshes that a file names are looked for beside it.
    ///
    /// # Errors
    /// As [`Scenario::parse`]; [`Error::Scenario`] where the file cannot be read.
    pub fn open(name: &str) -> Result<Self> {
        if let Some(text) = builtin::text(name) {
            return Self::parse(text, name);
        }
        let path = Path::new(name);
        let text = std::fs::read_to_string(path).map_err(|e| Error::Scenario {
            place: name.into(),
            why: format!(
                "{e}; built in are {}, anything else is taken for a TOML file",
                builtin::names().collect::<Vec<_>>().join(", ")
            ),
        })?;
        let mut scenario = Self::parse(&text, name)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for mine in &mut scenario.mines {
            let later = mine.queries.iter_mut().map(|q| &mut q.later_mesh);
            for mesh in later.chain([&mut mine.mesh]).flatten() {
                *mesh = folder.join(&*mesh);
            }
        }
        Ok(scenario)
    }

    /// Number of queries.
    #[must_use]
    pub fn cases(&self) -> usize {
        let queries = self.mines.iter().flat_map(|m| &m.queries);
        queries.map(QuerySpec::made).sum()
    }

    /// At most `count` queries of each family; those that stay are the same as without.
    pub fn limit(&mut self, count: usize) {
        for q in self.mines.iter_mut().flat_map(|m| &mut m.queries) {
            q.first = Some(count);
        }
    }
}

fn scenario(place: &str, e: &toml::de::Error) -> Error {
    Error::Scenario {
        place: place.into(),
        why: e.to_string().trim().replace('\n', " "),
    }
}

/// The message of a TOML error with its line.
fn line(text: &str, e: &toml::de::Error) -> String {
    let message = e.message().trim().replace('\n', " ");
    match e.span() {
        Some(span) => {
            let before = text.get(..span.start).unwrap_or("");
            format!("line {}: {message}", before.matches('\n').count() + 1)
        }
        None => message,
    }
}

#[cfg(test)]
mod tests;
