//! Reading and writing a million points: `cargo bench -p winze-io`.

#![allow(clippy::unwrap_used)]

use divan::{Bencher, black_box};
use winze::Cloud;
use winze_io::{Encoding, Format, ReadOptions, WriteOptions, read_cloud_bytes, write_cloud_bytes};

fn main() {
    divan::main();
}

const POINTS: u32 = 1_000_000;

/// A winding drift with rough walls, with intensities, about the origin or at UTM coordinates.
fn cloud(utm: bool) -> Cloud {
    let origin = if utm {
        [431_000.0, 4_499_000.0, 300.0]
    } else {
        [0.0; 3]
    };
    let points: Vec<[f64; 3]> = (0..POINTS)
        .map(|i| {
            let along = f64::from(i) * 3e-4;
            let around = f64::from(i.wrapping_mul(2_654_435_761)) * 1.463e-9;
            let radius = 2.0 + 0.1 * (f64::from(i) * 0.7).sin();
            [
                origin[0] + along,
                origin[1] + 20.0 * (along * 0.02).sin() + radius * around.cos(),
                origin[2] + radius * around.sin(),
            ]
        })
        .collect();
    let intensity: Vec<f32> = (0..POINTS).map(|i| (i % 256) as f32).collect();
    Cloud::with_intensity(&points, Some(&intensity)).unwrap().0
}

fn file(format: Format, encoding: Encoding, utm: bool) -> Vec<u8> {
    let options = WriteOptions {
        encoding: Some(encoding),
    };
    write_cloud_bytes(&cloud(utm), format, &options).unwrap()
}

const FORMATS: [(Format, Encoding); 6] = [
    (Format::Pcd, Encoding::Binary),
    (Format::Pcd, Encoding::Compressed),
    (Format::Pcd, Encoding::Ascii),
    (Format::Ply, Encoding::Binary),
    (Format::Ply, Encoding::Ascii),
    (Format::Text, Encoding::Ascii),
];

/// `FORMATS` by name.
#[derive(Clone, Copy)]
struct Which(usize);

impl std::fmt::Display for Which {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (format, encoding) = FORMATS[self.0];
        write!(f, "{format} {encoding}")
    }
}

const ALL: [Which; 6] = [Which(0), Which(1), Which(2), Which(3), Which(4), Which(5)];

fn read(bencher: Bencher<'_, '_>, which: Which, utm: bool, digest: bool) {
    let (format, encoding) = FORMATS[which.0];
    let bytes = file(format, encoding, utm);
    let options = ReadOptions {
        digest,
        ..ReadOptions::default()
    };
    bencher.bench(|| read_cloud_bytes(black_box(&bytes), format, &options).unwrap());
}

#[divan::bench(args = ALL, sample_count = 20)]
fn read_plain(bencher: Bencher<'_, '_>, which: Which) {
    read(bencher, which, false, false);
}

#[divan::bench(args = ALL, sample_count = 20)]
fn read_utm(bencher: Bencher<'_, '_>, which: Which) {
    read(bencher, which, true, false);
}

#[divan::bench(args = ALL, sample_count = 20)]
fn read_with_digest(bencher: Bencher<'_, '_>, which: Which) {
    read(bencher, which, false, true);
}

#[divan::bench(args = ALL, sample_count = 20)]
fn write(bencher: Bencher<'_, '_>, which: Which) {
    let (format, encoding) = FORMATS[which.0];
    let cloud = cloud(false);
    let options = WriteOptions {
        encoding: Some(encoding),
    };
    bencher.bench(|| write_cloud_bytes(black_box(&cloud), format, &options).unwrap());
}

/// Vertices through `ply-rs-bw`, for comparison.
#[divan::bench(sample_count = 20)]
fn ply_rs_bw(bencher: Bencher<'_, '_>) {
    #[derive(Default)]
    struct Vertex([f32; 4]);
    impl ply_rs_bw::ply::PropertyAccess for Vertex {
        fn new() -> Self {
            Self::default()
        }
        fn set_float(&mut self, key: &str, value: f32) -> ply_rs_bw::ply::PropertyAccessResult {
            let slot = match key {
                "x" => 0,
                "y" => 1,
                "z" => 2,
                _ => 3,
            };
            self.0[slot] = value;
            ply_rs_bw::ply::PropertyAccessResult::Set
        }
    }
    let bytes = file(Format::Ply, Encoding::Binary, false);
    let parser = ply_rs_bw::parser::Parser::<Vertex>::new();
    bencher.bench(|| parser.read_ply(&mut black_box(&bytes[..])).unwrap().payload["vertex"].len());
}
