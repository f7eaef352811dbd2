//! The values of a PCD header's lines.

use crate::columns::shortened;
use crate::error::{Fault, Place};
use crate::scalar::Scalar;

/// A header line's values with the line's number.
pub(super) type Values<'a> = (usize, Vec<&'a str>);

/// How the points follow the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Data {
    Ascii,
    Binary,
    Compressed,
}

impl Data {
    /// The name in the header.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Binary => "binary",
            Self::Compressed => "binary_compressed",
        }
    }
}

/// One value a field: those of the line, or `default` where the line is absent.
pub(super) fn list<'a>(
    values: Option<Values<'a>>,
    keyword: &str,
    fields_line: usize,
    fields: usize,
    default: &'a str,
) -> Result<Values<'a>, Fault> {
    let Some((line, values)) = values else {
        return Ok((fields_line, vec![default; fields]));
    };
    if values.len() != fields {
        return Err(Fault::malformed(
            Place::Line(line),
            format!(
                "{keyword} has {} values but FIELDS names {fields}; give one a field",
                values.len()
            ),
        ));
    }
    Ok((line, values))
}

pub(super) fn scalar(
    kinds: &Values<'_>,
    sizes: &Values<'_>,
    field: usize,
) -> Result<Scalar, Fault> {
    let kind = kinds.1.get(field).copied().unwrap_or_default();
    let size = sizes.1.get(field).copied().unwrap_or_default();
    Ok(match (kind, size) {
        ("I" | "i", "1") => Scalar::I8,
        ("I" | "i", "2") => Scalar::I16,
        ("I" | "i", "4") => Scalar::I32,
        ("I" | "i", "8") => Scalar::I64,
        ("U" | "u", "1") => Scalar::U8,
        ("U" | "u", "2") => Scalar::U16,
        ("U" | "u", "4") => Scalar::U32,
        ("U" | "u", "8") => Scalar::U64,
        ("F" | "f", "4") => Scalar::F32,
        ("F" | "f", "8") => Scalar::F64,
        _ => {
            return Err(Fault::malformed(
                Place::Line(sizes.0),
                format!(
                    "TYPE {} with SIZE {} is no PCD type; known are I and U with 1, 2, 4 or 8 and F with 4 or 8",
                    shortened(kind, 20),
                    shortened(size, 20)
                ),
            ));
        }
    })
}

pub(super) fn count(counts: &Values<'_>, field: usize) -> Result<u64, Fault> {
    let word = counts.1.get(field).copied().unwrap_or_default();
    word.parse().ok().filter(|&n| n > 0).ok_or_else(|| {
        Fault::malformed(
            Place::Line(counts.0),
            format!(
                "COUNT '{}' is not a whole number above 0",
                shortened(word, 20)
            ),
        )
    })
}

/// A single whole number, with its line.
pub(super) fn number((line, values): Values<'_>, keyword: &str) -> Result<(u64, usize), Fault> {
    let word = values.first().copied().unwrap_or_default();
    let value = word.parse().map_err(|_| {
        Fault::malformed(
            Place::Line(line),
            format!("{keyword} '{}' is not a whole number", shortened(word, 20)),
        )
    })?;
    Ok((value, line))
}

pub(super) fn viewpoint(values: &[&str]) -> Option<[f64; 7]> {
    let parsed: Option<Vec<f64>> = values.iter().map(|w| w.parse().ok()).collect();
    let seven: [f64; 7] = parsed?.try_into().ok()?;
    seven.iter().all(|v| v.is_finite()).then_some(seven)
}

pub(super) fn data(line: usize, word: Option<&str>) -> Result<Data, Fault> {
    match word {
        Some("ascii") => Ok(Data::Ascii),
        Some("binary") => Ok(Data::Binary),
        Some("binary_compressed") => Ok(Data::Compressed),
        other => Err(Fault::malformed(
            Place::Line(line),
            format!(
                "DATA '{}' is unknown; known are ascii, binary and binary_compressed",
                shortened(other.unwrap_or_default(), 30)
            ),
        )),
    }
}
