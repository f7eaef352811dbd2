//! A LiDAR without a turning head: a picture of ranges.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use winze::Pose;
use winze::rng::Rng;

use super::pulse::Pulse;
use super::{Return, pixel_direction, range_of_count, ray_stream};
use crate::dust::Dust;
use crate::error::Result;
use crate::raycast::Caster;

/// A LiDAR whose mirror of millimetres sweeps a field of view; its shots lie on the grid of a picture.
///
/// Its noise is along the ray, as that of a [`Spinning`](super::Spinning) LiDAR.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolidState {
    /// Shots in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Horizontal and vertical field of view, degrees.
    pub field_of_view_deg: [f64; 2],
    /// Scans a second.
    pub scans_per_second: f64,
    /// How it ranges.
    pub pulse: Pulse,
}

impl SolidState {
    pub(super) fn validate(&self) -> Result<()> {
        range_of_count("sensor.width", self.width, 8192)?;
        range_of_count("sensor.height", self.height, 8192)?;
        super::field_of_view(self.field_of_view_deg)?;
        let rate = self.scans_per_second;
        super::within("sensor.scans_per_second", rate, 0.1, 1000.0, "a second")?;
        self.pulse.validate()
    }

    pub(super) fn scan(
        &self,
        caster: &Caster,
        world_from_sensor: &Pose,
        air: &Dust,
        seed: u64,
        scan: u64,
    ) -> Vec<Return> {
        let origin = world_from_sensor.translation();
        let size = [self.width, self.height];
        (0..self.width.saturating_mul(self.height))
            .into_par_iter()
            .filter_map(|i| {
                let mut rng = Rng::new(seed, ray_stream(scan, i));
                let direction = pixel_direction(i, size, self.field_of_view_deg);
                let out = world_from_sensor.rotate(direction);
                let echo = self.pulse.shoot(caster, air, origin, out, &mut rng)?;
                Some(Return::of(direction, &echo))
            })
            .collect()
    }
}
