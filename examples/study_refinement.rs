//! Why point-to-point ICP makes a good pose worse, and what keeping the finer pose does about it.
//!
//! Prints the tables of `docs/refinement.md`. Needs no data: the mines are simulated.
//!
//! ```sh
//! cargo run --release --example study_refinement
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use common::mine::{ALONG, Drive, Route, Trip, scene};
use common::{Result, off, quantile};
use winze::config::{Config, IcpConfig, IcpMetric, Length, PrepareConfig};
use winze::features::{Features, describe};
use winze::kdtree::KdTree;
use winze::matching::match_descriptors;
use winze::ndt::NdtCells;
use winze::prepare::{Surface, prepare};
use winze::refine::keep_better;
use winze::verify::{Candidate, candidate};
use winze::{Cloud, Pose, icp, ndt, ransac, scale};

const MINES: u64 = 10;
/// Errors that differ by less than this are the same, metres.
const SAME: f64 = 0.002;

/// Errors of a pose, metres and degrees.
#[derive(Clone, Copy)]
struct Miss {
    metres: f64,
    degrees: f64,
    along: f64,
    across: f64,
}

/// Rows of misses by their names, in the order in which they first came.
#[derive(Default)]
struct Table(Vec<(String, Vec<Miss>)>);

impl Table {
    fn add(&mut self, name: &str, miss: Miss) {
        let at = self.0.iter().position(|r| r.0 == name).unwrap_or_else(|| {
            self.0.push((name.to_owned(), Vec::new()));
            self.0.len() - 1
        });
        self.0[at].1.push(miss);
    }

    fn get(&self, name: &str) -> &[Miss] {
        self.0
            .iter()
            .find(|r| r.0 == name)
            .map_or(&[], |r| r.1.as_slice())
    }
}

/// A map and a query prepared at one voxel size.
struct Prepared<'a> {
    drive: &'a Drive,
    centroid: [f64; 3],
    map: &'a Surface<'static>,
    query: Surface<'static>,
    levels: &'a [NdtCells<'static>],
}

/// What is done once for a map and a voxel size.
struct MapSide {
    voxel: f64,
    surface: Surface<'static>,
    levels: Vec<NdtCells<'static>>,
    features: Features<'static>,
}

impl Prepared<'_> {
    fn miss(&self, pose: &Pose) -> Miss {
        let e = pose.distance(&self.drive.truth, self.centroid);
        let (a, b) = (
            pose.transform(self.centroid),
            self.drive.truth.transform(self.centroid),
        );
        let along: f64 = (0..3).map(|i| (a[i] - b[i]) * ALONG[i]).sum();
        let across = (e.translation * e.translation - along * along).max(0.0);
        Miss {
            metres: e.translation,
            degrees: e.rotation.to_degrees(),
            along: along.abs(),
            across: across.sqrt(),
        }
    }

    fn candidate(&self, pose: Pose, config: &Config) -> Candidate {
        candidate(self.map, &self.query, &pose, None, &config.verify)
    }

    fn keep_better(&self, before: Candidate, after: Candidate, config: &Config) -> Candidate {
        keep_better(self.map, &self.query, before, after, &config.verify)
    }

    fn ndt(&self, start: &Pose, config: &Config) -> Pose {
        ndt::align(self.levels, self.map, &self.query, start, &config.ndt).map_from_query
    }

    fn icp(&self, start: &Pose, config: &IcpConfig) -> Pose {
        icp::align(self.map, &self.query, start, config).map_from_query
    }
}

fn main() -> Result<()> {
    let config = Config::default();
    let trip = |route, dust, rings| Trip { route, dust, rings };
    let trips = [
        ("all of it mapped", Trip::CLEAN),
        ("half of it mapped", trip(Route::HalfMapped, 0.0, true)),
        ("mapped, dust", trip(Route::Mapped, 0.15, true)),
        ("half mapped, dust", trip(Route::HalfMapped, 0.15, true)),
        ("one turn", trip(Route::OneTurn, 0.0, true)),
        ("random directions", trip(Route::Mapped, 0.0, false)),
    ];
    let (mut chains, mut causes, mut pairs) = (Vec::new(), Vec::new(), Vec::new());
    for _ in &trips {
        chains.push(Table::default());
        causes.push(Table::default());
        pairs.push(Table::default());
    }
    for seed in 0..MINES {
        let (cloud, drives) = scene(&trips.map(|t| t.1), seed)?;
        let mut sides: Vec<MapSide> = Vec::new();
        for (i, drive) in drives.iter().enumerate() {
            let measure = |c| scale::measure(c).ok_or("nothing to measure");
            let voxel = scale::voxel_for(&measure(&cloud)?, &measure(&drive.query)?);
            if !sides.iter().any(|s| s.voxel == voxel) {
                let surface = prepare(&cloud, &config.prepare, voxel);
                sides.push(MapSide {
                    voxel,
                    levels: ndt::levels(&surface, &config.ndt),
                    features: describe(&surface, &config),
                    surface,
                });
            }
            let side = sides.iter().find(|s| s.voxel == voxel).ok_or("no map")?;
            let p = Prepared {
                drive,
                centroid: drive.query.centroid().unwrap_or_default(),
                map: &side.surface,
                query: prepare(&drive.query, &config.prepare, voxel),
                levels: &side.levels,
            };
            let start = off(&drive.truth, &drive.query, seed);
            let by_ndt = p.ndt(&start, &config);
            chain(&mut chains[i], &p, &by_ndt, &config);
            if [0, 1, 5].contains(&i) {
                cause(&mut causes[i], &p, &by_ndt, &cloud, &config);
            }
            if i < 4 {
                pair(&mut pairs[i], &p, side, &config);
            }
        }
    }
    print_chains(&trips.map(|t| t.0)[..5], &chains);
    print_causes(&trips.map(|t| t.0), &causes);
    print_pairs(&trips.map(|t| t.0)[..4], &pairs);
    Ok(())
}

fn fixed(config: &Config, metres: f64) -> IcpConfig {
    IcpConfig {
        max_distance: Length::Metres(metres),
        final_distance: Length::Metres(metres),
        max_iterations: 200,
        ..config.icp.clone()
    }
}

fn plane(config: &IcpConfig) -> IcpConfig {
    IcpConfig {
        metric: IcpMetric::PointToPlane,
        ..config.clone()
    }
}

/// The ICPs of the first table.
fn refiners(config: &Config) -> [(&'static str, IcpConfig); 4] {
    [
        ("point-to-point", config.icp.clone()),
        ("point-to-point, pairs to 1 m", fixed(config, 1.0)),
        ("point-to-point, pairs to 2 m", fixed(config, 2.0)),
        ("point-to-plane", plane(&config.icp)),
    ]
}

/// What follows NDT, bare and with the finer pose kept.
fn chain(table: &mut Table, p: &Prepared<'_>, by_ndt: &Pose, config: &Config) {
    table.add("NDT", p.miss(by_ndt));
    let before = p.candidate(*by_ndt, config);
    for (name, icp) in refiners(config) {
        let after = p.candidate(p.icp(by_ndt, &icp), config);
        table.add(name, p.miss(&after.map_from_query));
        let kept = p.keep_better(before, after, config);
        table.add(&format!("{name}, guarded"), p.miss(&kept.map_from_query));
    }
}

/// Point-to-point ICP with one thing changed at a time.
fn cause(table: &mut Table, p: &Prepared<'_>, by_ndt: &Pose, cloud: &Cloud, config: &Config) {
    let bare = &config.icp;
    let mut add = |name: &str,
                   map: &Surface<'static>,
                   query: &Surface<'static>,
                   from: &Pose,
                   icp: &IcpConfig| {
        let found = icp::align(map, query, from, icp).map_from_query;
        table.add(name, p.miss(&found));
    };
    let (map, query) = (p.map, &p.query);
    add("as configured", map, query, by_ndt, bare);
    add("begun at the truth", map, query, &p.drive.truth, bare);
    let patient = IcpConfig {
        max_iterations: 500,
        translation_epsilon: 1e-6,
        rotation_epsilon: 1e-7,
        ..bare.clone()
    };
    add("until steps are below 1 µm", map, query, by_ndt, &patient);
    for metres in [0.25, 0.5, 1.0, 2.0, 5.0] {
        let name = format!("pairs to {metres} m throughout");
        add(&name, map, query, by_ndt, &fixed(config, metres));
    }
    let shared = shared(p);
    let name = "only points whose surface is mapped";
    add(name, map, &shared, by_ndt, bare);
    let name = "only those, pairs to 2 m throughout";
    add(name, map, &shared, by_ndt, &fixed(config, 2.0));
    let (own_map, own_query) = (measured(map, cloud), measured(query, &p.drive.query));
    let name = "a measured point for each centroid";
    add(name, &own_map, &own_query, by_ndt, bare);
    let (raw_map, raw_query) = (raw(cloud, map.voxel), raw(&p.drive.query, map.voxel));
    add("query not thinned", map, &raw_query, by_ndt, bare);
    add("map not thinned", &raw_map, query, by_ndt, bare);
    add("neither thinned", &raw_map, &raw_query, by_ndt, bare);
    let thick = prepare(cloud, &PrepareConfig::default(), 2.0 * map.voxel);
    let thick = Surface {
        voxel: map.voxel,
        ..thick
    };
    add("map at twice the voxel", &thick, query, by_ndt, bare);
    add("point-to-plane", map, query, by_ndt, &plane(bare));
}

/// FPFH+ICP and FPFH+NDT+ICP from the same coarse pose, where that is of the right place.
fn pair(table: &mut Table, p: &Prepared<'_>, side: &MapSide, config: &Config) {
    let features = describe(&p.query, config);
    let matches = match_descriptors(
        &features.descriptors,
        &side.features.descriptors,
        &config.matching,
    );
    let any = |_: &Pose| true;
    let estimate = ransac::estimate(
        &matches,
        &features,
        &side.features,
        &config.ransac,
        side.voxel,
        config.seed,
        &any,
    );
    let Some(coarse) = estimate.hypotheses.first().map(|h| h.map_from_query) else {
        return;
    };
    let miss = p.miss(&coarse);
    if miss.metres > 2.0 || miss.degrees > 20.0 {
        return;
    }
    table.add("coarse", miss);
    let by_ndt = p.ndt(&coarse, config);
    table.add("NDT", p.miss(&by_ndt));
    for (icp, metric) in [
        (config.icp.clone(), "point-to-point"),
        (plane(&config.icp), "point-to-plane"),
    ] {
        for (start, chain) in [(coarse, "FPFH+ICP"), (by_ndt, "FPFH+NDT+ICP")] {
            let (before, after) = (
                p.candidate(start, config),
                p.candidate(p.icp(&start, &icp), config),
            );
            let name = format!("{chain} {metric}");
            table.add(&name, p.miss(&after.map_from_query));
            let kept = p.keep_better(before, after, config).map_from_query;
            table.add(&format!("{name}, guarded"), p.miss(&kept));
        }
    }
}

/// The query's points whose surface the map holds, by the truth.
fn shared(p: &Prepared<'_>) -> Surface<'static> {
    let (map, query) = (p.map, &p.query);
    let pose = p.drive.truth.between_origins(map.origin, query.origin);
    let kept: Vec<usize> = (0..query.points.len())
        .filter(|&i| {
            let q = pose.transform(query.points[i].map(f64::from));
            let near = map
                .tree
                .nearest_within(q.map(|v| v as f32), 0.75 * map.voxel as f32);
            near.is_some_and(|near| {
                let (m, n) = (
                    map.points[near.index as usize],
                    map.normals[near.index as usize],
                );
                let out: f64 = (0..3)
                    .map(|a| (q[a] - f64::from(m[a])) * f64::from(n[a]))
                    .sum();
                out.abs() < 0.1
            })
        })
        .collect();
    let points: Vec<[f32; 3]> = kept.iter().map(|&i| query.points[i]).collect();
    Surface {
        origin: query.origin,
        voxel: query.voxel,
        normals: kept.iter().map(|&i| query.normals[i]).collect(),
        tree: KdTree::build(&points),
        points: points.into(),
    }
}

/// The surface with the nearest measured point in each centroid's place.
fn measured(surface: &Surface<'static>, cloud: &Cloud) -> Surface<'static> {
    let tree = KdTree::build(cloud.points());
    let shift: [f64; 3] = std::array::from_fn(|a| surface.origin[a] - cloud.origin()[a]);
    let points: Vec<[f32; 3]> = surface
        .points
        .iter()
        .filter_map(|c| {
            let at: [f32; 3] = std::array::from_fn(|a| (f64::from(c[a]) + shift[a]) as f32);
            let near = tree.nearest(at)?;
            let p = cloud.points()[near.index as usize];
            Some(std::array::from_fn(|a| (f64::from(p[a]) - shift[a]) as f32))
        })
        .collect();
    Surface {
        tree: KdTree::build(&points),
        points: points.into(),
        ..surface.clone()
    }
}

/// All points as they were measured, without normals.
fn raw(cloud: &Cloud, voxel: f64) -> Surface<'static> {
    Surface {
        origin: cloud.origin(),
        voxel,
        points: cloud.points().to_vec().into(),
        normals: vec![[0.0; 3]; cloud.len()].into(),
        tree: KdTree::build(cloud.points()),
    }
}

fn column(misses: &[Miss], of: impl Fn(&Miss) -> f64) -> Vec<f64> {
    misses.iter().map(of).collect()
}

fn spread(misses: &[Miss]) -> String {
    let m = column(misses, |m| m.metres);
    format!("{:.4} ({:.4})", quantile(&m, 0.5), quantile(&m, 1.0))
}

/// How many are worse than their fellows by more than [`SAME`].
fn worse(misses: &[Miss], than: &[Miss]) -> usize {
    misses
        .iter()
        .zip(than)
        .filter(|(a, b)| a.metres > b.metres + SAME)
        .count()
}

/// The most that any is worse than its fellow, metres.
fn harm(misses: &[Miss], than: &[Miss]) -> f64 {
    misses
        .iter()
        .zip(than)
        .map(|(a, b)| a.metres - b.metres)
        .fold(0.0, f64::max)
}

fn print_chains(names: &[&str], tables: &[Table]) {
    println!(
        "query | after NDT | ICP that follows | after it, m | worse by > 2 mm | most harm m | finer one kept, m | worse by > 2 mm | most harm m"
    );
    println!("---|---|---|---|---|---|---|---|---");
    for (name, table) in names.iter().zip(tables) {
        let ndt = table.get("NDT");
        for (icp, _) in refiners(&Config::default()) {
            let (bare, kept) = (table.get(icp), table.get(&format!("{icp}, guarded")));
            println!(
                "{name} | {} | {icp} | {} | {} of {} | {:.4} | {} | {} of {} | {:.4}",
                spread(ndt),
                spread(bare),
                worse(bare, ndt),
                bare.len(),
                harm(bare, ndt),
                spread(kept),
                worse(kept, ndt),
                kept.len(),
                harm(kept, ndt),
            );
        }
    }
    println!();
}

fn print_causes(names: &[&str], tables: &[Table]) {
    println!("query | point-to-point ICP | error m | along the drift m | across m | error deg");
    println!("---|---|---|---|---|---");
    for (name, table) in names.iter().zip(tables) {
        for (row, misses) in &table.0 {
            let median = |of: fn(&Miss) -> f64| quantile(&column(misses, of), 0.5);
            println!(
                "{name} | {row} | {} | {:.4} | {:.4} | {:.3}",
                spread(misses),
                median(|m| m.along),
                median(|m| m.across),
                median(|m| m.degrees),
            );
        }
    }
    println!();
}

fn print_pairs(names: &[&str], tables: &[Table]) {
    println!(
        "query | ICP | coarse poses | their error m | FPFH+NDT | FPFH+ICP | FPFH+NDT+ICP | FPFH+NDT+ICP better : equal : worse | the same, finer kept: FPFH+ICP | FPFH+NDT+ICP | better : equal : worse"
    );
    println!("---|---|---|---|---|---|---|---|---|---|---");
    for (name, table) in names.iter().zip(tables) {
        for metric in ["point-to-point", "point-to-plane"] {
            let coarse = table.get("coarse");
            let row = |guarded: &str| {
                let one = table.get(&format!("FPFH+ICP {metric}{guarded}"));
                let two = table.get(&format!("FPFH+NDT+ICP {metric}{guarded}"));
                let (won, lost) = (worse(one, two), worse(two, one));
                format!(
                    "{} | {} | {won} : {} : {lost}",
                    spread(one),
                    spread(two),
                    one.len() - won - lost
                )
            };
            println!(
                "{name} | {metric} | {} | {} | {} | {} | {}",
                coarse.len(),
                spread(coarse),
                spread(table.get("NDT")),
                row(""),
                row(", guarded"),
            );
        }
    }
}
