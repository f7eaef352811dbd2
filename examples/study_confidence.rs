//! Does confidence mean what it says, and does the covariance cover the error, over several evaluations at once?
//!
//! Prints the tables that `winze eval` prints of one, over all files together, and draws the reliability diagram.
//!
//! ```sh
//! winze sim dust --seed 21 --no-mesh --out dust-21
//! winze eval dust-21 --json dust-21.json
//! cargo run --release --example study_confidence -- reliability.svg dust-21.json ...
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use common::Result;
use winze_report::evaluation::{
    Run, bin_table, calibration_table, calibrations, coverage_table, coverages, reliability,
};

fn main() -> Result<()> {
    let usage = "usage: study_confidence DIAGRAM.svg EVALUATION.json ...";
    let mut args = std::env::args().skip(1);
    let diagram = args.next().ok_or(usage)?;
    let mut runs: Vec<Run> = Vec::new();
    for file in args {
        let text = std::fs::read(&file).map_err(|e| format!("{file}: {e}"))?;
        let mut evaluation: serde_json::Value = serde_json::from_slice(&text)?;
        let own: Vec<Run> = serde_json::from_value(evaluation["runs"].take())?;
        runs.extend(own.into_iter().filter(|r| r.method == "auto"));
    }
    let told = calibrations(&runs);
    let all = told.iter().find(|c| c.family.is_none()).ok_or(usage)?;
    println!("{} queries\n", runs.len());
    println!("{}", bin_table(&told).to_text());
    println!("{}", calibration_table(&told).to_text());
    println!("{}", coverage_table(&coverages(&runs)).to_text());
    std::fs::write(&diagram, reliability(all)?)?;
    Ok(())
}
