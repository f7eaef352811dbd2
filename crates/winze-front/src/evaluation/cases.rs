//! `cases.json`: what to evaluate, and what is true.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use winze::Pose;
use winze::degeneracy::DirectionKind;
use winze_io::digest;
use winze_report::evaluation::{Case as Truth, Direction, Tolerance};

use crate::mines::CASES;

/// One case as the file holds it, its paths made to count from where the program runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Case {
    /// Its name, unlike any other's.
    pub name: String,
    /// The prior map's file.
    pub map: PathBuf,
    /// The query's file.
    pub query: PathBuf,
    truth: Option<Matrix>,
    #[serde(default)]
    tolerance: Option<ToleranceRow>,
    /// Map and query both have z up.
    #[serde(default)]
    pub gravity_aligned: bool,
    #[serde(default)]
    ambiguous: bool,
    #[serde(default)]
    alternatives: Vec<Matrix>,
    #[serde(default)]
    unobservable: Vec<DirectionRow>,
    /// What kind of case it is.
    #[serde(default = "no_family")]
    pub family: String,
    /// What the query was seen with, if the file tells.
    #[serde(default)]
    pub sensor: String,
    /// Share of the query that the map holds, if the file tells.
    #[serde(default)]
    pub overlap: Option<f64>,
    /// How far odometry bent the query, root mean square, metres, if the file tells.
    #[serde(default)]
    pub bend_rms_m: Option<f64>,
}

type Matrix = [[f64; 4]; 4];

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct ToleranceRow {
    translation_m: f64,
    rotation_deg: f64,
}

/// A bare vector is a sliding direction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum DirectionRow {
    Slide([f64; 3]),
    Named { kind: KindRow, direction: [f64; 3] },
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum KindRow {
    Translation,
    Rotation,
}

fn no_family() -> String {
    "-".into()
}

/// The case file that `path` names: itself, or the `cases.json` in the folder.
pub fn file_of(path: &Path) -> PathBuf {
    if path.is_dir() {
        path.join(CASES)
    } else {
        path.to_owned()
    }
}

/// Reads and checks all cases of a file; with its digest.
///
/// # Errors
/// As [`parse`]; and where the file cannot be read.
pub fn read(file: &Path) -> anyhow::Result<(Vec<Case>, String)> {
    let at = file.display();
    let text = std::fs::read(file).with_context(|| {
        format!("{at}: cannot be read; give a cases.json or a folder that holds one")
    })?;
    let folder = file.parent().unwrap_or(Path::new(""));
    let cases = parse(&text, folder).with_context(|| at.to_string())?;
    Ok((cases, digest(&text)))
}

/// The cases in a case file's text, checked; their paths count from `folder`.
///
/// # Errors
/// Where it is no case file, or a case lacks something or contradicts itself: the message names case and field.
pub fn parse(text: &[u8], folder: &Path) -> anyhow::Result<Vec<Case>> {
    let value: Value = serde_json::from_slice(text).context("no JSON")?;
    let Some(rows) = value.get("cases").and_then(Value::as_array) else {
        bail!("cases: missing, or no list");
    };
    let mut cases: Vec<Case> = Vec::with_capacity(rows.len());
    for (i, row) in rows.iter().enumerate() {
        let name = row.get("name").and_then(Value::as_str).unwrap_or("no name");
        let place = || format!("case {} ({name})", i + 1);
        let case = one(row, folder).with_context(place)?;
        if cases.iter().any(|c| c.name == case.name) {
            bail!("{}: name: another case has it too", place());
        }
        cases.push(case);
    }
    Ok(cases)
}

fn one(row: &Value, folder: &Path) -> anyhow::Result<Case> {
    // Taken for absent, a forgotten truth would count every right answer as wrong.
    if row.is_object() && row.get("truth").is_none() {
        bail!("truth: missing; write null where the query is not in the map");
    }
    let mut case: Case = serde_path_to_error::deserialize(row)
        .map_err(|e| anyhow!("{}: {}", e.path(), e.inner()))?;
    case.truth()?;
    case.map = folder.join(&case.map);
    case.query = folder.join(&case.query);
    Ok(case)
}

impl Case {
    /// What is true of it.
    ///
    /// # Errors
    /// Where a pose is not rigid (a [`winze::Error`]), a tolerance not above 0, or a direction without length.
    pub fn truth(&self) -> anyhow::Result<Truth> {
        let pose = |field: &'static str, m: &Matrix| Pose::from_matrix(*m).context(field);
        let tolerance = match self.tolerance {
            None => Tolerance::default(),
            Some(t) if t.translation_m > 0.0 && t.rotation_deg > 0.0 => Tolerance {
                translation: t.translation_m,
                rotation: t.rotation_deg.to_radians(),
            },
            Some(_) => bail!("tolerance: must be above 0"),
        };
        let alternatives = self.alternatives.iter().map(|m| pose("alternatives", m));
        let unobservable = self.unobservable.iter().map(DirectionRow::direction);
        Ok(Truth {
            truth: self.truth.as_ref().map(|m| pose("truth", m)).transpose()?,
            tolerance,
            ambiguous: self.ambiguous,
            alternatives: alternatives.collect::<anyhow::Result<_>>()?,
            unobservable: unobservable.collect::<anyhow::Result<_>>()?,
        })
    }
}

impl DirectionRow {
    fn direction(&self) -> anyhow::Result<Direction> {
        let (kind, v) = match self {
            Self::Slide(v) => (DirectionKind::Translation, v),
            Self::Named { kind, direction } => match kind {
                KindRow::Translation => (DirectionKind::Translation, direction),
                KindRow::Rotation => (DirectionKind::Rotation, direction),
            },
        };
        let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
        if !(length > 1e-9 && length.is_finite()) {
            bail!("unobservable: a direction has no length");
        }
        Ok(Direction {
            kind,
            direction: v.map(|c| c / length),
        })
    }
}

/// Which of the cases to run.
#[derive(Debug, Default)]
pub struct Choice<'a> {
    /// Names, with `*` for anything; none: all.
    pub only: &'a [String],
    /// Families likewise.
    pub family: &'a [String],
    /// Of those, every so manieth.
    pub every: usize,
}

impl Choice<'_> {
    /// The chosen cases in the order of the file.
    pub fn of(&self, cases: Vec<Case>) -> Vec<Case> {
        let any = |patterns: &[String], text: &str| {
            patterns.is_empty() || patterns.iter().any(|p| matches(p, text))
        };
        cases
            .into_iter()
            .filter(|c| any(self.only, &c.name) && any(self.family, &c.family))
            .step_by(self.every.max(1))
            .collect()
    }
}

/// Whether `text` is as `pattern` says, in which `*` stands for anything, also nothing.
fn matches(pattern: &str, text: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else {
        return pattern == text;
    };
    let Some(text) = text.strip_prefix(first) else {
        return false;
    };
    let mut ends = text.char_indices().map(|(i, _)| i).chain([text.len()]);
    ends.any(|i| matches(rest, &text[i..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: &str = "[[1,0,0,5],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";

    fn cases(rest: &str) -> anyhow::Result<Vec<Case>> {
        let text = format!(
            r#"{{"made_by": "x", "cases": [{{"name": "a/1", "map": "m.pcd", "query": "q.pcd", {rest}}}]}}"#
        );
        parse(text.as_bytes(), Path::new("folder"))
    }

    #[test]
    fn a_full_case_and_a_bare_one() {
        let full = format!(
            r#""truth": {TRUTH}, "bend_rms_m": 0.04, "tolerance": {{"translation_m": 0.4, "rotation_deg": 180.0}},
            "gravity_aligned": true, "overlap": 0.9, "ambiguous": true, "alternatives": [{TRUTH}], "new key": 7,
            "unobservable": [[2, 0, 0], {{"kind": "rotation", "direction": [0, 0, 1], "information": 0.0}}],
            "family": "simulated", "sensor": "lidar32""#
        );
        let case = cases(&full).unwrap().remove(0);
        assert_eq!(case.map, Path::new("folder/m.pcd"));
        assert_eq!(
            (case.family.as_str(), case.gravity_aligned),
            ("simulated", true)
        );
        let truth = case.truth().unwrap();
        assert_eq!(truth.truth.unwrap().translation(), [5.0, 0.0, 0.0]);
        assert_eq!(truth.tolerance.rotation, std::f64::consts::PI);
        assert_eq!(truth.unobservable[0].direction, [1.0, 0.0, 0.0]);
        assert_eq!(truth.unobservable[1].kind, DirectionKind::Rotation);
        assert_eq!(truth.alternatives.len(), 1);
        assert_eq!(
            (case.sensor.as_str(), case.overlap, case.bend_rms_m),
            ("lidar32", Some(0.9), Some(0.04))
        );
        let bare = cases(r#""truth": null"#).unwrap().remove(0);
        assert_eq!(bare.truth().unwrap(), Truth::default());
        // As it goes to a worker.
        let text = serde_json::to_string(&case).unwrap();
        assert_eq!(serde_json::from_str::<Case>(&text).unwrap(), case);
    }

    #[test]
    fn mistakes_are_named_by_case_and_field() {
        for (rest, part) in [
            (r#""family": "x""#, "case 1 (a/1): truth: missing"),
            (r#""truth": [[1,2],[3,4]]"#, "case 1 (a/1): truth"),
            (
                r#""truth": [[2,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"#,
                "truth: not a rigid",
            ),
            (
                r#""truth": null, "ambiguous": 3"#,
                "ambiguous: invalid type",
            ),
            (
                r#""truth": null, "tolerance": {"translation_m": 0, "rotation_deg": 5}"#,
                "tolerance: must",
            ),
            (
                r#""truth": null, "tolerance": {"translation_m": 1}"#,
                "rotation_deg",
            ),
            (r#""truth": null, "unobservable": [[0,0,0]]"#, "no length"),
            (
                r#""truth": null, "unobservable": [{"kind": "up", "direction": [0,0,1]}]"#,
                "unobservable[0]",
            ),
        ] {
            let message = format!("{:#}", cases(rest).unwrap_err());
            assert!(message.contains(part), "{rest}: {message}");
        }
        let twice = r#""truth": null}, {"name": "a/1", "map": "m", "query": "q", "truth": null"#;
        assert!(format!("{:#}", cases(twice).unwrap_err()).contains("case 2 (a/1): name"));
        for text in ["", "[]", r#"{"cases": 3}"#, r#"{"cases": [7]}"#] {
            assert!(parse(text.as_bytes(), Path::new("")).is_err(), "{text}");
        }
    }

    #[test]
    fn cases_are_chosen_by_name_family_and_stride() {
        let all: Vec<Case> = (0..6)
            .map(|i| {
                let mut c = cases(r#""truth": null"#).unwrap().remove(0);
                c.name = format!("mine_{}/lidar_{i}", i % 2);
                c.family = if i < 4 { "near" } else { "far" }.into();
                c
            })
            .collect();
        let names = |only: &[&str], family: &[&str], every| -> Vec<String> {
            let owned = |l: &[&str]| l.iter().map(ToString::to_string).collect::<Vec<_>>();
            let (only, family) = (owned(only), owned(family));
            let choice = Choice {
                only: &only,
                family: &family,
                every,
            };
            choice.of(all.clone()).into_iter().map(|c| c.name).collect()
        };
        assert_eq!(names(&[], &[], 1).len(), 6);
        assert_eq!(
            names(&["mine_1/*"], &["n*r"], 1),
            ["mine_1/lidar_1", "mine_1/lidar_3"]
        );
        assert_eq!(names(&["mine_0/lidar_0", "*_5"], &[], 1).len(), 2);
        assert_eq!(
            names(&[], &["near"], 3),
            ["mine_0/lidar_0", "mine_1/lidar_3"]
        );
        assert!(names(&["mine"], &[], 1).is_empty());
        assert!(matches("*", "") && matches("a*b*c", "a--b-bc") && !matches("a*b", "abc"));
    }
}
