//! Dust, fog and smoke in the air: how much light they take, and how unevenly they hang.
//!
//! Light loses the share `σ dr` of itself over each `dr` (Bouguer, Lambert, Beer), so that `exp(-∫σ)` is left
//! after a way and its square after there and back. The extinction `σ` is what an eye's meteorological
//! visibility tells, `V = 3.9/σ` (Koschmieder 1924, contrast threshold 2 %):
//!
//! | σ, 1/m | visibility | what it looks like |
//! |---|---|---|
//! | 0 | | clean air |
//! | 0.01 | 390 m | haze of a working drift with good ventilation |
//! | 0.03 | 130 m | dust after a vehicle has passed |
//! | 0.1 | 39 m | mucking, loading at an ore pass |
//! | 0.3 | 13 m | dry drilling, dense fog at a shaft |
//! | 1 | 4 m | after a blast, or thick smoke: a blackout |
//!
//! Left out: scattering more than once, the colour of dust, dust that moves between scans, dust stirred up
//! by the robot.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::noise;

/// What hangs in the air.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Dust {
    /// Mean extinction, 1/m; 0 for none.
    pub extinction: f64,
    /// How uneven it is: 0 the same everywhere, 1 from nothing to twice the mean.
    pub patchiness: f64,
    /// Size of its patches, metres.
    pub patch_size: f64,
    /// Of the patches.
    pub seed: u64,
}

impl Default for Dust {
    fn default() -> Self {
        Self::NONE
    }
}

/// Steps along a ray, as a share of a patch's size.
const STEPS_PER_PATCH: f64 = 4.0;
/// Steps along a ray at most, however small the patches.
const MAX_STEPS: f64 = 500.0;

impl Dust {
    /// Clean air.
    pub const NONE: Self = Self {
        extinction: 0.0,
        patchiness: 0.5,
        patch_size: 3.0,
        seed: 0,
    };

    /// Refuses what has no meaning.
    ///
    /// # Errors
    /// [`Error::Setting`] with the key of the value and its domain.
    pub fn validate(&self) -> Result<()> {
        let wrong = |key: &str, why: &str| {
            Err(Error::Setting {
                key: format!("dust.{key}"),
                why: why.into(),
            })
        };
        if !(0.0..=100.0).contains(&self.extinction) {
            return wrong("extinction", "must lie from 0 (clean air) to 100 per metre");
        }
        if !(0.0..=1.0).contains(&self.patchiness) {
            return wrong("patchiness", "must lie from 0 (even) to 1");
        }
        if !(0.01..=1e4).contains(&self.patch_size) {
            return wrong("patch_size", "must lie from 0.01 to 10000 metres");
        }
        Ok(())
    }

    /// How far an eye sees a black object, metres; infinite in clean air.
    #[must_use]
    pub fn visibility(&self) -> f64 {
        3.912 / self.extinction
    }

    /// Extinction at a point of the world, 1/m.
    #[must_use]
    pub fn at(&self, point: [f64; 3]) -> f64 {
        if self.extinction <= 0.0 || self.patchiness <= 0.0 {
            return self.extinction.max(0.0);
        }
        let v = noise::value(point.map(|c| c / self.patch_size), self.seed);
        self.extinction * (1.0 + self.patchiness * v)
    }

    /// Optical depth `∫σ dr` from `origin` along the unit `direction` over `range` metres.
    #[must_use]
    pub fn depth(&self, origin: [f64; 3], direction: [f64; 3], range: f64) -> f64 {
        if self.extinction <= 0.0 || self.patchiness <= 0.0 {
            return self.extinction.max(0.0) * range;
        }
        let steps = (range * STEPS_PER_PATCH / self.patch_size)
            .ceil()
            .clamp(1.0, MAX_STEPS);
        let step = range / steps;
        let (mut sum, mut r) = (0.0, 0.5 * step);
        while r < range {
            sum += self.at(std::array::from_fn(|a| origin[a] + r * direction[a]));
            r += step;
        }
        sum * step
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_dust_has_the_depth_of_its_way() {
        let dust = Dust {
            extinction: 0.2,
            patchiness: 0.0,
            ..Dust::NONE
        };
        assert!((dust.depth([1.0; 3], [0.0, 1.0, 0.0], 10.0) - 2.0).abs() < 1e-12);
        assert!((dust.visibility() - 19.56).abs() < 1e-9);
        assert_eq!(Dust::NONE.depth([0.0; 3], [1.0, 0.0, 0.0], 50.0), 0.0);
        assert_eq!(Dust::NONE.visibility(), f64::INFINITY);
    }

    #[test]
    fn patches_keep_the_mean_and_are_uneven() {
        let dust = Dust {
            extinction: 0.1,
            patchiness: 1.0,
            patch_size: 2.0,
            seed: 4,
        };
        let mut rng = winze::rng::Rng::new(1, 0);
        let n = 20_000;
        let all: Vec<f64> = (0..n)
            .map(|_| dust.at(std::array::from_fn(|_| rng.range(-100.0, 100.0))))
            .collect();
        let mean = all.iter().sum::<f64>() / f64::from(n);
        assert!((mean - 0.1).abs() < 0.003, "{mean}");
        assert!(all.iter().all(|s| (0.0..=0.2).contains(s)));
        let thick = all.iter().filter(|s| **s > 0.14).count();
        assert!(thick > 1000, "{thick}");
    }

    #[test]
    fn depth_is_the_integral() {
        let dust = Dust {
            extinction: 0.1,
            patchiness: 0.8,
            patch_size: 1.5,
            seed: 2,
        };
        let fine: f64 = (0..20_000)
            .map(|i| dust.at([f64::from(i) * 0.001, 0.4, 0.0]) * 0.001)
            .sum();
        let depth = dust.depth([0.0, 0.4, 0.0], [1.0, 0.0, 0.0], 20.0);
        assert!((depth / fine - 1.0).abs() < 0.01, "{depth} {fine}");
    }

    #[test]
    fn nonsense_is_refused() {
        for (dust, key) in [
            (
                Dust {
                    extinction: -1.0,
                    ..Dust::NONE
                },
                "dust.extinction",
            ),
            (
                Dust {
                    extinction: f64::NAN,
                    ..Dust::NONE
                },
                "dust.extinction",
            ),
            (
                Dust {
                    patchiness: 2.0,
                    ..Dust::NONE
                },
                "dust.patchiness",
            ),
            (
                Dust {
                    patch_size: 0.0,
                    ..Dust::NONE
                },
                "dust.patch_size",
            ),
        ] {
            let e = dust.validate().unwrap_err().to_string();
            assert!(e.starts_with(key), "{e}");
        }
        assert!(Dust::NONE.validate().is_ok());
    }
}
