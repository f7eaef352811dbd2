//! Triangles with a material each: what rays meet.

use crate::error::{Error, Result};

/// How a surface answers light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Material {
    /// Share of near-infrared light given back diffusely, 0 to 1: 0.1 coal, 0.3 grey rock, 0.5 shotcrete.
    pub reflectivity: f64,
    /// How wet it is, 0 dry to 1 standing water: the probability that a shot at grazing incidence is
    /// mirrored away rather than given back.
    pub wet: f64,
}

impl Material {
    /// Dry grey rock.
    pub const ROCK: Self = Self {
        reflectivity: 0.3,
        wet: 0.0,
    };
}

/// Triangles that belong together: the rock, a pipe, a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// What it is, such as `rock`, `floor`, `pipe`, `vehicle`.
    pub name: String,
    /// How it answers light.
    pub material: Material,
    /// It was not there when the map was made , or not in this shape.
    pub new: bool,
}

/// A triangle mesh in the frame of its world: metres, z up, near the origin.
///
/// Every vertex is finite, every index valid and no triangle without area: [`Mesh::add`] sees to it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    vertices: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    part_of: Vec<u16>,
    parts: Vec<Part>,
}

/// What [`Mesh::add`] had to leave out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// Triangles with a corner that is not finite or does not exist.
    pub broken: usize,
    /// Triangles without area.
    pub degenerate: usize,
}

impl Mesh {
    /// A mesh of one part.
    ///
    /// # Errors
    /// As [`Mesh::add`].
    pub fn of(
        part: Part,
        vertices: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) -> Result<(Self, LeftOut)> {
        let mut mesh = Self::default();
        let left_out = mesh.add(part, vertices, triangles)?;
        Ok((mesh, left_out))
    }

    /// Adds a part. Triangles that nothing can hit are left out and counted; which way one is wound does
    /// not matter.
    ///
    /// # Errors
    /// [`Error::TooLarge`] beyond `u32` vertices or `u16` parts.
    pub fn add(
        &mut self,
        part: Part,
        vertices: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) -> Result<LeftOut> {
        let too_large = |what| Error::TooLarge { what };
        let index = u16::try_from(self.parts.len()).map_err(|_| too_large("parts"))?;
        let first = u32::try_from(self.vertices.len()).map_err(|_| too_large("vertices"))?;
        u32::try_from(self.vertices.len() + vertices.len()).map_err(|_| too_large("vertices"))?;
        u32::try_from(self.triangles.len() + triangles.len())
            .map_err(|_| too_large("triangles"))?;
        let mut left_out = LeftOut::default();
        // A vertex that is not finite stays in its place, so that indices hold, but nothing refers to it.
        let sound = |v: &[f32; 3]| v.iter().all(|c| c.is_finite() && c.abs() < MAX_COORDINATE);
        self.vertices.extend(
            vertices
                .iter()
                .map(|v| if sound(v) { *v } else { [0.0; 3] }),
        );
        for t in triangles {
            let corners = t.map(|i| vertices.get(i as usize).filter(|v| sound(v)));
            let [Some(a), Some(b), Some(c)] = corners else {
                left_out.broken += 1;
                continue;
            };
            if twice_area(*a, *b, *c) <= MIN_TWICE_AREA {
                left_out.degenerate += 1;
                continue;
            }
            self.triangles.push(t.map(|i| first + i));
            self.part_of.push(index);
        }
        self.parts.push(part);
        Ok(left_out)
    }

    /// Corners, some of which may belong to no triangle.
    #[must_use]
    pub fn vertices(&self) -> &[[f32; 3]] {
        &self.vertices
    }

    /// Indices of each triangle's corners.
    #[must_use]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The parts.
    #[must_use]
    pub fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Index into [`Mesh::parts`] of each triangle's part.
    #[must_use]
    pub fn part_of(&self) -> &[u16] {
        &self.part_of
    }

    /// The corners of triangle `i`, `None` where there is none.
    #[must_use]
    pub fn corners(&self, i: usize) -> Option<[[f32; 3]; 3]> {
        let t = self.triangles.get(i)?;
        let [a, b, c] = t.map(|v| self.vertices.get(v as usize).copied());
        Some([a?, b?, c?])
    }

    /// Least and greatest coordinates over all triangles, `None` where there are none.
    #[must_use]
    pub fn bounds(&self) -> Option<([f32; 3], [f32; 3])> {
        let mut bounds: Option<([f32; 3], [f32; 3])> = None;
        for v in self.triangles.iter().flatten() {
            let Some(v) = self.vertices.get(*v as usize) else {
                continue;
            };
            let (low, high) = bounds.get_or_insert((*v, *v));
            for a in 0..3 {
                low[a] = low[a].min(v[a]);
                high[a] = high[a].max(v[a]);
            }
        }
        bounds
    }
}

/// Further than this from the origin, metres, `f32` would lose a centimetre.
const MAX_COORDINATE: f32 = 60_000.0;
/// Triangles with less than twice this area, square metres, have no direction.
const MIN_TWICE_AREA: f64 = 1e-10;

fn twice_area(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> f64 {
    let d = |p: [f32; 3], q: [f32; 3]| -> [f64; 3] {
        std::array::from_fn(|i| f64::from(q[i]) - f64::from(p[i]))
    };
    let (u, v) = (d(a, b), d(a, c));
    let n = [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ];
    (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rock() -> Part {
        Part {
            name: "rock".into(),
            material: Material::ROCK,
            new: false,
        }
    }

    #[test]
    fn what_nothing_can_hit_is_left_out_and_counted() {
        let vertices = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [f32::NAN, 0.0, 0.0],
            [2.0, 0.0, 0.0],
        ];
        let triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 9], [0, 1, 4], [1, 1, 2]];
        let (mesh, left_out) = Mesh::of(rock(), &vertices, &triangles).unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2]]);
        assert_eq!((left_out.broken, left_out.degenerate), (2, 2));
        assert_eq!(mesh.bounds(), Some(([0.0; 3], [1.0, 1.0, 0.0])));
        assert_eq!(Mesh::default().bounds(), None);
    }

    #[test]
    fn parts_are_kept_apart() {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mut mesh = Mesh::default();
        mesh.add(rock(), &vertices, &[[0, 1, 2]]).unwrap();
        mesh.add(rock(), &vertices.map(|v| [v[0], v[1], 5.0]), &[[2, 1, 0]])
            .unwrap();
        assert_eq!(mesh.part_of(), [0, 1]);
        assert_eq!(mesh.corners(1).unwrap()[0], [0.0, 1.0, 5.0]);
        assert_eq!(mesh.corners(2), None);
    }
}
