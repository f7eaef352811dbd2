//! The tables of an evaluation, as a person reads them on a terminal.

use std::fmt::Write as _;

use winze_report::evaluation::{
    Evaluation, accuracy, answers, bin_table, calibration_table, costs, coverage_table,
    label_table, step_table,
};

const CALIBRATION: &str = "Confidence of every answer that has one, against the share whose pose lay within 0.5 m and 5° of the truth.
Brier: mean square difference from what came true. ECE: mean difference from the share right, over the bins.
";
const COVERAGE: &str = "Errors of located poses in units of their covariance. Covered: within 5 m of the truth, and with a covariance.
NEES: squared, 6 on average and 5.35 in the median where the covariance is right. Within one and two standard
deviations: x, y, z and the angles about them (68 and 95 %). H⁻¹: by the inverse Hessian of the fit.
";

/// The tables as plain text, or the paper's as Markdown where they were asked for.
#[must_use]
pub fn text(e: &Evaluation) -> String {
    let mut out = String::new();
    if let Some(paper) = &e.paper {
        out += &paper.to_markdown();
    } else {
        let _ = writeln!(out, "{}", label_table(&e.labels).to_text());
        let _ = writeln!(out, "{}", answers(&e.summaries).to_text());
        let _ = writeln!(out, "{}", accuracy(&e.summaries).to_text());
        out += "m and °: errors of right poses, across what is unobservable; all m: of every pose of a query in the map.\n";
        let calibration = calibration_table(&e.calibrations);
        if !calibration.is_empty() {
            let _ = write!(
                out,
                "\n{}\n{}\n{CALIBRATION}",
                bin_table(&e.calibrations).to_text(),
                calibration.to_text()
            );
        }
        let coverage = coverage_table(&e.coverages);
        if !coverage.is_empty() {
            let _ = write!(out, "\n{}\n{COVERAGE}", coverage.to_text());
        }
        let steps = step_table(&e.steps);
        if !steps.is_empty() {
            let _ = write!(
                out,
                "\n{}\nOf poses that are right before a refiner: nearer to the truth after it or further from it, by more than 2 mm; right \
                 no more (lost), or only now (won).\n",
                steps.to_text()
            );
        }
    }
    let _ = write!(out, "\n{}", costs(&e.costs).to_text());
    if e.jobs > 1 {
        let _ = writeln!(
            out,
            "\nSeconds were taken with {} methods running at once.",
            e.jobs
        );
    }
    if e.together && e.paper.is_none() {
        out += "\nMethods shared one process and its work: seconds are told of the first alone.\n";
    }
    if e.seeds.len() > 1 && e.paper.is_none() {
        let _ = writeln!(
            out,
            "\nIntervals take runs for independent, which several seeds on one case are not."
        );
    }
    out
}
