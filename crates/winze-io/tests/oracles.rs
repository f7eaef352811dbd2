//! Other readers and writers of the same formats agree with ours.

#![allow(clippy::unwrap_used, clippy::panic)]

use pcd_rs::{
    DataKind, DynReader, DynRecord, DynWriter, Field, Schema, ValueKind, ViewPoint, WriterInit,
};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, Property};
use winze::Cloud;
use winze_io::{
    Encoding, Format, NoReturns, ReadOptions, WriteOptions, read_cloud, read_cloud_bytes,
    write_cloud_bytes,
};

const KEEP: ReadOptions = ReadOptions {
    no_returns: NoReturns::Keep,
    digest: false,
};

/// Points that compress a little, at the origin or far from it.
fn cloud(origin: [f64; 3]) -> Cloud {
    let points: Vec<[f64; 3]> = (0..5000)
        .map(|i| {
            let t = f64::from(i);
            [
                origin[0] + (t * 0.01).floor(),
                origin[1] + t.sin() * 30.0,
                origin[2] + 0.25,
            ]
        })
        .collect();
    let intensity: Vec<f32> = (0..5000u16).map(|i| f32::from(i % 255)).collect();
    Cloud::with_intensity(&points, Some(&intensity)).unwrap().0
}

fn write(cloud: &Cloud, format: Format, encoding: Encoding) -> Vec<u8> {
    let options = WriteOptions {
        encoding: Some(encoding),
    };
    write_cloud_bytes(cloud, format, &options).unwrap()
}

fn f64s(record: &DynRecord) -> Vec<f64> {
    let number = |field: &Field| match field {
        Field::F32(v) => f64::from(v[0]),
        Field::F64(v) => v[0],
        other => panic!("{other:?}"),
    };
    record.0.iter().map(number).collect()
}

#[test]
fn pcd_rs_reads_our_pcd() {
    for origin in [[0.0; 3], [500_000.0, 4_500_000.0, 300.0]] {
        let cloud = cloud(origin);
        for encoding in [Encoding::Ascii, Encoding::Binary, Encoding::Compressed] {
            let bytes = write(&cloud, Format::Pcd, encoding);
            let reader = DynReader::from_bytes(&bytes).unwrap();
            let records: Vec<DynRecord> = reader.collect::<Result<_, _>>().unwrap();
            assert_eq!(records.len(), cloud.len());
            let intensity = cloud.intensity().unwrap();
            for ((record, point), &i) in records.iter().zip(cloud.iter()).zip(intensity) {
                let [x, y, z, value] = f64s(record)[..] else {
                    panic!()
                };
                assert_eq!(value, f64::from(i));
                for (a, b) in [x, y, z].into_iter().zip(point) {
                    assert!((a - b).abs() < 1e-4, "{encoding}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn we_read_the_pcd_of_pcd_rs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pcd");
    for data_kind in [
        DataKind::Ascii,
        DataKind::Binary,
        DataKind::BinaryCompressed,
    ] {
        let schema = [
            ("t", ValueKind::F64, 2),
            ("z", ValueKind::I16, 1),
            ("x", ValueKind::F64, 1),
            ("y", ValueKind::F32, 1),
            ("intensity", ValueKind::U8, 1),
        ];
        let init = WriterInit {
            width: 1000,
            height: 1,
            viewpoint: ViewPoint::default(),
            data_kind,
            schema: Some(Schema::from_iter(schema)),
            version: None,
        };
        let mut writer: DynWriter<_> = init.create(&path).unwrap();
        for i in 0..1000u16 {
            let t = f64::from(i);
            let record = DynRecord(vec![
                Field::F64(vec![t, -t]),
                Field::I16(vec![-(i as i16)]),
                Field::F64(vec![500_000.0 + t / 1000.0]),
                Field::F32(vec![f32::from(i) * 0.5]),
                Field::U8(vec![(i % 256) as u8]),
            ]);
            writer.push(&record).unwrap();
        }
        writer.finish().unwrap();
        let file = read_cloud(&path, &KEEP).unwrap();
        assert_eq!(file.cloud.len(), 1000);
        for (i, point) in file.cloud.iter().enumerate() {
            let t = i as f64;
            assert!(
                (point[0] - 500_000.0 - t / 1000.0).abs() < 1e-4,
                "{data_kind:?} {point:?}"
            );
            assert_eq!([point[1], point[2]], [t * 0.5, -t]);
        }
        let intensity = file.cloud.intensity().unwrap();
        assert!(
            intensity
                .iter()
                .enumerate()
                .all(|(i, &v)| v == (i % 256) as f32)
        );
    }
}

#[test]
fn ply_rs_reads_our_ply() {
    for origin in [[0.0; 3], [500_000.0, 4_500_000.0, 300.0]] {
        let cloud = cloud(origin);
        for encoding in [Encoding::Ascii, Encoding::Binary] {
            let bytes = write(&cloud, Format::Ply, encoding);
            let ply = Parser::<DefaultElement>::new()
                .read_ply(&mut &bytes[..])
                .unwrap();
            let vertices = &ply.payload["vertex"];
            assert_eq!(vertices.len(), cloud.len());
            let number = |vertex: &DefaultElement, name: &str| match vertex.get(name) {
                Some(Property::Float(v)) => f64::from(*v),
                Some(Property::Double(v)) => *v,
                other => panic!("{other:?}"),
            };
            let intensity = cloud.intensity().unwrap();
            for ((vertex, point), &i) in vertices.iter().zip(cloud.iter()).zip(intensity) {
                assert_eq!(number(vertex, "intensity"), f64::from(i));
                for (name, expected) in ["x", "y", "z"].into_iter().zip(point) {
                    let got = number(vertex, name);
                    assert!(
                        (got - expected).abs() < 1e-4,
                        "{encoding}: {got} {expected}"
                    );
                }
            }
        }
    }
}

/// Both readers on the same bytes, some of them broken: wherever the other one gets points, ours
/// gets the same.
#[test]
fn ply_rs_and_we_agree_on_mangled_files() {
    let head = "ply\nformat binary_big_endian 1.0\nelement a 2\nproperty list uchar short l\nelement vertex 3\nproperty float x\nproperty list uchar char l\nproperty double y\nproperty int z\nend_header\n";
    let mut bytes = head.as_bytes().to_vec();
    bytes.extend([1, 0, 9, 0]);
    for i in 0..3u8 {
        bytes.extend(f32::from(i).to_be_bytes());
        bytes.extend([1, i]);
        bytes.extend(f64::from(i).to_be_bytes());
        bytes.extend(i32::from(i).to_be_bytes());
    }
    let mut agreed = 0;
    for at in 0..bytes.len() {
        for value in [0, 1, 2, 0x80, 0xFF, b'4', b'\n'] {
            let mut mangled = bytes.clone();
            mangled[at] = value;
            let theirs = Parser::<DefaultElement>::new().read_ply(&mut &mangled[..]);
            let Some(vertices) = theirs.ok().and_then(|p| p.payload.get("vertex").cloned()) else {
                continue;
            };
            if vertices
                .iter()
                .any(|v| ["x", "y", "z"].iter().any(|n| v.get(*n).is_none()))
            {
                continue;
            }
            match read_cloud_bytes(&mangled, Format::Ply, &KEEP) {
                Ok(file) => assert_eq!(file.report.points_in_file, vertices.len()),
                // Points too far apart, which only a cloud minds.
                Err(winze_io::Error::Rejected { .. }) => {}
                Err(error) => panic!("byte {at} as {value}: {error}"),
            }
            agreed += 1;
        }
    }
    assert!(agreed > 300, "{agreed}");
}
