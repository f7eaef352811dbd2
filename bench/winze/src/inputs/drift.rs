//! A drift of any length, drawn point by point: small inputs to count instructions on, and long ones to see how cost
//! grows.
//!
//! The density is the same whatever the number of points: a longer drift has more of them. Only `libm` is asked for
//! sines, so that the points are the same everywhere.

use std::f64::consts::TAU;

use winze::rng::Rng;
use winze::{Cloud, Pose};

use super::make::Question;

/// Points on a metre of drift: about 5 cm apart on its walls.
pub(crate) const PER_METRE: f64 = 5_000.0;
/// Range noise along each axis, one standard deviation, metres.
const NOISE: f64 = 0.01;
/// Length of the query, metres, where the drift is as long.
const QUERY: f64 = 15.0;
const VOXEL: f64 = 0.2;
const SEED: u64 = 21;

/// The relief of the rock: waves along and around the drift.
struct Relief {
    /// Waves a metre, waves around, phase, amplitude.
    waves: Vec<[f64; 4]>,
}

impl Relief {
    fn new() -> Self {
        let mut rng = Rng::new(SEED, 0);
        let wave = |i: i32| {
            let length = 7.0 * 0.82f64.powi(i);
            let around = f64::from(rng.below(6 + i.unsigned_abs() / 2));
            [
                TAU / length * rng.range(0.5, 1.0),
                around,
                rng.range(0.0, TAU),
                0.9f64.powi(i),
            ]
        };
        let mut waves: Vec<[f64; 4]> = (0..18).map(wave).collect();
        let sum: f64 = waves.iter().map(|w| w[3]).sum();
        waves.iter_mut().for_each(|w| w[3] *= 1.3 / sum);
        Self { waves }
    }

    /// A point on the wall: so far along the drift, at this angle around it.
    fn wall(&self, s: f64, angle: f64) -> [f64; 3] {
        let relief: f64 = self
            .waves
            .iter()
            .map(|w| w[3] * libm::sin(w[0] * s + w[1] * angle + w[2]))
            .sum();
        let r = 2.3 + relief;
        // The middle winds, so that no piece of it is like another.
        let y = 12.0 * libm::sin(s / 31.0) + 40.0 * libm::sin(s / 173.0);
        let z = 2.0 * libm::sin(s / 57.0);
        [
            s,
            y + r * libm::cos(angle),
            z + (0.85 * r * libm::sin(angle)).max(-1.5 + 0.2 * relief),
        ]
    }
}

/// Points from `from` to `to` metres along, drawn by `stream`.
fn draw(relief: &Relief, count: usize, [from, to]: [f64; 2], stream: u64) -> Vec<[f64; 3]> {
    let mut rng = Rng::new(SEED, stream);
    let mut point = |_| {
        let p = relief.wall(rng.range(from, to), rng.range(0.0, TAU));
        p.map(|v| v + NOISE * rng.normal())
    };
    (0..count).map(&mut point).collect()
}

/// A drift of so many points and one query in it.
pub(crate) fn question(points: usize) -> anyhow::Result<Question> {
    let relief = Relief::new();
    #[expect(clippy::cast_precision_loss, reason = "a number of points")]
    let length = points as f64 / PER_METRE;
    let map = draw(&relief, points, [0.0, length], 1);
    let mut rng = Rng::new(SEED, 2);
    let intensity: Vec<f32> = (0..points).map(|_| rounded(rng.uniform())).collect();
    let (map, _) = Cloud::with_intensity(&map, Some(&intensity))?;
    let part = QUERY.min(0.8 * length);
    let begin = 0.4 * (length - part);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a number of points"
    )]
    let seen = draw(
        &relief,
        (part * PER_METRE) as usize,
        [begin, begin + part],
        3,
    );
    let truth = Pose::from_rotation_vector([0.1, -0.2, 1.9], [begin + 20.0, -7.0, 3.0]);
    let (query, _) = Cloud::from_points(&seen)?;
    Ok(Question {
        map,
        queries: vec![(query.transformed(&truth.inverse())?, truth)],
        voxel: VOXEL,
        seed: 0,
    })
}

/// Intensities have few steps.
fn rounded(v: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "a byte's worth of steps")]
    let v = (v * 255.0).floor() as f32;
    v / 255.0
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn the_query_lies_on_the_map() {
        let q = question(30_000).unwrap();
        let (query, truth) = &q.queries[0];
        assert_eq!(q.map.len(), 30_000);
        let tree = winze::kdtree::KdTree::build(q.map.points());
        let near = winze::metrics::inliers(&tree, q.map.origin(), query, truth, 0.25);
        assert!(near.fraction > 0.98, "{near:?}");
    }

    #[test]
    fn density_does_not_depend_on_length() {
        let spacing = |n| winze::spacing::spacing(question(n).unwrap().map.points()).unwrap();
        let (short, long) = (spacing(10_000), spacing(100_000));
        assert!((short / long - 1.0).abs() < 0.1, "{short} {long}");
    }
}
