//! Two clouds in, one answer out: the shortest way to use winze.
//!
//! ```sh
//! cargo run --release --example two_clouds -- map.pcd query.pcd
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

use std::path::Path;

use winze::{Config, Verdict};
use winze_io::{ReadOptions, read_cloud};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(map), Some(query)) = (args.next(), args.next()) else {
        return Err("usage: two_clouds MAP QUERY".into());
    };
    let map = read_cloud(Path::new(&map), &ReadOptions::default())?.cloud;
    let query = read_cloud(Path::new(&query), &ReadOptions::default())?.cloud;

    let outcome = winze::locate(&map, &query, &Config::default())?;

    println!("{}: {}", outcome.verdict, outcome.reason);
    match (outcome.verdict, outcome.map_from_query) {
        // Only this one may move a robot.
        (Verdict::Located, Some(map_from_query)) => {
            for row in map_from_query.to_matrix() {
                println!(
                    "{:12.6} {:12.6} {:12.6} {:12.6}",
                    row[0], row[1], row[2], row[3]
                );
            }
        }
        (Verdict::Ambiguous, _) => {
            println!(
                "{} places were weighed; drive on and ask again",
                outcome.hypotheses.len()
            );
        }
        _ => println!("not to be acted on"),
    }
    Ok(())
}
