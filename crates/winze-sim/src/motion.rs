//! A robot on its way: where its sensor is at each scan, and where its odometry believes it to be.

use serde::{Deserialize, Serialize};
use winze::Pose;
use winze::rng::Rng;
use winze::vec3::distance;

use crate::error::{Error, Result};
use crate::noise;

/// How a robot moves and carries its sensor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Motion {
    /// Speed along the way, metres a second; it only stamps the trajectory.
    pub speed: f64,
    /// Way between two scans, metres.
    pub scan_every: f64,
    /// Mount of the sensor on the robot: yaw, pitch (positive looks down), roll, degrees.
    pub mount: [f64; 3],
    /// Standard deviation of the attitude's wobble about each axis, degrees.
    pub wobble: f64,
    /// Standard deviation of the height's, metres.
    pub bob: f64,
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            speed: 1.0,
            scan_every: 1.0,
            mount: [0.0; 3],
            wobble: 1.0,
            bob: 0.03,
        }
    }
}

/// How odometry errs: a step is measured too long or too short, its heading turns a little too far, and both wander.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Drift {
    /// Scale error of a run, one standard deviation, percent of the way.
    pub translation_percent: f64,
    /// Constant turn of a run, one standard deviation, degrees a metre.
    pub heading_per_metre: f64,
    /// Random walk of the position about each axis, metres after one metre of way.
    pub walk: f64,
    /// Random walk of the heading, degrees after one metre of way.
    pub heading_walk: f64,
}

impl Drift {
    /// There is none: odometry is the truth.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }
}

/// A sensor's poses, one a scan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// Takes points of the sensor's frame at each scan to the world.
    pub world_from_sensor: Vec<Pose>,
    /// Time of each scan, seconds from the first.
    pub seconds: Vec<f64>,
    /// Way up to each scan, metres.
    pub way: Vec<f64>,
}

impl Motion {
    /// Refuses settings that no robot has.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn validate(&self, key: &str) -> Result<()> {
        for (name, value, low, high) in [
            ("speed", self.speed, 1e-3, 1e4),
            ("scan_every", self.scan_every, 0.01, 1e4),
            ("wobble", self.wobble, 0.0, 45.0),
            ("bob", self.bob, 0.0, 1.0),
        ] {
            if !(value >= low && value <= high) {
                return Err(Error::Setting {
                    key: format!("{key}.{name}"),
                    why: format!("{value} is not between {low} and {high}"),
                });
            }
        }
        if self.mount.iter().any(|v| !v.is_finite()) {
            return Err(Error::Setting {
                key: format!("{key}.mount"),
                why: "not a finite number".into(),
            });
        }
        Ok(())
    }

    /// The poses of a robot that follows `way`, a line through the sensor's places in the world, looking where it goes.
    #[must_use]
    pub fn follow(&self, way: &[[f64; 3]], seed: u64) -> Trajectory {
        let mut out = Trajectory::default();
        let along = lengths(way);
        let Some(total) = along.last().copied() else {
            return out;
        };
        let mount = self.mount.map(f64::to_radians);
        let robot_from_sensor = Pose::from_yaw_pitch_roll(mount[0], mount[1], mount[2], [0.0; 3]);
        // A slow swing of a few metres' length and a quicker one.
        let swing = |s: f64, axis: f64| {
            let slow = noise::value([s / 3.0, 17.3 * axis, 0.5], seed);
            let quick = noise::value([s / 0.7, 17.3 * axis, 9.5], seed);
            2.8 * slow + 1.5 * quick
        };
        let wobble = self.wobble.to_radians();
        let mut s = 0.0;
        loop {
            let at = place(way, &along, s);
            // The heading over a metre or two, so that a path's small steps do not jerk the sensor.
            let (back, ahead) = (
                place(way, &along, (s - 0.8).max(0.0)),
                place(way, &along, (s + 0.8).min(total)),
            );
            let heading = libm::atan2(ahead[1] - back[1], ahead[0] - back[0]);
            let heading = if heading.is_finite() { heading } else { 0.0 };
            let at = [at[0], at[1], at[2] + self.bob * swing(s, 4.0)];
            let world_from_robot = Pose::from_yaw_pitch_roll(
                heading + wobble * swing(s, 1.0),
                wobble * swing(s, 2.0),
                wobble * swing(s, 3.0),
                at,
            );
            out.world_from_sensor
                .push(world_from_robot.compose(&robot_from_sensor));
            out.seconds.push(s / self.speed);
            out.way.push(s);
            if s >= total {
                return out;
            }
            s = (s + self.scan_every).min(total);
        }
    }
}

impl Trajectory {
    /// The poses as odometry sees them: true at the first scan, off by more and more after it.
    /// Gravity keeps the robot level, so only heading and position err.
    #[must_use]
    pub fn drifted(&self, drift: &Drift, seed: u64) -> Vec<Pose> {
        let (Some(first), false) = (self.world_from_sensor.first(), drift.is_none()) else {
            return self.world_from_sensor.clone();
        };
        let mut rng = Rng::new(seed, 0xD21F);
        let scale = 1.0 + 0.01 * drift.translation_percent * rng.normal();
        let turn = drift.heading_per_metre.to_radians() * rng.normal();
        let mut believed = vec![*first];
        let (mut place, mut yaw) = (first.translation(), 0.0f64);
        for (poses, way) in self.world_from_sensor.windows(2).zip(self.way.windows(2)) {
            let ([a, b], [from, to]) = (poses, way) else {
                continue;
            };
            let length = (to - from).max(0.0);
            let root = length.sqrt();
            let (pa, pb) = (a.translation(), b.translation());
            let (sin, cos) = (libm::sin(yaw), libm::cos(yaw));
            let d: [f64; 3] = std::array::from_fn(|i| scale * (pb[i] - pa[i]));
            let step = [cos * d[0] - sin * d[1], sin * d[0] + cos * d[1], d[2]];
            for (p, s) in place.iter_mut().zip(step) {
                *p += s + drift.walk * root * rng.normal();
            }
            yaw += turn * length + drift.heading_walk.to_radians() * root * rng.normal();
            let turned = Pose::from_yaw_pitch_roll(yaw, 0.0, 0.0, [0.0; 3]);
            // The attitude of the true pose, turned; its place replaced.
            let rotated = turned.compose(b);
            let shift = std::array::from_fn(|i| place[i] - rotated.translation()[i]);
            believed.push(Pose::from_translation(shift).compose(&rotated));
        }
        believed
    }
}

/// Way up to each point of a line, metres.
fn lengths(line: &[[f64; 3]]) -> Vec<f64> {
    let mut total = 0.0;
    let mut last: Option<[f64; 3]> = None;
    line.iter()
        .map(|p| {
            if let Some(q) = last {
                total += distance(*p, q);
            }
            last = Some(*p);
            total
        })
        .collect()
}

/// The point `s` metres along a line.
fn place(line: &[[f64; 3]], along: &[f64], s: f64) -> [f64; 3] {
    let next = along.partition_point(|v| *v < s);
    let (Some(b), Some(to)) = (line.get(next), along.get(next)) else {
        return line.last().copied().unwrap_or_default();
    };
    let before = next.checked_sub(1);
    let (Some(a), Some(from)) = (
        before.and_then(|i| line.get(i)),
        before.and_then(|i| along.get(i)),
    ) else {
        return *b;
    };
    let share = if to > from {
        (s - from) / (to - from)
    } else {
        0.0
    };
    std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WAY: [[f64; 3]; 3] = [[0.0, 0.0, 1.5], [10.0, 0.0, 1.5], [10.0, 8.0, 1.5]];

    #[test]
    fn a_robot_looks_where_it_goes() {
        let motion = Motion {
            wobble: 0.0,
            bob: 0.0,
            scan_every: 2.0,
            mount: [90.0, 0.0, 0.0],
            ..Motion::default()
        };
        let t = motion.follow(&WAY, 1);
        assert_eq!(
            t.way,
            [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0]
        );
        let ahead = t.world_from_sensor[1].rotate([0.0, -1.0, 0.0]);
        assert!(
            (ahead[0] - 1.0).abs() < 1e-12,
            "mounted to look left: {ahead:?}"
        );
        assert!(distance(t.world_from_sensor[6].translation(), [10.0, 2.0, 1.5]) < 1e-12);
        let ahead = t.world_from_sensor[8].rotate([0.0, -1.0, 0.0]);
        assert!((ahead[1] - 1.0).abs() < 1e-12);
    }

    #[test]
    fn odometry_without_drift_is_the_truth_and_drift_grows() {
        let line = [[0.0, 0.0, 1.0], [60.0, 0.0, 1.0]];
        let t = Motion::default().follow(&line, 3);
        assert_eq!(t.drifted(&Drift::default(), 1), t.world_from_sensor);
        let drift = Drift {
            translation_percent: 1.0,
            heading_per_metre: 0.05,
            walk: 0.01,
            heading_walk: 0.05,
        };
        let runs = 200;
        let off = |at: usize| {
            let squares: f64 = (0..runs)
                .map(|seed| {
                    let believed = t.drifted(&drift, seed)[at];
                    let d = distance(
                        believed.translation(),
                        t.world_from_sensor[at].translation(),
                    );
                    d * d
                })
                .sum();
            (squares / runs as f64).sqrt()
        };
        assert!(off(0) == 0.0);
        // Scale: 0.3 m after 30 m; heading: 0.05 deg/m × 30² / 2 = 0.39 m; walks a little more.
        assert!((0.4..0.9).contains(&off(30)), "{}", off(30));
        assert!(off(60) > 2.0 * off(30));
    }

    #[test]
    fn wobble_has_the_size_it_is_given() {
        let line = [[0.0, 0.0, 1.0], [3000.0, 0.0, 1.0]];
        let t = Motion::default().follow(&line, 3);
        let pitch: Vec<f64> = t
            .world_from_sensor
            .iter()
            .map(|p| p.yaw_pitch_roll()[1].to_degrees())
            .collect();
        let sd = (pitch.iter().map(|v| v * v).sum::<f64>() / pitch.len() as f64).sqrt();
        assert!((0.6..1.5).contains(&sd), "{sd}");
    }

    #[test]
    fn odd_ways_and_settings() {
        assert!(Motion::default().follow(&[], 1).way.is_empty());
        assert_eq!(Motion::default().follow(&[[1.0; 3]], 1).way, [0.0]);
        assert_eq!(Motion::default().follow(&[[1.0; 3]; 3], 1).way, [0.0]);
        for bad in [
            Motion {
                scan_every: 0.0,
                ..Motion::default()
            },
            Motion {
                speed: f64::NAN,
                ..Motion::default()
            },
        ] {
            assert!(bad.validate("queries.motion").is_err());
        }
    }
}
