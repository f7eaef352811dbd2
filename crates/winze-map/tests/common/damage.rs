//! Files that are damaged in every way: by accident, by a table that lies, by a forger who sets all checksums right.

use serde_json::{Value, json};
use winze::rng::Rng;

use super::{Line, assembled, lines, seal, sections, sign, sign_section, table_at, u64_at};

/// How a file was damaged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Damage {
    /// Any way that its checksums tell.
    Bytes,
    /// The table lies in one number, and its checksums were set right.
    Table,
    /// A forger set all checksums right.
    Forged,
}

/// A damaged file, what was done to it in words, and how it must be met.
pub struct Damaged {
    pub what: String,
    pub damage: Damage,
    pub bytes: Vec<u8>,
}

/// One damaged file of each `number`, always the same one.
pub fn damaged(sound: &[u8], number: u64) -> Damaged {
    let mut rng = Rng::new(4_711, number);
    let rng = &mut rng;
    let lines = lines(sound);
    let (damage, (what, bytes)) = match number % 100 {
        0..30 => (Damage::Bytes, flipped(sound, &lines, number, rng)),
        30..43 => (Damage::Bytes, overwritten(sound, rng)),
        43..50 => (Damage::Bytes, cut(sound, &lines, rng)),
        50..55 => (Damage::Bytes, exchanged(sound, &lines, rng)),
        55..60 => (Damage::Bytes, foreign(sound, rng)),
        60..72 => (Damage::Table, lying_table(sound, lines, rng)),
        72..88 => (Damage::Forged, lying_content(sound, &lines, number, rng)),
        88..91 => (Damage::Forged, rearranged(sound, rng)),
        _ => (Damage::Forged, lying_meta(sound, rng)),
    };
    Damaged {
        what: format!("{number}: {what}"),
        damage,
        bytes,
    }
}

type Made = (String, Vec<u8>);

fn pick<T: Clone>(rng: &mut Rng, from: &[T]) -> T {
    from[below(rng, from.len())].clone()
}

fn below(rng: &mut Rng, n: usize) -> usize {
    rng.below(u32::try_from(n.max(1)).unwrap()) as usize
}

/// Each section gets its share, and so do header, table, trailer and padding.
fn flipped(sound: &[u8], lines: &[Line], number: u64, rng: &mut Rng) -> Made {
    let mut bytes = sound.to_vec();
    let part = (number / 100 * 30 + number % 100) as usize % (lines.len() + 4);
    let table = table_at(sound);
    let range = match part.checked_sub(lines.len()) {
        None => lines[part].range(),
        Some(0) => 0..64,
        Some(1) => table..sound.len() - 64,
        Some(2) => sound.len() - 64..sound.len(),
        Some(_) => 0..sound.len(),
    };
    let range = if range.is_empty() { 0..64 } else { range };
    let count = if number.is_multiple_of(2) {
        1
    } else {
        1 + below(rng, 4)
    };
    let mut what = "bits flipped:".to_owned();
    for _ in 0..count {
        let (at, bit) = (range.start + below(rng, range.len()), below(rng, 8));
        bytes[at] ^= 1 << bit;
        what += &format!(" {at}.{bit}");
    }
    (what, bytes)
}

fn overwritten(sound: &[u8], rng: &mut Rng) -> Made {
    let mut bytes = sound.to_vec();
    let most = pick(rng, &[8, 100, 4096, 100_000]);
    let length = 1 + below(rng, most);
    let at = below(rng, bytes.len());
    let end = (at + length).min(bytes.len());
    match below(rng, 4) {
        0 => bytes[at..end].fill(0),
        1 => bytes[at..end].fill(0xFF),
        2 => {
            let from = below(rng, bytes.len() - (end - at));
            bytes.copy_within(from..from + end - at, at);
        }
        _ => bytes[at..end].fill_with(|| rng.next_u64() as u8),
    }
    (format!("overwritten: {at}..{end}"), bytes)
}

fn cut(sound: &[u8], lines: &[Line], rng: &mut Rng) -> Made {
    let mut bytes = sound.to_vec();
    let length = match below(rng, 4) {
        0 => below(rng, 200),
        1 => sound.len() - 1 - below(rng, 200),
        2 => pick(rng, lines).offset as usize,
        _ => below(rng, sound.len()),
    };
    bytes.truncate(length);
    if below(rng, 4) == 0 {
        // As a file system leaves it that knows the length but lost the end; or with a trailer that seems right.
        bytes.resize(sound.len(), 0);
        if below(rng, 2) == 0 {
            let end = sound.len() - 64;
            bytes[end..].copy_from_slice(&sound[end..]);
        }
    }
    (format!("cut to {length}, now {}", bytes.len()), bytes)
}

/// Two sections in each other's places, as far as both reach, or with what is behind them moved.
fn exchanged(sound: &[u8], lines: &[Line], rng: &mut Rng) -> Made {
    let (i, j) = (below(rng, lines.len()), below(rng, lines.len()));
    let (a, b) = (lines[i.min(j)], lines[i.max(j)]);
    let bytes = if below(rng, 2) == 0 {
        let mut bytes = sound.to_vec();
        let length = a.length.min(b.length) as usize;
        for k in 0..length {
            bytes.swap(a.offset as usize + k, b.offset as usize + k);
        }
        bytes
    } else {
        let (x, y) = (a.range(), b.range());
        if x == y {
            sound.to_vec()
        } else {
            [
                &sound[..x.start],
                &sound[y.clone()],
                &sound[x.end..y.start],
                &sound[x],
                &sound[y.end..],
            ]
            .concat()
        }
    };
    (format!("sections {i} and {j} exchanged"), bytes)
}

fn foreign(sound: &[u8], rng: &mut Rng) -> Made {
    let mut bytes = sound.to_vec();
    let heads: [&[u8]; 9] = [
        b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\n",
        b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n",
        b"1.0 2.0 3.0\n4.0 5.0 6.0\n",
        b"\x7fELF\x02\x01\x01\0",
        b"PK\x03\x04",
        b"\x1f\x8b\x08",
        b"LASF\0\0\0\0",
        b"winzemap",
        b"\0\0\0\0\0\0\0\0",
    ];
    let what = match below(rng, 4) {
        0 => {
            let head = pick(rng, &heads);
            bytes[..head.len()].copy_from_slice(head);
            "another format's head"
        }
        1 => {
            bytes = [pick(rng, &heads), &bytes].concat();
            "another format's head before"
        }
        2 => {
            bytes[8..12].copy_from_slice(&pick(rng, &[0, 2, 7, u32::MAX]).to_le_bytes());
            seal(&mut bytes[..64]);
            "another version"
        }
        _ => {
            bytes[12 + below(rng, 48)] ^= 1 + below(rng, 255) as u8;
            seal(&mut bytes[..64]);
            "another byte order, or something reserved"
        }
    };
    (what.to_owned(), bytes)
}

/// Numbers that lead to overflows, or near to what is there.
fn lie(was: u64, length: usize, rng: &mut Rng) -> u64 {
    match below(rng, 8) {
        0 => 0,
        1 => u64::MAX - rng.next_u64() % 130,
        2 => was.wrapping_add(64),
        3 => was.wrapping_sub(64),
        4 => was ^ 1 << below(rng, 64),
        5 => rng.next_u64(),
        6 => below(rng, length + 64) as u64 / 64 * 64,
        _ => was.wrapping_add(rng.next_u64() % 9).wrapping_sub(4),
    }
}

fn lying_table(sound: &[u8], mut lines: Vec<Line>, rng: &mut Rng) -> Made {
    let mut bytes = sound.to_vec();
    let whole = sound.len();
    let i = below(rng, lines.len());
    let other = pick(rng, &lines);
    let line = &mut lines[i];
    let was = *line;
    let field = below(rng, 7);
    match field {
        0 => line.offset = lie(was.offset, whole, rng),
        1 => line.length = lie(was.length, whole, rng),
        2 => line.tag = pick(rng, &[other.tag, *b"ABCD", [0; 4], [0xFF; 4], *b"\n\x1b[2"]),
        3 => line.number = pick(rng, &[other.number, 64, u32::MAX, was.number ^ 1]),
        4 => line.crc = pick(rng, &[other.crc, 0, was.crc ^ 1]),
        5 => line.element = pick(rng, &[0, 1, 2, 3, 4, 12, 64, u32::MAX, was.element + 1]),
        _ => {
            let end = whole - 64 + pick(rng, &[0, 8, 16]);
            let value = lie(u64_at(&bytes, end), whole, rng);
            bytes[end..end + 8].copy_from_slice(&value.to_le_bytes());
            seal(&mut bytes[whole - 64..]);
            return (format!("trailer: {value} at {end}"), bytes);
        }
    }
    let what = format!("{was:?} as {:?}", lines[i]);
    sign(&mut bytes, &lines);
    (what, bytes)
}

/// Four bytes, of which one makes the numbers that an index or a length could be, or the floats that spoil sums.
fn word(rng: &mut Rng) -> [u8; 4] {
    let floats = [
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        1e30,
        -1e18,
        1e-40,
        0.0,
        -0.0,
        1.0,
    ];
    match below(rng, 4) {
        0 => pick(rng, &floats).to_le_bytes(),
        1 => (below(rng, 5000) as u32).to_le_bytes(),
        2 => pick(rng, &[0, 1, 2, 3, 4, u32::MAX, u32::MAX - 1, 1 << 31]).to_le_bytes(),
        _ => (rng.next_u64() as u32).to_le_bytes(),
    }
}

fn lying_content(sound: &[u8], lines: &[Line], number: u64, rng: &mut Rng) -> Made {
    let mut bytes = sound.to_vec();
    let i = (number / 100 * 16 + number % 100) as usize % lines.len();
    let range = lines[i].range();
    let words = range.len() / 4;
    let mut what = format!("forged in section {i} ({}):", lines[i].tag.escape_ascii());
    match below(rng, 6) {
        _ if words == 0 => {}
        0 => {
            let value = word(rng);
            for w in 0..words {
                bytes[range.start + 4 * w..][..4].copy_from_slice(&value);
            }
            what += &format!(" all {value:?}");
        }
        1 => {
            bytes[range.clone()].fill_with(|| rng.next_u64() as u8);
            what += " noise";
        }
        2 => {
            // Elements in other places: each is sound by itself.
            let size = lines[i].element as usize;
            let elements = range.len() / size;
            let by = below(rng, elements) * size;
            bytes[range.clone()].rotate_left(by);
            what += &format!(" rotated by {by} bytes");
        }
        _ => {
            let most = pick(rng, &[1, 4, 100]);
            for _ in 0..1 + below(rng, most) {
                let w = below(rng, words);
                // Signs and exponents of doubles are in the upper word.
                let value = word(rng);
                bytes[range.start + 4 * w..][..4].copy_from_slice(&value);
                what += &format!(" {w}={value:?}");
            }
        }
    }
    sign_section(&mut bytes, i);
    (what, bytes)
}

/// Sections with others' contents, left out, cut, doubled, or in another order.
fn rearranged(sound: &[u8], rng: &mut Rng) -> Made {
    let mut all = sections(sound);
    let (i, j) = (below(rng, all.len()), below(rng, all.len()));
    let what = match below(rng, 6) {
        0 => {
            (all[i].1, all[j].1) = (all[j].1.clone(), all[i].1.clone());
            "contents exchanged"
        }
        1 => {
            all.remove(i);
            "left out"
        }
        2 => {
            let size = all[i].0.element as usize;
            let elements = all[i].1.len() / size;
            all[i].1.truncate(below(rng, elements) * size);
            "cut by whole elements"
        }
        3 => {
            let content = all[i].1.clone();
            all[i].1.extend(content);
            "doubled"
        }
        4 => {
            all.swap(i, j);
            "in another order"
        }
        _ => {
            all[i].1.clear();
            "emptied"
        }
    };
    let what = format!("sections {i} and {j}: {what}");
    (what, assembled(sound, &all))
}

fn lying_meta(sound: &[u8], rng: &mut Rng) -> Made {
    let mut all = sections(sound);
    let content = &mut all.iter_mut().find(|(l, _)| l.tag == *b"META").unwrap().1;
    let mut meta: Value = serde_json::from_slice(content).unwrap();
    let mut what = "META:".to_owned();
    if below(rng, 6) == 0 {
        what += &raw_lie(content, rng);
        return (what, assembled(sound, &all));
    }
    for _ in 0..pick(rng, &[1, 1, 1, 3]) {
        let mut paths = Vec::new();
        places(&meta, String::new(), &mut paths);
        let place = pick(rng, &paths);
        let (parent, name) = place.rsplit_once('/').unwrap();
        if below(rng, 6) == 0 {
            match meta.pointer_mut(parent) {
                Some(Value::Object(o)) => drop(o.remove(name)),
                Some(Value::Array(a)) => drop(a.remove(name.parse().unwrap())),
                _ => {}
            }
            what += &format!(" {place} removed");
            continue;
        }
        let was = meta.pointer_mut(&place).unwrap();
        let lie = value(was, rng);
        let shown = lie.to_string();
        what += &format!(" {place}={}", shown.get(..80).unwrap_or(&shown));
        *was = lie;
    }
    *content = serde_json::to_vec(&meta).unwrap();
    (what, assembled(sound, &all))
}

/// A value in the place of another.
fn value(was: &Value, rng: &mut Rng) -> Value {
    if let (Some(number), true) = (was.as_f64(), below(rng, 3) == 0) {
        let factor = pick(rng, &[0.5, 2.0, 1e-3, 1e3, -1.0]);
        return if was.is_f64() {
            json!(number * factor)
        } else {
            json!((number * factor) as i64)
        };
    }
    let doubled = |a: &Vec<Value>| Value::Array([&a[..], &a[..]].concat());
    match below(rng, 15) {
        0 => json!(0),
        1 => json!(-1),
        2 => json!(1e-300),
        3 => json!(1e300),
        4 => json!(9.9e5),
        5 => json!(1e-9),
        6 => json!(u64::MAX),
        7 => json!(i64::MIN),
        8 => Value::Null,
        9 => json!("text\n\u{1b}[31m"),
        10 => json!([]),
        11 => json!({}),
        12 => json!(true),
        13 => was.as_array().map_or(json!("3 voxels"), doubled),
        _ => Value::Array(vec![was.clone(); 1 + below(rng, 100)]),
    }
}

/// What no value can express.
fn raw_lie(content: &mut Vec<u8>, rng: &mut Rng) -> String {
    let text = String::from_utf8(content.clone()).unwrap();
    let n = pick(rng, &[100, 1_000, 5_000, 30_000, 200_000]);
    let (what, text) = match below(rng, 8) {
        0 => ("1e999", text.replacen("0.", "1e999, 0.", 1)),
        1 => ("deep", format!("{{\"levels\": {}", "[".repeat(100_000))),
        2 => ("deep objects", "{\"a\":".repeat(50_000)),
        3 => {
            let many = format!("\"ndt_sizes\": [{}", "1,".repeat(n));
            ("many numbers", text.replacen("\"ndt_sizes\": [", &many, 1))
        }
        4 => {
            let one = "[\"\",\"\",0,\"\",0,[0,0,0],null],";
            let many = format!("\"sources\": [{}", one.repeat(n / 10));
            ("many sources", text.replacen("\"sources\": [", &many, 1))
        }
        5 => {
            let long = format!("\"winze\": \"\\u0001{}", "\\u0007".repeat(n / 40));
            ("a long text", text.replacen("\"winze\": \"", &long, 1))
        }
        6 => {
            let long = format!("\"seed\": \"{}\", \"x", "\\u0007".repeat(n / 40));
            (
                "a long text for a number",
                text.replacen("\"seed", &long, 1),
            )
        }
        _ => ("no end", text[..below(rng, text.len())].to_owned()),
    };
    *content = text.into_bytes();
    format!(" {what}, {n}")
}

/// All places in a value, as JSON pointers.
fn places(value: &Value, at: String, into: &mut Vec<String>) {
    let mut inner = |name: String, v: &Value| {
        let place = format!("{at}/{name}");
        into.push(place.clone());
        places(v, place, into);
    };
    match value {
        Value::Object(o) => o.iter().for_each(|(k, v)| inner(k.clone(), v)),
        Value::Array(a) => (0..)
            .zip(a)
            .for_each(|(i, v): (usize, _)| inner(i.to_string(), v)),
        _ => {}
    }
}
