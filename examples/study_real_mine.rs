//! A mine drift mapped twice, three weeks apart: every method over seeds, frames and halves.
//!
//! Prints the table of `docs/real-mine.md`. Needs the clouds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example study_real_mine
//! cargo run --release --example study_real_mine -- auto     # only these methods
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::time::Instant;

use common::{Result, Tally, folder_exists, halves, off, random_frame, read, truth};
use winze::{Cloud, Config, Method, Pose, Request, Verdict};

const MAP: &str = "jinchuan/map_2025-05-13.pcd";
const QUERY: &str = "jinchuan/query_2025-04-21.pcd";

const AS_IT_IS: &str = "as it is, seeds 0 to 9";

fn main() -> Result<()> {
    folder_exists("jinchuan")?;
    let named: Vec<Method> = std::env::args()
        .skip(1)
        .map(|a| a.parse())
        .collect::<std::result::Result<_, _>>()?;
    let methods = if named.is_empty() {
        Method::ALL.to_vec()
    } else {
        named
    };
    let query = read(QUERY)?;
    let truth = truth("jinchuan/T_map_query.txt")?;
    let halves = halves(&query, &truth);

    let still: Result<Vec<Case>> = (0..10)
        .map(|seed| Case::new(&query, &truth, Pose::identity(), seed))
        .collect();
    let moved: Result<Vec<Case>> = (0..20)
        .map(|f| Case::new(&query, &truth, random_frame(f), f))
        .collect();
    let cut = |half: &Cloud| -> Result<Vec<Case>> {
        (0..10)
            .map(|f| Case::new(half, &truth, random_frame(100 + f), f))
            .collect()
    };
    let sets = [
        (AS_IT_IS, still?),
        ("in 20 random frames", moved?),
        ("its one half, in 10 random frames", cut(&halves[0])?),
        ("its other half, in 10 random frames", cut(&halves[1])?),
    ];
    println!(
        "Right is within 0.5 m and 5°; columns with * are over the runs whose pose was right. {} threads.",
        std::thread::available_parallelism()?
    );
    for (name, cases) in &sets {
        println!(
            "\n### The query {name}\n\nmethod | {}\n---|{}",
            Tally::HEAD,
            Tally::RULE
        );
        // Seeds are all that tells the first cases apart.
        let once = if *name == AS_IT_IS { 1 } else { cases.len() };
        for &method in &methods {
            let drawn = if method.draws_at_random() {
                &cases[..]
            } else {
                &cases[..once]
            };
            println!("{method} | {}", run(drawn, method, false)?.row());
        }
        if methods.contains(&Method::NdtIcp) {
            println!(
                "ndt+icp from 0.5 m and 5° off | {}",
                run(cases, Method::NdtIcp, true)?.row()
            );
        }
    }
    println!(
        "\n### Where it does not belong: in gazebo_tunnel/slam_map.pcd, in 10 random frames\n\nmethod | runs | located | other verdicts"
    );
    println!("---|---|---|---");
    let tunnel = read("gazebo_tunnel/slam_map.pcd")?;
    for &method in &methods {
        let mut verdicts = Vec::new();
        for seed in 0..10 {
            let config = Config {
                seed,
                ..Config::default()
            };
            let request = Request {
                method,
                ..Request::default()
            };
            let query = query.transformed(&random_frame(200 + seed))?;
            verdicts.push(winze::locate_by(&tunnel, &query, &config, &request)?.verdict);
        }
        let located = verdicts.iter().filter(|v| **v == Verdict::Located).count();
        let mut others: Vec<String> = verdicts
            .iter()
            .filter(|v| **v != Verdict::Located)
            .map(ToString::to_string)
            .collect();
        others.sort();
        others.dedup();
        println!(
            "{method} | {} | {located} | {}",
            verdicts.len(),
            others.join(", ")
        );
    }
    Ok(())
}

struct Case {
    query: Cloud,
    truth: Pose,
    seed: u64,
}

impl Case {
    fn new(query: &Cloud, truth: &Pose, frame: Pose, seed: u64) -> Result<Self> {
        Ok(Self {
            query: query.transformed(&frame)?,
            truth: truth.compose(&frame.inverse()),
            seed,
        })
    }
}

/// Runs `method` on all cases. Seconds are from opening both files to the answer.
fn run(cases: &[Case], method: Method, near_start: bool) -> Result<Tally> {
    let mut tally = Tally::default();
    for case in cases {
        let begun = Instant::now();
        let map = read(MAP)?;
        read(QUERY)?;
        let config = Config {
            seed: case.seed,
            ..Config::default()
        };
        let initial = near_start.then(|| off(&case.truth, &case.query, case.seed));
        let request = Request {
            method,
            initial,
            ..Request::default()
        };
        let outcome = winze::locate_by(&map, &case.query, &config, &request)?;
        tally.add(
            &outcome,
            &case.truth,
            &case.query,
            begun.elapsed().as_secs_f64(),
        );
    }
    Ok(tally)
}
