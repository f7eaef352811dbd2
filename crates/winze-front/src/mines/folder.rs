//! What a scenario makes, written as it comes.

use std::collections::BTreeMap;
use std::path::Path;

use winze::Pose;
use winze_io::{atomic, write_cloud, write_trajectory, write_transform};
use winze_report::thin;
use winze_sim::cases::Case;
use winze_sim::mesh_file::to_ply_bytes;
use winze_sim::scenario::{Made, MadeQuery, Scenario};

use super::sheets::{self, Sketch};
use super::{Told, notes};

/// Points of a map and of a query on a contact sheet.
const MAP_DOTS: usize = 40_000;
const QUERY_DOTS: usize = 4_000;

/// What has been written so far.
pub(super) struct Folder<'a> {
    out: &'a Path,
    name: &'a str,
    /// Whether meshes are wanted.
    mesh: bool,
    told: &'a (dyn Fn(Told<'_>) + Sync),
    pub(super) cases: Vec<Case>,
    pub(super) notes: Vec<String>,
    /// Dots of each map.
    maps: BTreeMap<String, Vec<[f64; 3]>>,
    sketches: Vec<Sketch>,
}

impl<'a> Folder<'a> {
    pub(super) fn new(
        out: &'a Path,
        scenario: &'a Scenario,
        mesh: bool,
        told: &'a (dyn Fn(Told<'_>) + Sync),
    ) -> Self {
        Self {
            out,
            name: &scenario.name,
            mesh,
            told,
            cases: Vec::new(),
            notes: Vec::new(),
            maps: BTreeMap::new(),
            sketches: Vec::new(),
        }
    }

    pub(super) fn take(&mut self, made: Made<'_>) -> anyhow::Result<()> {
        match made {
            Made::Mesh {
                mine,
                later,
                mesh,
                read,
            } => {
                let name = later.map_or(mine.to_owned(), |later| format!("{mine}+{later}"));
                tracing::info!("{name}: {} triangles", mesh.triangles().len());
                for note in read.map_or_else(Vec::new, |read| notes::of(&name, &read)) {
                    (self.told)(Told::Note(&note));
                    self.notes.push(note);
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
        self.sketches.push(Sketch {
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
    pub(super) fn sheets(&self) -> anyhow::Result<Vec<String>> {
        sheets::write(self.out, self.name, &self.maps, &self.sketches)
    }
}
