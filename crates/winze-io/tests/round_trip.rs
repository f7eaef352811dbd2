//! What is written reads back the same, in every format and encoding.

#![allow(clippy::unwrap_used, clippy::panic)]

use winze::Cloud;
use winze_io::{
    Encoding, Format, NoReturns, ReadOptions, WriteOptions, read_cloud, read_cloud_bytes,
    write_cloud, write_cloud_bytes,
};

const ALL: [(Format, Encoding); 6] = [
    (Format::Pcd, Encoding::Ascii),
    (Format::Pcd, Encoding::Binary),
    (Format::Pcd, Encoding::Compressed),
    (Format::Ply, Encoding::Ascii),
    (Format::Ply, Encoding::Binary),
    (Format::Text, Encoding::Ascii),
];

const KEEP: ReadOptions = ReadOptions {
    no_returns: NoReturns::Keep,
    digest: false,
};

/// A thousand points about `origin`, some at it, with or without intensities.
fn cloud(origin: [f64; 3], intensity: bool) -> Cloud {
    let points: Vec<[f64; 3]> = (0..1000)
        .map(|i| {
            let t = f64::from(i / 3) * 0.377;
            [
                origin[0] + 40.0 * t.sin(),
                origin[1] + t * 0.1,
                origin[2] + 3.0 * (1.7 * t).cos(),
            ]
        })
        .collect();
    let values: Vec<f32> = (0..1000u16).map(|i| f32::from(i) * 0.1).collect();
    Cloud::with_intensity(&points, intensity.then_some(&values[..]))
        .unwrap()
        .0
}

fn round_trip(cloud: &Cloud, format: Format, encoding: Encoding) -> Cloud {
    let options = WriteOptions {
        encoding: Some(encoding),
    };
    let bytes = write_cloud_bytes(cloud, format, &options).unwrap();
    let file = read_cloud_bytes(&bytes, format, &KEEP).unwrap();
    assert!(
        file.report.warnings.is_empty(),
        "{:?}",
        file.report.warnings
    );
    assert_eq!(file.report.points_in_file, cloud.len());
    assert_eq!(Format::from_content(&bytes), Some(format));
    file.cloud
}

#[test]
fn small_coordinates_come_back_to_the_bit() {
    for (format, encoding) in ALL {
        for intensity in [false, true] {
            let cloud = cloud([0.0; 3], intensity);
            assert_eq!(
                round_trip(&cloud, format, encoding),
                cloud,
                "{format} {encoding}"
            );
        }
    }
}

#[test]
fn kitti_holds_what_fits_and_refuses_the_rest() {
    let write = |cloud: &Cloud| write_cloud_bytes(cloud, Format::Kitti, &WriteOptions::default());
    let near = cloud([0.0; 3], true);
    let bytes = write(&near).unwrap();
    assert_eq!(bytes.len(), 16 * near.len());
    assert_eq!(bytes[16..20], near.points()[1][0].to_le_bytes());
    let back = read_cloud_bytes(&bytes, Format::Kitti, &KEEP).unwrap();
    assert_eq!(back.cloud, near);
    assert_eq!(back.report.fields, ["x", "y", "z", "intensity"]);
    // Without intensities there are zeros, and none at all where there is no point.
    let bare = write(&cloud([0.0; 3], false)).unwrap();
    assert_eq!(bare[12..16], [0; 4]);
    assert!(write(&Cloud::default()).unwrap().is_empty());
    assert!(
        read_cloud_bytes(&[], Format::Kitti, &KEEP)
            .unwrap()
            .cloud
            .is_empty()
    );
    let far = cloud([500_000.0, 4_500_000.0, 300.0], true);
    let error = write(&far).unwrap_err().to_string();
    assert!(
        error.contains("32-bit floats") && error.contains(".pcd"),
        "{error}"
    );
    // What is far and lies on the grid of 32-bit floats is held.
    let (steps, _) = Cloud::from_points(&[[500_000.5, 4_500_000.5, 300.25]; 3]).unwrap();
    let back = read_cloud_bytes(&write(&steps).unwrap(), Format::Kitti, &KEEP).unwrap();
    assert_eq!(back.cloud.points(), steps.points());
}

#[test]
fn utm_coordinates_come_back_to_a_tenth_of_a_millimetre() {
    for (format, encoding) in ALL {
        let cloud = cloud([500_000.0, 4_500_000.0, 300.0], true);
        let back = round_trip(&cloud, format, encoding);
        assert_eq!(back.len(), cloud.len());
        assert_eq!(back.intensity(), cloud.intensity());
        for (a, b) in cloud.iter().flatten().zip(back.iter().flatten()) {
            assert!((a - b).abs() < 1e-4, "{format} {encoding}: {a} {b}");
        }
        if encoding != Encoding::Ascii {
            assert_eq!(back, cloud, "{format} {encoding}");
        }
    }
}

#[test]
fn empty_pcd_and_ply_are_empty_clouds() {
    for (format, encoding) in ALL {
        if format == Format::Text {
            continue;
        }
        for intensity in [None, Some(&[][..])] {
            let (cloud, _) = Cloud::with_intensity(&[], intensity).unwrap();
            assert!(round_trip(&cloud, format, encoding).is_empty());
        }
    }
}

#[test]
fn a_viewpoint_survives_in_pcd() {
    for encoding in [Encoding::Ascii, Encoding::Binary, Encoding::Compressed] {
        let there = Some([431_234.567_891, -2.5, 0.125]);
        let cloud = cloud([431_200.0, 0.0, 0.0], false).seen_from(there);
        assert_eq!(round_trip(&cloud, Format::Pcd, encoding).viewpoint(), there);
    }
}

#[test]
fn files_of_every_extension_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = cloud([0.0; 3], true);
    for name in [
        "a.pcd", "a.ply", "a.bin", "a.xyz", "a.txt", "a.asc", "a.csv", "A.PCD",
    ] {
        let path = folder.path().join(name);
        let written = write_cloud(&path, &cloud, &WriteOptions::default()).unwrap();
        let read = read_cloud(&path, &KEEP).unwrap();
        assert_eq!(read.cloud, cloud, "{name}");
        assert_eq!(read.report.format, written.format);
        assert_eq!(read.report.bytes, written.bytes);
        assert_eq!(read.report.fields, ["x", "y", "z", "intensity"]);
    }
}

#[test]
fn ascii_files_with_utm_coordinates_keep_them() {
    let numbers = "431234.567 4499980.459 312.001\n431235.001 4499981.002 312.999\n";
    let pcd = format!(
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n{numbers}"
    );
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n{numbers}"
    );
    for (format, text) in [
        (Format::Pcd, pcd.as_str()),
        (Format::Ply, &ply),
        (Format::Text, numbers),
    ] {
        let cloud = read_cloud_bytes(text.as_bytes(), format, &KEEP)
            .unwrap()
            .cloud;
        let [a, b] = [cloud.point(0), cloud.point(1)];
        for (got, expected) in a.into_iter().chain(b).zip([
            431_234.567,
            4_499_980.459,
            312.001,
            431_235.001,
            4_499_981.002,
            312.999,
        ]) {
            assert!((got - expected).abs() < 5e-4, "{format}: {got} {expected}");
        }
    }
}
