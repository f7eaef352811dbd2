//! Sensors as a scenario writes them: a preset or a kind, and what differs from it.

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::{Sensor, presets};

/// A sensor as written in a scenario: `preset = "..."` or `kind = "spinning" | "stereo" | "solid_state"`, and
/// any of the sensor's own settings in place of those. A kind alone starts from the first preset of that kind.
///
/// ```
/// # use winze_sim::sensor::{Sensor, SensorSpec};
/// let spec: SensorSpec = toml::from_str(
///     "preset = \"vlp16\"\nshots_per_turn = 900\npulse = { returns = \"last\" }",
/// )?;
/// assert_eq!(spec.0.rays(), 16 * 900);
/// # Ok::<(), toml::de::Error>(())
/// ```
///
/// A key that the sensor does not have is an error that names it, and so is a value outside its domain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Table", into = "Sensor")]
pub struct SensorSpec(pub Sensor);

impl From<SensorSpec> for Sensor {
    fn from(spec: SensorSpec) -> Self {
        spec.0
    }
}

impl From<Sensor> for SensorSpec {
    fn from(sensor: Sensor) -> Self {
        Self(sensor)
    }
}

impl TryFrom<Table> for SensorSpec {
    type Error = String;

    fn try_from(mut written: Table) -> Result<Self, String> {
        let preset = written.remove("preset");
        let name = match (&preset, written.get("kind")) {
            (Some(Value::String(name)), _) => name.as_str(),
            (Some(_), _) => return Err("preset: must be a name in quotes".into()),
            (None, Some(Value::String(kind))) => presets::first_of(kind).ok_or_else(|| {
                format!("kind: \"{kind}\" is none of spinning, stereo, solid_state")
            })?,
            (None, Some(_)) => return Err("kind: must be a name in quotes".into()),
            (None, None) => {
                return Err(format!(
                    "a sensor needs preset = \"...\" (one of {}) or kind = \"...\" (spinning, stereo, \
                     solid_state)",
                    presets::NAMES.join(", ")
                ));
            }
        };
        let start = Sensor::preset(name).ok_or_else(|| {
            format!(
                "preset: \"{name}\" is none of {}",
                presets::NAMES.join(", ")
            )
        })?;
        let mut settings = Table::try_from(&start).map_err(|e| e.to_string())?;
        if let (Some(kind), Some(own)) = (written.get("kind"), settings.get("kind"))
            && kind != own
        {
            return Err(format!("kind: {kind}, but preset \"{name}\" is {own}"));
        }
        overlay(&mut settings, written);
        let sensor = Sensor::deserialize(settings).map_err(|e| e.message().to_owned())?;
        sensor.validate().map_err(|e| e.to_string())?;
        Ok(Self(sensor))
    }
}

/// Puts `over` in the place of what has the same key, table by table.
fn overlay(under: &mut Table, over: Table) {
    for (key, value) in over {
        match (under.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => overlay(old, new),
            // A whole number is a number.
            (Some(old @ Value::Float(_)), Value::Integer(new)) => {
                #[expect(clippy::cast_precision_loss, reason = "settings are small")]
                let new = new as f64;
                *old = Value::Float(new);
            }
            (_, value) => {
                under.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Sensor, String> {
        toml::from_str::<SensorSpec>(text)
            .map(|s| s.0)
            .map_err(|e| e.to_string())
    }

    #[test]
    fn a_preset_alone_is_the_preset_and_comes_back_as_written() {
        for name in Sensor::PRESETS {
            let sensor = read(&format!("preset = \"{name}\"")).unwrap();
            assert_eq!(Some(&sensor), Sensor::preset(name).as_ref());
            let text = toml::to_string(&SensorSpec(sensor.clone())).unwrap();
            assert_eq!(read(&text).unwrap(), sensor, "{text}");
        }
    }

    #[test]
    fn what_is_written_takes_the_preset_s_place() {
        let sensor =
            read("preset = \"d457\"\nwidth = 100\nmax_range = 8\nfield_of_view_deg = [80, 50]")
                .unwrap();
        let Sensor::Stereo(s) = sensor else {
            panic!("a stereo camera")
        };
        assert_eq!((s.width, s.max_range, s.height), (100, 8.0, 240));
        assert_eq!(s.field_of_view_deg, [80.0, 50.0]);
        let sensor =
            read("kind = \"spinning\"\n[pulse]\nrange_sd = 0.05\nreturns = \"last\"").unwrap();
        let Sensor::Spinning(s) = sensor else {
            panic!("a spinning LiDAR")
        };
        assert_eq!((s.beams, s.pulse.range_sd), (16, 0.05));
    }

    #[test]
    fn errors_name_the_key() {
        for (text, words) in [
            ("preset = \"vlp16\"\nshots = 3", "shots"),
            ("preset = \"vlp16\"\npulse = { rangesd = 3.0 }", "rangesd"),
            ("preset = \"l515\"\nbaseline = 0.1", "baseline"),
            ("preset = \"d457\"\nmin_rang = 1.0", "min_rang"),
            ("preset = \"vlp17\"", "vlp17"),
            ("kind = \"sonar\"", "sonar"),
            ("preset = \"vlp16\"\nkind = \"stereo\"", "kind"),
            ("preset = 3", "preset"),
            ("beams = 3", "preset"),
            ("preset = \"vlp16\"\nshots_per_turn = 0", "shots_per_turn"),
            (
                "preset = \"vlp16\"\nelevation_deg = [1, 2, 3]",
                "elevation_deg",
            ),
            ("preset = \"xt32\"\nbeams = 17\nshots_per_turn = -4", "-4"),
            (
                "preset = \"l515\"\npulse = { max_range = 0.0 }",
                "pulse.max_range",
            ),
            (
                "preset = \"l515\"\npulse = { returns = \"first\" }",
                "first",
            ),
        ] {
            let e = read(text).unwrap_err();
            assert!(e.contains(words), "{text}: {e}");
        }
    }
}
