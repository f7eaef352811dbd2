//! What is said of a job, taken in.

use winze_report::evaluation::{Run, Trouble};

use super::cases::Case;

/// Runs and troubles of methods that share a process, as they come.
#[derive(Debug)]
pub struct Gathering<'a> {
    cases: &'a [Case],
    methods: &'a [(String, Vec<u64>)],
    runs: Vec<Run>,
    troubles: Vec<Trouble>,
}

impl<'a> Gathering<'a> {
    /// Of nothing yet: all of `cases`, and the methods' names, each with its seeds.
    #[must_use]
    pub fn new(cases: &'a [Case], methods: &'a [(String, Vec<u64>)]) -> Self {
        Self {
            cases,
            methods,
            runs: Vec::new(),
            troubles: Vec::new(),
        }
    }

    /// Takes in a run.
    pub fn run(&mut self, run: Run) {
        self.runs.push(run);
    }

    /// Takes in that a case gives no answer by a method, or by any.
    pub fn trouble(&mut self, case: &str, method: Option<&str>, message: &str) {
        let of = self.methods.iter().map(|(m, _)| m);
        let of = of.filter(|m| method.is_none_or(|own| own == *m));
        self.troubles.extend(of.map(|method| Trouble {
            case: case.to_owned(),
            method: method.clone(),
            message: message.to_owned(),
        }));
    }

    /// All runs, methods one after the other, each in the order of the cases; and the troubles. What broke off stays in
    /// every denominator: a run without a verdict stands in its place. Where a process that ran several methods died,
    /// those that had answered are in no trouble.
    ///
    /// # Errors
    /// As [`Case::truth`].
    pub fn end(mut self) -> anyhow::Result<(Vec<Run>, Vec<Trouble>)> {
        let mut troubled = Vec::new();
        for trouble in self.troubles {
            let case = self.cases.iter().find(|c| c.name == trouble.case);
            let own = self.methods.iter().find(|(m, _)| *m == trouble.method);
            let (Some(case), Some((method, seeds))) = (case, own) else {
                continue;
            };
            let truth = case.truth()?;
            let before = self.runs.len();
            for &seed in seeds {
                let is = |r: &Run| r.case == case.name && r.method == *method && r.seed == seed;
                if !self.runs.iter().any(is) {
                    let (name, family) = (&case.name, &case.family);
                    let why = &trouble.message;
                    self.runs.push(Run {
                        sensor: case.sensor.clone(),
                        overlap: case.overlap,
                        ..Run::broken(name, family, method, seed, &truth, why)
                    });
                }
            }
            if self.runs.len() > before {
                troubled.push(trouble);
            }
        }
        // Seeds stay in their order.
        self.runs.sort_by_key(|r| {
            (
                self.methods.iter().position(|(m, _)| *m == r.method),
                self.cases.iter().position(|c| c.name == r.case),
            )
        });
        Ok((self.runs, troubled))
    }
}
