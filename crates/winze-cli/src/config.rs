//! The effective settings: defaults, then a file, then `--set`, then `--seed`; and `winze config`.

use std::fmt::Write as _;
use std::process::ExitCode;

use anyhow::{Context as _, anyhow, bail};
use winze::Config;
use winze_map::Map;

use crate::args::Global;
use crate::output::print;

/// The settings that a run uses, checked.
pub(crate) fn effective(global: &Global) -> anyhow::Result<Config> {
    effective_on(toml::Table::new(), global)
}

/// The same where a map was built with settings of its own: those that shaped it stand in the place of
/// the defaults.
pub(crate) fn effective_for(map: &Map, global: &Global) -> anyhow::Result<Config> {
    let built = map.adopt(&Config::default())?;
    let table = toml::Table::try_from(&built).context("the map's settings cannot be used")?;
    effective_on(table, global)
}

/// `table`, then the file, then `--set`, then `--seed`.
fn effective_on(mut table: toml::Table, global: &Global) -> anyhow::Result<Config> {
    if let Some(path) = &global.config {
        let text = std::fs::read_to_string(path)
            .with_context(|| format!("{}: cannot be read", path.display()))?;
        let file = from_file(&text).with_context(|| path.display().to_string())?;
        lay_over(&mut table, file);
    }
    for setting in &global.set {
        set(&mut table, setting)?;
    }
    let mut config = parse(table)?;
    if let Some(seed) = global.seed {
        config.seed = seed;
    }
    config.validate()?;
    Ok(config)
}

/// Values of `over` in the place of those in `table`, section by section.
fn lay_over(table: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (table.get_mut(&key), value) {
            (Some(toml::Value::Table(own)), toml::Value::Table(value)) => lay_over(own, value),
            (_, value) => {
                table.insert(key, value);
            }
        }
    }
}

/// The table of a configuration file that is right in itself. A mistake is reported with its
/// place there, before `--set` blurs it.
fn from_file(text: &str) -> anyhow::Result<toml::Table> {
    let table: toml::Table = text.parse().map_err(|e: toml::de::Error| {
        let line = e.span().map_or(1, |s| {
            1 + text[..s.start.min(text.len())].matches('\n').count()
        });
        anyhow!("line {line}: {}", one_line(e.message()))
    })?;
    parse(table.clone())?.validate()?;
    Ok(table)
}

/// Values from a table, a wrong one named by its key.
fn parse(table: toml::Table) -> anyhow::Result<Config> {
    serde_path_to_error::deserialize(table).map_err(|e| {
        let (key, message) = (e.path().to_string(), one_line(e.inner().message()));
        anyhow!("config: {key}: {message}; `winze config` lists every key and its values")
    })
}

/// The parser's messages may span lines; ours do not.
fn one_line(message: &str) -> String {
    message.trim().replace('\n', ", ")
}

/// Applies one `KEY=VALUE`, the key a dotted path, the value TOML or a bare word.
fn set(table: &mut toml::Table, setting: &str) -> anyhow::Result<()> {
    let Some((key, value)) = setting.split_once('=') else {
        bail!("--set {setting}: write KEY=VALUE, such as scale.voxel=0.3");
    };
    let (key, value) = (key.trim(), value.trim());
    let value = format!("v = {value}")
        .parse::<toml::Table>()
        .ok()
        .and_then(|mut t| t.remove("v"))
        .unwrap_or_else(|| toml::Value::String(value.into()));
    let mut at = table;
    let mut parts = key.split('.').peekable();
    while let Some(part) = parts.next() {
        if parts.peek().is_none() {
            at.insert(part.into(), value);
            return Ok(());
        }
        let inner = at
            .entry(part)
            .or_insert_with(|| toml::Value::Table(toml::Table::new()));
        match inner {
            toml::Value::Table(t) => at = t,
            _ => bail!("--set {setting}: {part} is a value, not a section"),
        }
    }
    Ok(())
}

/// A digest of every setting, the seed included.
pub(crate) fn digest(config: &Config) -> anyhow::Result<String> {
    let text = serde_json::to_string(config).context("the settings cannot be written down")?;
    Ok(winze_io::digest(text.as_bytes()))
}

pub(crate) fn run(global: &Global) -> anyhow::Result<ExitCode> {
    print(&commented(&effective(global)?)?)?;
    Ok(ExitCode::SUCCESS)
}

/// The settings as TOML with what each one means.
fn commented(config: &Config) -> anyhow::Result<String> {
    let table = toml::Table::try_from(config).context("the settings cannot be written down")?;
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

    fn global(set: &[&str]) -> Global {
        Global {
            quiet: false,
            verbose: 0,
            threads: 0,
            config: None,
            set: set.iter().map(ToString::to_string).collect(),
            seed: None,
        }
    }

    #[test]
    fn settings_are_applied_in_order() {
        let c = effective(&global(&[
            "scale.voxel=0.3",
            "scale.voxel=0.4",
            "fpfh.radius=3 voxels",
            "icp.kernel=huber",
        ]))
        .unwrap();
        assert_eq!(c.scale.voxel, 0.4);
        assert_eq!(c.fpfh.radius, winze::config::Length::Voxels(3.0));
        assert_eq!(c.icp.kernel, winze::config::Kernel::Huber);
        assert_eq!(effective(&global(&["seed=7"])).unwrap().seed, 7);
        let seeded = Global {
            seed: Some(9),
            ..global(&["seed=7"])
        };
        assert_eq!(effective(&seeded).unwrap().seed, 9);
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
            let message = format!("{:#}", effective(&global(&[setting])).unwrap_err());
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
    fn the_printed_settings_are_the_effective_ones() {
        let config =
            effective(&global(&["scale.voxel=0.25", "ransac.inlier_distance=0.6"])).unwrap();
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
