//! How much of a drift a query must show: pieces of several lengths, from a few metres up, sought in
//! their own map and in one where they do not belong.
//!
//! Prints the second table of `docs/real-mine.md`. Needs the clouds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example study_length
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use common::{Result, folder_exists, part, quantile, random_frame, read, truth};
use winze::{Config, Verdict};

const STATIONS: u32 = 10;

fn main() -> Result<()> {
    folder_exists("jinchuan")?;
    let map = read("jinchuan/map_2025-05-13.pcd")?;
    let elsewhere = read("gazebo_tunnel/slam_map.pcd")?;
    let in_map =
        read("jinchuan/query_2025-04-21.pcd")?.transformed(&truth("jinchuan/T_map_query.txt")?)?;
    // The drift runs along the map's x here.
    let along: Vec<f64> = in_map.iter().map(|p| p[0]).collect();
    let (first, last) = (quantile(&along, 0.02), quantile(&along, 0.98));
    println!(
        "length m | pieces | located rightly | wrong accepts | best pose right | refused as | in the wrong map: located | refused as"
    );
    println!("---|---|---|---|---|---|---|---");
    for (length, ball) in [(6.0, false), (12.0, false), (25.0, false), (24.0, true)] {
        let (mut right, mut wrong, mut best, mut believed) = (0, 0, 0, 0);
        let (mut refusals, mut rejections) = (Vec::new(), Vec::new());
        for station in 0..STATIONS {
            let low =
                first + (last - first - length) * f64::from(station) / f64::from(STATIONS - 1);
            let frame = random_frame(u64::from(station));
            // A slice of the drift, or the points around a place in its middle.
            let middle = low + 0.5 * length;
            let near: Vec<[f64; 3]> = in_map
                .iter()
                .filter(|p| (p[0] - middle).abs() < 1.0)
                .collect();
            let [y, z] = [1, 2].map(|a| {
                let of: Vec<f64> = near.iter().map(|p| p[a]).collect();
                quantile(&of, 0.5)
            });
            let inside = |p: [f64; 3]| {
                if ball {
                    let d = [p[0] - middle, p[1] - y, p[2] - z];
                    d.iter().map(|v| v * v).sum::<f64>() < 0.25 * length * length
                } else {
                    p[0] >= low && p[0] < low + length
                }
            };
            let piece = part(&in_map, inside).transformed(&frame)?;
            let config = Config {
                seed: u64::from(station),
                ..Config::default()
            };
            let outcome = winze::locate(&map, &piece, &config)?;
            let home = outcome
                .error(&frame.inverse(), &piece)
                .is_some_and(|e| e.translation < 0.5 && e.rotation < 5f64.to_radians());
            best += u32::from(home);
            match (outcome.verdict, home) {
                (Verdict::Located, true) => right += 1,
                (Verdict::Located, false) => wrong += 1,
                (other, _) => refusals.push(other.name()),
            }
            let outcome = winze::locate(&elsewhere, &piece, &config)?;
            match outcome.verdict {
                Verdict::Located => believed += 1,
                other => rejections.push(other.name()),
            }
        }
        println!(
            "{} | {STATIONS} | {} | {} | {} | {} | {} | {}",
            if ball {
                format!("{} around a place", 0.5 * length)
            } else {
                length.to_string()
            },
            right,
            wrong,
            best,
            counted(refusals),
            believed,
            counted(rejections)
        );
    }
    Ok(())
}

/// Each word with how often it came.
fn counted(mut words: Vec<&str>) -> String {
    words.sort_unstable();
    let counts: Vec<String> = words
        .chunk_by(|a, b| a == b)
        .map(|c| format!("{} {}", c.len(), c[0]))
        .collect();
    counts.join(", ")
}
