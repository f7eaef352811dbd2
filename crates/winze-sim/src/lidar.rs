//! A spinning LiDAR in a mine.

use rayon::prelude::*;
use winze::Pose;
use winze::rng::Rng;

use crate::mine::Mine;

/// A spinning LiDAR.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lidar {
    /// Number of beams.
    pub beams: u32,
    /// Lowest and highest beam, radians above the horizon.
    pub elevation: [f64; 2],
    /// Shots a turn.
    pub shots: u32,
    /// Furthest return, metres.
    pub range: f64,
    /// Standard deviation of a range, metres.
    pub range_noise: f64,
    /// Share of shots that dust returns instead of the wall.
    pub dust: f64,
}

/// A shot's return, in the frame of the mine.
pub type Return = [f64; 3];

impl Lidar {
    /// One turn from `mine_from_sensor`; `turn` seeds its noise. Shots that meet nothing within
    /// range are left out.
    #[must_use]
    pub fn turn(&self, mine: &Mine, mine_from_sensor: &Pose, seed: u64, turn: u64) -> Vec<Return> {
        let origin = mine_from_sensor.translation();
        let total = self.beams * self.shots;
        (0..total)
            .into_par_iter()
            .filter_map(|i| {
                let mut rng = Rng::new(seed, turn << 32 | u64::from(i));
                let (beam, shot) = (i / self.shots, i % self.shots);
                let share = f64::from(beam) / f64::from((self.beams - 1).max(1));
                let elevation = self.elevation[0] + share * (self.elevation[1] - self.elevation[0]);
                let azimuth = std::f64::consts::TAU * f64::from(shot) / f64::from(self.shots);
                let (ce, se) = (libm::cos(elevation), libm::sin(elevation));
                let direction =
                    mine_from_sensor.rotate([ce * libm::cos(azimuth), ce * libm::sin(azimuth), se]);
                let wall = cast(mine, origin, direction, self.range)?;
                let dusty = rng.uniform() < self.dust;
                let range = if dusty {
                    // Thick near the sensor, thin further out.
                    (0.5 - 2.5 * libm::log(1.0 - rng.uniform())).min(wall)
                } else {
                    wall + self.range_noise * rng.normal()
                };
                Some(std::array::from_fn(|a| origin[a] + range * direction[a]))
            })
            .collect()
    }
}

/// Distance along a unit `direction` to the rock, `None` beyond `range`.
#[must_use]
pub fn cast(mine: &Mine, origin: [f64; 3], direction: [f64; 3], range: f64) -> Option<f64> {
    let at = |t: f64| mine.clearance(std::array::from_fn(|a| origin[a] + t * direction[a]));
    // Relief makes the clearance steeper than a true distance; shorter steps stay safe.
    let (mut t, mut last) = (0.0, 0.0);
    while t < range {
        let clearance = at(t);
        if clearance < 1e-3 {
            // Between the last step and this one lies the wall: halve the way to it.
            let (mut open, mut rock) = (last, t);
            for _ in 0..10 {
                let middle = 0.5 * (open + rock);
                if at(middle) > 0.0 {
                    open = middle;
                } else {
                    rock = middle;
                }
            }
            return Some(rock);
        }
        last = t;
        t += (0.7 * clearance).max(0.015);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mine::Drift;

    fn mine() -> Mine {
        let drift = Drift {
            from: [0.0; 3],
            to: [60.0, 0.0, 0.0],
            width: 4.0,
            height: 4.0,
        };
        Mine {
            drifts: vec![drift],
            roughness: 0.25,
            seed: 3,
        }
    }

    #[test]
    fn rays_end_on_the_rock() {
        let mine = mine();
        let mut rng = Rng::new(1, 0);
        for _ in 0..500 {
            let (origin, direction) = ([30.0, 0.3, 1.5], rng.direction());
            let t = cast(&mine, origin, direction, 100.0).unwrap();
            let hit = std::array::from_fn(|a| origin[a] + t * direction[a]);
            assert!(mine.clearance(hit).abs() < 2e-3, "{}", mine.clearance(hit));
        }
        assert_eq!(
            cast(&mine, [30.0, 0.0, 1.5], [1.0, 0.0, 0.0], 10.0),
            None,
            "out of range"
        );
        assert_eq!(
            cast(&mine, [30.0, 9.0, 1.5], [1.0, 0.0, 0.0], 10.0),
            Some(0.0),
            "inside the rock"
        );
    }

    #[test]
    fn ranges_have_the_stated_noise_and_turns_do_not_depend_on_threads() {
        let mine = mine();
        let lidar = Lidar {
            beams: 8,
            elevation: [-0.3, 0.3],
            shots: 360,
            range: 50.0,
            range_noise: 0.02,
            dust: 0.0,
        };
        let pose = Pose::from_yaw_pitch_roll(0.3, 0.02, 0.01, [30.0, 0.2, 1.5]);
        let turn = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| lidar.turn(&mine, &pose, 7, 2))
        };
        let noisy = turn(1);
        assert_eq!(noisy, turn(3));
        let exact = Lidar {
            range_noise: 0.0,
            ..lidar
        }
        .turn(&mine, &pose, 7, 2);
        let (mut sum, mut square) = (0.0, 0.0);
        for (a, b) in noisy.iter().zip(&exact) {
            let direction = |p: &Return| {
                (0..3)
                    .map(|i| (p[i] - pose.translation()[i]).powi(2))
                    .sum::<f64>()
                    .sqrt()
            };
            let e = direction(a) - direction(b);
            sum += e;
            square += e * e;
        }
        let n = exact.len() as f64;
        assert!((sum / n).abs() < 0.002 && ((square / n).sqrt() - 0.02).abs() < 0.002);
    }
}
