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
