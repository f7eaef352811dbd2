//! What is true of a query whatever program looks for it: how much of it the map holds, whether another
//! place would fit as well, along which directions it could slide.
//!
//! All is computed on the noise-free surface that map and query saw, not on their clouds, and by none of the
//! library's verification: a point of the query is *explained* by a pose where mapped surface lies within
//! [`REACH`] of it and its distance from that surface's tangent plane is less than [`SIGMAS`] standard deviations of
//! the query sensor's noise at its range, or [`FINEST`] where that is more. Another place makes a query
//! ambiguous where it explains as much as the true one, and of what has mapped surface [`BESIDE`] it as large a share,
//! but for [`SLACK`]. A query of which the map explains less than [`MIN_EXPLAINED`] at the truth is not asked about.

mod rivals;

use rustc_hash::FxHashMap;
use winze::Pose;
use winze::kdtree::KdTree;
use winze::vec3::{cross, sub, voxel_of};

use self::rivals::Occupancy;
use crate::sensor::{Return, ReturnOrigin};

/// Mapped surface this near to a true point of the query is overlap, metres.
pub const REACH: f64 = 0.25;
/// A surface differs from the one that was seen where, free of noise, it lies this many standard deviations off.
pub const SIGMAS: f64 = 1.0;
/// No map is finer than this, metres, however good its sensor.
pub const FINEST: f64 = 0.03;
/// Mapped surface this near to a point lies beside it, metres.
pub const BESIDE: f64 = 0.5;
/// Share by which a rival may explain less than the truth, and of the points beside mapped surface, fewer.
pub const SLACK: f64 = 0.05;
/// Least share of the query that the map must explain at the truth before rivals are asked about.
pub const MIN_EXPLAINED: f64 = 0.1;

/// Points of a query that poses are judged by.
const JUDGED: usize = 1500;

/// A place on the true surface that a query saw, free of noise and drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Witness {
    /// Where it is, world frame, metres.
    pub point: [f64; 3],
    /// The surface's unit normal there.
    pub normal: [f64; 3],
    /// One standard deviation of the sensor's range at its distance, metres.
    pub sigma: f64,
    /// It lies on something that was not there, or not so, when the map was made.
    pub new: bool,
}

/// Edge of the voxels of which each keeps one witness, metres: near surfaces count no more than far ones.
const WITNESS_VOXEL: f64 = 0.1;

/// The noise-free surface that scans met, one witness a voxel: the first.
#[derive(Debug, Clone, Default)]
pub struct SeenSurface {
    cells: FxHashMap<[i64; 3], Witness>,
}

impl SeenSurface {
    /// Adds what a return met, if it was a surface. `sigma` tells the sensor's noise at a range, `is_new`
    /// whether a part is.
    pub fn add(
        &mut self,
        r: &Return,
        world_from_sensor: &Pose,
        sigma: impl Fn(f64) -> f64,
        is_new: impl Fn(u16) -> bool,
    ) {
        let (ReturnOrigin::Surface, Some(truth)) = (r.origin, r.true_point()) else {
            return;
        };
        let point = world_from_sensor.transform(truth);
        let key = voxel_of(point, WITNESS_VOXEL);
        self.cells.entry(key).or_insert_with(|| Witness {
            point,
            normal: r.normal,
            sigma: sigma(r.range),
            new: is_new(r.part),
        });
    }

    /// The witnesses in the order of their places.
    #[must_use]
    pub fn witnesses(self) -> Vec<Witness> {
        let mut cells: Vec<([i64; 3], Witness)> = self.cells.into_iter().collect();
        cells.sort_unstable_by_key(|(key, _)| *key);
        cells.into_iter().map(|(_, w)| w).collect()
    }
}

/// The surface that a survey saw, free of noise: a point and a normal a voxel.
pub struct MappedSurface {
    origin: [f64; 3],
    normals: Vec<[f32; 3]>,
    points: Vec<[f32; 3]>,
    tree: KdTree<'static>,
    coarse: Occupancy,
    places: Vec<[f64; 3]>,
}

/// How mapped surface answers for a query at a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fit {
    /// Share of the query's points that it explains.
    explained: f64,
    /// Share that it explains of those with mapped surface beside them: what lies beside a wall but not on it
    /// speaks against the pose.
    agreeing: f64,
}

impl Fit {
    /// It is as good as the truth's, but for [`SLACK`].
    fn rivals(&self, truth: &Self) -> bool {
        self.explained >= (1.0 - SLACK) * truth.explained && self.agreeing >= truth.agreeing - SLACK
    }
}

/// What is true of a query in a map.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Labels {
    /// Share of the query's true surface points (new objects aside) within [`REACH`] of mapped surface.
    pub overlap: f64,
    /// Rigid moves of the world that put the query onto other places that explain it as well.
    pub alternatives: Vec<Pose>,
    /// Directions along which, or about which, it can be moved without being explained any less; unit vectors,
    /// world axes; rotations are about the query's centroid.
    pub unobservable: Vec<Open>,
}

/// An open direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Open {
    /// A rotation about it, else a translation along it.
    pub rotation: bool,
    /// The unit direction, world axes.
    pub direction: [f64; 3],
}

/// How far from the truth a pose may lie and still be right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Displacement of the query's centroid, metres.
    pub translation: f64,
    /// Angle, radians.
    pub rotation: f64,
}

impl MappedSurface {
    /// From the noise-free points and unit normals that a survey saw (world frame) and the places where a
    /// robot's sensor can be.
    #[must_use]
    pub fn new(seen: &[Witness], places: &[[f64; 3]]) -> Self {
        let origin = seen.first().map_or([0.0; 3], |w| w.point.map(f64::round));
        #[expect(clippy::cast_possible_truncation, reason = "offsets from the origin")]
        let offset =
            |p: [f64; 3]| -> [f32; 3] { std::array::from_fn(|a| (p[a] - origin[a]) as f32) };
        let points: Vec<[f32; 3]> = seen.iter().map(|w| offset(w.point)).collect();
        #[expect(clippy::cast_possible_truncation, reason = "unit vectors")]
        let normals = seen.iter().map(|w| w.normal.map(|v| v as f32)).collect();
        Self {
            origin,
            tree: KdTree::build(&points),
            points,
            normals,
            coarse: Occupancy::around(seen),
            places: places.to_vec(),
        }
    }

    /// Points it is made of.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Nothing was seen.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Distance to the nearest mapped point and to its tangent plane (signed), with the normal.
    fn nearest(&self, p: [f64; 3], within: f64) -> Option<(f64, f64, [f64; 3])> {
        #[expect(clippy::cast_possible_truncation, reason = "offsets from the origin")]
        let q: [f32; 3] = std::array::from_fn(|a| (p[a] - self.origin[a]) as f32);
        #[expect(clippy::cast_possible_truncation, reason = "metres")]
        let near = self.tree.nearest_within(q, within as f32)?;
        let i = near.index as usize;
        let (m, n) = (self.points.get(i)?, self.normals.get(i)?.map(f64::from));
        let out = (0..3)
            .map(|a| (f64::from(q[a]) - f64::from(m[a])) * n[a])
            .sum();
        Some((f64::from(near.distance_squared).sqrt(), out, n))
    }

    /// How the surface answers for `points` once they are moved.
    fn fit(&self, points: &[Witness], moved: &Pose) -> Fit {
        let (mut beside, mut explained) = (0, 0);
        for w in points {
            let Some((distance, out, _)) = self.nearest(moved.transform(w.point), BESIDE) else {
                continue;
            };
            beside += 1;
            let within = out.abs() <= (SIGMAS * w.sigma).max(FINEST);
            explained += usize::from(distance <= REACH && within);
        }
        Fit {
            explained: share(explained, points.len()),
            agreeing: share(explained, beside),
        }
    }
}

/// What a query saw, and from where.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// The noise-free surface.
    pub witnesses: &'a [Witness],
    /// Where the sensor was, in order, world frame.
    pub stands: &'a [[f64; 3]],
}

/// What is true of a query, by its noise-free points.
#[must_use]
pub fn label(map: &MappedSurface, query: Seen<'_>, tolerance: Tolerance, seed: u64) -> Labels {
    let lasting: Vec<Witness> = query.witnesses.iter().filter(|w| !w.new).copied().collect();
    let overlap = share(
        lasting
            .iter()
            .filter(|w| map.nearest(w.point, REACH).is_some())
            .count(),
        lasting.len(),
    );
    let judged = evenly(&lasting, JUDGED);
    let at_truth = map.fit(&judged, &Pose::identity());
    let mut labels = Labels {
        overlap,
        alternatives: Vec::new(),
        unobservable: Vec::new(),
    };
    if at_truth.explained < MIN_EXPLAINED {
        return labels;
    }
    labels.unobservable = open_directions(map, &judged, tolerance, &at_truth);
    let starts = rivals::starts(map, &judged, query.stands, seed);
    labels.alternatives = rivals::alternatives(
        map,
        &judged,
        tolerance,
        &at_truth,
        &labels.unobservable,
        &starts,
    );
    labels
}

/// The principal directions of the query's geometry along which a move by the tolerance, either way,
/// still explains enough.
fn open_directions(
    map: &MappedSurface,
    judged: &[Witness],
    tolerance: Tolerance,
    at_truth: &Fit,
) -> Vec<Open> {
    let centre = centroid(judged);
    let mut open = Vec::new();
    for rotation in [false, true] {
        for direction in principal(judged, centre, rotation) {
            let still = [-1.0, 1.0].iter().all(|sign| {
                let by = |size: f64| direction.map(|v| sign * size * v);
                let moved = if rotation {
                    Pose::identity().perturbed([0.0; 3], by(tolerance.rotation), centre)
                } else {
                    Pose::identity().perturbed(by(tolerance.translation), [0.0; 3], centre)
                };
                map.fit(judged, &moved).rivals(at_truth)
            });
            if still {
                open.push(Open {
                    rotation,
                    direction,
                });
            }
        }
    }
    open
}

/// Eigenvectors of the point-to-plane information of translations, or of rotations about the centre.
fn principal(points: &[Witness], centre: [f64; 3], rotation: bool) -> [[f64; 3]; 3] {
    let mut m = [[0.0; 3]; 3];
    for w in points {
        let v = if rotation {
            cross(sub(w.point, centre), w.normal)
        } else {
            w.normal
        };
        for i in 0..3 {
            for j in 0..3 {
                m[i][j] += v[i] * v[j];
            }
        }
    }
    let upper = [m[0][0], m[0][1], m[0][2], m[1][1], m[1][2], m[2][2]];
    winze::eigen3::eigen3(&upper).vectors
}

fn centroid(points: &[Witness]) -> [f64; 3] {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = points.len().max(1) as f64;
    let mut sum = [0.0; 3];
    for w in points {
        for (s, v) in sum.iter_mut().zip(w.point) {
            *s += v;
        }
    }
    sum.map(|s| s / n)
}

/// At most `most` of them, evenly drawn.
fn evenly(points: &[Witness], most: usize) -> Vec<Witness> {
    let step = points.len().div_ceil(most.max(1)).max(1);
    points.iter().step_by(step).copied().collect()
}

fn share(count: usize, of: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    let share = count as f64 / of.max(1) as f64;
    share
}

#[cfg(test)]
mod tests;
