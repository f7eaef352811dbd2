//! Stereolithography files: triangles without shared vertices, as text or binary.

use super::{Merged, Raw, number, quoted};

/// A text before the number of triangles in a binary file.
const HEADER: usize = 80;
/// A binary triangle: normal, three corners, two bytes more.
const TRIANGLE: usize = 50;

pub(super) fn read(bytes: &[u8]) -> Result<Raw, String> {
    let declared = bytes
        .get(HEADER..HEADER + 4)
        .and_then(|b| b.try_into().ok())
        .map(u32::from_le_bytes);
    let is_binary = declared.is_some_and(|n| size_of(n) == Some(bytes.len()));
    // Binary files, too, begin with "solid" at times.
    let text_start = bytes.trim_ascii_start();
    let is_text = text_start
        .get(..5)
        .is_some_and(|w| w.eq_ignore_ascii_case(b"solid"));
    if is_text && !is_binary {
        return ascii(bytes);
    }
    let Some(declared) = declared else {
        return Err("too short for an STL file: copy or export it again".into());
    };
    binary(bytes.get(HEADER + 4..).unwrap_or_default(), declared)
}

fn size_of(triangles: u32) -> Option<usize> {
    usize::try_from(triangles)
        .ok()?
        .checked_mul(TRIANGLE)?
        .checked_add(HEADER + 4)
}

fn binary(body: &[u8], declared: u32) -> Result<Raw, String> {
    let held = body.len() / TRIANGLE;
    let declared = declared as usize;
    if held < declared {
        return Err(format!(
            "ends too early: {declared} triangles announced, {held} there; copy or export it again"
        ));
    }
    let mut raw = Raw::default();
    let mut merged = Merged::default();
    for triangle in body.chunks_exact(TRIANGLE).take(declared) {
        let mut coordinates = triangle.chunks_exact(4).skip(3).map(|b| {
            let bytes = b.try_into().unwrap_or_default();
            f64::from(f32::from_le_bytes(bytes))
        });
        let mut next = || coordinates.next().unwrap_or(f64::NAN);
        let corners: [[f64; 3]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
        let t = corners.map(|v| merged.add(&mut raw.vertices, v));
        raw.triangles.push(t);
    }
    Ok(raw)
}

fn ascii(bytes: &[u8]) -> Result<Raw, String> {
    let mut raw = Raw::default();
    let mut merged = Merged::default();
    let mut corners: Vec<u32> = Vec::new();
    // Whether the last solid and the last facet have been closed.
    let (mut ended, mut open) = (true, false);
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_ascii_whitespace();
        let Some(word) = words.next() else { continue };
        match word.to_ascii_lowercase().as_str() {
            "solid" => ended = false,
            "facet" => {
                corners.clear();
                open = true;
            }
            "vertex" => {
                let mut next = || number(words.next(), i + 1);
                let v = [next()?, next()?, next()?];
                corners.push(merged.add(&mut raw.vertices, v));
            }
            "endfacet" => {
                if corners.len() < 3 || !open {
                    return Err(format!(
                        "line {}: the facet that ends here has {} corners",
                        i + 1,
                        corners.len()
                    ));
                }
                raw.fan(&corners);
                open = false;
            }
            "outer" | "endloop" => {}
            "endsolid" => ended = true,
            _ => {
                return Err(format!(
                    "line {}: {} is no STL; the file is damaged, export it again",
                    i + 1,
                    quoted(word)
                ));
            }
        }
    }
    if open || !ended {
        return Err("ends too early, without `endsolid`: copy or export it again".into());
    }
    Ok(raw)
}
