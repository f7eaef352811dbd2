//! The vertices of a PLY file.

use super::header::{Data, Element, Header, Kind};
use crate::columns::{Columns, Row, shortened};
use crate::error::{Fault, Place};
use crate::lines::{blank_separated, number, parse_rows, skip_lines};
use crate::raw::{Raw, point_count};
use crate::scalar::{Column, Order, Scalar};

/// Decodes the vertices of a whole PLY file. What follows them is not looked at.
pub(crate) fn decode(bytes: &[u8]) -> Result<Raw, Fault> {
    let header = Header::parse(bytes)?;
    let at = header.elements.iter().position(|e| e.name == "vertex");
    let (before, vertex) = at
        .and_then(|at| Some((header.elements.get(..at)?, header.elements.get(at)?)))
        .ok_or_else(|| no_vertices(&header.elements))?;
    let names: Vec<String> = vertex.properties.iter().map(|p| p.name.clone()).collect();
    let place = Place::Line(vertex.line);
    let mut columns = Columns::find(&names).map_err(|problem| Fault::Malformed(place, problem))?;
    let list = |column: usize| {
        let property = vertex.properties.get(column)?;
        matches!(property.kind, Kind::List { .. }).then_some(&property.name)
    };
    if let Some(name) = columns.xyz.into_iter().find_map(list) {
        let problem = format!("property {name} is a list where a number is needed");
        return Err(Fault::Malformed(place, problem));
    }
    let mut warnings = Vec::new();
    if let Some(name) = columns.intensity.and_then(list) {
        warnings.push(format!(
            "property {name} is a list; intensities are left out"
        ));
        columns.intensity = None;
    }
    point_count(vertex.count)?;
    let (points, intensity) = match header.data {
        Data::Ascii => ascii(before, vertex, columns, bytes, header.body)?,
        Data::Binary(order) => {
            let body = bytes.get(header.body..).unwrap_or_default();
            let start = skip_binary(before, body, order)?;
            let body = body.get(start..).unwrap_or_default();
            match vertex.fixed_size() {
                Some(stride) => fixed(vertex, columns, body, order, stride)?,
                None => varied(vertex, columns, body, order)?,
            }
        }
    };
    Ok(Raw {
        intensity: columns.intensity.map(|_| intensity),
        encoding: match header.data {
            Data::Ascii => "ascii",
            Data::Binary(Order::Little) => "binary_little_endian",
            Data::Binary(Order::Big) => "binary_big_endian",
        }
        .to_owned(),
        fields: names,
        points,
        warnings,
        ..Raw::default()
    })
}

fn no_vertices(elements: &[Element]) -> Fault {
    let names: Vec<&str> = elements.iter().map(|e| e.name.as_str()).collect();
    let there = match names.len() {
        0 => "no elements at all".to_owned(),
        _ => shortened(&names.join(", "), 100),
    };
    Fault::malformed(
        Place::File,
        format!("has no element vertex (there are: {there}); a cloud is read from the vertices"),
    )
}

type Points = (Vec<[f64; 3]>, Vec<f32>);

fn cut(element: &Element, held: u64) -> Fault {
    let Element {
        name, count, line, ..
    } = element;
    Fault::truncated(
        Place::Line(*line),
        format!("announces {count} of element {name} but the file holds {held}"),
    )
}

fn ascii(
    before: &[Element],
    vertex: &Element,
    columns: Columns,
    bytes: &[u8],
    body: usize,
) -> Result<Points, Fault> {
    let mut start = body;
    for element in before.iter().filter(|e| !e.properties.is_empty()) {
        let rest = bytes.get(start..).unwrap_or_default();
        start += skip_lines(rest, element.count).map_err(|held| cut(element, held))?;
    }
    let rest = bytes.get(start..).unwrap_or_default();
    let length = skip_lines(rest, vertex.count).map_err(|held| cut(vertex, held))?;
    let bytes = bytes.get(..start + length).unwrap_or(bytes);
    let plain = vertex.fixed_size().is_some();
    let rows = parse_rows(bytes, start, columns.intensity.is_some(), |line| {
        if line.is_empty() {
            return Ok(None);
        }
        if !plain {
            return row_with_lists(vertex, columns, line).map(Some);
        }
        let (row, seen) = columns.pick(blank_separated(line), number)?;
        let properties = vertex.properties.len();
        if seen != properties {
            return Err(format!("{seen} values for {properties} properties"));
        }
        Ok(Some(row))
    })?;
    Ok((rows.points, rows.intensity))
}

/// A line in which lists come between the numbers.
fn row_with_lists(vertex: &Element, columns: Columns, line: &[u8]) -> Result<Row, String> {
    let mut tokens = blank_separated(line);
    let mut scalars = Vec::with_capacity(vertex.properties.len());
    for property in &vertex.properties {
        let token = tokens
            .next()
            .ok_or_else(|| format!("no value for property {}", property.name))?;
        if let Kind::List { .. } = property.kind {
            let count = std::str::from_utf8(token)
                .ok()
                .and_then(|t| t.parse::<usize>().ok())
                .ok_or_else(|| format!("property {} has no length", property.name))?;
            if count > 0 && tokens.nth(count - 1).is_none() {
                return Err(format!(
                    "property {} is shorter than it says",
                    property.name
                ));
            }
        }
        // A list's length keeps its place, so that the columns stay in step.
        scalars.push(token);
    }
    let (row, _) = columns.pick(scalars.into_iter(), number)?;
    Ok(row)
}

/// Where the elements before the vertices end in binary data.
fn skip_binary(before: &[Element], body: &[u8], order: Order) -> Result<usize, Fault> {
    let mut at = 0usize;
    for element in before {
        let rest = body.get(at..).unwrap_or_default();
        at += match element.fixed_size() {
            Some(size) => element
                .count
                .checked_mul(size)
                .filter(|&n| n <= rest.len() as u64)
                .ok_or_else(|| cut(element, rest.len() as u64 / size.max(1)))?
                as usize,
            None => walk(element, rest, order, |_, _| {})?,
        };
    }
    Ok(at)
}

/// Vertices that all have the same size.
fn fixed(
    vertex: &Element,
    columns: Columns,
    body: &[u8],
    order: Order,
    stride: u64,
) -> Result<Points, Fault> {
    let held = body.len() as u64 / stride.max(1);
    if held < vertex.count {
        return Err(cut(vertex, held));
    }
    let (count, stride) = (vertex.count as usize, stride as usize);
    let column = |index: usize| {
        let sizes = vertex.properties.iter().take(index).map(|p| match p.kind {
            Kind::Scalar(scalar) => scalar.size(),
            Kind::List { .. } => 0,
        });
        let scalar = match vertex.properties.get(index).map(|p| p.kind) {
            Some(Kind::Scalar(scalar)) => scalar,
            _ => Scalar::F64,
        };
        Column {
            scalar,
            order,
            bytes: body.get(sizes.sum()..).unwrap_or_default(),
            stride,
        }
    };
    let points = Column::points(columns.xyz.map(column), count);
    let intensity = columns.intensity.map(|i| column(i).floats(count));
    Ok((points, intensity.unwrap_or_default()))
}

/// Vertices with lists, which must be read one after the other.
fn varied(vertex: &Element, columns: Columns, body: &[u8], order: Order) -> Result<Points, Fault> {
    // The count is the file's claim: what it takes at least must be there.
    let least = vertex.least_size().max(1);
    let most = body.len() as u64 / least;
    if most < vertex.count {
        return Err(cut(vertex, most));
    }
    let count = vertex.count as usize;
    let mut points = Vec::with_capacity(count);
    let mut intensity = Vec::new();
    let mut row = Row::default();
    let last = vertex.properties.len() - 1;
    walk(vertex, body, order, |column, value| {
        if let Some(axis) = columns.xyz.iter().position(|&c| c == column) {
            if let Some(slot) = row.point.get_mut(axis) {
                *slot = value;
            }
        } else if columns.intensity == Some(column) {
            row.intensity = value as f32;
        }
        if column == last {
            points.push(row.point);
            if columns.intensity.is_some() {
                intensity.push(row.intensity);
            }
        }
    })?;
    Ok((points, intensity))
}

/// Goes through all rows of an element with lists and calls `visit` with each property's index and
/// its value, or its length if it is a list. Returns the bytes passed.
fn walk(
    element: &Element,
    body: &[u8],
    order: Order,
    mut visit: impl FnMut(usize, f64),
) -> Result<usize, Fault> {
    let mut rest = body;
    for row in 0..element.count {
        for (i, property) in element.properties.iter().enumerate() {
            let (head, item) = match property.kind {
                Kind::Scalar(scalar) => (scalar, None),
                Kind::List { count, item } => (count, Some(item)),
            };
            let value = head.first(order, rest).ok_or_else(|| cut(element, row))?;
            let items = match item {
                // A count beyond all data saturates and is then not there.
                Some(item) if value >= 0.0 => (value as usize).saturating_mul(item.size()),
                Some(_) => {
                    let offset = body.len() - rest.len();
                    let name = &property.name;
                    return Err(Fault::malformed(
                        Place::Line(element.line),
                        format!(
                            "list {name} has a length of {value}, {offset} bytes into the element; the file is damaged"
                        ),
                    ));
                }
                None => 0,
            };
            rest = rest
                .get(head.size().saturating_add(items)..)
                .ok_or_else(|| cut(element, row))?;
            visit(i, value);
        }
    }
    Ok(body.len() - rest.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(elements: &str, body: &str) -> Vec<u8> {
        format!("ply\nformat ascii 1.0\n{elements}end_header\n{body}").into_bytes()
    }

    const XYZ: &str = "property float x\nproperty float y\nproperty double z\n";

    #[test]
    fn ascii_vertices_of_all_spellings() {
        let elements = format!("element vertex 4\n{XYZ}property uchar scalar_Intensity\n");
        let body = "1 2 3 4\r\n\r\n.5 -2. 1e1 5\n  nan\t-nan inf 6  \n0.1 431234.567 0 7";
        let raw = decode(&file(&elements, body)).unwrap();
        assert_eq!(raw.points[1], [0.5, -2.0, 10.0]);
        assert_eq!(raw.points[3], [0.1, 431_234.567, 0.0]);
        assert!(raw.points[2].iter().all(|v| !v.is_finite()));
        assert_eq!(raw.intensity, Some(vec![4.0, 5.0, 6.0, 7.0]));
        assert_eq!((raw.seen_from, raw.organised), (None, None));
    }

    #[test]
    fn other_elements_are_passed_over() {
        let elements = format!(
            "element camera 2\nproperty int a\nelement none 9\nelement vertex 1\n{XYZ}element face 1\nproperty list uchar int i\n"
        );
        let raw = decode(&file(&elements, "7\n8\n1 2 3\n3 0 0 0\n")).unwrap();
        assert_eq!(raw.points, [[1.0, 2.0, 3.0]]);
        // Faces are not looked at, so they may be missing.
        assert!(decode(&file(&elements, "7\n8\n1 2 3\n")).is_ok());
    }

    #[test]
    fn an_intensity_that_is_a_list_is_left_out() {
        let elements = format!("element vertex 2\n{XYZ}property list uchar float intensity\n");
        let ascii = file(&elements, "1 2 3 2 7 8\n4 5 6 0\n");
        let head = format!("ply\nformat binary_little_endian 1.0\n{elements}end_header\n");
        let mut binary = head.into_bytes();
        for (xy, z, items) in [([1.0f32, 2.0], 3.0f64, 2), ([4.0, 5.0], 6.0, 0)] {
            binary.extend(xy.map(f32::to_le_bytes).concat());
            binary.extend(z.to_le_bytes());
            binary.push(items);
            binary.extend(vec![0; 4 * usize::from(items)]);
        }
        for bytes in [ascii, binary] {
            let raw = decode(&bytes).unwrap();
            assert_eq!(raw.points, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]);
            assert_eq!(raw.intensity, None);
            assert!(raw.warnings[0].contains("property intensity is a list"));
        }
    }

    #[test]
    fn bad_lines_are_named() {
        let elements = format!("element vertex 2\n{XYZ}");
        for (body, expected) in [
            (
                "1 2 3\n1 2\n",
                "line 9: 2 values for 3 properties, in \"1 2\"",
            ),
            ("1 2 3\n1 2 3 4\n", "line 9: 4 values for 3 properties"),
            ("1 2 3\n1 b 3\n", "line 9: 'b' is not a number"),
            (
                "1 2 3\n",
                "line 3: announces 2 of element vertex but the file holds 1",
            ),
        ] {
            let text = decode(&file(&elements, body))
                .unwrap_err()
                .of("a.ply")
                .to_string();
            assert!(text.contains(expected), "{text}");
        }
        let listed = format!("element vertex 1\nproperty list uchar int l\n{XYZ}");
        for (body, expected) in [
            ("2 7 8 1 2\n", "line 9: no value for property z"),
            ("9 7 8\n", "line 9: property l is shorter than it says"),
            ("-1 1 2 3\n", "line 9: property l has no length"),
            (
                "99999999999999999999 1 2 3\n",
                "line 9: property l has no length",
            ),
            (
                "18446744073709551615 1 2 3\n",
                "line 9: property l is shorter",
            ),
        ] {
            let text = decode(&file(&listed, body))
                .unwrap_err()
                .of("a.ply")
                .to_string();
            assert!(text.contains(expected), "{text}");
        }
    }
}
