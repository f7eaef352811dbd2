//! How long one question takes, against the size of the map.

use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};
use winze_io::{WriteOptions, write_cloud, write_transform};

use crate::common::{Result, quantile};
use crate::{make, mine, name};

/// Starts of the queries along the first row, metres; every map that is asked covers them.
const STARTS: [f64; 2] = [1.0, 70.0];
/// Radius of the region that `--near` gives, metres.
const NEAR: f64 = 30.0;

/// Asks `queries` questions of maps of so many raw `points`, and writes every run to `out`.
pub(crate) fn ask(
    folder: &Path,
    winze: &Path,
    points: &[u64],
    queries: usize,
    out: &Path,
) -> Result<()> {
    let run = |args: &[String]| -> Result<()> {
        let status = Command::new(winze)
            .args(args)
            .current_dir(folder)
            .status()?;
        // 1 is an answer too: not located.
        match status.code() {
            Some(0 | 1) => Ok(()),
            _ => Err(format!("winze {} failed", args.join(" ")).into()),
        }
    };
    let mut near = Vec::new();
    std::fs::create_dir_all(folder)?;
    for i in 0..queries {
        let share = i as f64 / queries.saturating_sub(1).max(1) as f64;
        let from = STARTS[0] + share * (STARTS[1] - STARTS[0]);
        let (query, truth) = mine::query_from(from, i)?;
        let [x, y, z] = truth.transform(query.centroid().unwrap_or_default());
        near.push(format!("{x:.1},{y:.1},{z:.1},{NEAR}"));
        write_transform(&folder.join(format!("ask_{i}.txt")), &truth)?;
        write_cloud(
            &folder.join(format!("ask_{i}.pcd")),
            &query,
            &WriteOptions::default(),
        )?;
    }
    println!(
        "raw points | finest level | near | located rightly | p50 s | p95 s | max s | p50 of the whole process s"
    );
    println!("---|---|---|---|---|---|---|---");
    let mut runs = Vec::new();
    for &points in points {
        make(folder, points)?;
        let map = name(points) + ".wmap";
        if !folder.join(&map).exists() {
            let words = [
                "map",
                "build",
                &(name(points) + ".pcd"),
                "-o",
                &map,
                "--quiet",
            ];
            run(&words.map(str::to_owned))?;
        }
        let info = Command::new(winze)
            .args(["map", "info", &map, "--json"])
            .current_dir(folder)
            .output()?;
        let info: Value = serde_json::from_slice(&info.stdout)?;
        let finest = info["levels"]
            .as_array()
            .and_then(|l| l.iter().filter_map(|l| l["points"].as_u64()).max());
        for region in [false, true] {
            let (mut seconds, mut whole, mut right) = (Vec::new(), Vec::new(), 0);
            for i in 0..queries {
                let mut words: Vec<String> = ["locate", &map]
                    .map(str::to_owned)
                    .into_iter()
                    .chain([
                        format!("ask_{i}.pcd"),
                        "--truth".into(),
                        format!("ask_{i}.txt"),
                    ])
                    .chain(["--json", "answer.json", "--quiet"].map(str::to_owned))
                    .collect();
                if region {
                    words.extend(["--near".into(), near[i].clone()]);
                }
                let begun = std::time::Instant::now();
                run(&words)?;
                let process = begun.elapsed().as_secs_f64();
                let found: Value =
                    serde_json::from_slice(&std::fs::read(folder.join("answer.json"))?)?;
                let metres = found["error"]["translation_m"].as_f64();
                let located = found["verdict"] == "located" && metres.is_some_and(|m| m < 0.5);
                right += usize::from(located);
                let own = found["seconds"].as_f64().unwrap_or(f64::NAN);
                seconds.push(own);
                whole.push(process);
                runs.push(json!({
                    "points": points, "finest": finest, "near": region, "query": i,
                    "verdict": found["verdict"], "error_m": metres, "seconds": own,
                    "process_seconds": process, "stages": found["stages"],
                }));
            }
            println!(
                "{points} | {} | {} | {right}/{queries} | {:.3} | {:.3} | {:.3} | {:.3}",
                finest.unwrap_or(0),
                if region { "30 m" } else { "-" },
                quantile(&seconds, 0.5),
                quantile(&seconds, 0.95),
                quantile(&seconds, 1.0),
                quantile(&whole, 0.5),
            );
            std::fs::write(out, serde_json::to_vec_pretty(&runs)?)?;
        }
    }
    Ok(())
}
