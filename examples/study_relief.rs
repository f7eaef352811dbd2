//! What tells a place from its look-alikes: the evidence at the true pose and at every other place that `auto` weighs.
//!
//! Prints a line a pose: case, right or wrong, error, overlap, median residual, patches asked and confirmed at each of the map's levels.
//!
//! ```sh
//! winze sim aliasing --count 10 --out aliasing
//! cargo run --release --example study_relief -- aliasing
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use common::Result;
use winze::config::{IcpConfig, IcpMetric};
use winze::kept::{KeptMap, KeptQuery};
use winze::locate::locate_in;
use winze::prepare::{Surface, prepare};
use winze::{Cloud, Config, Pose, Request, relief, verify};
use winze_io::{ReadOptions, read_cloud};

fn main() -> Result<()> {
    let folder = std::env::args()
        .nth(1)
        .ok_or("usage: study_relief FOLDER [EVERY]")?;
    let every: usize = std::env::args().nth(2).map_or(Ok(1), |a| a.parse())?;
    let folder = Path::new(&folder);
    let cases: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("cases.json"))?)?;
    let config = Config::default();
    let mut by_map: BTreeMap<String, Vec<&serde_json::Value>> = BTreeMap::new();
    for case in cases["cases"]
        .as_array()
        .into_iter()
        .flatten()
        .step_by(every)
    {
        let map = case["map"].as_str().unwrap_or_default().to_owned();
        let only = std::env::args().nth(3).unwrap_or_default();
        if !case["name"].as_str().unwrap_or_default().contains(&only) {
            continue;
        }
        by_map.entry(map).or_default().push(case);
    }
    let cloud = |name: &str| -> Result<Cloud> {
        Ok(read_cloud(&folder.join(name), &ReadOptions::default())?.cloud)
    };
    println!("case | place | error_m | overlap | median | voxel asked confirmed ...");
    for (map, cases) in by_map {
        let map = cloud(&map)?;
        let spacing = winze::scale::spacing(map.points()).ok_or("an empty map")?;
        let voxel = winze::scale::base_voxel(spacing);
        let base = winze::base::base_of(&map, voxel);
        let Ok(measure) = winze::scale::measure_base(
            (&base.points, voxel),
            map.origin(),
            spacing,
            &winze::columns::Memory,
        );
        let mut levels = winze::scale::levels(&measure);
        levels.truncate(3);
        println!("# levels {levels:?}, spacing {}", measure.spacing);
        let surfaces: Vec<Surface<'_>> = levels
            .iter()
            .map(|v| prepare(&map, &config.prepare, *v))
            .collect();
        let mut kept = KeptMap::new(&map);
        for case in cases {
            let name = case["name"].as_str().unwrap_or_default();
            let query = cloud(case["query"].as_str().unwrap_or_default())?;
            let truth: Option<[[f64; 4]; 4]> = serde_json::from_value(case["truth"].clone())?;
            let truth = truth.map(Pose::from_matrix).transpose()?;
            let outcome = locate_in(
                &mut kept,
                &mut KeptQuery::new(&query),
                &config,
                &Request::default(),
            )?;
            let queries: Vec<Surface<'_>> = levels
                .iter()
                .map(|v| prepare(&query, &config.prepare, *v))
                .collect();
            let mut poses: Vec<(String, Pose)> = Vec::new();
            if let Some(truth) = truth {
                poses.push(("truth".into(), truth));
                let polish = IcpConfig {
                    metric: IcpMetric::PointToPlane,
                    ..config.icp.clone()
                };
                let refined = winze::icp::align(&surfaces[0], &queries[0], &truth, &polish);
                poses.push(("refined".into(), refined.map_from_query));
            }
            for (i, h) in outcome.hypotheses.iter().take(6).enumerate() {
                poses.push((format!("found {i}"), h.map_from_query));
            }
            println!(
                "# {name} {} {} overlap {} bend {} {:?} {:.2} s",
                outcome.verdict,
                case["sensor"],
                case["overlap"],
                case["bend_rms_m"],
                outcome
                    .stages
                    .iter()
                    .find(|s| s.name == "estimate")
                    .map(|s| (s.count_in, s.count_out)),
                outcome.seconds,
            );
            for (what, pose) in poses {
                let error = truth.and_then(|t| {
                    let e = winze::metrics::pose_error(&pose, &t, &query)?;
                    Some(e.translation)
                });
                let fit = verify::fit(&surfaces[0], &queries[0], &pose, &config.verify);
                print!(
                    "{name} | {what} | {:.3} | {:.3} | {:.4} |",
                    error.unwrap_or(f64::NAN),
                    fit.overlap,
                    fit.median_point_to_plane
                );
                for ((map, query), voxel) in surfaces.iter().zip(&queries).zip(&levels) {
                    let v = &config.verify;
                    let patches = relief::patches(query, v.patch_size.metres(*voxel), v.patches);
                    let lengths = [v.patch_step.metres(*voxel), v.patch_reach.metres(*voxel)];
                    let r = relief::ask(map, query.origin, &patches, &|_| pose, lengths);
                    print!(
                        " {voxel:.2}: {}/{} {:.2} {:.1};",
                        r.confirmed,
                        r.asked,
                        r.share(),
                        r.significance()
                    );
                }
                println!();
            }
        }
    }
    Ok(())
}
