//! Case files: which query is asked in which map, and what the right answer is.
//!
//! `cases.json` is a contract with whoever evaluates: fields may be added, unknown ones are ignored.

use serde::Serialize;

/// A file of cases; paths are relative to it.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Cases {
    /// The cases.
    pub cases: Vec<Case>,
}

/// A question and its answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Case {
    /// Its name, unlike any other's.
    pub name: String,
    /// The prior map's file.
    pub map: String,
    /// The query's file.
    pub query: String,
    /// The true `map_from_query`, row by row; null where the query is not in this map. Where odometry bent
    /// the query: the rigid fit of its points to their true positions.
    pub truth: Option<[[f64; 4]; 4]>,
    /// What that fit leaves, root mean square, metres.
    pub bend_rms_m: f64,
    /// How far a right pose may lie from it.
    pub tolerance: CaseTolerance,
    /// Map and query both have z up.
    pub gravity_aligned: bool,
    /// Share of the query's true surface returns within 0.25 m of mapped surface at the truth.
    pub overlap: Option<f64>,
    /// Another place fits the query's surface within the sensor's noise.
    pub ambiguous: bool,
    /// The poses of such places.
    pub alternatives: Vec<[[f64; 4]; 4]>,
    /// Directions along which the query can slide, or about which it can turn.
    pub unobservable: Vec<OpenDirection>,
    /// What kind of case it is.
    pub family: String,
    /// What the query was seen with.
    pub sensor: String,
}

/// How far a right pose may lie from the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CaseTolerance {
    /// Displacement of the query's centroid, metres.
    pub translation_m: f64,
    /// Angle, degrees.
    pub rotation_deg: f64,
}

impl Default for CaseTolerance {
    fn default() -> Self {
        Self {
            translation_m: 0.5,
            rotation_deg: 5.0,
        }
    }
}

/// A direction that the query's geometry leaves open.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OpenDirection {
    /// `translation` or `rotation`, the latter about the query's centroid.
    pub kind: String,
    /// Unit direction in the map's axes.
    pub direction: [f64; 3],
}

impl Cases {
    /// As indented JSON text with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Only maps with keys that are no strings could fail, and there are none.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }
}
