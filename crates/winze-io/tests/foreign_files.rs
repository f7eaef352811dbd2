//! Files written by other software, see `fixtures/README.md`.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::Path;

use winze_io::{CloudFile, Format, NoReturns, ReadOptions, read_cloud};

fn read(name: &str) -> CloudFile {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let options = ReadOptions {
        no_returns: NoReturns::Keep,
        ..ReadOptions::default()
    };
    let file = read_cloud(&folder.join(name), &options).unwrap();
    assert!(
        file.report.warnings.is_empty(),
        "{name}: {:?}",
        file.report.warnings
    );
    file
}

/// Checks each point against a formula.
fn assert_points(file: &CloudFile, count: usize, expected: impl Fn(f64) -> [f64; 3]) {
    assert_eq!(file.report.points_in_file, count);
    assert_eq!(file.cloud.len(), count);
    for (i, point) in file.cloud.iter().enumerate() {
        for (a, b) in point.into_iter().zip(expected(i as f64)) {
            assert!((a - b).abs() < 1e-6, "point {i}: {a} is not {b}");
        }
    }
}

fn assert_counting_intensity(file: &CloudFile) {
    let intensity = file.cloud.intensity().unwrap();
    assert!(intensity.iter().enumerate().all(|(i, &v)| v == i as f32));
}

#[test]
fn pcd_of_the_point_cloud_library() {
    for (name, encoding) in [
        ("pcl_ascii.pcd", "ascii"),
        ("pcl_binary.pcd", "binary"),
        ("pcl_compressed.pcd", "binary_compressed"),
        ("pcl_blob.pcd", "binary"),
    ] {
        let file = read(name);
        assert_points(&file, 120, |i| [i / 8.0, i.sin(), -i / 16.0]);
        assert_counting_intensity(&file);
        assert_eq!(file.report.encoding, encoding);
        assert_eq!(file.report.organised, None);
        let blob = name.contains("blob");
        let fields = if blob {
            "x y z _ intensity ring _ time"
        } else {
            "x y z intensity ring time"
        };
        assert_eq!(file.report.fields.join(" "), fields);
        assert_eq!(file.cloud.viewpoint(), blob.then_some([1.0, 2.0, 3.0]));
    }
}

#[test]
fn images_of_the_point_cloud_library() {
    for name in ["pcl_image.pcd", "pcl_image_ascii.pcd"] {
        let CloudFile { cloud, report } = read(name);
        assert_eq!(report.organised, Some((16, 6)));
        assert_eq!(
            (report.points_in_file, report.non_finite, cloud.len()),
            (96, 20, 76)
        );
        assert_eq!(cloud.viewpoint(), Some([0.0; 3]));
        assert_eq!(report.viewpoint, Some([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]));
        let pixels = (0..96u8).filter(|i| i % 5 != 0);
        for (point, i) in cloud.iter().zip(pixels) {
            assert_eq!(point, [f64::from(i % 16), f64::from(i / 16), 10.0]);
        }
    }
}

#[test]
fn files_of_open3d() {
    for (name, format, encoding) in [
        ("open3d_compressed.pcd", Format::Pcd, "binary_compressed"),
        ("open3d_tensor.pcd", Format::Pcd, "binary_compressed"),
        ("open3d_ascii.ply", Format::Ply, "ascii"),
        ("open3d_binary.ply", Format::Ply, "binary_little_endian"),
        ("open3d_tensor.ply", Format::Ply, "binary_little_endian"),
        ("open3d.xyz", Format::Text, "ascii, blank separated"),
        ("open3d.pts", Format::Text, "ascii, blank separated"),
    ] {
        let file = read(name);
        assert_points(&file, 100, |i| [i / 8.0, i.cos(), -i / 4.0]);
        assert_eq!(
            (file.report.format, file.report.encoding.as_str()),
            (format, encoding)
        );
        if name.contains("tensor") {
            assert_counting_intensity(&file);
        } else {
            assert!(file.cloud.intensity().is_none());
        }
    }
}

#[test]
fn ply_of_plyfile_in_both_byte_orders() {
    for (name, encoding) in [
        ("plyfile_big.ply", "binary_big_endian"),
        ("plyfile_little.ply", "binary_little_endian"),
        ("plyfile_ascii.ply", "ascii"),
    ] {
        let file = read(name);
        assert_points(&file, 50, |i| [i / 8.0, -i, 1e6 + i / 1024.0]);
        assert_counting_intensity(&file);
        assert_eq!(file.report.encoding, encoding);
        assert_eq!(file.report.fields.join(" "), "scalar_Intensity z y x label");
    }
    for name in ["plyfile_lists_little.ply", "plyfile_lists_ascii.ply"] {
        assert_points(&read(name), 6, |i| [i, i + 10.0, i + 20.0]);
    }
}
