//! What comes back of one shot of a ranging laser.
//!
//! The signal is counted in units of the weakest that is detected, which the range at which a target that
//! gives back 10 % is still seen fixes: `s = (ρ cosθ / 0.1) (R₁₀/R)² exp(-2∫σ)`, the LiDAR equation for a
//! diffuse target wider than the beam. Below 1 (give or take the fading of a rough surface) nothing comes.
//! The standard deviation of a range grows as the signal falls, `sd² = a² + b²/s`, as the repeatability
//! against signal-to-noise of the Ouster OS1 data sheet does (1.5, 3 and 10 cm at 250, 100 and 12).
//!
//! Dust is a soft target (Rasshofer, Spies & Spies 2011; Hahner et al., "Fog simulation on real LiDAR point
//! clouds", ICCV 2021): a stretch of air as long as half the pulse gives back what a surface of reflectivity
//! `π (σ/L) Δ` would, `L` being the lidar ratio. It competes with the wall behind it. Each stretch's share is
//! random (log-normal, mean 1): few large grains give most of the light.

use serde::{Deserialize, Serialize};
use winze::rng::Rng;
use winze::vec3::dot;

use super::ReturnOrigin;
use super::sight::{self, Met};
use crate::dust::Dust;
use crate::error::Result;
use crate::raycast::Caster;

/// Which of several echoes of a shot is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Returns {
    /// The one with most light.
    Strongest,
    /// The furthest that is detected: sees further through dust.
    Last,
}

/// The ranging of a LiDAR.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pulse {
    /// Nearest return, metres.
    pub min_range: f64,
    /// Furthest return, metres.
    pub max_range: f64,
    /// Standard deviation of a range with plenty of light, metres: `a`.
    pub range_sd: f64,
    /// What is added in squares where the signal is the weakest that is detected, metres: `b`.
    pub range_sd_weak: f64,
    /// Range at which a target that gives back 10 % head-on is still detected, metres.
    pub range_at_10_percent: f64,
    /// Share of shots lost for no reason that is modelled.
    pub dropout: f64,
    /// Full angle of the beam, degrees; 0 for a line without width.
    pub divergence_deg: f64,
    /// Half the length of the pulse in air, metres: echoes closer than this are one.
    pub pulse_length: f64,
    /// Range from which on the receiver sees the whole beam, metres; nearer, its share falls with the square.
    pub full_overlap: f64,
    /// Which echo is reported.
    pub returns: Returns,
}

/// What one shot brings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Echo {
    pub(super) range: f64,
    pub(super) first: Option<f64>,
    pub(super) origin: ReturnOrigin,
    pub(super) part: u16,
    pub(super) normal: [f64; 3],
    pub(super) intensity: f64,
}

/// Extinction over backscatter of dust, sr: about 50 for mineral dust (Müller et al. 2007), 65 in Hahner et al.
const LIDAR_RATIO: f64 = 50.0;
/// Log-normal spread of the light that a stretch of dust gives back.
const GRAIN_SPREAD: f64 = 0.8;
/// Log-normal spread of the light that a rough surface gives back, from spot to spot.
pub(super) const FADING: f64 = 0.25;
/// Light below this share is not followed through dust any further.
const GONE: f64 = 1e-9;

impl Pulse {
    /// Refuses settings without meaning.
    ///
    /// # Errors
    /// [`crate::Error::Setting`] with the key of the value and its domain.
    pub fn validate(&self) -> Result<()> {
        super::range_of_sensor("sensor.pulse", self.min_range, self.max_range)?;
        let key = |k: &str| format!("sensor.pulse.{k}");
        super::within(&key("range_sd"), self.range_sd, 0.0, 10.0, "metres")?;
        super::within(
            &key("range_sd_weak"),
            self.range_sd_weak,
            0.0,
            10.0,
            "metres",
        )?;
        let far = self.range_at_10_percent;
        super::within(&key("range_at_10_percent"), far, 0.01, 1e5, "metres")?;
        super::within(&key("dropout"), self.dropout, 0.0, 1.0, "as a share")?;
        super::within(
            &key("divergence_deg"),
            self.divergence_deg,
            0.0,
            5.0,
            "degrees",
        )?;
        super::within(
            &key("pulse_length"),
            self.pulse_length,
            0.05,
            50.0,
            "metres",
        )?;
        super::within(&key("full_overlap"), self.full_overlap, 0.0, 50.0, "metres")
    }

    /// Signal of a surface, in units of the weakest that is detected.
    ///
    /// `given_back` is reflectivity times cosine of incidence, `depth` the optical depth on the way there.
    #[must_use]
    pub fn signal(&self, given_back: f64, range: f64, depth: f64) -> f64 {
        let spread = self.range_at_10_percent / range.max(1e-3);
        given_back / 0.1 * spread * spread * self.overlap(range) * libm::exp(-2.0 * depth)
    }

    /// Standard deviation of a range measured with this signal, metres.
    #[must_use]
    pub fn range_sd_of(&self, signal: f64) -> f64 {
        // What is detected by luck of fading is not worse than the weakest.
        let weak = self.range_sd_weak * self.range_sd_weak / signal.max(1.0);
        (self.range_sd * self.range_sd + weak).sqrt()
    }

    /// Share of the beam that the receiver sees.
    fn overlap(&self, range: f64) -> f64 {
        if range >= self.full_overlap {
            return 1.0;
        }
        let share = range / self.full_overlap;
        share * share
    }

    /// One shot from `origin` along the unit `direction`, both of the world.
    pub(super) fn shoot(
        &self,
        caster: &Caster,
        air: &Dust,
        origin: [f64; 3],
        direction: [f64; 3],
        rng: &mut Rng,
    ) -> Option<Echo> {
        if rng.uniform() < self.dropout {
            return None;
        }
        let sight = sight::look(caster, origin, direction, self.max_range, rng);
        let end = sight.met.map_or(self.max_range, |m| m.range);
        // Dust beyond a mirror is met off the ray and not told from the mirror image.
        let clear = sight.first.unwrap_or(self.max_range);
        let (depth, cloud) = self.dust(air, origin, direction, end, clear, rng);
        let wall = sight.met.and_then(|met| {
            let seen = self.edge(caster, origin, direction, met, rng);
            let signal = self.signal(seen.met.reflectivity * seen.met.cosine, seen.range, depth);
            let fading = libm::exp(FADING * rng.normal());
            (signal * fading >= 1.0 && seen.range >= self.min_range).then_some((seen, signal))
        });
        // The last echo is the wall's wherever there is one.
        let dust = cloud.filter(|(_, signal)| match &wall {
            None => true,
            Some((_, wall)) => self.returns == Returns::Strongest && signal > wall,
        });
        if let Some((range, signal)) = dust {
            return Some(Echo {
                range: range.max(self.min_range),
                first: sight.first,
                origin: ReturnOrigin::Dust,
                part: u16::MAX,
                normal: [0.0; 3],
                intensity: self.reflectance(signal, range),
            });
        }
        let (seen, signal) = wall?;
        let range = seen.range + self.range_sd_of(signal) * rng.normal();
        Some(Echo {
            range: range.max(1e-3),
            first: sight.first,
            origin: seen.met.origin,
            part: seen.met.part,
            normal: seen.met.normal,
            intensity: self.reflectance(signal, seen.range),
        })
    }

    /// Reflectivity of a surface that, head-on and in clean air, would give this signal.
    fn reflectance(&self, signal: f64, range: f64) -> f64 {
        (signal / self.signal(1.0, range, 0.0)).clamp(0.0, 1.0)
    }

    /// Optical depth to `end`, and range and signal of the dust echo before `clear` that is reported.
    fn dust(
        &self,
        air: &Dust,
        origin: [f64; 3],
        direction: [f64; 3],
        end: f64,
        clear: f64,
        rng: &mut Rng,
    ) -> (f64, Option<(f64, f64)>) {
        if air.extinction <= 0.0 {
            return (0.0, None);
        }
        let step = self.pulse_length;
        let (mut depth, mut near) = (0.0, 0.0);
        let mut echo: Option<(f64, f64)> = None;
        while near < end {
            let length = step.min(end - near);
            let middle = near + 0.5 * length;
            let density = air.at(std::array::from_fn(|a| origin[a] + middle * direction[a]));
            // One draw each, whether used or not, keeps neighbouring settings comparable.
            let (grains, place) = (rng.normal(), rng.uniform());
            // Too close to the surface its echo swallows the dust's.
            if near + step <= clear && middle >= self.min_range {
                let given_back = std::f64::consts::PI * density / LIDAR_RATIO
                    * length
                    * libm::exp(GRAIN_SPREAD * grains - 0.5 * GRAIN_SPREAD * GRAIN_SPREAD);
                let signal = self.signal(given_back, middle, depth + 0.5 * density * length);
                let better = match self.returns {
                    Returns::Strongest => echo.is_none_or(|(_, s)| signal > s),
                    Returns::Last => true,
                };
                if signal >= 1.0 && better {
                    echo = Some((near + place * length, signal));
                }
            }
            depth += density * length;
            near += length;
            if libm::exp(-2.0 * depth) < GONE {
                // Neither dust nor wall is seen through this.
                depth += air.extinction * (end - near);
                break;
            }
        }
        (depth, echo)
    }

    /// A beam that hits an edge sees two surfaces: between them where its pulse cannot tell them apart, else
    /// the one that is reported.
    fn edge(
        &self,
        caster: &Caster,
        origin: [f64; 3],
        direction: [f64; 3],
        met: Met,
        rng: &mut Rng,
    ) -> Seen {
        let one = Seen {
            range: met.range,
            met,
        };
        if self.divergence_deg <= 0.0 || met.origin != ReturnOrigin::Surface {
            return one;
        }
        let aside = self.aside(direction, rng);
        let share = rng.uniform();
        let Some(hit) = caster.cast(origin, aside, self.max_range) else {
            return one;
        };
        let signal = |met: &Met| self.signal(met.reflectivity * met.cosine, met.range, 0.0);
        let flat = 3.0 * self.range_sd_of(signal(&met));
        if sight::off_plane(direction, met.range, met.normal, aside, hit.range) <= flat {
            return one;
        }
        let other = Met {
            range: hit.range,
            cosine: sight::incidence(aside, hit.normal),
            reflectivity: sight::material(caster, hit.part).0,
            part: hit.part,
            normal: hit.normal,
            origin: ReturnOrigin::Bleed,
        };
        if (other.range - met.range).abs() < self.pulse_length {
            let mixed = Met {
                origin: ReturnOrigin::Bleed,
                ..met
            };
            return Seen {
                range: met.range + share * (other.range - met.range),
                met: mixed,
            };
        }
        let (here, there) = ((1.0 - share) * signal(&met), share * signal(&other));
        let other_wins = match self.returns {
            Returns::Strongest => there > here,
            Returns::Last => there >= 1.0 && other.range > met.range,
        };
        if other_wins {
            Seen {
                range: other.range,
                met: other,
            }
        } else {
            one
        }
    }

    /// A direction within the beam.
    fn aside(&self, direction: [f64; 3], rng: &mut Rng) -> [f64; 3] {
        let half = 0.5 * self.divergence_deg.to_radians();
        let away = rng.direction();
        let along = dot(away, direction);
        let across: [f64; 3] = std::array::from_fn(|a| away[a] - along * direction[a]);
        let length = dot(across, across).sqrt().max(1e-9);
        // The root spreads the directions evenly over the beam's disc.
        let offset = half * rng.uniform().sqrt() / length;
        let d: [f64; 3] = std::array::from_fn(|a| direction[a] + offset * across[a]);
        let n = dot(d, d).sqrt();
        d.map(|c| c / n)
    }
}

/// A surface and the range at which the beam sees it.
struct Seen {
    range: f64,
    met: Met,
}
