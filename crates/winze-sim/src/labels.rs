//! What is true of a query whatever program looks for it: how much of it the map holds, whether another
//! place would fit as well, along which directions it could slide.
//!
//! All is computed on the noise-free surface that map and query saw, not on their clouds, and by none of the
//! library's verification: a point of the query is *explained* by a pose where mapped surface lies within
//! [`REACH`] of it and its distance from that surface's tangent plane is less than [`SIGMAS`] standard deviations of
//! the query sensor's noise at its range, or [`FINEST`] where that is more. Another place makes a query
//! ambiguous where it explains as much as the true one, and of what has mapped surface [`BESIDE`] it as large a share,
//! but for [`SLACK`]. A query of which the map explains less than [`MIN_EXPLAINED`] at the truth is not asked about.

use rayon::prelude::*;
use rustc_hash::FxHashMap;
use winze::Pose;
use winze::kdtree::KdTree;
use winze::rng::Rng;
use winze::solve::System;
use winze::vec3::{cross, distance, dot, norm, sub, voxel_of};

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

/// Points that places are proposed by, and that they are judged by.
const SKETCH: usize = 96;
const JUDGED: usize = 1500;
/// Radius of the part of the query that places are proposed by, metres.
const NEIGHBOURHOOD: f64 = 8.0;
/// Cell of the coarse occupancy that places are proposed on, metres.
const COARSE: f64 = 0.5;
/// Headings tried at each place.
const HEADINGS: u32 = 72;
/// Proposals at most, those that a first, quick settling leaves, and the points and steps of each.
const PROPOSED: usize = 1500;
const REFINED: usize = 24;
const QUICK: (usize, usize) = (80, 5);
const THOROUGH: (usize, usize) = (400, 15);
/// Proposals nearer than this, metres, and turned by less than this many headings are one.
const APART: (f64, u32) = (1.5, 4);

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
    tree: KdTree,
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
        // A cell is occupied where surface lies in it or in one that touches it.
        let mut coarse = Occupancy::default();
        for w in seen {
            let c = cell(w.point);
            for d in 0..27 {
                coarse.insert([c[0] + d % 3 - 1, c[1] + d / 3 % 3 - 1, c[2] + d / 9 - 1]);
            }
        }
        Self {
            origin,
            tree: KdTree::build(&points),
            points,
            normals,
            coarse,
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
    let anchors = anchors(map, centroid(&judged), query.stands);
    let starts: Vec<Pose> = anchors
        .iter()
        .flat_map(|anchor| proposals(map, &judged, *anchor, seed))
        .collect();
    labels.alternatives = alternatives(
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

/// Distinct other places that explain enough, of those that `starts` settle on.
fn alternatives(
    map: &MappedSurface,
    judged: &[Witness],
    tolerance: Tolerance,
    at_truth: &Fit,
    open: &[Open],
    starts: &[Pose],
) -> Vec<Pose> {
    let centre = centroid(judged);
    let slides: Vec<[f64; 3]> = open
        .iter()
        .filter(|o| !o.rotation)
        .map(|o| o.direction)
        .collect();
    let few = evenly(judged, 400);
    let few_at_truth = map.fit(&few, &Pose::identity());
    // Not another place: the same one, or where it can slide to, all the way explained as well. What looks the
    // same further along, with something else between, is another.
    let same = |a: &Pose, b: &Pose| {
        if a.distance(b, centre).rotation > 2.0 * tolerance.rotation {
            return false;
        }
        let d = sub(a.transform(centre), b.transform(centre));
        let mut slide = [0.0; 3];
        // The directions are those at the truth; another place may lie turned to it.
        for s in slides.iter().map(|s| b.rotate(*s)) {
            let along = dot(d, s);
            slide = std::array::from_fn(|i| slide[i] + along * s[i]);
        }
        let off = norm(sub(d, slide));
        if off > 2.0 * tolerance.translation {
            return false;
        }
        if norm(d) <= 2.0 * tolerance.translation {
            return true;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a few hundred steps"
        )]
        let steps = (norm(slide) / tolerance.translation.max(0.1)).ceil() as u32;
        (1..steps).all(|step| {
            let part = f64::from(step) / f64::from(steps);
            let shift = Pose::from_translation(slide.map(|v| part * v));
            map.fit(&few, &shift.compose(b)).rivals(&few_at_truth)
        })
    };
    let settled = |starts: &[Pose], (points, steps): (usize, usize), judges: &[Witness]| {
        let points = evenly(judged, points);
        let mut settled: Vec<(Fit, Pose)> = starts
            .par_iter()
            .map(|start| {
                let pose = settle(map, &points, *start, centre, steps);
                (map.fit(judges, &pose), pose)
            })
            .collect();
        settled.sort_by(|a, b| b.0.explained.total_cmp(&a.0.explained));
        settled
    };
    let quick = settled(starts, QUICK, &evenly(judged, 200));
    let mut hopeful: Vec<Pose> = Vec::new();
    for (_, pose) in quick {
        let taken = |other: &Pose| {
            let apart = pose.distance(other, centre);
            apart.translation < 1.0 && apart.rotation < 0.1
        };
        if hopeful.len() == REFINED {
            break;
        }
        if !hopeful.iter().any(taken) && !same(&pose, &Pose::identity()) {
            hopeful.push(pose);
        }
    }
    let mut found = settled(&hopeful, THOROUGH, judged);
    found.retain(|(fit, pose)| fit.rivals(at_truth) && !same(pose, &Pose::identity()));
    let mut distinct: Vec<Pose> = Vec::new();
    for (_, pose) in found {
        if !distinct.iter().any(|d| same(d, &pose)) {
            distinct.push(pose);
        }
    }
    distinct
}

/// Places by whose surroundings others are proposed: the one nearest to the middle of what the query saw, and
/// those near the beginning and the end of a longer drive.
fn anchors(map: &MappedSurface, centre: [f64; 3], stands: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let at = |part: usize| {
        stands
            .get(part * stands.len().saturating_sub(1) / 6)
            .copied()
    };
    let mut anchors: Vec<[f64; 3]> = Vec::new();
    for from in [Some(centre), at(1), at(5)].into_iter().flatten() {
        let place = map
            .places
            .iter()
            .min_by(|a, b| distance(**a, from).total_cmp(&distance(**b, from)));
        let apart = |place: &&[f64; 3]| {
            anchors
                .iter()
                .all(|a| distance(*a, **place) > NEIGHBOURHOOD)
        };
        if let Some(place) = place.filter(apart) {
            anchors.push(*place);
        }
    }
    anchors
}

/// Upright moves of the world that put an anchor of the query onto places of the map where, coarsely, surface is
/// where it should be; the best of each neighbourhood.
fn proposals(map: &MappedSurface, judged: &[Witness], anchor: [f64; 3], seed: u64) -> Vec<Pose> {
    let near: Vec<Witness> = judged
        .iter()
        .filter(|w| distance(w.point, anchor) < NEIGHBOURHOOD)
        .copied()
        .collect();
    let mut rng = Rng::new(seed, 0x0A17);
    let mut sketch = evenly(&near, 4 * SKETCH);
    while sketch.len() > SKETCH {
        #[expect(clippy::cast_possible_truncation, reason = "a few hundred")]
        let drop = rng.below(sketch.len() as u32) as usize;
        sketch.swap_remove(drop);
    }
    if sketch.is_empty() {
        return Vec::new();
    }
    let offsets: Vec<[f64; 3]> = sketch.iter().map(|w| sub(w.point, anchor)).collect();
    let scored: Vec<(usize, usize, u32)> = map
        .places
        .par_iter()
        .enumerate()
        .map(|(at, place)| {
            let mut best: Vec<(usize, usize, u32)> = Vec::new();
            for heading in 0..HEADINGS {
                let (sin, cos) = turn(heading);
                // Given up as soon as half of them have missed.
                let mut misses = 0;
                let lost = offsets.iter().any(|o| {
                    misses += usize::from(!map.coarse.contains(cell([
                        place[0] + cos * o[0] - sin * o[1],
                        place[1] + sin * o[0] + cos * o[1],
                        place[2] + o[2],
                    ])));
                    2 * misses > offsets.len()
                });
                if !lost {
                    best.push((offsets.len() - misses, at, heading));
                }
            }
            best.sort_by(|a, b| b.0.cmp(&a.0).then(a.2.cmp(&b.2)));
            best.truncate(4);
            best
        })
        .flatten_iter()
        .collect();
    let mut order = scored;
    order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut kept: Vec<(usize, u32)> = Vec::new();
    for (_, at, heading) in order {
        if kept.len() >= PROPOSED {
            break;
        }
        let close = |(other, h): &(usize, u32)| {
            let apart = heading.abs_diff(*h);
            let (Some(a), Some(b)) = (map.places.get(at), map.places.get(*other)) else {
                return true;
            };
            distance(*a, *b) < APART.0 && apart.min(HEADINGS - apart) < APART.1
        };
        if !kept.iter().any(close) {
            kept.push((at, heading));
        }
    }
    kept.iter()
        .filter_map(|(at, heading)| {
            let place = map.places.get(*at)?;
            let (sin, cos) = turn(*heading);
            let yaw = Pose::from_yaw_pitch_roll(libm::atan2(sin, cos), 0.0, 0.0, [0.0; 3]);
            let turned = yaw.transform(anchor);
            let shift = std::array::from_fn(|a| place[a] - turned[a]);
            Some(Pose::from_translation(shift).compose(&yaw))
        })
        .collect()
}

/// Gauss-Newton on point-to-plane distances, from pairs a metre apart down to a fifth.
fn settle(
    map: &MappedSurface,
    points: &[Witness],
    start: Pose,
    centre: [f64; 3],
    steps: usize,
) -> Pose {
    let mut pose = start;
    for step in 0..steps {
        #[expect(clippy::cast_precision_loss, reason = "a few steps")]
        let progress = step as f64 / steps as f64;
        let within = 1.2 * libm::pow(0.16, progress);
        let c = pose.transform(centre);
        let mut system = System::default();
        for w in points {
            let p = pose.transform(w.point);
            let Some((_, out, n)) = map.nearest(p, within) else {
                continue;
            };
            let turn = cross(sub(p, c), n);
            system.add_row(&[n[0], n[1], n[2], turn[0], turn[1], turn[2]], out, 1.0);
        }
        // Directions that nothing resists are left alone.
        let Some(x) = system.step(NEIGHBOURHOOD, 1e-3) else {
            return pose;
        };
        pose = pose.perturbed([x[0], x[1], x[2]], [x[3], x[4], x[5]], c);
    }
    pose
}

fn turn(heading: u32) -> (f64, f64) {
    let angle = std::f64::consts::TAU * f64::from(heading) / f64::from(HEADINGS);
    (libm::sin(angle), libm::cos(angle))
}

fn cell(p: [f64; 3]) -> [i32; 3] {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "mines are smaller than 2^31 half metres"
    )]
    p.map(|v| {
        let v = v / COARSE;
        // Towards zero, then down: `floor` is a call on some processors, and this is asked millions of times.
        let towards_zero = v as i32;
        towards_zero - i32::from(v < f64::from(towards_zero))
    })
}

/// A set of cells: a bit each, in blocks of 4 × 4 × 4, so that neighbours are found in cache.
#[derive(Default)]
struct Occupancy {
    blocks: FxHashMap<[i32; 3], u64>,
}

impl Occupancy {
    fn place(cell: [i32; 3]) -> ([i32; 3], u64) {
        let [x, y, z] = cell.map(|c| c & 3);
        (cell.map(|c| c >> 2), 1 << (x | y << 2 | z << 4))
    }

    fn insert(&mut self, cell: [i32; 3]) {
        let (block, bit) = Self::place(cell);
        *self.blocks.entry(block).or_default() |= bit;
    }

    fn contains(&self, cell: [i32; 3]) -> bool {
        let (block, bit) = Self::place(cell);
        self.blocks.get(&block).is_some_and(|bits| bits & bit != 0)
    }
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
