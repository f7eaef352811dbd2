//! PLY: read by `ply-rs-bw`, written here.

use std::io::ErrorKind;

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType,
    ScalarType,
};

use super::{Raw, quoted};
use crate::mesh::{Material, Mesh, Part};

/// The names that the list of a face's corners goes by.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];
/// Begins the comments that name the parts.
const PART: &str = "winze part";

pub(super) fn read(bytes: &[u8]) -> Result<Raw, String> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Vertex>::new()
        .read_header(&mut reader)
        .map_err(|e| explained(&e))?;
    let mut raw = Raw {
        parts: parts(&header),
        ..Raw::default()
    };
    check(&header, reader.get_ref().len())?;
    let mut faces = Vec::new();
    for element in header.elements.values() {
        match element.name.as_str() {
            "vertex" => {
                raw.vertices = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| explained(&e))?
                    .into_iter()
                    .map(|v| v.0)
                    .collect();
            }
            "face" => {
                faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| explained(&e))?;
                // Nothing behind the faces matters.
                if !raw.vertices.is_empty() {
                    break;
                }
            }
            _ => {
                Parser::<Passed>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| explained(&e))?;
            }
        }
    }
    let has_parts = !raw.parts.is_empty() && faces.iter().all(|f| f.part.is_some());
    for (i, face) in faces.iter().enumerate() {
        let corners = face.corners(raw.vertices.len()).map_err(|why| {
            format!("face {i} (from 0): {why}; the file is damaged, export it again")
        })?;
        let before = raw.triangles.len();
        raw.fan(&corners);
        if let Some(part) = face.part.filter(|_| has_parts) {
            if usize::from(part) >= raw.parts.len() {
                return Err(format!(
                    "face {i} (from 0): part {part}, but the header names {}; export it again",
                    raw.parts.len()
                ));
            }
            raw.part_of
                .extend(std::iter::repeat_n(part, raw.triangles.len() - before));
        }
    }
    Ok(raw)
}

/// Refuses what is no mesh, and counts that the file is too short for.
fn check(header: &Header, body: usize) -> Result<(), String> {
    let coordinates = |e: &ElementDef| {
        ["x", "y", "z"].iter().all(|name| {
            e.properties
                .get(*name)
                .is_some_and(|p| matches!(p.data_type, PropertyType::Scalar(_)))
        })
    };
    match header.elements.get("vertex") {
        Some(e) if coordinates(e) => {}
        _ => return Err("no vertices with x, y and z: export it as a triangle mesh".into()),
    }
    let face = header.elements.get("face").ok_or_else(|| {
        let hint = if header.elements.contains_key("tristrips") {
            "triangle strips are not read, export single triangles"
        } else {
            "export it as a mesh with faces, not as a point cloud"
        };
        format!("no triangles: {hint}")
    })?;
    let list = CORNERS.iter().any(|name| {
        face.properties
            .get(*name)
            .is_some_and(|p| matches!(p.data_type, PropertyType::List(..)))
    });
    let fixed = ["v1", "v2", "v3"]
        .iter()
        .all(|name| face.properties.contains_key(*name));
    if face.count > 0 && !list && !fixed {
        return Err(format!(
            "its faces have no `{}`: export it as a triangle mesh",
            CORNERS.join("` or `")
        ));
    }
    let mut least = 0usize;
    for e in header.elements.values() {
        let one: usize = if header.encoding == Encoding::Ascii {
            // A digit and a blank or a line's end each; the last line may lack its own.
            2 * e.properties.len()
        } else {
            e.properties
                .values()
                .map(|p| match &p.data_type {
                    PropertyType::Scalar(s) | PropertyType::List(s, _) => width(s),
                })
                .sum()
        };
        if one == 0 && e.count > 0 {
            return Err(format!("element {} has no properties", quoted(&e.name)));
        }
        least = e
            .count
            .checked_mul(one)
            .and_then(|n| n.checked_add(least))
            .unwrap_or(usize::MAX);
    }
    if least > body.saturating_add(1) {
        return Err(format!(
            "ends too early: its header announces at least {least} bytes, {body} are there; copy or export it again"
        ));
    }
    Ok(())
}

fn width(scalar: &ScalarType) -> usize {
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// The library's message, on one line, with what to do.
fn explained(error: &ParseError) -> String {
    let text = error.to_string();
    // Not the line itself: it may be binary, and long.
    let words = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.starts_with("String:"))
        .flat_map(str::split_whitespace);
    let clean: String = words.collect::<Vec<_>>().join(" ");
    let clean: String = clean
        .chars()
        .filter(|c| !c.is_control())
        .take(240)
        .collect();
    if error.kind() == ErrorKind::UnexpectedEof {
        format!("ends too early: {clean}; copy or export it again")
    } else {
        format!("no PLY as it should be: {clean}; export it again")
    }
}

/// The parts that the comments name, none unless all are in order.
fn parts(header: &Header) -> Vec<Part> {
    let mut out = Vec::new();
    for line in header.comments.iter().filter_map(|c| c.strip_prefix(PART)) {
        let mut words = line.trim_start().splitn(5, ' ');
        let mut next = || words.next().unwrap_or_default();
        let (index, reflectivity, wet, new, name) = (next(), next(), next(), next(), next());
        let (Ok(index), Ok(reflectivity), Ok(wet)) = (
            index.parse::<usize>(),
            reflectivity.parse::<f64>(),
            wet.parse::<f64>(),
        ) else {
            return Vec::new();
        };
        let share = |v: f64| (0.0..=1.0).contains(&v);
        if index != out.len() || !share(reflectivity) || !share(wet) {
            return Vec::new();
        }
        out.push(Part {
            name: printable(name),
            material: Material { reflectivity, wet },
            new: new == "new",
        });
    }
    out
}

/// A name with blanks for control characters, so that it stays on its line.
fn printable(name: &str) -> String {
    let blank = |c: char| if c.is_control() { ' ' } else { c };
    name.chars().map(blank).collect()
}

/// A mesh as binary little-endian PLY: vertices as `float`, faces with the index of their part, and comments
/// that name the parts. The same mesh gives the same bytes.
#[must_use]
pub fn to_ply_bytes(mesh: &Mesh) -> Vec<u8> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    for (i, part) in mesh.parts().iter().enumerate() {
        let name = printable(&part.name);
        let Material { reflectivity, wet } = part.material;
        let new = if part.new { "new" } else { "old" };
        header += &format!("comment {PART} {i} {reflectivity} {wet} {new} {name}\n");
    }
    header += &format!(
        "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar uint vertex_indices\nproperty ushort part\nend_header\n",
        mesh.vertices().len(),
        mesh.triangles().len()
    );
    let mut out =
        Vec::with_capacity(header.len() + 12 * mesh.vertices().len() + 15 * mesh.triangles().len());
    out.extend_from_slice(header.as_bytes());
    for c in mesh.vertices().iter().flatten() {
        out.extend_from_slice(&c.to_le_bytes());
    }
    for (t, part) in mesh.triangles().iter().zip(mesh.part_of()) {
        out.push(3);
        for i in t {
            out.extend_from_slice(&i.to_le_bytes());
        }
        out.extend_from_slice(&part.to_le_bytes());
    }
    out
}

/// An element that is passed over.
struct Passed;

impl PropertyAccess for Passed {
    fn new() -> Self {
        Self
    }
}

/// A vertex, not a number where the file gives none.
struct Vertex([f64; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([f64::NAN; 3])
    }

    fn set_property(&mut self, key: &str, value: Property) -> PropertyAccessResult {
        let axis = match key {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = match value {
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// A face: a list of corners, or three of them by name.
#[derive(Default)]
struct Face {
    list: Option<Vec<u32>>,
    fixed: [Option<u32>; 3],
    part: Option<u16>,
}

impl Face {
    /// The corners, checked against the number of vertices.
    fn corners(&self, vertices: usize) -> Result<Vec<u32>, String> {
        let corners = match &self.list {
            Some(list) => list.clone(),
            None => self.fixed.iter().filter_map(|c| *c).collect(),
        };
        if corners.len() < 3 {
            return Err(format!("{} corners", corners.len()));
        }
        match corners.iter().find(|c| **c as usize >= vertices) {
            Some(c) => Err(format!("vertex {c}, but there are {vertices}")),
            None => Ok(corners),
        }
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, key: &str, value: Property) -> PropertyAccessResult {
        if CORNERS.contains(&key) {
            // A negative index is no vertex either.
            self.list = value.to_u32_list();
            return match self.list {
                Some(_) => PropertyAccessResult::Set,
                None => PropertyAccessResult::UnsupportedType,
            };
        }
        let number = match value {
            Property::Char(v) => u32::try_from(v).ok(),
            Property::UChar(v) => Some(v.into()),
            Property::Short(v) => u32::try_from(v).ok(),
            Property::UShort(v) => Some(v.into()),
            Property::Int(v) => u32::try_from(v).ok(),
            Property::UInt(v) => Some(v),
            _ => None,
        };
        match key {
            "v1" => self.fixed[0] = number,
            "v2" => self.fixed[1] = number,
            "v3" => self.fixed[2] = number,
            "part" => self.part = number.and_then(|n| u16::try_from(n).ok()),
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}
