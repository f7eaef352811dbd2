//! Which settings shape a map, and whether two configurations agree on them.

use std::collections::BTreeMap;

use serde_json::Value;
use winze::Config;

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

/// Settings by their dotted keys.
pub(crate) type Built = BTreeMap<String, Value>;

/// Whether a map that was built with `built` can be asked with `asked`.
///
/// # Errors
/// [`winze::Error::Config`] for the first setting that shaped the map and is another one now;
/// [`winze::Error::Map`] for one that this winze does not know.
pub(crate) fn agree(built: &Built, asked: &Config) -> winze::Result<()> {
    let defaults: Built = shaping(&Config::default()).into_iter().collect();
    known(built, &defaults)?;
    for (key, is) in shaping(asked) {
        // A map from before there was the setting was built as if it had its default.
        let Some(was) = built.get(&key).or_else(|| defaults.get(&key)) else {
            continue;
        };
        if *was != is {
            return Err(winze::Error::Config {
                key,
                value: shown(&is),
                rule: format!(
                    "the map was built with {}; leave the setting out, or build a map with it",
                    shown(was)
                ),
            });
        }
    }
    Ok(())
}

/// `asked` with the settings that shaped a map taken from `built`; with `defaults_alone` only those that have their
/// default in `asked`.
pub(crate) fn adopted(
    built: &Built,
    asked: &Config,
    defaults_alone: bool,
) -> winze::Result<Config> {
    let defaults: Built = shaping(&Config::default()).into_iter().collect();
    known(built, &defaults)?;
    let mut all = serde_json::to_value(asked).unwrap_or_default();
    for (key, value) in built {
        if let Some((section, name)) = key.split_once('.')
            && let Some(slot) = all.get_mut(section).and_then(|s| s.get_mut(name))
            && (!defaults_alone || defaults.get(key) == Some(slot))
        {
            *slot = value.clone();
        }
    }
    let config: Config =
        serde_json::from_value(all).map_err(|e| winze::Error::Map(e.to_string()))?;
    config.validate()?;
    Ok(config)
}

/// # Errors
/// For a setting that is not among `known`.
fn known(built: &Built, known: &Built) -> winze::Result<()> {
    match built.keys().find(|key| !known.contains_key(*key)) {
        Some(key) => Err(winze::Error::Map(format!(
            "the map was built with a setting {key:?} that this winze does not know; update winze, or build the map again"
        ))),
        None => Ok(()),
    }
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
        let shaped: Built = shaping(&built).into_iter().collect();
        assert_eq!(agree(&shaped, &asked), Ok(()));
        assert_eq!(digest(&built), digest(&asked));
        asked.fpfh.radius = winze::config::Length::Voxels(5.0);
        let told = agree(&shaped, &asked).unwrap_err().to_string();
        assert!(
            told.contains("fpfh.radius = 5 voxels: the map was built with 6 voxels"),
            "{told}"
        );
        assert_ne!(digest(&built), digest(&asked));
        let mut other: Built = shaping(&asked).into_iter().collect();
        let taken = adopted(&other, &built, false).unwrap();
        assert_eq!(agree(&other, &taken), Ok(()));
        assert_eq!(taken.icp, built.icp);
        // What was asked for is not given up where only defaults are.
        asked.fpfh.radius = winze::config::Length::Voxels(7.0);
        assert_eq!(adopted(&other, &built, true).unwrap(), taken);
        assert!(agree(&other, &adopted(&other, &asked, true).unwrap()).is_err());
        // A setting that came later had its default; one that is not known yet is told.
        let mut older = shaped;
        older.remove("iss.gamma_21");
        assert_eq!(agree(&older, &built), Ok(()));
        other.insert("iss.gamma_43".into(), Value::Null);
        for told in [
            agree(&other, &built).unwrap_err(),
            adopted(&other, &built, false).unwrap_err(),
        ] {
            assert!(told.to_string().contains("iss.gamma_43"), "{told}");
        }
    }
}
