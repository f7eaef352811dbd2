//! Whatever is in the file: a bundle or an error, never a panic.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test")]

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _, Write as _};

use winze::part::{Count, Look, MapPart, PartLevel, Reference};
use winze::scale::Measure;
use winze::{Config, Pose};
use winze_bundle::{Beforehand, Bundle, Error, MapFile, QueryFile};
use zip::write::SimpleFileOptions;
use zip::{ZipArchive, ZipWriter};

fn bundle() -> Bundle {
    let pose = Pose::from_rotation_vector([0.3, -0.1, 2.0], [4e5 + 0.1, -3.3, 1.0 / 3.0]);
    let points = vec![[1.0f32, -0.0, 0.1], [2.0, 1e-30, 3.0]];
    let mut config = Config {
        seed: 7,
        ..Config::default()
    };
    config.ransac.confidence = 0.1 + 0.2;
    Bundle {
        winze: "0.1.0".into(),
        query: QueryFile {
            path: "folder/My \"query\"\n.PCD".into(),
            bytes: b"any bytes \0\xff".to_vec(),
        },
        config,
        asked: Beforehand {
            method: winze::Method::NdtIcp,
            gravity_aligned: true,
            near: Some(winze::locate::Near {
                centre: [1.0 / 3.0, 2.0, 3.0],
                radius: 4.0,
            }),
            initial: Some(pose),
            truth: Some(pose.inverse()),
        },
        map: MapFile {
            path: "map.pcd".into(),
            digest: "sha256:00".into(),
            points_in_file: 12,
        },
        part: MapPart {
            points: 11,
            built: true,
            measure: Some(Measure {
                spacing: 0.1,
                width: Some(4.0),
                width_range: Some([1.0, 5.0]),
                budget: 0.2,
            }),
            voxels: vec![0.1, 0.2 / 3.0],
            looks: vec![Look {
                voxel: 0.1,
                stages: vec![Count {
                    name: "describe map".into(),
                    count_in: 3,
                    count_out: 2,
                }],
                starts: vec![pose, Pose::identity()],
                gaussians: 5,
            }],
            levels: vec![PartLevel {
                voxel: 0.1,
                origin: [4e5, 4.5e6, -0.0],
                of: 2,
                points: points.clone(),
                normals: vec![[0.0, 0.6, 0.8], [0.0; 3]],
            }],
            reference: Reference {
                origin: [1.0, 2.0, 3.0],
                of: 11,
                points,
            },
        },
        outcome: "{}\n".into(),
    }
}

type Entries = BTreeMap<String, Vec<u8>>;

fn unpacked(bytes: &[u8]) -> Entries {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).unwrap();
    let names: Vec<String> = archive
        .file_names()
        .map(|n| n.unwrap().into_owned())
        .collect();
    let mut read = |name: &str| {
        let mut content = Vec::new();
        archive
            .by_name(name)
            .unwrap()
            .read_to_end(&mut content)
            .unwrap();
        content
    };
    names
        .iter()
        .map(|name| (name.clone(), read(name)))
        .collect()
}

fn packed(entries: &Entries) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in entries {
        writer.start_file(name, SimpleFileOptions::DEFAULT).unwrap();
        writer.write_all(content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// The bundle with one entry changed and its digest set right.
fn with(name: &str, change: impl FnOnce(&mut Vec<u8>)) -> Result<Bundle, Error> {
    let mut entries = unpacked(&bundle().to_bytes().unwrap());
    change(entries.get_mut(name).unwrap());
    if name != "manifest.json" {
        let content = &entries[name];
        let mut manifest: serde_json::Value =
            serde_json::from_slice(&entries["manifest.json"]).unwrap();
        manifest["entries"][name] = serde_json::json!({
            "bytes": content.len(), "digest": winze_io::digest(content),
        });
        let manifest = serde_json::to_vec(&manifest).unwrap();
        entries.insert("manifest.json".into(), manifest);
    }
    Bundle::from_bytes("b.zip", &packed(&entries))
}

/// The same with a text in it replaced.
fn replaced(name: &str, from: &str, to: &str) -> Result<Bundle, Error> {
    with(name, |content| {
        let text = String::from_utf8(content.clone()).unwrap();
        assert!(text.contains(from), "{name} has no {from}: {text}");
        *content = text.replacen(from, to, 1).into_bytes();
    })
}

fn message(read: Result<Bundle, Error>) -> String {
    let text = read.unwrap_err().to_string();
    assert!(!text.chars().any(char::is_control), "{text:?}");
    text
}

#[test]
fn a_bundle_comes_back_to_the_bit_and_is_the_same_file_each_time() {
    let bytes = bundle().to_bytes().unwrap();
    assert_eq!(bytes, bundle().to_bytes().unwrap());
    let back = Bundle::from_bytes("b.zip", &bytes).unwrap();
    // Debug output tells zeros of either sign apart.
    assert_eq!(format!("{back:?}"), format!("{:?}", bundle()));
    assert_eq!(back.to_bytes().unwrap(), bytes);
    let names: Vec<String> = unpacked(&bytes).into_keys().collect();
    let expected = [
        "README.txt",
        "config.toml",
        "manifest.json",
        "map/0/normals.npy",
        "map/0/points.npy",
        "map/part.json",
        "map/reference.npy",
        "outcome.json",
        "query.pcd",
    ];
    assert_eq!(names, expected);
    // An extension that is none stays outside.
    let mut plain = bundle();
    plain.query.path = "a/q.an odd one".into();
    let names = unpacked(&plain.to_bytes().unwrap());
    assert!(names.contains_key("query"));
}

#[test]
fn every_truncation_and_every_flipped_byte_is_an_error_or_the_same_bundle() {
    let bytes = bundle().to_bytes().unwrap();
    for end in 0..bytes.len() {
        message(Bundle::from_bytes("b.zip", &bytes[..end]));
    }
    for at in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 0x41;
        // Times and the like have no meaning.
        match Bundle::from_bytes("b.zip", &flipped) {
            Ok(same) => assert_eq!(same, bundle(), "{at}"),
            error => drop(message(error)),
        }
    }
}

#[test]
fn what_breaks_the_rules_is_named() {
    let part = "map/part.json";
    for (name, from, to, wanted) in [
        (
            "manifest.json",
            "\"format\": 1",
            "\"format\": 2",
            "update winze",
        ),
        (
            "manifest.json",
            "\"format\": 1",
            "\"format\": -1",
            "manifest.json: ",
        ),
        (
            "manifest.json",
            "\"bytes\": 3",
            "\"bytes\": 2",
            "outcome.json: unpacks to more",
        ),
        (
            "manifest.json",
            "\"bytes\": 3",
            "\"bytes\": 99999999999999",
            "more than",
        ),
        ("manifest.json", "ndt+icp", "magic", "manifest.json: "),
        ("manifest.json", "4.0\n", "-4.0\n", "no ball"),
        (
            "manifest.json",
            "\"entry\": \"",
            "\"entry\": \"../",
            "not named after",
        ),
        (
            "manifest.json",
            "\"config.toml\"",
            "\"c\\u001b[2J.toml\"",
            "cannot be shown",
        ),
        (
            "manifest.json",
            "sha256:00",
            "sha\\u001b[2J",
            "cannot be shown",
        ),
        ("manifest.json", "400000.1", "4e50", "too far out"),
        ("config.toml", "seed = 7", "sed = 7", "config.toml: "),
        (
            "config.toml",
            "confidence = 0.3",
            "confidence = 3.3",
            "ransac.confidence",
        ),
        (part, "\"spacing\": 0.1", "\"spacing\": -0.1", "no length"),
        (part, "\"voxel\": 0.1", "\"voxel\": 0.0", "no length"),
        (part, "4500000.0", "4.5e60", "too far out"),
        (
            part,
            "\"of\": 2",
            "\"of\": 1",
            "2 points and 2 normals of 1",
        ),
        (part, "400000.1", "1e400", "map/part.json: "),
        (part, "describe map", "\\u0007", "cannot be shown"),
        (part, "\"looks\"", "\"luks\"", "looks"),
    ] {
        let told = message(replaced(name, from, to));
        assert!(
            told.starts_with("b.zip: ") && told.contains(wanted),
            "{name} {to}: {told}"
        );
    }
    let told = message(with("map/0/points.npy", |c| c.truncate(c.len() - 12)));
    assert!(
        told.contains("map/0/points.npy: is no NumPy array"),
        "{told}"
    );
    let nan = |c: &mut Vec<u8>| {
        let end = c.len();
        c[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    };
    assert!(message(with("map/0/normals.npy", nan)).contains("point 1 is not finite"));
    assert!(message(with("outcome.json", |c| c[0] = 0xff)).contains("is no text"));
    assert!(
        with("query.pcd", |c| c.push(1)).is_ok(),
        "the query is read when it is asked about"
    );
}

#[test]
fn an_archive_of_something_else_is_no_bundle() {
    let sound = unpacked(&bundle().to_bytes().unwrap());
    let mut more = sound.clone();
    more.insert("more.txt".into(), b"more".to_vec());
    assert!(message(Bundle::from_bytes("b.zip", &packed(&more))).contains("the archive has 10"));
    let mut other = sound.clone();
    other.remove("outcome.json");
    other.insert("other.json".into(), b"{}".to_vec());
    assert!(message(Bundle::from_bytes("b.zip", &packed(&other))).contains("outcome.json: "));
    let mut none = sound;
    none.remove("manifest.json");
    assert!(message(Bundle::from_bytes("b.zip", &packed(&none))).contains("is no bundle"));
    for bytes in [&b""[..], b"PK\x05\x06", b"# .PCD v0.7"] {
        assert!(message(Bundle::from_bytes("b.zip", bytes)).contains("is no bundle"));
    }
}
