//! Which settings shape a map, and whether two configurations agree on them.

use serde_json::Value;
use winze::Config;

use crate::error::Result;

/// Sections whose settings shape a map, with the ones that concern queries alone or that do.
const SHAPING: &[(&str, Names)] = &[
    ("scale", Names::Only(&["voxel"])),
    ("prepare", Names::AllBut(&["min_range", "max_range"])),
    ("iss", Names::AllBut(&["max_keypoints"])),
    ("fpfh", Names::AllBut(&[])),
    (
        "ndt",
        Names::Only(&["coarsest", "finest", "min_points", "eigenvalue_floor"]),
    ),
];

#[derive(Debug, Clone, Copy)]
enum Names {
    Only(&'static [&'static str]),
    AllBut(&'static [&'static str]),
}

impl Names {
    fn hold(self, name: &str) -> bool {
        match self {
            Self::Only(names) => names.contains(&name),
            Self::AllBut(names) => !names.contains(&name),
        }
    }
}

/// The settings of `config` that shape a map, by their dotted keys, in order.
pub(crate) fn shaping(config: &Config) -> Vec<(String, Value)> {
    let all = serde_json::to_value(config).unwrap_or_default();
    let mut found = Vec::new();
    for (section, names) in SHAPING {
        let fields = all.get(section).and_then(Value::as_object);
        for (name, value) in fields.into_iter().flatten() {
            if names.hold(name) {
                found.push((format!("{section}.{name}"), value.clone()));
            }
        }
    }
    found
}

/// A digest of the settings that shape a map.
pub(crate) fn digest(config: &Config) -> String {
    let text: Vec<String> = shaping(config)
        .into_iter()
        .map(|(key, value)| format!("{key}={value}"))
        .collect();
    winze_io::digest(text.join("\n").as_bytes())
}

/// Whether a map that was built with `built` can be asked with `asked`.
///
/// # Errors
/// [`winze::Error::Config`] for the first setting that shaped the map and is another one now.
pub(crate) fn agree(built: &Config, asked: &Config) -> winze::Result<()> {
    for ((key, was), (_, is)) in shaping(built).into_iter().zip(shaping(asked)) {
        if was != is {
            return Err(winze::Error::Config {
                key,
                value: shown(&is),
                rule: format!(
                    "the map was built with {}; leave the setting out, or build a map with it",
                    shown(&was)
                ),
            });
        }
    }
    Ok(())
}

/// `asked` with the settings that shaped a map taken from `built`.
pub(crate) fn adopted(built: &Config, asked: &Config) -> Result<Config> {
    let mut all = serde_json::to_value(asked).unwrap_or_default();
    for (key, value) in shaping(built) {
        if let Some((section, name)) = key.split_once('.')
            && let Some(slot) = all.get_mut(section).and_then(|s| s.get_mut(name))
        {
            *slot = value;
        }
    }
    serde_json::from_value(all).map_err(|e| winze::Error::Map(e.to_string()).into())
}

fn shown(value: &Value) -> String {
    value
        .as_str()
        .map_or_else(|| value.to_string(), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_shapes_a_map_matters() {
        let built = Config::default();
        let mut asked = built.clone();
        asked.seed = 9;
        asked.prepare.max_range = 30.0;
        asked.iss.max_keypoints = 7;
        asked.icp.max_iterations = 3;
        asked.ndt.max_iterations = 3;
        asked.scale.tries = 1;
        assert_eq!(agree(&built, &asked), Ok(()));
        assert_eq!(digest(&built), digest(&asked));
        asked.fpfh.radius = winze::config::Length::Voxels(5.0);
        let told = agree(&built, &asked).unwrap_err().to_string();
        assert!(
            told.contains("fpfh.radius = 5 voxels: the map was built with 6 voxels"),
            "{told}"
        );
        assert_ne!(digest(&built), digest(&asked));
        let adopted = adopted(&asked, &built).unwrap();
        assert_eq!(agree(&asked, &adopted), Ok(()));
        assert_eq!(adopted.icp, built.icp);
    }
}
