//! Triangle meshes in files: PLY, STL and OBJ are read, PLY is written.
//!
//! Coordinates are read in double precision. Where a mesh lies far from the origin of its coordinates (a
//! survey grid), a whole number of metres is subtracted before it is stored, and reported.
//!
//! STL and OBJ are read here rather than by a library, because those at hand read single precision only, in
//! which a survey grid's coordinates are half a metre apart.

mod obj;
mod ply;
mod stl;

use std::path::Path;

use rustc_hash::FxHashMap;

use crate::error::{Error, Result};
use crate::mesh::{LeftOut, Material, Mesh, Part};

pub use ply::to_ply_bytes;

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// Polygon file format: ascii, binary of either byte order.
    Ply,
    /// Stereolithography: ascii or binary.
    Stl,
    /// Wavefront.
    Obj,
}

impl MeshFormat {
    /// The kind that the name of a file ends in, in either case.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "ply" => Some(Self::Ply),
            "stl" => Some(Self::Stl),
            "obj" => Some(Self::Obj),
            _ => None,
        }
    }
}

/// What was read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeshReport {
    /// Triangles in the mesh; polygons of more corners count as the triangles they were cut into.
    pub triangles: usize,
    /// Triangles of the file that are not in the mesh.
    pub left_out: LeftOut,
    /// Subtracted from the coordinates of the file, metres: `mesh = file - origin`. Zero in each direction
    /// in which the mesh lies within 5 km of the file's own origin.
    pub origin: [f64; 3],
}

/// Reads a mesh. Parts are those that [`write_mesh`] wrote; a mesh from elsewhere is one part, `mesh`, of
/// dry grey rock.
///
/// # Errors
/// [`Error::MeshFile`] where the file cannot be opened, has an unknown extension, ends too early or is
/// malformed; where it has no triangle that could be hit.
pub fn read_mesh(path: &Path) -> Result<(Mesh, MeshReport)> {
    read_mesh_about(path, None)
}

/// Reads a mesh as [`read_mesh`], but with this `origin` subtracted, that of another mesh in whose frame it is to be.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_about(path: &Path, origin: Option<[f64; 3]>) -> Result<(Mesh, MeshReport)> {
    let wrong = |why: String| Error::MeshFile {
        path: path.to_path_buf(),
        why,
    };
    let format = MeshFormat::of(path)
        .ok_or_else(|| wrong("no mesh by its name: .ply, .stl and .obj are read".into()))?;
    let bytes = std::fs::read(path).map_err(|e| wrong(format!("cannot be read: {e}")))?;
    read(&bytes, format, origin).map_err(wrong)
}

/// Reads a mesh from memory, as [`read_mesh`].
///
/// # Errors
/// As [`read_mesh`]; the path is empty.
pub fn read_mesh_bytes(bytes: &[u8], format: MeshFormat) -> Result<(Mesh, MeshReport)> {
    read(bytes, format, None).map_err(|why| Error::MeshFile {
        path: "(memory)".into(),
        why,
    })
}

/// Writes a mesh as binary PLY with the part of every triangle. The same mesh gives the same bytes.
///
/// # Errors
/// [`Error::MeshFile`] where the file cannot be written.
pub fn write_mesh(path: &Path, mesh: &Mesh) -> Result<()> {
    std::fs::write(path, to_ply_bytes(mesh)).map_err(|e| Error::MeshFile {
        path: path.to_path_buf(),
        why: format!("cannot be written: {e}"),
    })
}

fn read(
    bytes: &[u8],
    format: MeshFormat,
    origin: Option<[f64; 3]>,
) -> std::result::Result<(Mesh, MeshReport), String> {
    let raw = match format {
        MeshFormat::Ply => ply::read(bytes),
        MeshFormat::Stl => stl::read(bytes),
        MeshFormat::Obj => obj::read(bytes),
    }?;
    raw.finish(origin)
}

/// What a file holds, before it is a mesh.
#[derive(Default)]
struct Raw {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    /// The part of each triangle, or empty.
    part_of: Vec<u16>,
    parts: Vec<Part>,
}

impl Raw {
    /// Adds a polygon as a fan of triangles around its first corner.
    fn fan(&mut self, corners: &[u32]) {
        if let [first, rest @ ..] = corners {
            for pair in rest.windows(2) {
                if let [b, c] = pair {
                    self.triangles.push([*first, *b, *c]);
                }
            }
        }
    }

    fn finish(
        mut self,
        origin: Option<[f64; 3]>,
    ) -> std::result::Result<(Mesh, MeshReport), String> {
        let found = self.triangles.len();
        if found == 0 {
            return Err(format!(
                "no triangles ({} vertices): export it as a mesh with faces, not as a point cloud",
                self.vertices.len()
            ));
        }
        let origin = origin.unwrap_or_else(|| self.middle());
        self.move_by(origin);
        if self.part_of.len() != found || self.parts.is_empty() {
            self.part_of = vec![0; found];
            self.parts = vec![Part {
                name: "mesh".into(),
                material: Material::ROCK,
                new: false,
            }];
        }
        let mut mesh = Mesh::default();
        let mut left_out = LeftOut::default();
        for (index, part) in (0u16..).zip(std::mem::take(&mut self.parts)) {
            let (vertices, triangles) = self.of_part(index);
            let out = mesh
                .add(part, &vertices, &triangles)
                .map_err(|e| e.to_string())?;
            left_out.broken += out.broken;
            left_out.degenerate += out.degenerate;
        }
        if mesh.triangles().is_empty() {
            return Err(format!(
                "none of its {found} triangles could be hit: {} have a corner that is not a number or lies \
                 more than 60 km away, {} have no area; export it again, in metres",
                left_out.broken, left_out.degenerate
            ));
        }
        let report = MeshReport {
            triangles: mesh.triangles().len(),
            left_out,
            origin,
        };
        Ok((mesh, report))
    }

    /// The vertices that the triangles of a part refer to, in the order in which they do, and these triangles.
    fn of_part(&self, part: u16) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let mut new_index = vec![u32::MAX; self.vertices.len()];
        let mut vertices: Vec<[f32; 3]> = Vec::new();
        let mut triangles = Vec::new();
        for (t, _) in self
            .triangles
            .iter()
            .zip(&self.part_of)
            .filter(|(_, p)| **p == part)
        {
            triangles.push(t.map(|old| {
                let (Some(new), Some(v)) = (
                    new_index.get_mut(old as usize),
                    self.vertices.get(old as usize),
                ) else {
                    return u32::MAX;
                };
                if *new == u32::MAX {
                    *new = u32::try_from(vertices.len()).unwrap_or(u32::MAX);
                    #[expect(clippy::cast_possible_truncation, reason = "near the origin")]
                    vertices.push(v.map(|c| c as f32));
                }
                *new
            }));
        }
        (vertices, triangles)
    }

    /// The rounded median of each coordinate where that is far from zero, else zero.
    fn middle(&self) -> [f64; 3] {
        std::array::from_fn(|a| {
            let mut values: Vec<f64> = self
                .vertices
                .iter()
                .map(|v| v[a])
                .filter(|c| c.is_finite())
                .collect();
            let middle = values.len() / 2;
            if middle >= values.len() {
                return 0.0;
            }
            let (_, median, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
            if median.abs() > FAR {
                median.round()
            } else {
                0.0
            }
        })
    }

    fn move_by(&mut self, origin: [f64; 3]) {
        if origin != [0.0; 3] {
            for v in &mut self.vertices {
                *v = std::array::from_fn(|a| v[a] - origin[a]);
            }
        }
    }
}

/// Coordinates whose median is further than this from zero are moved, metres: `f32` is good to half a
/// millimetre up to here.
const FAR: f64 = 5_000.0;

/// Numbers for points, the same for equal ones.
#[derive(Default)]
struct Merged {
    index: FxHashMap<[u64; 3], u32>,
}

impl Merged {
    fn add(&mut self, vertices: &mut Vec<[f64; 3]>, v: [f64; 3]) -> u32 {
        // Minus zero is zero.
        let key = v.map(|c| (c + 0.0).to_bits());
        *self.index.entry(key).or_insert_with(|| {
            vertices.push(v);
            u32::try_from(vertices.len() - 1).unwrap_or(u32::MAX)
        })
    }
}

/// The first words of a foreign text, printable.
fn quoted(text: &str) -> String {
    let clean: String = text
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .take(60)
        .collect();
    format!("{:?}", clean.trim())
}

/// A coordinate in a text.
fn number(token: Option<&str>, line: usize) -> std::result::Result<f64, String> {
    let token = token.ok_or_else(|| format!("line {line}: a coordinate is missing"))?;
    token
        .parse()
        .map_err(|_| format!("line {line}: {} is no number", quoted(token)))
}

#[cfg(test)]
mod tests;
