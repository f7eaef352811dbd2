//! What building a prepared map costs, and opening and asking it, against the number of raw points.
//!
//! Maps are simulated mines of any size, and so are the queries, which lie where all of the maps begin: only the map
//! differs. Needs no data, but some room: 12 bytes a raw point for the cloud, up to 60 for scratch
//! files, and the map. Reads `/proc`, so it runs on Linux.
//!
//! ```sh
//! cargo build --release
//! cargo run --release --example bench_map -- run DIR --winze target/release/winze \
//!     --memory 1G --sizes 0.2,2,20,200 --out bench_map.json
//! cargo run --release --example bench_map -- draw bench_map.json docs/images/prepared-map.svg
//! ```
//!
//! `run` keeps what an earlier run wrote to its JSON file of other sizes, so that they can be measured one by one.
//! `make DIR --points N` only writes a cloud and the queries. `ask` times many queries in maps of several sizes, with and without `--near`.
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

#[path = "bench_map/ask.rs"]
mod ask;
#[path = "bench_map/measure.rs"]
mod measure;
#[path = "bench_map/mine.rs"]
mod mine;
#[path = "bench_map/picture.rs"]
mod picture;

use std::path::{Path, PathBuf};
use std::time::Instant;

use common::Result;
use winze_io::{WriteOptions, write_cloud, write_transform};

const USAGE: &str = "usage: bench_map make DIR --points N
       bench_map run DIR --winze BINARY [--memory 1G] [--sizes 0.2,2,20,200] [--threads 2,1] [--clouds-to 2] --out RESULTS.json
       bench_map ask DIR --winze BINARY [--sizes 0.66,6.6,66] [--queries 30] --out RESULTS.json
       bench_map draw RESULTS.json PICTURE.svg";

fn main() -> Result<()> {
    let mut words = Vec::new();
    let mut options: Vec<(String, String)> = Vec::new();
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        match arg.strip_prefix("--") {
            Some(name) => options.push((name.to_owned(), args.next().ok_or(USAGE)?)),
            None => words.push(arg),
        }
    }
    let option = |name: &str| {
        let found = options.iter().find(|(n, _)| n == name);
        found.map(|(_, value)| value.as_str())
    };
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["make", folder] => {
            let points: f64 = option("points").ok_or(USAGE)?.parse()?;
            make(Path::new(folder), points as u64)
        }
        ["run", folder] => {
            let list = |name: &str, default: &str| -> Result<Vec<f64>> {
                let text = option(name).unwrap_or(default);
                text.split(',').map(|v| Ok(v.parse()?)).collect()
            };
            let plan = measure::Plan {
                folder: PathBuf::from(folder),
                winze: PathBuf::from(option("winze").ok_or(USAGE)?).canonicalize()?,
                memory: option("memory").unwrap_or("1G").to_owned(),
                sizes: list("sizes", "0.2,2,20,200")?
                    .iter()
                    .map(|millions| (1e6 * millions).round() as u64)
                    .collect(),
                threads: list("threads", "2")?.iter().map(|t| *t as u32).collect(),
                clouds_to: (1e6 * list("clouds-to", "2")?[0]) as u64,
                out: PathBuf::from(option("out").ok_or(USAGE)?),
            };
            measure::run(&plan)
        }
        ["ask", folder] => {
            let sizes: Vec<f64> = option("sizes")
                .unwrap_or("0.66,6.6,66")
                .split(',')
                .map(str::parse)
                .collect::<std::result::Result<_, _>>()?;
            let points: Vec<u64> = sizes.iter().map(|m| (1e6 * m).round() as u64).collect();
            let queries = option("queries").unwrap_or("30").parse()?;
            let winze = PathBuf::from(option("winze").ok_or(USAGE)?).canonicalize()?;
            let out = PathBuf::from(option("out").ok_or(USAGE)?);
            ask::ask(Path::new(folder), &winze, &points, queries, &out)
        }
        ["draw", results, svg] => picture::draw(Path::new(results), Path::new(svg)),
        _ => Err(USAGE.into()),
    }
}

/// The name of a cloud of so many points, without what says its format.
pub(crate) fn name(points: u64) -> String {
    format!("mine_{}M", points as f64 / 1e6)
}

/// Writes the cloud and the queries where they are not there yet.
pub(crate) fn make(folder: &Path, points: u64) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    let path = folder.join(name(points) + ".pcd");
    if !path.exists() {
        let begun = Instant::now();
        // Under another name until it is whole.
        let part = folder.join(name(points) + ".part");
        let metres = mine::write_map(&part, points)?;
        std::fs::rename(&part, &path)?;
        println!(
            "{}: {points} points, {metres:.0} m of drifts, {:.1} s",
            path.display(),
            begun.elapsed().as_secs_f64()
        );
    }
    for i in 0..mine::QUERIES.len() {
        let path = folder.join(format!("query_{i}.pcd"));
        if !path.exists() {
            let (query, truth) = mine::query(i)?;
            write_transform(&folder.join(format!("query_{i}.txt")), &truth)?;
            write_cloud(&path, &query, &WriteOptions::default())?;
            println!("{}: {} points", path.display(), query.len());
        }
    }
    Ok(())
}
