//! The part of a map that one run looked at: enough to ask the same question again without the map.
//!
//! Features of the whole map say where a query may lie; all that follows, from refinement to verdict, looks no further than the map's
//! surface near these places. A [`MapPart`] keeps the places and the surface around them, at each voxel size that was tried, in the
//! map's own order and offsets: neighbours, Gaussians and sums then come out the same, to the bit, as long as nothing that was looked at
//! is missing. How far a run looked is not known beforehand, so whoever cuts a part asks it ([`KeptMap::part`]), compares, and
//! cuts a wider one where the answers differ.

use std::borrow::Cow;

use crate::config::{Config, VerifyConfig};
use crate::covariance::way;
use crate::error::{Error, Result};
use crate::kdtree::KdTree;
use crate::kept::{KeptMap, KeptQuery};
use crate::outcome::{Outcome, Stage};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::scale::Measure;
use crate::vec3::voxel_of;

/// The part of a map that a run looked at, and what it learned of the whole.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapPart {
    /// Points of the map as given.
    pub points: usize,
    /// Whether it was prepared beforehand.
    pub built: bool,
    /// What was measured of it, where that was asked.
    pub measure: Option<Measure>,
    /// Its voxel sizes, metres, the finest first; none where they were not asked for.
    pub voxels: Vec<f64>,
    /// What the whole map said at each voxel size.
    pub looks: Vec<Look>,
    /// Its surface at each voxel size, as far as it was looked at.
    pub levels: Vec<PartLevel>,
    /// What the paper's metrics met.
    pub reference: Reference,
}

/// What features of the whole map led to at one voxel size.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Look {
    /// The voxel size, metres.
    pub voxel: f64,
    /// Stages that it took.
    pub stages: Vec<Count>,
    /// Poses (`map_from_query`) that went on to be refined, in order.
    pub starts: Vec<Pose>,
    /// Gaussians that were made of the map for it.
    pub gaussians: usize,
}

/// A stage and what went in and came out.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Count {
    /// Its name.
    pub name: String,
    /// Things that went in.
    pub count_in: usize,
    /// Things that came out.
    pub count_out: usize,
}

/// A part of a map's surface at one voxel size, see [`Surface`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PartLevel {
    /// The voxel size, metres.
    pub voxel: f64,
    /// Origin of all offsets, map frame, metres.
    pub origin: [f64; 3],
    /// Points that the whole surface has.
    pub of: usize,
    /// Offsets from the origin, in the order that they have there.
    pub points: Vec<[f32; 3]>,
    /// Unit normals, or zeros.
    pub normals: Vec<[f32; 3]>,
}

/// Points of the map as given, or, where it was prepared beforehand, of its finest level, that were nearest to the query's at the pose answered and made them
/// inliers.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Reference {
    /// Origin of all offsets, map frame, metres.
    pub origin: [f64; 3],
    /// Points that they were looked up among.
    pub of: usize,
    /// Offsets from the origin, in the order that they have there.
    pub points: Vec<[f32; 3]>,
}

/// Where a run looked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trail {
    /// What features led to, by voxel size.
    pub(crate) looks: Vec<Look>,
    /// Voxel sizes at which the map's surface was asked for.
    pub(crate) voxels: Vec<f64>,
    /// Poses that refinement led to, at whatever size.
    pub(crate) led_to: Vec<Pose>,
}

impl Trail {
    /// The map's surface was asked for.
    pub(crate) fn asked(&mut self, voxel: f64) {
        if !self.voxels.iter().any(|v| same(*v, voxel)) {
            self.voxels.push(voxel);
        }
    }

    /// `stages` at a voxel size led to `starts`.
    pub(crate) fn found(&mut self, voxel: f64, stages: &[Stage], starts: &[Pose]) {
        let count = |s: &Stage| Count {
            name: s.name.clone(),
            count_in: s.count_in,
            count_out: s.count_out,
        };
        self.looks.push(Look {
            voxel,
            stages: stages.iter().map(count).collect(),
            starts: starts.to_vec(),
            gaussians: 0,
        });
    }

    /// So many Gaussians were made for what was found last.
    pub(crate) fn made(&mut self, gaussians: usize) {
        if let Some(look) = self.looks.last_mut() {
            look.gaussians = gaussians;
        }
    }
}

fn same(a: f64, b: f64) -> bool {
    a.to_bits() == b.to_bits()
}

impl MapPart {
    /// Cuts out of `map` what a run that left a `trail` and gave an `outcome` looked at: whatever lies within `reach` blocks of where any pose that
    /// it weighed puts a point of the query; all of the map's surface where that is `None`. A block is as wide as NDT's coarsest cell, at least 8 voxels.
    ///
    /// `map`, `query` and `config` are those of the run.
    ///
    /// # Errors
    /// [`Error::Map`] where a prepared map is damaged.
    pub fn cut(
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        config: &Config,
        (trail, outcome): (&Trail, &Outcome),
        reach: Option<u32>,
    ) -> Result<Self> {
        // A voxel size that was asked for needs no measure.
        let measure = match config.scale.voxel {
            asked if asked > 0.0 => None,
            _ => map.measure(config),
        };
        let voxels = measure.as_ref().map(|measure| map.voxels(measure));
        let mut levels = Vec::with_capacity(trail.voxels.len());
        for &voxel in &trail.voxels {
            let starts = trail.looks.iter().filter(|look| same(look.voxel, voxel));
            let starts = starts.flat_map(|look| &look.starts);
            let mut poses: Vec<Pose> = starts.chain(&trail.led_to).copied().collect();
            let query = &query.at(voxel, config).surface;
            let surface = &map.at(voxel, config)?.surface;
            if outcome.voxel.is_some_and(|answered| same(answered, voxel)) {
                let width = measure.as_ref().and_then(|measure| measure.width);
                poses.extend(slid(
                    outcome,
                    surface,
                    query,
                    &config.verify.at(voxel, width),
                ));
            }
            let block = config.ndt.coarsest.metres(voxel).max(BLOCK * voxel);
            let near = reach.map(|reach| Blocks::around(&poses, query, surface, block, reach));
            let kept = |p: &[f32; 3]| near.as_ref().is_none_or(|near| near.hold(p));
            let points = surface.points.iter().zip(surface.normals.iter());
            let (points, normals) = points.filter(|(p, _)| kept(p)).unzip();
            levels.push(PartLevel {
                voxel,
                origin: surface.origin,
                of: map.at(voxel, config)?.len(),
                points,
                normals,
            });
        }
        let reference = match &outcome.map_from_query {
            Some(pose) => {
                let (origin, points) = map.met(query.cloud(), pose, outcome.inlier_distance)?;
                Reference {
                    origin,
                    of: map.reference()?,
                    points,
                }
            }
            None => Reference::default(),
        };
        Ok(Self {
            points: map.points(),
            built: map.is_built(),
            measure,
            voxels: voxels.unwrap_or_default(),
            looks: trail.looks.clone(),
            levels,
            reference,
        })
    }

    /// The level of a voxel size.
    pub(crate) fn level(&self, voxel: f64) -> Result<&PartLevel> {
        let level = self.levels.iter().find(|level| same(level.voxel, voxel));
        level.ok_or_else(|| missing(voxel))
    }

    /// What the whole map said at a voxel size.
    pub(crate) fn look(&self, voxel: f64) -> Option<&Look> {
        self.looks.iter().find(|look| same(look.voxel, voxel))
    }
}

impl PartLevel {
    /// The surface, as far as there is any.
    pub(crate) fn surface(&self) -> Result<Surface<'_>> {
        if self.points.len() != self.normals.len() {
            return Err(Error::Map(format!(
                "this part of the map has {} points and {} normals at a voxel size of {:.3} m; as many are needed",
                self.points.len(),
                self.normals.len(),
                self.voxel
            )));
        }
        Ok(Surface {
            origin: self.origin,
            voxel: self.voxel,
            points: Cow::Borrowed(&self.points),
            normals: Cow::Borrowed(&self.normals),
            // Names of points ascend as they do in the whole tree, so that equal distances are ordered alike.
            tree: KdTree::build(&self.points),
        })
    }

    /// That nothing was looked for at this size.
    pub(crate) fn not_looked_at(&self) -> Error {
        missing(self.voxel)
    }
}

fn missing(voxel: f64) -> Error {
    Error::Map(format!(
        "this part of the map was not looked at with a voxel size of {voxel:.3} m, which is now asked for; give the whole map"
    ))
}

/// Where the covariance slid the pose that was answered.
fn slid(
    outcome: &Outcome,
    map: &Surface<'_>,
    query: &Surface<'_>,
    verify: &VerifyConfig,
) -> Vec<Pose> {
    let (Some(pose), Some(at)) = (&outcome.map_from_query, outcome.covariance_at) else {
        return Vec::new();
    };
    let open = outcome.unobservable.iter().flatten();
    let ways = open.flat_map(|open| [-1.0, 1.0].map(|sign| (open, sign)));
    ways.flat_map(|(open, sign)| way(open, sign, map, query, (pose, at), verify))
        .map(|(_, pose)| pose)
        .collect()
}

/// Least width of a block, in voxels.
const BLOCK: f64 = 8.0;

/// Cubes of space, in the offsets of a surface.
struct Blocks {
    size: f64,
    /// In ascending order.
    cells: Vec<[i64; 3]>,
}

impl Blocks {
    /// All within `reach` blocks of one that holds a point of `query` at one of the poses.
    fn around(
        poses: &[Pose],
        query: &Surface<'_>,
        map: &Surface<'_>,
        size: f64,
        reach: u32,
    ) -> Self {
        let mut cells: Vec<[i64; 3]> = Vec::new();
        for pose in poses {
            let pose = pose.between_origins(map.origin, query.origin);
            let points = query.points.iter().map(|p| p.map(f64::from));
            let mut own: Vec<_> = points.map(|p| voxel_of(pose.transform(p), size)).collect();
            unique(&mut own);
            cells.append(&mut own);
            unique(&mut cells);
        }
        let reach = i64::from(reach);
        for axis in 0..3 {
            let along = |cell: &[i64; 3]| {
                let cell = *cell;
                (-reach..=reach).map(move |by| {
                    let mut moved = cell;
                    moved[axis] = moved[axis].saturating_add(by);
                    moved
                })
            };
            cells = cells.iter().flat_map(along).collect();
            unique(&mut cells);
        }
        Self { size, cells }
    }

    fn hold(&self, p: &[f32; 3]) -> bool {
        let cell = voxel_of(p.map(f64::from), self.size);
        self.cells.binary_search(&cell).is_ok()
    }
}

fn unique(cells: &mut Vec<[i64; 3]>) {
    cells.sort_unstable();
    cells.dedup();
}

#[cfg(test)]
mod tests;
