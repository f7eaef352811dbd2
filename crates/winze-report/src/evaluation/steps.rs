//! What each refiner makes of the poses that the methods share before it, in pairs: same case, same seed.

use std::collections::HashMap;

use serde::Serialize;

use super::Run;
use super::rates::median_of_all;
use super::summary::distinct;

/// Methods that differ by one refiner.
const STEPS: [(&str, &str); 4] = [
    ("fpfh", "fpfh+ndt"),
    ("fpfh", "fpfh+icp"),
    ("fpfh+ndt", "fpfh+ndt+icp"),
    ("fpfh+icp", "fpfh+ndt+icp"),
];

/// Displacements that differ by less than this are called the same, metres.
const SAME: f64 = 0.002;

/// A refiner's effect on the right poses of one family. Displacements are those of the query's centroid, across what the case
/// leaves open.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Step {
    /// The method without the refiner.
    pub before: String,
    /// The method with it.
    pub after: String,
    /// The family; null for all together.
    pub family: Option<String>,
    /// Runs whose pose is right before.
    pub right_before: usize,
    /// Of those, nearer to the truth after, by more than 2 mm.
    pub better: usize,
    /// Further from it, by more than 2 mm, or without a pose.
    pub worse: usize,
    /// Right no more.
    pub lost: usize,
    /// Runs whose pose is wrong before and right after.
    pub won: usize,
    /// Median displacement of those that were right before, metres.
    pub median_before_m: Option<f64>,
    /// And after; one that has no pose counts as the worst there is.
    pub median_after_m: Option<f64>,
    /// The most that one lost that kept a pose, metres.
    pub largest_loss_m: f64,
    /// The case that lost it; null where none lost anything.
    pub largest_loss: Option<String>,
}

/// The steps between the methods that were run, per family and over all.
#[must_use]
pub fn steps(runs: &[Run]) -> Vec<Step> {
    let families = distinct(runs.iter().map(|r| r.family.as_str()));
    let groups: Vec<Option<&str>> = families.into_iter().map(Some).chain([None]).collect();
    let mut out = Vec::new();
    for (before, after) in STEPS {
        for family in &groups {
            let step = step(runs, before, after, *family);
            if step.right_before + step.won > 0 {
                out.push(step);
            }
        }
    }
    out
}

/// Of the runs that both methods have.
fn step(runs: &[Run], before: &str, after: &str, family: Option<&str>) -> Step {
    let of_family = |r: &&Run| family.is_none_or(|f| r.family == f);
    let afterwards: HashMap<(&str, u64), &Run> = runs
        .iter()
        .filter(|r| r.method == after)
        .map(|r| ((r.case.as_str(), r.seed), r))
        .collect();
    let mut step = Step {
        before: before.into(),
        after: after.into(),
        family: family.map(Into::into),
        ..Step::default()
    };
    let mut displaced = [Vec::new(), Vec::new()];
    for b in runs.iter().filter(|r| r.method == before).filter(of_family) {
        let Some(a) = afterwards.get(&(b.case.as_str(), b.seed)) else {
            continue;
        };
        if !b.mark.pose_right {
            step.won += usize::from(a.mark.pose_right);
            continue;
        }
        step.right_before += 1;
        step.lost += usize::from(!a.mark.pose_right);
        let [was, is] = [b, *a].map(|r| r.mark.observable_translation_m.unwrap_or(f64::INFINITY));
        displaced[0].push(was);
        displaced[1].push(is);
        step.better += usize::from(is < was - SAME);
        step.worse += usize::from(is > was + SAME);
        if is.is_finite() && is - was > step.largest_loss_m {
            step.largest_loss_m = is - was;
            step.largest_loss = Some(b.case.clone());
        }
    }
    step.median_before_m = median_of_all(&displaced[0]);
    step.median_after_m = median_of_all(&displaced[1]);
    step
}

#[cfg(test)]
mod tests {
    use super::super::tests::run;
    use super::super::{Class, Mark};
    use super::*;

    fn at(method: &str, case: &str, family: &str, displaced: f64) -> Run {
        let mark = Mark {
            pose_right: displaced < 0.5,
            has_truth: true,
            observable_translation_m: displaced.is_finite().then_some(displaced),
            ..Mark::default()
        };
        Run {
            case: case.into(),
            ..run(method, family, Class::Right, mark)
        }
    }

    #[test]
    fn pairs_are_of_one_case_and_only_right_poses_can_be_made_worse() {
        let runs = [
            at("fpfh", "a", "x", 0.10),
            at("fpfh", "b", "x", 0.04),
            at("fpfh", "c", "x", 3.00),
            at("fpfh", "d", "y", 0.20),
            at("fpfh", "alone", "y", 0.20),
            at("fpfh+ndt", "d", "y", f64::INFINITY),
            at("fpfh+ndt", "c", "x", 0.02),
            at("fpfh+ndt", "b", "x", 0.60),
            at("fpfh+ndt", "a", "x", 0.01),
        ];
        let found = steps(&runs);
        assert_eq!(found.len(), 3, "{found:?}");
        let (x, y, all) = (&found[0], &found[1], &found[2]);
        assert_eq!(
            (x.right_before, x.better, x.worse, x.lost, x.won),
            (2, 1, 1, 1, 1)
        );
        assert_eq!(
            (x.median_before_m, x.median_after_m),
            (Some(0.07), Some(0.305))
        );
        assert!((x.largest_loss_m - 0.56).abs() < 1e-12);
        assert_eq!(x.largest_loss.as_deref(), Some("b"));
        assert_eq!((y.right_before, y.worse, y.lost), (1, 1, 1));
        assert_eq!((y.median_after_m, y.largest_loss.as_deref()), (None, None));
        assert_eq!((all.right_before, all.family.as_deref()), (3, None));
    }
}
