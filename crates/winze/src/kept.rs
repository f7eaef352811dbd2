//! Work on a map or a query that need not be done twice.
//!
//! A robot asks the same map again and again, and an evaluation asks the same question with many
//! seeds. What [`locate_in`](crate::locate::locate_in) works out about a cloud depends on the cloud,
//! the voxel size and a few sections of the configuration, never on the seed; a [`KeptMap`] and a
//! [`KeptQuery`] remember it. The answer is the same, to the bit, as without them. Where the sections change, what was kept is
//! dropped.
//!
//! Memory: the points of a cloud once more in a tree and, of a map, once more thinned a little (its base); and
//! for each of the last few voxel sizes the thinned surface with its normals, tree, descriptors, their index,
//! and Gaussians. A [`PreparedMap`] has all that in its file.

use std::sync::Arc;

use crate::base::{Base, base_of};
use crate::cloud::Cloud;
use crate::columns::Memory;
use crate::config::{
    Config, FpfhConfig, IcpConfig, IssConfig, MatchingConfig, NdtConfig, PrepareConfig,
    VerifyConfig,
};
use crate::descriptor_index::{self, DescriptorIndex};
use crate::error::Result;
use crate::features::{Features, describe, describe_map};
use crate::kdtree::KdTree;
use crate::matching::{Correspondence, match_indexed};
use crate::metrics::{self, InlierMetrics};
use crate::ndt::{self, NdtCells};
use crate::parallel;
use crate::part::{Look, MapPart, PartLevel};
use crate::pose::Pose;
use crate::prepare::{Frame, Surface, limit_range, prepare, remove_outliers};
use crate::prepared::{PreparedMap, level_in};
use crate::scale::{self, Measure};

mod recent;
mod refinements;
#[cfg(test)]
mod tests;

use recent::Recent;
pub(crate) use refinements::{Refinements, Refiner};

/// Voxel sizes kept; with `auto`'s few tries on a ladder of sizes, queries of one kind share them.
const MOST_SIZES: usize = 6;

/// A map and what was worked out about it so far, by [`locate_in`](crate::locate::locate_in), or long before.
#[derive(Debug)]
pub struct KeptMap<'a> {
    source: Source<'a>,
    /// What the paper's metrics compare with, where that is not the source.
    reference: Option<&'a Cloud>,
    settings: Option<Settings>,
    /// Of the raw points.
    spacing: Option<Option<f64>>,
    base: Option<(f64, Base)>,
    measure: Option<Measure>,
    tree: Option<KdTree<'static>>,
    /// Of a prepared map.
    finest: Option<Surface<'a>>,
    sizes: Recent<MapAt<'a>>,
}

/// What a map is made of.
#[derive(Debug, Clone, Copy)]
enum Source<'a> {
    Cloud(&'a Cloud),
    Prepared(&'a dyn PreparedMap),
    Part(&'a MapPart),
}

/// Points to look things up among.
struct Compared<'a> {
    tree: &'a KdTree<'a>,
    origin: [f64; 3],
    points: &'a [[f32; 3]],
    /// How many there are of the whole map.
    of: usize,
}

/// A query and what was worked out about it so far, by [`locate_in`](crate::locate::locate_in).
#[derive(Debug)]
pub struct KeptQuery<'a> {
    cloud: &'a Cloud,
    settings: Option<Settings>,
    limited: Option<Cloud>,
    measure: Option<Option<Measure>>,
    sizes: Recent<QueryAt>,
}

/// A map at one voxel size.
#[derive(Debug)]
pub(crate) struct MapAt<'a> {
    pub(crate) surface: Surface<'a>,
    /// Where the rest was prepared beforehand, if it was, and at which level.
    prepared: Option<(&'a dyn PreparedMap, usize)>,
    /// What is known of the rest, where this is but a part of the map.
    part: Option<&'a PartLevel>,
    look: Option<&'a Look>,
    features: Option<(Features<'a>, DescriptorIndex<'a>)>,
    cells: Option<Vec<NdtCells<'a>>>,
    /// Tells these features from those of any other map or size.
    mark: Arc<()>,
}

/// A query at one voxel size.
#[derive(Debug)]
pub(crate) struct QueryAt {
    pub(crate) surface: Surface<'static>,
    features: Option<Features<'static>>,
    /// With the mark of the map they lead to, and how they were matched.
    correspondences: Vec<(Arc<()>, MatchingConfig, Vec<Correspondence>)>,
    pub(crate) refinements: Refinements,
}

/// The sections that what is kept depends on.
#[derive(Debug, Clone, PartialEq)]
struct Settings {
    voxel: f64,
    prepare: PrepareConfig,
    iss: IssConfig,
    fpfh: FpfhConfig,
    matching: MatchingConfig,
    ndt: NdtConfig,
    icp: IcpConfig,
}

impl Settings {
    fn of(config: &Config) -> Self {
        Self {
            voxel: config.scale.voxel,
            prepare: config.prepare.clone(),
            iss: config.iss.clone(),
            fpfh: config.fpfh.clone(),
            matching: config.matching.clone(),
            ndt: config.ndt.clone(),
            icp: config.icp.clone(),
        }
    }
}

impl<'a> KeptMap<'a> {
    /// A map about which nothing is known yet.
    #[must_use]
    pub fn new(map: &'a Cloud) -> Self {
        Self::keeping(Source::Cloud(map), MOST_SIZES)
    }

    /// A map that was prepared beforehand.
    #[must_use]
    pub fn prepared(map: &'a dyn PreparedMap) -> Self {
        Self::keeping(Source::Prepared(map), MOST_SIZES)
    }

    /// The same, with the cloud that it was made of: the paper's metrics are then taken against all of its
    /// points, as they are for a map that was not prepared.
    #[must_use]
    pub fn measured_against(mut self, cloud: &'a Cloud) -> Self {
        self.reference = Some(cloud);
        self
    }

    /// What an earlier run looked at of a map, see [`part`](crate::part).
    #[must_use]
    pub fn part(part: &'a MapPart) -> Self {
        Self::keeping(Source::Part(part), MOST_SIZES)
    }

    /// For a single question: one voxel size and the finest one at a time.
    pub(crate) fn once(map: &'a Cloud) -> Self {
        Self::keeping(Source::Cloud(map), 2)
    }

    fn keeping(source: Source<'a>, most: usize) -> Self {
        Self {
            source,
            reference: None,
            settings: None,
            spacing: None,
            base: None,
            measure: None,
            tree: None,
            finest: None,
            sizes: Recent::new(most),
        }
    }

    /// Points of the map as given.
    #[must_use]
    pub fn points(&self) -> usize {
        match self.source {
            Source::Cloud(cloud) => cloud.len(),
            Source::Prepared(map) => map.points(),
            Source::Part(part) => part.points,
        }
    }

    /// Whether what [`KeptMap::inliers`] compares with was prepared beforehand.
    pub(crate) fn is_built(&self) -> bool {
        match self.compared() {
            Source::Cloud(_) => false,
            Source::Prepared(_) => true,
            Source::Part(part) => part.built,
        }
    }

    /// What [`KeptMap::inliers`] compares with, in words.
    #[must_use]
    pub fn inlier_reference(&self) -> &'static str {
        if self.is_built() {
            "finest level of the built map"
        } else {
            "map as read"
        }
    }

    /// What the paper's metrics compare with.
    fn compared(&self) -> Source<'a> {
        self.reference.map_or(self.source, Source::Cloud)
    }

    /// The paper's metrics of `query` at any pose, against the map as given, or, where it was prepared
    /// beforehand, against its finest level: at the truth, the ceiling that no method can be asked to exceed.
    ///
    /// # Errors
    /// [`Error::Map`](crate::Error::Map) where a prepared map is damaged.
    pub fn inliers(
        &mut self,
        query: &Cloud,
        map_from_query: &Pose,
        config: &VerifyConfig,
    ) -> Result<InlierMetrics> {
        let compared = self.look_up()?;
        Ok(metrics::inliers(
            compared.tree,
            compared.origin,
            query,
            map_from_query,
            config.inlier_distance,
        ))
    }

    /// What [`KeptMap::inliers`] at a pose is about: those points of the map that make one of `query`'s an inlier, in order, and their origin.
    pub(crate) fn met(
        &mut self,
        query: &Cloud,
        map_from_query: &Pose,
        distance: f64,
    ) -> Result<([f64; 3], Vec<[f32; 3]>)> {
        let compared = self.look_up()?;
        let near = metrics::near(
            compared.tree,
            compared.origin,
            query,
            map_from_query,
            distance,
        );
        let mut met = parallel::map_with(query.len(), || (), |(), i| near(i).map(|n| n.index));
        met.sort_unstable();
        met.dedup();
        let met = met.into_iter().flatten();
        let met = met.map(|i| compared.points[i as usize]).collect();
        Ok((compared.origin, met))
    }

    /// The surface that an answer at `voxel` metres was judged on ([`Outcome::voxel`](crate::Outcome::voxel)), to look closer at it.
    ///
    /// # Errors
    /// [`Error::Map`](crate::Error::Map) where a prepared map is damaged.
    pub fn surface(&mut self, voxel: f64, config: &Config) -> Result<&Surface<'a>> {
        self.settle(config)?;
        Ok(&self.at(voxel, config)?.surface)
    }

    /// How an answer at `voxel` metres was verified: lengths that depend on the map are settled.
    #[must_use]
    pub fn verification(&mut self, voxel: f64, config: &Config) -> VerifyConfig {
        let measured = config.scale.voxel <= 0.0;
        let measure = if measured { self.measure(config) } else { None };
        config.verify.at(voxel, measure.and_then(|m| m.width))
    }

    /// Makes what [`KeptMap::inliers`] looks things up in; how many points that has.
    pub(crate) fn reference(&mut self) -> Result<usize> {
        Ok(self.look_up()?.of)
    }

    /// What the paper's metrics compare with.
    fn look_up(&mut self) -> Result<Compared<'_>> {
        Ok(match self.compared() {
            Source::Cloud(cloud) => Compared {
                tree: self.tree(cloud.points()),
                origin: cloud.origin(),
                points: cloud.points(),
                of: cloud.len(),
            },
            Source::Prepared(map) => {
                let finest = self.finest(map)?;
                Compared {
                    tree: &finest.tree,
                    origin: finest.origin,
                    points: &finest.points,
                    of: finest.points.len(),
                }
            }
            Source::Part(part) => Compared {
                tree: self.tree(&part.reference.points),
                origin: part.reference.origin,
                points: &part.reference.points,
                of: part.reference.of,
            },
        })
    }

    /// The finest level of a prepared map.
    fn finest(&mut self, map: &'a dyn PreparedMap) -> Result<&Surface<'a>> {
        let finest = match self.finest.take() {
            Some(known) => known,
            None => map.surface(0)?,
        };
        Ok(self.finest.insert(finest))
    }

    /// The tree over all points of the map.
    fn tree(&mut self, points: &[[f32; 3]]) -> &KdTree<'static> {
        self.tree.get_or_insert_with(|| KdTree::build(points))
    }

    /// Drops what other settings gave.
    pub(crate) fn settle(&mut self, config: &Config) -> Result<()> {
        if let Source::Prepared(map) = self.source {
            map.agrees(config)?;
        }
        let settings = Settings::of(config);
        if self.settings.as_ref() != Some(&settings) {
            // Neither the spacing nor the tree depends on them.
            self.sizes.clear();
            self.base = None;
            self.measure = None;
            self.settings = Some(settings);
        }
        Ok(())
    }

    /// `None` where the map has no two distinct points.
    pub(crate) fn measure(&mut self, config: &Config) -> Option<Measure> {
        match self.source {
            Source::Prepared(map) => Some(map.measure()),
            Source::Part(part) => part.measure,
            Source::Cloud(_) if self.measure.is_some() => self.measure,
            Source::Cloud(cloud) => {
                let points = cloud.points();
                let spacing = (*self.spacing.get_or_insert_with(|| scale::spacing(points)))?;
                let voxel = scale::base_voxel(spacing);
                let base = kept_base(&mut self.base, cloud, voxel, config);
                let Ok(measure) =
                    scale::measure_base((&base.points, voxel), cloud.origin(), spacing, &Memory);
                self.measure = Some(measure);
                self.measure
            }
        }
    }

    /// The voxel sizes at which the map is or will be prepared, given its measure, finest first.
    pub(crate) fn voxels(&self, measure: &Measure) -> Vec<f64> {
        match self.source {
            Source::Cloud(_) => scale::levels(measure),
            Source::Prepared(map) => map.voxels().to_vec(),
            Source::Part(part) => part.voxels.clone(),
        }
    }

    /// The map at `voxel` metres.
    pub(crate) fn at(&mut self, voxel: f64, config: &Config) -> Result<&mut MapAt<'a>> {
        let (source, kept, spacing) = (self.source, &mut self.base, self.spacing.flatten());
        self.sizes.try_at(voxel, || {
            let (mut prepared, mut part, mut look) = (None, None, None);
            let surface = match source {
                Source::Part(of) => {
                    let level = of.level(voxel)?;
                    (part, look) = (Some(level), of.look(voxel));
                    level.surface()?
                }
                Source::Prepared(map) => {
                    let same = |v: &f64| v.to_bits() == voxel.to_bits();
                    let level = map.voxels().iter().position(same).unwrap_or(0);
                    prepared = Some((map, level));
                    map.surface(level)?
                }
                Source::Cloud(cloud) => {
                    // A voxel that was asked for is its own base.
                    let finest = match spacing {
                        Some(spacing) if config.scale.voxel <= 0.0 => scale::base_voxel(spacing),
                        _ => voxel,
                    };
                    let base = kept_base(kept, cloud, finest, config);
                    let frame = Frame {
                        origin: cloud.origin(),
                        viewpoint: cloud.viewpoint(),
                    };
                    let points = (&base.points[..], &base.weights[..]);
                    let Ok(surface) = level_in(points, frame, voxel, config, &Memory);
                    surface.into_surface()
                }
            };
            Ok(MapAt {
                surface,
                prepared,
                part,
                look,
                features: None,
                cells: None,
                mark: Arc::new(()),
            })
        })
    }
}

/// The base of `cloud` in cells of `voxel` metres, made where it is not the one kept.
fn kept_base<'k>(
    kept: &'k mut Option<(f64, Base)>,
    cloud: &Cloud,
    voxel: f64,
    config: &Config,
) -> &'k Base {
    let known = kept.take().filter(|(v, _)| v.to_bits() == voxel.to_bits());
    let (_, base) = kept.insert(known.unwrap_or_else(|| {
        let base = if config.prepare.denoise_first {
            base_of(&remove_outliers(cloud, &config.prepare, voxel), voxel)
        } else {
            base_of(cloud, voxel)
        };
        (voxel, base)
    }));
    base
}

impl<'a> KeptQuery<'a> {
    /// A query about which nothing is known yet.
    #[must_use]
    pub fn new(query: &'a Cloud) -> Self {
        Self::keeping(query, MOST_SIZES)
    }

    /// For a single question: one voxel size and the finest one at a time.
    pub(crate) fn once(query: &'a Cloud) -> Self {
        Self::keeping(query, 2)
    }

    fn keeping(cloud: &'a Cloud, most: usize) -> Self {
        Self {
            cloud,
            settings: None,
            limited: None,
            measure: None,
            sizes: Recent::new(most),
        }
    }

    /// The query as given.
    #[must_use]
    pub fn cloud(&self) -> &'a Cloud {
        self.cloud
    }

    /// The surface by which an answer at `voxel` metres was judged ([`Outcome::voxel`](crate::Outcome::voxel)), to look closer at it.
    pub fn surface(&mut self, voxel: f64, config: &Config) -> &Surface<'static> {
        self.settle(config);
        &self.at(voxel, config).surface
    }

    /// Drops what other settings gave.
    pub(crate) fn settle(&mut self, config: &Config) {
        let settings = Settings::of(config);
        if self.settings.as_ref() != Some(&settings) {
            self.sizes.clear();
            self.limited = None;
            self.measure = None;
            self.settings = Some(settings);
        }
    }

    /// The points within the range limits.
    pub(crate) fn limited(&mut self, config: &Config) -> &Cloud {
        self.limited
            .get_or_insert_with(|| limit_range(self.cloud, &config.prepare))
    }

    pub(crate) fn measure(&mut self, config: &Config) -> Option<Measure> {
        if self.measure.is_none() {
            self.measure = Some(scale::measure(self.limited(config)));
        }
        self.measure.flatten()
    }

    pub(crate) fn at(&mut self, voxel: f64, config: &Config) -> &mut QueryAt {
        let limited = self
            .limited
            .get_or_insert_with(|| limit_range(self.cloud, &config.prepare));
        self.sizes.at(voxel, || QueryAt {
            surface: prepare(limited, &config.prepare, voxel),
            features: None,
            correspondences: Vec::new(),
            refinements: Refinements::default(),
        })
    }
}

impl<'a> MapAt<'a> {
    /// Points of the whole map at this size.
    pub(crate) fn len(&self) -> usize {
        self.part.map_or(self.surface.points.len(), |part| part.of)
    }

    /// What an earlier run found on the whole map, where this is but what it then looked at.
    ///
    /// # Errors
    /// [`Error::Map`](crate::Error::Map) where that run did not get so far.
    pub(crate) fn recalled(&self) -> Result<Option<&'a Look>> {
        match (self.part, self.look) {
            (Some(part), None) => Err(part.not_looked_at()),
            (_, look) => Ok(look),
        }
    }

    /// Gaussians of the whole map, where an earlier run counted them.
    pub(crate) fn counted(&self) -> Option<usize> {
        self.look.map(|look| look.gaussians)
    }

    /// Keypoints and descriptors, and the index over these.
    pub(crate) fn describe(
        &mut self,
        config: &Config,
    ) -> Result<&(Features<'a>, DescriptorIndex<'a>)> {
        let features = match (self.features.take(), self.prepared) {
            (Some(known), _) => known,
            (None, Some((map, level))) => map.features(level)?,
            (None, None) => {
                let features = describe_map(&self.surface, config);
                let Ok(index) = descriptor_index::build(&features.descriptors, &Memory);
                (features, index.into_index())
            }
        };
        Ok(self.features.insert(features))
    }

    /// Its features, where they were asked for.
    pub(crate) fn described(&self) -> Option<&Features<'a>> {
        self.features.as_ref().map(|(features, _)| features)
    }

    /// The Gaussians of NDT, coarse to fine, and the surface they were made of.
    pub(crate) fn cells(&mut self, config: &Config) -> Result<(&[NdtCells<'a>], &Surface<'a>)> {
        let cells = match (self.cells.take(), self.prepared) {
            (Some(known), _) => known,
            (None, Some((map, level))) => map.cells(level)?,
            (None, None) => ndt::levels(&self.surface, &config.ndt),
        };
        Ok((self.cells.insert(cells), &self.surface))
    }
}

impl QueryAt {
    /// Forgets where refiners led to on any other map.
    pub(crate) fn refine_on(&mut self, map: &MapAt<'_>) {
        if !self.refinements.are_on(&map.mark) {
            self.refinements = Refinements::on(&map.mark);
        }
    }

    pub(crate) fn describe(&mut self, config: &Config) -> &Features<'static> {
        self.features
            .get_or_insert_with(|| describe(&self.surface, config))
    }

    /// Its features, where they were asked for.
    pub(crate) fn described(&self) -> Option<&Features<'static>> {
        self.features.as_ref()
    }

    /// The matches of this query's descriptors among the map's.
    pub(crate) fn matches(
        &mut self,
        map: &mut MapAt<'_>,
        config: &Config,
        matching: &MatchingConfig,
    ) -> Result<&[Correspondence]> {
        let known = &mut self.correspondences;
        known.retain(|(mark, ..)| Arc::ptr_eq(mark, &map.mark));
        let at = match known.iter().position(|(_, how, _)| how == matching) {
            Some(at) => at,
            None => {
                let own = self
                    .features
                    .get_or_insert_with(|| describe(&self.surface, config));
                let (features, index) = map.describe(config)?;
                let found = match_indexed(&own.descriptors, &features.descriptors, index, matching);
                // The paper's methods match one way, `auto` another.
                known.truncate(1);
                known.push((Arc::clone(&map.mark), matching.clone(), found));
                known.len() - 1
            }
        };
        Ok(&known[at].2)
    }
}
