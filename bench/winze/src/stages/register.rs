//! Poses from correspondences and from near starts, and the chain of all stages.

use std::borrow::Cow;

use anyhow::Context as _;
use winze::config::{IcpConfig, IcpMetric};
use winze::features::{Features, describe, describe_map};
use winze::kdtree::KdTree;
use winze::matching::{Correspondence, match_descriptors};
use winze::prepare::{Surface, prepare};
use winze::refine::Refined;
use winze::{Cloud, Config, Pose};
use winze::{icp, ndt, normals, ransac};

use super::Done;
use crate::inputs::Inputs;
use crate::measure::Bench;
use crate::settings;

pub(super) fn ransac(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let matched = Matched::of(inputs)?;
    let found = bench.run(|| Ok(matched.estimate(inputs.voxel)))?;
    let best = found.hypotheses.first().map(|h| h.map_from_query);
    Ok(Done::poses(&[best.unwrap_or_else(Pose::identity)], 0))
}

/// What RANSAC is given.
pub(crate) struct Matched {
    pub(crate) pairs: Vec<Correspondence>,
    query: Features<'static>,
    map: Features<'static>,
}

impl Matched {
    pub(crate) fn of(inputs: &Inputs) -> anyhow::Result<Self> {
        let at_keypoints = |points: &str, keypoints: &str| -> anyhow::Result<Features<'static>> {
            let points: Vec<[f32; 3]> = inputs.rows(points)?;
            let at = inputs
                .indices(keypoints)?
                .into_iter()
                .map(|i| points[i as usize]);
            Ok(Features {
                points: at.collect(),
                ..Features::default()
            })
        };
        let pairs = inputs.rows("correspondences.u32")?;
        let pair = |[query, map]: [u32; 2]| Correspondence {
            query,
            map,
            distance: 0.0,
        };
        Ok(Self {
            map: at_keypoints("map_thin.f32", "map_keypoints.u32")?,
            query: at_keypoints("query_thin.f32", "query_keypoints.u32")?,
            pairs: pairs.into_iter().map(pair).collect(),
        })
    }

    pub(crate) fn estimate(&self, voxel: f64) -> ransac::Estimate {
        ransac::estimate(
            &self.pairs,
            &self.query,
            &self.map,
            &settings::ransac(),
            voxel,
            settings::SEED,
            &|_| true,
        )
    }
}

/// The arrays of a prepared cloud, all but its tree.
pub(crate) struct Arrays {
    voxel: f64,
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
}

impl Arrays {
    pub(crate) fn of(inputs: &Inputs, what: &str) -> anyhow::Result<Self> {
        Ok(Self {
            voxel: inputs.voxel,
            points: inputs.rows(&format!("{what}_thin.f32"))?,
            normals: inputs.rows(&format!("{what}_normals.f32"))?,
        })
    }

    fn with_tree(&self, tree: KdTree<'static>) -> Surface<'_> {
        Surface {
            origin: [0.0; 3],
            voxel: self.voxel,
            points: Cow::Borrowed(&self.points),
            normals: Cow::Borrowed(&self.normals),
            tree,
        }
    }

    /// With the tree that refiners look map points up in.
    pub(crate) fn as_map(&self) -> Surface<'_> {
        self.with_tree(KdTree::build(&self.points))
    }

    /// Nothing is looked up in a query.
    pub(crate) fn as_query(&self) -> Surface<'_> {
        self.with_tree(KdTree::default())
    }
}

/// Refines all near starts, one after the other: what `refine` makes is made anew for each.
fn refined(
    inputs: &Inputs,
    bench: &mut Bench,
    refine: impl Fn(&Pose) -> Refined,
) -> anyhow::Result<Done> {
    let starts = inputs.poses("start.f64")?;
    let one = |start: &Pose| refine(start).map_from_query;
    let poses = bench.run(|| Ok(starts.iter().map(one).collect::<Vec<Pose>>()))?;
    Ok(Done::poses(&poses, 0))
}

pub(super) fn ndt(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (map, query) = (Arrays::of(inputs, "map")?, Arrays::of(inputs, "query")?);
    let config = settings::ndt();
    let done = refined(inputs, bench, |start| {
        let (map, query) = (map.as_map(), query.as_query());
        let levels = ndt::levels(&map, &config);
        ndt::align(&levels, &map, &query, start, &config)
    })?;
    Ok(done.noted("with the map's tree and the pose's information matrix"))
}

pub(super) fn icp_point(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    icp(inputs, bench, &settings::icp(IcpMetric::PointToPoint))
}

pub(super) fn icp_plane(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    icp(inputs, bench, &settings::icp(IcpMetric::PointToPlane))
}

/// With normals, and so covariances, of the nearest points made anew.
pub(super) fn gicp(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (map, query): (Points, Points) =
        (inputs.rows("map_thin.f32")?, inputs.rows("query_thin.f32")?);
    let config = settings::icp(IcpMetric::Generalized);
    let with_covariances = |points: &Points| {
        let tree = KdTree::build(points);
        let normals = normals::estimate(points, &tree, settings::nearest_normal());
        Surface {
            origin: [0.0; 3],
            voxel: inputs.voxel,
            points: Cow::Owned(points.clone()),
            normals: Cow::Owned(normals),
            tree,
        }
    };
    let done = refined(inputs, bench, |start| {
        let (map, query) = (with_covariances(&map), with_covariances(&query));
        icp::align(&map, &query, start, &config)
    })?;
    Ok(done.noted("with the pose's information matrix"))
}

type Points = Vec<[f32; 3]>;

fn icp(inputs: &Inputs, bench: &mut Bench, config: &IcpConfig) -> anyhow::Result<Done> {
    let (map, query) = (Arrays::of(inputs, "map")?, Arrays::of(inputs, "query")?);
    let done = refined(inputs, bench, |start| {
        icp::align(&map.as_map(), &query.as_query(), start, config)
    })?;
    Ok(done.noted("with the pose's information matrix"))
}

pub(super) fn chain(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let (map, query) = (inputs.cloud("map.f32")?, inputs.cloud("query_0.f32")?);
    let config = settings::chain();
    let pose = bench.run(|| chain_of(&map, &query, &config, inputs.voxel))?;
    Ok(Done::poses(&[pose], 0))
}

/// The paper's chain, stage by stage.
fn chain_of(map: &Cloud, query: &Cloud, config: &Config, voxel: f64) -> anyhow::Result<Pose> {
    let map = prepare(map, &config.prepare, voxel);
    let query = prepare(query, &config.prepare, voxel);
    let (map_has, query_has) = (describe_map(&map, config), describe(&query, config));
    let pairs = match_descriptors(
        &query_has.descriptors,
        &map_has.descriptors,
        &config.matching,
    );
    let found = ransac::estimate(
        &pairs,
        &query_has,
        &map_has,
        &config.ransac,
        voxel,
        config.seed,
        &|_| true,
    );
    let start = found
        .hypotheses
        .first()
        .context("RANSAC found no pose")?
        .map_from_query;
    let levels = ndt::levels(&map, &config.ndt);
    let refined = ndt::align(&levels, &map, &query, &start, &config.ndt);
    Ok(icp::align(&map, &query, &refined.map_from_query, &config.icp).map_from_query)
}
