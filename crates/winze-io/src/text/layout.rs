//! How the columns of a text file are laid out, from its first lines.

use std::fmt;

use crate::columns::{self, Columns, Row};
use crate::error::{Fault, Place};
use crate::lines::{blank_separated, number};

/// The names and the first numbers stand in lines no longer than this. Such a line is held a column
/// at a time, which takes many times its own size.
const LONGEST: usize = 64 * 1024;

/// What stands between two columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Delimiter {
    Blank,
    Comma,
    Semicolon,
}

#[derive(Debug)]
pub(super) struct Layout {
    pub(super) delimiter: Delimiter,
    pub(super) columns: Columns,
    /// Names of the columns, as far as they are known.
    pub(super) names: Vec<String>,
    /// Where the first line of numbers begins.
    pub(super) body: usize,
    /// Lines before it.
    pub(super) line: usize,
    /// The number of points that the first line announces, with the line's number.
    pub(super) announced: Option<(u64, usize)>,
}

impl Delimiter {
    fn detect(line: &[u8]) -> Self {
        if line.contains(&b';') {
            Self::Semicolon
        } else if line.contains(&b',') {
            Self::Comma
        } else {
            Self::Blank
        }
    }

    /// The delimiter's byte, where it is a single one.
    pub(super) fn byte(self) -> Option<u8> {
        match self {
            Self::Blank => None,
            Self::Comma => Some(b','),
            Self::Semicolon => Some(b';'),
        }
    }

    /// A number in a column: in quotes or not, absent (not a number), between semicolons with a
    /// decimal comma.
    pub(super) fn number(self, token: &[u8]) -> Option<f64> {
        let token = bare(token);
        if token.is_empty() && self != Self::Blank {
            return Some(f64::NAN);
        }
        if self == Self::Semicolon && token.contains(&b',') {
            let point = |&b: &u8| if b == b',' { b'.' } else { b };
            return number(&token.iter().map(point).collect::<Vec<u8>>());
        }
        number(token)
    }

    fn tokens(self, line: &[u8]) -> Vec<&[u8]> {
        match self.byte() {
            None => blank_separated(line).collect(),
            Some(byte) => line.split(|&b| b == byte).collect(),
        }
    }
}

impl fmt::Display for Delimiter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Blank => "ascii, blank separated",
            Self::Comma => "ascii, comma separated",
            Self::Semicolon => "ascii, semicolon separated",
        })
    }
}

/// The lines ahead of the first one of numbers, taken one by one.
#[derive(Debug, Default)]
pub(super) struct Detector {
    /// Bytes and lines passed.
    pub(super) body: usize,
    pub(super) line: usize,
    announced: Option<(u64, usize)>,
    comment: Option<Vec<String>>,
    header: Option<Vec<String>>,
}

impl Detector {
    /// For a file that starts with these bytes, at least three where there are as many. The first
    /// line begins at `body`.
    pub(super) fn new(start: &[u8]) -> Result<Self, Fault> {
        if start.starts_with(&[0xFF, 0xFE]) || start.starts_with(&[0xFE, 0xFF]) {
            return Err(Fault::malformed(
                Place::File,
                "is UTF-16 text; save it as UTF-8",
            ));
        }
        let marked = start.starts_with(b"\xEF\xBB\xBF");
        Ok(Self {
            body: if marked { 3 } else { 0 },
            ..Self::default()
        })
    }

    /// Looks at the next line, with its end; the layout if it is the first one of numbers.
    pub(super) fn take(&mut self, line: &[u8]) -> Result<Option<Layout>, Fault> {
        let place = Place::Line(self.line + 1);
        let content = line.trim_ascii();
        if is_comment(content) {
            if content.len() <= LONGEST {
                let names = names(after_marker(content));
                if Columns::find(&names).is_ok() {
                    self.comment = Some(names);
                }
            }
        } else if content.len() > LONGEST {
            return Err(Fault::malformed(
                place,
                "is longer than 64 KiB; a text cloud has one point a line, x y z",
            ));
        } else if !content.is_empty() {
            let delimiter = Delimiter::detect(content);
            let tokens = delimiter.tokens(content);
            let unsettled = self.announced.is_none() && self.header.is_none();
            if let Some(count) = count(&tokens).filter(|_| unsettled) {
                self.announced = Some((count, self.line + 1));
            } else if self.header.is_none()
                && let Some(row) = header_names(delimiter, &tokens, content)
                    .map_err(|problem| Fault::Malformed(place, problem))?
            {
                self.header = Some(row);
            } else {
                // A comment is taken for names only if it fits: it may as well be prose.
                let comment = self.comment.take();
                let comment = comment.filter(|names| names.len() == tokens.len());
                let (columns, names) = choose(self.header.take().or(comment));
                return Ok(Some(Layout {
                    delimiter,
                    columns,
                    names,
                    body: self.body,
                    line: self.line,
                    announced: self.announced,
                }));
            }
        }
        self.body += line.len();
        self.line += 1;
        Ok(None)
    }

    /// What is wrong where no line of numbers came.
    pub(super) fn end(&self) -> Fault {
        match check_count(self.announced, 0) {
            Err(fault) => fault,
            Ok(()) => Fault::Empty,
        }
    }
}

impl Layout {
    /// Looks at the lines up to and including the first one of numbers.
    pub(super) fn detect(bytes: &[u8]) -> Result<Self, Fault> {
        let mut detector = Detector::new(bytes)?;
        let lines = bytes.get(detector.body..).unwrap_or_default();
        for line in lines.split_inclusive(|&b| b == b'\n') {
            if let Some(layout) = detector.take(line)? {
                return Ok(layout);
            }
        }
        Err(detector.end())
    }

    /// Parses a line; `None` where it holds no point.
    pub(super) fn row(&self, line: &[u8]) -> Result<Option<Row>, String> {
        if line.is_empty() || is_comment(line) {
            return Ok(None);
        }
        let needed = self.columns.needed();
        let number = |token: &[u8]| self.delimiter.number(token);
        let (row, seen) = match self.delimiter.byte() {
            None => self.columns.pick(blank_separated(line), number)?,
            Some(byte) => self.columns.pick(line.split(|&b| b == byte), number)?,
        };
        if seen < needed {
            return Err(format!("{seen} columns where {needed} are needed"));
        }
        Ok(Some(row))
    }

    /// A warning where the file holds more points than it announces.
    pub(super) fn surplus(&self, held: u64) -> Option<String> {
        let (announced, line) = self.announced.filter(|&(n, _)| n != held)?;
        Some(format!(
            "line {line} announces {announced} points but the file holds {held}; all are read"
        ))
    }

    /// Refuses a file that holds fewer points than it announces.
    pub(super) fn check_held(&self, held: u64) -> Result<(), Fault> {
        check_count(self.announced, held)
    }
}

fn check_count(announced: Option<(u64, usize)>, held: u64) -> Result<(), Fault> {
    match announced {
        Some((count, line)) if count > held => Err(Fault::truncated(
            Place::Line(line),
            format!("announces {count} points but the file holds {held}"),
        )),
        _ => Ok(()),
    }
}

/// The names in the first line that is no comment, if it is one of names: where a column has the
/// name x, and so on, or where the first token is no number. That one may be absent: some programs
/// give a column of row numbers no name.
fn header_names(
    delimiter: Delimiter,
    tokens: &[&[u8]],
    content: &[u8],
) -> Result<Option<Vec<String>>, String> {
    let is_word = |token: &&[u8]| delimiter.number(token).is_none();
    if !tokens.iter().any(is_word) {
        return Ok(None);
    }
    let row = names(content);
    match Columns::find(&row) {
        Ok(_) => Ok(Some(row)),
        Err(problem) => {
            let first = tokens.iter().find(|token| !bare(token).is_empty());
            // A word further on is a label beside a point, or a point gone wrong.
            if first.is_some_and(is_word) {
                Err(problem)
            } else {
                Ok(None)
            }
        }
    }
}

fn choose(names: Option<Vec<String>>) -> (Columns, Vec<String>) {
    let unnamed = Columns {
        xyz: [0, 1, 2],
        intensity: None,
    };
    match names.map(|names| (Columns::find(&names), names)) {
        Some((Ok(columns), names)) => (columns, names),
        _ => (unnamed, ["x", "y", "z"].map(str::to_owned).to_vec()),
    }
}

/// A line that holds no point.
pub(super) fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//")
}

fn after_marker(line: &[u8]) -> &[u8] {
    let start = line.iter().position(|b| !matches!(b, b'#' | b'/'));
    start.and_then(|at| line.get(at..)).unwrap_or_default()
}

/// The number in a line that holds nothing but digits; one beyond all files saturates.
fn count(tokens: &[&[u8]]) -> Option<u64> {
    let &[digits] = tokens else {
        return None;
    };
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let text = std::str::from_utf8(digits).ok()?;
    Some(text.parse().unwrap_or(u64::MAX))
}

/// A token without blanks and quotes around it.
fn bare(token: &[u8]) -> &[u8] {
    let token = token.trim_ascii();
    match token {
        [b'"', inner @ .., b'"'] => inner.trim_ascii(),
        _ => token,
    }
}

/// The names in a line, without quotes and units.
fn names(line: &[u8]) -> Vec<String> {
    let delimiter = Delimiter::detect(line);
    delimiter
        .tokens(line)
        .into_iter()
        .filter(|token| {
            // Between blanks a unit is a token of its own.
            let unit = token.starts_with(b"[") || token.starts_with(b"(");
            delimiter != Delimiter::Blank || !unit
        })
        .map(|token| {
            let token = bare(token);
            let unit = token.iter().position(|b| matches!(b, b'[' | b'('));
            let name = unit.and_then(|at| token.get(..at)).unwrap_or(token);
            columns::name(&String::from_utf8_lossy(name.trim_ascii()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lose_quotes_and_units() {
        assert_eq!(names(b"\"X [m]\", \"Y(m)\",z"), ["X", "Y", "z"]);
        assert_eq!(names(b"X [m] Y [m] Z[m]"), ["X", "Y", "Z"]);
        assert_eq!(names(b""), Vec::<String>::new());
    }

    #[test]
    fn the_body_starts_at_the_first_numbers() {
        let layout = Layout::detect(b"# hello\n\n3\n1;2;3\n").unwrap();
        assert_eq!((layout.body, layout.announced), (11, Some((3, 3))));
        assert_eq!(layout.delimiter, Delimiter::Semicolon);
    }

    #[test]
    fn first_lines_are_not_taken_apart_whatever_their_length() {
        let most = LONGEST - "x,y,z".len();
        let names = format!("x,y,z{}\n1,2,3\n", ",".repeat(most));
        assert_eq!(
            Layout::detect(names.as_bytes()).unwrap().names.len(),
            most + 3
        );
        for text in [
            format!("\nx,y,z{}\n1,2,3\n", ",".repeat(most + 1)),
            format!("\n1,2,3{}\n", ",".repeat(4_000_000)),
            format!("# x y z\n{}", "1 ".repeat(2_000_000)),
            format!("7\n{}", "1".repeat(4_000_000)),
        ] {
            let error = Layout::detect(text.as_bytes()).unwrap_err().of("a.csv");
            assert_eq!(
                error.to_string(),
                "a.csv: line 2: is longer than 64 KiB; a text cloud has one point a line, x y z"
            );
        }
        // A long comment is passed over like all others.
        let prose = format!("# x y z{}\n1 2 3\n", " and so on".repeat(100_000));
        assert_eq!(
            Layout::detect(prose.as_bytes()).unwrap().names,
            ["x", "y", "z"]
        );
    }

    #[test]
    fn decimal_commas_only_between_semicolons() {
        assert_eq!(Delimiter::Semicolon.number(b" \"1,5\" "), Some(1.5));
        assert_eq!(Delimiter::Blank.number(b"1,5"), None);
        assert!(Delimiter::Comma.number(b"").is_some_and(f64::is_nan));
        assert_eq!(Delimiter::Blank.number(b""), None);
    }
}
