//! The effective settings: defaults, then a file, then single ones, then the seed; as text with what they mean.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context as _, anyhow, bail};
use toml::{Table, Value};
use winze::Config;
use winze_map::Map;

/// What is laid over the defaults, the later over the earlier.
#[derive(Debug, Clone, Copy, Default)]
pub struct Layers<'a> {
    /// A TOML file.
    pub file: Option<&'a Path>,
    /// Single settings, `KEY=VALUE` each, as [`set`] takes them.
    pub set: &'a [String],
    /// Seed of every random choice.
    pub seed: Option<u64>,
}

/// The settings that a run uses, checked.
///
/// # Errors
/// Where the file cannot be read, or a setting is unknown or out of its domain: the message names the key.
pub fn effective(layers: &Layers<'_>) -> anyhow::Result<Config> {
    effective_on(Table::new(), layers)
}

/// The same where a map was built with settings of its own: those that shaped it stand in the place of
/// the defaults.
///
/// # Errors
/// As [`effective`]; and where the map's settings cannot be read back.
pub fn effective_for(map: &Map, layers: &Layers<'_>) -> anyhow::Result<Config> {
    effective_on(built_with(map)?, layers)
}

/// `table`, by sections or by dotted keys, over the defaults, or over the settings that shaped a `built` map; checked.
///
/// # Errors
/// As [`effective_for`].
pub fn from_table(built: Option<&Map>, table: Table) -> anyhow::Result<Config> {
    let mut under = built.map(built_with).transpose()?.unwrap_or_default();
    for (key, value) in table {
        if key.contains('.') {
            put(&mut under, &key, value).with_context(|| format!("config: {key}"))?;
        } else {
            lay_over(&mut under, Table::from_iter([(key, value)]));
        }
    }
    let config = parse(under)?;
    config.validate()?;
    Ok(config)
}

/// The settings of a run on `map` where none are asked for.
fn built_with(map: &Map) -> anyhow::Result<Table> {
    let built = map.adopt(&Config::default())?;
    Table::try_from(&built).context("the map's settings cannot be used")
}

/// `table`, then the layers.
fn effective_on(mut table: Table, layers: &Layers<'_>) -> anyhow::Result<Config> {
    if let Some(path) = layers.file {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("{}: cannot be read", path.display()))?;
        let file = from_file(&text).with_context(|| path.display().to_string())?;
        lay_over(&mut table, file);
    }
    for setting in layers.set {
        set(&mut table, setting)?;
    }
    let mut config = parse(table)?;
    if let Some(seed) = layers.seed {
        config.seed = seed;
    }
    config.validate()?;
    Ok(config)
}

/// Values of `over` in the place of those in `table`, section by section.
fn lay_over(table: &mut Table, over: Table) {
    for (key, value) in over {
        match (table.get_mut(&key), value) {
            (Some(Value::Table(own)), Value::Table(value)) => lay_over(own, value),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// The table of a configuration file that is right in itself. A mistake is reported with its
/// place there, before `--set` blurs it.
///
/// # Errors
/// For the first mistake.
pub fn from_file(text: &str) -> anyhow::Result<Table> {
    let table: Table = text.parse().map_err(|e: toml::de::Error| {
        let line = e.span().map_or(1, |s| {
            1 + text[..s.start.min(text.len())].matches('\n').count()
        });
        anyhow!("line {line}: {}", one_line(e.message()))
    })?;
    parse(table.clone())?.validate()?;
    Ok(table)
}

/// Values from a table, a wrong one named by its key.
fn parse(table: Table) -> anyhow::Result<Config> {
    serde_path_to_error::deserialize(table).map_err(|e| {
        let (key, message) = (e.path().to_string(), one_line(e.inner().message()));
        anyhow!("config: {key}: {message}; `winze config` lists every key and its values")
    })
}

/// The parser's messages may span lines; ours do not.
fn one_line(message: &str) -> String {
    message.trim().replace('\n', ", ")
}

/// Lays one `KEY=VALUE` over `table`: the key a dotted path, the value TOML or a bare word.
///
/// # Errors
/// Where there is no `=`, or the path leads through a value. Whether there is such a setting shows later.
pub fn set(table: &mut Table, setting: &str) -> anyhow::Result<()> {
    let Some((key, value)) = setting.split_once('=') else {
        bail!("--set {setting}: write KEY=VALUE, such as scale.voxel=0.3");
    };
    let (key, value) = (key.trim(), value.trim());
    let value = format!("v = {value}")
        .parse::<Table>()
        .ok()
        .and_then(|mut t| t.remove("v"))
        .unwrap_or_else(|| Value::String(value.into()));
    put(table, key, value).with_context(|| format!("--set {setting}"))
}

/// Puts a value where a dotted path leads.
fn put(table: &mut Table, key: &str, value: Value) -> anyhow::Result<()> {
    let mut at = table;
    let mut parts = key.split('.').peekable();
    while let Some(part) = parts.next() {
        if parts.peek().is_none() {
            at.insert(part.into(), value);
            return Ok(());
        }
        let inner = at.entry(part).or_insert_with(|| Value::Table(Table::new()));
        match inner {
            Value::Table(t) => at = t,
            _ => bail!("{part} is a value, not a section"),
        }
    }
    Ok(())
}

/// A digest of every setting, the seed included.
///
/// # Errors
/// None that is known: settings can be written down.
pub fn digest(config: &Config) -> anyhow::Result<String> {
    let text = serde_json::to_string(config).context("the settings cannot be written down")?;
    Ok(winze_io::digest(text.as_bytes()))
}

/// The settings as TOML with what each one means, to start from.
///
/// # Errors
/// None that is known: settings can be written down.
pub fn commented(config: &Config) -> anyhow::Result<String> {
    let table = Table::try_from(config).context("the settings cannot be written down")?;
    let mut out = String::from(
        "# Settings of winze. A length is metres (0.5) or a multiple of the voxel size (\"3 voxels\").\n\n",
    );
    let _ = writeln!(
        out,
        "# Seed of every random choice (auto makes none).\nseed = {}",
        config.seed
    );
    for section in Config::sections() {
        let _ = writeln!(out, "\n#{}\n[{}]", section.doc.join("\n#"), section.key);
        for field in section.fields {
            let value = table.get(section.key).and_then(|s| s.get(field.name));
            let _ = writeln!(out, "#{}", field.doc.join("\n#"));
            let rule = match field.rule {
                winze::config::Rule::Any => String::new(),
                rule => format!("  # {rule}"),
            };
            let value = value.map_or_else(String::new, ToString::to_string);
            let _ = writeln!(out, "{} = {value}{rule}", field.name);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(set: &[&str]) -> anyhow::Result<Config> {
        seeded(set, None)
    }

    fn seeded(set: &[&str], seed: Option<u64>) -> anyhow::Result<Config> {
        let set: Vec<String> = set.iter().map(ToString::to_string).collect();
        effective(&Layers {
            set: &set,
            seed,
            ..Layers::default()
        })
    }

    #[test]
    fn settings_are_applied_in_order() {
        let c = with(&[
            "scale.voxel=0.3",
            "scale.voxel=0.4",
            "fpfh.radius=3 voxels",
            "icp.kernel=huber",
        ])
        .unwrap();
        assert_eq!(c.scale.voxel, 0.4);
        assert_eq!(c.fpfh.radius, winze::config::Length::Voxels(3.0));
        assert_eq!(c.icp.kernel, winze::config::Kernel::Huber);
        assert_eq!(with(&["seed=7"]).unwrap().seed, 7);
        assert_eq!(seeded(&["seed=7"], Some(9)).unwrap().seed, 9);
    }

    #[test]
    fn mistakes_are_named_in_one_line() {
        for (setting, part) in [
            ("scale.vxel=0.3", "vxel"),
            ("fpfh.radius=-1", "fpfh.radius = -1 m: must be above 0"),
            ("fpfh.radius=wide", "3 voxels"),
            ("icp.kernel=soft", "soft"),
            ("ransac", "KEY=VALUE"),
            ("seed.x=1", "config: seed: "),
            ("iss.min_neighbours=-3", "config: iss.min_neighbours: "),
            (
                "ransac.inlier_distance=true",
                "config: ransac.inlier_distance: ",
            ),
        ] {
            let message = format!("{:#}", with(&[setting]).unwrap_err());
            assert!(
                message.contains(part) && !message.contains('\n'),
                "{setting}: {message}"
            );
        }
    }

    #[test]
    fn mistakes_in_a_file_have_a_line_or_a_key() {
        let message = |text: &str| format!("{:#}", from_file(text).unwrap_err());
        assert!(
            message("seed = 1\n[iss\n").starts_with("line 2: "),
            "{}",
            message("seed = 1\n[iss\n")
        );
        assert!(
            message("[iss]\ngama = 1").contains("iss")
                && message("[iss]\ngama = 1").contains("gama")
        );
        assert!(message("[fpfh]\nradius = \"-2 voxels\"").contains("fpfh.radius = -2 voxels"));
    }

    #[test]
    fn a_table_has_sections_or_dotted_keys() {
        let of = |text: &str| from_table(None, text.parse().unwrap());
        let c = of("seed = 3\n\"fpfh.radius\" = 2.5\n[scale]\nvoxel = 0.4").unwrap();
        assert_eq!((c.seed, c.scale.voxel), (3, 0.4));
        assert_eq!(c.fpfh.radius, winze::config::Length::Metres(2.5));
        assert_eq!(of("").unwrap(), Config::default());
        for (text, part) in [
            ("[scale]\nvxel = 1", "vxel"),
            ("\"icp.kernel\" = \"soft\"", "config: icp.kernel: "),
            (
                "seed = 1\n\"seed.x\" = 2",
                "config: seed.x: seed is a value",
            ),
            ("fpfh = 3", "config: fpfh: "),
        ] {
            let message = format!("{:#}", of(text).unwrap_err());
            assert!(message.contains(part), "{text}: {message}");
        }
        let e = of("[fpfh]\nradius = -1.0").unwrap_err();
        assert!(e.chain().any(<dyn std::error::Error>::is::<winze::Error>));
    }

    #[test]
    fn the_printed_settings_are_the_effective_ones() {
        let config = with(&["scale.voxel=0.25", "ransac.inlier_distance=0.6"]).unwrap();
        let text = commented(&config).unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), config);
        assert!(text.contains("# Voxel size in metres"));
        assert_eq!(digest(&config).unwrap(), digest(&config.clone()).unwrap());
        assert_ne!(
            digest(&config).unwrap(),
            digest(&Config::default()).unwrap()
        );
    }
}
