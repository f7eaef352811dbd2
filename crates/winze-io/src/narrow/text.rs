//! Points in lines of text.

use std::io::Read;

use rayon::prelude::*;

use super::{Narrow, Seen, Source, narrow, onwards};
use crate::columns::{Columns, Row};
use crate::lines::{pieces, quick_number};

/// Text is read this many bytes at a time, and parsed in pieces.
const TEXT_BLOCK: usize = 1 << 20;
const TEXT_PIECE: usize = 1 << 17;
/// Longer lines are for the other decoders.
const LONGEST_LINE: usize = 16 << 20;

/// Which number of a line goes where: an axis, the intensity (3), or nowhere (4).
pub(crate) struct Line {
    slots: Vec<usize>,
}

impl Line {
    /// Of so many columns. `None` where they are too many to be looked at one by one.
    pub(crate) fn new(wanted: Columns, columns: u64) -> Option<Self> {
        let columns = usize::try_from(columns).ok().filter(|&n| n <= 64)?;
        let slot = |column: usize| {
            let axis = wanted.xyz.iter().position(|&c| c == column);
            axis.unwrap_or(if wanted.intensity == Some(column) {
                3
            } else {
                4
            })
        };
        Some(Self {
            slots: (0..columns).map(slot).collect(),
        })
    }

    /// The numbers of the first line of `text`, and what follows it. `None` where it is not just as many plain numbers
    /// as there are columns.
    #[inline]
    fn parse<'a>(&self, text: &'a [u8]) -> Option<([f64; 4], &'a [u8])> {
        // A remark, or a line that is trimmed otherwise.
        let first = text.iter().find(|b| !matches!(b, b' ' | b'\t'));
        if matches!(first, None | Some(b'#')) {
            return None;
        }
        let mut values = [0.0; 4];
        let mut rest = text;
        for &slot in &self.slots {
            while let [b' ' | b'\t', tail @ ..] = rest {
                rest = tail;
            }
            let before = rest;
            if let Some(value) = values.get_mut(slot) {
                (*value, rest) = quick_number(rest)?;
            } else {
                while let [byte, tail @ ..] = rest
                    && !byte.is_ascii_whitespace()
                    && *byte != 0x0b
                {
                    rest = tail;
                }
            }
            let ends = matches!(rest, [] | [b' ' | b'\t' | b'\r' | b'\n', ..]);
            if rest.len() == before.len() || !ends {
                return None;
            }
        }
        while let [b' ' | b'\t', tail @ ..] = rest {
            rest = tail;
        }
        match rest {
            [] => Some((values, rest)),
            [b'\n', tail @ ..] | [b'\r', b'\n', tail @ ..] => Some((values, tail)),
            _ => None,
        }
    }
}

/// Reads lines from `start` on, of which `expected` hold points. Those that `line` does not take go to `parse`. `None`
/// where that refuses one.
pub(crate) fn text(
    source: &dyn Source,
    start: u64,
    expected: usize,
    with_intensity: bool,
    line: &Line,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String> + Sync,
) -> Option<Narrow> {
    let mut all = Narrow {
        intensity: with_intensity.then(Vec::new),
        ..Narrow::default()
    };
    // A point takes at least two bytes a column.
    let left = source.length().saturating_sub(start);
    let most = usize::try_from(left).ok()? / (2 * line.slots.len().max(1)) + 1;
    all.points.reserve_exact(expected.min(most));
    if let Some(intensity) = &mut all.intensity {
        intensity.reserve_exact(expected.min(most));
    }
    let mut input = onwards(source, start);
    let mut held = Vec::new();
    loop {
        let had = held.len();
        held.resize(had + TEXT_BLOCK, 0);
        let mut filled = had;
        while let Some(room) = held.get_mut(filled..).filter(|room| !room.is_empty()) {
            match input.read(room).ok()? {
                0 => break,
                read => filled += read,
            }
        }
        let ended = filled < held.len();
        held.truncate(filled);
        // What was held before has no end of a line.
        let last = held
            .get(had..)
            .and_then(|new| new.iter().rposition(|&b| b == b'\n'));
        let end = match last {
            _ if ended => held.len(),
            Some(last) => had + last + 1,
            None if held.len() > LONGEST_LINE => return None,
            None => 0,
        };
        let block = held.get(..end).unwrap_or_default();
        let parts: Vec<Option<(Narrow, Seen)>> = pieces(block, 0, TEXT_PIECE)
            .into_par_iter()
            .map(|(_, piece)| {
                winze::cancel::check();
                text_piece(piece, with_intensity, line, &parse)
            })
            .collect();
        for part in parts {
            let (part, seen) = part?;
            if seen.wide {
                return None;
            }
            all.points.extend_from_slice(&part.points);
            if let (Some(all), Some(part)) = (&mut all.intensity, part.intensity) {
                all.extend_from_slice(&part);
            }
            all.zeros += seen.zeros;
            all.broken |= seen.broken;
        }
        if ended {
            return (!all.points.is_empty()).then_some(all);
        }
        held.drain(..end);
    }
}

fn text_piece(
    piece: &[u8],
    with_intensity: bool,
    line: &Line,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String>,
) -> Option<(Narrow, Seen)> {
    let mut out = Narrow {
        intensity: with_intensity.then(Vec::new),
        ..Narrow::default()
    };
    let mut rest = piece;
    let mut wide = false;
    while !rest.is_empty() {
        let [x, y, z, intensity] = match line.parse(rest) {
            Some((values, tail)) => {
                rest = tail;
                values
            }
            None => {
                let end = rest.iter().position(|&b| b == b'\n');
                let (line, tail) = rest.split_at(end.map_or(rest.len(), |at| at + 1));
                rest = tail;
                match parse(line.trim_ascii()).ok()? {
                    None => continue,
                    Some(row) => {
                        let [x, y, z] = row.point;
                        [x, y, z, f64::from(row.intensity)]
                    }
                }
            }
        };
        out.points.push([x, y, z].map(|v| {
            let (short, far) = narrow(v);
            wide |= far;
            short
        }));
        if let Some(all) = &mut out.intensity {
            all.push(intensity as f32);
        }
    }
    let mut seen = Seen::of(&out.points);
    seen.wide |= wide;
    Some((out, seen))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_parsed_only_where_they_are_plain() {
        let wanted = Columns {
            xyz: [1, 2, 3],
            intensity: Some(0),
        };
        let line = Line::new(wanted, 5).unwrap();
        let parse = |text: &'static str| line.parse(text.as_bytes());
        let values = [1.0, 2.5, -3.0, 9.0];
        assert_eq!(parse(" 9 1\t2.5  -3 a \r\nb"), Some((values, &b"b"[..])));
        assert_eq!(parse("9 1 2.5 -3 a"), Some((values, &b""[..])));
        for odd in [
            "",
            "9 1 2.5 -3\na",
            "9 1 2.5 -3 a b\n",
            "9 1 2.5 -3x a",
            "nan 1 2 3 4",
            "# 1",
        ] {
            assert_eq!(parse(odd), None, "{odd}");
        }
        assert!(Line::new(wanted, 65).is_none());
    }

    #[test]
    fn a_line_is_all_that_is_looked_at() {
        let wanted = Columns {
            xyz: [0, 1, 2],
            intensity: None,
        };
        let line = Line::new(wanted, 3).unwrap();
        // Minutes, were each blank line to look at all that follow it.
        let mut text = vec![b'\n'; 4 << 20];
        text.extend(b"1 2 3");
        let parse = |line: &[u8]| match line {
            [] => Ok(None),
            _ => Err("not blank".to_owned()),
        };
        let narrow = super::text(&&text[..], 0, 1, false, &line, parse).unwrap();
        assert_eq!(narrow.points, [[1.0, 2.0, 3.0]]);
    }
}
