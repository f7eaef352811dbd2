//! Numbers in lines of text, a million lines at a time.

use std::io::{self, Read};

use rayon::prelude::*;

use crate::columns::{Row, excerpt};
use crate::error::{Fault, Place};

/// Text is parsed in pieces of about this many bytes. Fixed, so that the pieces do not depend on
/// the number of threads.
const PIECE: usize = 1 << 20;

/// A decimal number, `nan` or `inf` with or without a sign, or one of the spellings of "not a
/// number" of older C libraries (`1.#QNAN`, `-nan(ind)`).
pub(crate) fn number(token: &[u8]) -> Option<f64> {
    if let Some((value, [])) = quick_number(token) {
        return Some(value);
    }
    let text = std::str::from_utf8(token).ok()?;
    if let Ok(value) = text.parse() {
        return Some(value);
    }
    let odd = text.trim_start_matches(['+', '-']).to_ascii_lowercase();
    if odd.starts_with("1.#inf") {
        Some(f64::INFINITY)
    } else if odd.starts_with("1.#") || odd.starts_with("nan(") {
        Some(f64::NAN)
    } else {
        None
    }
}

/// The powers of ten that a 64-bit float holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// The number at the start of `text`, and what follows its last digit or point. Only where it is plain: digits that make
/// a whole number which a float holds exactly, with a point among them or not. It and the power of ten are both exact then,
/// so that their quotient is the nearest float, as it should be. `None` says nothing.
#[inline]
pub(crate) fn quick_number(text: &[u8]) -> Option<(f64, &[u8])> {
    let (negative, mut rest) = match text {
        [b'-', rest @ ..] => (true, rest),
        _ => (false, text),
    };
    let mut whole = 0u64;
    let before = rest.len();
    while let [digit @ b'0'..=b'9', tail @ ..] = rest {
        whole = whole.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
        rest = tail;
    }
    let mut digits = before - rest.len();
    let mut scale = 0;
    if let [b'.', tail @ ..] = rest {
        rest = tail;
        while let [digit @ b'0'..=b'9', tail @ ..] = rest {
            whole = whole.wrapping_mul(10).wrapping_add(u64::from(digit - b'0'));
            rest = tail;
        }
        scale = tail.len() - rest.len();
        digits += scale;
    }
    // Of up to 19 digits, none was lost.
    if digits == 0 || digits > 19 || whole > 1 << 53 {
        return None;
    }
    let value = whole as f64 / POWERS.get(scale)?;
    Some((if negative { -value } else { value }, rest))
}

/// The tokens of a line that stand between blanks or tabs.
pub(crate) fn blank_separated(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(|b| matches!(b, b' ' | b'\t'))
        .filter(|token| !token.is_empty())
}

/// The points of many lines.
#[derive(Debug, Default)]
pub(crate) struct Rows {
    pub(crate) points: Vec<[f64; 3]>,
    pub(crate) intensity: Vec<f32>,
}

/// Parses all of `bytes` from `start` on, a row a line; lines for which `parse` gives `None` hold
/// none. Intensities are kept only if asked for.
///
/// # Errors
/// The first line in the file that `parse` refuses, with its number and an excerpt.
pub(crate) fn parse_rows(
    bytes: &[u8],
    start: usize,
    with_intensity: bool,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String> + Sync,
) -> Result<Rows, Fault> {
    let pieces = parse_pieces(bytes, start, PIECE, with_intensity, parse);
    let mut all = Rows::default();
    for piece in pieces {
        let piece = piece.map_err(|(offset, problem)| {
            Fault::Malformed(Place::Line(line_number(bytes, offset)), problem)
        })?;
        if all.points.is_empty() {
            all = piece;
        } else {
            all.points.extend(piece.points);
            all.intensity.extend(piece.intensity);
        }
    }
    Ok(all)
}

/// The rows of each piece, or where in `bytes` the first line begins that is refused, and why.
type Pieces = Vec<Result<Rows, (usize, String)>>;

fn parse_pieces(
    bytes: &[u8],
    start: usize,
    size: usize,
    with_intensity: bool,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String> + Sync,
) -> Pieces {
    pieces(bytes, start, size)
        .into_par_iter()
        .map(|(offset, piece)| {
            winze::cancel::check();
            parse_piece(offset, piece, with_intensity, &parse)
        })
        .collect()
}

/// Cuts `bytes` from `start` on at the first line end `size` bytes or more after each cut.
pub(crate) fn pieces(bytes: &[u8], start: usize, size: usize) -> Vec<(usize, &[u8])> {
    let mut out = Vec::new();
    let mut offset = start;
    while let Some(rest) = bytes.get(offset..).filter(|rest| !rest.is_empty()) {
        let end = rest
            .get(size..)
            .and_then(|tail| tail.iter().position(|&b| b == b'\n'))
            .map_or(rest.len(), |at| size + at + 1);
        let (piece, _) = rest.split_at(end);
        out.push((offset, piece));
        offset += end;
    }
    out
}

fn parse_piece(
    offset: usize,
    piece: &[u8],
    with_intensity: bool,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String>,
) -> Result<Rows, (usize, String)> {
    let mut rows = Rows::default();
    let mut at = offset;
    for line in piece.split_inclusive(|&b| b == b'\n') {
        let content = line.trim_ascii();
        match parse(content) {
            Ok(Some(row)) => {
                rows.points.push(row.point);
                if with_intensity {
                    rows.intensity.push(row.intensity);
                }
            }
            Ok(None) => {}
            Err(problem) => {
                return Err((at, format!("{problem}, in \"{}\"", excerpt(content))));
            }
        }
        at += line.len();
    }
    Ok(rows)
}

/// The number, from 1, of the line that holds byte `offset`.
pub(crate) fn line_number(bytes: &[u8], offset: usize) -> usize {
    let before = bytes.get(..offset).unwrap_or(bytes);
    1 + before.iter().filter(|&&b| b == b'\n').count()
}

/// Where the first `count` lines of `bytes` that are not blank end; `Err` with their number where
/// there are fewer.
pub(crate) fn skip_lines(bytes: &[u8], count: u64) -> Result<usize, u64> {
    let mut end = 0;
    let mut seen = 0;
    let mut lines = bytes.split_inclusive(|&b| b == b'\n');
    while seen < count {
        let line = lines.next().ok_or(seen)?;
        end += line.len();
        seen += u64::from(!line.trim_ascii().is_empty());
    }
    Ok(end)
}

/// Lines are streamed in blocks of about this many bytes, each parsed in pieces of its own.
const BLOCK: usize = 1 << 20;
const BLOCK_PIECE: usize = 1 << 17;

/// The lines of a source, a block of whole lines at a time. Holds one block, or the longest line
/// where that is longer.
pub(crate) struct Blocks<R> {
    source: R,
    buffer: Vec<u8>,
    /// What of the buffer was passed, and where its last whole line ends.
    passed: usize,
    whole: usize,
    ended: bool,
    /// Lines and bytes passed, counted from the beginning of the file.
    line: usize,
    at: u64,
}

impl<R: Read> Blocks<R> {
    /// From a source that stands at byte `at` of its file, after `line` lines.
    pub(crate) fn new(source: R, line: usize, at: u64) -> Self {
        Self {
            source,
            buffer: Vec::new(),
            passed: 0,
            whole: 0,
            ended: false,
            line,
            at,
        }
    }

    /// Whole lines that were not passed yet; none at all at the end.
    pub(crate) fn lines(&mut self) -> io::Result<&[u8]> {
        if self.passed == self.whole && !self.ended {
            self.buffer.drain(..self.passed);
            self.passed = 0;
            self.whole = 0;
            while self.whole == 0 && !self.ended {
                let held = self.buffer.len();
                let read = self
                    .source
                    .by_ref()
                    .take(BLOCK as u64)
                    .read_to_end(&mut self.buffer)?;
                self.ended = read < BLOCK;
                let new = self.buffer.get(held..).unwrap_or_default();
                self.whole = match new.iter().rposition(|&b| b == b'\n') {
                    _ if self.ended => self.buffer.len(),
                    Some(last) => held + last + 1,
                    None => 0,
                };
            }
        }
        Ok(self.buffer.get(self.passed..self.whole).unwrap_or_default())
    }

    /// Passes the first `bytes` of the lines at hand.
    pub(crate) fn pass(&mut self, bytes: usize) {
        let end = self.passed.saturating_add(bytes).min(self.whole);
        let passed = self.buffer.get(self.passed..end).unwrap_or_default();
        self.line += passed.iter().filter(|&&b| b == b'\n').count();
        self.at += passed.len() as u64;
        self.passed = end;
    }

    /// Passes `count` lines that are not blank; `Err` with their number where there are fewer.
    pub(crate) fn skip(&mut self, count: u64) -> io::Result<Result<(), u64>> {
        let mut left = count;
        while left > 0 {
            let block = self.lines()?;
            if block.is_empty() {
                return Ok(Err(count - left));
            }
            let (end, seen) = match skip_lines(block, left) {
                Ok(end) => (end, left),
                Err(seen) => (block.len(), seen),
            };
            self.pass(end);
            left -= seen;
        }
        Ok(Ok(()))
    }

    /// Like [`parse_rows`], of the first `bytes` of the lines at hand, which are then passed. The
    /// points go to `put` in order, with the byte of the file that they end before.
    pub(crate) fn parse(
        &mut self,
        bytes: usize,
        parse: impl Fn(&[u8]) -> Result<Option<Row>, String> + Sync,
        mut put: impl FnMut(&[[f64; 3]], u64) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        let lines = self.buffer.get(self.passed..self.whole).unwrap_or_default();
        let block = lines.get(..bytes).unwrap_or(lines);
        let end = self.at + block.len() as u64;
        for piece in parse_pieces(block, 0, BLOCK_PIECE, false, parse) {
            let rows = piece.map_err(|(offset, problem)| {
                let line = self.line + line_number(block, offset);
                Fault::Malformed(Place::Line(line), problem)
            })?;
            put(&rows.points, end)?;
        }
        self.pass(bytes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(line: &[u8]) -> Result<Option<Row>, String> {
        if line.is_empty() {
            return Ok(None);
        }
        let value = number(line).ok_or("not a number")?;
        Ok(Some(Row {
            point: [value; 3],
            intensity: 0.5,
        }))
    }

    #[test]
    fn numbers_of_all_spellings() {
        for (text, value) in [
            ("1.5", 1.5),
            ("-.5", -0.5),
            ("5.", 5.0),
            ("+1e3", 1000.0),
            ("-inf", f64::NEG_INFINITY),
        ] {
            assert_eq!(number(text.as_bytes()), Some(value), "{text}");
        }
        for text in [
            "nan",
            "-nan",
            "NaN",
            "-NAN",
            "1.#QNAN",
            "-1.#IND",
            "-nan(ind)",
        ] {
            assert!(number(text.as_bytes()).is_some_and(f64::is_nan), "{text}");
        }
        assert!(number(b"1.#INF").is_some_and(f64::is_infinite));
        for text in ["", "x", "1,5", "0x10", "1 2", "nano", "--1"] {
            assert_eq!(number(text.as_bytes()), None, "{text}");
        }
        assert_eq!(number(b"\xff"), None);
    }

    #[test]
    fn quick_numbers_are_the_nearest() {
        let mut state = 1u64;
        for _ in 0..200_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            let digits = format!(
                "{:0width$}",
                state >> (state & 63),
                width = (state >> 58) as usize % 20
            );
            let at = (state >> 32) as usize % (digits.len() + 1);
            let (before, after) = digits.split_at(at);
            for text in [
                digits.clone(),
                format!("{before}.{after}"),
                format!("-{before}.{after}"),
            ] {
                if let Some((value, rest)) = quick_number(text.as_bytes()) {
                    assert!(rest.is_empty());
                    let exact: f64 = text.parse().unwrap();
                    assert_eq!(value.to_bits(), exact.to_bits(), "{text}");
                }
            }
        }
        assert_eq!(quick_number(b"-0.5e3"), Some((-0.5, &b"e3"[..])));
        assert_eq!(quick_number(b"9007199254740993"), None);
        for none in ["", ".", "-", "-.", "+1", "x", "00000000000000000001"] {
            assert_eq!(quick_number(none.as_bytes()), None, "{none}");
        }
    }

    #[test]
    fn many_pieces_give_the_rows_in_order() {
        let text: String = (0..400_000).map(|i| format!("{i}\r\n")).collect();
        assert!(text.len() > 2 * PIECE);
        let rows = parse_rows(text.as_bytes(), 0, true, row).unwrap();
        assert_eq!(
            (rows.points.len(), rows.intensity.len()),
            (400_000, 400_000)
        );
        assert!(
            rows.points
                .iter()
                .enumerate()
                .all(|(i, p)| p[0] == i as f64)
        );
    }

    #[test]
    fn the_first_bad_line_is_named() {
        let mut text: String = "header\n".to_owned() + &"1.25\n".repeat(500_000);
        text.push_str("oops\n");
        text.push_str(&"1\n".repeat(700_000));
        text.push_str("worse");
        let error = parse_rows(text.as_bytes(), 7, false, row)
            .unwrap_err()
            .of("a.xyz");
        assert_eq!(
            error.to_string(),
            "a.xyz: line 500002: not a number, in \"oops\""
        );
    }

    #[test]
    fn skipping_counts_only_lines_that_hold_something() {
        assert_eq!(skip_lines(b"1\n\n \r\n2\n3", 2), Ok(8));
        assert_eq!(skip_lines(b"1\n\n \r\n2\n3", 3), Ok(9));
        assert_eq!(skip_lines(b"1\n\n \r\n2\n3", 4), Err(3));
        assert_eq!(skip_lines(b"", 0), Ok(0));
    }
}
