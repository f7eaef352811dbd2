//! What a map tells of itself in words and single numbers: its section `META`, in JSON.

use serde::{Deserialize, Serialize};
use winze::Config;
use winze::scale::Measure;

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
    /// All settings it was built with. Those that shaped it are named in `docs/map-format.md`.
    pub config: Config,
    /// Digest of the settings that shaped it.
    pub config_digest: String,
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
