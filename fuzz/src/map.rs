//! What must hold for any bytes that are opened as a prepared map.

use std::ops::Range;
use std::sync::OnceLock;

use winze::{Config, PreparedMap as _};
use winze_map::{BuildOptions, Map, build};

use crate::check_message;

/// Opens `bytes` as a map and verifies it; where it is one, looks around in it.
pub fn check(bytes: &[u8]) {
    let opened = Map::from_bytes("fuzzed.wmap", bytes);
    match opened.and_then(|map| map.check(&mut |_, _| ()).map(|()| map)) {
        Ok(map) => look_around(&map),
        Err(error) => check_message(&error.to_string()),
    }
}

/// The same for a sound map to which `patches` were made, with checksums that match.
///
/// A patch has eight bytes: a section, what to do, where (two), and a value (four).
pub fn check_patched(patches: &[u8]) {
    let Sound { bytes, sections } = sound();
    let mut bytes = bytes.clone();
    let mut changed = vec![false; sections.len()];
    for patch in patches.as_chunks::<8>().0 {
        let &[section, what, at0, at1, ..] = patch;
        let value = [patch[4], patch[5], patch[6], patch[7]];
        let section = usize::from(section) % sections.len();
        let content = &mut bytes[sections[section].clone()];
        if content.len() < 4 {
            continue;
        }
        let at = usize::from(u16::from_le_bytes([at0, at1]));
        match what % 4 {
            // Bytes, as in a text; words from the front, or from the end.
            0 => {
                let at = at % (content.len() - 3);
                content[at..at + 4].copy_from_slice(&value);
            }
            1 => {
                let at = at % (content.len() / 4) * 4;
                content[at..at + 4].copy_from_slice(&value);
            }
            2 => {
                let at = content.len() - 4 - at % (content.len() / 4) * 4;
                content[at..at + 4].copy_from_slice(&value);
            }
            _ => content.as_chunks_mut().0.fill(value),
        }
        changed[section] = true;
    }
    sign(&mut bytes, sections, &changed);
    check(&bytes);
}

/// Asks all that is in a map, at least once.
fn look_around(map: &Map) {
    let mut found = Vec::new();
    for level in 0..map.meta().levels.len() {
        let surface = map.surface(level).expect("it was checked");
        for p in surface.points.iter().take(4) {
            let _ = surface.tree.nearest(*p);
            surface.tree.knn(*p, 20, 1.0, &mut Vec::new());
        }
        let (features, index) = map.features(level).expect("it was checked");
        for d in features.descriptors.iter().take(4) {
            index.nearest(&features.descriptors, d, 3, &mut found);
            assert!(
                found
                    .iter()
                    .all(|(_, i)| (*i as usize) < features.points.len())
            );
        }
        map.cells(level).expect("it was checked");
    }
    let _ = map.adopt(&Config::default());
}

struct Sound {
    bytes: Vec<u8>,
    /// Where their bytes are, in the order of the table.
    sections: Vec<Range<usize>>,
}

/// A small map, made once.
fn sound() -> &'static Sound {
    static SOUND: OnceLock<Sound> = OnceLock::new();
    SOUND.get_or_init(|| {
        let folder = tempfile::tempdir().expect("a folder");
        let (cloud, out) = (folder.path().join("a.xyz"), folder.path().join("a.wmap"));
        let points: String = (0..1500)
            .map(|i| {
                let (x, a) = (0.004 * f64::from(i), 2.399_963 * f64::from(i));
                let r = 1.5 + 0.2 * (3.0 * x + a.sin()).sin();
                format!("{x:.4} {:.4} {:.4}\n", r * a.cos(), r * a.sin())
            })
            .collect();
        std::fs::write(&cloud, points).expect("a cloud");
        let mut config = Config::default();
        config.iss.max_map_keypoints = 100;
        build(&[cloud], &out, &config, &BuildOptions::default()).expect("a map");
        let map = Map::open(&out).expect("a sound map");
        let range = |at: u64, length: u64| at as usize..(at + length) as usize;
        let sections = map.sections().map(|e| range(e.offset, e.length)).collect();
        let bytes = std::fs::read(&out).expect("its bytes");
        Sound { bytes, sections }
    })
}

/// Sets the checksums of changed sections right, then those of the table and the trailer.
fn sign(bytes: &mut [u8], sections: &[Range<usize>], changed: &[bool]) {
    let end = bytes.len() - 64;
    let number = |at: usize| {
        let number = bytes[at..at + 8].try_into().expect("eight bytes");
        u64::from_le_bytes(number) as usize
    };
    let table = number(end)..number(end) + number(end + 8);
    let mut put = |at: usize, of: Range<usize>| {
        let crc = crc32fast::hash(&bytes[of]);
        bytes[at..at + 4].copy_from_slice(&crc.to_le_bytes());
    };
    for (i, section) in sections.iter().enumerate().filter(|(i, _)| changed[*i]) {
        put(table.start + 40 * i + 24, section.clone());
    }
    put(end + 24, table);
    put(end + 60, end..end + 60);
}
