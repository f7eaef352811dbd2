//! What is to be done for an evaluation, and what is said of it.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use winze::{Config, Method};
use winze_report::evaluation::{MapCost, Run};

use super::cases::Case;

/// Methods to ask over cases.
#[derive(Debug, Serialize, Deserialize)]
pub struct Job {
    /// The methods' names, each with its seeds.
    pub methods: Vec<(String, Vec<u64>)>,
    /// The settings; those of a built map's that are left at their default are as it was built.
    pub config: Config,
    /// Keep the work on a query from seed to seed and from method to method: sooner done, but the seconds are too
    /// few.
    pub keep_query: bool,
    /// Folder for a picture of each case, before and after one of the methods.
    pub figures: Option<(String, PathBuf)>,
    /// Maps that were built beforehand, by the clouds they were made of.
    pub built: Vec<(PathBuf, PathBuf)>,
    /// Cases on one map stand together.
    pub cases: Vec<Case>,
}

/// What is said while a job is done.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "said", rename_all = "snake_case")]
pub enum Said {
    /// One run is over.
    Run(Box<Run>),
    /// A case gives no answer by a method, or by any.
    Trouble {
        /// The case's name.
        case: String,
        /// The method's.
        method: Option<String>,
        /// What went wrong, in a line.
        message: String,
    },
    /// All runs of a case are over; with the most memory held so far, bytes.
    Over {
        /// The case's name.
        case: String,
        /// The memory.
        peak: Option<u64>,
    },
    /// All cases of a map are over; with the most memory held so far, bytes.
    Map {
        /// Time on the map.
        cost: MapCost,
        /// The memory.
        peak: Option<u64>,
    },
}

/// What the cost of methods that share a process goes by: the method, or how many there are.
#[must_use]
pub fn cost_name(methods: &[(String, Vec<u64>)]) -> String {
    match methods {
        [(one, _)] => one.clone(),
        several => format!("{} together", several.len()),
    }
}

/// Of `seeds` those that `method` is asked with: of one that draws nothing at random all would say the same.
#[must_use]
pub fn seeds_of(method: Method, seeds: &[u64]) -> Vec<u64> {
    let all = if method.draws_at_random() {
        seeds.len()
    } else {
        1
    };
    seeds.iter().take(all).copied().collect()
}

/// Cases on one map together, maps in the order in which they first come.
#[must_use]
pub fn by_map(cases: &[Case]) -> Vec<Case> {
    let mut maps: Vec<&Path> = Vec::new();
    for c in cases {
        if !maps.contains(&c.map.as_path()) {
            maps.push(&c.map);
        }
    }
    let mut sorted = cases.to_vec();
    sorted.sort_by_key(|c| maps.iter().position(|m| *m == c.map));
    sorted
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_worker_says_is_understood() {
        let said = Said::Map {
            cost: MapCost::default(),
            peak: Some(7),
        };
        let text = serde_json::to_string(&said).unwrap();
        assert!(text.starts_with(r#"{"said":"map""#), "{text}");
        assert!(matches!(
            serde_json::from_str(&text).unwrap(),
            Said::Map { peak: Some(7), .. }
        ));
    }
}
