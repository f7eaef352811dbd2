//! The header of a PLY file.

use crate::columns::{self, excerpt, shortened};
use crate::error::{Fault, Place};
use crate::scalar::{Order, Scalar};

/// A header that has not come to `end_header` by then is none.
pub(super) const LONGEST: usize = 64 * 1024;

/// How the elements follow the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Data {
    Ascii,
    Binary(Order),
}

impl Data {
    /// The name in the header.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ascii",
            Self::Binary(Order::Little) => "binary_little_endian",
            Self::Binary(Order::Big) => "binary_big_endian",
        }
    }
}

/// The type of one property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    /// A count and as many items.
    List {
        count: Scalar,
        item: Scalar,
    },
}

#[derive(Debug, Clone)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

/// A table of the file: its name, rows and columns.
#[derive(Debug, Clone)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
    /// The header line that announces it.
    pub(super) line: usize,
}

impl Element {
    /// Bytes of a row in binary, where they are always the same.
    pub(super) fn fixed_size(&self) -> Option<u64> {
        self.properties
            .iter()
            .map(|p| match p.kind {
                Kind::Scalar(scalar) => Some(scalar.size() as u64),
                Kind::List { .. } => None,
            })
            .sum()
    }

    /// The fewest bytes a row can take in binary.
    pub(super) fn least_size(&self) -> u64 {
        self.properties
            .iter()
            .map(|p| match p.kind {
                Kind::Scalar(scalar) | Kind::List { count: scalar, .. } => scalar.size() as u64,
            })
            .sum()
    }
}

#[derive(Debug)]
pub(super) struct Header {
    pub(super) data: Data,
    pub(super) elements: Vec<Element>,
    /// Where the elements begin.
    pub(super) body: usize,
}

impl Header {
    /// Reads the header at the start of `bytes`.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut data = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut end = 0;
        for (i, line) in bytes.split_inclusive(|&b| b == b'\n').enumerate() {
            end += line.len();
            if end > LONGEST {
                break;
            }
            let number = i + 1;
            let bad = |problem: String| Fault::Malformed(Place::Line(number), problem);
            // Comments may be in any character set.
            let text = String::from_utf8_lossy(line);
            let words: Vec<&str> = text.split_whitespace().collect();
            if i == 0 && words != ["ply"] {
                return Err(bad("a PLY file starts with a line 'ply'".into()));
            }
            match words.as_slice() {
                [] | ["ply" | "comment" | "obj_info", ..] => {}
                ["format", name, ..] => data = Some(format(name).map_err(bad)?),
                ["element", name, count] => elements.push(Element {
                    name: columns::name(name),
                    count: count.parse().map_err(|_| {
                        bad(format!(
                            "'{}' is not a number of elements",
                            shortened(count, 20)
                        ))
                    })?,
                    properties: Vec::new(),
                    line: number,
                }),
                ["property", rest @ ..] => {
                    let property = property(rest).map_err(bad)?;
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| bad("a property before any element".into()))?;
                    element.properties.push(property);
                }
                ["end_header"] => {
                    let data =
                        data.ok_or_else(|| bad("no format line before end_header".into()))?;
                    return Ok(Self {
                        data,
                        elements,
                        body: end,
                    });
                }
                _ => {
                    return Err(bad(format!("\"{}\" is no PLY header line", excerpt(line))));
                }
            }
        }
        if end > LONGEST {
            return Err(Fault::malformed(
                Place::File,
                "no end_header within the first 64 KiB; this is no PLY file, or its header is broken",
            ));
        }
        Err(Fault::truncated(
            Place::File,
            "the header ends without end_header",
        ))
    }
}

fn format(name: &str) -> Result<Data, String> {
    match name {
        "ascii" => Ok(Data::Ascii),
        "binary_little_endian" => Ok(Data::Binary(Order::Little)),
        "binary_big_endian" => Ok(Data::Binary(Order::Big)),
        _ => Err(format!(
            "format '{}' is unknown; known are ascii, binary_little_endian and binary_big_endian",
            shortened(name, 30)
        )),
    }
}

fn property(words: &[&str]) -> Result<Property, String> {
    let (kind, name) = match words {
        ["list", count, item, name] => {
            let count_type = scalar(count)?;
            if count_type.is_float() {
                return Err(format!(
                    "a list cannot be counted in '{}'",
                    shortened(count, 20)
                ));
            }
            let item = scalar(item)?;
            (
                Kind::List {
                    count: count_type,
                    item,
                },
                columns::name(name),
            )
        }
        // Some programs leave blanks in the names of scalar fields.
        [kind, name @ ..] if !name.is_empty() => {
            (Kind::Scalar(scalar(kind)?), columns::name(&name.join(" ")))
        }
        _ => return Err("a property has a type and a name".into()),
    };
    Ok(Property { name, kind })
}

fn scalar(name: &str) -> Result<Scalar, String> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "int64" => Scalar::I64,
        "uint64" => Scalar::U64,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return Err(format!("'{}' is no PLY type", shortened(name, 30))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: &str = "ply\nformat binary_big_endian 1.0\ncomment a b c\nobj_info x\nelement camera 1\nproperty double t\nelement vertex 3\nproperty float x\nproperty list uchar int tags\nend_header\n";

    fn message(text: &str) -> String {
        Header::parse(text.as_bytes())
            .unwrap_err()
            .of("a.ply")
            .to_string()
    }

    #[test]
    fn an_ordinary_header() {
        for text in [PLAIN.to_owned(), PLAIN.replace('\n', "\r\n")] {
            let header = Header::parse(text.as_bytes()).unwrap();
            assert_eq!(
                (header.data, header.body),
                (Data::Binary(Order::Big), text.len())
            );
            let [camera, vertex] = &header.elements[..] else {
                panic!()
            };
            assert_eq!(
                (camera.name.as_str(), camera.count, camera.fixed_size()),
                ("camera", 1, Some(8))
            );
            assert_eq!(
                (vertex.count, vertex.fixed_size(), vertex.least_size()),
                (3, None, 5)
            );
        }
    }

    #[test]
    fn broken_headers_are_refused_with_their_line() {
        for (from, to, expected) in [
            ("ply\n", "plyx\n", "line 1: a PLY file starts"),
            ("binary_big_endian", "zip", "line 2: format 'zip'"),
            ("format binary_big_endian 1.0\n", "\n", "no format line"),
            (
                "vertex 3",
                "vertex -3",
                "line 7: '-3' is not a number of elements",
            ),
            ("vertex 3", "vertex 99999999999999999999", "line 7"),
            ("float x", "half x", "line 8: 'half' is no PLY type"),
            (
                "list uchar",
                "list float",
                "line 9: a list cannot be counted",
            ),
            (
                "list uchar int tags",
                "list uchar",
                "line 9: 'list' is no PLY type",
            ),
            (
                "element camera 1\n",
                "",
                "line 5: a property before any element",
            ),
            ("obj_info", "object", "line 4: \"object x\""),
            ("end_header\n", "", "ends without end_header"),
        ] {
            let text = message(&PLAIN.replace(from, to));
            assert!(text.contains(expected), "{text}");
        }
    }

    #[test]
    fn a_file_that_is_no_ply_is_not_searched_to_its_end() {
        assert!(message(&format!("ply\n{}", "comment long\n".repeat(100_000))).contains("64 KiB"));
        assert!(message("").contains("without end_header"));
    }
}
