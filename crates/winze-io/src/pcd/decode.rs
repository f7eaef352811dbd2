//! The points of a PCD file.

use super::header::{Claim, Field, Header};
use super::values::Data;
use crate::columns::{Columns, Row};
use crate::error::{Fault, Place};
use crate::lines::{blank_separated, number, parse_rows};
use crate::lzf;
use crate::narrow::{self, Line, Narrow, Records, Run, Scatter, Source};
use crate::raw::{Raw, point_count};
use crate::scalar::{Column, Order};

const NO_VIEWPOINT: [f64; 7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// Decodes a whole PCD file.
pub(crate) fn decode(bytes: &[u8]) -> Result<Raw, Fault> {
    let mut header = Header::parse(bytes)?;
    let columns = header.find_columns()?;
    let (points, intensity) = match header.data {
        Data::Ascii => ascii(&mut header, columns, bytes)?,
        Data::Binary => binary(&mut header, columns, bytes)?,
        Data::Compressed => compressed(&mut header, columns, bytes)?,
    };
    let about = about(header, points.len());
    Ok(Raw {
        intensity: columns.intensity.map(|_| intensity),
        points,
        ..about
    })
}

/// What the header says of a file with so many points.
fn about(header: Header, count: usize) -> Raw {
    let organised = header.organised(count as u64);
    Raw {
        encoding: header.data.name().to_owned(),
        fields: header.names(),
        organised,
        viewpoint: header.viewpoint,
        seen_from: seen_from(header.viewpoint, organised.is_some()),
        warnings: header.warnings,
        ..Raw::default()
    }
}

/// Like [`decode`], of a source whose header is in `head`, where the points are nothing but small numbers.
pub(crate) fn decode_narrow(head: &[u8], source: &dyn Source) -> Option<(Raw, Narrow)> {
    let mut header = Header::parse(head).ok()?;
    let columns = header.find_columns().ok()?;
    let body = header.body as u64;
    let length = source.length().checked_sub(body)?;
    let field = |header: &Header, column: usize| {
        let field = header.fields.get(column)?;
        Some((field.scalar, field.byte, field.count))
    };
    let narrow = match header.data {
        Data::Ascii => {
            let line = Line::new(text_columns(&header, columns), header.columns)?;
            let row = row_parser(&header, columns);
            let expected = match header.claim() {
                Claim::One(count) => point_count(count).ok()?,
                Claim::None | Claim::Disputed => 0,
            };
            let with_intensity = columns.intensity.is_some();
            let mut narrow = narrow::text(source, body, expected, with_intensity, &line, row)?;
            let held = narrow.points.len() as u64;
            let count = header.settle(held).ok()?;
            // More points than announced are a rare thing, and their zeros are not to be counted.
            if held != count {
                return None;
            }
            narrow.points.shrink_to_fit();
            if let Some(intensity) = &mut narrow.intensity {
                intensity.shrink_to_fit();
            }
            narrow
        }
        Data::Binary => {
            let stride = header.stride.max(1);
            let count = point_count(header.settle(length / stride).ok()?).ok()?;
            let end = body + count as u64 * stride;
            let rest = source.length() - end;
            let mut buffer = Vec::new();
            let tail = usize::try_from(rest).ok().filter(|&n| n <= 1 << 16)?;
            let tail = source.bytes(end, tail, &mut buffer).ok()?;
            if tail.iter().any(|&byte| byte != 0) {
                header.warnings.push(bytes_ignored(rest));
            }
            let place = |column: usize| {
                let (scalar, byte, _) = field(&header, column)?;
                let offset = usize::try_from(byte).ok()?;
                Some(narrow::Place { scalar, offset })
            };
            let [x, y, z] = columns.xyz.map(place);
            let records = Records {
                start: body,
                stride: usize::try_from(stride).ok()?,
                order: Order::Little,
                xyz: [x?, y?, z?],
                intensity: match columns.intensity {
                    Some(column) => Some(place(column)?),
                    None => None,
                },
            };
            records.read(source, count)?
        }
        Data::Compressed => {
            let mut sizes = [0; Packed::HEAD];
            source.read(body, &mut sizes).ok()?;
            let packed = Packed::read(&mut header, &sizes, length).ok()??;
            let count = point_count(packed.count).ok()?;
            let run = |column: usize| {
                let (scalar, byte, values) = field(&header, column)?;
                let start = byte.checked_mul(count as u64)?;
                (values == 1).then_some(Run { scalar, start })
            };
            let [x, y, z] = columns.xyz.map(run);
            let intensity = match columns.intensity {
                Some(column) => Some(run(column)?),
                None => None,
            };
            let mut scatter = Scatter::new([x?, y?, z?], intensity, count);
            let mut input = narrow::onwards(source, body + Packed::HEAD as u64);
            let unpacked = lzf::unpack(&mut input, packed.packed, packed.size, &mut scatter);
            unpacked.ok()?.ok()?;
            scatter.finish()?
        }
    };
    let count = narrow.points.len();
    Some((about(header, count), narrow))
}

/// Where the sensor stood. Most programs write the default viewpoint whatever the cloud is, so the
/// default alone says nothing; in an image-like cloud it does mean the origin.
pub(super) fn seen_from(viewpoint: Option<[f64; 7]>, organised: bool) -> Option<[f64; 3]> {
    let [x, y, z, ..] = viewpoint.unwrap_or(NO_VIEWPOINT);
    (organised || viewpoint.is_some_and(|v| v != NO_VIEWPOINT)).then_some([x, y, z])
}

type Points = (Vec<[f64; 3]>, Vec<f32>);

/// Parses a line of text; `None` where it holds no point.
pub(super) fn row_parser(
    header: &Header,
    columns: Columns,
) -> impl Fn(&[u8]) -> Result<Option<Row>, String> + Sync + use<> {
    let wanted = text_columns(header, columns);
    let total = header.columns;
    move |line| {
        if line.is_empty() || line.starts_with(b"#") {
            return Ok(None);
        }
        let (row, seen) = wanted.pick(blank_separated(line), number)?;
        if seen as u64 != total {
            return Err(format!("{seen} values where FIELDS and COUNT make {total}"));
        }
        Ok(Some(row))
    }
}

/// From fields to columns of text, which differ where a COUNT is above 1.
fn text_columns(header: &Header, columns: Columns) -> Columns {
    let column = |field: usize| {
        header
            .fields
            .get(field)
            .map_or(usize::MAX, |f| f.column as usize)
    };
    Columns {
        xyz: columns.xyz.map(column),
        intensity: columns.intensity.map(column),
    }
}

/// A warning where the data goes on after `count` points.
pub(super) fn points_ignored(held: u64, count: u64) -> Option<String> {
    let rest = held.checked_sub(count).filter(|&rest| rest > 0)?;
    Some(format!("{rest} points more than announced are ignored"))
}

/// The warning where the data goes on after the last point and is not zero.
pub(super) fn bytes_ignored(rest: u64) -> String {
    format!("{rest} bytes after the last announced point are ignored")
}

fn ascii(header: &mut Header, columns: Columns, bytes: &[u8]) -> Result<Points, Fault> {
    let row = row_parser(header, columns);
    let mut rows = parse_rows(bytes, header.body, columns.intensity.is_some(), row)?;
    let held = rows.points.len();
    let count = point_count(header.settle(held as u64)?)?;
    header
        .warnings
        .extend(points_ignored(held as u64, count as u64));
    rows.points.truncate(count);
    rows.intensity.truncate(count);
    Ok((rows.points, rows.intensity))
}

fn binary(header: &mut Header, columns: Columns, bytes: &[u8]) -> Result<Points, Fault> {
    let body = bytes.get(header.body..).unwrap_or_default();
    // A record has at least x, y and z, so the stride is not zero.
    let held = body.len() as u64 / header.stride.max(1);
    let count = point_count(header.settle(held)?)?;
    let stride = usize::try_from(header.stride).unwrap_or(usize::MAX);
    // The Point Cloud Library itself sometimes leaves zeros behind the last point.
    let rest = body.get(count.saturating_mul(stride)..).unwrap_or_default();
    if rest.iter().any(|&byte| byte != 0) {
        header.warnings.push(bytes_ignored(rest.len() as u64));
    }
    gather(header, columns, count, |field| {
        Some((body.get(field.byte as usize..)?, stride))
    })
}

/// How compressed data announces itself, checked against what is there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Packed {
    /// Bytes before and after decompression.
    pub(super) packed: u64,
    pub(super) size: u64,
    pub(super) count: u64,
}

impl Packed {
    /// Bytes of the two sizes ahead of the data.
    pub(super) const HEAD: usize = 8;

    /// From the first [`Packed::HEAD`] bytes of the body, which is `length` bytes long. `None` where
    /// there is no data, and there need be none.
    pub(super) fn read(
        header: &mut Header,
        head: &[u8],
        length: u64,
    ) -> Result<Option<Self>, Fault> {
        let place = Place::Byte(header.body);
        let Some((packed, rest)) = head.split_first_chunk::<4>() else {
            // Some programs write no sizes where there are no points.
            header.settle(0)?;
            return Ok(None);
        };
        let packed = u64::from(u32::from_le_bytes(*packed));
        let Some((size, _)) = rest.split_first_chunk::<4>() else {
            return Err(Fault::truncated(place, "the data ends within its size"));
        };
        let size = u64::from(u32::from_le_bytes(*size));
        let held = length.saturating_sub(Self::HEAD as u64);
        if packed > held {
            return Err(Fault::truncated(
                place,
                format!("{packed} compressed bytes announced, {held} there"),
            ));
        }
        if size > packed.saturating_mul(lzf::MOST_EXPANSION as u64) {
            return Err(Fault::malformed(
                place,
                format!(
                    "{packed} bytes cannot decompress to the {size} announced; the file is damaged"
                ),
            ));
        }
        let count = header.settle(size / header.stride.max(1))?;
        if count.checked_mul(header.stride) != Some(size) {
            let stride = header.stride;
            return Err(Fault::malformed(
                place,
                format!(
                    "{count} points of {stride} bytes do not make the {size} bytes announced; the file is damaged"
                ),
            ));
        }
        Ok(Some(Self {
            packed,
            size,
            count,
        }))
    }

    /// Data that breaks the compression's rules `at` bytes after the sizes.
    pub(super) fn damaged(header: &Header, at: usize) -> Fault {
        Fault::malformed(
            Place::Byte(header.body + Self::HEAD + at),
            "the compressed data is damaged; copy the file again",
        )
    }
}

/// Compressed data is stored a field at a time, not a point at a time. Of the unpacked fields only
/// coordinates and intensity are made numbers, each right in its place in the points.
fn compressed(header: &mut Header, columns: Columns, bytes: &[u8]) -> Result<Points, Fault> {
    let body = bytes.get(header.body..).unwrap_or_default();
    let head = body.get(..Packed::HEAD).unwrap_or(body);
    let Some(packed) = Packed::read(header, head, body.len() as u64)? else {
        return Ok((Vec::new(), Vec::new()));
    };
    let count = point_count(packed.count)?;
    let data = body
        .get(Packed::HEAD..)
        .and_then(|data| data.get(..packed.packed as usize))
        .unwrap_or_default();
    let columns_of_bytes =
        lzf::decompress(data, packed.size as usize).map_err(|at| Packed::damaged(header, at))?;
    gather(header, columns, count, |field| {
        let start = (field.byte as usize).checked_mul(count)?;
        Some((columns_of_bytes.get(start..)?, field.bytes() as usize))
    })
}

/// Picks coordinates and intensity from binary data; `locate` gives the bytes from a field's first
/// value on and the step from one point to the next.
fn gather<'a>(
    header: &Header,
    columns: Columns,
    count: usize,
    locate: impl Fn(&Field) -> Option<(&'a [u8], usize)>,
) -> Result<Points, Fault> {
    if count == 0 {
        return Ok((Vec::new(), Vec::new()));
    }
    let find = |column: usize| {
        let field = header.fields.get(column)?;
        let (bytes, stride) = locate(field)?;
        Some(Column {
            scalar: field.scalar,
            order: Order::Little,
            bytes,
            stride,
        })
    };
    let [x, y, z] = columns.xyz.map(find);
    let (Some(x), Some(y), Some(z)) = (x, y, z) else {
        return Err(Fault::malformed(
            Place::File,
            "a record is longer than the data",
        ));
    };
    let intensity = columns.intensity.and_then(find);
    Ok((
        Column::points([x, y, z], count),
        intensity.map_or_else(Vec::new, |column| column.floats(count)),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(fields: &str, lines: &str, data: &str, body: &[u8]) -> Vec<u8> {
        let head = format!("VERSION 0.7\nFIELDS {fields}\n{lines}\nDATA {data}\n");
        [head.as_bytes(), body].concat()
    }

    #[test]
    fn a_viewpoint_counts_only_where_it_means_something() {
        let body = b"1 2 3\n".repeat(4);
        for (lines, expected) in [
            ("WIDTH 4", None),
            ("WIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0", None),
            ("WIDTH 4\nVIEWPOINT 0 -0 0 1.0 0 0 0", None),
            ("WIDTH 4\nVIEWPOINT 1 2 3 1 0 0 0", Some([1.0, 2.0, 3.0])),
            ("WIDTH 4\nVIEWPOINT 0 0 0 0 1 0 0", Some([0.0; 3])),
            ("WIDTH 2\nHEIGHT 2", Some([0.0; 3])),
            ("WIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0", Some([0.0; 3])),
            (
                "WIDTH 2\nHEIGHT 2\nVIEWPOINT 0 0 9 1 0 0 0",
                Some([0.0, 0.0, 9.0]),
            ),
            ("WIDTH 4\nVIEWPOINT 1 2 3", None),
        ] {
            let raw = decode(&file("x y z", lines, "ascii", &body)).unwrap();
            assert_eq!(raw.seen_from, expected, "{lines}");
        }
    }

    #[test]
    fn ascii_rows_of_all_kinds() {
        let lines = "SIZE 4 4 4 4 1\nTYPE F F I F U\nCOUNT 2 1 1 1 1\nWIDTH 3";
        let body = b"9 9 1 2 3.5 7\r\n# note\r\n\r\n9 9 nan -2 inf 8\n\t9  9 1e1 +2 .5 9";
        let raw = decode(&file("n x y z intensity", lines, "ascii", body)).unwrap();
        assert_eq!(
            [raw.points[0], raw.points[2]],
            [[1.0, 2.0, 3.5], [10.0, 2.0, 0.5]]
        );
        assert!(raw.points[1][0].is_nan() && raw.points[1][2].is_infinite());
        assert_eq!(raw.intensity, Some(vec![7.0, 8.0, 9.0]));
        assert!(raw.warnings[..] == [] as [String; 0]);
    }

    #[test]
    fn rows_of_the_wrong_length_are_errors_and_rows_too_many_a_warning() {
        let read = |body: &[u8]| decode(&file("x y z t", "WIDTH 2", "ascii", body));
        let error = read(b"1 2 3 4\n1 2 3\n")
            .unwrap_err()
            .of("a.pcd")
            .to_string();
        assert!(
            error.contains("line 6: 3 values where FIELDS and COUNT make 4"),
            "{error}"
        );
        assert!(read(b"1 2 3 4\n1 2 3 4 5\n").is_err());
        let error = read(b"1 2 3 4\n").unwrap_err().of("a.pcd").to_string();
        assert!(
            error.contains("line 3: WIDTH times HEIGHT says 2 but the file holds 1"),
            "{error}"
        );
        let raw = read(&b"1 2 3 4\n".repeat(5)).unwrap();
        assert_eq!(raw.points.len(), 2);
        assert!(raw.warnings.iter().any(|w| w.starts_with("3 points more")));
    }

    #[test]
    fn bytes_behind_the_last_point_are_told_unless_zero() {
        let lines = "SIZE 2 2 2\nTYPE I I I\nPOINTS 1";
        for (rest, warnings) in [(&[][..], 0), (&[0; 40], 0), (&[0, 0, 1], 1)] {
            let body = [&[1, 0, 0xFF, 0xFF, 3, 0][..], rest].concat();
            let raw = decode(&file("x y z", lines, "binary", &body)).unwrap();
            assert_eq!(raw.points, [[1.0, -1.0, 3.0]]);
            assert_eq!(raw.warnings.len(), warnings, "{:?}", raw.warnings);
        }
    }

    #[test]
    fn a_file_without_coordinates_says_what_it_has() {
        let error = decode(&file("rgb label", "WIDTH 1", "ascii", b"1 2\n")).unwrap_err();
        let text = error.of("a.pcd").to_string();
        assert!(
            text.contains("the columns are rgb, label; a cloud needs"),
            "{text}"
        );
    }
}
