//! Maps built of clouds: the same answers as the clouds give, the same bytes however they are built.

#![allow(clippy::unwrap_used, reason = "a test")]

use std::path::{Path, PathBuf};

use winze::rng::Rng;
use winze::{
    Cloud, Config, KeptMap, KeptQuery, Method, Outcome, Pose, PreparedMap as _, Request, locate_in,
};
use winze_io::{ReadOptions, WriteOptions, read_cloud, write_cloud};
use winze_map::{BuildOptions, Error, Map, build};

/// A rough drift along x, 4 m wide.
fn drift(points: usize, length: f64, seed: u64, moved: impl Fn([f64; 3]) -> [f64; 3]) -> Cloud {
    let mut rng = Rng::new(seed, 0);
    let points: Vec<[f64; 3]> = (0..points)
        .map(|_| {
            let (x, a) = (
                rng.range(0.0, length),
                rng.range(0.0, std::f64::consts::TAU),
            );
            let rough = 0.25 * ((1.3 * x + 2.0 * a.sin()).sin() + (0.41 * x * x).cos() * a.cos());
            let r = 2.0 + rough + 0.005 * rng.normal();
            moved([x, r * a.cos(), 0.8 * r * a.sin()])
        })
        .collect();
    Cloud::from_points(&points).unwrap().0
}

fn put(folder: &Path, name: &str, cloud: &Cloud) -> PathBuf {
    let path = folder.join(name);
    write_cloud(&path, cloud, &WriteOptions::default()).unwrap();
    path
}

fn quick() -> Config {
    let mut config = Config::default();
    config.ransac.max_samples = 4_000;
    config.ransac.min_samples = 2_000;
    config
}

/// Everything but the times and what the metrics are taken against.
fn timeless(mut outcome: Outcome) -> String {
    (outcome.seconds, outcome.map_seconds) = (0.0, 0.0);
    (outcome.inlier_fraction, outcome.inlier_rmse) = (None, None);
    outcome.inlier_reference = "";
    outcome.stages.clear();
    format!("{outcome:?}")
}

#[test]
fn a_built_map_answers_as_its_cloud_does_by_every_method() {
    let folder = tempfile::tempdir().unwrap();
    let far = |p: [f64; 3]| [p[0] + 431_000.5, p[1] + 4_499_980.25, p[2] - 312.0];
    let path = put(folder.path(), "map.pcd", &drift(30_000, 20.0, 1, far));
    let query_from_map = Pose::from_rotation_vector([0.1, -0.2, 2.0], [40.0, -7.0, 3.0]);
    let query = drift(12_000, 20.0, 2, |p| query_from_map.transform(p));
    let truth = Pose::from_translation(far([0.0; 3])).compose(&query_from_map.inverse());
    let out = folder.path().join("map.wmap");
    let config = quick();
    build(
        std::slice::from_ref(&path),
        &out,
        &config,
        &BuildOptions::default(),
    )
    .unwrap();
    let map = Map::open(&out).unwrap();
    map.check(&mut |_, _| {}).unwrap();
    let cloud = read_cloud(&path, &ReadOptions::default()).unwrap().cloud;
    let near = winze::locate::Near {
        centre: far([10.0, 0.0, 0.0]),
        radius: 9.0,
    };
    for method in Method::ALL {
        for near in [None, Some(near)] {
            let request = Request {
                method,
                near,
                initial: (!method.uses_features()).then_some(truth),
                ..Request::default()
            };
            let mut of_cloud = KeptMap::new(&cloud);
            let mut of_map = KeptMap::prepared(&map);
            let mut kept = KeptQuery::new(&query);
            let from_cloud = locate_in(&mut of_cloud, &mut kept, &config, &request).unwrap();
            let from_map = locate_in(&mut of_map, &mut kept, &config, &request).unwrap();
            assert_eq!(from_cloud.inlier_reference, "map as read");
            assert_eq!(from_map.inlier_reference, "finest level of the built map");
            let error = from_cloud.error(&truth, &query).unwrap();
            assert!(error.translation < 0.3, "{method}: {error:?}");
            assert_eq!(timeless(from_cloud), timeless(from_map), "{method}");
            let mut measured = KeptMap::prepared(&map).measured_against(&cloud);
            let measured = locate_in(&mut measured, &mut kept, &config, &request).unwrap();
            assert_eq!(measured.inlier_reference, "map as read");
        }
    }
}

#[test]
fn neither_threads_nor_memory_nor_the_split_into_files_change_what_is_prepared() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = drift(60_000, 30.0, 3, |p| p);
    let whole = put(folder.path(), "map.pcd", &cloud);
    let built = |threads: usize, memory: u64, clouds: &[PathBuf]| -> Vec<u8> {
        let out = folder.path().join("out.wmap");
        let options = BuildOptions {
            memory,
            replace: true,
            ..BuildOptions::default()
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| build(clouds, &out, &quick(), &options))
            .unwrap();
        std::fs::read(&out).unwrap()
    };
    let one = built(1, 1 << 30, std::slice::from_ref(&whole));
    for (threads, memory) in [(2, 1 << 30), (8, 1 << 30), (2, 1), (3, 5 << 20)] {
        let other = built(threads, memory, std::slice::from_ref(&whole));
        assert!(one == other, "{threads} threads, {memory} bytes");
    }
    // In two files, only what is told of the sources differs.
    let part = |name: &str, range: std::ops::Range<u32>| {
        let part = cloud.select(&range.collect::<Vec<_>>());
        put(folder.path(), name, &part)
    };
    let parts = [part("a.pcd", 0..23_456), part("b.ply", 23_456..60_000)];
    let (one, two) = (
        Map::from_bytes("one", &one).unwrap(),
        Map::from_bytes("two", &built(2, 1 << 30, &parts)).unwrap(),
    );
    assert_eq!(two.meta().sources.len(), 2);
    assert_eq!(one.meta().levels, two.meta().levels);
    for level in 0..one.meta().levels.len() {
        assert_eq!(one.surface(level).unwrap(), two.surface(level).unwrap());
        assert_eq!(one.features(level).unwrap(), two.features(level).unwrap());
        assert_eq!(one.cells(level).unwrap(), two.cells(level).unwrap());
    }
}

#[test]
fn a_map_keeps_the_settings_that_shaped_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = put(folder.path(), "map.pcd", &drift(20_000, 15.0, 4, |p| p));
    let out = folder.path().join("map.wmap");
    let mut config = quick();
    config.fpfh.radius = winze::config::Length::Voxels(5.0);
    config.scale.voxel = 0.25;
    build(&[path], &out, &config, &BuildOptions::default()).unwrap();
    let map = Map::open(&out).unwrap();
    assert_eq!(map.meta().levels.len(), 1);
    let query = drift(9_000, 15.0, 5, |p| p);
    let ask = |config: &Config| {
        let mut kept = KeptMap::prepared(&map);
        let mut query = KeptQuery::new(&query);
        locate_in(&mut kept, &mut query, config, &Request::default())
    };
    let told = ask(&quick()).unwrap_err().to_string();
    assert!(told.contains("the map was built with"), "{told}");
    let adopted = map.adopt(&quick()).unwrap();
    assert_eq!(adopted, config);
    ask(&adopted).unwrap();
}

#[test]
fn what_cannot_be_built_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let config = quick();
    let out = folder.path().join("map.wmap");
    let options = BuildOptions::default();
    let try_build = |cloud: &Cloud, config: &Config| {
        let path = put(folder.path(), "map.pcd", cloud);
        build(&[path], &out, config, &options).unwrap_err()
    };
    let wall = |n: i32, step: f64| {
        let points: Vec<[f64; 3]> = (0..n * n)
            .map(|i| [f64::from(i % n) * step, f64::from(i / n) * step, 0.0])
            .collect();
        Cloud::from_points(&points).unwrap().0
    };
    let few = try_build(&drift(50, 5.0, 1, |p| p), &config);
    assert!(matches!(few, Error::TooFew { points: 50, .. }), "{few}");
    let none = try_build(&Cloud::default(), &config);
    assert!(matches!(none, Error::TooFew { points: 0, .. }), "{none}");
    let same = try_build(&Cloud::from_points(&[[1.0; 3]; 500]).unwrap().0, &config);
    assert!(matches!(same, Error::TooFew { points: 1, .. }), "{same}");
    let mut coarse = quick();
    coarse.scale.voxel = 0.1;
    coarse.fpfh.radius = winze::config::Length::Metres(3.0);
    let small = try_build(&wall(30, 0.05), &coarse);
    assert!(matches!(small, Error::TooSmall { .. }), "{small}");
    let mut first = quick();
    first.prepare.denoise_first = true;
    let denoised = try_build(&drift(9_000, 9.0, 1, |p| p), &first).to_string();
    assert!(
        denoised.contains("prepare.denoise_first = true"),
        "{denoised}"
    );
    assert!(!out.exists());
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
    std::fs::write(&out, "mine").unwrap();
    let there = try_build(&drift(9_000, 9.0, 1, |p| p), &config);
    assert!(matches!(there, Error::Exists { .. }), "{there}");
    assert_eq!(std::fs::read(&out).unwrap(), b"mine");
}
