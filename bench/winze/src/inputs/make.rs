//! From a map and its queries to all arrays that stages are given.

use std::fs;
use std::path::Path;

use serde_json::json;
use winze::kdtree::KdTree;
use winze::rng::Rng;
use winze::{Cloud, Config, Pose};
use winze::{fpfh, iss, matching, prepare, voxel};
use winze_io::{Encoding, WriteOptions, write_cloud};
use winze_map::BuildOptions;

use crate::arrays::{bytes, flat, write};
use crate::settings;

/// Where neighbours are asked for, at most.
const PROBES: usize = 100_000;
/// How far a probe lies off a point of the map along each axis, one standard deviation, metres.
const PROBE_OFF: f64 = 0.1;
/// How many near starts there are.
const STARTS: u64 = 4;
/// How far each lies off the truth: metres, and degrees about the query's centroid.
const START_OFF: (f64, f64) = (0.4, 3.0);
const SEED: u64 = 8;

/// A map with the queries that are asked in it, and where they truly lie (`map_from_query`).
#[derive(Debug, Clone)]
pub(crate) struct Question {
    pub(crate) map: Cloud,
    pub(crate) queries: Vec<(Cloud, Pose)>,
    /// Metres.
    pub(crate) voxel: f64,
    /// Seed of the probes and of the near starts.
    pub(crate) seed: u64,
}

/// A cloud thinned, with all that is worked out about it.
struct Described {
    points: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    keypoints: Vec<u32>,
    fpfh: Vec<fpfh::Descriptor>,
}

/// Writes the map alone, as one file and as an array.
pub(crate) fn write_bare(folder: &Path, question: &Question) -> anyhow::Result<()> {
    fs::create_dir_all(folder)?;
    let encoding = Some(Encoding::Binary);
    let map = &question.map;
    write_cloud(&folder.join("map.pcd"), map, &WriteOptions { encoding })?;
    write(&folder.join("map.f32"), &bytes(map.points()))?;
    let settings = json!({ "voxel": question.voxel }).to_string();
    write(&folder.join("settings.json"), settings.as_bytes())
}

/// Writes every file of `folder`.
pub(crate) fn write_all(folder: &Path, question: &Question) -> anyhow::Result<()> {
    fs::create_dir_all(folder)?;
    let (map, v) = (&question.map, question.voxel);
    for (name, encoding) in [
        ("map.pcd", Encoding::Binary),
        ("map.ascii.pcd", Encoding::Ascii),
        ("map.compressed.pcd", Encoding::Compressed),
        ("map.ply", Encoding::Binary),
    ] {
        let encoding = Some(encoding);
        write_cloud(&folder.join(name), map, &WriteOptions { encoding })?;
    }
    let put = |name: &str, bytes: Vec<u8>| write(&folder.join(name), &bytes);
    put("map.f32", bytes(map.points()))?;
    // Made here, so that the memory of its making is not lying about where queries are asked.
    winze_map::build(
        &[folder.join("map.pcd")],
        &folder.join("map.wmap"),
        &Config::default(),
        &BuildOptions::default(),
    )?;
    for (i, (query, truth)) in question.queries.iter().enumerate() {
        put(&format!("query_{i}.f32"), bytes(query.points()))?;
        put(&format!("truth_{i}.f64"), bytes(&truth.to_matrix()))?;
    }
    let [(query, truth), ..] = &question.queries[..] else {
        anyhow::bail!("there is no query");
    };
    let (map_has, query_has) = (describe(map, v), describe(query, v));
    for (name, has) in [("map", &map_has), ("query", &query_has)] {
        put(&format!("{name}_thin.f32"), bytes(&has.points))?;
        put(&format!("{name}_normals.f32"), bytes(&has.normals))?;
        put(&format!("{name}_keypoints.u32"), flat(&has.keypoints))?;
        put(&format!("{name}_fpfh.f32"), bytes(&has.fpfh))?;
    }
    let matches =
        matching::match_descriptors(&query_has.fpfh, &map_has.fpfh, &settings::matching(false));
    let matches: Vec<[u32; 2]> = matches.iter().map(|c| [c.query, c.map]).collect();
    put("correspondences.u32", bytes(&matches))?;
    put("probes.f32", bytes(&probes(map.points(), question.seed)))?;
    put("truth.f64", bytes(&truth.to_matrix()))?;
    let starts = (0..STARTS).flat_map(|i| near(truth, query, question.seed, i).to_matrix());
    put("start.f64", bytes(&starts.collect::<Vec<[f64; 4]>>()))?;
    let lengths = json!({
        "voxel": v,
        "search_radius": 3.0 * v,
        "normal_radius": 2.5 * v,
        "iss_salient_radius": 6.0 * v,
        "iss_non_max_radius": 4.0 * v,
        "fpfh_radius": 5.0 * v,
        "inlier_distance": 2.0 * v,
        "ndt_cell": 1.0,
        "pair_distance": 1.0,
    });
    put(
        "settings.json",
        (serde_json::to_string_pretty(&lengths)? + "\n").into_bytes(),
    )
}

fn describe(cloud: &Cloud, v: f64) -> Described {
    let thin = voxel::downsample(cloud, v);
    let mut normals = prepare::normals(&thin, &settings::prepare(), v, None);
    // Libraries differ in what they make of a point without a normal; there is none.
    for n in normals.iter_mut().filter(|n| **n == [0.0; 3]) {
        *n = [0.0, 0.0, 1.0];
    }
    let points = thin.into_points();
    let tree = KdTree::build(&points);
    let keypoints = iss::keypoints(&points, &tree, &settings::described(), v).indices;
    let fpfh = fpfh::descriptors(&points, &normals, &tree, &keypoints, &settings::fpfh(), v);
    Described {
        points,
        normals,
        keypoints,
        fpfh,
    }
}

/// Places near random points, in no order.
fn probes(points: &[[f32; 3]], seed: u64) -> Vec<[f32; 3]> {
    let mut rng = Rng::new(SEED + seed, 1);
    #[expect(clippy::cast_possible_truncation, reason = "a cloud's size; metres")]
    let mut probe = |_| {
        let at = points[rng.below(points.len() as u32) as usize];
        at.map(|v| v + (PROBE_OFF * rng.normal()) as f32)
    };
    (0..PROBES.min(points.len())).map(&mut probe).collect()
}

/// The truth a little off, each time in another random direction.
fn near(truth: &Pose, query: &Cloud, seed: u64, time: u64) -> Pose {
    let mut rng = Rng::new(SEED + seed, 2 + time);
    let (metres, degrees) = START_OFF;
    let shift = rng.direction().map(|v| metres * v);
    let turn = rng.direction().map(|v| degrees.to_radians() * v);
    let centroid = query.centroid().unwrap_or_default();
    truth.perturbed(shift, turn, truth.transform(centroid))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::inputs::{Inputs, drift};

    #[test]
    fn the_near_starts_are_as_far_off_as_they_say_and_differ() {
        let (query, _) = Cloud::from_points(&[[5.0, 1.0, 0.0], [7.0, -1.0, 2.0]]).unwrap();
        let truth = Pose::from_rotation_vector([0.3, 0.0, 1.0], [10.0, -4.0, 2.0]);
        let centroid = query.centroid().unwrap();
        let starts: Vec<Pose> = (0..STARTS).map(|i| near(&truth, &query, 3, i)).collect();
        for (i, start) in starts.iter().enumerate() {
            let off = start.distance(&truth, centroid);
            assert!((off.translation - 0.4).abs() < 1e-9, "{off:?}");
            assert!((off.rotation.to_degrees() - 3.0).abs() < 1e-6, "{off:?}");
            for other in &starts[..i] {
                assert!(start.distance(other, centroid).translation > 0.01);
            }
        }
    }

    #[test]
    fn what_is_written_hangs_together() {
        let folder = tempfile::tempdir().unwrap();
        let question = drift::question(20_000).unwrap();
        write_all(folder.path(), &question).unwrap();
        let inputs = Inputs::open(folder.path()).unwrap();
        assert_eq!(
            (inputs.voxel, inputs.queries),
            (question.voxel, question.queries.len())
        );
        assert_eq!(
            inputs.cloud("map.f32").unwrap().points(),
            question.map.points()
        );
        let thin: Vec<[f32; 3]> = inputs.rows("map_thin.f32").unwrap();
        let normals: Vec<[f32; 3]> = inputs.rows("map_normals.f32").unwrap();
        assert_eq!(thin.len(), normals.len());
        let unit = |n: &[f32; 3]| (n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5;
        assert!(normals.iter().all(unit));
        let keypoints = inputs.indices("map_keypoints.u32").unwrap();
        assert!(keypoints.len() > 20 && keypoints.iter().all(|k| (*k as usize) < thin.len()));
        let descriptors: Vec<fpfh::Descriptor> = inputs.rows("map_fpfh.f32").unwrap();
        assert_eq!(descriptors.len(), keypoints.len());
        let query_keypoints = inputs.indices("query_keypoints.u32").unwrap().len();
        let pairs: Vec<[u32; 2]> = inputs.rows("correspondences.u32").unwrap();
        assert!(pairs.len() == query_keypoints);
        assert!(
            pairs
                .iter()
                .all(|p| (p[0] as usize) < query_keypoints && (p[1] as usize) < keypoints.len())
        );
        assert_eq!(inputs.rows::<f32, 3>("probes.f32").unwrap().len(), 20_000);
        let options = winze_io::ReadOptions::default();
        for name in ["map.pcd", "map.ascii.pcd", "map.compressed.pcd", "map.ply"] {
            let file = winze_io::read_cloud(&inputs.path(name), &options).unwrap();
            assert_eq!(file.cloud.points(), question.map.points(), "{name}");
            assert!(file.cloud.intensity().is_some(), "{name}");
        }
        assert_eq!(inputs.poses("start.f64").unwrap().len(), 4);
        // But for the last digit: a pose is kept as a quaternion.
        let truth = inputs.pose("truth.f64").unwrap();
        let off = truth.distance(&question.queries[0].1, [1.0, 2.0, 3.0]);
        assert!(off.translation < 1e-12 && off.rotation < 1e-7, "{off:?}");
    }
}
