//! A LiDAR that turns.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use winze::Pose;
use winze::rng::Rng;

use super::pulse::Pulse;
use super::{Return, range_of_count, ray_stream, wrong};
use crate::dust::Dust;
use crate::error::Result;
use crate::raycast::Caster;

/// A LiDAR whose beams, one above the other, turn about the sensor's z axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spinning {
    /// Number of beams.
    pub beams: u32,
    /// Angles above the horizon, degrees: one for each beam, or two for the lowest and the highest with the
    /// others evenly between.
    pub elevation_deg: Vec<f64>,
    /// Shots of each beam in a turn.
    pub shots_per_turn: u32,
    /// Turns a second: a scan takes the inverse.
    pub turns_per_second: f64,
    /// How it ranges.
    pub pulse: Pulse,
}

impl Spinning {
    pub(super) fn validate(&self) -> Result<()> {
        range_of_count("sensor.beams", self.beams, 1024)?;
        range_of_count("sensor.shots_per_turn", self.shots_per_turn, 65_536)?;
        let angles = self.elevation_deg.len();
        if angles != 2 && angles != self.beams as usize {
            let why = format!(
                "has {angles} angles; give {}, one a beam, or 2, the lowest and the highest",
                self.beams
            );
            return wrong("sensor.elevation_deg", why);
        }
        if !self.elevation_deg.iter().all(|e| e.abs() <= 90.0) {
            return wrong(
                "sensor.elevation_deg",
                "must lie from -90 to 90 degrees".into(),
            );
        }
        let rate = self.turns_per_second;
        super::within("sensor.turns_per_second", rate, 0.1, 1000.0, "a second")?;
        self.pulse.validate()
    }

    /// Angle of a beam above the horizon, radians.
    #[must_use]
    pub fn elevation(&self, beam: u32) -> f64 {
        let degrees = if self.elevation_deg.len() == self.beams as usize {
            self.elevation_deg.get(beam as usize).copied()
        } else {
            let share = f64::from(beam) / f64::from(self.beams.saturating_sub(1).max(1));
            match self.elevation_deg.as_slice() {
                [low, high, ..] => Some(low + share * (high - low)),
                _ => None,
            }
        };
        degrees.unwrap_or(0.0).to_radians()
    }

    /// Direction of a shot in the sensor's frame; shot 0 goes forward, the turn is to the left.
    #[must_use]
    pub fn direction(&self, beam: u32, shot: u32) -> [f64; 3] {
        let elevation = self.elevation(beam);
        let turn = f64::from(shot) / f64::from(self.shots_per_turn.max(1));
        let azimuth = std::f64::consts::TAU * turn;
        let (ce, se) = (libm::cos(elevation), libm::sin(elevation));
        [ce * libm::cos(azimuth), ce * libm::sin(azimuth), se]
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
        (0..self.beams.saturating_mul(self.shots_per_turn))
            .into_par_iter()
            .filter_map(|i| {
                let mut rng = Rng::new(seed, ray_stream(scan, i));
                let direction = self.direction(i / self.shots_per_turn, i % self.shots_per_turn);
                let out = world_from_sensor.rotate(direction);
                let echo = self.pulse.shoot(caster, air, origin, out, &mut rng)?;
                Some(Return::of(direction, &echo))
            })
            .collect()
    }
}
