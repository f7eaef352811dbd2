//! The checks of a container's frame: everything but what is in the sections.
//!
//! They take time and memory in proportion to the number of sections. Sections, table and trailer
//! must follow each other as closely as their alignment allows, with zeros in between, so that each
//! byte of a file is under some check.

use std::collections::BTreeMap;

use super::layout::{
    ALIGN, END_MAGIC, ENTRY, HEADER, Header, Id, Line, MAGIC, OLDEST, ORDER_MARK, TRAILER, Trailer,
    VERSION, aligned, is_sealed,
};
use crate::error::{Error, Result};

/// What is where.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Frame {
    /// In the order of the file.
    pub(super) lines: Vec<Line>,
    pub(super) by_id: BTreeMap<Id, usize>,
}

/// Checks the frame of `bytes`, which are the whole of `file`.
pub(super) fn frame(file: &str, bytes: &[u8]) -> Result<Frame> {
    let parse = Parse { file, bytes };
    parse.header()?;
    let trailer = parse.trailer()?;
    let table = parse.table(&trailer)?;
    let mut lines = Vec::with_capacity(table.len());
    let mut by_id = BTreeMap::new();
    let mut end = HEADER as u64;
    for (i, entry) in table.iter().enumerate() {
        let (line, reserved) = Line::decode(entry);
        let place = || format!("section table, entry {i} ({})", line.id);
        if !reserved {
            return Err(parse.malformed(place(), "reserved bytes are not zero"));
        }
        if line.element == 0 || line.length % u64::from(line.element) != 0 {
            let (length, element) = (line.length, line.element);
            let problem = format!("{length} bytes are no whole number of elements of {element}");
            return Err(parse.malformed(place(), problem));
        }
        end = span(line.offset, line.length, trailer.table_offset)
            .and_then(|next_end| parse.joined(end, line.offset).map(|()| next_end))
            .map_err(|problem| parse.malformed(place(), problem))?;
        if by_id.insert(line.id, i).is_some() {
            return Err(parse.malformed(place(), "is there twice"));
        }
        lines.push(line);
    }
    parse
        .joined(end, trailer.table_offset)
        .map_err(|problem| parse.malformed("section table", problem))?;
    Ok(Frame { lines, by_id })
}

struct Parse<'a> {
    file: &'a str,
    bytes: &'a [u8],
}

impl<'a> Parse<'a> {
    fn malformed(&self, place: impl Into<String>, problem: impl Into<String>) -> Error {
        Error::Malformed {
            file: self.file.into(),
            place: place.into(),
            problem: problem.into(),
        }
    }

    fn damaged(&self, section: &str) -> Error {
        Error::Damaged {
            file: self.file.into(),
            section: section.into(),
        }
    }

    fn cut_short(&self, problem: impl Into<String>) -> Error {
        Error::CutShort {
            file: self.file.into(),
            problem: problem.into(),
        }
    }

    fn header(&self) -> Result<()> {
        let file = || self.file.to_owned();
        if !self.bytes.starts_with(&MAGIC) {
            return Err(match self.bytes.len() {
                1.. if MAGIC.starts_with(self.bytes) => self.cut_short("ends within its header"),
                _ => Error::NotAMap {
                    file: file(),
                    problem: instead(self.bytes).into(),
                },
            });
        }
        let Some(bytes) = self.bytes.first_chunk() else {
            return Err(self.cut_short("ends within its header"));
        };
        if !is_sealed(bytes) {
            return Err(self.damaged("header"));
        }
        // The header is the same in all versions up to here; what is reserved need not be.
        let (header, reserved) = Header::decode(bytes);
        if header.order == ORDER_MARK.swap_bytes() {
            return Err(Error::ByteOrder { file: file() });
        }
        let version = header.version;
        if version > VERSION {
            return Err(Error::Newer {
                file: file(),
                version,
                known: VERSION,
            });
        }
        if version < OLDEST {
            return Err(Error::Older {
                file: file(),
                version,
                known: OLDEST,
            });
        }
        if header.order != ORDER_MARK {
            return Err(self.malformed("header", "its mark of the byte order is unknown"));
        }
        if !reserved {
            return Err(self.malformed("header", "reserved bytes are not zero"));
        }
        Ok(())
    }

    fn trailer(&self) -> Result<Trailer> {
        let length = self.bytes.len() as u64;
        let unended = "does not end as a map does: it was cut short, or something was appended";
        let Some((_, bytes)) = self
            .bytes
            .split_last_chunk::<TRAILER>()
            .filter(|(before, _)| before.len() >= HEADER)
        else {
            return Err(self.cut_short(unended));
        };
        let (trailer, reserved) = Trailer::decode(bytes);
        if trailer.magic != END_MAGIC {
            return Err(self.cut_short(unended));
        }
        if !is_sealed(bytes) {
            return Err(self.damaged("trailer"));
        }
        if trailer.total != length {
            let change = if length < trailer.total {
                "cut short"
            } else {
                "something was added"
            };
            return Err(self.cut_short(format!(
                "has {length} bytes but was written with {}: {change}",
                trailer.total
            )));
        }
        if !reserved {
            return Err(self.malformed("trailer", "reserved bytes are not zero"));
        }
        Ok(trailer)
    }

    /// The entries of the table: as many as the file has bytes for, whatever the trailer claims.
    fn table(&self, trailer: &Trailer) -> Result<&'a [[u8; ENTRY]]> {
        let limit = (self.bytes.len() - TRAILER) as u64;
        let (offset, length) = (trailer.table_offset, trailer.table_length);
        let end = match span(offset, length, limit) {
            Ok(end) if offset >= HEADER as u64 => end,
            Ok(_) => return Err(self.malformed("section table", "lies in the header")),
            Err(problem) => return Err(self.malformed("section table", problem)),
        };
        self.joined(end, limit)
            .map_err(|problem| self.malformed("trailer", problem))?;
        let table = self.slice(offset, end);
        if crc32fast::hash(table) != trailer.table_crc {
            return Err(self.damaged("section table"));
        }
        match table.as_chunks() {
            (entries, []) => Ok(entries),
            _ => {
                let problem = format!("its {length} bytes are no whole number of entries");
                Err(self.malformed("section table", problem))
            }
        }
    }

    /// Whether what begins at `next` is as near to the `end` of what is before it as it can be, with
    /// zeros in between.
    fn joined(&self, end: u64, next: u64) -> std::result::Result<(), String> {
        if next < end {
            return Err(format!(
                "begins at byte {next}, before byte {end}, where what is before it ends"
            ));
        }
        if aligned(end) != Some(next) {
            return Err(format!(
                "begins at byte {next}, away from byte {end}, where what is before it ends"
            ));
        }
        if self.slice(end, next).iter().any(|&b| b != 0) {
            return Err(format!("the padding from byte {end} on is not zero"));
        }
        Ok(())
    }

    /// The bytes from `start` to `end`; none where they are not in the file.
    fn slice(&self, start: u64, end: u64) -> &'a [u8] {
        slice(self.bytes, start, end).unwrap_or_default()
    }
}

/// The bytes from `start` to `end`, where they are there.
pub(super) fn slice(bytes: &[u8], start: u64, end: u64) -> Option<&[u8]> {
    bytes.get(usize::try_from(start).ok()?..usize::try_from(end).ok()?)
}

/// The end of `length` bytes at `offset`, where both are in order and `limit` is not passed.
fn span(offset: u64, length: u64, limit: u64) -> std::result::Result<u64, String> {
    if !offset.is_multiple_of(ALIGN) {
        return Err(format!(
            "begins at byte {offset}, which is no multiple of {ALIGN}"
        ));
    }
    match offset.checked_add(length) {
        Some(end) if end <= limit => Ok(end),
        _ => Err(format!(
            "{length} bytes from byte {offset} on reach beyond byte {limit}, where they must end"
        )),
    }
}

/// What a file is instead of a map, as far as its first bytes tell.
fn instead(bytes: &[u8]) -> &'static str {
    let text = bytes.split_at_checked(16).map_or(bytes, |(start, _)| start);
    if bytes.is_empty() {
        "it is empty"
    } else if text.starts_with(b"# .PCD") || text.starts_with(b"VERSION") {
        "it is a point cloud in the PCD format"
    } else if text.starts_with(b"ply\n") || text.starts_with(b"ply\r") {
        "it is a point cloud in the PLY format"
    } else {
        "it does not begin as one does"
    }
}
