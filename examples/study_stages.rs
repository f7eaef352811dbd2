//! Seconds and peak memory of each stage on a real pair, at one thread and at two.
//!
//! Prints the table of `docs/stages.md`. Needs the clouds of `WINZE_DATA`, and Linux for the memory.
//!
//! ```sh
//! cargo run --release --example study_stages
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::sync::Mutex;
use std::time::Instant;

use common::{Result, folder_exists, quantile, read};
use winze::outcome::Stage;
use winze::{Config, Method, Request};

/// Runs at each number of threads; the medians are printed.
const RUNS: usize = 5;

fn main() -> Result<()> {
    folder_exists("jinchuan")?;
    let mut rows: Vec<(String, [Vec<f64>; 2], f64)> = Vec::new();
    let mut note = |column: usize, name: &str, seconds: f64, megabytes: f64| {
        let at = rows.iter().position(|r| r.0 == name).unwrap_or_else(|| {
            rows.push((name.to_owned(), Default::default(), 0.0));
            rows.len() - 1
        });
        rows[at].1[column].push(seconds);
        rows[at].2 = rows[at].2.max(megabytes);
    };
    for (column, threads) in [1, 2].into_iter().enumerate() {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        for _ in 0..RUNS {
            let told: Mutex<Vec<(String, f64, f64)>> = Mutex::new(Vec::new());
            let progress = |name: &str, stage: Option<&Stage>| match stage {
                None => forget_peak(),
                Some(s) => {
                    if let Ok(mut told) = told.lock() {
                        told.push((name.to_owned(), s.seconds, peak()));
                    }
                }
            };
            pool.install(|| -> Result<()> {
                let begun = Instant::now();
                forget_peak();
                let (map, query) = (
                    read("jinchuan/map_2025-05-13.pcd")?,
                    read("jinchuan/query_2025-04-21.pcd")?,
                );
                let reading = begun.elapsed().as_secs_f64();
                if let Ok(mut told) = told.lock() {
                    told.push(("read both files".into(), reading, peak()));
                }
                let request = Request {
                    method: Method::Auto,
                    progress: Some(&progress),
                    ..Request::default()
                };
                winze::locate_by(&map, &query, &Config::default(), &request)?;
                Ok(())
            })?;
            let told = told.into_inner().unwrap_or_default();
            let sum: f64 = told.iter().map(|t| t.1).sum();
            for (name, seconds, megabytes) in &told {
                note(column, name, *seconds, *megabytes);
            }
            note(
                column,
                "all",
                sum,
                told.iter().map(|t| t.2).fold(0.0, f64::max),
            );
        }
    }
    println!(
        "stage | seconds, 1 thread | seconds, 2 threads | peak memory of the process during it, MB"
    );
    println!("---|---|---|---");
    for (name, seconds, megabytes) in &rows {
        let [one, two] = [0, 1].map(|i: usize| quantile(&seconds[i], 0.5));
        println!("{name} | {one:.3} | {two:.3} | {megabytes:.0}");
    }
    Ok(())
}

/// Peak resident memory since it was last forgotten, MB; 0 where the system does not tell.
fn peak() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().strip_suffix("kB")?.trim().parse::<f64>().ok())
        .unwrap_or(0.0)
        / 1024.0
}

fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
