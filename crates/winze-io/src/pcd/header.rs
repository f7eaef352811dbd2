//! The header of a PCD file.

use super::values::{self, Data, Values};
use crate::columns::{self, Columns, shortened};
use crate::error::{Fault, Place};
use crate::scalar::Scalar;

/// A header that has not come to DATA by then is none.
pub(super) const LONGEST: usize = 64 * 1024;

/// More unknown lines than this are not listed.
const MOST_WARNINGS: usize = 8;

/// One column, or `count` neighbouring ones.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    pub(super) count: u64,
    /// Where it starts in a record: in bytes, and in columns of text.
    pub(super) byte: u64,
    pub(super) column: u64,
}

impl Field {
    /// Bytes the field takes in a record.
    pub(super) fn bytes(&self) -> u64 {
        self.count * self.scalar.size() as u64
    }
}

/// How many points a header announces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Claim {
    None,
    One(u64),
    /// POINTS and WIDTH times HEIGHT differ: what the data holds decides.
    Disputed,
}

/// All that the header says.
#[derive(Debug, Clone)]
pub(super) struct Header {
    pub(super) fields: Vec<Field>,
    /// Bytes and text columns of a record.
    pub(super) stride: u64,
    pub(super) columns: u64,
    pub(super) width: Option<u64>,
    pub(super) height: u64,
    pub(super) viewpoint: Option<[f64; 7]>,
    pub(super) data: Data,
    /// Where the points begin.
    pub(super) body: usize,
    pub(super) warnings: Vec<String>,
    /// POINTS with its line.
    points: Option<(u64, usize)>,
    width_line: usize,
}

/// The lines as they come, before they are put together.
#[derive(Default)]
struct Lines<'a> {
    fields: Option<Values<'a>>,
    size: Option<Values<'a>>,
    kind: Option<Values<'a>>,
    count: Option<Values<'a>>,
    width: Option<Values<'a>>,
    height: Option<Values<'a>>,
    points: Option<Values<'a>>,
    viewpoint: Option<Values<'a>>,
    warnings: Vec<String>,
}

impl Header {
    /// Reads the header at the start of `bytes`.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut lines = Lines::default();
        let mut end = 0;
        for (i, line) in bytes.split_inclusive(|&b| b == b'\n').enumerate() {
            end += line.len();
            if end > LONGEST {
                break;
            }
            // Comments may be in any character set.
            if line.trim_ascii_start().starts_with(b"#") {
                continue;
            }
            let number = i + 1;
            let Ok(text) = std::str::from_utf8(line) else {
                return Err(Fault::malformed(
                    Place::Line(number),
                    "is not text; a PCD file starts with lines such as FIELDS x y z",
                ));
            };
            let mut words = text.split_whitespace();
            let Some(keyword) = words.next() else {
                continue;
            };
            let values: Vec<&str> = words.collect();
            if keyword == "DATA" {
                return lines.finish(values::data(number, values.first().copied())?, end);
            }
            lines.take(keyword, number, values);
        }
        if end > LONGEST {
            return Err(Fault::malformed(
                Place::File,
                "no DATA line within the first 64 KiB; this is no PCD file, or its header is broken",
            ));
        }
        Err(Fault::truncated(
            Place::File,
            "the header ends without a DATA line",
        ))
    }

    /// WIDTH times HEIGHT, where the file gives a WIDTH.
    fn area(&self) -> Option<u64> {
        self.width?.checked_mul(self.height)
    }

    /// What the header alone says of the number of points.
    pub(super) fn claim(&self) -> Claim {
        match (self.points, self.area()) {
            (None, None) => Claim::None,
            (Some((n, _)), None) | (None, Some(n)) => Claim::One(n),
            (Some((points, _)), Some(area)) if points == area => Claim::One(points),
            (Some(_), Some(_)) => Claim::Disputed,
        }
    }

    /// How many points to read where the data holds `held`: POINTS, or WIDTH times HEIGHT where
    /// POINTS is absent or these are exactly what is held. Short of that, data that holds less than
    /// POINTS is cut: a WIDTH that was left behind must not let it pass for a smaller cloud.
    pub(super) fn settle(&mut self, held: u64) -> Result<u64, Fault> {
        let area = self.area();
        let (claimed, source, line) = match (self.points, area) {
            (Some((points, line)), _) => (points, "POINTS", line),
            (None, Some(area)) => (area, "WIDTH times HEIGHT", self.width_line),
            (None, None) => (held, "the data", 0),
        };
        let other = area.unwrap_or(claimed);
        let count = if other == held && held > 0 {
            held
        } else if claimed <= held {
            claimed
        } else {
            return Err(Fault::truncated(
                Place::Line(line),
                format!("{source} says {claimed} but the file holds {held} points"),
            ));
        };
        if other != claimed {
            self.warnings.push(format!(
                "POINTS says {claimed} but WIDTH times HEIGHT is {other}; {count} points are read"
            ));
        }
        Ok(count)
    }

    /// Width and height, where the points form an image.
    pub(super) fn organised(&self, count: u64) -> Option<(usize, usize)> {
        let width = self
            .width
            .filter(|_| self.height > 1 && self.area() == Some(count))?;
        Some((width.try_into().ok()?, self.height.try_into().ok()?))
    }

    /// The fields that are read, by index into `fields`.
    pub(super) fn find_columns(&self) -> Result<Columns, Fault> {
        Columns::find(&self.names()).map_err(|problem| Fault::Malformed(Place::File, problem))
    }

    /// The names of all fields, in order.
    pub(super) fn names(&self) -> Vec<String> {
        self.fields.iter().map(|f| f.name.clone()).collect()
    }
}

impl<'a> Lines<'a> {
    fn take(&mut self, keyword: &str, line: usize, values: Vec<&'a str>) {
        let slot = match keyword {
            "VERSION" => return,
            "FIELDS" | "COLUMNS" => &mut self.fields,
            "SIZE" => &mut self.size,
            "TYPE" => &mut self.kind,
            "COUNT" => &mut self.count,
            "WIDTH" => &mut self.width,
            "HEIGHT" => &mut self.height,
            "POINTS" => &mut self.points,
            "VIEWPOINT" => &mut self.viewpoint,
            _ => {
                if self.warnings.len() < MOST_WARNINGS {
                    let keyword = shortened(keyword, 30);
                    self.warnings.push(format!(
                        "line {line}: '{keyword}' is not a PCD keyword; ignored"
                    ));
                }
                return;
            }
        };
        *slot = Some((line, values));
    }

    fn finish(self, data: Data, body: usize) -> Result<Header, Fault> {
        let mut warnings = self.warnings;
        let (line, names) = self.fields.ok_or_else(|| {
            Fault::malformed(
                Place::File,
                "the header has no FIELDS line; this is no PCD file, or its header is broken",
            )
        })?;
        if self.size.is_none() || self.kind.is_none() {
            warnings.push("SIZE or TYPE is missing; 4-byte floats are assumed".into());
        }
        let sizes = values::list(self.size, "SIZE", line, names.len(), "4")?;
        let kinds = values::list(self.kind, "TYPE", line, names.len(), "F")?;
        let counts = values::list(self.count, "COUNT", line, names.len(), "1")?;
        let mut fields = Vec::with_capacity(names.len());
        let (mut byte, mut column) = (0u64, 0u64);
        for (i, name) in names.iter().enumerate() {
            let scalar = values::scalar(&kinds, &sizes, i)?;
            let count = values::count(&counts, i)?;
            fields.push(Field {
                name: columns::name(name),
                scalar,
                count,
                byte,
                column,
            });
            let bytes = count.checked_mul(scalar.size() as u64);
            (byte, column) = bytes
                .and_then(|b| Some((byte.checked_add(b)?, column.checked_add(count)?)))
                .ok_or_else(|| {
                    Fault::malformed(
                        Place::Line(counts.0),
                        "a record of this many values fits no file; correct COUNT",
                    )
                })?;
        }
        let viewpoint = self.viewpoint.and_then(|(line, values)| {
            let parsed = values::viewpoint(&values);
            if parsed.is_none() {
                warnings.push(format!(
                    "line {line}: VIEWPOINT is not seven finite numbers; ignored"
                ));
            }
            parsed
        });
        let width = self.width.map(|v| values::number(v, "WIDTH")).transpose()?;
        let height = self
            .height
            .map(|v| values::number(v, "HEIGHT"))
            .transpose()?;
        if let (Some((width, line)), Some((height, _))) = (width, height)
            && width.checked_mul(height).is_none()
        {
            return Err(Fault::malformed(
                Place::Line(line),
                format!(
                    "WIDTH {width} times HEIGHT {height} is more than any file holds; correct them"
                ),
            ));
        }
        Ok(Header {
            fields,
            stride: byte,
            columns: column,
            width: width.map(|(n, _)| n),
            height: height.map_or(1, |(n, _)| n),
            viewpoint,
            data,
            body,
            warnings,
            points: self
                .points
                .map(|v| values::number(v, "POINTS"))
                .transpose()?,
            width_line: width.map_or(0, |(_, line)| line),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: &str = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n";

    fn message(text: &str) -> String {
        Header::parse(text.as_bytes())
            .unwrap_err()
            .of("a.pcd")
            .to_string()
    }

    #[test]
    fn an_ordinary_header() {
        let mut header = Header::parse(PLAIN.as_bytes()).unwrap();
        assert_eq!(
            (header.stride, header.columns, header.body),
            (12, 3, PLAIN.len())
        );
        assert_eq!(header.viewpoint, Some([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]));
        assert_eq!(header.settle(2).unwrap(), 2);
        assert!(header.warnings.is_empty());
    }

    #[test]
    fn odd_but_legal_headers() {
        let text = "COLUMNS _ z y x ring\r\nTYPE U F F I U\r\nSIZE 1 8 8 4 2\r\n\r\n# note\r\nCOUNT 3 1 1 1 2\r\nWIDTH 4\r\nHEIGHT 5\r\nDATA binary\r\n";
        let mut header = Header::parse(text.as_bytes()).unwrap();
        assert_eq!((header.stride, header.columns), (3 + 8 + 8 + 4 + 4, 8));
        assert_eq!(header.find_columns().unwrap().xyz, [3, 2, 1]);
        assert_eq!((header.fields[3].byte, header.fields[3].column), (19, 5));
        assert_eq!(
            (header.settle(20).unwrap(), header.organised(20)),
            (20, Some((4, 5)))
        );

        let bare = Header::parse(b"VERSION .5\nFIELDS x y z\nDATA ascii").unwrap();
        assert_eq!(bare.fields[2].scalar, Scalar::F32);
        assert!(bare.warnings[0].contains("SIZE or TYPE"));
    }

    #[test]
    fn what_the_data_holds_decides_between_points_and_area() {
        let header = |points: u64, width: u64| {
            let text = PLAIN
                .replace("POINTS 2", &format!("POINTS {points}"))
                .replace("WIDTH 2", &format!("WIDTH {width}"));
            Header::parse(text.as_bytes()).unwrap()
        };
        for (points, width, held, read, warnings) in [
            (5, 5, 5, 5, 0),
            (5, 7, 5, 5, 1),
            (5, 7, 7, 7, 1),
            (5, 3, 3, 3, 1),
            (0, 3, 3, 3, 1),
            (5, 5, 9, 5, 0),
            (5, 7, 6, 5, 1),
        ] {
            let mut header = header(points, width);
            assert_eq!(
                header.settle(held).unwrap(),
                read,
                "{points} {width} {held}"
            );
            assert_eq!(header.warnings.len(), warnings, "{:?}", header.warnings);
        }
        for (points, width, held) in [(100, 1, 3), (5, 3, 4), (5, 7, 4), (5, 0, 4), (5, 0, 0)] {
            let error = header(points, width).settle(held).unwrap_err();
            let text = error.of("map.pcd").to_string();
            assert!(
                text.contains(&format!(
                    "line 10: POINTS says {points} but the file holds {held}"
                )),
                "{text}"
            );
            assert!(
                text.ends_with("the file is cut short, copy it again"),
                "{text}"
            );
        }
        assert_eq!(
            header(4_000_000_000, 4_000_000_000)
                .settle(120)
                .unwrap_err()
                .of("map.pcd")
                .to_string(),
            "map.pcd: line 10: POINTS says 4000000000 but the file holds 120 points; the file is cut short, copy it again"
        );
    }

    #[test]
    fn lies_and_nonsense_are_refused_with_their_line() {
        for (from, to, expected) in [
            ("SIZE 4 4 4", "SIZE 4 3 4", "line 4: TYPE F with SIZE 3"),
            (
                "SIZE 4 4 4",
                "SIZE 4 4",
                "line 4: SIZE has 2 values but FIELDS names 3",
            ),
            ("TYPE F F F", "TYPE F Q F", "line 4: TYPE Q with SIZE 4"),
            ("COUNT 1 1 1", "COUNT 1 0 1", "line 6: COUNT '0'"),
            ("COUNT 1 1 1", "COUNT 1 -7 1", "line 6: COUNT '-7'"),
            (
                "COUNT 1 1 1",
                "COUNT 1 18446744073709551615 1",
                "line 6: a record of this many",
            ),
            (
                "POINTS 2",
                "POINTS -2",
                "line 10: POINTS '-2' is not a whole number",
            ),
            ("POINTS 2", "POINTS 99999999999999999999", "line 10: POINTS"),
            ("WIDTH 2", "WIDTH", "line 7: WIDTH ''"),
            (
                "WIDTH 2\nHEIGHT 1",
                "WIDTH 8589934592\nHEIGHT 8589934592",
                "line 7: WIDTH 8589934592 times HEIGHT 8589934592 is more than any file holds",
            ),
            ("DATA ascii", "DATA zip", "line 11: DATA 'zip' is unknown"),
            ("DATA ascii", "", "without a DATA line"),
            ("FIELDS x y z", "", "no FIELDS line"),
        ] {
            let text = message(&PLAIN.replace(from, to));
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn a_file_that_is_no_pcd_is_not_searched_to_its_end() {
        let long = "junk line\n".repeat(100_000);
        assert!(message(&long).contains("64 KiB"));
        assert!(Header::parse(&[0xFF; 300]).is_err());
        assert!(Header::parse(&vec![b' '; 1 << 20]).is_err());
        let warned = Header::parse(format!("{}{PLAIN}", "junk\n".repeat(50)).as_bytes()).unwrap();
        assert_eq!(warned.warnings.len(), MOST_WARNINGS);
    }

    #[test]
    fn a_broken_viewpoint_is_a_warning() {
        for broken in ["0 0 nan 1 0 0 0", "0 0 0 x 1 0 0 0", "0 0 0 1 0 0"] {
            let header = Header::parse(PLAIN.replace("0 0 0 1 0 0 0", broken).as_bytes()).unwrap();
            assert_eq!(header.viewpoint, None, "{broken}");
            assert!(header.warnings[0].contains("line 9: VIEWPOINT"));
        }
    }

    #[test]
    fn comments_may_be_in_any_character_set() {
        let text = [b"  # Strecke S\xfcd\n", PLAIN.as_bytes()].concat();
        let header = Header::parse(&text).unwrap();
        assert_eq!((header.body, header.warnings.len()), (text.len(), 0));
        let text = [b"Strecke S\xfcd\n", PLAIN.as_bytes()].concat();
        let error = Header::parse(&text).unwrap_err().of("a.pcd").to_string();
        assert!(error.contains("line 1: is not text"), "{error}");
    }
}
