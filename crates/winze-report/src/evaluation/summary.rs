//! Rates, errors and times over many runs.

use serde::{Deserialize, Serialize};
use winze::Verdict;

use super::Run;
use super::mark::Class;
use super::rates::{Quantiles, Rate, quantile};

/// One method on one family, or on all of them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The method's name.
    pub method: String,
    /// The family; null for all together.
    pub family: Option<String>,
    /// Runs: cases times seeds.
    pub runs: usize,
    /// Located within tolerance, of the runs on cases with a truth, not ambiguous, observable.
    pub recall: Rate,
    /// Believed and wrong, of all runs.
    pub wrong_accepts: Rate,
    /// Not answered though an answer was there to be had, of all runs.
    pub refusals: Rate,
    /// The right thing said, of all runs.
    pub right: Rate,
    /// The best pose within tolerance, whatever the verdict, of the runs with a truth.
    pub pose_right: Rate,
    /// Runs per verdict.
    pub verdicts: Verdicts,
    /// Displacement, metres, over the runs whose pose is right (across what is unobservable).
    pub translation_m: Option<Quantiles>,
    /// Angle, degrees, likewise.
    pub rotation_deg: Option<Quantiles>,
    /// Displacement, metres, over all runs with a truth and a pose.
    pub translation_m_of_all: Option<Quantiles>,
    /// Angle, degrees, likewise.
    pub rotation_deg_of_all: Option<Quantiles>,
    /// Median of the paper's inlier share over the runs with a pose.
    pub inlier_fraction: Option<f64>,
    /// Median of the paper's inlier RMSE likewise, metres.
    pub inlier_rmse: Option<f64>,
    /// Seconds an answer took, the map at hand; runs with work kept from another seed left out.
    pub seconds: Option<Quantiles>,
}

/// How often each verdict was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Verdicts {
    /// Here it is.
    pub located: usize,
    /// Several places fit.
    pub ambiguous: usize,
    /// Some directions are open.
    pub degenerate: usize,
    /// No place fits.
    pub not_found: usize,
    /// Too little geometry.
    pub insufficient: usize,
}

/// What a method costs besides its answers' seconds. Each method runs in a process of its own.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MethodCost {
    /// The method's name.
    pub method: String,
    /// The most memory that its process held, bytes; null where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// Each map, prepared once.
    pub maps: Vec<MapCost>,
    /// Cases that gave no answer.
    pub errors: usize,
}

/// Time on one map.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MapCost {
    /// Its file.
    pub map: String,
    /// Its points.
    pub points: usize,
    /// Reading it.
    pub read_seconds: f64,
    /// Measuring, preparing, describing it, its Gaussians and its tree, at all voxel sizes asked for.
    pub work_seconds: f64,
}

impl MethodCost {
    /// Adds maps. One that is already there was prepared again, since a process died or an evaluation was cut short, and
    /// counts once.
    pub fn add_maps(&mut self, maps: impl IntoIterator<Item = MapCost>) {
        for new in maps {
            if !self.maps.iter().any(|own| own.map == new.map) {
                self.maps.push(new);
            }
        }
    }
}

impl Summary {
    /// Of the runs given.
    #[must_use]
    pub fn of(method: &str, family: Option<&str>, runs: &[&Run]) -> Self {
        let class = |class| Rate::of(runs, |r| r.mark.class == class);
        let picked =
            |keep: &dyn Fn(&Run) -> bool, value: &dyn Fn(&Run) -> Option<f64>| -> Vec<f64> {
                let kept = runs.iter().filter(|r| keep(r));
                kept.filter_map(|r| value(r)).collect()
            };
        let right = |value: &dyn Fn(&Run) -> Option<f64>| {
            Quantiles::of(&picked(&|r| r.mark.pose_right, value))
        };
        let any = |value: &dyn Fn(&Run) -> Option<f64>| picked(&|_| true, value);
        let counted: Vec<&&Run> = runs.iter().filter(|r| r.mark.counted).collect();
        let with_truth: Vec<&&Run> = runs.iter().filter(|r| r.mark.has_truth).collect();
        Self {
            method: method.to_owned(),
            family: family.map(ToOwned::to_owned),
            runs: runs.len(),
            recall: Rate::of(&counted, |r| r.mark.recalled),
            wrong_accepts: class(Class::WrongAccept),
            refusals: class(Class::Refusal),
            right: class(Class::Right),
            pose_right: Rate::of(&with_truth, |r| r.mark.pose_right),
            verdicts: Verdicts::of(runs),
            translation_m: right(&|r| r.mark.observable_translation_m),
            rotation_deg: right(&|r| r.mark.observable_rotation_deg),
            translation_m_of_all: Quantiles::of(&any(&|r| r.mark.translation_m)),
            rotation_deg_of_all: Quantiles::of(&any(&|r| r.mark.rotation_deg)),
            inlier_fraction: quantile(&any(&|r| r.inliers.map(|i| i.fraction)), 0.5),
            inlier_rmse: quantile(&any(&|r| r.inliers.and_then(|i| i.rmse)), 0.5),
            seconds: Quantiles::of(&picked(&|r| !r.query_kept, &|r| Some(r.seconds))),
        }
    }
}

impl Verdicts {
    fn of(runs: &[&Run]) -> Self {
        let count = |verdict| runs.iter().filter(|r| r.verdict == Some(verdict)).count();
        Self {
            located: count(Verdict::Located),
            ambiguous: count(Verdict::Ambiguous),
            degenerate: count(Verdict::Degenerate),
            not_found: count(Verdict::NotFound),
            insufficient: count(Verdict::Insufficient),
        }
    }
}

/// A summary for each method and family, and for each method over all families, in the order in
/// which they come.
#[must_use]
pub fn summaries(runs: &[Run]) -> Vec<Summary> {
    by_family(runs, |method, family, runs| {
        Some(Summary::of(method, family, runs))
    })
}

/// What `of` makes of each method's runs on each family, and of those over all families, in the order in which they come.
pub(super) fn by_family<T>(
    runs: &[Run],
    of: impl Fn(&str, Option<&str>, &[&Run]) -> Option<T>,
) -> Vec<T> {
    let methods = distinct(runs.iter().map(|r| r.method.as_str()));
    let families = distinct(runs.iter().map(|r| r.family.as_str()));
    let mut out = Vec::new();
    for method in methods {
        let of_method: Vec<&Run> = runs.iter().filter(|r| r.method == method).collect();
        for family in &families {
            let of_both: Vec<&Run> = of_method
                .iter()
                .copied()
                .filter(|r| r.family == *family)
                .collect();
            if !of_both.is_empty() {
                out.extend(of(method, Some(family), &of_both));
            }
        }
        out.extend(of(method, None, &of_method));
    }
    out
}

pub(super) fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut seen: Vec<&str> = Vec::new();
    for name in names {
        if !seen.contains(&name) {
            seen.push(name);
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{Mark, tests::run};

    #[test]
    fn counts_and_quantiles_by_hand() {
        let found = |metres: f64| Mark {
            counted: true,
            recalled: true,
            has_truth: true,
            pose_right: true,
            translation_m: Some(metres),
            observable_translation_m: Some(metres),
            ..Mark::default()
        };
        let far = Mark {
            counted: true,
            has_truth: true,
            translation_m: Some(30.0),
            observable_translation_m: Some(30.0),
            ..Mark::default()
        };
        let mut runs = vec![
            run("auto", "a", Class::Right, found(0.1)),
            run("auto", "a", Class::Right, found(0.2)),
            run("auto", "a", Class::Right, found(0.3)),
            run("auto", "a", Class::WrongAccept, far),
            // Not in the map: right to refuse, and no matter of recall.
            run("auto", "b", Class::Right, Mark::default()),
            run("fpfh", "b", Class::Refusal, Mark::default()),
        ];
        runs[4].verdict = Some(Verdict::NotFound);
        runs[1].query_kept = true;
        runs[1].seconds = 900.0;
        let s = summaries(&runs);
        let names: Vec<_> = s
            .iter()
            .map(|s| (s.method.as_str(), s.family.as_deref(), s.runs))
            .collect();
        assert_eq!(
            names,
            [
                ("auto", Some("a"), 4),
                ("auto", Some("b"), 1),
                ("auto", None, 5),
                ("fpfh", Some("b"), 1),
                ("fpfh", None, 1)
            ]
        );
        let all = &s[2];
        assert_eq!((all.recall.count, all.recall.of), (3, 4));
        assert_eq!((all.wrong_accepts.count, all.wrong_accepts.of), (1, 5));
        assert_eq!((all.right.count, all.refusals.count), (4, 0));
        assert_eq!((all.pose_right.count, all.pose_right.of), (3, 4));
        assert_eq!((all.verdicts.located, all.verdicts.not_found), (4, 1));
        assert_eq!(all.translation_m.unwrap().median, 0.2);
        assert_eq!(all.translation_m.unwrap().max, 0.3);
        assert_eq!(all.translation_m_of_all.unwrap().median, 0.25);
        assert_eq!(all.seconds.unwrap().max, 1.0);
        assert_eq!((s[1].recall.of, s[1].recall.share), (0, None));
        assert_eq!(s[4].refusals.share, Some(1.0));
    }
}
