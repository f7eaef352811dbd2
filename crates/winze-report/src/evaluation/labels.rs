//! What the cases are: shares that later work must not shrink.

use serde::Serialize;

use super::mark::Case;

/// How many cases of a family carry each label.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
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
}

/// The labels of each family, in the order in which they come, and of all together at the end.
/// Given are each case's family, what is true of it, and whether it is gravity-aligned.
#[must_use]
pub fn labels<'a>(cases: impl IntoIterator<Item = (&'a str, &'a Case, bool)>) -> Vec<Labels> {
    let mut families: Vec<Labels> = Vec::new();
    let mut all = Labels::default();
    for (family, case, upright) in cases {
        let at = families
            .iter()
            .position(|l| l.family.as_deref() == Some(family))
            .unwrap_or_else(|| {
                families.push(Labels {
                    family: Some(family.to_owned()),
                    ..Labels::default()
                });
                families.len() - 1
            });
        for l in [&mut families[at], &mut all] {
            let open = !case.unobservable.is_empty();
            l.cases += 1;
            l.out_of_map += usize::from(case.truth.is_none());
            l.ambiguous += usize::from(case.ambiguous);
            l.unobservable += usize::from(open);
            l.counted += usize::from(case.truth.is_some() && !case.ambiguous && !open);
            l.gravity_aligned += usize::from(upright);
        }
    }
    families.push(all);
    families
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
        let cases = [("a", &plain, true), ("b", &out, false), ("a", &twin, false)];
        let l = labels(cases);
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
