//! From how far away does each refiner come home, and does a second one widen the basin?
//!
//! Prints the tables of `docs/refinement.md` as Markdown, writes every start to a CSV file and the picture
//! as SVG. Needs no data: the mines are simulated.
//!
//! ```sh
//! cargo run --release --example study_basin -- basin.csv basin.svg
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::fmt::Write as _;

use common::mine::{Route, Trip, scene};
use common::{Result, picture};
use rayon::prelude::*;
use winze::config::{Config, IcpConfig, IcpMetric, Length};
use winze::ndt::NdtCells;
use winze::prepare::{Surface, prepare};
use winze::rng::Rng;
use winze::{Pose, icp, ndt, scale};

const MINES: u64 = 6;
/// Starts at each offset of a sweep in each mine, and in each cell of the grid.
const STARTS: [u64; 2] = [10, 3];
const DUST: [(&str, f64); 3] = [("no dust", 0.0), ("middle dust", 0.15), ("heavy dust", 0.5)];
const METRES: [f64; 10] = [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0];
const DEGREES: [f64; 9] = [0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 135.0, 180.0];
/// The other half of a sweep's offsets.
const BESIDE: (f64, f64) = (0.25, 5.0);
const GRID: ([f64; 3], [f64; 3]) = ([1.0, 2.0, 3.0], [15.0, 30.0, 45.0]);
const REFINERS: [&str; 6] = [
    "ICP point-to-point",
    "ICP point-to-point, wide",
    "ICP point-to-plane",
    "NDT",
    "NDT, ICP point-to-point",
    "NDT, ICP point-to-plane",
];

/// One start and what became of it: metres and degrees off the truth by each refiner.
struct Start {
    sweep: usize,
    offset: (f64, f64),
    mine: u64,
    found: [(f64, f64); REFINERS.len()],
}

/// Which errors are a success.
#[derive(Clone, Copy)]
enum Home {
    /// Within 0.5 m and 5°.
    Coarse,
    /// Within 0.1 m and 1°.
    Fine,
}

impl Home {
    fn holds(self, (metres, degrees): (f64, f64)) -> bool {
        match self {
            Self::Coarse => metres < 0.5 && degrees < 5.0,
            Self::Fine => metres < 0.1 && degrees < 1.0,
        }
    }
}

fn main() -> Result<()> {
    let mut paths = std::env::args().skip(1);
    let (Some(csv), Some(svg)) = (paths.next(), paths.next()) else {
        return Err("usage: study_basin RAW.csv PICTURE.svg".into());
    };
    let mut starts: [Vec<Start>; DUST.len()] = Default::default();
    for mine in 0..MINES {
        let trips = DUST.map(|(_, dust)| Trip {
            route: Route::Mapped,
            dust,
            rings: true,
        });
        let (map, drives) = scene(&trips, mine)?;
        let config = Config::default();
        // One size for all dust, so that dust alone is compared.
        let measure = |c| scale::measure(c).ok_or("nothing to measure");
        let voxel = scale::voxel_for(&measure(&map)?, &measure(&drives[0].query)?);
        let map = prepare(&map, &config.prepare, voxel);
        let levels = ndt::levels(&map, &config.ndt);
        for (drive, out) in drives.iter().zip(&mut starts) {
            let problem = Problem {
                query: prepare(&drive.query, &config.prepare, voxel),
                centroid: drive.query.centroid().unwrap_or_default(),
                truth: drive.truth,
                map: &map,
                levels: &levels,
            };
            let plan = plan();
            out.par_extend(plan.par_iter().map(|&(sweep, offset, trial)| Start {
                sweep,
                offset,
                mine,
                found: problem.all(&problem.start(offset, mine, trial)),
            }));
        }
    }
    write_raw(&csv, &starts)?;
    std::fs::write(svg, picture(&starts)?)?;
    tables(&starts);
    Ok(())
}

/// Sweep, offset and number of every start in a mine.
fn plan() -> Vec<(usize, (f64, f64), u64)> {
    let mut plan = Vec::new();
    let shifts = METRES.map(|m| (0, (m, BESIDE.1)));
    let turns = DEGREES.map(|d| (1, (BESIDE.0, d)));
    let grid = GRID.0.iter().flat_map(|&m| GRID.1.map(|d| (2, (m, d))));
    for (sweep, offset) in shifts.into_iter().chain(turns).chain(grid) {
        for trial in 0..STARTS[sweep / 2] {
            plan.push((sweep, offset, trial));
        }
    }
    plan
}

struct Problem<'a> {
    map: &'a Surface<'static>,
    levels: &'a [NdtCells<'static>],
    query: Surface<'static>,
    centroid: [f64; 3],
    truth: Pose,
}

impl Problem<'_> {
    /// The truth moved by so many metres and turned by so many degrees about the query's centroid.
    fn start(&self, (metres, degrees): (f64, f64), mine: u64, trial: u64) -> Pose {
        let mut rng = Rng::new(mine, 1000 + trial);
        let shift = rng.direction().map(|v| v * metres);
        let turn = rng.direction().map(|v| v * degrees.to_radians());
        let about = self.truth.transform(self.centroid);
        self.truth.perturbed(shift, turn, about)
    }

    /// What each refiner makes of it, in the order of [`REFINERS`]; as configured, but on fewer
    /// of the query's points.
    fn all(&self, start: &Pose) -> [(f64, f64); REFINERS.len()] {
        let mut config = Config::default();
        config.icp.max_points = 1500;
        config.ndt.max_points = 1000;
        let point = config.icp;
        let plane = IcpConfig {
            metric: IcpMetric::PointToPlane,
            ..point.clone()
        };
        // As far as NDT's coarse cells and their neighbours reach.
        let wide = IcpConfig {
            max_distance: Length::Voxels(12.0),
            ..point.clone()
        };
        let icp = |from: &Pose, c| icp::align(self.map, &self.query, from, c).map_from_query;
        let by_ndt =
            ndt::align(self.levels, self.map, &self.query, start, &config.ndt).map_from_query;
        [
            icp(start, &point),
            icp(start, &wide),
            icp(start, &plane),
            by_ndt,
            icp(&by_ndt, &point),
            icp(&by_ndt, &plane),
        ]
        .map(|pose| {
            let e = pose.distance(&self.truth, self.centroid);
            (e.translation, e.rotation.to_degrees())
        })
    }
}

fn write_raw(path: &str, starts: &[Vec<Start>]) -> Result<()> {
    let mut text = "dust,sweep,mine,start_m,start_deg".to_owned();
    for refiner in REFINERS {
        let name = refiner.replace([',', ' '], "_").replace("__", "_");
        write!(text, ",{name}_m,{name}_deg")?;
    }
    text.push('\n');
    for ((_, dust), starts) in DUST.iter().zip(starts) {
        for s in starts {
            let sweep = ["translation", "rotation", "grid"][s.sweep];
            write!(
                text,
                "{dust},{sweep},{},{},{}",
                s.mine, s.offset.0, s.offset.1
            )?;
            for (m, d) in s.found {
                write!(text, ",{m:.4},{d:.3}")?;
            }
            text.push('\n');
        }
    }
    Ok(std::fs::write(path, text)?)
}

/// How many of the starts at an offset come home, and how many there are.
fn count(
    starts: &[Start],
    sweep: usize,
    offset: (f64, f64),
    refiner: usize,
    home: Home,
) -> (usize, usize) {
    let at: Vec<&Start> = starts
        .iter()
        .filter(|s| s.sweep == sweep && s.offset == offset)
        .collect();
    let hits = at.iter().filter(|s| home.holds(s.found[refiner])).count();
    (hits, at.len())
}

/// Wilson's 95 % interval of a share.
fn wilson(hits: usize, n: usize) -> (f64, f64) {
    let (p, n, z) = (hits as f64 / n.max(1) as f64, n.max(1) as f64, 1.96);
    let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    ((middle - half).max(0.0), (middle + half).min(1.0))
}

fn tables(starts: &[Vec<Start>]) {
    for (home, tolerance) in [(Home::Coarse, "0.5 m and 5°"), (Home::Fine, "0.1 m and 1°")] {
        println!("Home within {tolerance}, % of starts (Wilson's 95 % interval):\n");
        println!("dust | start | n | {}", REFINERS.join(" | "));
        println!("---|---|---{}", "|---".repeat(REFINERS.len()));
        for ((dust, _), starts) in DUST.iter().zip(starts) {
            let mut seen = Vec::new();
            for s in starts {
                if seen.contains(&(s.sweep, s.offset)) {
                    continue;
                }
                seen.push((s.sweep, s.offset));
                let cells: Vec<String> = (0..REFINERS.len())
                    .map(|r| {
                        let (hits, n) = count(starts, s.sweep, s.offset, r, home);
                        let (low, high) = wilson(hits, n);
                        format!(
                            "{:.0} ({:.0}-{:.0})",
                            100.0 * hits as f64 / n as f64,
                            100.0 * low,
                            100.0 * high
                        )
                    })
                    .collect();
                let (_, n) = count(starts, s.sweep, s.offset, 0, home);
                println!(
                    "{dust} | {} m, {}° | {n} | {}",
                    s.offset.0,
                    s.offset.1,
                    cells.join(" | ")
                );
            }
        }
        println!();
    }
    println!("The same starts in pairs, over all offsets and dust:\n");
    println!("home within | first | second | both | first only | second only | neither");
    println!("---|---|---|---|---|---|---");
    for (home, tolerance) in [(Home::Coarse, "0.5 m and 5°"), (Home::Fine, "0.1 m and 1°")] {
        for (a, b) in [(3, 4), (3, 5), (0, 4), (1, 4), (2, 5)] {
            let mut counts = [0; 4];
            for s in starts.iter().flatten() {
                let (a, b) = (home.holds(s.found[a]), home.holds(s.found[b]));
                counts[match (a, b) {
                    (true, true) => 0,
                    (true, false) => 1,
                    (false, true) => 2,
                    (false, false) => 3,
                }] += 1;
            }
            let [both, first, second, neither] = counts;
            println!(
                "{tolerance} | {} | {} | {both} | {first} | {second} | {neither}",
                REFINERS[a], REFINERS[b]
            );
        }
    }
}

/// Share of starts that come home (coarse) against the offset: a column for each dust, a row for each sweep.
fn picture(starts: &[Vec<Start>]) -> Result<String> {
    let rows = [
        (
            "moved by, m (turned by 5°)",
            METRES.map(|m| (m, (m, BESIDE.1))).to_vec(),
        ),
        (
            "turned by, degrees (moved by 0.25 m)",
            DEGREES.map(|d| (d, (BESIDE.0, d))).to_vec(),
        ),
    ];
    let mut panels = Vec::new();
    for (sweep, (axis, offsets)) in rows.iter().enumerate() {
        for ((dust, share), starts) in DUST.iter().zip(starts) {
            let lines = (0..REFINERS.len())
                .map(|r| {
                    offsets
                        .iter()
                        .map(|&(x, offset)| {
                            let (hits, n) = count(starts, sweep, offset, r, Home::Coarse);
                            let (low, high) = wilson(hits, n);
                            [
                                x,
                                100.0 * hits as f64 / n.max(1) as f64,
                                100.0 * low,
                                100.0 * high,
                            ]
                        })
                        .collect()
                })
                .collect();
            panels.push(picture::Panel {
                title: format!("{dust} ({:.0} % of shots)", 100.0 * share),
                x: (*axis).to_owned(),
                lines,
            });
        }
    }
    picture::draw(&panels, DUST.len(), &REFINERS, "% home within 0.5 m and 5°")
}
