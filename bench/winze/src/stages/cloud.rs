//! Reading, thinning, cleaning, normals.

use winze::kdtree::KdTree;
use winze::normals::{self, Neighbourhood};
use winze::{prepare, voxel};
use winze_io::{NoReturns, ReadOptions, read_cloud};

use super::Done;
use crate::inputs::Inputs;
use crate::measure::Bench;
use crate::settings;

pub(super) fn read(inputs: &Inputs, bench: &mut Bench, name: &str) -> anyhow::Result<Done> {
    let path = inputs.path(name);
    // The others neither hash the file nor look for beams that came back from nothing.
    let options = ReadOptions {
        no_returns: NoReturns::Keep,
        digest: false,
    };
    let cloud = bench.run(|| Ok(read_cloud(&path, &options)?.cloud))?;
    let mean = cloud.centroid().unwrap_or_default();
    let done = Done {
        count: cloud.len(),
        ..Done::numbers(&mean)
    };
    Ok(done.noted("with intensities, without the digest"))
}

pub(super) fn voxel(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let cloud = inputs.cloud("map.f32")?;
    let thin = bench.run(|| Ok(voxel::downsample(&cloud, inputs.voxel)))?;
    Ok(Done::rows(thin.points()))
}

pub(super) fn outliers(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let cloud = inputs.cloud("map_thin.f32")?;
    let config = settings::prepare();
    let kept = bench.run(|| Ok(prepare::confirmed(&cloud, &config, inputs.voxel)))?;
    Ok(Done::numbers(&kept))
}

pub(super) fn normals_knn(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    normals(inputs, bench, settings::nearest_normal())
}

pub(super) fn normals_radius(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    normals(inputs, bench, settings::radius_normal(inputs.voxel))
}

fn normals(inputs: &Inputs, bench: &mut Bench, around: Neighbourhood) -> anyhow::Result<Done> {
    let points: Vec<[f32; 3]> = inputs.rows("map_thin.f32")?;
    let normals = bench.run(|| Ok(normals::estimate(&points, &KdTree::build(&points), around)))?;
    Ok(Done::rows(&normals))
}
