//! Does the covariance cover the error? True errors of the located queries of a folder of `winze sim`, in units of several covariances.
//!
//! Prints, for each family, of the covariance answered and of the plain inverse Hessian (with `--each` of every part and of other errors of the map too): queries, the mean squared error in its units (6 where it is right), and the share of the errors' components
//! within one and two standard deviations (68 and 95 % where it is right).
//!
//! ```sh
//! winze sim long-drift --seed 17 --no-mesh --out long-drift
//! winze eval long-drift --json long-drift.json
//! cargo run --release --example study_covariance -- long-drift long-drift.json
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use common::Result;
use winze::config::{IcpConfig, IcpMetric, OdometryConfig};
use winze::covariance::{
    Covariance, PATCHES, Residuals, SECTIONS, estimate, inverse_hessian, perturbation,
};
use winze::degeneracy::{Unobservable, directions};
use winze::icp::information;
use winze::prepare::{Surface, prepare};
use winze::{Cloud, Config, Pose};
use winze_io::{ReadOptions, read_cloud};

/// Errors in units of a covariance.
#[derive(Default)]
struct Tally {
    queries: usize,
    squares: Vec<f64>,
    /// Of each component.
    within: [[usize; 6]; 2],
}

impl Tally {
    fn add(&mut self, covariance: &Covariance, error: [f64; 6]) {
        let Some(square) = covariance.nees(error) else {
            return;
        };
        self.queries += 1;
        self.squares.push(square);
        for (i, e) in error.iter().enumerate() {
            let sigmas = e.abs() / covariance.matrix[i][i].sqrt();
            self.within[0][i] += usize::from(sigmas <= 1.0);
            self.within[1][i] += usize::from(sigmas <= 2.0);
        }
    }
}

fn pose_of(value: &serde_json::Value) -> Result<Pose> {
    Ok(Pose::from_matrix(serde_json::from_value(value.clone())?)?)
}

fn main() -> Result<()> {
    let usage = "usage: study_covariance FOLDER EVALUATION.json [--each]";
    let each = std::env::args().nth(3).is_some_and(|a| a == "--each");
    let folder = std::env::args().nth(1).ok_or(usage)?;
    let evaluation = std::env::args().nth(2).ok_or(usage)?;
    let folder = Path::new(&folder);
    let read = |path: &Path| -> Result<serde_json::Value> {
        Ok(serde_json::from_slice(&std::fs::read(path)?)?)
    };
    let cloud = |name: &serde_json::Value| -> Result<Cloud> {
        let name = name.as_str().unwrap_or_default();
        Ok(read_cloud(&folder.join(name), &ReadOptions::default())?.cloud)
    };
    let cases = read(&folder.join("cases.json"))?;
    let by_name: BTreeMap<&str, &serde_json::Value> = cases["cases"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|c| Some((c["name"].as_str()?, c)))
        .collect();
    let evaluation = read(Path::new(&evaluation))?;
    let config = Config::default();
    let icp = IcpConfig {
        metric: IcpMetric::PointToPlane,
        ..config.icp.clone()
    };
    type Map = (Cloud, Option<f64>);
    let mut maps: BTreeMap<String, Map> = BTreeMap::new();
    let mut surfaces: BTreeMap<(String, u64), Surface<'static>> = BTreeMap::new();
    let mut tallies: BTreeMap<(String, String), Tally> = BTreeMap::new();
    for run in evaluation["runs"].as_array().into_iter().flatten() {
        let (Some(case), Some(voxel)) = (
            run["case"].as_str().and_then(|name| by_name.get(name)),
            run["voxel"].as_f64(),
        ) else {
            continue;
        };
        if run["verdict"] != "located" || case["truth"].is_null() {
            continue;
        }
        let name = case["map"].to_string();
        if !maps.contains_key(&name) {
            let map = cloud(&case["map"])?;
            let width = winze::scale::measure(&map).and_then(|m| m.width);
            maps.insert(name.clone(), (map, width));
        }
        let (map, width) = &maps[&name];
        let map = surfaces
            .entry((name, voxel.to_bits()))
            .or_insert_with(|| prepare(map, &config.prepare, voxel));
        let verify = config.verify.at(voxel, *width);
        let query_cloud = cloud(&case["query"])?;
        let query = prepare(&query_cloud, &config.prepare, voxel);
        let (pose, truth) = (pose_of(&run["map_from_query"])?, pose_of(&case["truth"])?);
        let error = perturbation(&pose, &truth, query.centroid().unwrap_or_default());
        let distance = verify.overlap_distance.metres(voxel);
        let told = information(map, &query, &pose, distance, verify.max_points);
        let open: Vec<Unobservable> = directions(&told)
            .into_iter()
            .filter(|d| d.information < verify.min_information_confirmed)
            .collect();
        let beyond = winze::bend::follow(map, &query, &pose, &icp, &verify).map(|b| b.beyond);
        let residuals = Residuals::of(map, &query, &pose, &verify);
        let patch = verify.patch_size.metres(voxel);
        let mut all = vec![
            (
                "0 answered".to_owned(),
                estimate(map, &query, &pose, &open, &verify, &config.odometry, beyond),
            ),
            ("1 inverse Hessian".to_owned(), inverse_hessian(&told)),
        ];
        if each {
            for map_off in [0.0, 0.005, 0.015, 0.02] {
                let odometry = OdometryConfig {
                    map: map_off,
                    ..config.odometry.clone()
                };
                all.push((
                    format!("5 answered, were the map off by {map_off}"),
                    estimate(map, &query, &pose, &open, &verify, &odometry, beyond),
                ));
            }
            let patches = PATCHES.map(|size| {
                let told = residuals.of_patches(size * patch);
                (format!("2 patches {size}"), told)
            });
            let sections = SECTIONS.map(|size| {
                let told = residuals.of_sections(size * patch);
                (format!("3 sections {size}"), told)
            });
            let odometry = residuals.of_odometry(&config.odometry, 0.0);
            all.push(("4 odometry alone".to_owned(), Some(odometry)));
            all.extend(patches);
            all.extend(sections);
        }
        let family = run["family"].as_str().unwrap_or_default();
        for (kind, covariance) in all {
            if let Some(covariance) = covariance {
                let key = (family.to_owned(), kind);
                tallies.entry(key).or_default().add(&covariance, error);
            }
        }
    }
    println!(
        "family | covariance | queries | mean square | median square | within 1 σ, % (x y z, about x y z) | within 2 σ, %"
    );
    println!("---|---|---|---|---|---|---");
    for ((family, kind), mut tally) in tallies {
        tally.squares.sort_by(f64::total_cmp);
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let n = tally.queries as f64;
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let share = |k: usize| 100.0 * k as f64 / n;
        let both = tally.within.map(|components| {
            let each: Vec<String> = components
                .iter()
                .map(|k| format!("{:.0}", share(*k)))
                .collect();
            let all = share(components.iter().sum()) / 6.0;
            format!("{all:.0} ({})", each.join(" "))
        });
        println!(
            "{family} | {kind} | {n} | {:.1} | {:.1} | {} | {}",
            tally.squares.iter().sum::<f64>() / n,
            tally.squares[tally.squares.len() / 2],
            both[0],
            both[1]
        );
    }
    Ok(())
}
