//! What must hold for any bytes that are read as a cloud, a mesh, a prepared map or an incident bundle.

pub mod bundle;
pub mod map;

use winze::Cloud;
use winze_io::{
    CloudFile, Encoding, Format, NoReturns, ReadOptions, WriteOptions, read_cloud_bytes,
    write_cloud_bytes,
};
use winze_sim::mesh_file::{MeshFormat, read_mesh_bytes, to_ply_bytes};

/// Clouds that reach further than this from their origin, metres, are not written and read back: a
/// cloud's limit is 16 384 m, and an origin may move by 1 024 m when coordinates are rounded.
const INNER: f32 = 15_000.0;

/// Reads `bytes`. If they are a cloud, checks what its report says, and that every encoding of
/// `format` gives the same points back.
pub fn check(bytes: &[u8], format: Format) {
    let keep = options(NoReturns::Keep);
    match read_cloud_bytes(bytes, format, &keep) {
        Ok(file) => {
            check_counts(&file);
            assert_eq!(file.report.no_returns, 0);
            round_trips(&file.cloud, format);
        }
        Err(error) => check_message(&error.to_string()),
    }
    for rule in [NoReturns::Auto, NoReturns::Drop] {
        if let Ok(file) = read_cloud_bytes(bytes, format, &options(rule)) {
            check_counts(&file);
        }
    }
}

/// Reads `bytes`. If they are a mesh, checks that it is sound and that it comes back from a file as it was.
pub fn check_mesh(bytes: &[u8], format: MeshFormat) {
    let (mesh, report) = match read_mesh_bytes(bytes, format) {
        Ok(read) => read,
        Err(error) => return check_message(&error.to_string()),
    };
    assert_eq!(mesh.triangles().len(), report.triangles);
    assert_eq!(mesh.part_of().len(), report.triangles);
    assert!(report.triangles > 0 && report.origin.iter().all(|v| v.is_finite()));
    assert!(
        mesh.part_of()
            .iter()
            .all(|p| usize::from(*p) < mesh.parts().len())
    );
    let corners = |mesh: &winze_sim::mesh::Mesh, i| mesh.corners(i).expect("a sound index");
    let (again, second) = read_mesh_bytes(&to_ply_bytes(&mesh), MeshFormat::Ply)
        .expect("what was written can be read");
    assert_eq!(second.triangles, report.triangles);
    assert_eq!(again.part_of(), mesh.part_of());
    assert_eq!(again.parts(), mesh.parts());
    for i in 0..report.triangles {
        let (a, b) = (corners(&mesh, i), corners(&again, i));
        assert!(a.iter().flatten().all(|v| v.is_finite()));
        if second.origin == [0.0; 3] {
            assert_eq!(a, b);
        }
    }
}

fn options(no_returns: NoReturns) -> ReadOptions {
    ReadOptions {
        no_returns,
        digest: false,
    }
}

fn check_message(text: &str) {
    assert!(
        !text.chars().any(char::is_control),
        "not printable: {text:?}"
    );
    assert!(text.len() < 1000, "too long: {text}");
}

fn check_counts(CloudFile { cloud, report }: &CloudFile) {
    assert!(cloud.points().iter().flatten().all(|v| v.is_finite()));
    assert!(cloud.iter().flatten().all(f64::is_finite));
    let dropped = report.non_finite + report.no_returns + report.far;
    assert_eq!(cloud.len() + dropped, report.points_in_file);
    assert!(cloud.intensity().is_none_or(|i| i.len() == cloud.len()));
    assert!(
        cloud
            .viewpoint()
            .is_none_or(|v| v.iter().all(|c| c.is_finite()))
    );
    if let Some((width, height)) = report.organised {
        assert_eq!(width * height, report.points_in_file);
    }
    report
        .warnings
        .iter()
        .chain(&report.fields)
        .for_each(|text| check_message(text));
}

fn round_trips(cloud: &Cloud, format: Format) {
    let encodings: &[Encoding] = match format {
        Format::Pcd => &[Encoding::Ascii, Encoding::Binary, Encoding::Compressed],
        Format::Ply => &[Encoding::Ascii, Encoding::Binary],
        Format::Kitti => &[Encoding::Binary],
        Format::Text => &[Encoding::Ascii],
    };
    let wide = cloud.points().iter().flatten().any(|v| v.abs() > INNER);
    if wide || (format == Format::Text && cloud.is_empty()) {
        return;
    }
    for &encoding in encodings {
        let options = WriteOptions {
            encoding: Some(encoding),
        };
        let bytes = match write_cloud_bytes(cloud, format, &options) {
            Ok(bytes) => bytes,
            // Its floats may be too coarse for what is left of a coordinate far from the origin.
            Err(_) if format == Format::Kitti => continue,
            Err(error) => panic!("a cloud cannot be written: {error}"),
        };
        let back = read_cloud_bytes(&bytes, format, &self::options(NoReturns::Keep))
            .expect("what was written can be read")
            .cloud;
        assert_eq!(back.len(), cloud.len(), "{encoding}");
        assert_eq!(
            back.intensity().is_some(),
            cloud.intensity().is_some(),
            "{encoding}"
        );
        for (a, b) in cloud.iter().flatten().zip(back.iter().flatten()) {
            // Rounded to 0.1 mm on the way, to 1 mm in the cloud itself, to 53 bits beyond that.
            let most = 2e-3 + a.abs() * 1e-15;
            assert!((a - b).abs() <= most, "{encoding}: {a} came back as {b}");
        }
    }
}
