//! The vertices of a PLY file.

use super::header::{Data, Element, Header, Kind};
use super::walk::{Body, Source};
use crate::columns::{Columns, Row, shortened};
use crate::error::{Fault, Place};
use crate::lines::{blank_separated, number, parse_rows, skip_lines};
use crate::narrow::{self, Narrow, Records};
use crate::raw::{Raw, point_count};
use crate::scalar::{Column, Order, Scalar};

/// A PLY file's header and what of it is read.
#[derive(Debug)]
pub(super) struct Vertices {
    pub(super) data: Data,
    /// Where the elements begin.
    pub(super) body: usize,
    pub(super) before: Vec<Element>,
    pub(super) vertex: Element,
    pub(super) columns: Columns,
    pub(super) names: Vec<String>,
    pub(super) warnings: Vec<String>,
}

impl Vertices {
    /// Finds the vertices in the header at the start of `bytes`.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Fault> {
        let mut header = Header::parse(bytes)?;
        let at = header.elements.iter().position(|e| e.name == "vertex");
        header.elements.truncate(at.map_or(usize::MAX, |at| at + 1));
        let vertex = match at.and_then(|_| header.elements.pop()) {
            Some(vertex) => vertex,
            None => return Err(no_vertices(&header.elements)),
        };
        let names: Vec<String> = vertex.properties.iter().map(|p| p.name.clone()).collect();
        let place = Place::Line(vertex.line);
        let mut columns =
            Columns::find(&names).map_err(|problem| Fault::Malformed(place, problem))?;
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
        Ok(Self {
            data: header.data,
            body: header.body,
            before: header.elements,
            vertex,
            columns,
            names,
            warnings,
        })
    }

    /// Where a column lies in a vertex without lists, and its type.
    pub(super) fn place(&self, column: usize) -> (usize, Scalar) {
        let properties = &self.vertex.properties;
        let sizes = properties.iter().take(column).map(|p| match p.kind {
            Kind::Scalar(scalar) => scalar.size(),
            Kind::List { .. } => 0,
        });
        match properties.get(column).map(|p| p.kind) {
            Some(Kind::Scalar(scalar)) => (sizes.sum(), scalar),
            _ => (sizes.sum(), Scalar::F64),
        }
    }

    /// Parses a line of text; `None` where it holds no vertex.
    pub(super) fn row(&self, line: &[u8]) -> Result<Option<Row>, String> {
        if line.is_empty() {
            return Ok(None);
        }
        if self.vertex.fixed_size().is_none() {
            return row_with_lists(&self.vertex, self.columns, line).map(Some);
        }
        let (row, seen) = self.columns.pick(blank_separated(line), number)?;
        let properties = self.vertex.properties.len();
        if seen != properties {
            return Err(format!("{seen} values for {properties} properties"));
        }
        Ok(Some(row))
    }

    /// Refuses vertices of `least` bytes or more, of which `length` bytes hold too few.
    pub(super) fn check_held(&self, length: u64, least: u64) -> Result<(), Fault> {
        let held = length / least.max(1);
        if held < self.vertex.count {
            return Err(cut(&self.vertex, held));
        }
        Ok(())
    }

    /// Vertices with lists, which must be read one after the other. Each goes to `put`.
    pub(super) fn varied<S: Source>(
        &self,
        body: &mut Body<S>,
        mut put: impl FnMut(Row) -> Result<(), Fault>,
    ) -> Result<(), Fault> {
        // The count is the file's claim: what it takes at least must be there.
        self.check_held(body.left(), self.vertex.least_size())?;
        let columns = self.columns;
        let mut row = Row::default();
        let last = self.vertex.properties.len() - 1;
        body.walk(&self.vertex, |column, value| {
            if let Some(axis) = columns.xyz.iter().position(|&c| c == column) {
                if let Some(slot) = row.point.get_mut(axis) {
                    *slot = value;
                }
            } else if columns.intensity == Some(column) {
                row.intensity = value as f32;
            }
            if column == last { put(row) } else { Ok(()) }
        })
    }
}

/// Decodes the vertices of a whole PLY file. What follows them is not looked at.
pub(crate) fn decode(bytes: &[u8]) -> Result<Raw, Fault> {
    let file = Vertices::parse(bytes)?;
    point_count(file.vertex.count)?;
    let (points, intensity) = match file.data {
        Data::Ascii => ascii(&file, bytes)?,
        Data::Binary(order) => {
            let rest = bytes.get(file.body..).unwrap_or_default();
            let mut body = Body::new(rest, order, rest.len() as u64);
            body.skip_elements(&file.before)?;
            match file.vertex.fixed_size() {
                Some(stride) => fixed(&file, body.into_source(), order, stride)?,
                None => varied(&file, &mut body)?,
            }
        }
    };
    Ok(Raw {
        intensity: file.columns.intensity.map(|_| intensity),
        encoding: file.data.name().to_owned(),
        fields: file.names,
        points,
        warnings: file.warnings,
        ..Raw::default()
    })
}

/// Like [`decode`], of a source whose header is in `head`, where the points are nothing but small binary numbers.
pub(crate) fn decode_narrow(head: &[u8], source: &dyn narrow::Source) -> Option<(Raw, Narrow)> {
    let file = Vertices::parse(head).ok()?;
    let count = point_count(file.vertex.count).ok()?;
    let Data::Binary(order) = file.data else {
        return None;
    };
    let stride = file.vertex.fixed_size()?;
    let mut start = file.body as u64;
    for element in &file.before {
        start = start.checked_add(element.count.checked_mul(element.fixed_size()?)?)?;
    }
    let held = source.length().checked_sub(start)?;
    file.check_held(held, stride).ok()?;
    let place = |column: usize| {
        let (offset, scalar) = file.place(column);
        narrow::Place { scalar, offset }
    };
    let records = Records {
        start,
        stride: usize::try_from(stride).ok()?,
        order,
        xyz: file.columns.xyz.map(place),
        intensity: file.columns.intensity.map(place),
    };
    let narrow = records.read(source, count)?;
    let about = Raw {
        encoding: file.data.name().to_owned(),
        fields: file.names,
        warnings: file.warnings,
        ..Raw::default()
    };
    Some((about, narrow))
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

pub(super) fn cut(element: &Element, held: u64) -> Fault {
    let Element {
        name, count, line, ..
    } = element;
    Fault::truncated(
        Place::Line(*line),
        format!("announces {count} of element {name} but the file holds {held}"),
    )
}

fn ascii(file: &Vertices, bytes: &[u8]) -> Result<Points, Fault> {
    let vertex = &file.vertex;
    let mut start = file.body;
    for element in file.before.iter().filter(|e| !e.properties.is_empty()) {
        let rest = bytes.get(start..).unwrap_or_default();
        start += skip_lines(rest, element.count).map_err(|held| cut(element, held))?;
    }
    let rest = bytes.get(start..).unwrap_or_default();
    let length = skip_lines(rest, vertex.count).map_err(|held| cut(vertex, held))?;
    let bytes = bytes.get(..start + length).unwrap_or(bytes);
    let with_intensity = file.columns.intensity.is_some();
    let rows = parse_rows(bytes, start, with_intensity, |line| file.row(line))?;
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

/// Vertices that all have the same size.
fn fixed(file: &Vertices, body: &[u8], order: Order, stride: u64) -> Result<Points, Fault> {
    file.check_held(body.len() as u64, stride)?;
    let (count, stride) = (file.vertex.count as usize, stride as usize);
    let column = |index: usize| {
        let (offset, scalar) = file.place(index);
        Column {
            scalar,
            order,
            bytes: body.get(offset..).unwrap_or_default(),
            stride,
        }
    };
    let points = Column::points(file.columns.xyz.map(column), count);
    let intensity = file.columns.intensity.map(|i| column(i).floats(count));
    Ok((points, intensity.unwrap_or_default()))
}

fn varied(file: &Vertices, body: &mut Body<&[u8]>) -> Result<Points, Fault> {
    let mut points = Vec::new();
    let mut intensity = Vec::new();
    file.varied(body, |row| {
        points.push(row.point);
        if file.columns.intensity.is_some() {
            intensity.push(row.intensity);
        }
        Ok(())
    })?;
    Ok((points, intensity))
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
