//! The tables that `winze eval` prints.

use super::calibration::Calibration;
use super::coverage::Coverage;
use super::labels::Labels;
use super::rates::{Quantiles, Rate};
use super::steps::Step;
use super::summary::{MethodCost, Summary};
use crate::table::Table;

/// What was answered: rates with their 95 % intervals, in percent.
#[must_use]
pub fn answers(summaries: &[Summary]) -> Table {
    let mut table = Table::new(
        2,
        &[
            "method",
            "family",
            "runs",
            "recall % [95 %]",
            "wrong accepts % [95 %]",
            "refused",
            "right",
            "pose right % [95 %]",
        ],
    );
    for s in summaries {
        table.row(vec![
            s.method.clone(),
            family(s.family.as_deref()),
            s.runs.to_string(),
            rate(&s.recall),
            // Of all runs, whose number stands before.
            rate(&s.wrong_accepts).replacen(&format!("/{}", s.runs), "", 1),
            s.refusals.count.to_string(),
            s.right.count.to_string(),
            rate(&s.pose_right),
        ]);
    }
    table
}

/// How well: errors over the right poses, the paper's metrics, seconds; last, displacement over all poses of queries
/// that are in the map, right or wrong.
#[must_use]
pub fn accuracy(summaries: &[Summary]) -> Table {
    let mut table = Table::new(
        2,
        &[
            "method",
            "family",
            "m p50",
            "p95",
            "° p50",
            "p95",
            "inliers %",
            "RMSE m",
            "s p50",
            "p95",
            "max",
            "all m p50",
            "p95",
        ],
    );
    for s in summaries {
        let number =
            |q: Option<Quantiles>, get: fn(Quantiles) -> f64, digits| decimal(q.map(get), digits);
        table.row(vec![
            s.method.clone(),
            family(s.family.as_deref()),
            number(s.translation_m, |q| q.median, 3),
            number(s.translation_m, |q| q.p95, 3),
            number(s.rotation_deg, |q| q.median, 2),
            number(s.rotation_deg, |q| q.p95, 2),
            decimal(s.inlier_fraction.map(|f| 100.0 * f), 2),
            decimal(s.inlier_rmse, 4),
            number(s.seconds, |q| q.median, 2),
            number(s.seconds, |q| q.p95, 2),
            number(s.seconds, |q| q.max, 2),
            number(s.translation_m_of_all, |q| q.median, 2),
            number(s.translation_m_of_all, |q| q.p95, 2),
        ]);
    }
    table
}

/// What each refiner makes of the poses before it.
#[must_use]
pub fn step_table(steps: &[Step]) -> Table {
    let mut table = Table::new(
        3,
        &[
            "before",
            "after",
            "family",
            "right before",
            "better",
            "worse",
            "lost",
            "won",
            "m p50 before",
            "after",
            "largest loss m",
            "of case",
        ],
    );
    for s in steps {
        table.row(vec![
            s.before.clone(),
            s.after.clone(),
            family(s.family.as_deref()),
            s.right_before.to_string(),
            s.better.to_string(),
            s.worse.to_string(),
            s.lost.to_string(),
            s.won.to_string(),
            decimal(s.median_before_m, 3),
            decimal(s.median_after_m, 3),
            decimal(s.largest_loss.as_ref().map(|_| s.largest_loss_m), 3),
            s.largest_loss.clone().unwrap_or_else(|| "-".into()),
        ]);
    }
    table
}

/// Whether confidence means what it says, per bin, over all families.
#[must_use]
pub fn bin_table(calibrations: &[Calibration]) -> Table {
    let head = [
        "method",
        "confidence from",
        "to",
        "its mean",
        "right % [95 %]",
        "agrees",
    ];
    let mut table = Table::new(1, &head);
    for c in calibrations.iter().filter(|c| c.family.is_none()) {
        for b in &c.bins {
            table.row(vec![
                c.method.clone(),
                decimal(Some(b.from), 4),
                decimal(Some(b.to), 4),
                decimal(Some(b.confidence), 4),
                rate(&b.right),
                b.judged().into(),
            ]);
        }
    }
    table
}

/// Scores of the confidence.
#[must_use]
pub fn calibration_table(calibrations: &[Calibration]) -> Table {
    let head = [
        "method",
        "family",
        "answers",
        "Brier",
        "ECE",
        "overconfidence",
    ];
    let mut table = Table::new(2, &head);
    for c in calibrations {
        table.row(vec![
            c.method.clone(),
            family(c.family.as_deref()),
            c.answers.to_string(),
            decimal(Some(c.brier), 4),
            decimal(Some(c.calibration_error), 4),
            decimal(Some(c.overconfidence), 4),
        ]);
    }
    table
}

/// Whether the covariance covers the error.
#[must_use]
pub fn coverage_table(coverages: &[Coverage]) -> Table {
    let head = [
        "method",
        "family",
        "covered",
        "NEES",
        "p50",
        "within 1 σ %",
        "within 2 σ %",
        "NEES of H⁻¹",
    ];
    let mut table = Table::new(2, &head);
    let each = |shares: [f64; 6]| shares.map(|s| format!("{:.0}", 100.0 * s)).join(" ");
    for c in coverages {
        table.row(vec![
            c.method.clone(),
            family(c.family.as_deref()),
            format!("{}/{}", c.answers, c.located),
            decimal(Some(c.answered.mean_nees), 1),
            decimal(Some(c.answered.median_nees), 1),
            each(c.answered.within_one),
            each(c.answered.within_two),
            decimal(c.inverse_hessian.as_ref().map(|p| p.mean_nees), 0),
        ]);
    }
    table
}

/// Maps and memory.
#[must_use]
pub fn costs(costs: &[MethodCost]) -> Table {
    let mut table = Table::new(
        1,
        &[
            "method",
            "maps",
            "seconds to read them",
            "seconds to prepare them",
            "peak memory MiB",
            "errors",
        ],
    );
    for c in costs {
        let sum = |get: fn(&super::MapCost) -> f64| c.maps.iter().map(get).sum::<f64>();
        #[expect(clippy::cast_precision_loss, reason = "megabytes")]
        let memory = c.peak_memory_bytes.map(|b| b as f64 / 1_048_576.0);
        table.row(vec![
            c.method.clone(),
            c.maps.len().to_string(),
            decimal(Some(sum(|m| m.read_seconds)), 2),
            decimal(Some(sum(|m| m.work_seconds)), 2),
            decimal(memory, 0),
            c.errors.to_string(),
        ]);
    }
    table
}

/// What the cases are.
#[must_use]
pub fn label_table(labels: &[Labels]) -> Table {
    let mut table = Table::new(
        1,
        &[
            "family",
            "cases",
            "out of map",
            "ambiguous",
            "unobservable",
            "counted for recall",
            "gravity-aligned",
            "overlap p50",
            "bend m p50",
        ],
    );
    for l in labels {
        let mut row = vec![family(l.family.as_deref())];
        row.extend(
            [
                l.cases,
                l.out_of_map,
                l.ambiguous,
                l.unobservable,
                l.counted,
                l.gravity_aligned,
            ]
            .map(|n| n.to_string()),
        );
        row.extend([decimal(l.overlap, 3), decimal(l.bend_rms_m, 3)]);
        table.row(row);
    }
    table
}

fn family(name: Option<&str>) -> String {
    name.unwrap_or("all").to_owned()
}

/// `61/100 61.0 [51.2-70.0]`; `-` where there is nothing to ask.
fn rate(r: &Rate) -> String {
    match (r.share, r.low, r.high) {
        (Some(share), Some(low), Some(high)) => format!(
            "{}/{} {} [{}-{}]",
            r.count,
            r.of,
            percent(share),
            percent(low),
            percent(high)
        ),
        _ => "-".into(),
    }
}

/// One decimal, but none for all of it.
fn percent(share: f64) -> String {
    if share >= 0.9995 {
        "100".into()
    } else {
        format!("{:.1}", 100.0 * share)
    }
}

/// A number with so many decimals; `-` where there is none.
pub(super) fn decimal(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |v| format!("{v:.digits$}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{Class, Mark, summaries, tests::run};

    #[test]
    fn tables_fit_120_columns() {
        let found = Mark {
            counted: true,
            has_truth: true,
            pose_right: true,
            translation_m: Some(123.456),
            ..Mark::default()
        };
        let many: Vec<_> = (0..1000)
            .map(|i| {
                let mark = if i % 2 == 0 { found } else { Mark::default() };
                run("fpfh+ndt+icp", "low-overlap", Class::WrongAccept, mark)
            })
            .collect();
        let s = summaries(&many);
        for table in [answers(&s), accuracy(&s)] {
            let text = table.to_text();
            assert!(text.lines().all(|l| l.chars().count() <= 120), "{text}");
        }
        let text = answers(&s).to_text();
        assert!(text.contains("0/500 0.0 [0.0-0.8]"), "{text}");
        assert!(text.contains("1000 100 [99.6-100]"), "{text}");
        assert_eq!(rate(&Rate::new(0, 0)), "-");
    }
}
