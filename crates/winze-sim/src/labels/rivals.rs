//! The search for other places that explain a query as well as the true one: proposed coarsely through the whole map,
//! settled, and judged.

use rayon::prelude::*;
use winze::Pose;
use winze::rng::Rng;
use winze::solve::System;
use winze::vec3::{cross, distance, dot, norm, sub};

use super::{Fit, MappedSurface, Open, Tolerance, Witness, centroid, evenly};

/// Points that places are proposed by.
const SKETCH: usize = 96;
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

/// Moves of the world that may put the query on a like place, proposed by what surrounds each of its anchors. `stands`: where
/// the sensor was.
pub(super) fn starts(
    map: &MappedSurface,
    judged: &[Witness],
    stands: &[[f64; 3]],
    seed: u64,
) -> Vec<Pose> {
    anchors(map, centroid(judged), stands)
        .iter()
        .flat_map(|anchor| proposals(map, judged, *anchor, seed))
        .collect()
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

/// Distinct other places that explain enough, of those that `starts` settle on.
pub(super) fn alternatives(
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

/// A set of cells: a bit each, in chunks of 32 × 32 × 32 where there are any, so that asking costs two array accesses.
#[derive(Default)]
pub(super) struct Occupancy {
    /// Lowest chunk, and how many there are, along each axis.
    least: [i32; 3],
    size: [usize; 3],
    /// Which of the chunks kept each is; [`NO_CHUNK`] where nothing is occupied.
    index: Vec<u32>,
    /// Blocks of 4 × 4 × 4 cells, [`BLOCKS`] a chunk.
    blocks: Vec<u64>,
}

const NO_CHUNK: u32 = u32::MAX;
const BLOCKS: usize = 8 * 8 * 8;

impl Occupancy {
    /// Occupied are the cells in which surface lies, and those that touch them.
    pub(super) fn around(seen: &[Witness]) -> Self {
        let cells: Vec<[i32; 3]> = seen.iter().map(|w| cell(w.point)).collect();
        let bound = |axis: usize| {
            let chunks = cells
                .iter()
                .map(|c| (c[axis] - 1) >> 5..=(c[axis] + 1) >> 5);
            chunks.fold(None, |bound: Option<(i32, i32)>, c| {
                let (low, high) = bound.unwrap_or((*c.start(), *c.end()));
                Some((low.min(*c.start()), high.max(*c.end())))
            })
        };
        let [Some(x), Some(y), Some(z)] = [bound(0), bound(1), bound(2)] else {
            return Self::default();
        };
        #[expect(clippy::cast_sign_loss, reason = "high is not below low")]
        let size = [x, y, z].map(|(low, high)| (high - low + 1) as usize);
        let mut occupied = Self {
            least: [x.0, y.0, z.0],
            size,
            index: vec![NO_CHUNK; size.iter().product()],
            blocks: Vec::new(),
        };
        for c in cells {
            for d in 0..27 {
                occupied.insert([c[0] + d % 3 - 1, c[1] + d / 3 % 3 - 1, c[2] + d / 9 - 1]);
            }
        }
        occupied
    }

    /// Where in the index the chunk of a cell is; `None` outside.
    fn chunk(&self, cell: [i32; 3]) -> Option<usize> {
        let mut at = [0; 3];
        for axis in 0..3 {
            at[axis] = usize::try_from((cell[axis] >> 5) - self.least[axis]).ok()?;
            if at[axis] >= self.size[axis] {
                return None;
            }
        }
        Some(at[0] + self.size[0] * (at[1] + self.size[1] * at[2]))
    }

    /// Which block of its chunk a cell is in, and which bit of that.
    fn place(cell: [i32; 3]) -> (usize, u64) {
        #[expect(clippy::cast_sign_loss, reason = "0 to 7")]
        let [i, j, k] = cell.map(|c| (c >> 2 & 7) as usize);
        let [x, y, z] = cell.map(|c| c & 3);
        (i + 8 * (j + 8 * k), 1 << (x | y << 2 | z << 4))
    }

    fn insert(&mut self, cell: [i32; 3]) {
        let Some(entry) = self.chunk(cell).and_then(|at| self.index.get_mut(at)) else {
            return;
        };
        if *entry == NO_CHUNK {
            #[expect(clippy::cast_possible_truncation, reason = "far fewer chunks")]
            let new = (self.blocks.len() / BLOCKS) as u32;
            *entry = new;
            self.blocks.resize(self.blocks.len() + BLOCKS, 0);
        }
        let (block, bit) = Self::place(cell);
        self.blocks[*entry as usize * BLOCKS + block] |= bit;
    }

    fn contains(&self, cell: [i32; 3]) -> bool {
        let Some(chunk) = self.chunk(cell).map(|at| self.index[at]) else {
            return false;
        };
        let (block, bit) = Self::place(cell);
        chunk != NO_CHUNK && self.blocks[chunk as usize * BLOCKS + block] & bit != 0
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn occupied_is_what_touches_surface_and_nothing_else() {
        let mut rng = Rng::new(7, 0);
        let seen: Vec<Witness> = (0..400)
            .map(|_| Witness {
                point: std::array::from_fn(|_| rng.range(-40.0, 60.0)),
                normal: [0.0, 0.0, 1.0],
                sigma: 0.01,
                new: false,
            })
            .collect();
        let occupied = Occupancy::around(&seen);
        let mut expected = BTreeSet::new();
        for c in seen.iter().map(|w| cell(w.point)) {
            for (x, y, z) in (0..27).map(|d| (d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1)) {
                expected.insert([c[0] + x, c[1] + y, c[2] + z]);
            }
        }
        for c in &expected {
            for axis in 0..3 {
                for step in [-1, 0, 1] {
                    let mut near = *c;
                    near[axis] += step;
                    assert_eq!(
                        occupied.contains(near),
                        expected.contains(&near),
                        "{near:?}"
                    );
                }
            }
        }
        for _ in 0..20_000 {
            let far = cell(std::array::from_fn(|_| rng.range(-150.0, 150.0)));
            assert_eq!(occupied.contains(far), expected.contains(&far), "{far:?}");
        }
        assert!(!Occupancy::around(&[]).contains([0; 3]));
    }
}
