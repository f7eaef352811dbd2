//! Which directions the geometry leaves open.
//!
//! A bare straight drift can be slid along its axis without any surface noticing. The information matrix of
//! a point-to-plane fit shows that: its translation and rotation blocks, each freed of the other by
//! the Schur complement and scaled to a pair's share, have an eigenvalue near zero along a
//! direction that nothing constrains. (NDT's and point-to-point's own Hessians cannot show it: they
//! hold on to sampling noise.)

use crate::icp::Information;
use crate::pose::Pose;
use crate::symmetric::eigen;
use crate::vec3::{dot, norm, scale, sub};

/// What kind of motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum DirectionKind {
    /// Sliding along the direction.
    Translation,
    /// Turning about it, through the query's centroid.
    Rotation,
}

/// A motion that the surfaces do not resist.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Unobservable {
    /// Sliding or turning.
    pub kind: DirectionKind,
    /// Unit vector in map axes.
    pub direction: [f64; 3],
    /// Its information as a share of a pair's: 0 is none, 1 would be every normal along it.
    pub information: f64,
}

/// Information of every principal direction: of the three translations first, then of the three
/// rotations, each least observable first. A rotation's information is divided by the mean square
/// distance of the points from its axis, which puts it on the scale of a translation.
///
/// All zero where no pair took part.
#[must_use]
pub fn directions(information: &Information) -> Vec<Unobservable> {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let pairs = information.pairs.max(1) as f64;
    let m = &information.matrix;
    let block = |r: usize, c: usize| -> [[f64; 3]; 3] {
        std::array::from_fn(|i| std::array::from_fn(|j| m[r + i][c + j] / pairs))
    };
    let (tt, tr, rr) = (block(0, 0), block(0, 3), block(3, 3));
    let translation = principal(schur(tt, tr, rr), DirectionKind::Translation);
    let mut rotation = principal(schur(rr, transposed(tr), tt), DirectionKind::Rotation);
    let c = &information.moments;
    for r in &mut rotation {
        let d = r.direction;
        let along: f64 = (0..3)
            .map(|i| (0..3).map(|j| d[i] * c[i][j] * d[j]).sum::<f64>())
            .sum();
        let arm = (c[0][0] + c[1][1] + c[2][2] - along).max(1e-9);
        r.information /= arm;
    }
    rotation.sort_by(|a, b| a.information.total_cmp(&b.information));
    translation.into_iter().chain(rotation).collect()
}

fn principal(m: [[f64; 3]; 3], kind: DirectionKind) -> [Unobservable; 3] {
    let e = eigen(m);
    std::array::from_fn(|i| Unobservable {
        kind,
        direction: e.vectors[i],
        information: e.values[i].max(0.0),
    })
}

/// `a − b c⁺ bᵀ`: what `a` still knows when the other block is free.
fn schur(a: [[f64; 3]; 3], b: [[f64; 3]; 3], c: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let e = eigen(c);
    let largest = e.values[2].max(f64::MIN_POSITIVE);
    let mut out = a;
    for (value, vector) in e.values.iter().zip(&e.vectors) {
        if *value < 1e-9 * largest {
            continue;
        }
        let bv: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| b[i][k] * vector[k]).sum());
        for i in 0..3 {
            for j in 0..3 {
                out[i][j] -= bv[i] * bv[j] / value;
            }
        }
    }
    out
}

fn transposed(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

/// By how much a place may lie off the line along which another one slides, for each metre that it does,
const STRAIGHT: f64 = 0.03;
/// and at most, in merge distances: further off lies another passage.
const ASIDE: f64 = 4.0;

/// Whether motion along the `open` directions alone leads from the first pose (`map_from_query`) to the second: what is left of the way
/// between them, at `centroid` of the query, is at most `merge` (metres, radians), and somewhat more after a long slide.
///
/// A turn about an open axis may be of any size, a slide goes along a straight line.
#[must_use]
pub fn reaches(
    open: &[Unobservable],
    (from, to): (&Pose, &Pose),
    centroid: [f64; 3],
    [metres, radians]: [f64; 2],
) -> bool {
    if open.is_empty() {
        return false;
    }
    let way = sub(to.transform(centroid), from.transform(centroid));
    let turn = to.compose(&from.inverse()).rotation_vector();
    let along = |v: [f64; 3], kind: DirectionKind| {
        let own = open.iter().filter(|d| d.kind == kind);
        own.fold(v, |left, d| {
            let by = dot(left, d.direction);
            sub(left, scale(d.direction, by))
        })
    };
    let (off, turned) = (
        norm(along(way, DirectionKind::Translation)),
        norm(along(turn, DirectionKind::Rotation)),
    );
    off <= (metres + STRAIGHT * norm(way)).min(ASIDE * metres) && turned <= radians
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::icp;
    use crate::test_world::{drift, surface};

    fn weakest(points: &[[f64; 3]]) -> Vec<Unobservable> {
        let s = surface(points, 0.15);
        let information = icp::information(&s, &s, &Pose::identity(), 0.3, 0);
        directions(&information)
    }

    #[test]
    fn a_bare_tube_is_open_along_its_axis_and_a_rough_one_is_not() {
        let bare = weakest(&drift(60_000, 20.0, 0.0, 0.005, 1));
        assert!(bare[0].information < 0.005, "{bare:?}");
        assert_eq!(bare[0].kind, DirectionKind::Translation);
        assert!(bare[0].direction[0].abs() > 0.999, "{bare:?}");
        assert!(bare[1].information > 0.1);
        let rough = weakest(&drift(60_000, 20.0, 0.3, 0.005, 1));
        assert!(rough.iter().all(|d| d.information > 0.015), "{rough:?}");
    }

    #[test]
    fn a_slide_is_the_same_place_and_a_turn_or_a_step_aside_is_not() {
        let axis = |kind, direction| Unobservable {
            kind,
            direction,
            information: 0.0,
        };
        let slide = [axis(DirectionKind::Translation, [0.6, 0.8, 0.0])];
        let spin = [axis(DirectionKind::Rotation, [0.0, 0.0, 1.0])];
        let (here, centre) = (
            Pose::from_rotation_vector([0.1, 0.2, 0.3], [5.0; 3]),
            [1.0, 2.0, 3.0],
        );
        let moved = |by: [f64; 3], turn: [f64; 3]| here.perturbed(by, turn, here.transform(centre));
        let same = |open: &[Unobservable], by, turn| {
            reaches(open, (&here, &moved(by, turn)), centre, [0.2, 0.05])
        };
        assert!(same(&slide, [6.0, 8.0, 0.1], [0.0, 0.0, 0.02]));
        assert!(!same(&slide, [0.8, -0.6, 0.0], [0.0; 3]), "a step aside");
        // Half a metre aside after 10 m is still the same line; a metre is the next passage, however far along.
        assert!(same(&slide, [6.36, 7.73, 0.0], [0.0; 3]));
        assert!(!same(&slide, [60.8, 79.4, 0.0], [0.0; 3]));
        assert!(
            !same(&slide, [6.0, 8.0, 0.0], [0.0, 0.0, 3.1]),
            "the other way round"
        );
        assert!(same(&spin, [0.0, 0.1, 0.0], [0.0, 0.0, 3.1]));
        assert!(!same(&spin, [0.0, 0.1, 0.0], [0.0, 0.4, 0.0]));
        assert!(!same(&[], [0.0; 3], [0.0; 3]), "nothing is open");
    }

    #[test]
    fn a_plane_slides_two_ways_and_turns_one() {
        let plane: Vec<[f64; 3]> = (0..10_000)
            .map(|i| [f64::from(i % 100) * 0.1, f64::from(i / 100) * 0.1, 0.0])
            .collect();
        let open: Vec<Unobservable> = weakest(&plane)
            .into_iter()
            .filter(|d| d.information < 1e-4)
            .collect();
        let translations = open
            .iter()
            .filter(|d| d.kind == DirectionKind::Translation)
            .count();
        assert_eq!((translations, open.len()), (2, 3), "{open:?}");
        let turn = open
            .iter()
            .find(|d| d.kind == DirectionKind::Rotation)
            .unwrap();
        assert!(turn.direction[2].abs() > 0.999);
    }
}
