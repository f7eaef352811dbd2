//! Files read as streams: the very points, origin and errors of `read_cloud`.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use proptest::prelude::*;
use winze::Cloud;
use winze_io::{
    CloudStream, Encoding, Error, Format, NoReturns, PointStream, ReadOptions, WriteOptions,
    read_cloud, write_cloud_bytes,
};

const CHUNKS: [usize; 4] = [1, 7, 1000, usize::MAX];

fn open(paths: &[PathBuf], options: &ReadOptions) -> winze_io::Result<PointStream> {
    let (mut last, mut total) = (0, 0);
    let stream = PointStream::open(paths, options, &mut |done, all| {
        assert!(done >= last && done <= all && (total == 0 || total == all));
        (last, total) = (done, all);
    })?;
    assert_eq!(last, total);
    Ok(stream)
}

fn collect(stream: &PointStream, chunk: usize) -> winze_io::Result<Vec<[f32; 3]>> {
    let mut all = Vec::new();
    let mut full = true;
    stream.for_each(chunk, &mut |part| {
        assert!(full && !part.is_empty() && part.len() <= chunk);
        full = part.len() == chunk;
        all.extend_from_slice(part);
        Ok(())
    })?;
    Ok(all)
}

fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
    points.iter().map(|p| p.map(f32::to_bits)).collect()
}

/// Reads one file both ways; whether it could be read.
fn same(path: &Path, options: &ReadOptions) -> bool {
    let whole = read_cloud(path, options);
    let stream = open(&[path.to_owned()], options);
    let (whole, stream) = match (whole, stream) {
        (Ok(whole), Ok(stream)) => (whole, stream),
        (Err(a), Err(b)) => {
            assert_eq!(a.to_string(), b.to_string());
            return false;
        }
        (a, b) => panic!("{}: {a:?} but {b:?}", path.display()),
    };
    let cloud = whole.cloud;
    assert_eq!(
        stream.origin().map(f64::to_bits),
        cloud.origin().map(f64::to_bits)
    );
    assert_eq!(stream.len(), cloud.len() as u64);
    assert_eq!(stream.viewpoint(), cloud.viewpoint());
    assert_eq!(stream.files()[0].report, whole.report);
    for chunk in CHUNKS {
        assert_eq!(
            bits(&collect(&stream, chunk).unwrap()),
            bits(cloud.points())
        );
    }
    let raw = CloudStream::open(path).unwrap();
    for chunk in CHUNKS {
        let mut points = 0;
        raw.for_each(chunk, &mut |part| {
            assert!(part.len() <= chunk);
            points += part.len();
            Ok(())
        })
        .unwrap();
        assert_eq!(points, whole.report.points_in_file);
    }
    true
}

/// A name and the content of files of all kinds, all of them readable.
fn zoo() -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    let mut put = |name: &str, content: Vec<u8>| {
        let extension = name.rsplit('.').next().unwrap().to_owned();
        files.push((format!("{}.{extension}", files.len()), content));
    };
    let small: Vec<[f64; 3]> = (0..40)
        .map(|i| [f64::from(i) + 0.1, -1.3, f64::from(i % 3) / 3.0])
        .collect();
    let utm: Vec<[f64; 3]> = small
        .iter()
        .map(|p| [p[0] + 431_234.567, p[1] + 4_499_980.459, p[2]])
        .collect();
    // A remark between lines of which nobody wants the first column.
    let header = "VERSION 0.7\nFIELDS label z y x\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n\
        WIDTH 3\nHEIGHT 1\nPOINTS 3\nDATA ascii\n";
    let lines = "7 1 2 3\n# 1 2 3\n8 1.5 2 3\n\t# a word\n9 2 2 3\n";
    put("a.pcd", format!("{header}{lines}").into_bytes());
    for points in [&small, &utm] {
        let intensity = [0.5; 40];
        for intensity in [None, Some(&intensity[..])] {
            let (cloud, _) = Cloud::with_intensity(points, intensity).unwrap();
            for (name, format, encoding) in [
                ("a.pcd", Format::Pcd, Encoding::Ascii),
                ("a.pcd", Format::Pcd, Encoding::Binary),
                ("a.pcd", Format::Pcd, Encoding::Compressed),
                ("a.ply", Format::Ply, Encoding::Ascii),
                ("a.ply", Format::Ply, Encoding::Binary),
                ("a.xyz", Format::Text, Encoding::Ascii),
            ] {
                let options = WriteOptions {
                    encoding: Some(encoding),
                };
                put(name, write_cloud_bytes(&cloud, format, &options).unwrap());
            }
        }
    }
    // Zeros, values that are none, strays, comments and blank lines.
    let rows = "1 2 3 4\r\n0 -0 0 1\r\n\r\nnan 1 2 3\r\n".repeat(12)
        + &"5e5 4e6 7 1\r\n".repeat(990)
        + "5e5 inf 0 0\r\n9e9 0 0 0";
    put("a.txt", format!("# a\n# x y z i\r\n{rows}").into_bytes());
    put(
        "a.csv",
        format!("x,y,z,i\n{}", rows.replace(' ', ",")).into_bytes(),
    );
    for points in [&small, &utm] {
        let numbers = points.iter().flat_map(|&[x, y, z]| [x, y, z, 0.5]);
        put(
            "a.bin",
            numbers.flat_map(|v| (v as f32).to_le_bytes()).collect(),
        );
    }
    put("a.asc", "\u{feff}1,5;2;3\n4;5;\n".into());
    put("a.pts", "2\r\n1 2 3\r\n4 5 6\r\n7 8 9\r\n".into());
    let pcd = |lines: &str, data: &str, body: &[u8]| {
        [format!("FIELDS _ z y x a\nSIZE 1 8 8 8 2\nTYPE U F F F I\nCOUNT 3 1 1 1 2\n{lines}\nDATA {data}\n").as_bytes(), body].concat()
    };
    let text = |n: u32| {
        (0..n).fold(String::new(), |mut all, i| {
            writeln!(all, "9 9 9 {i}.5 {i} -3 7 7").unwrap();
            all
        })
    };
    for lines in [
        "POINTS 5",
        "WIDTH 3\nPOINTS 5",
        "WIDTH 6\nPOINTS 5",
        "WIDTH 2\nHEIGHT 3",
        "VIEWPOINT 1 2 3 1 0 0 0\nBOGUS\nPOINTS 6",
        "HEIGHT 2",
    ] {
        put("a.pcd", pcd(lines, "ascii", text(6).as_bytes()));
        let record = [
            &[9u8; 3][..],
            &1.5f64.to_le_bytes(),
            &f64::NAN.to_le_bytes(),
            &(-4e6f64).to_le_bytes(),
            &[1; 4],
        ]
        .concat();
        let other = [
            &[9u8; 3][..],
            &1.5f64.to_le_bytes(),
            &0f64.to_le_bytes(),
            &(-4e6f64).to_le_bytes(),
            &[1; 4],
        ]
        .concat();
        put(
            "a.pcd",
            pcd(lines, "binary", &[record, other.repeat(5)].concat()),
        );
        put(
            "a.pcd",
            pcd(lines, "binary", &[other.repeat(6), vec![0, 1]].concat()),
        );
    }
    let wide = String::from(
        "FIELDS x pad y z\nSIZE 4 1 4 4\nTYPE F U F F\nCOUNT 1 70000 1 1\nPOINTS 3\nDATA binary\n",
    );
    put(
        "a.pcd",
        [
            wide.into_bytes(),
            [
                vec![0, 0, 128, 63],
                vec![7; 70_000],
                vec![0, 0, 128, 64, 0, 0, 0, 65],
            ]
            .concat()
            .repeat(3),
        ]
        .concat(),
    );
    for order in ["little", "big"] {
        let number = |v: f32| {
            if order == "big" {
                v.to_be_bytes()
            } else {
                v.to_le_bytes()
            }
        };
        let head = |vertex: &str| {
            format!(
                "ply\r\nformat binary_{order}_endian 1.0\nelement camera 2\nproperty list uchar uchar l\nelement plain 2\nproperty float f\nelement vertex 4\n{vertex}element face 1\nproperty list uchar int i\nend_header\n"
            )
        };
        let before = [&[1, 9, 2, 9, 9][..], &[0; 8]].concat();
        let xyz = "property float z\nproperty uchar c\nproperty float x\nproperty float y\n";
        let listed = "property float z\nproperty list uchar uchar q\nproperty float x\nproperty list uchar int intensity\nproperty float y\n";
        let mut fixed = [head(xyz).into_bytes(), before.clone()].concat();
        let mut varied = [head(listed).into_bytes(), before].concat();
        for i in 0..4u8 {
            let [z, x, y] = [f32::from(i), -2.5, 0.1].map(number);
            fixed.extend([&z[..], &[7], &x, &y].concat());
            varied.extend([&z[..], &[i], &vec![7; usize::from(i)], &x, &[0], &y].concat());
        }
        fixed.push(3);
        put("a.ply", fixed);
        put("a.ply", varied);
    }
    put("a.ply", "ply\nformat ascii 1.0\nelement a 1\nproperty int i\nelement none 3\nelement vertex 3\nproperty float x\nproperty list uchar int l\nproperty double y\nproperty float z\nelement face 1\nproperty list uchar int i\nend_header\n\n7\n1 0 2 3\r\n\n4 2 9 9 5 6\n7 1 1 8 9\n3 0 1 2\n".into());
    put(
        "a.pcd",
        "FIELDS x y z\nPOINTS 0\nDATA binary_compressed\n".into(),
    );
    files
}

#[test]
fn streams_give_the_points_of_read_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let mut read = 0;
    for (name, content) in zoo() {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        for no_returns in [NoReturns::Auto, NoReturns::Keep, NoReturns::Drop] {
            read += usize::from(same(
                &path,
                &ReadOptions {
                    no_returns,
                    digest: true,
                },
            ));
        }
    }
    assert!(read > 100, "{read}");
}

#[test]
fn files_of_other_software() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures");
    let mut read = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if Format::from_extension(&path).is_some() {
            read += usize::from(same(&path, &ReadOptions::default()));
        }
    }
    assert!(read > 15, "{read}");
}

#[test]
fn files_cut_at_any_byte_give_the_same_points_or_the_same_error() {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in zoo() {
        let step = if content.len() > 4000 {
            1 + content.len() / 400
        } else {
            1
        };
        for cut in (0..content.len()).step_by(step) {
            let path = folder.path().join(format!("{cut}_{name}"));
            fs::write(&path, &content[..cut]).unwrap();
            same(
                &path,
                &ReadOptions {
                    digest: false,
                    ..ReadOptions::default()
                },
            );
            fs::remove_file(&path).unwrap();
        }
    }
}

#[test]
fn many_blocks_of_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let points: Vec<[f64; 3]> = (0..150_000)
        .map(|i| {
            [
                f64::from(i) * 0.01 + 7e5,
                f64::from(i % 977) * 0.37,
                if i % 3000 == 5 { 1e7 } else { 0.123_456 },
            ]
        })
        .collect();
    let (cloud, dropped) = Cloud::from_points(&points).unwrap();
    assert_eq!(dropped.far, 50);
    for (i, (name, format, encoding)) in [
        ("a.pcd", Format::Pcd, Encoding::Ascii),
        ("b.pcd", Format::Pcd, Encoding::Binary),
        ("c.pcd", Format::Pcd, Encoding::Compressed),
        ("d.ply", Format::Ply, Encoding::Ascii),
        ("e.ply", Format::Ply, Encoding::Binary),
        ("f.xyz", Format::Text, Encoding::Ascii),
    ]
    .into_iter()
    .enumerate()
    {
        let path = folder.path().join(name);
        let options = WriteOptions {
            encoding: Some(encoding),
        };
        let mut bytes = write_cloud_bytes(&cloud, format, &options).unwrap();
        fs::write(&path, &bytes).unwrap();
        assert!(
            same(
                &path,
                &ReadOptions {
                    digest: i == 0,
                    ..ReadOptions::default()
                }
            ),
            "{name}"
        );
        // Damage far from the beginning is told with its place.
        if encoding != Encoding::Binary {
            let at = bytes.len() - 700_000;
            bytes[at..at + 60].fill(b'?');
            fs::write(&path, &bytes).unwrap();
            same(
                &path,
                &ReadOptions {
                    digest: false,
                    ..ReadOptions::default()
                },
            );
        }
    }
}

#[test]
fn strays_in_a_text_file_are_dropped_as_by_read_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    let near = "1000 2000 3000.25\n0 0 0\n".repeat(12_000);
    for (strays, read) in [(0, true), (200, true), (300, false)] {
        let text = format!("{near}{}{near}", "4e5 1 1\nnan 0 0\n".repeat(strays));
        fs::write(&path, text).unwrap();
        assert_eq!(same(&path, &ReadOptions::default()), read);
    }
}

#[test]
fn several_files_are_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        path
    };
    let first = "431000.5 4499000.25 300\n".repeat(700) + "nan 0 0\n";
    let third = "431000 4499000 299\n".repeat(11_000);
    let parts = [
        put("a.xyz", &first),
        put("b.xyz", "1e9 0 0\n431001 4499001 301\n"),
        put("c.xyz", &third),
    ];
    let whole = put(
        "whole.xyz",
        &(first + "1e9 0 0\n431001 4499001 301\n" + &third),
    );
    let options = ReadOptions::default();
    let cloud = read_cloud(&whole, &options).unwrap().cloud;
    let stream = open(&parts, &options).unwrap();
    assert_eq!(stream.origin(), cloud.origin());
    assert_eq!(stream.viewpoint(), None);
    for chunk in CHUNKS {
        assert_eq!(
            bits(&collect(&stream, chunk).unwrap()),
            bits(cloud.points())
        );
    }
    let reports: Vec<(usize, usize, usize)> = stream
        .files()
        .iter()
        .map(|f| (f.report.points_in_file, f.report.non_finite, f.report.far))
        .collect();
    assert_eq!(reports, [(701, 1, 0), (2, 0, 1), (11_000, 0, 0)]);
    assert!(open(&[], &options).unwrap().is_empty());
    let far = put("far.xyz", &"9e6 0 0\n".repeat(4000));
    let error = open(&[whole, far], &options).unwrap_err().to_string();
    assert!(
        error.contains("whole.xyz and 1 more: cloud too wide"),
        "{error}"
    );
}

#[test]
fn a_file_that_changes_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    let text = "1 2 3\n".repeat(5000);
    let options = ReadOptions::default();
    for other in [
        text[6..].to_owned(),
        text.clone() + "4 5 6\n",
        "# 2 3\n".to_owned() + &text[6..],
        text.replace("2 3", "2 4"),
        String::new(),
    ] {
        fs::write(&path, &text).unwrap();
        let stream = open(std::slice::from_ref(&path), &options).unwrap();
        let raw = CloudStream::open(&path).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(30));
        fs::write(&path, &other).unwrap();
        assert!(matches!(collect(&stream, 9), Err(Error::Changed { .. })));
        assert!(matches!(
            raw.for_each(9, &mut |_| Ok(())),
            Err(Error::Changed { .. })
        ));
        // While it is read, too.
        fs::write(&path, &text).unwrap();
        let stream = open(std::slice::from_ref(&path), &options).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(30));
        let mut given = 0;
        let error = stream.for_each(100, &mut |part| {
            given += part.len();
            if given == 100 {
                fs::write(&path, &other).unwrap();
            }
            Ok(())
        });
        assert!(matches!(error, Err(Error::Changed { .. })) && given <= 5000);
    }
    fs::remove_file(&path).unwrap();
    assert!(
        CloudStream::open(&path)
            .unwrap_err()
            .to_string()
            .contains("no such file")
    );
    assert!(matches!(
        CloudStream::open(folder.path()),
        Err(Error::Folder { .. })
    ));
}

#[test]
fn an_error_of_the_caller_ends_the_reading() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xyz");
    fs::write(&path, "1 2 3\n".repeat(50)).unwrap();
    let stream = open(std::slice::from_ref(&path), &ReadOptions::default()).unwrap();
    let mut calls = 0;
    let error = stream.for_each(7, &mut |_| {
        calls += 1;
        Err(Error::Empty {
            file: "mine".into(),
        })
    });
    assert!(matches!(error, Err(Error::Empty { file }) if file == "mine") && calls == 1);
}

#[test]
fn headers_that_lie_cost_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        (
            "a.pcd",
            "FIELDS x y z\nPOINTS 18446744073709551615\nDATA binary\n",
        ),
        (
            "b.pcd",
            "FIELDS x y z\nPOINTS 18446744073709551615\nDATA ascii\n1 2 3\n",
        ),
        (
            "c.pcd",
            "FIELDS x y z a\nCOUNT 1 1 1 4000000000\nPOINTS 1\nDATA binary\n",
        ),
        (
            "d.pcd",
            "FIELDS x y z\nPOINTS 9\nDATA binary_compressed\n\u{1}\0\0\0\u{7f}\u{7f}\u{7f}\u{7f}",
        ),
        (
            "e.ply",
            "ply\nformat binary_little_endian 1.0\nelement a 18446744073709551615\nproperty list uint double l\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        ),
        (
            "f.ply",
            "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\nx\n",
        ),
        ("g.xyz", "99999999999999999999\n1 2 3\n"),
        ("h.ply", "FIELDS x y z\n"),
        ("i.laz", "\0\0"),
    ] {
        let path = folder.path().join(name);
        fs::write(&path, text).unwrap();
        assert!(!same(&path, &ReadOptions::default()), "{name}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Changes of any byte lead to the same points or the same error.
    #[test]
    fn damaged_files_are_read_alike(which in any::<prop::sample::Index>(), at in any::<prop::sample::Index>(), bytes in prop::collection::vec(any::<u8>(), 1..4)) {
        let mut files = zoo();
        let (name, mut content) = files.swap_remove(which.index(files.len()));
        let at = at.index(content.len().min(3000));
        for (slot, byte) in content[at..].iter_mut().zip(bytes) {
            *slot = byte;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        same(&path, &ReadOptions { digest: false, ..ReadOptions::default() });
    }
}

/// `cargo test -p winze-io --test stream -- --ignored --nocapture`
#[test]
#[ignore = "prints how fast ten million points are read"]
fn speed() {
    let folder = tempfile::tempdir().unwrap();
    let points: Vec<[f64; 3]> = (0..10_000_000)
        .map(|i| [f64::from(i) * 1e-4, f64::from(i % 977) * 0.37, 0.123_456])
        .collect();
    let (cloud, _) = Cloud::from_points(&points).unwrap();
    drop(points);
    for (name, format, encoding) in [
        ("b.pcd", Format::Pcd, Encoding::Binary),
        ("c.pcd", Format::Pcd, Encoding::Compressed),
        ("e.ply", Format::Ply, Encoding::Binary),
        ("f.xyz", Format::Text, Encoding::Ascii),
    ] {
        let path = folder.path().join(name);
        let options = WriteOptions {
            encoding: Some(encoding),
        };
        fs::write(&path, write_cloud_bytes(&cloud, format, &options).unwrap()).unwrap();
        let time = |what: &str, work: &mut dyn FnMut()| {
            let start = Instant::now();
            work();
            println!(
                "{name} {what}: {:.1} ns a point",
                start.elapsed().as_secs_f64() * 100.0
            );
        };
        let options = ReadOptions {
            digest: false,
            ..ReadOptions::default()
        };
        let mut stream = None;
        time("open", &mut || {
            stream = Some(open(std::slice::from_ref(&path), &options).unwrap());
        });
        let stream = stream.unwrap();
        time("PointStream::for_each", &mut || {
            stream.for_each(100_000, &mut |_| Ok(())).unwrap();
        });
        let raw = CloudStream::open(&path).unwrap();
        time("CloudStream::for_each", &mut || {
            raw.for_each(100_000, &mut |_| Ok(())).unwrap();
        });
        time("read_cloud", &mut || {
            assert_eq!(read_cloud(&path, &options).unwrap().cloud.len(), 10_000_000);
        });
    }
}
