//! Real clouds, from the folder in the environment variable `WINZE_DATA`, by default
//! `../shared/data`, both from the project's root. Where there is none these tests are ignored.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use winze_io::{
    CloudFile, Encoding, ReadOptions, WriteOptions, read_cloud, read_cloud_bytes, read_transform,
    write_cloud_bytes,
};

fn path(name: &str) -> PathBuf {
    let named = std::env::var_os("WINZE_DATA");
    folder(named.as_deref().unwrap_or("../shared/data".as_ref())).join(name)
}

/// A folder, by its place from the project's root or from that of the file system.
fn folder(from_root: &OsStr) -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .join(from_root);
    folder
        .canonicalize()
        .unwrap_or_else(|e| panic!("WINZE_DATA: {}: {e}", folder.display()))
}

#[test]
fn a_relative_folder_is_taken_from_the_root() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    for named in ["crates/winze-io".as_ref(), here.as_os_str()] {
        assert_eq!(folder(named), here.canonicalize().unwrap());
    }
}

fn read(name: &str) -> CloudFile {
    let file = read_cloud(&path(name), &ReadOptions::default()).unwrap();
    let report = &file.report;
    assert_eq!(
        report.points_in_file,
        file.cloud.len() + report.non_finite + report.no_returns + report.far,
        "{name}"
    );
    assert_eq!(report.bytes, std::fs::metadata(path(name)).unwrap().len());
    file
}

/// Width, depth and height that hold all but the outermost thousandth of the points.
fn size(file: &CloudFile) -> [f64; 3] {
    let (low, high) = file.cloud.bounds(0.001).unwrap();
    std::array::from_fn(|a| high[a] - low[a])
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn mine_scans() {
    for (name, points, encoding, intensity) in [
        (
            "jinchuan/map_2025-05-13.pcd",
            239_171,
            "binary_compressed",
            true,
        ),
        ("jinchuan/query_2025-04-21.pcd", 176_758, "binary", false),
        ("gazebo_tunnel/slam_map.pcd", 121_064, "binary", true),
        ("pairs/room_scan1.pcd", 112_586, "binary_compressed", false),
        ("pairs/room_scan2.pcd", 112_624, "binary_compressed", false),
    ] {
        let file = read(name);
        assert_eq!(file.report.points_in_file, points, "{name}");
        assert_eq!(file.cloud.len(), points, "{name}");
        assert_eq!(file.report.encoding, encoding);
        assert_eq!(file.cloud.intensity().is_some(), intensity);
        assert_eq!(file.cloud.viewpoint(), None);
        assert!(
            file.report.warnings.is_empty(),
            "{name}: {:?}",
            file.report.warnings
        );
    }
    let [x, y, z] = size(&read("jinchuan/map_2025-05-13.pcd"));
    assert!(
        (150.0..=222.0).contains(&x) && (30.0..=90.0).contains(&y) && (3.0..=29.0).contains(&z),
        "{x} {y} {z}"
    );
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn scans_with_no_returns() {
    for (name, points) in [
        ("pairs/outdoor_source.ply", 69_792),
        ("pairs/outdoor_target.ply", 69_088),
    ] {
        let CloudFile { cloud, report } = read(name);
        assert_eq!(report.points_in_file, points);
        assert!(
            (5_000..5_200).contains(&report.no_returns),
            "{name}: {}",
            report.no_returns
        );
        assert_eq!(report.encoding, "binary_little_endian");
        assert_eq!(report.fields, ["x", "y", "z", "scalar_intensity"]);
        assert_eq!(cloud.intensity().map(<[f32]>::len), Some(cloud.len()));
        assert!(report.warnings[0].contains("beams without a return"));
    }
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn an_image_of_a_depth_camera() {
    let CloudFile { cloud, report } = read("pairs/capture0001.pcd");
    assert_eq!(report.organised, Some((640, 480)));
    assert_eq!(report.points_in_file, 640 * 480);
    let share = report.non_finite as f64 / report.points_in_file as f64;
    assert!((0.18..0.20).contains(&share), "{share}");
    assert_eq!(report.viewpoint, Some([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]));
    assert_eq!(cloud.viewpoint(), Some([0.0; 3]));
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn vertices_of_meshes() {
    for (name, vertices) in [
        ("gazebo_tunnel/world.ply", 30_922),
        ("worlds/cave_01.ply", 507_062),
        ("worlds/edgar_plan_roofless.ply", 13_770),
        ("worlds/edgar_section_03.ply", 11_914),
        ("worlds/lava_tube.ply", 4_089),
        ("worlds/rough_tunnel_tiles.ply", 84_887),
        ("worlds/tunnel_practice_1.ply", 100_929),
    ] {
        assert_eq!(read(name).cloud.len(), vertices, "{name}");
    }
    let [x, y, z] = size(&read("worlds/cave_01.ply"));
    assert!(
        (550.0..=600.0).contains(&x) && (400.0..=450.0).contains(&y) && (60.0..=84.0).contains(&z),
        "{x} {y} {z}"
    );
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn transforms() {
    for name in [
        "jinchuan/T_map_query.txt",
        "gazebo_tunnel/T_world_map.txt",
        "pairs/outdoor_T_target_source.txt",
        "pairs/room_T_1_2.txt",
    ] {
        read_transform(&path(name)).unwrap();
    }
    let pose = read_transform(&path("jinchuan/T_map_query.txt")).unwrap();
    assert!((pose.to_matrix()[0][3] + 71.063_372_784).abs() < 1e-9);
}

#[test]
#[cfg_attr(not(winze_data), ignore = "needs the clouds of WINZE_DATA")]
fn a_mine_scan_survives_every_format() {
    let file = read("jinchuan/map_2025-05-13.pcd");
    for (format, encoding) in [
        (winze_io::Format::Pcd, Encoding::Ascii),
        (winze_io::Format::Pcd, Encoding::Binary),
        (winze_io::Format::Pcd, Encoding::Compressed),
        (winze_io::Format::Ply, Encoding::Ascii),
        (winze_io::Format::Ply, Encoding::Binary),
        (winze_io::Format::Text, Encoding::Ascii),
    ] {
        let options = WriteOptions {
            encoding: Some(encoding),
        };
        let bytes = write_cloud_bytes(&file.cloud, format, &options).unwrap();
        let back = read_cloud_bytes(&bytes, format, &ReadOptions::default()).unwrap();
        assert_eq!(back.cloud, file.cloud, "{format} {encoding}");
        if encoding == Encoding::Compressed {
            // Within a few per cent of what the Point Cloud Library makes of it.
            let ratio = bytes.len() as f64 / file.report.bytes as f64;
            assert!(ratio < 1.05, "{ratio}");
        }
    }
}
