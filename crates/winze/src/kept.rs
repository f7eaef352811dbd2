//! Work on a map or a query that need not be done twice.
//!
//! A robot asks the same map again and again, and an evaluation asks the same question with many
//! seeds. What [`locate_in`](crate::locate::locate_in) works out about a cloud depends on the cloud,
//! the voxel size and a few sections of the configuration, never on the seed; a [`KeptMap`] and a
//! [`KeptQuery`] remember it. The answer is the same, to the bit, as without them. Where the sections change, what was kept is
//! dropped.
//!
//! Memory: the points of a cloud once more in a tree, and for each of the last few voxel sizes the
//! thinned surface with its normals, tree, descriptors and Gaussians.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

use rustc_hash::FxHashMap;

use crate::cloud::Cloud;
use crate::config::{
    Config, FpfhConfig, IcpConfig, IcpMetric, IssConfig, MatchingConfig, NdtConfig, PrepareConfig,
    VerifyConfig,
};
use crate::features::{Features, describe};
use crate::kdtree::KdTree;
use crate::matching::{Correspondence, match_descriptors};
use crate::metrics::{self, InlierMetrics};
use crate::ndt::{self, NdtCells};
use crate::pose::Pose;
use crate::prepare::{Surface, limit_range, prepare};
use crate::refine::Refined;
use crate::scale::{self, Measure};

/// Voxel sizes kept; with `auto`'s few tries on a ladder of sizes, queries of one kind share them.
const MOST_SIZES: usize = 6;

/// A map and what was worked out about it so far, by [`locate_in`](crate::locate::locate_in).
#[derive(Debug)]
pub struct KeptMap<'a> {
    cloud: Cow<'a, Cloud>,
    settings: Option<Settings>,
    measure: Option<Option<Measure>>,
    tree: Option<KdTree>,
    sizes: Recent<MapAt>,
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
pub(crate) struct MapAt {
    pub(crate) surface: Surface,
    features: Option<Features>,
    cells: Option<Vec<NdtCells>>,
    /// Tells these features from those of any other map or size.
    mark: Arc<()>,
}

/// A query at one voxel size.
#[derive(Debug)]
pub(crate) struct QueryAt {
    pub(crate) surface: Surface,
    features: Option<Features>,
    /// With the mark of the map they lead to.
    correspondences: Option<(Arc<()>, Vec<Correspondence>)>,
    pub(crate) refinements: Refinements,
}

/// Where refiners led to on one map. Methods that start from the same poses share them.
#[derive(Debug, Default)]
pub(crate) struct Refinements {
    /// The map's.
    mark: Arc<()>,
    known: Mutex<FxHashMap<(Refiner, [u64; 16]), Refined>>,
}

/// Which refiner; all else that it depends on is in [`Settings`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Refiner {
    Ndt,
    Icp(IcpMetric),
}

/// Refinements kept; more are forgotten all at once.
const MOST_REFINEMENTS: usize = 10_000;

impl Refinements {
    /// What `work` makes of a start, or made of it before.
    pub(crate) fn get(
        &self,
        refiner: Refiner,
        start: &Pose,
        work: impl FnOnce() -> Refined,
    ) -> Refined {
        let mut bits = [0; 16];
        for (slot, v) in bits.iter_mut().zip(start.to_matrix().iter().flatten()) {
            *slot = v.to_bits();
        }
        let key = (refiner, bits);
        let lock = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().get(&key) {
            return *known;
        }
        let refined = work();
        let mut known = lock();
        if known.len() >= MOST_REFINEMENTS {
            known.clear();
        }
        known.insert(key, refined);
        refined
    }
}

/// The sections that what is kept depends on.
#[derive(Debug, Clone, PartialEq)]
struct Settings {
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
        Self::keeping(Cow::Borrowed(map), MOST_SIZES)
    }

    /// For a single question: one voxel size at a time.
    pub(crate) fn once(map: Cow<'a, Cloud>) -> Self {
        Self::keeping(map, 1)
    }

    fn keeping(cloud: Cow<'a, Cloud>, most: usize) -> Self {
        Self {
            cloud,
            settings: None,
            measure: None,
            tree: None,
            sizes: Recent::new(most),
        }
    }

    /// The map as given.
    #[must_use]
    pub fn cloud(&self) -> &Cloud {
        &self.cloud
    }

    /// The paper's metrics of `query` at any pose, against the map as given: at the truth, the
    /// ceiling that no method can be asked to exceed.
    #[must_use]
    pub fn inliers(
        &mut self,
        query: &Cloud,
        map_from_query: &Pose,
        config: &VerifyConfig,
    ) -> InlierMetrics {
        let origin = self.cloud.origin();
        let distance = config.inlier_distance;
        metrics::inliers(self.tree(), origin, query, map_from_query, distance)
    }

    /// Drops what other settings gave.
    pub(crate) fn settle(&mut self, config: &Config) {
        let settings = Settings::of(config);
        if self.settings.as_ref() != Some(&settings) {
            // Neither the measure nor the tree depends on them.
            self.sizes.clear();
            self.settings = Some(settings);
        }
    }

    pub(crate) fn measure(&mut self) -> Option<Measure> {
        *self
            .measure
            .get_or_insert_with(|| scale::measure(&self.cloud))
    }

    /// The tree over all points of the map.
    pub(crate) fn tree(&mut self) -> &KdTree {
        self.tree
            .get_or_insert_with(|| KdTree::build(self.cloud.points()))
    }

    pub(crate) fn at(&mut self, voxel: f64, config: &Config) -> &mut MapAt {
        self.sizes.at(voxel, || MapAt {
            surface: prepare(&self.cloud, &config.prepare, voxel),
            features: None,
            cells: None,
            mark: Arc::new(()),
        })
    }
}

impl<'a> KeptQuery<'a> {
    /// A query about which nothing is known yet.
    #[must_use]
    pub fn new(query: &'a Cloud) -> Self {
        Self::keeping(query, MOST_SIZES)
    }

    /// For a single question: one voxel size at a time.
    pub(crate) fn once(query: &'a Cloud) -> Self {
        Self::keeping(query, 1)
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
            correspondences: None,
            refinements: Refinements::default(),
        })
    }
}

impl MapAt {
    pub(crate) fn describe(&mut self, config: &Config) -> &Features {
        self.features
            .get_or_insert_with(|| describe(&self.surface, config))
    }

    /// The Gaussians of NDT, coarse to fine, and the surface they were made of.
    pub(crate) fn cells(&mut self, config: &Config) -> (&[NdtCells], &Surface) {
        let cells = self
            .cells
            .get_or_insert_with(|| ndt::levels(&self.surface, &config.ndt));
        (cells, &self.surface)
    }
}

impl QueryAt {
    /// Forgets where refiners led to on any other map.
    pub(crate) fn refine_on(&mut self, map: &MapAt) {
        if !Arc::ptr_eq(&self.refinements.mark, &map.mark) {
            self.refinements = Refinements {
                mark: Arc::clone(&map.mark),
                ..Refinements::default()
            };
        }
    }

    pub(crate) fn describe(&mut self, config: &Config) -> &Features {
        self.features
            .get_or_insert_with(|| describe(&self.surface, config))
    }

    /// The matches of this query's descriptors among the map's.
    pub(crate) fn matches(&mut self, map: &mut MapAt, config: &Config) -> &[Correspondence] {
        let known = self
            .correspondences
            .take()
            .filter(|(mark, _)| Arc::ptr_eq(mark, &map.mark));
        let (_, found) = self.correspondences.insert(known.unwrap_or_else(|| {
            let own = self
                .features
                .get_or_insert_with(|| describe(&self.surface, config));
            let found = match_descriptors(
                &own.descriptors,
                &map.describe(config).descriptors,
                &config.matching,
            );
            (Arc::clone(&map.mark), found)
        }));
        found
    }

    /// What a pose is estimated from: the map's features, the query's, and the matches between.
    pub(crate) fn evidence<'a>(
        &'a mut self,
        map: &'a mut MapAt,
        config: &Config,
    ) -> (&'a Features, &'a Features, &'a [Correspondence]) {
        self.matches(map, config);
        let own = self
            .features
            .get_or_insert_with(|| describe(&self.surface, config));
        let matches = self.correspondences.as_ref().map_or(&[][..], |(_, m)| m);
        (map.describe(config), own, matches)
    }
}

/// What was made for the last few voxel sizes.
#[derive(Debug)]
struct Recent<T> {
    most: usize,
    /// The one last asked for at the end.
    held: Vec<(f64, T)>,
}

impl<T> Recent<T> {
    fn new(most: usize) -> Self {
        Self {
            most,
            held: Vec::new(),
        }
    }

    fn clear(&mut self) {
        self.held.clear();
    }

    fn at(&mut self, voxel: f64, make: impl FnOnce() -> T) -> &mut T {
        let known = self
            .held
            .iter()
            .position(|(v, _)| v.to_bits() == voxel.to_bits());
        let entry = known.map(|i| self.held.remove(i)).unwrap_or_else(|| {
            // Before the new one is made, so that no more than `most` are ever there.
            if self.held.len() >= self.most {
                self.held.remove(0);
            }
            (voxel, make())
        });
        self.held.push(entry);
        let last = self.held.len() - 1;
        &mut self.held[last].1
    }
}

#[cfg(test)]
mod tests;
