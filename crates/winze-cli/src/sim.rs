//! `winze sim`: a simulated mine with its map, its queries and the truth.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use winze::{Cloud, Pose};
use winze_io::{atomic, write_cloud, write_trajectory, write_transform};
use winze_report::{Thumb, contact_sheet};
use winze_sim::cases::{Case, Cases};
use winze_sim::mesh_file::to_ply_bytes;
use winze_sim::scenario::{self, Made, MadeQuery, Scenario, Step};

use crate::args::{Global, Sim};
use crate::config;
use crate::output::{print, talk};
use crate::progress::Progress;

/// Points of a map and of a query on a contact sheet.
const MAP_DOTS: usize = 40_000;
const QUERY_DOTS: usize = 4_000;
/// Queries a sheet.
const A_SHEET: usize = 60;

pub(crate) fn run(args: &Sim, global: &Global) -> anyhow::Result<ExitCode> {
    let Some(name) = &args.scenario else {
        return list();
    };
    let mut scenario = Scenario::open(name)?;
    if args.show {
        return show(name, &scenario);
    }
    let Some(out) = &args.out else {
        bail!("--out: say where to write; --show prints the scenario instead");
    };
    if let Some(count) = args.count {
        scenario.limit(count);
    }
    let seed = config::effective(global)?.seed;
    claim(out, &scenario.name, seed)?;
    let progress = Progress::new(global.quiet, scenario.cases() as u64);
    let mut folder = Folder::new(out, &scenario, args.mesh);
    let told = |step: Step<'_>| progress.at(step.what, step.done as u64);
    scenario::simulate(&scenario, seed, &told, |made| folder.take(made))?;
    progress.say("contact sheets");
    let sheets = folder.sheets()?;
    // Last: a folder with a case file is whole.
    let cases = Cases {
        cases: std::mem::take(&mut folder.cases),
    };
    atomic::write_bytes(&out.join(CASES), cases.to_json().as_bytes())?;
    progress.finish();
    if !global.quiet {
        print(&shares(&cases.cases))?;
        talk(&format!(
            "\n{} cases in {1}/{CASES}; look at {1}/{2}; then:\n  winze eval {1}\n",
            cases.cases.len(),
            out.display(),
            sheets.join(", "),
        ));
    }
    Ok(ExitCode::SUCCESS)
}

fn list() -> anyhow::Result<ExitCode> {
    let mut text = String::from("built-in scenarios:\n");
    for name in scenario::builtin::names() {
        let scenario = Scenario::open(name)?;
        text += &format!(
            "  {name:<12} {:>4} cases  {}\n",
            scenario.cases(),
            scenario.about
        );
    }
    text +=
        "`winze sim NAME --show` prints one to start from; `winze sim NAME --out DIR` plays it.\n";
    print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// The scenario's text as it was written.
fn show(name: &str, scenario: &Scenario) -> anyhow::Result<ExitCode> {
    match scenario::builtin::text(name) {
        Some(text) => print(text)?,
        None => print(&toml::to_string(scenario).context("the scenario cannot be printed")?)?,
    }
    Ok(ExitCode::SUCCESS)
}

const CASES: &str = "cases.json";
const SIGN: &str = "README.txt";

/// Makes the folder, or takes one over that an earlier run of the same scenario made.
fn claim(out: &Path, name: &str, seed: u64) -> anyhow::Result<()> {
    let at = out.display();
    std::fs::create_dir_all(out).with_context(|| format!("{at}: cannot be made"))?;
    let first = format!("Made by `winze sim {name}`");
    let sign = out.join(SIGN);
    let ours = std::fs::read_to_string(&sign).is_ok_and(|t| t.starts_with(&first));
    let empty = std::fs::read_dir(out)
        .with_context(|| format!("{at}: cannot be read"))?
        .next()
        .is_none();
    if !empty && !ours {
        bail!("{at}: holds other files; give --out a folder that is new or empty");
    }
    // What an earlier run left must not be taken for this one's.
    for old in ["maps", "queries", "truth", "trajectories", "meshes"] {
        let folder = out.join(old);
        if folder.is_dir() {
            std::fs::remove_dir_all(&folder)
                .with_context(|| format!("{}: cannot be emptied", folder.display()))?;
        }
    }
    for entry in std::fs::read_dir(out)
        .with_context(|| format!("{at}: cannot be read"))?
        .flatten()
    {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name == CASES || (name.starts_with("contact_sheet") && name.ends_with(".png")) {
            std::fs::remove_file(entry.path())
                .with_context(|| format!("{}: cannot be deleted", entry.path().display()))?;
        }
    }
    for folder in ["maps", "queries", "truth", "trajectories"] {
        let folder = out.join(folder);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    let text = format!(
        "{first}, seed {seed}, which writes over these files when it is run again.

cases.json          which query is asked in which map, and the right answer
maps/               the prior maps
queries/            the queries, each in a frame of its own
truth/              map_from_query of each, a 4x4 matrix, where the query lies in the map
trajectories/       where the sensor was (map frame) and where odometry believed it to be (query frame)
meshes/             the mines themselves, where they were asked for
contact_sheet*.png  every query on its map
"
    );
    atomic::write_bytes(&sign, text.as_bytes())?;
    Ok(())
}

/// What has been written so far.
struct Folder<'a> {
    out: &'a Path,
    name: &'a str,
    /// Whether meshes are wanted.
    mesh: bool,
    cases: Vec<Case>,
    /// Dots of each map.
    maps: BTreeMap<String, Vec<[f64; 3]>>,
    thumbs: Vec<Sketch>,
}

/// A thumb before its map is known to be there.
struct Sketch {
    map: String,
    query: Vec<[f64; 3]>,
    in_map: bool,
    title: String,
    note: String,
}

impl<'a> Folder<'a> {
    fn new(out: &'a Path, scenario: &'a Scenario, mesh: bool) -> Self {
        Self {
            out,
            name: &scenario.name,
            mesh,
            cases: Vec::new(),
            maps: BTreeMap::new(),
            thumbs: Vec::new(),
        }
    }

    fn take(&mut self, made: Made<'_>) -> anyhow::Result<()> {
        match made {
            Made::Mesh { mine, mesh } if self.mesh => {
                let folder = self.out.join("meshes");
                std::fs::create_dir_all(&folder)
                    .with_context(|| format!("{}: cannot be made", folder.display()))?;
                let path = folder.join(format!("{mine}.ply"));
                atomic::write_bytes(&path, &to_ply_bytes(mesh))?;
            }
            Made::Mesh { mine, mesh } => {
                tracing::info!("{mine}: {} triangles", mesh.triangles().len());
            }
            Made::Map(map) => {
                let path = self.out.join("maps").join(format!("{}.pcd", map.mine));
                write_cloud(&path, map.cloud, &Default::default())?;
                tracing::info!(
                    "{}: a map of {} points from {} scans over {:.0} m",
                    map.mine,
                    map.cloud.len(),
                    map.scans,
                    map.way
                );
                self.maps
                    .insert(map.mine.to_owned(), dots(map.cloud, MAP_DOTS, None));
            }
            Made::Query(query) => self.query(*query)?,
        }
        Ok(())
    }

    fn query(&mut self, made: MadeQuery) -> anyhow::Result<()> {
        let case = made.case;
        write_cloud(
            &self.out.join(&case.query),
            &made.cloud,
            &Default::default(),
        )?;
        let file = case.name.replace('/', "_");
        let truth = case.truth.map(Pose::from_matrix).transpose()?;
        if let Some(truth) = &truth {
            write_transform(&self.out.join("truth").join(format!("{file}.txt")), truth)?;
        }
        for (what, frame, poses) in [
            ("true", "map_from_sensor", &made.map_from_sensor),
            ("odometry", "query_from_sensor", &made.query_from_sensor),
        ] {
            let path = self
                .out
                .join("trajectories")
                .join(format!("{file}_{what}.txt"));
            let stamped: Vec<(f64, Pose)> = made
                .seconds
                .iter()
                .copied()
                .zip(poses.iter().copied())
                .collect();
            write_trajectory(&path, frame, &stamped)?;
        }
        // A query that is not in the map is drawn where it lies in its own mine.
        let home = truth.or_else(|| {
            let (a, b) = (
                made.map_from_sensor.first()?,
                made.query_from_sensor.first()?,
            );
            Some(a.compose(&b.inverse()))
        });
        let share = |v: f64| format!("{:.0} %", 100.0 * v);
        let mut note = match (truth, case.overlap) {
            (None, _) => "not in this map".to_owned(),
            (_, Some(overlap)) => format!("overlap {}", share(overlap)),
            (_, None) => String::new(),
        };
        if made.spurious > 0.005 {
            note += &format!(", dust {}", share(made.spurious));
        }
        if case.bend_rms_m > 0.0 {
            note += &format!(", bend {:.2} m", case.bend_rms_m);
        }
        if case.ambiguous {
            note += ", ambiguous";
        }
        if !case.unobservable.is_empty() {
            note += ", can slide";
        }
        self.thumbs.push(Sketch {
            map: made.asks_in,
            query: dots(&made.cloud, QUERY_DOTS, home.as_ref()),
            in_map: truth.is_some(),
            title: format!("{} {}", case.name, case.sensor),
            note,
        });
        self.cases.push(case);
        Ok(())
    }

    /// Writes the contact sheets; their names.
    fn sheets(&self) -> anyhow::Result<Vec<String>> {
        let nothing = Vec::new();
        let several = self.thumbs.len() > A_SHEET;
        let mut names = Vec::new();
        for (i, part) in self.thumbs.chunks(A_SHEET).enumerate() {
            let thumbs: Vec<Thumb<'_>> = part
                .iter()
                .map(|s| Thumb {
                    map: self.maps.get(&s.map).unwrap_or(&nothing),
                    query: s.query.clone(),
                    in_map: s.in_map,
                    title: s.title.clone(),
                    note: s.note.clone(),
                })
                .collect();
            let name = if several {
                format!("contact_sheet_{}.png", i + 1)
            } else {
                "contact_sheet.png".to_owned()
            };
            let png = contact_sheet(&format!("scenario {}", self.name), &thumbs)?;
            atomic::write_bytes(&self.out.join(&name), &png)?;
            names.push(name);
        }
        Ok(names)
    }
}

/// Evenly drawn points of a cloud, moved.
fn dots(cloud: &Cloud, most: usize, pose: Option<&Pose>) -> Vec<[f64; 3]> {
    let step = cloud.len().div_ceil(most).max(1);
    let place = |p| pose.map_or(p, |t| t.transform(p));
    cloud.iter().step_by(step).map(place).collect()
}

/// How many cases of each family are what: nobody can shrink a denominator unseen.
fn shares(cases: &[Case]) -> String {
    let mut families: Vec<&str> = Vec::new();
    for c in cases {
        if !families.contains(&c.family.as_str()) {
            families.push(&c.family);
        }
    }
    let mut text = format!(
        "{:<26}{:>6}{:>8}{:>12}{:>11}{:>11}{:>16}{:>13}\n",
        "family",
        "cases",
        "z up",
        "not in map",
        "ambiguous",
        "can slide",
        "overlap median",
        "bend median"
    );
    let mut row = |name: &str, cases: &[&Case]| {
        let count = |f: fn(&Case) -> bool| cases.iter().filter(|c| f(c)).count();
        let median = |f: fn(&Case) -> Option<f64>| {
            let mut v: Vec<f64> = cases.iter().filter_map(|c| f(c)).collect();
            v.sort_by(f64::total_cmp);
            v.get(v.len() / 2).copied()
        };
        let show =
            |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
        text += &format!(
            "{name:<26}{:>6}{:>8}{:>12}{:>11}{:>11}{:>16}{:>13}\n",
            cases.len(),
            count(|c| c.gravity_aligned),
            count(|c| c.truth.is_none()),
            count(|c| c.ambiguous),
            count(|c| !c.unobservable.is_empty()),
            show(median(|c| c.truth.and(c.overlap)), 3),
            show(median(|c| Some(c.bend_rms_m)), 3),
        );
    };
    for family in families {
        let own: Vec<&Case> = cases.iter().filter(|c| c.family == family).collect();
        row(family, &own);
    }
    row("all", &cases.iter().collect::<Vec<_>>());
    text
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn a_folder_with_other_files_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let out: PathBuf = folder.path().join("new");
        claim(&out, "dust", 1).unwrap();
        std::fs::write(out.join(CASES), "{}").unwrap();
        claim(&out, "dust", 2).unwrap();
        assert!(
            !out.join(CASES).exists(),
            "a half-made folder has no case file"
        );
        assert!(claim(&out, "paper", 1).is_err(), "another scenario's");
        let other = folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        std::fs::write(other.join("thesis.txt"), "mine").unwrap();
        assert!(claim(&other, "dust", 1).is_err());
    }
}
