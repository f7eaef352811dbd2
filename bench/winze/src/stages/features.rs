//! Keypoints, descriptors, matches.

use winze::fpfh::{self, Descriptor};
use winze::iss;
use winze::kdtree::KdTree;
use winze::matching::match_descriptors;

use super::Done;
use crate::inputs::Inputs;
use crate::measure::Bench;
use crate::settings;

pub(super) fn iss(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let points: Vec<[f32; 3]> = inputs.rows("map_thin.f32")?;
    let config = settings::iss();
    let found = bench.run(|| {
        let tree = KdTree::build(&points);
        Ok(iss::keypoints(&points, &tree, &config, inputs.voxel))
    })?;
    Ok(Done::numbers(&found.indices))
}

/// What `iss` finds with the scatter about the mean, for those who take it so to be held against.
pub(crate) fn iss_about_mean(inputs: &Inputs) -> anyhow::Result<Done> {
    let points: Vec<[f32; 3]> = inputs.rows("map_thin.f32")?;
    let tree = KdTree::build(&points);
    let found = iss::keypoints(&points, &tree, &settings::iss_about_mean(), inputs.voxel);
    Ok(Done::numbers(&found.indices))
}

pub(super) fn fpfh_all(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let count = inputs.rows::<f32, 3>("map_thin.f32")?.len();
    fpfh(inputs, bench, (0u32..).take(count).collect())
}

pub(super) fn fpfh_keypoints(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    fpfh(inputs, bench, inputs.indices("map_keypoints.u32")?)
}

fn fpfh(inputs: &Inputs, bench: &mut Bench, at: Vec<u32>) -> anyhow::Result<Done> {
    let points: Vec<[f32; 3]> = inputs.rows("map_thin.f32")?;
    let normals: Vec<[f32; 3]> = inputs.rows("map_normals.f32")?;
    let config = settings::fpfh();
    let found = bench.run(|| {
        let tree = KdTree::build(&points);
        Ok(fpfh::descriptors(
            &points,
            &normals,
            &tree,
            &at,
            &config,
            inputs.voxel,
        ))
    })?;
    Ok(Done::rows(&found).noted("PCL's variant"))
}

pub(super) fn matching(inputs: &Inputs, bench: &mut Bench, mutual: bool) -> anyhow::Result<Done> {
    let query: Vec<Descriptor> = inputs.rows("query_fpfh.f32")?;
    let map: Vec<Descriptor> = inputs.rows("map_fpfh.f32")?;
    let config = settings::matching(mutual);
    let pairs = bench.run(|| Ok(match_descriptors(&query, &map, &config)))?;
    let pairs: Vec<[u32; 2]> = pairs.iter().map(|c| [c.query, c.map]).collect();
    Ok(Done::rows(&pairs))
}
