//! Sensors: what a robot's LiDAR or depth camera makes of a world, ray by ray.
//!
//! | sensor | noise | in dust |
//! |---|---|---|
//! | [`Spinning`] LiDAR | along the ray, constant and growing as the signal falls | loses the wall, sees the dust |
//! | [`SolidState`] LiDAR | the same | the same |
//! | [`Stereo`] camera | in disparity, so along its axis with depth squared; neighbours err together | loses contrast |
//!
//! Every [`Return`] carries the truth along its ray, so that a sensor can be checked before anything is
//! made of its points. [`presets`] holds well-known units with the source of each figure.
//!
//! Left out by all: motion within a scan (poses are the caller's: one a scan), offsets that stay the same from
//! scan to scan (calibration of a unit), glass and other mirrors than water, sunlight, crosstalk.

pub mod presets;
pub mod pulse;
mod sight;
mod solid_state;
mod spec;
mod spinning;
mod stereo;
#[cfg(test)]
mod tests;

use winze::Pose;

use crate::dust::Dust;
use crate::error::{Error, Result};
use crate::mesh::Material;
use crate::raycast::Caster;
use pulse::Echo;
pub use pulse::{Pulse, Returns};
pub use solid_state::SolidState;
pub use spec::SensorSpec;
pub use spinning::Spinning;
pub use stereo::Stereo;

use serde::{Deserialize, Serialize};

/// Where a return comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ReturnOrigin {
    /// The first surface along the ray.
    Surface,
    /// Dust before it.
    Dust,
    /// A surface seen in a wet one: the point lies behind the mirror, where nothing is.
    Mirror,
    /// An edge: between the foreground and the background, or on the one of them that the ray's middle misses.
    Bleed,
}

/// One return, in the sensor's frame: x forward, y left, z up, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Return {
    /// Unit direction of the ray.
    pub direction: [f64; 3],
    /// Range as measured, metres.
    pub range: f64,
    /// Range to the first surface along the ray without noise, metres; `None` where nothing is there.
    pub true_range: Option<f64>,
    /// Where it comes from.
    pub origin: ReturnOrigin,
    /// Part of the mesh that gave the light back: in [`ReturnOrigin::Mirror`] the one seen in the mirror;
    /// `u16::MAX` for dust.
    pub part: u16,
    /// True normal of that surface in the world's frame, towards the light; zero for dust.
    pub normal: [f64; 3],
    /// Reflectivity as it appears, corrected for range but not for dust or slant, 0 to 1.
    pub intensity: f32,
}

impl Return {
    /// The point as measured, sensor frame.
    #[must_use]
    pub fn point(&self) -> [f64; 3] {
        self.direction.map(|c| c * self.range)
    }

    /// The point of the first surface along the ray, sensor frame.
    #[must_use]
    pub fn true_point(&self) -> Option<[f64; 3]> {
        self.true_range.map(|r| self.direction.map(|c| c * r))
    }

    fn of(direction: [f64; 3], echo: &Echo) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a share, to be stored")]
        let intensity = echo.intensity as f32;
        Self {
            direction,
            range: echo.range,
            true_range: echo.first,
            origin: echo.origin,
            part: echo.part,
            normal: echo.normal,
            intensity,
        }
    }
}

/// A sensor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Sensor {
    /// A LiDAR that turns.
    Spinning(Spinning),
    /// A stereo depth camera.
    Stereo(Stereo),
    /// A LiDAR without a turning head.
    SolidState(SolidState),
}

impl Sensor {
    /// Names that [`Sensor::preset`] knows.
    pub const PRESETS: &[&str] = presets::NAMES;

    /// A well-known unit, see [`presets`]. `None` for a name that is not in [`Sensor::PRESETS`].
    #[must_use]
    pub fn preset(name: &str) -> Option<Self> {
        presets::by_name(name)
    }

    /// A short name of its kind, such as `lidar32`, `stereo` or `solid_state`.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Spinning(s) => format!("lidar{}", s.beams),
            Self::Stereo(_) => "stereo".into(),
            Self::SolidState(_) => "solid_state".into(),
        }
    }

    /// Refuses settings without meaning.
    ///
    /// # Errors
    /// [`Error::Setting`] with the key of the first such value and its domain.
    pub fn validate(&self) -> Result<()> {
        match self {
            Self::Spinning(s) => s.validate(),
            Self::Stereo(s) => s.validate(),
            Self::SolidState(s) => s.validate(),
        }
    }

    /// One scan from `world_from_sensor`, in the order of rays; those that bring nothing are left out.
    ///
    /// `seed` and the number of the `scan` determine the noise; the result has the same bits at any number
    /// of threads. A sensor that [`Sensor::validate`] refuses gives something without meaning, or nothing.
    #[must_use]
    pub fn scan(
        &self,
        caster: &Caster,
        world_from_sensor: &Pose,
        air: &Dust,
        seed: u64,
        scan: u64,
    ) -> Vec<Return> {
        match self {
            Self::Spinning(s) => s.scan(caster, world_from_sensor, air, seed, scan),
            Self::Stereo(s) => s.scan(caster, world_from_sensor, air, seed, scan),
            Self::SolidState(s) => s.scan(caster, world_from_sensor, air, seed, scan),
        }
    }

    /// One standard deviation of a range along the ray in clean air, metres: forwards, of grey rock, head-on.
    #[must_use]
    pub fn noise_at(&self, range: f64) -> f64 {
        self.noise_along([1.0, 0.0, 0.0], range, Material::ROCK.reflectivity)
    }

    /// One standard deviation of a range along a ray of this sensor in clean air, metres.
    ///
    /// `direction` is a unit vector of the sensor's frame, which matters to a stereo camera; `given_back` is
    /// the surface's reflectivity times the cosine of incidence, which matters to LiDARs.
    #[must_use]
    pub fn noise_along(&self, direction: [f64; 3], range: f64, given_back: f64) -> f64 {
        match self {
            Self::Spinning(Spinning { pulse, .. }) | Self::SolidState(SolidState { pulse, .. }) => {
                pulse.range_sd_of(pulse.signal(given_back, range, 0.0))
            }
            Self::Stereo(s) => s.noise_along(direction, range),
        }
    }

    /// Nearest return, metres; for a stereo camera along its axis.
    #[must_use]
    pub fn min_range(&self) -> f64 {
        match self {
            Self::Spinning(s) => s.pulse.min_range,
            Self::Stereo(s) => s.min_range,
            Self::SolidState(s) => s.pulse.min_range,
        }
    }

    /// Furthest return, metres; for a stereo camera along its axis.
    #[must_use]
    pub fn max_range(&self) -> f64 {
        match self {
            Self::Spinning(s) => s.pulse.max_range,
            Self::Stereo(s) => s.max_range,
            Self::SolidState(s) => s.pulse.max_range,
        }
    }

    /// Rays of a scan.
    #[must_use]
    pub fn rays(&self) -> usize {
        let (a, b) = match self {
            Self::Spinning(s) => (s.beams, s.shots_per_turn),
            Self::Stereo(s) => (s.width, s.height),
            Self::SolidState(s) => (s.width, s.height),
        };
        (a as usize).saturating_mul(b as usize)
    }

    /// Scans a second.
    #[must_use]
    pub fn rate(&self) -> f64 {
        match self {
            Self::Spinning(s) => s.turns_per_second,
            Self::Stereo(s) => s.scans_per_second,
            Self::SolidState(s) => s.scans_per_second,
        }
    }

    /// The same sensor with one ray of `every`: fewer shots a turn, or of pictures fewer rows and columns.
    /// Noise and field of view stay.
    #[must_use]
    pub fn thinned(&self, every: u32) -> Self {
        let every = every.max(1);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the root of a u32"
        )]
        let fewer = |n: u32| ((f64::from(n) / f64::from(every).sqrt()).round() as u32).max(1);
        match self.clone() {
            Self::Spinning(s) => Self::Spinning(Spinning {
                shots_per_turn: (s.shots_per_turn / every).max(1),
                ..s
            }),
            Self::Stereo(s) => Self::Stereo(Stereo {
                width: fewer(s.width),
                height: fewer(s.height),
                ..s
            }),
            Self::SolidState(s) => Self::SolidState(SolidState {
                width: fewer(s.width),
                height: fewer(s.height),
                ..s
            }),
        }
    }
}

/// Stream of random numbers of a ray.
fn ray_stream(scan: u64, ray: u32) -> u64 {
    scan << 32 | u64::from(ray)
}

/// Direction of pixel `i`, row by row from the upper left, of a pinhole camera; unit, sensor frame.
fn pixel_direction(i: u32, [width, height]: [u32; 2], field_of_view_deg: [f64; 2]) -> [f64; 3] {
    let half = field_of_view_deg.map(|a| libm::tan(0.5 * a.to_radians()));
    let across = |pixel: u32, of: u32| 1.0 - (2.0 * f64::from(pixel) + 1.0) / f64::from(of.max(1));
    let width_at_least_1 = width.max(1);
    let y = half[0] * across(i % width_at_least_1, width);
    let z = half[1] * across(i / width_at_least_1, height);
    let n = (1.0 + y * y + z * z).sqrt();
    [1.0 / n, y / n, z / n]
}

fn wrong(key: &str, why: String) -> Result<()> {
    Err(Error::Setting {
        key: key.into(),
        why,
    })
}

fn within(key: &str, value: f64, low: f64, high: f64, unit: &str) -> Result<()> {
    if value >= low && value <= high {
        return Ok(());
    }
    wrong(
        key,
        format!("is {value}; must lie from {low} to {high} {unit}"),
    )
}

fn range_of_count(key: &str, value: u32, most: u32) -> Result<()> {
    if value >= 1 && value <= most {
        return Ok(());
    }
    wrong(key, format!("is {value}; must lie from 1 to {most}"))
}

fn range_of_sensor(table: &str, min_range: f64, max_range: f64) -> Result<()> {
    within(&format!("{table}.min_range"), min_range, 0.0, 1e4, "metres")?;
    within(
        &format!("{table}.max_range"),
        max_range,
        0.01,
        1e4,
        "metres",
    )?;
    if min_range < max_range {
        return Ok(());
    }
    wrong(
        &format!("{table}.max_range"),
        format!("is {max_range} m, not beyond min_range, {min_range} m"),
    )
}

fn field_of_view(degrees: [f64; 2]) -> Result<()> {
    for d in degrees {
        within("sensor.field_of_view_deg", d, 0.1, 170.0, "degrees")?;
    }
    Ok(())
}
