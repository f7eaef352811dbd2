//! Seconds of each stage on the points of a file of raw little-endian f64 triples, as a program in Rust calls them.
//!
//! The other half of `bench/python_overhead.py`, which makes the file, runs this and holds Python's calls against it.
//!
//! ```sh
//! cargo run --release --example bench_calls -- MAP.f64 QUERY.f64 THREADS
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

use std::hint::black_box;
use std::time::Instant;

use winze::features::Features;
use winze::kdtree::KdTree;
use winze::{Cloud, Config, Pose};
use winze::{fpfh, icp, iss, locate, matching, metrics, ndt, prepare, ransac, voxel};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// The voxel size that lengths count in, metres: about the spacing of the points.
const VOXEL: f64 = 0.05;
/// The voxel size of what is registered.
const COARSE: f64 = 0.3;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [map, query, threads] = args.as_slice() else {
        return Err("usage: bench_calls MAP.f64 QUERY.f64 THREADS".into());
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads.parse()?)
        .build()?;
    let (map, query) = (read(map)?, read(query)?);
    pool.install(|| run(&map, &query))
}

fn read(path: &str) -> Result<Vec<[f64; 3]>> {
    let bytes = std::fs::read(path)?;
    let numbers: Vec<f64> = bytes
        .as_chunks::<8>()
        .0
        .iter()
        .map(|b| f64::from_le_bytes(*b))
        .collect();
    Ok(numbers.as_chunks::<3>().0.to_vec())
}

/// Does something and prints how long it took.
fn timed<T>(name: &str, work: impl FnOnce() -> T) -> T {
    let begun = Instant::now();
    let done = black_box(work());
    println!("{name}\t{}", begun.elapsed().as_secs_f64());
    done
}

fn run(points: &[[f64; 3]], query_points: &[[f64; 3]]) -> Result<()> {
    let config = Config::default();
    // Each from the points as they lie in memory, as a call from Python has them.
    let cloud = |p: &[[f64; 3]]| Cloud::from_points(black_box(p)).map(|(cloud, _)| cloud);
    let map = timed("Cloud", || cloud(points))?;
    let thinned = timed("voxel_downsample", || -> Result<Vec<[f64; 3]>> {
        let thin = voxel::downsample(&cloud(points)?, VOXEL);
        Ok(thin.iter().collect())
    })?;
    timed("remove_outliers", || -> Result<Vec<u32>> {
        Ok(prepare::confirmed(&cloud(points)?, &config.prepare, VOXEL))
    })?;
    let normals = timed("estimate_normals", || -> Result<_> {
        let own = cloud(points)?;
        Ok(prepare::normals(&own, &config.prepare, VOXEL, None))
    })?;
    let keypoints = timed("iss_keypoints", || -> Result<_> {
        let own = cloud(points)?;
        let tree = KdTree::build(own.points());
        Ok(iss::keypoints(own.points(), &tree, &config.iss, VOXEL))
    })?;
    timed("fpfh", || -> Result<_> {
        let own = cloud(points)?;
        let tree = KdTree::build(own.points());
        let at = &keypoints.indices;
        Ok(fpfh::descriptors(
            own.points(),
            &normals,
            &tree,
            at,
            &config.fpfh,
            VOXEL,
        ))
    })?;
    let query = cloud(query_points)?;
    let surface = timed("prepare", || -> Result<_> {
        Ok(prepare::prepare(&cloud(points)?, &config.prepare, COARSE))
    })?;
    let query_surface = prepare::prepare(&query, &config.prepare, COARSE);
    let describe = |s: &prepare::Surface<'_>| {
        let found = iss::keypoints(&s.points, &s.tree, &config.iss, COARSE);
        let at: Vec<[f32; 3]> = found
            .indices
            .iter()
            .map(|&i| s.points[i as usize])
            .collect();
        let of = &config.fpfh;
        let d = fpfh::descriptors(&s.points, &s.normals, &s.tree, &found.indices, of, COARSE);
        (at, d)
    };
    let ((map_at, map_descriptors), (query_at, query_descriptors)) =
        (describe(&surface), describe(&query_surface));
    let pairs = timed("match_features", || {
        matching::match_descriptors(&query_descriptors, &map_descriptors, &config.matching)
    });
    let features = |origin: [f64; 3], at: &[[f32; 3]]| Features {
        origin,
        points: at.to_vec().into(),
        ..Features::default()
    };
    timed("ransac", || {
        let (map, query) = (
            features(surface.origin, &map_at),
            features(query_surface.origin, &query_at),
        );
        let seed = config.seed;
        ransac::estimate(&pairs, &query, &map, &config.ransac, COARSE, seed, &|_| {
            true
        })
    });
    let start = Pose::from_translation([0.1, -0.1, 0.05]);
    timed("ndt", || {
        let levels = ndt::levels(&surface, &config.ndt);
        ndt::align(&levels, &surface, &query_surface, &start, &config.ndt)
    });
    timed("icp", || {
        icp::align(&surface, &query_surface, &start, &config.icp)
    });
    timed("inliers", || -> Result<_> {
        let (map, query) = (cloud(points)?, cloud(query_points)?);
        let tree = KdTree::build(map.points());
        Ok(metrics::inliers(&tree, map.origin(), &query, &start, 0.5))
    })?;
    timed("locate", || -> Result<_> {
        Ok(locate(&cloud(points)?, &cloud(query_points)?, &config)?)
    })?;
    black_box((thinned, map));
    Ok(())
}
