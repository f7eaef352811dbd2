//! A small rough drift for unit tests: every wall spot is its own, the geometry is exact.

use crate::cloud::Cloud;
use crate::config::PrepareConfig;
use crate::prepare::{Surface, prepare};
use crate::rng::Rng;

/// `n` points on a drift of about 2 m radius along x from 0 to `length` metres, with bumps of up to
/// `rough` metres, and Gaussian noise of `noise` metres; `draw` picks other points of the same walls.
pub(crate) fn drift(n: usize, length: f64, rough: f64, noise: f64, draw: u64) -> Vec<[f64; 3]> {
    // The world is one, whatever the draw.
    let mut world = Rng::new(2024, 0);
    let bumps: Vec<[f64; 4]> = (0..24)
        .map(|i| {
            let wavelength = 6.0 * libm::pow(0.85, f64::from(i));
            let k = std::f64::consts::TAU / wavelength;
            let along = world.range(-1.0, 1.0);
            [
                k * along,
                (2.0 * k * (1.0 - along * along).sqrt()).round(),
                world.range(0.0, 6.0),
                wavelength / 6.0,
            ]
        })
        .collect();
    let total: f64 = bumps.iter().map(|b| b[3]).sum();
    let mut rng = Rng::new(draw, 1);
    (0..n)
        .map(|_| {
            let (x, a) = (
                rng.range(0.0, length),
                rng.range(0.0, std::f64::consts::TAU),
            );
            let bump: f64 = bumps
                .iter()
                .map(|b| b[3] * libm::sin(b[0] * x + b[1] * a + b[2]))
                .sum();
            let r = 2.0 + rough * 3.0 * bump / total + noise * rng.normal();
            [
                x + noise * rng.normal(),
                r * libm::cos(a),
                0.8 * r * libm::sin(a),
            ]
        })
        .collect()
}

pub(crate) fn cloud(points: &[[f64; 3]]) -> Cloud {
    Cloud::from_points(points).unwrap().0
}

pub(crate) fn surface(points: &[[f64; 3]], voxel: f64) -> Surface<'static> {
    prepare(&cloud(points), &PrepareConfig::default(), voxel)
}
