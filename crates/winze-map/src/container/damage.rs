//! Files that somebody or something changed.

use proptest::prelude::*;

use super::layout::{ENTRY, Header, Line, ORDER_MARK, TRAILER, Trailer, is_sealed};
use super::tests::{made, sample};
use super::*;
use crate::{Error, Result};

/// All sections, after everything was verified.
fn contents(bytes: &[u8]) -> Result<Vec<(Id, u32, Vec<u8>)>> {
    let file = Container::from_bytes("a", bytes)?;
    // A table has as many lines as the file has bytes for.
    assert!(file.entries().len() * ENTRY <= bytes.len());
    let verified = file.verify_all(&mut |_, _| ());
    let mut all = Vec::new();
    for entry in file.entries() {
        let Id { tag, number } = entry.id;
        let read: Result<Vec<u8>> = match entry.element {
            1 => file.section::<u8>(tag, number).map(<[u8]>::to_vec),
            8 => file.section::<[u8; 8]>(tag, number).map(<[_]>::concat),
            12 => file.section::<[u8; 12]>(tag, number).map(<[_]>::concat),
            _ => file.section::<[u8; 3]>(tag, number).map(<[_]>::concat),
        };
        if entry.intact == Some(false) {
            assert!(read.is_err());
        }
        all.push((entry.id, entry.element, read.unwrap_or_default()));
    }
    verified.map(|()| all)
}

/// The error of a file that must not be opened; none where sections are the same as in the sample.
fn refused(bytes: &[u8]) -> Option<Error> {
    match contents(bytes) {
        Ok(all) => {
            assert_eq!(all, contents(&sample()).unwrap());
            None
        }
        Err(error) => Some(error),
    }
}

fn trailer(bytes: &[u8]) -> Trailer {
    Trailer::decode(bytes.last_chunk().unwrap()).0
}

/// The table's lines and the trailer changed at will, and all their checksums set right.
fn resigned(mut bytes: Vec<u8>, change: impl FnOnce(&mut [Line], &mut Trailer)) -> Vec<u8> {
    let mut end = trailer(&bytes);
    let (start, len) = (end.table_offset as usize, end.table_length as usize);
    let table = &mut bytes[start..][..len];
    let mut lines: Vec<Line> = table
        .as_chunks()
        .0
        .iter()
        .map(|entry| Line::decode(entry).0)
        .collect();
    change(&mut lines, &mut end);
    for (entry, line) in table.chunks_mut(ENTRY).zip(&lines) {
        entry.copy_from_slice(&line.encode());
    }
    resigned_bytes(bytes, end)
}

/// The checksum of the table, wherever the trailer says it is, and of the trailer set right.
fn resigned_bytes(mut bytes: Vec<u8>, mut end: Trailer) -> Vec<u8> {
    let (start, len) = (end.table_offset as usize, end.table_length as usize);
    let table = bytes.get(start..start.saturating_add(len));
    end.table_crc = table.map_or(0, crc32fast::hash);
    *bytes.last_chunk_mut().unwrap() = end.encode();
    assert!(is_sealed(bytes.last_chunk().unwrap()));
    bytes
}

fn headed(header: Header) -> Vec<u8> {
    let mut bytes = sample();
    *bytes.first_chunk_mut().unwrap() = header.encode();
    bytes
}

fn malformed(bytes: &[u8], wanted: &str) {
    let told = refused(bytes).unwrap_or_else(|| panic!("taken, in spite of: {wanted}"));
    assert!(matches!(told, Error::Malformed { .. }), "{told}");
    assert!(told.to_string().contains(wanted), "{told}");
}

#[test]
fn no_flipped_bit_goes_unnoticed() {
    let sound = sample();
    let mut bytes = sound.clone();
    for bit in 0..8 * bytes.len() {
        bytes[bit / 8] ^= 1 << (bit % 8);
        assert!(refused(&bytes).is_some(), "bit {bit}");
        bytes[bit / 8] ^= 1 << (bit % 8);
    }
    assert!(refused(&sound).is_none());
}

#[test]
fn a_file_cut_short_or_grown_is_refused() {
    let bytes = sample();
    for length in 0..bytes.len() {
        let told = refused(&bytes[..length]).unwrap();
        let right = match told {
            Error::NotAMap { .. } => length == 0,
            Error::CutShort { .. } => length > 0,
            _ => false,
        };
        assert!(right, "{length}: {told}");
    }
    for more in [1, 63, 64, 128, 5000] {
        let grown = [&bytes[..], &vec![0; more]].concat();
        assert!(matches!(refused(&grown), Some(Error::CutShort { .. })));
    }
    let twice = [&bytes[..], &bytes[..]].concat();
    let told = refused(&twice).unwrap().to_string();
    assert!(told.contains("something was added"), "{told}");
    let short = [&bytes[..64], &bytes[128..]].concat();
    let told = refused(&short).unwrap().to_string();
    let wanted = format!(
        "has {} bytes but was written with {}: cut short",
        short.len(),
        bytes.len()
    );
    assert!(told.contains(&wanted), "{told}");
}

#[test]
fn sections_that_changed_places_are_refused() {
    let bytes = made(|file| {
        file.section(*b"PNTS", 0, &[1_u8; 64]).unwrap();
        file.section(*b"PNTS", 1, &[2_u8; 64]).unwrap();
    });
    let mut swapped = bytes.clone();
    swapped[64..192].rotate_left(64);
    let file = Container::from_bytes("a", &swapped).unwrap();
    for _ in 0..2 {
        let told = file.section::<u8>(*b"PNTS", 1).unwrap_err();
        assert!(matches!(told, Error::Damaged { .. }), "{told}");
    }
    let told = file.verify_all(&mut |_, _| ()).unwrap_err().to_string();
    assert!(
        told.starts_with("a: section PNTS 0, PNTS 1: damaged"),
        "{told}"
    );
}

#[test]
fn many_damaged_sections_are_not_all_named() {
    let mut bytes = made(|file| (0..20).for_each(|i| file.section(*b"PNTS", i, &[9_u8]).unwrap()));
    (0..20).for_each(|i| bytes[64 + i * 64] = 8);
    let file = Container::from_bytes("a", &bytes).unwrap();
    let told = file.verify_all(&mut |_, _| ()).unwrap_err().to_string();
    assert!(told.contains("PNTS 7 and 12 more: damaged"), "{told}");
}

#[test]
fn other_versions_and_byte_orders_are_told() {
    let sound = Header {
        magic: *b"WINZEMAP",
        version: VERSION,
        order: ORDER_MARK,
    };
    assert!(refused(&headed(sound)).is_none());
    let version = |version| headed(Header { version, ..sound });
    assert!(matches!(
        refused(&version(0)),
        Some(Error::Older { version: 0, .. })
    ));
    let newer = version(VERSION + 1);
    let told = refused(&newer).unwrap().to_string();
    assert!(
        told.contains("has format version 2, this winze reads up to 1; update winze"),
        "{told}"
    );
    // A newer one may well end in another way.
    assert!(matches!(refused(&newer[..80]), Some(Error::Newer { .. })));
    let order = |order| headed(Header { order, ..sound });
    let swapped = order(ORDER_MARK.swap_bytes());
    assert!(matches!(refused(&swapped), Some(Error::ByteOrder { .. })));
    malformed(&order(7), "mark of the byte order");
    let mut reserved = sample();
    reserved[20] = 1;
    let crc = crc32fast::hash(&reserved[..60]);
    reserved[60..64].copy_from_slice(&crc.to_le_bytes());
    malformed(&reserved, "header: reserved bytes are not zero");
}

#[test]
fn tables_that_lie_are_refused_in_spite_of_their_checksums() {
    let change = |change: fn(&mut [Line], &mut Trailer)| resigned(sample(), change);
    assert!(refused(&change(|_, _| ())).is_none());
    let entry = |i, name| format!("section table, entry {i} ({name}): ");

    let header = change(|l, _| l[0].offset = 0);
    malformed(
        &header,
        &(entry(0, "META 0") + "begins at byte 0, before byte 64"),
    );
    let odd = change(|l, _| l[1].offset += 4);
    malformed(&odd, "no multiple of 64");
    let same = change(|l, _| l[1].offset = l[0].offset);
    malformed(
        &same,
        &(entry(1, "PNTS 0") + "begins at byte 64, before byte"),
    );
    let overlap = change(|l, _| l[0].length += 64);
    malformed(&overlap, &entry(1, "PNTS 0"));
    let gap = change(|l, _| l[2].offset += 64);
    malformed(&gap, &(entry(2, "NONE 0") + "begins at byte"));
    let table = change(|l, t| l[4].offset = t.table_offset);
    malformed(&table, "reach beyond byte");
    let beyond = change(|l, t| l[4].offset = t.total);
    malformed(&beyond, "reach beyond byte");
    let huge = change(|l, _| l[1].length = u64::MAX - 63);
    malformed(&huge, "reach beyond byte");
    let huge = change(|l, _| (l[0].offset, l[0].length) = (u64::MAX - 63, 200));
    malformed(&huge, "reach beyond byte");
    let short = change(|l, _| l[1].length -= 12);
    malformed(&short, "padding from byte 176 on is not zero");
    let missing = change(|l, _| l[4].length = 0);
    malformed(&missing, "section table: begins at byte");
    let twice = change(|l, _| l[3].id = l[1].id);
    malformed(&twice, &(entry(3, "PNTS 0") + "is there twice"));
    let order = change(|l, _| l.swap(1, 3));
    malformed(&order, "away from byte");
    let element = change(|l, _| l[1].element = 0);
    malformed(&element, "no whole number of elements of 0");
    let element = change(|l, _| l[1].element = 7);
    malformed(&element, "60 bytes are no whole number of elements of 7");
}

#[test]
fn trailers_that_lie_are_refused_in_spite_of_their_checksums() {
    let change = |change: fn(&mut Trailer)| resigned(sample(), |_, end| change(end));
    malformed(
        &change(|t| t.table_offset = 0),
        "section table: lies in the header",
    );
    malformed(&change(|t| t.table_offset += 1), "no multiple of 64");
    malformed(&change(|t| t.table_offset = t.total), "reach beyond byte");
    malformed(
        &change(|t| t.table_offset = u64::MAX - 63),
        "reach beyond byte",
    );
    malformed(&change(|t| t.table_length = u64::MAX), "reach beyond byte");
    malformed(
        &change(|t| t.table_length = u64::MAX / 40 * 40),
        "reach beyond byte",
    );
    malformed(&change(|t| t.table_length = 0), "trailer: begins at byte");
    malformed(
        &change(|t| t.table_length += 1),
        "no whole number of entries",
    );
    malformed(
        &change(|t| t.table_length -= 40),
        "trailer: begins at byte 640, away from byte 544",
    );
    let told = refused(&change(|t| t.total = u64::MAX)).unwrap();
    assert!(matches!(told, Error::CutShort { .. }), "{told}");

    let mut bytes = sample();
    let at = bytes.len() - TRAILER + 30;
    bytes[at] = 1;
    let crc = crc32fast::hash(&bytes[bytes.len() - TRAILER..bytes.len() - 4]);
    *bytes.last_chunk_mut().unwrap() = crc.to_le_bytes();
    malformed(&bytes, "trailer: reserved bytes are not zero");
    let mut bytes = sample();
    let end = trailer(&bytes);
    bytes[end.table_offset as usize + 39] = 1;
    malformed(&resigned_bytes(bytes, end), "reserved bytes are not zero");
}

/// Numbers as they stand in tables, and such as lead to overflows.
fn number() -> impl Strategy<Value = u64> {
    prop_oneof![
        (0_u64..32).prop_map(|n| n * 64),
        0_u64..2000,
        any::<u64>(),
        (0_u64..130).prop_map(|n| u64::MAX - n),
    ]
}

proptest! {
    #[test]
    fn no_bytes_cause_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let _ = contents(&bytes);
    }

    #[test]
    fn no_changed_bytes_cause_a_panic(
        patches in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        sign in any::<bool>(),
    ) {
        let mut bytes = sample();
        for (at, value) in patches {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if sign {
            let end = trailer(&bytes);
            bytes = resigned_bytes(bytes, end);
        } else {
            // Each of few bytes, so that their checksums tell.
            refused(&bytes);
        }
        let _ = contents(&bytes);
    }

    #[test]
    fn no_signed_table_causes_a_panic(
        lines in proptest::collection::vec((0_usize..5, 0_u8..4, number()), 0..4),
        ends in proptest::collection::vec((0_u8..3, number()), 0..2),
    ) {
        let bytes = resigned(sample(), |table, end| {
            for (i, field, value) in lines {
                let line = &mut table[i];
                match field {
                    0 => line.offset = value,
                    1 => line.length = value,
                    2 => line.element = value as u32,
                    _ => line.id.number = value as u32,
                }
            }
            for (field, value) in ends {
                match field {
                    0 => end.table_offset = value,
                    1 => end.table_length = value,
                    _ => end.total = value,
                }
            }
        });
        let _ = contents(&bytes);
    }
}
