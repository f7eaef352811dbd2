//! Well-known units.
//!
//! | preset | unit | rays a scan | range, m | noise, one standard deviation |
//! |---|---|---|---|---|
//! | `vlp16` | Velodyne VLP-16 "Puck" | 16 × 1800 at 10 Hz, ±15° | 1 to 100 | 20 mm, growing |
//! | `xt32` | Hesai PandarXT-32 | 32 × 2000 at 10 Hz, −16° to 15° | 0.05 to 120 | 5 mm, growing |
//! | `os0_128` | Ouster OS0-128 | 128 × 1024 at 10 Hz, ±45° | 0.3 to 75 | 8 mm, growing to 50 mm |
//! | `d457` | RealSense D457 | 424 × 240 of 1280 × 720 at 30 Hz, 87° × 58° | 0.52 to 10 | 20 mm at 4 m, by depth squared |
//! | `l515` | RealSense L515 | 320 × 240 of 1024 × 768 at 30 Hz, 70° × 55° | 0.25 to 9 | 2.5 mm at 1 m, 15.5 mm at 9 m |
//!
//! Sources are named at each unit. Figures marked *common* are as commonly published and could not be checked
//! against the maker's own page; those marked *assumed* are published nowhere and chosen here. For all of
//! them the echo's length, the overlap of beam and receiver and the share of dropouts are assumed.
//!
//! Rotation is one rate of several that a unit offers; depth cameras have fewer pixels than the unit, since a
//! registration thins them out anyway: `width`, `height` set more.

use super::pulse::{Pulse, Returns};
use super::{Sensor, SolidState, Spinning, Stereo};

/// Names of the presets.
pub(super) const NAMES: &[&str] = &["vlp16", "xt32", "os0_128", "d457", "l515"];

/// The preset of a name.
pub(super) fn by_name(name: &str) -> Option<Sensor> {
    match name {
        "vlp16" => Some(Sensor::Spinning(vlp16())),
        "xt32" => Some(Sensor::Spinning(xt32())),
        "os0_128" => Some(Sensor::Spinning(os0_128())),
        "d457" => Some(Sensor::Stereo(d457())),
        "l515" => Some(Sensor::SolidState(l515())),
        _ => None,
    }
}

/// The preset that a kind of sensor starts from.
pub(super) fn first_of(kind: &str) -> Option<&'static str> {
    match kind {
        "spinning" => Some("vlp16"),
        "stereo" => Some("d457"),
        "solid_state" => Some("l515"),
        _ => None,
    }
}

/// Velodyne VLP-16.
///
/// Source: user manual 63-9243 Rev. D: 16 beams 2° apart from −15° to 15° (table 9-1), all fired every
/// 55.296 µs (section 8.1), so 1808 shots a turn at 10 Hz, here 1800 (0.2°); strongest, last or dual return;
/// range "from 1 m to 100 m" (earlier revision, page 3). Data sheet 63-9229: accuracy ±3 cm, typical.
/// No standard deviation is published; 20 mm with plenty of signal is assumed, which the root mean square of
/// 22 to 27 mm found on planes by Glennie, Kusari & Facchin (2016) bounds (*common*). Detection of 10 % at
/// 50 m: *assumed*. Divergence 3 mrad × 1.5 mrad (*common*), here 0.13°.
#[must_use]
pub fn vlp16() -> Spinning {
    Spinning {
        beams: 16,
        elevation_deg: vec![-15.0, 15.0],
        shots_per_turn: 1800,
        turns_per_second: 10.0,
        pulse: Pulse {
            min_range: 1.0,
            max_range: 100.0,
            range_sd: 0.02,
            range_sd_weak: 0.03,
            range_at_10_percent: 50.0,
            dropout: 0.005,
            divergence_deg: 0.13,
            pulse_length: 0.9,
            full_overlap: 2.0,
            returns: Returns::Strongest,
        },
    }
}

/// Hesai PandarXT-32.
///
/// Source: data sheet (*common*): 32 beams 1° apart from −16° to 15°, 0.18° at 10 Hz, 0.05 to 120 m, 80 m at
/// 10 %, precision 5 mm (one standard deviation). Range and step agree with the constants of the Nebula driver
/// (`min_range` 0.05, `max_range` 120, `peak_resolution` 0.18° × 1°). Noise at the weakest signal of 20 mm
/// and divergence of 0.1°: *assumed*.
#[must_use]
pub fn xt32() -> Spinning {
    Spinning {
        beams: 32,
        elevation_deg: vec![-16.0, 15.0],
        shots_per_turn: 2000,
        turns_per_second: 10.0,
        pulse: Pulse {
            min_range: 0.05,
            max_range: 120.0,
            range_sd: 0.005,
            range_sd_weak: 0.02,
            range_at_10_percent: 80.0,
            dropout: 0.005,
            divergence_deg: 0.1,
            pulse_length: 0.6,
            full_overlap: 2.0,
            returns: Returns::Strongest,
        },
    }
}

/// Ouster OS0-128.
///
/// Source: field of view of 90° from the maker's pages; data sheet of revision 7 (*common*): 0.3 to 75 m at
/// 80 %, 35 m at 10 %, precision 8 to 40 mm, divergence 0.35°. That noise goes with the inverse root of the
/// signal is the OS1's data sheet: repeatability 15, 30, 100 mm at a signal-to-noise ratio of 250, 100, 12.
#[must_use]
pub fn os0_128() -> Spinning {
    Spinning {
        beams: 128,
        elevation_deg: vec![-45.0, 45.0],
        shots_per_turn: 1024,
        turns_per_second: 10.0,
        pulse: Pulse {
            min_range: 0.3,
            max_range: 75.0,
            range_sd: 0.008,
            range_sd_weak: 0.05,
            range_at_10_percent: 35.0,
            dropout: 0.005,
            divergence_deg: 0.35,
            pulse_length: 0.9,
            full_overlap: 1.5,
            returns: Returns::Strongest,
        },
    }
}

/// RealSense D457: the depth module D450 behind a plug for vehicles.
///
/// Source: maker's page of the D455f, of the same module, and D400 series data sheet 337029: 87° × 58°,
/// 1280 × 720, least depth 0.52 m at full resolution, ideal range 0.6 to 6 m, error below 2 % at 4 m; baseline
/// 95 mm (*common*). Subpixel error of 0.08 px: RealSense "Tuning depth cameras for best performance"
/// (*common*), split here into a pixel's own and the neighbours' (*assumed*); that gives 0.5 % at 4 m, and
/// steps of 1/32 px from "Subpixel linearity improvement for RealSense depth cameras". Edges and texture:
/// *assumed*.
#[must_use]
pub fn d457() -> Stereo {
    Stereo {
        width: 424,
        height: 240,
        native_width: 1280,
        field_of_view_deg: [87.0, 58.0],
        scans_per_second: 30.0,
        baseline: 0.095,
        min_range: 0.52,
        max_range: 10.0,
        disparity_sd: 0.05,
        disparity_sd_shared: 0.0625,
        shared_over: 24.0,
        disparity_step: 0.03125,
        bleed: 0.5,
        texture_size: 0.5,
        featureless: 0.8,
        min_contrast: 0.1,
        max_incidence_deg: 80.0,
        dropout: 0.01,
    }
}

/// RealSense L515.
///
/// Source: maker's page: 70° × 55°, 1024 × 768 at 30 Hz, 0.25 to 9 m. Data sheet revision 003 (*common*):
/// standard deviation 2.5 mm at 1 m and 15.5 mm at 9 m on a target of 95 %. Through these two goes
/// `sd² = (1.82 mm)² + (1.71 mm · R/1 m)²`, the second part being the weakening signal's, so 15.4 mm where
/// the signal is the weakest, at 9 m and 95 %: 10 % is then seen to 2.92 m. The mean error of 5 mm at 1 m to
/// 14 mm at 9 m is left out, as are all offsets that do not change from scan to scan. It sends a code rather
/// than a pulse; in dust a pulse of 0.5 m stands for it (*assumed*).
#[must_use]
pub fn l515() -> SolidState {
    SolidState {
        width: 320,
        height: 240,
        field_of_view_deg: [70.0, 55.0],
        scans_per_second: 30.0,
        pulse: Pulse {
            min_range: 0.25,
            max_range: 9.0,
            range_sd: 0.001_82,
            range_sd_weak: 0.015_39,
            range_at_10_percent: 2.92,
            dropout: 0.01,
            divergence_deg: 0.08,
            pulse_length: 0.5,
            full_overlap: 0.5,
            returns: Returns::Strongest,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_sound_and_every_kind_has_one() {
        for name in NAMES {
            let sensor = by_name(name).unwrap();
            sensor.validate().unwrap();
            assert!(sensor.rays() > 10_000 && sensor.rate() >= 10.0, "{name}");
        }
        for kind in ["spinning", "stereo", "solid_state"] {
            assert!(by_name(first_of(kind).unwrap()).is_some());
        }
        assert!(by_name("vlp").is_none());
    }

    #[test]
    fn presets_meet_their_data_sheets() {
        let l515 = Sensor::SolidState(l515());
        let sd = |r| l515.noise_along([1.0, 0.0, 0.0], r, 0.95);
        assert!((sd(1.0) - 0.0025).abs() < 5e-5, "{}", sd(1.0));
        assert!((sd(9.0) - 0.0155).abs() < 1e-4, "{}", sd(9.0));
        let d457 = Sensor::Stereo(d457());
        assert!(d457.noise_at(4.0) < 0.02 * 4.0);
        assert!(
            (d457.noise_at(4.0) - 0.02).abs() < 0.001,
            "{}",
            d457.noise_at(4.0)
        );
        let ratio = d457.noise_at(6.0) / d457.noise_at(3.0);
        assert!((ratio - 4.0).abs() < 1e-9, "{ratio}");
        let xt32 = Sensor::Spinning(xt32());
        assert!((xt32.noise_at(5.0) - 0.005).abs() < 1e-4);
        assert!((vlp16().elevation(1).to_degrees() + 13.0).abs() < 1e-9);
        assert!((super::xt32().elevation(31).to_degrees() - 15.0).abs() < 1e-9);
    }

    #[test]
    fn settings_outside_their_domain_are_refused() {
        let pulse = |change: fn(&mut Pulse)| {
            let mut s = vlp16();
            change(&mut s.pulse);
            Sensor::Spinning(s).validate().unwrap_err().to_string()
        };
        for (e, key) in [
            (pulse(|p| p.max_range = 0.0), "sensor.pulse.max_range"),
            (pulse(|p| p.max_range = 0.5), "sensor.pulse.max_range"),
            (pulse(|p| p.min_range = -1.0), "sensor.pulse.min_range"),
            (pulse(|p| p.range_sd = f64::NAN), "sensor.pulse.range_sd"),
            (pulse(|p| p.dropout = 1.5), "sensor.pulse.dropout"),
            (pulse(|p| p.pulse_length = 0.0), "sensor.pulse.pulse_length"),
        ] {
            assert!(e.starts_with(key), "{e}");
        }
        let stereo = |change: fn(&mut Stereo)| {
            let mut s = d457();
            change(&mut s);
            Sensor::Stereo(s).validate().unwrap_err().to_string()
        };
        for (e, key) in [
            (stereo(|s| s.baseline = 0.0), "sensor.baseline"),
            (stereo(|s| s.height = 0), "sensor.height"),
            (
                stereo(|s| s.field_of_view_deg[1] = 180.0),
                "sensor.field_of_view_deg",
            ),
            (stereo(|s| s.max_range = 0.1), "sensor.max_range"),
        ] {
            assert!(e.starts_with(key), "{e}");
        }
    }
}
