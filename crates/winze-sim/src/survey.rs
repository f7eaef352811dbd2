//! What a robot's mapping software makes of a drive: scans gathered along its trajectory, one point a voxel.

use rustc_hash::FxHashMap;
use winze::fit::fit_rigid;
use winze::vec3::voxel_of;
use winze::{Cloud, Pose};

use crate::error::Result;
use crate::labels::{SeenSurface, Witness};
use crate::sensor::{Return, ReturnOrigin};

/// Noise-free points kept of a query, at most about this many; its labels are computed from them.
const WITNESSES: usize = 6000;

/// Gathers points in voxels, each answering with the mean of what fell into it.
#[derive(Debug, Clone)]
pub struct Gathered {
    voxel: f64,
    cells: FxHashMap<[i64; 3], Cell>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    sum: [f64; 3],
    intensity: f64,
    count: u32,
}

impl Gathered {
    /// Nothing yet; `voxel` in metres.
    #[must_use]
    pub fn new(voxel: f64) -> Self {
        Self {
            voxel,
            cells: FxHashMap::default(),
        }
    }

    /// Adds a point.
    pub fn add(&mut self, point: [f64; 3], intensity: f32) {
        let cell = self.cells.entry(voxel_of(point, self.voxel)).or_default();
        for (s, v) in cell.sum.iter_mut().zip(point) {
            *s += v;
        }
        cell.intensity += f64::from(intensity);
        cell.count += 1;
    }

    /// Voxels that hold something.
    #[must_use]
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// There are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// One point a voxel, in the order of their places, seen through `frame_from_points`.
    ///
    /// # Errors
    /// As [`Cloud::from_points`].
    pub fn cloud(self, frame_from_points: &Pose, with_intensity: bool) -> Result<Cloud> {
        let mut cells: Vec<([i64; 3], Cell)> = self.cells.into_iter().collect();
        cells.sort_unstable_by_key(|(key, _)| *key);
        let points: Vec<[f64; 3]> = cells
            .iter()
            .map(|(_, c)| frame_from_points.transform(c.sum.map(|s| s / f64::from(c.count))))
            .collect();
        #[expect(clippy::cast_possible_truncation, reason = "a mean of f32 values")]
        let intensity: Option<Vec<f32>> = with_intensity.then(|| {
            cells
                .iter()
                .map(|(_, c)| (c.intensity / f64::from(c.count)) as f32)
                .collect()
        });
        Ok(Cloud::with_intensity(&points, intensity.as_deref())?.0)
    }
}

/// A query as it was gathered, with what only a simulator knows of it.
#[derive(Debug, Clone)]
pub struct Gathering {
    /// The cloud in the frame of the query.
    pub cloud: Cloud,
    /// Takes query points to the world: exact without drift, else the rigid fit of the points to where they truly were.
    pub world_from_query: Pose,
    /// What such a fit leaves, root mean square, metres; 0 without drift.
    pub bend_rms: f64,
    /// Noise-free surface points, evenly drawn, world frame.
    pub witnesses: Vec<Witness>,
    /// Returns from surfaces, and from dust, mirrors and edges.
    pub returns: [usize; 2],
}

/// Collects a query's scans; see [`QueryGatherer::finish`].
#[derive(Debug, Clone)]
pub struct QueryGatherer {
    query_from_world: Pose,
    bent: bool,
    gathered: Gathered,
    pairs: FxHashMap<[i64; 3], Pair>,
    seen: SeenSurface,
    returns: [usize; 2],
}

/// What the surface returns of a voxel were taken for, and where they truly were: sums.
#[derive(Debug, Clone, Copy, Default)]
struct Pair {
    placed: [f64; 3],
    truth: [f64; 3],
    count: u32,
}

impl QueryGatherer {
    /// A query whose frame is `query_from_world` away from the world at its first scan; `bent` where
    /// odometry drifts.
    #[must_use]
    pub fn new(query_from_world: Pose, voxel: f64, bent: bool) -> Self {
        Self {
            query_from_world,
            bent,
            gathered: Gathered::new(voxel),
            pairs: FxHashMap::default(),
            seen: SeenSurface::default(),
            returns: [0; 2],
        }
    }

    /// Adds a scan taken at `world_from_sensor`, where odometry believed the sensor to be at
    /// `believed` (in the world, as the drifting odometry sees it). `sigma` tells the sensor's noise at a range, `is_new` whether a
    /// part is.
    pub fn add(
        &mut self,
        scan: &[Return],
        world_from_sensor: &Pose,
        believed: &Pose,
        sigma: impl Fn(f64) -> f64,
        is_new: impl Fn(u16) -> bool,
    ) {
        let query_from_sensor = self.query_from_world.compose(believed);
        for r in scan {
            let point = r.point();
            let placed = query_from_sensor.transform(point);
            self.gathered.add(placed, r.intensity);
            let surface = r.origin == ReturnOrigin::Surface;
            self.returns[usize::from(!surface)] += 1;
            if !surface {
                continue;
            }
            if self.bent {
                let truth = world_from_sensor.transform(point);
                let pair = self
                    .pairs
                    .entry(voxel_of(placed, self.gathered.voxel))
                    .or_default();
                for a in 0..3 {
                    pair.placed[a] += placed[a];
                    pair.truth[a] += truth[a];
                }
                pair.count += 1;
            }
            self.seen.add(r, world_from_sensor, &sigma, &is_new);
        }
    }

    /// The query with its truth.
    ///
    /// # Errors
    /// As [`Cloud::from_points`].
    pub fn finish(self, with_intensity: bool) -> Result<Gathering> {
        let (world_from_query, bend_rms) = if self.bent {
            fit_bent(self.pairs, &self.query_from_world.inverse())
        } else {
            (self.query_from_world.inverse(), 0.0)
        };
        let seen = self.seen.witnesses();
        let step = seen.len().div_ceil(WITNESSES).max(1);
        Ok(Gathering {
            cloud: self.gathered.cloud(&Pose::identity(), with_intensity)?,
            world_from_query,
            bend_rms,
            witnesses: seen.into_iter().step_by(step).collect(),
            returns: self.returns,
        })
    }
}

/// The rigid fit of a bent query's points, one a voxel, to where they truly were, and what it leaves.
fn fit_bent(pairs: FxHashMap<[i64; 3], Pair>, otherwise: &Pose) -> (Pose, f64) {
    let mut pairs: Vec<([i64; 3], Pair)> = pairs.into_iter().collect();
    pairs.sort_unstable_by_key(|(key, _)| *key);
    let pairs: Vec<([f64; 3], [f64; 3])> = pairs
        .into_iter()
        .map(|(_, p)| {
            let mean = |sum: [f64; 3]| sum.map(|s| s / f64::from(p.count));
            (mean(p.placed), mean(p.truth))
        })
        .collect();
    let pose = fit_rigid(pairs.iter().map(|(q, w)| (*q, *w, 1.0))).unwrap_or(*otherwise);
    let square: f64 = pairs
        .iter()
        .map(|(q, w)| {
            let p = pose.transform(*q);
            (0..3).map(|a| (p[a] - w[a]) * (p[a] - w[a])).sum::<f64>()
        })
        .sum();
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = pairs.len().max(1) as f64;
    (pose, (square / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A surface return of a sensor's frame.
    fn seen(point: [f64; 3]) -> Return {
        let range = winze::vec3::norm(point);
        Return {
            direction: point.map(|c| c / range),
            range,
            true_range: Some(range),
            origin: ReturnOrigin::Surface,
            part: 0,
            normal: [0.0, 0.0, 1.0],
            intensity: 0.5,
        }
    }

    /// A drive of 12 scans, a metre apart, that odometry believes to bend by up to `bend` metres and radians; the scan
    /// at the start is taken `at_start` times.
    fn driven(bend: f64, at_start: usize) -> Gathering {
        let query_from_world = Pose::from_rotation_vector([0.3, -0.2, 1.0], [5.0, 4.0, -2.0]);
        let mut gatherer = QueryGatherer::new(query_from_world, 0.1, true);
        let scan: Vec<Return> = (0..400)
            .map(|i| {
                let angle = 0.7 * f64::from(i);
                let along = 0.01 * f64::from(i) - 2.0;
                seen([along, 2.0 * libm::cos(angle), 2.0 * libm::sin(angle)])
            })
            .collect();
        for i in 0..12 {
            let way = f64::from(i);
            let share = (way / 11.0) * (way / 11.0);
            let truly = Pose::from_translation([way, 0.0, 1.5]);
            let believed = truly.compose(&Pose::from_rotation_vector(
                [0.0, 0.0, 0.1 * bend * share],
                [0.0, bend * share, 0.0],
            ));
            for _ in 0..if i == 0 { at_start } else { 1 } {
                gatherer.add(&scan, &truly, &believed, |_| 0.01, |_| false);
            }
        }
        gatherer.finish(false).unwrap()
    }

    #[test]
    fn without_a_bend_the_fit_is_the_frame_itself() {
        let gathering = driven(0.0, 1);
        let frame = Pose::from_rotation_vector([0.3, -0.2, 1.0], [5.0, 4.0, -2.0]).inverse();
        let off = gathering.world_from_query.distance(&frame, [0.0; 3]);
        assert!(off.translation < 1e-9 && off.rotation < 1e-9, "{off:?}");
        assert!(gathering.bend_rms < 1e-9, "{}", gathering.bend_rms);
    }

    #[test]
    fn the_truth_of_a_bent_query_is_its_best_rigid_fit() {
        let frame = Pose::from_rotation_vector([0.3, -0.2, 1.0], [5.0, 4.0, -2.0]).inverse();
        let bent = driven(0.4, 1);
        let off = bent.world_from_query.distance(&frame, [0.0; 3]);
        assert!(off.translation > 0.05, "not the first scan's: {off:?}");
        // A point a voxel: what was seen fifty times counts as what was seen once.
        let long = driven(0.4, 50);
        let moved = long
            .world_from_query
            .distance(&bent.world_from_query, [0.0; 3]);
        assert!(moved.translation < 0.02, "{moved:?}");

        // Its own pairs: no small motion lies closer to them, and what is left is the bend.
        let mut pairs = FxHashMap::default();
        for i in 0..200 {
            let x = 0.05 * f64::from(i);
            let placed = [x, libm::sin(1.3 * x), libm::cos(0.9 * x)];
            let truth = frame.transform([x, placed[1] + 0.01 * x * x, placed[2]]);
            let count = 1 + i % 7;
            let times = |p: [f64; 3]| p.map(|v| v * f64::from(count));
            let pair = Pair {
                placed: times(placed),
                truth: times(truth),
                count: count as u32,
            };
            pairs.insert(voxel_of(placed, 0.02), pair);
        }
        let rms = |pose: &Pose| {
            let square: f64 = pairs
                .values()
                .map(|p: &Pair| {
                    let mean = |sum: [f64; 3]| sum.map(|s| s / f64::from(p.count));
                    let off = winze::vec3::sub(pose.transform(mean(p.placed)), mean(p.truth));
                    winze::vec3::dot(off, off)
                })
                .sum();
            (square / pairs.len() as f64).sqrt()
        };
        let (pose, bend) = fit_bent(pairs.clone(), &Pose::identity());
        assert!((bend - rms(&pose)).abs() < 1e-12 && bend > 0.01, "{bend}");
        let middle = pose.transform([5.0, 0.0, 0.0]);
        for a in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut step = [0.0; 3];
                step[a] = sign * 1e-3;
                for other in [
                    pose.perturbed(step, [0.0; 3], middle),
                    pose.perturbed([0.0; 3], step, middle),
                ] {
                    assert!(rms(&other) > bend, "{a} {sign}");
                }
            }
        }
    }
}
