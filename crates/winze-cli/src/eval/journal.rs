//! What a long evaluation has found so far, kept in a file, so that one that was cut short can go on.
//!
//! One JSON line each: first what the runs belong to, then runs and costs as they come.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, bail};
use serde::{Deserialize, Serialize};
use winze_report::evaluation::{MapCost, MethodCost, Run};

/// What all runs of a journal have in common.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Head {
    pub(super) winze: String,
    pub(super) config_digest: String,
    pub(super) cases_digest: String,
    /// Methods share a process: seconds are not those of methods apart.
    pub(super) together: bool,
    /// Processes at once, and threads of each.
    pub(super) jobs: usize,
    pub(super) threads: usize,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Line {
    Head(Head),
    Run(Box<Run>),
    Map {
        method: String,
        cost: MapCost,
        peak: Option<u64>,
    },
}

/// A journal that is open for more.
pub(super) struct Journal {
    path: PathBuf,
    file: Mutex<File>,
    runs: HashMap<(String, String), Vec<Run>>,
    costs: HashMap<String, MethodCost>,
}

impl Journal {
    /// Opens or begins one.
    ///
    /// # Errors
    /// Where it cannot be read or written, or is of other cases, settings, or another version.
    pub(super) fn open(path: &Path, head: &Head) -> anyhow::Result<Self> {
        let at = path.display();
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(path)
            .with_context(|| format!("{at}: cannot be written"))?;
        let mut text = String::new();
        file.read_to_string(&mut text)
            .with_context(|| format!("{at}: cannot be read"))?;
        // A last line that was cut short is written anew.
        let whole = text.rfind('\n').map_or(0, |end| end + 1);
        if whole == 0 && !text.is_empty() {
            bail!("{at}: is no journal of `winze eval`; name another file");
        }
        let mut journal = Self {
            path: path.to_owned(),
            file: Mutex::new(file),
            runs: HashMap::new(),
            costs: HashMap::new(),
        };
        for (i, line) in text.get(..whole).unwrap_or_default().lines().enumerate() {
            let line: Line = serde_json::from_str(line).with_context(|| {
                format!(
                    "{at}: line {} is not of a journal of `winze eval`; name another file",
                    i + 1
                )
            })?;
            journal.remember(line, i == 0, head)?;
        }
        let mut file = journal.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.set_len(whole as u64)
            .and_then(|()| file.seek(SeekFrom::End(0)))
            .with_context(|| format!("{at}: cannot be written"))?;
        drop(file);
        if whole == 0 {
            journal.write(&Line::Head(head.clone()))?;
        }
        Ok(journal)
    }

    fn remember(&mut self, line: Line, first: bool, head: &Head) -> anyhow::Result<()> {
        let at = self.path.display();
        match line {
            Line::Head(own) if first => {
                if own != *head {
                    bail!(
                        "{at}: holds runs of {}; name another file, or delete it",
                        if own.cases_digest != head.cases_digest {
                            "another case file"
                        } else if own.config_digest != head.config_digest {
                            "other settings"
                        } else if own.winze != head.winze {
                            "another version"
                        } else {
                            "methods run otherwise (--together, --jobs, --threads)"
                        }
                    );
                }
            }
            Line::Run(run) if !first => {
                let key = (run.method.clone(), run.case.clone());
                self.runs.entry(key).or_default().push(*run);
            }
            Line::Map { method, cost, peak } if !first => {
                let kept = self.costs.entry(method.clone()).or_insert(MethodCost {
                    method,
                    ..MethodCost::default()
                });
                kept.peak_memory_bytes = kept.peak_memory_bytes.max(peak);
                kept.add_maps([cost]);
            }
            _ => bail!("{at}: is no journal of `winze eval`; name another file"),
        }
        Ok(())
    }

    /// The runs of a case with all of `seeds`, if they are all there.
    pub(super) fn runs(&self, method: &str, case: &str, seeds: &[u64]) -> Option<Vec<Run>> {
        let own = self.runs.get(&(method.to_owned(), case.to_owned()))?;
        seeds
            .iter()
            .map(|s| own.iter().find(|r| r.seed == *s).cloned())
            .collect()
    }

    /// What a method's earlier work cost.
    pub(super) fn cost(&self, method: &str) -> Option<&MethodCost> {
        self.costs.get(method)
    }

    /// Notes a run.
    pub(super) fn run(&self, run: &Run) -> anyhow::Result<()> {
        self.write(&Line::Run(Box::new(run.clone())))
    }

    /// Notes what a map cost a method.
    pub(super) fn map(
        &self,
        method: &str,
        cost: &MapCost,
        peak: Option<u64>,
    ) -> anyhow::Result<()> {
        self.write(&Line::Map {
            method: method.to_owned(),
            cost: cost.clone(),
            peak,
        })
    }

    fn write(&self, line: &Line) -> anyhow::Result<()> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(&text)
            .with_context(|| format!("{}: cannot be written", self.path.display()))
    }
}
