//! Wavefront OBJ: `v` and `f` lines; all else is passed over.

use super::{Raw, number, quoted};

pub(super) fn read(bytes: &[u8]) -> Result<Raw, String> {
    let mut raw = Raw::default();
    let mut corners = Vec::new();
    let mut statement = String::new();
    for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let text = String::from_utf8_lossy(line);
        let text = text.split('#').next().unwrap_or_default().trim();
        // A line that ends in a backslash goes on.
        if let Some(part) = text.strip_suffix('\\') {
            statement.push_str(part);
            statement.push(' ');
            continue;
        }
        statement.push_str(text);
        let mut words = statement.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut next = || number(words.next(), i + 1);
                raw.vertices.push([next()?, next()?, next()?]);
            }
            Some("f") => {
                corners.clear();
                for word in words {
                    corners.push(corner(word, raw.vertices.len(), i + 1)?);
                }
                if corners.len() < 3 {
                    return Err(format!(
                        "line {}: a face needs three corners, this one has {}",
                        i + 1,
                        corners.len()
                    ));
                }
                raw.fan(&corners);
            }
            _ => {}
        }
        statement.clear();
    }
    Ok(raw)
}

/// The vertex that `5`, `5/2`, `5//3` or `-1` stands for, counted from 0.
fn corner(word: &str, vertices: usize, line: usize) -> Result<u32, String> {
    let index = word.split('/').next().unwrap_or_default();
    let wrong = || {
        format!(
            "line {line}: {} is no vertex, there are {vertices} before it; the file is damaged, export it again",
            quoted(word)
        )
    };
    let number: i64 = index.parse().map_err(|_| wrong())?;
    let count = i64::try_from(vertices).map_err(|_| wrong())?;
    let from_zero = if number < 0 {
        count + number
    } else {
        number - 1
    };
    if number == 0 || from_zero < 0 || from_zero >= count {
        return Err(wrong());
    }
    u32::try_from(from_zero).map_err(|_| wrong())
}
