//! A small map, its parts, and [ways to damage it](damage).
#![allow(
    dead_code,
    unreachable_pub,
    clippy::unwrap_used,
    clippy::indexing_slicing,
    clippy::cast_possible_truncation,
    reason = "shared by several test programs"
)]

pub mod damage;

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use winze::rng::Rng;
use winze::{Cloud, Config};
use winze_map::{BuildOptions, build};

/// `n` points of a rough drift along x between two places, metres; `draw` picks other points of the same walls.
pub fn drift(n: usize, [from, to]: [f64; 2], draw: u64) -> Vec<[f64; 3]> {
    let mut world = Rng::new(2024, 0);
    let bumps: Vec<[f64; 4]> = (0..24)
        .map(|i| {
            let wavelength = 6.0 * 0.85_f64.powi(i);
            let k = TAU / wavelength;
            let along = world.range(-1.0, 1.0);
            let around = (2.0 * k * (1.0 - along * along).sqrt()).round();
            [k * along, around, world.range(0.0, 6.0), wavelength / 6.0]
        })
        .collect();
    let total: f64 = bumps.iter().map(|b| b[3]).sum();
    let mut rng = Rng::new(draw, 1);
    (0..n)
        .map(|_| {
            let (x, a) = (rng.range(from, to), rng.range(0.0, TAU));
            let bump = |b: &[f64; 4]| b[3] * (b[0] * x + b[1] * a + b[2]).sin();
            let r = 2.0 + 0.9 * bumps.iter().map(bump).sum::<f64>() / total;
            [x, r * a.cos(), 0.8 * r * a.sin()]
        })
        .collect()
}

/// Writes points as a text cloud.
pub fn write_cloud(path: &Path, points: &[[f64; 3]]) {
    let lines: Vec<String> = points
        .iter()
        .map(|[x, y, z]| format!("{x:.4} {y:.4} {z:.4}\n"))
        .collect();
    std::fs::write(path, lines.concat()).unwrap();
}

/// Settings that ask little.
pub fn cheap() -> Config {
    let mut config = Config::default();
    config.scale.tries = 1;
    config.iss.min_keypoints = 300;
    config.iss.max_keypoints = 300;
    config.iss.max_map_keypoints = 500;
    config.ransac.min_samples = 2_000;
    config.ransac.max_samples = 4_000;
    config.ransac.hypotheses = 4;
    config.ndt.max_points = 300;
    config.ndt.max_iterations = 8;
    config.icp.max_points = 300;
    config.icp.max_iterations = 8;
    config.verify.max_points = 500;
    config.verify.refined = 2;
    config
}

/// A map of a short drift in a folder of its own, and its bytes.
pub fn small_map() -> (tempfile::TempDir, PathBuf, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let cloud = folder.path().join("drift.xyz");
    write_cloud(&cloud, &drift(4_000, [0.0, 8.0], 1));
    let path = folder.path().join("drift.wmap");
    build(&[cloud], &path, &cheap(), &BuildOptions::default()).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    (folder, path, bytes)
}

/// Something to look for in it.
pub fn query() -> Cloud {
    let points: Vec<[f64; 3]> = drift(2_000, [2.0, 6.0], 2)
        .iter()
        .map(|[x, y, z]| [0.8 * x - 0.6 * y - 2.0, 0.6 * x + 0.8 * y, z + 0.5])
        .collect();
    Cloud::from_points(&points).unwrap().0
}

/// A line of the section table as `docs/map-format.md` has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    pub tag: [u8; 4],
    pub number: u32,
    pub offset: u64,
    pub length: u64,
    pub crc: u32,
    pub element: u32,
}

impl Line {
    pub fn range(&self) -> std::ops::Range<usize> {
        self.offset as usize..(self.offset + self.length) as usize
    }
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// Where the table of a sound file begins.
pub fn table_at(bytes: &[u8]) -> usize {
    u64_at(bytes, bytes.len() - 64) as usize
}

/// The table of a sound file.
pub fn lines(bytes: &[u8]) -> Vec<Line> {
    let length = u64_at(bytes, bytes.len() - 56) as usize;
    let entries = bytes[table_at(bytes)..][..length].chunks(40);
    entries
        .map(|e| Line {
            tag: e[..4].try_into().unwrap(),
            number: u32_at(e, 4),
            offset: u64_at(e, 8),
            length: u64_at(e, 16),
            crc: u32_at(e, 24),
            element: u32_at(e, 28),
        })
        .collect()
}

fn table(lines: &[Line]) -> Vec<u8> {
    let mut table = Vec::new();
    for l in lines {
        table.extend(l.tag);
        table.extend(l.number.to_le_bytes());
        table.extend(l.offset.to_le_bytes());
        table.extend(l.length.to_le_bytes());
        table.extend(l.crc.to_le_bytes());
        table.extend(l.element.to_le_bytes());
        table.extend([0; 8]);
    }
    table
}

/// Puts `lines` into the table of a sound file, with all checksums that follow from it.
pub fn sign(bytes: &mut [u8], lines: &[Line]) {
    let table = table(lines);
    let at = table_at(bytes);
    bytes[at..at + table.len()].copy_from_slice(&table);
    let end = bytes.len() - 64;
    bytes[end + 24..end + 28].copy_from_slice(&crc32fast::hash(&table).to_le_bytes());
    seal(&mut bytes[end..]);
}

/// Sets the checksum of a header or a trailer right.
pub fn seal(bytes: &mut [u8]) {
    let crc = crc32fast::hash(&bytes[..60]);
    bytes[60..64].copy_from_slice(&crc.to_le_bytes());
}

/// Sets the checksum of a section right, and what follows from it.
pub fn sign_section(bytes: &mut [u8], section: usize) {
    let mut lines = lines(bytes);
    lines[section].crc = crc32fast::hash(&bytes[lines[section].range()]);
    sign(bytes, &lines);
}

/// A file with the `header` of a sound one, of these sections: name and element size of each line, and content.
pub fn assembled(header: &[u8], sections: &[(Line, Vec<u8>)]) -> Vec<u8> {
    let mut bytes = header[..64].to_vec();
    let pad = |bytes: &mut Vec<u8>| bytes.resize(bytes.len().next_multiple_of(64), 0);
    let mut lines = Vec::new();
    for (line, content) in sections {
        pad(&mut bytes);
        lines.push(Line {
            offset: bytes.len() as u64,
            length: content.len() as u64,
            crc: crc32fast::hash(content),
            ..*line
        });
        bytes.extend(content);
    }
    pad(&mut bytes);
    let (at, table) = (bytes.len() as u64, table(&lines));
    bytes.extend(&table);
    pad(&mut bytes);
    let mut trailer = [0; 64];
    trailer[..8].copy_from_slice(&at.to_le_bytes());
    trailer[8..16].copy_from_slice(&(table.len() as u64).to_le_bytes());
    trailer[16..24].copy_from_slice(&(bytes.len() as u64 + 64).to_le_bytes());
    trailer[24..28].copy_from_slice(&crc32fast::hash(&table).to_le_bytes());
    trailer[52..60].copy_from_slice(b"WMAP END");
    seal(&mut trailer);
    bytes.extend(trailer);
    bytes
}

/// The sections of a sound file, for [`assembled`].
pub fn sections(bytes: &[u8]) -> Vec<(Line, Vec<u8>)> {
    let lines = lines(bytes).into_iter();
    lines.map(|l| (l, bytes[l.range()].to_vec())).collect()
}
