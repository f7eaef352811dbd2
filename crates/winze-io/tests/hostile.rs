//! Files that are cut, that lie or that make no sense: an error, at once, and never a panic.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::time::{Duration, Instant};

use winze::Cloud;
use winze_io::{
    Encoding, Error, Format, ReadOptions, WriteOptions, read_cloud_bytes, write_cloud_bytes,
};

fn read(bytes: &[u8], format: Format) -> winze_io::Result<winze_io::CloudFile> {
    let start = Instant::now();
    let result = read_cloud_bytes(bytes, format, &ReadOptions::default());
    assert!(start.elapsed() < Duration::from_secs(2), "takes too long");
    result
}

fn small_file(format: Format, encoding: Encoding) -> Vec<u8> {
    let points: Vec<[f64; 3]> = (0..12).map(|i| [f64::from(i) + 0.25, 1.5, -2.75]).collect();
    let (cloud, _) = Cloud::with_intensity(&points, Some(&[0.5; 12])).unwrap();
    let options = WriteOptions {
        encoding: Some(encoding),
    };
    write_cloud_bytes(&cloud, format, &options).unwrap()
}

#[test]
fn binary_files_cut_at_any_byte_are_errors() {
    for (format, encoding) in [
        (Format::Pcd, Encoding::Binary),
        (Format::Pcd, Encoding::Compressed),
        (Format::Ply, Encoding::Binary),
    ] {
        let bytes = small_file(format, encoding);
        assert_eq!(read(&bytes, format).unwrap().cloud.len(), 12);
        for cut in 0..bytes.len() {
            let error = read(&bytes[..cut], format).unwrap_err();
            // Within the header a cut may also leave a keyword that is none.
            let kind = matches!(error, Error::Truncated { .. } | Error::Malformed { .. });
            assert!(kind, "{format} {encoding} cut at {cut}: {error}");
        }
    }
}

#[test]
fn a_kitti_file_is_cut_within_a_point_or_not_at_all() {
    let bytes = small_file(Format::Kitti, Encoding::Binary);
    for cut in 0..bytes.len() {
        match read(&bytes[..cut], Format::Kitti) {
            Ok(file) => assert_eq!(16 * file.report.points_in_file, cut),
            Err(error) => {
                assert!(matches!(error, Error::Truncated { .. }), "{error}");
                assert!(cut % 16 != 0 && error.to_string().contains("takes 16 bytes"));
            }
        }
    }
    // Nothing tells another program's bytes from floats but where they lie.
    let text = b"a file that is no cloud at all, ".repeat(40);
    let error = read(&text, Format::Kitti).unwrap_err();
    assert!(matches!(error, Error::Rejected { .. }), "{error}");
}

#[test]
fn ascii_files_cut_before_their_last_number_are_errors() {
    for format in [Format::Pcd, Format::Ply] {
        let bytes = small_file(format, Encoding::Ascii);
        let last = bytes
            .trim_ascii_end()
            .iter()
            .rposition(|&b| b == b' ')
            .unwrap();
        for cut in 0..=last {
            assert!(
                read(&bytes[..cut], format).is_err(),
                "{format} cut at {cut}"
            );
        }
        // From here on the file has all its numbers, the very last one perhaps with fewer digits.
        for cut in last + 2..=bytes.len() {
            match read(&bytes[..cut], format) {
                Ok(file) => assert_eq!(file.cloud.len(), 12),
                Err(error) => panic!("{format} cut at {cut}: {error}"),
            }
        }
    }
}

#[test]
fn text_files_cut_anywhere_never_panic() {
    let bytes = small_file(Format::Text, Encoding::Ascii);
    for cut in 0..bytes.len() {
        let lines = bytes[..cut].iter().filter(|&&b| b == b'\n').count();
        match read(&bytes[..cut], Format::Text) {
            Ok(file) => assert!(file.cloud.len() + 1 >= lines),
            Err(Error::Malformed { .. } | Error::Empty { .. }) => {}
            Err(error) => panic!("cut at {cut}: {error}"),
        }
    }
}

#[test]
fn big_endian_ply_and_ply_with_lists_cut_anywhere_are_errors() {
    let head = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement pose 1\nproperty list uchar short t\n\
             element vertex 2\nproperty float x\nproperty list ushort uchar tags\n\
             property double y\nproperty float z\nend_header\n"
        )
    };
    let mut big = head("binary_big_endian").into_bytes();
    big.extend([2, 0, 7, 0, 8]);
    for i in 0..2u8 {
        big.extend(f32::from(i).to_be_bytes());
        big.extend([0, 3, 1, 2, 3]);
        big.extend(2.5f64.to_be_bytes());
        big.extend((-1f32).to_be_bytes());
    }
    let ascii = head("ascii") + "2 7 8\n0 3 1 2 3 2.5 -1\n1 0 2.5 -1\n";
    for (bytes, end) in [(&big[..], big.len()), (ascii.as_bytes(), ascii.len() - 2)] {
        let cloud = read(bytes, Format::Ply).unwrap().cloud;
        assert_eq!(
            [cloud.point(0), cloud.point(1)],
            [[0.0, 2.5, -1.0], [1.0, 2.5, -1.0]]
        );
        for cut in 0..end {
            assert!(read(&bytes[..cut], Format::Ply).is_err(), "cut at {cut}");
        }
    }
}

fn pcd(lines: &str, data: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("VERSION 0.7\nFIELDS x y z a\nTYPE F F F F\n{lines}\nDATA {data}\n");
    [head.as_bytes(), body].concat()
}

#[test]
fn pcd_headers_that_lie_are_refused_at_once() {
    let body = [0u8; 200];
    for (lines, expected) in [
        (
            "SIZE 4 4 4 4\nWIDTH 4000000000\nHEIGHT 1\nPOINTS 4000000000",
            "line 7: POINTS says 4000000000",
        ),
        (
            "SIZE 4 4 4 4\nWIDTH 4000000000\nHEIGHT 4000000000",
            "line 5: WIDTH times HEIGHT says 16000000000000000000 but the file holds 12 points",
        ),
        (
            "SIZE 4 4 4 4\nWIDTH 8589934592\nHEIGHT 8589934592",
            "line 5: WIDTH 8589934592 times HEIGHT 8589934592 is more than any file holds",
        ),
        (
            "SIZE 4 4 4 4\nWIDTH 1\nHEIGHT 1\nPOINTS 100",
            "line 7: POINTS says 100 but the file holds 12 points",
        ),
        (
            "SIZE 4 4 4 4\nWIDTH 4000000000",
            "line 5: WIDTH times HEIGHT says 4000000000",
        ),
        (
            "SIZE 4 4 4 4\nPOINTS 18446744073709551615",
            "line 5: POINTS says 18446744073709551615",
        ),
        ("SIZE 4 4 4 4\nPOINTS -1", "line 5: POINTS '-1'"),
        ("SIZE 4 4 3 4\nPOINTS 1", "line 4: TYPE F with SIZE 3"),
        (
            "SIZE 4 4 4 4\nCOUNT 1 1 1 4000000000\nPOINTS 1",
            "the file holds 0 points",
        ),
        (
            "SIZE 4 4 4 4\nCOUNT 1 1 1 18446744073709551615\nPOINTS 1",
            "line 5: a record of this many",
        ),
        (
            "SIZE 4 4 4 4\nCOUNT 4611686018427387904 1 1 1\nPOINTS 1",
            "line 5: a record of this many",
        ),
    ] {
        for data in ["ascii", "binary", "binary_compressed"] {
            let error = read(&pcd(lines, data, &body), Format::Pcd).unwrap_err();
            let text = error.to_string();
            assert!(data != "binary" || text.contains(expected), "{text}");
        }
    }
}

#[test]
fn compressed_sizes_that_lie_are_refused_before_memory_is_taken() {
    let lines = |points: u64| format!("SIZE 4 4 4 4\nPOINTS {points}");
    let body = |packed: u32, size: u32, data: &[u8]| {
        [&packed.to_le_bytes()[..], &size.to_le_bytes(), data].concat()
    };
    for (points, body, expected) in [
        (
            268_435_455,
            body(8, 0xFFFF_FFF0, &[0; 8]),
            "8 bytes cannot decompress to the 4294967280",
        ),
        (
            268_435_455,
            body(0xFFFF_FFFF, 0xFFFF_FFF0, &[0; 8]),
            "4294967295 compressed bytes announced, 8 there",
        ),
        (
            1,
            body(8, 17, &[0; 8]),
            "1 points of 16 bytes do not make the 17 bytes",
        ),
        (
            2,
            body(8, 16, &[0; 8]),
            "POINTS says 2 but the file holds 1 points",
        ),
        (1, body(8, 32, &[0; 8]), "do not make the 32 bytes"),
        (
            1,
            body(8, 16, &[0xFF; 8]),
            "byte 93: the compressed data is damaged",
        ),
        (1, body(0, 0, &[]), "holds 0 points"),
        (1, vec![0; 6], "ends within its size"),
        (1, vec![], "holds 0 points"),
    ] {
        let error = read(
            &pcd(&lines(points), "binary_compressed", &body),
            Format::Pcd,
        )
        .unwrap_err()
        .to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn ply_headers_that_lie_are_refused_at_once() {
    let ply = |format: &str, elements: &str| {
        let head = format!("ply\nformat {format} 1.0\n{elements}\nend_header\n");
        [head.as_bytes(), &b"1 2 3\n".repeat(20)].concat()
    };
    let xyz = "property float x\nproperty float y\nproperty float z";
    for (elements, expected) in [
        (
            format!("element vertex 4000000000\n{xyz}"),
            "line 3: announces 4000000000 of element vertex",
        ),
        (
            format!("element vertex 18446744073709551615\n{xyz}"),
            "at most",
        ),
        (
            format!("element vertex -1\n{xyz}"),
            "line 3: '-1' is not a number of elements",
        ),
        (
            format!("element vertex 4000000000\n{xyz}\nproperty list uint double t"),
            "announces 4000000000",
        ),
        (
            format!("element vertex 1\n{xyz}\nproperty list int double t"),
            "of element vertex",
        ),
        (
            format!("element face 4000000000\nproperty list uchar int i\nelement vertex 1\n{xyz}"),
            "announces 4000000000 of element face",
        ),
        (
            format!(
                "element face 18446744073709551615\nproperty double d\nelement vertex 1\n{xyz}"
            ),
            "of element face",
        ),
        (
            "element vertex 1\nproperty float x\nproperty float y".to_owned(),
            "the columns are x, y; a cloud needs",
        ),
        (
            "element vertex 1\nproperty list uchar int x\nproperty float y\nproperty float z"
                .to_owned(),
            "property x is a list",
        ),
        (
            "element face 1\nelement edge 2".to_owned(),
            "has no element vertex (there are: face, edge)",
        ),
        (
            String::new(),
            "has no element vertex (there are: no elements at all)",
        ),
    ] {
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            match read(&ply(format, &elements), Format::Ply) {
                Err(error) if format == "binary_little_endian" => {
                    let text = error.to_string();
                    assert!(
                        text.contains(expected) || elements.contains("list int"),
                        "{text}"
                    );
                }
                Err(_) => {}
                Ok(_) => panic!("{format}: {elements} is taken"),
            }
        }
    }
    // Elements without properties take no room, however many there are.
    let read = read(
        &ply(
            "ascii",
            &format!("element nothing 4000000000\nelement vertex 20\n{xyz}"),
        ),
        Format::Ply,
    );
    assert_eq!(read.unwrap().cloud.len(), 20);
}

#[test]
fn a_list_of_negative_length_is_refused() {
    let head = "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nproperty list char int t\nend_header\n";
    let bytes = [head.as_bytes(), &[0; 12], &[0x80]].concat();
    let text = read(&bytes, Format::Ply).unwrap_err().to_string();
    assert!(text.contains("list t has a length of -128"), "{text}");
}

#[test]
fn junk_in_every_format_is_an_error() {
    let junk: Vec<u8> = (0..100_000u32)
        .map(|i| (i.wrapping_mul(2_654_435_761) >> 23) as u8)
        .collect();
    for format in [Format::Pcd, Format::Ply, Format::Text] {
        let text = read(&junk, format).unwrap_err().to_string();
        assert!(
            text.len() < 300 && !text.chars().any(char::is_control),
            "{text}"
        );
    }
}
