//! What a map tells of itself in words and single numbers: its section `META`, in JSON.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use winze::scale::Measure;

use crate::error::{Error, Result};

/// What a prepared map is and what it was made of. Lengths in metres; coordinates in the map's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Version of the winze that built it.
    pub winze: String,
    /// Points of its clouds that were used.
    pub points: u64,
    /// What all offsets in the file count from.
    pub origin: [f64; 3],
    /// The coordinate reference system of its coordinates, where that is known.
    pub crs: Option<String>,
    /// Smallest and largest corner.
    pub bounds: [[f64; 3]; 2],
    /// The same, a thousandth of the surface left out at each end of each axis: stray returns do not count.
    pub robust_bounds: [[f64; 3]; 2],
    /// What was measured of it.
    pub measure: Measured,
    /// How thick its walls are: the median over the map of the root mean square distance of the base's
    /// points from the plane through a patch of them [`Meta::noise_patch`] in radius. Roughness of that
    /// size counts. `None` where no patch held enough points.
    pub noise_floor: Option<f64>,
    /// Radius of those patches.
    pub noise_patch: f64,
    /// Voxel size of the base that all levels were made from, and its points.
    pub base_voxel: f64,
    /// Points of the base.
    pub base_points: u64,
    /// Its levels, finest first.
    pub levels: Vec<LevelMeta>,
    /// The files it was made of, in order.
    pub sources: Vec<SourceMeta>,
    /// The settings that shaped it, by their dotted keys.
    pub settings: BTreeMap<String, serde_json::Value>,
    /// Digest of the settings that shaped it.
    pub config_digest: String,
}

/// Bytes that a map may take in memory on top of its file's size, to be opened.
const SLACK: u64 = 1 << 20;
/// The longest text or number, bytes.
const LONGEST: usize = 16 << 10;
/// Characters of a parser's complaint that are passed on.
const TOLD: usize = 200;

impl Meta {
    /// Reads what a map of `length` bytes tells of itself.
    ///
    /// # Errors
    /// Says what is wrong, in a few printable words.
    pub(crate) fn read(text: &[u8], length: u64) -> std::result::Result<Self, String> {
        if !is_modest(text, length) {
            return Err("tells of more than a map of this size can hold".into());
        }
        serde_json::from_slice(text).map_err(|e| {
            let told: String = e.to_string().chars().take(TOLD).collect();
            format!("cannot be read: {}", told.escape_debug())
        })
    }

    /// As it is written to a file.
    ///
    /// # Errors
    /// Where it could not be read back from a file of `before` and its own bytes.
    pub(crate) fn write(&self, before: u64) -> Result<Vec<u8>> {
        let failed = |e: String| Error::from(winze::Error::Map(e));
        let text = serde_json::to_vec_pretty(self).map_err(|e| failed(e.to_string()))?;
        if is_modest(&text, before + text.len() as u64) {
            return Ok(text);
        }
        Err(failed(format!(
            "{} clouds are too many for so small a map, or a name of theirs or of the CRS is too long; join clouds \
             first",
            self.sources.len()
        )))
    }
}

/// Whether reading the JSON `text` takes no more memory than `length` bytes and [`SLACK`], at worst.
///
/// A vector takes up to three times its elements while it grows. Each element but a list's first comes after a comma;
/// those larger than a number begin with a bracket, and none is larger than a source. Texts are kept as
/// they are, which takes no more than they do here, but are unescaped and complained about in other places, one
/// at a time.
fn is_modest(text: &[u8], length: u64) -> bool {
    const NESTED: u64 = 3 * size_of::<SourceMeta>() as u64;
    const NUMBER: u64 = 3 * size_of::<u64>() as u64;
    let mut weight = text.len() as u64;
    let (mut quoted, mut escaped, mut begun) = (false, false, 0);
    for (at, byte) in text.iter().enumerate() {
        if at - begun > LONGEST {
            return false;
        }
        if quoted {
            let ends = *byte == b'"' && !escaped;
            escaped = *byte == b'\\' && !escaped;
            if ends {
                (quoted, begun) = (false, at);
            }
            continue;
        }
        weight += match byte {
            b'[' | b'{' => NESTED,
            b',' => NUMBER,
            b'"' | b']' | b'}' | b':' => 0,
            _ => continue,
        };
        (quoted, begun) = (*byte == b'"', at);
    }
    weight <= length.saturating_add(SLACK)
}

/// [`Measure`], to be written down.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// See [`Measure::spacing`].
    pub spacing: f64,
    /// See [`Measure::width`].
    pub width: Option<f64>,
    /// See [`Measure::width_range`].
    pub width_range: Option<[f64; 2]>,
    /// See [`Measure::budget`].
    pub budget: f64,
}

impl From<Measure> for Measured {
    fn from(m: Measure) -> Self {
        Self {
            spacing: m.spacing,
            width: m.width,
            width_range: m.width_range,
            budget: m.budget,
        }
    }
}

impl From<Measured> for Measure {
    fn from(m: Measured) -> Self {
        Self {
            spacing: m.spacing,
            width: m.width,
            width_range: m.width_range,
            budget: m.budget,
        }
    }
}

/// One level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LevelMeta {
    /// Voxel size.
    pub voxel: f64,
    /// Points of the surface.
    pub points: u64,
    /// Keypoints with descriptors.
    pub keypoints: u64,
    /// Keypoints that passed the ISS test.
    pub qualified: u64,
    /// Sizes of NDT cells, coarsest first.
    pub ndt_sizes: Vec<f64>,
    /// How many of each size hold a Gaussian.
    pub ndt_cells: Vec<u64>,
}

/// One file that a map was made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SourceMeta {
    /// Its name, without folders.
    pub name: String,
    /// `sha256:` and the hash of its bytes.
    pub digest: String,
    /// Its size.
    pub bytes: u64,
    /// Format and encoding.
    pub format: String,
    /// Points that it holds.
    pub points: u64,
    /// Of those, dropped: not finite, no return, too far from the rest.
    pub dropped: [u64; 3],
    /// When it was last changed, seconds since 1970.
    pub modified: Option<u64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_take_too_much_memory_is_not_read() {
        let length = 100_000;
        assert!(is_modest(br#"{"a": [1, 2, "b, [ \" c"]}"#, 0));
        let long = |n: usize| format!("[\"{}\", 1]", "x".repeat(n));
        assert!(is_modest(long(LONGEST - 2).as_bytes(), length));
        assert!(!is_modest(long(LONGEST + 2).as_bytes(), length));
        assert!(!is_modest("1".repeat(LONGEST + 2).as_bytes(), length));
        assert!(!is_modest("[0,".repeat(10_000).as_bytes(), length));
        assert!(!is_modest("0,".repeat(100_000).as_bytes(), length));
        // Nothing in a text counts but its length.
        let text = format!("[{}1]", "\"[,[,[\\\\\",".repeat(10_000));
        assert!(is_modest(text.as_bytes(), length));
    }

    #[test]
    fn what_is_wrong_is_told_in_printable_words() {
        for text in ["{\"a\n\": 1}", "[", "{\"points\": \"\\u001b[2J\"}"] {
            let told = Meta::read(text.as_bytes(), 100).unwrap_err();
            assert!(!told.chars().any(char::is_control), "{told:?}");
        }
    }
}
