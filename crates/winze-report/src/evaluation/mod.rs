//! Many answers held against the truth: what each one is worth, rates and errors per method and
//! family, the paper's tables, and a page to look at.
//!
//! Every run is one of three things, and the three add up to all runs:
//!
//! * **right**: `located` within the case's tolerance; `ambiguous` where the case is; `degenerate`
//!   where the case has the directions named and the pose is within tolerance across them;
//!   `not_found` where the query is not in the map;
//! * **wrong accept**: `located` or `degenerate` at a wrong place, or in a map that does not hold the
//!   query; the one that does harm;
//! * **refusal**: anything else: an answer was there to be had, and was not given.

mod calibration;
mod coverage;
mod labels;
mod mark;
mod page;
mod paper;
mod rates;
mod reliability;
mod steps;
mod summary;
mod tables;

pub use calibration::{Bin, Calibration, calibrations};
pub use coverage::{Coverage, Covered, PoseError, Uncertainty, coverages};
pub use labels::{Labelled, Labels, labels};
pub use mark::{Case, Class, Direction, Mark, Tolerance, mark};
pub use page::{Exhibit, RunView, evaluation_page};
pub use paper::{CLOUDS, Paper, PaperCell};
pub use rates::{Quantiles, Rate, quantile};
pub use reliability::reliability;
pub use steps::{Step, steps};
pub use summary::{MapCost, MethodCost, Summary, summaries};
pub use tables::{
    accuracy, answers, bin_table, calibration_table, costs, coverage_table, label_table, step_table,
};

use serde::{Deserialize, Serialize};
use winze::Verdict;
use winze::confidence::Evidence;

/// One case answered by one method with one seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The case's name.
    pub case: String,
    /// Its family.
    pub family: String,
    /// The query's sensor, if the case names it.
    #[serde(default)]
    pub sensor: String,
    /// Share of the query that the map holds, if the case tells.
    #[serde(default)]
    pub overlap: Option<f64>,
    /// The method's name.
    pub method: String,
    /// The seed.
    pub seed: u64,
    /// The answer in a word; null where the run broke off (then it counts as a refusal, in every
    /// denominator).
    pub verdict: Option<Verdict>,
    /// And in a sentence.
    pub reason: String,
    /// The best pose, whatever the verdict.
    pub map_from_query: Option<[[f64; 4]; 4]>,
    /// What that is worth.
    pub mark: Mark,
    /// The probability that it is said to be right with.
    #[serde(default)]
    pub confidence: Option<f64>,
    /// What that rests on.
    #[serde(default)]
    pub evidence: Option<Evidence>,
    /// Patches of wall asked there whether it is the same rock, and those that say yes.
    #[serde(default)]
    pub patches: Option<[usize; 2]>,
    /// Its error and its covariance, where there is a truth and a covariance.
    #[serde(default)]
    pub pose_error: Option<PoseError>,
    /// Places weighed.
    pub hypotheses: usize,
    /// The truth is among them.
    pub truth_weighed: Option<bool>,
    /// The paper's metrics at the pose.
    pub inliers: Option<Inliers>,
    /// The paper's metrics at the truth: what no method can be asked to exceed.
    pub ceiling: Option<Inliers>,
    /// Voxel size of the answer, metres.
    pub voxel: Option<f64>,
    /// Seconds for the answer, with the map at hand, its preparation and reading files not counted.
    pub seconds: f64,
    /// The work on the query was kept from another seed, so that the seconds are too few.
    pub query_kept: bool,
    /// Command lines that give this answer again, alone.
    #[serde(default)]
    pub again: Vec<String>,
}

/// The paper's two metrics.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Inliers {
    /// Share of the query near the map.
    pub fraction: f64,
    /// Root mean square distance of that share, metres; null where there is none.
    pub rmse: Option<f64>,
}

/// A case that gave no answer at all.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Trouble {
    /// The case's name.
    pub case: String,
    /// The method's name.
    pub method: String,
    /// What went wrong.
    pub message: String,
}

/// Everything that an evaluation found, as its JSON holds it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Version of winze.
    pub winze: &'static str,
    /// The command line.
    pub command: String,
    /// Digest of the settings.
    pub config_digest: String,
    /// Seeds that each case was run with.
    pub seeds: Vec<u64>,
    /// Methods that ran at once: where more than one, seconds are those of a busy machine.
    pub jobs: usize,
    /// Methods ran in one process and shared work: seconds and memory are no method's own.
    pub together: bool,
    /// Threads of each; 0 for all.
    pub threads: usize,
    /// Shares of the labels, per family and over all (family null).
    pub labels: Vec<Labels>,
    /// Rates and errors per method and family, and over all families (family null).
    pub summaries: Vec<Summary>,
    /// Whether confidence means what it says, per method and family, and over all families (family null).
    pub calibrations: Vec<Calibration>,
    /// Whether the covariance covers the error, likewise.
    pub coverages: Vec<Coverage>,
    /// What each refiner makes of right poses, where the methods before and after it were run.
    pub steps: Vec<Step>,
    /// Time on maps and memory, per method.
    pub costs: Vec<MethodCost>,
    /// Cases without an answer.
    pub errors: Vec<Trouble>,
    /// The paper's tables, where they were asked for.
    pub paper: Option<Paper>,
    /// Every run, in the order of methods, then cases, then seeds.
    pub runs: Vec<Run>,
}

impl Run {
    /// A run that broke off: the worst that can be said of it without an answer.
    #[must_use]
    pub fn broken(
        case: &str,
        family: &str,
        method: &str,
        seed: u64,
        truth: &Case,
        why: &str,
    ) -> Self {
        let worth = mark(truth, Verdict::NotFound, None, &[], [0.0; 3]);
        Self {
            case: case.to_owned(),
            family: family.to_owned(),
            sensor: String::new(),
            overlap: None,
            method: method.to_owned(),
            seed,
            verdict: None,
            reason: why.to_owned(),
            map_from_query: None,
            mark: Mark {
                class: Class::Refusal,
                ..worth
            },
            confidence: None,
            evidence: None,
            patches: None,
            pose_error: None,
            hypotheses: 0,
            truth_weighed: None,
            inliers: None,
            ceiling: None,
            voxel: None,
            seconds: 0.0,
            query_kept: true,
            again: Vec::new(),
        }
    }
}

impl Evaluation {
    /// The evaluation as indented JSON text with a final line break.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Only maps with keys that are no strings could fail, and there are none.
        let mut text = serde_json::to_string_pretty(self).unwrap_or_default();
        text.push('\n');
        text
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A run for tests of what is made of many.
    pub(crate) fn run(method: &str, family: &str, class: Class, mark: Mark) -> Run {
        Run {
            case: format!("{family}/1"),
            family: family.into(),
            sensor: String::new(),
            overlap: None,
            method: method.into(),
            seed: 0,
            verdict: Some(Verdict::Located),
            reason: String::new(),
            map_from_query: None,
            mark: Mark { class, ..mark },
            confidence: None,
            evidence: None,
            patches: None,
            pose_error: None,
            hypotheses: 1,
            truth_weighed: None,
            inliers: None,
            ceiling: None,
            voxel: None,
            seconds: 1.0,
            query_kept: false,
            again: Vec::new(),
        }
    }

    #[test]
    fn a_run_goes_through_json_to_the_bit() {
        let mut one = run("auto", "f", Class::Right, Mark::default());
        one.map_from_query = Some([[0.1 + 0.2, 1.0 / 3.0, 1e-17, 4.5e6 + 0.1]; 4]);
        let text = serde_json::to_string(&one).unwrap();
        assert_eq!(serde_json::from_str::<Run>(&text).unwrap(), one);
    }
}
