//! `winze sim`: a simulated mine with its map, its queries and the truth.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use winze::Pose;
use winze_front::settings;
use winze_io::{atomic, write_cloud, write_trajectory, write_transform};
use winze_report::evaluation::quantile;
use winze_report::{Thumb, contact_sheet, thin};
use winze_sim::cases::{Case, Cases};
use winze_sim::mesh_file::{MeshReport, to_ply_bytes};
use winze_sim::scenario::{self, Made, MadeQuery, Scenario, Step};

use crate::args::{Global, Sim};
use crate::output::{claim_folder, print, talk};
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
        return show(name);
    }
    let Some(out) = &args.out else {
        bail!("--out: say where to write; --show prints the scenario instead");
    };
    if let Some(count) = args.count {
        scenario.limit(count);
    }
    let seed = settings::effective(&global.layers())?.seed;
    let making = claim(out, &scenario.name)?;
    let progress = Progress::new(global.quiet, scenario.cases() as u64);
    let mut folder = Folder::new(&making, &scenario, !args.no_mesh);
    let told = |step: Step<'_>| progress.at(step.what, step.done as u64);
    let made = (|| {
        scenario::simulate(&scenario, seed, &told, |made| folder.take(made))?;
        progress.say("contact sheets");
        let sheets = folder.sheets()?;
        let cases = Cases {
            cases: std::mem::take(&mut folder.cases),
        };
        atomic::write_bytes(&making.join(CASES), cases.to_json().as_bytes())?;
        Ok((cases, sheets))
    })();
    let (cases, sheets) = made.inspect_err(|_: &anyhow::Error| {
        // It can be large, and is of no use; if it cannot be deleted, the next run will.
        let _ = std::fs::remove_dir_all(&making);
    })?;
    put_in_place(out, &making, &scenario.name, seed)?;
    progress.finish();
    if cases.cases.is_empty() {
        talk(&format!(
            "winze: note: no queries were asked for; {} holds maps and meshes alone\n",
            out.display()
        ));
    } else if !global.quiet {
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
fn show(name: &str) -> anyhow::Result<ExitCode> {
    if let Some(text) = scenario::builtin::text(name) {
        print(text)?;
    } else {
        let text = std::fs::read_to_string(name);
        print(&text.with_context(|| format!("{name}: cannot be read"))?)?;
    }
    Ok(ExitCode::SUCCESS)
}

const CASES: &str = "cases.json";
const SIGN: &str = "README.txt";

/// Where a run writes until it is whole, in the folder that it is to be in.
const MAKING: &str = ".making";
/// Folders of what a run makes.
const FOLDERS: [&str; 5] = ["maps", "queries", "truth", "trajectories", "meshes"];

fn first_line(name: &str) -> String {
    format!("Made by `winze sim {name}`")
}

/// Takes the folder over, which must be new, empty, or an earlier run's of the same scenario, and makes a place in
/// it for this run. What the earlier run made stays until this one is whole.
fn claim(out: &Path, name: &str) -> anyhow::Result<PathBuf> {
    let first = first_line(name);
    claim_folder(out, SIGN, |sign| sign.starts_with(&first))?;
    // From here on the folder is ours, however the run ends.
    let sign = out.join(SIGN);
    if !sign.exists() {
        let text = format!("{first}, which has not ended.\n");
        atomic::write_bytes(&sign, text.as_bytes())?;
    }
    let making = out.join(MAKING);
    if making.exists() {
        std::fs::remove_dir_all(&making)
            .with_context(|| format!("{}: cannot be deleted", making.display()))?;
    }
    for folder in FOLDERS {
        let folder = making.join(folder);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    Ok(making)
}

/// Replaces what an earlier run made by what this one did. The case file goes first and comes last: a folder that
/// has one is whole.
fn put_in_place(out: &Path, making: &Path, name: &str, seed: u64) -> anyhow::Result<()> {
    let old =
        std::fs::read_dir(out).with_context(|| format!("{}: cannot be read", out.display()))?;
    let mut old: Vec<PathBuf> = old.flatten().map(|entry| entry.path()).collect();
    old.sort_by_key(|path| path.file_name().is_none_or(|f| f != CASES));
    for path in old {
        let file = path.file_name().map(|f| f.to_string_lossy().into_owned());
        let file = file.unwrap_or_default();
        let sheet = file.starts_with("contact_sheet") && file.ends_with(".png");
        let gone = if FOLDERS.contains(&file.as_str()) {
            std::fs::remove_dir_all(&path)
        } else if file == CASES || sheet {
            std::fs::remove_file(&path)
        } else {
            Ok(())
        };
        gone.with_context(|| format!("{}: cannot be deleted", path.display()))?;
    }
    let text = format!(
        "{}, seed {seed}, which writes over these files when it is run again.

cases.json          which query is asked in which map, and the right answer
maps/               the prior maps
queries/            the queries, each in a frame of its own
truth/              map_from_query of each, a 4x4 matrix, where the query lies in the map
trajectories/       where the sensor was (map frame) and where odometry believed it to be (query frame)
meshes/             the mines themselves, world frame, also as later queries found them; not with --no-mesh
contact_sheet*.png  every query on its map
",
        first_line(name)
    );
    atomic::write_bytes(&out.join(SIGN), text.as_bytes())?;
    let new = std::fs::read_dir(making)
        .with_context(|| format!("{}: cannot be read", making.display()))?;
    let mut new: Vec<PathBuf> = new.flatten().map(|entry| entry.path()).collect();
    new.sort_by_key(|path| path.file_name().is_some_and(|f| f == CASES));
    for path in new {
        let Some(file) = path.file_name() else {
            continue;
        };
        std::fs::rename(&path, out.join(file))
            .with_context(|| format!("{}: cannot be put in its place", path.display()))?;
    }
    std::fs::remove_dir_all(making)
        .with_context(|| format!("{}: cannot be deleted", making.display()))
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
            Made::Mesh {
                mine,
                later,
                mesh,
                read,
            } => {
                let name = later.map_or(mine.to_owned(), |later| format!("{mine}+{later}"));
                tracing::info!("{name}: {} triangles", mesh.triangles().len());
                if let Some(note) = read.and_then(|read| note(&name, &read)) {
                    talk(&note);
                }
                if self.mesh {
                    let path = self.out.join("meshes").join(format!("{name}.ply"));
                    atomic::write_bytes(&path, &to_ply_bytes(mesh))?;
                }
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
                    .insert(map.mine.to_owned(), thin(map.cloud, MAP_DOTS));
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
            note += &format!(", stray {}", share(made.spurious));
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
            query: thin(&made.cloud, QUERY_DOTS)
                .into_iter()
                .map(|p| home.map_or(p, |home: Pose| home.transform(p)))
                .collect(),
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

/// What a user must know of a mesh that was read from a file.
fn note(mine: &str, read: &MeshReport) -> Option<String> {
    let mut text = String::new();
    if read.origin != [0.0; 3] {
        let [x, y, z] = read.origin;
        text += &format!(
            "winze: note: mine \"{mine}\": its mesh lies far from the origin and was moved: lines, places and the map are \
             in coordinates less {x:.0}, {y:.0}, {z:.0} (set the map's origin to that to get the file's again)\n"
        );
    }
    let left = &read.left_out;
    if left.broken + left.degenerate > 0 {
        text += &format!(
            "winze: note: mine \"{mine}\": of its triangles {} have a corner that is not finite or missing and {} have no area; \
             they were left out, {} are used\n",
            left.broken, left.degenerate, read.triangles
        );
    }
    (!text.is_empty()).then_some(text)
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
            let values: Vec<f64> = cases.iter().filter_map(|c| f(c)).collect();
            quantile(&values, 0.5)
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
        let run = |seed: u64, file: &str| {
            let making = claim(&out, "dust").unwrap();
            std::fs::write(making.join("maps").join(file), "x").unwrap();
            std::fs::write(making.join(CASES), format!("{{\"seed\": {seed}}}")).unwrap();
            making
        };
        let making = run(1, "one.pcd");
        assert!(!out.join(CASES).exists(), "a run that has not ended");
        put_in_place(&out, &making, "dust", 1).unwrap();
        assert!(out.join(CASES).exists() && !making.exists());
        // A run that fails leaves what was there; one that ends replaces it.
        let making = run(2, "two.pcd");
        assert!(out.join("maps/one.pcd").exists());
        put_in_place(&out, &making, "dust", 2).unwrap();
        assert!(!out.join("maps/one.pcd").exists() && out.join("maps/two.pcd").exists());
        assert!(claim(&out, "paper").is_err(), "another scenario's");
        let other = folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        std::fs::write(other.join("thesis.txt"), "mine").unwrap();
        assert!(claim(&other, "dust").is_err());
    }
}
