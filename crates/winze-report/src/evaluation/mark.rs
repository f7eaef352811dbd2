//! What one answer is worth, given the truth.

use serde::{Deserialize, Serialize};
use winze::degeneracy::{DirectionKind, Unobservable};
use winze::vec3::{cross, dot, norm};
use winze::{Pose, Verdict};

/// A direction that an answer names counts as one of the case's within this angle, radians (30°).
const SAME_DIRECTION: f64 = std::f64::consts::FRAC_PI_6;

/// What is true of a case.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Case {
    /// The true `map_from_query`; `None` where the query is not in the map.
    pub truth: Option<Pose>,
    /// How near to it counts as right.
    pub tolerance: Tolerance,
    /// Another place fits within the sensor's noise.
    pub ambiguous: bool,
    /// Such other places.
    pub alternatives: Vec<Pose>,
    /// Motions that the query's surfaces do not resist.
    pub unobservable: Vec<Direction>,
}

/// How near to the truth a pose must be to be right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Displacement of the query's centroid, metres.
    pub translation: f64,
    /// Angle, radians.
    pub rotation: f64,
}

impl Default for Tolerance {
    /// Half a metre and 5 degrees.
    fn default() -> Self {
        Self {
            translation: 0.5,
            rotation: 5f64.to_radians(),
        }
    }
}

/// Sliding along, or turning about (through the query's centroid), a unit vector in map axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Sliding or turning.
    pub kind: DirectionKind,
    /// The unit vector.
    pub direction: [f64; 3],
}

/// See the [module documentation](super).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// What should have been said.
    Right,
    /// Believed, and wrong.
    WrongAccept,
    /// Not said though it could have been.
    #[default]
    Refusal,
}

/// What an answer is worth.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Mark {
    /// Right, harmful or neither.
    pub class: Class,
    /// In the denominator of recall: the query is in the map, its place is not ambiguous and nothing is
    /// unobservable.
    pub counted: bool,
    /// Such a case, located within tolerance.
    pub recalled: bool,
    /// The query is in the map.
    pub has_truth: bool,
    /// The best pose is within tolerance, across what is unobservable, whatever the verdict.
    pub pose_right: bool,
    /// The best pose is within tolerance of one of the case's alternatives.
    pub at_alternative: bool,
    /// Displacement of the query's centroid, metres; null without a pose or a truth.
    pub translation_m: Option<f64>,
    /// Angle, degrees; null likewise.
    pub rotation_deg: Option<f64>,
    /// The displacement across the directions that the case leaves open, metres.
    pub observable_translation_m: Option<f64>,
    /// The angle likewise, degrees.
    pub observable_rotation_deg: Option<f64>,
}

/// Holds an answer against the truth: its verdict, its best pose, and the directions it says are open.
/// `centroid` is that of the query's points, in the query's frame.
#[must_use]
pub fn mark(
    case: &Case,
    verdict: Verdict,
    map_from_query: Option<&Pose>,
    open: &[Unobservable],
    centroid: [f64; 3],
) -> Mark {
    let full = case
        .truth
        .zip(map_from_query)
        .map(|(t, p)| Offset::between(p, &t, centroid, &[]));
    let across = case
        .truth
        .zip(map_from_query)
        .map(|(t, p)| Offset::between(p, &t, centroid, &case.unobservable));
    let within = |o: Option<Offset>| o.is_some_and(|o| o.within(case.tolerance));
    let (at_truth, across_right) = (within(full), within(across));
    let at_alternative = map_from_query.is_some_and(|p| {
        case.alternatives
            .iter()
            .any(|a| Offset::between(p, a, centroid, &case.unobservable).within(case.tolerance))
    });
    let class = match verdict {
        Verdict::Located if at_truth => Class::Right,
        Verdict::Located => Class::WrongAccept,
        Verdict::Degenerate if !across_right => Class::WrongAccept,
        Verdict::Degenerate if names_only(open, &case.unobservable) => Class::Right,
        Verdict::Ambiguous if case.ambiguous && case.truth.is_some() => Class::Right,
        Verdict::NotFound if case.truth.is_none() => Class::Right,
        _ => Class::Refusal,
    };
    let counted = case.truth.is_some() && !case.ambiguous && case.unobservable.is_empty();
    Mark {
        class,
        counted,
        recalled: counted && verdict == Verdict::Located && at_truth,
        has_truth: case.truth.is_some(),
        pose_right: across_right,
        at_alternative,
        translation_m: full.map(|o| o.translation),
        rotation_deg: full.map(|o| o.rotation.to_degrees()),
        observable_translation_m: across.map(|o| o.translation),
        observable_rotation_deg: across.map(|o| o.rotation.to_degrees()),
    }
}

/// How far a pose is from another, metres and radians.
#[derive(Clone, Copy)]
struct Offset {
    translation: f64,
    rotation: f64,
}

impl Offset {
    /// Leaving out motions along `open`.
    fn between(pose: &Pose, truth: &Pose, centroid: [f64; 3], open: &[Direction]) -> Self {
        let distance = pose.distance(truth, centroid);
        let axes = |kind| {
            let of_kind = open.iter().filter(|d| d.kind == kind);
            orthonormal(of_kind.map(|d| d.direction))
        };
        let slides = axes(DirectionKind::Translation);
        let (a, b) = (pose.transform(centroid), truth.transform(centroid));
        let moved = without(std::array::from_fn(|i| a[i] - b[i]), &slides);
        let rotation = match axes(DirectionKind::Rotation)[..] {
            [] => distance.rotation,
            // What is left once turning about the axis is allowed: how far the axis itself is turned.
            [axis] => {
                let turned = pose.compose(&truth.inverse()).rotate(axis);
                let sine = norm(cross(axis, turned));
                libm::atan2(sine, dot(axis, turned))
            }
            // Two open axes reach every attitude.
            _ => 0.0,
        };
        Self {
            translation: if slides.is_empty() {
                distance.translation
            } else {
                norm(moved)
            },
            rotation,
        }
    }

    fn within(self, tolerance: Tolerance) -> bool {
        self.translation <= tolerance.translation && self.rotation <= tolerance.rotation
    }
}

/// Whether something is named, and all of it is among the case's directions.
fn names_only(named: &[Unobservable], case: &[Direction]) -> bool {
    !named.is_empty()
        && named.iter().all(|n| {
            let of_kind = case.iter().filter(|d| d.kind == n.kind);
            let axes = orthonormal(of_kind.map(|d| d.direction));
            let out = norm(without(n.direction, &axes)) / norm(n.direction).max(1e-12);
            !axes.is_empty() && out <= libm::sin(SAME_DIRECTION)
        })
}

/// An orthonormal basis of what the vectors span.
fn orthonormal(vectors: impl Iterator<Item = [f64; 3]>) -> Vec<[f64; 3]> {
    let mut basis: Vec<[f64; 3]> = Vec::new();
    for v in vectors {
        let length = norm(v);
        let rest = without(v, &basis);
        let left = norm(rest);
        // Directions that were measured are never exactly parallel.
        if left > 0.1 * length && basis.len() < 3 {
            basis.push(rest.map(|c| c / left));
        }
    }
    basis
}

/// `v` without its components along the orthonormal `axes`.
fn without(v: [f64; 3], axes: &[[f64; 3]]) -> [f64; 3] {
    axes.iter().fold(v, |v, axis| {
        let along = dot(v, *axis);
        std::array::from_fn(|i| v[i] - along * axis[i])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const C: [f64; 3] = [1000.0, 0.0, 0.0];

    fn case() -> Case {
        Case {
            truth: Some(Pose::from_translation([10.0, 20.0, 0.0])),
            ..Case::default()
        }
    }

    /// The truth of [`case`] moved and turned about the query's centroid.
    fn off(translation: [f64; 3], rotation: [f64; 3]) -> Pose {
        let truth = Pose::from_translation([10.0, 20.0, 0.0]);
        truth.perturbed(translation, rotation, truth.transform(C))
    }

    fn class(case: &Case, verdict: Verdict, pose: &Pose) -> Class {
        mark(case, verdict, Some(pose), &[], C).class
    }

    #[test]
    fn located_is_right_only_at_the_truth() {
        let near = off([0.3, 0.0, 0.4], [0.0, 0.0, 0.08]);
        let m = mark(&case(), Verdict::Located, Some(&near), &[], C);
        assert_eq!(m.class, Class::Right);
        assert!(m.recalled && m.pose_right && m.counted);
        // The centroid's displacement, not that of the origin, which the turn moves by 80 m.
        assert!((m.translation_m.unwrap() - 0.5).abs() < 1e-9);
        assert!((m.rotation_deg.unwrap() - 0.08f64.to_degrees()).abs() < 1e-9);
        for wrong in [
            off([0.6, 0.0, 0.0], [0.0; 3]),
            off([0.0; 3], [0.0, 0.1, 0.0]),
        ] {
            let m = mark(&case(), Verdict::Located, Some(&wrong), &[], C);
            assert_eq!(m.class, Class::WrongAccept);
            assert!(!m.recalled && !m.pose_right);
        }
        let refused = mark(&case(), Verdict::NotFound, Some(&near), &[], C);
        assert_eq!(refused.class, Class::Refusal);
        assert!(refused.pose_right && !refused.recalled && refused.counted);
        let nothing = mark(&case(), Verdict::Insufficient, None, &[], C);
        assert_eq!(
            (nothing.class, nothing.translation_m),
            (Class::Refusal, None)
        );
    }

    #[test]
    fn out_of_the_map_only_not_found_is_right() {
        let out = Case::default();
        let pose = Pose::identity();
        assert_eq!(class(&out, Verdict::NotFound, &pose), Class::Right);
        assert_eq!(class(&out, Verdict::Located, &pose), Class::WrongAccept);
        assert_eq!(class(&out, Verdict::Degenerate, &pose), Class::WrongAccept);
        assert_eq!(class(&out, Verdict::Ambiguous, &pose), Class::Refusal);
        assert!(!mark(&out, Verdict::NotFound, None, &[], C).counted);
    }

    #[test]
    fn an_ambiguous_case_may_be_called_so_or_located_at_the_truth() {
        let twin = off([0.0, 40.0, 0.0], [0.0; 3]);
        let case = Case {
            ambiguous: true,
            alternatives: vec![twin],
            ..case()
        };
        let right = off([0.1, 0.0, 0.0], [0.0; 3]);
        assert_eq!(class(&case, Verdict::Ambiguous, &twin), Class::Right);
        assert_eq!(class(&case, Verdict::Located, &right), Class::Right);
        let m = mark(&case, Verdict::Located, Some(&twin), &[], C);
        assert_eq!(m.class, Class::WrongAccept);
        assert!(m.at_alternative && !m.counted && !m.recalled);
    }

    fn open(direction: [f64; 3]) -> Unobservable {
        Unobservable {
            kind: DirectionKind::Translation,
            direction,
            information: 0.0,
        }
    }

    #[test]
    fn degenerate_is_right_where_it_is_true_and_the_rest_of_the_pose_is_right() {
        let tube = Case {
            unobservable: vec![
                Direction {
                    kind: DirectionKind::Translation,
                    direction: [0.0, 2.0, 0.0],
                },
                Direction {
                    kind: DirectionKind::Rotation,
                    direction: [0.0, 1.0, 0.0],
                },
            ],
            ..case()
        };
        let along = [open([0.0, -0.98, 0.199])];
        // Slid by 7 m and turned by 2 rad about the axis, and a little across.
        let slid = off([0.0, 7.0, 0.0], [0.0, 2.0, 0.0]);
        let slid = slid.perturbed([0.2, 0.0, 0.0], [0.05, 0.0, 0.0], slid.transform(C));
        let m = mark(&tube, Verdict::Degenerate, Some(&slid), &along, C);
        assert_eq!(m.class, Class::Right, "{m:?}");
        assert!((m.observable_translation_m.unwrap() - 0.2).abs() < 1e-9);
        assert!((m.observable_rotation_deg.unwrap() - 0.05f64.to_degrees()).abs() < 1e-6);
        assert!(m.translation_m.unwrap() > 7.0 && !m.counted && m.pose_right);
        // Sure of itself there, it is wrong.
        assert_eq!(class(&tube, Verdict::Located, &slid), Class::WrongAccept);
        let across = off([1.0, 7.0, 0.0], [0.0; 3]);
        let m = mark(&tube, Verdict::Degenerate, Some(&across), &along, C);
        assert_eq!(m.class, Class::WrongAccept);
        // The right place, but something else is said to be open.
        let m = mark(
            &tube,
            Verdict::Degenerate,
            Some(&slid),
            &[open([1.0, 0.0, 0.0])],
            C,
        );
        assert_eq!(m.class, Class::Refusal);
        // Where all is observable, it is too modest at the truth and wrong elsewhere.
        let right = off([0.0; 3], [0.0; 3]);
        let m = mark(&case(), Verdict::Degenerate, Some(&right), &along, C);
        assert_eq!(m.class, Class::Refusal);
        let m = mark(&case(), Verdict::Degenerate, Some(&slid), &along, C);
        assert_eq!(m.class, Class::WrongAccept);
    }

    #[test]
    fn open_directions_need_not_be_square_to_each_other() {
        let wall = Case {
            unobservable: [[1.0, 0.0, 0.0], [0.7, 0.7, 0.0], [0.99, 0.01, 0.0]]
                .map(|direction| Direction {
                    kind: DirectionKind::Translation,
                    direction,
                })
                .to_vec(),
            ..case()
        };
        let m = mark(
            &wall,
            Verdict::Degenerate,
            Some(&off([3.0, -4.0, 0.25], [0.0; 3])),
            &[],
            C,
        );
        assert!((m.observable_translation_m.unwrap() - 0.25).abs() < 1e-9);
        assert!(m.pose_right);
    }
}
