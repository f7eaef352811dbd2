//! Surface normals by principal components, and what to do about their sign.
//!
//! A plane has no front. PCA gives each normal an arbitrary sign, yet FPFH angles change with it,
//! so the sign has to come from somewhere: from the sensor's place where one is known
//! ([`orient_towards`]), else from the open side, the side on which the rest of the passage lies
//! ([`orient_open_side`]), which two clouds of the same passage agree on whatever their frames.

use nalgebra::Vector3;

use crate::eigen3::{BATCH, Symmetric3, eigen3, solve};
use crate::kdtree::{KdTree, Neighbour};
use crate::neighbours::{GROUP, Moments, Nearest, Neighbours};
use crate::parallel;
use crate::simd;

/// The neighbourhood that a normal is fitted to: all points within `radius` metres, but at least
/// the `least` nearest and at most the `most` nearest. A bound of 0 is none; the point itself counts.
/// With neither `radius` nor `most` it is the `least` nearest.
///
/// The lower bound matters where a LiDAR's rings lie far apart: a ball that holds one ring only
/// holds a line, and a plane through a line is anybody's guess.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbourhood {
    /// Metres; 0 for a neighbourhood of the `most` nearest, wherever they are.
    pub radius: f64,
    /// Nearest points that are taken even beyond the radius.
    pub least: usize,
    /// Nearest points that are taken at most.
    pub most: usize,
}

/// One unit normal a point, from the covariance of its neighbourhood. Signs are arbitrary.
///
/// `[0, 0, 0]` where the neighbourhood spans no plane (fewer than three points, a line, or points
/// that all coincide): such a normal is undefined and must not be used.
#[must_use]
pub fn estimate(points: &[[f32; 3]], tree: &KdTree<'_>, around: Neighbourhood) -> Vec<[f32; 3]> {
    let mut normals = vec![[0.0; 3]; points.len()];
    estimate_into(&mut normals, points, tree, around);
    normals
}

/// As [`estimate`], into `normals`.
pub(crate) fn estimate_into(
    normals: &mut [[f32; 3]],
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    around: Neighbourhood,
) {
    if tree.order().is_empty() {
        estimate_in_leaf_order(&mut normals[..tree.len()], points, tree, around);
        return;
    }
    let mut made = vec![[0.0; 3]; tree.len()];
    estimate_in_leaf_order(&mut made, points, tree, around);
    normals.fill([0.0; 3]);
    for (&i, normal) in tree.order().iter().zip(made) {
        normals[i as usize] = normal;
    }
}

/// Of each place in the tree's leaf order, in which points that follow each other are near each other.
fn estimate_in_leaf_order(
    normals: &mut [[f32; 3]],
    points: &[[f32; 3]],
    tree: &KdTree<'_>,
    around: Neighbourhood,
) {
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let radius = if around.radius > 0.0 {
        around.radius as f32
    } else {
        f32::INFINITY
    };
    let nearest = if around.most == 0 && radius.is_infinite() {
        around.least
    } else {
        around.most
    };
    if nearest == 0 && radius.is_infinite() {
        normals.fill([0.0; 3]);
        return;
    }
    let nearest = nearest.min(tree.len());
    let (_, [xs, ys, zs]) = tree.parts();
    let at = |place: usize| [xs[place], ys[place], zs[place]];
    parallel::fill_groups(normals, GROUP, Search::default, |search, group, normals| {
        search.moments.clear();
        let mut left = group;
        while !left.is_empty() {
            let together = if nearest == 0 {
                search.near.gather(tree, radius, left.clone(), at)
            } else {
                let sought = (nearest, radius);
                search.nearest.gather(tree, sought, left.clone(), at)
            };
            left.start = together.end;
            for place in together {
                let moments = search.around(points, tree, at(place), radius, nearest, around);
                search.moments.push(moments);
            }
        }
        for (moments, normals) in search.moments.chunks(BATCH).zip(normals.chunks_mut(BATCH)) {
            planes(moments, normals);
        }
    });
}

/// What a thread keeps from point to point.
#[derive(Default)]
struct Search {
    near: Neighbours,
    nearest: Nearest,
    /// Of the points of a group.
    moments: Vec<Moments>,
}

impl Search {
    /// Sums over the neighbourhood of `q`.
    fn around(
        &mut self,
        points: &[[f32; 3]],
        tree: &KdTree<'_>,
        q: [f32; 3],
        radius: f32,
        nearest: usize,
        around: Neighbourhood,
    ) -> Moments {
        let looked_up = |nearest: &mut Nearest, sought| {
            let found = nearest.look_up(tree, q, sought);
            Moments::of(points, q, found)
        };
        let within = if nearest == 0 {
            self.near.moments_within(q)
        } else {
            let ask = |near: &mut Neighbours, guess| near.moments_of_nearest(q, nearest, guess);
            match self.nearest.ask(ask) {
                Some(moments) => moments,
                None => looked_up(&mut self.nearest, (nearest, radius)),
            }
        };
        if (within.count as usize) < around.least {
            return looked_up(&mut self.nearest, (around.least, f32::INFINITY));
        }
        within
    }
}

/// Share of the largest eigenvalue below which the middle one is none. Sums in 32 bits over a lane's points are off by up to 5·10⁻⁶ of the
/// largest; a line half a metre long whose points are half a millimetre off it has 10⁻⁵.
const LINE: f64 = 1e-5;

/// The normals of planes through neighbourhoods, of [`BATCH`] at most.
fn planes(moments: &[Moments], normals: &mut [[f32; 3]]) {
    let mut batch = [[0.0; BATCH]; 6];
    for (k, moments) in moments.iter().enumerate() {
        let covariance = moments.covariance();
        (0..6).for_each(|e| batch[e][k] = covariance[e]);
    }
    let solved = simd::wide(
        #[inline(always)]
        || solve(&batch),
    );
    for (k, (moments, normal)) in moments.iter().zip(normals).enumerate() {
        let mut middle = solved.values[1][k];
        let mut high = solved.values[2][k];
        let mut least = solved.least.map(|v| v[k]);
        if solved.vector_sure[k] == 0.0 {
            let e = eigen3(&batch.map(|v| v[k]));
            ([_, middle, high], [least, ..]) = (e.values, e.vectors);
        }
        #[expect(clippy::cast_possible_truncation, reason = "unit components")]
        let unit = least.map(|v| v as f32);
        // A line has two vanishing eigenvalues; the direction across it is anybody's guess.
        let plane = moments.count >= 3 && middle > LINE * high;
        *normal = if plane { unit } else { [0.0; 3] };
    }
}

/// Covariance (divided by the count) about the neighbourhood's own mean, and the count. Offsets
/// are taken from `centre` first: raw coordinates squared would lose all their digits.
pub(crate) fn covariance(
    points: &[[f32; 3]],
    centre: [f32; 3],
    neighbours: &[Neighbour],
) -> (Symmetric3, f64) {
    let moments = Moments::of(points, centre, neighbours);
    (moments.covariance(), f64::from(moments.count))
}

/// Turns every normal towards `viewpoint` (offsets as the points are).
pub fn orient_towards(points: &[[f32; 3]], normals: &mut [[f32; 3]], viewpoint: [f64; 3]) {
    let v = Vector3::from(viewpoint);
    for (p, n) in points.iter().zip(normals) {
        let to = v - Vector3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        let facing = to.dot(&Vector3::new(
            f64::from(n[0]),
            f64::from(n[1]),
            f64::from(n[2]),
        ));
        if facing < 0.0 {
            *n = n.map(|c| -c);
        }
    }
}

/// Turns every normal to its open side: the side on which more of the cloud within `radius`
/// (metres; a passage's width or so) lies.
///
/// In a drift the floor, back and opposite rib all lie on a wall's open side. The balance is taken
/// over `coarse`, the tree of a thinned copy of the cloud (a point every `radius / 4` or so is enough), so that
/// dense walls do not outvote the rest; each point counts by how far out of the tangent plane
/// it stands, up to a quarter of the radius, so that a wall's own roughness counts for little.
pub fn orient_open_side(
    points: &[[f32; 3]],
    normals: &mut [[f32; 3]],
    coarse: &KdTree<'_>,
    radius: f64,
) {
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let radius = radius as f32;
    let cap = radius / 4.0;
    parallel::fill_groups(
        normals,
        GROUP,
        Neighbours::default,
        |near, group, normals| {
            let first = group.start;
            let mut left = group;
            while !left.is_empty() {
                let together = near.gather(coarse, radius, left.clone(), |k| points[k]);
                left.start = together.end;
                for k in together {
                    let n = &mut normals[k - first];
                    // What is no normal has no sides.
                    if n.iter().all(|c| c.is_finite()) && near.balance(points[k], *n, cap) < 0.0 {
                        *n = n.map(|c| -c);
                    }
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    const NEAREST_20: Neighbourhood = Neighbourhood {
        radius: 0.0,
        least: 0,
        most: 20,
    };

    #[test]
    fn rings_far_apart_still_give_the_floor_s_normal() {
        // Two rings of a LiDAR on a floor, a metre apart, points every 10 cm.
        let points: Vec<[f32; 3]> = (0..80)
            .map(|i| {
                [
                    (i % 40) as f32 * 0.1,
                    (i / 40) as f32,
                    0.001 * ((i * 37) % 11) as f32,
                ]
            })
            .collect();
        let tree = KdTree::build(&points);
        let tilt = |least| {
            let normals = estimate(
                &points,
                &tree,
                Neighbourhood {
                    radius: 0.5,
                    least,
                    most: 0,
                },
            );
            normals.iter().map(|n| n[2].abs()).fold(1.0, f32::min)
        };
        assert!(tilt(0) < 0.9, "one ring is a line: {}", tilt(0));
        assert!(tilt(30) > 0.99, "{}", tilt(30));
    }

    /// A tube of radius 2 along x, with a little roughness.
    fn tube() -> Vec<[f32; 3]> {
        let mut rng = Rng::new(11, 0);
        (0..8000)
            .map(|_| {
                let (x, a, r) = (
                    rng.range(0.0, 20.0),
                    rng.range(0.0, std::f64::consts::TAU),
                    2.0 + 0.02 * rng.normal(),
                );
                [x as f32, (r * a.cos()) as f32, (r * a.sin()) as f32]
            })
            .collect()
    }

    #[test]
    fn normals_of_a_tube_are_radial_and_turn_inwards() {
        let points = tube();
        let tree = KdTree::build(&points);
        for (most, radius) in [(20, 0.0), (0, 0.6), (30, 0.8)] {
            let mut normals = estimate(
                &points,
                &tree,
                Neighbourhood {
                    radius,
                    least: 0,
                    most,
                },
            );
            orient_open_side(&points, &mut normals, &tree, 4.0);
            let inward = |n: &[f32; 3], p: &[f32; 3]| {
                -(n[1] * p[1] + n[2] * p[2]) / (p[1] * p[1] + p[2] * p[2]).sqrt()
            };
            let good = points
                .iter()
                .zip(&normals)
                .filter(|(p, n)| inward(n, p) > 0.95)
                .count();
            assert!(
                good as f64 > 0.99 * points.len() as f64,
                "{good} for {most} within {radius}"
            );
            orient_towards(&points, &mut normals, [10.0, 0.0, 0.0]);
            let near = points
                .iter()
                .zip(&normals)
                .filter(|(p, _)| (p[0] - 10.0).abs() < 2.0);
            assert!(near.clone().all(|(p, n)| inward(n, p) > 0.0));
        }
    }

    #[test]
    fn orientation_does_not_depend_on_the_signs_given() {
        let points = tube();
        let tree = KdTree::build(&points);
        let mut a = estimate(&points, &tree, NEAREST_20);
        let mut rng = Rng::new(5, 0);
        let mut b: Vec<[f32; 3]> = a
            .iter()
            .map(|n| if rng.below(2) == 0 { n.map(|c| -c) } else { *n })
            .collect();
        orient_open_side(&points, &mut a, &tree, 4.0);
        orient_open_side(&points, &mut b, &tree, 4.0);
        assert_eq!(a, b);
    }

    #[test]
    fn undefined_normals_are_zero() {
        let zero = |points: &[[f32; 3]]| {
            let tree = KdTree::build(points);
            assert!(
                estimate(points, &tree, NEAREST_20)
                    .iter()
                    .all(|n| *n == [0.0; 3]),
                "{points:?}"
            );
        };
        let none = Neighbourhood {
            most: 0,
            ..NEAREST_20
        };
        let tree = KdTree::build(&tube());
        assert!(
            estimate(&tube(), &tree, none)
                .iter()
                .all(|n| *n == [0.0; 3])
        );
        zero(&[]);
        zero(&[[1.0, 2.0, 3.0]]);
        zero(&[[1.0, 2.0, 3.0]; 7]);
        let line: Vec<[f32; 3]> = (0..9).map(|i| [i as f32, 2.0 * i as f32, 0.0]).collect();
        zero(&line);
    }

    #[test]
    fn far_from_zero_the_covariance_keeps_its_digits() {
        let mut rng = Rng::new(1, 0);
        let points: Vec<[f32; 3]> = (0..200)
            .map(|_| {
                [
                    9000.0 + rng.range(0.0, 1.0) as f32,
                    -9000.0 + rng.range(0.0, 1.0) as f32,
                    8000.0,
                ]
            })
            .collect();
        let normals = estimate(&points, &KdTree::build(&points), NEAREST_20);
        assert!(normals.iter().all(|n| n[2].abs() > 0.9999));
    }
}
