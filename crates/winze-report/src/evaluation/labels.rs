//! What the cases are: shares that later work must not shrink.

use serde::Serialize;

use super::mark::Case;
use super::rates::quantile;

/// How many cases of a family carry each label.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Labels {
    /// The family; null for all together.
    pub family: Option<String>,
    /// Cases.
    pub cases: usize,
    /// The query is not in the map.
    pub out_of_map: usize,
    /// Another place fits within the sensor's noise.
    pub ambiguous: usize,
    /// Some motion is unobservable.
    pub unobservable: usize,
    /// In the denominator of recall: none of the above.
    pub counted: usize,
    /// Both clouds have z up.
    pub gravity_aligned: usize,
    /// Median share of a query that the map holds, over the cases that tell.
    pub overlap: Option<f64>,
    /// Median bend of a query, metres, likewise.
    pub bend_rms_m: Option<f64>,
}

/// A case with its labels.
#[derive(Debug, Clone, Copy)]
pub struct Labelled<'a> {
    /// Its family.
    pub family: &'a str,
    /// What is true of it.
    pub truth: &'a Case,
    /// Both clouds have z up.
    pub gravity_aligned: bool,
    /// Share of the query that the map holds.
    pub overlap: Option<f64>,
    /// What a rigid pose cannot mend of the query, metres.
    pub bend_rms_m: Option<f64>,
}

/// The labels of each family, in the order in which they come, and of all together at the end.
#[must_use]
pub fn labels<'a>(cases: impl IntoIterator<Item = Labelled<'a>>) -> Vec<Labels> {
    let cases: Vec<Labelled<'_>> = cases.into_iter().collect();
    let mut families: Vec<&str> = Vec::new();
    for c in &cases {
        if !families.contains(&c.family) {
            families.push(c.family);
        }
    }
    let of = |family: Option<&str>| {
        let own: Vec<&Labelled<'_>> = cases
            .iter()
            .filter(|c| family.is_none_or(|f| f == c.family))
            .collect();
        Labels::of(family, &own)
    };
    let mut out: Vec<Labels> = families.iter().map(|f| of(Some(f))).collect();
    out.push(of(None));
    out
}

impl Labels {
    fn of(family: Option<&str>, cases: &[&Labelled<'_>]) -> Self {
        let count = |is: &dyn Fn(&Labelled<'_>) -> bool| cases.iter().filter(|c| is(c)).count();
        let open = |c: &Labelled<'_>| !c.truth.unobservable.is_empty();
        let median = |value: &dyn Fn(&Labelled<'_>) -> Option<f64>| {
            let values: Vec<f64> = cases.iter().filter_map(|c| value(c)).collect();
            quantile(&values, 0.5)
        };
        Self {
            family: family.map(ToOwned::to_owned),
            cases: cases.len(),
            out_of_map: count(&|c| c.truth.truth.is_none()),
            ambiguous: count(&|c| c.truth.ambiguous),
            unobservable: count(&open),
            counted: count(&|c| c.truth.truth.is_some() && !c.truth.ambiguous && !open(c)),
            gravity_aligned: count(&|c| c.gravity_aligned),
            overlap: median(&|c| c.overlap),
            bend_rms_m: median(&|c| c.bend_rms_m),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use winze::Pose;

    #[test]
    fn labels_are_counted_per_family_and_over_all() {
        let plain = Case {
            truth: Some(Pose::identity()),
            ..Case::default()
        };
        let twin = Case {
            ambiguous: true,
            ..plain.clone()
        };
        let out = Case::default();
        let case = |family, truth, gravity_aligned, overlap| Labelled {
            family,
            truth,
            gravity_aligned,
            overlap,
            bend_rms_m: None,
        };
        let l = labels([
            case("a", &plain, true, Some(0.5)),
            case("b", &out, false, None),
            case("a", &twin, false, Some(0.7)),
        ]);
        assert_eq!((l[0].overlap, l[1].overlap), (Some(0.6), None));
        assert_eq!(l.len(), 3);
        let numbers = |l: &Labels| {
            [
                l.cases,
                l.out_of_map,
                l.ambiguous,
                l.counted,
                l.gravity_aligned,
            ]
        };
        assert_eq!(numbers(&l[0]), [2, 0, 1, 1, 1]);
        assert_eq!(numbers(&l[1]), [1, 1, 0, 0, 0]);
        assert_eq!((numbers(&l[2]), &l[2].family), ([3, 1, 1, 1, 1], &None));
    }
}
