//! The rock's triangles told apart: walls, floor, water, wet rock, and what was blasted since.

use rayon::prelude::*;

use super::field::Field;
use super::polygonise::Surface;
use crate::error::Result;
use crate::mesh::{Material, Mesh, Part};

/// Kinds of rock surface, in the order of their parts.
const KINDS: [&str; 4] = ["rock", "floor", "water", "wet rock"];

/// Adds the rock as parts `rock`, `floor`, `water` and `wet rock`, and again those that differ from what the
/// rock was `before`; parts without triangles are left out.
pub(super) fn add_rock(
    mesh: &mut Mesh,
    surface: &Surface,
    field: &Field,
    before: Option<&Field>,
) -> Result<()> {
    let moved: Vec<bool> = before.map_or_else(Vec::new, |before| {
        let vertices = surface.vertices.par_iter().with_min_len(4096);
        vertices
            .map(|v| differs(before, field, v.map(f64::from)))
            .collect()
    });
    let kinds: Vec<u8> = surface
        .triangles
        .par_iter()
        .with_min_len(4096)
        .map(|t| {
            let [a, b, c] = t.map(|i| surface.vertices.get(i as usize).map(|v| v.map(f64::from)));
            match (a, b, c) {
                (Some(a), Some(b), Some(c)) => {
                    let moved = t.iter().any(|i| moved.get(*i as usize) == Some(&true));
                    kind(field, [a, b, c]) + if moved { 4 } else { 0 }
                }
                _ => 0,
            }
        })
        .collect();
    let reflectivity = field.relief.rock().reflectivity;
    let material = |kind: usize| match kind {
        0 => Material {
            reflectivity,
            wet: 0.0,
        },
        1 => Material {
            reflectivity: 0.8 * reflectivity,
            wet: 0.0,
        },
        2 => Material {
            reflectivity: 0.3 * reflectivity,
            wet: 1.0,
        },
        _ => Material {
            reflectivity: 0.6 * reflectivity,
            wet: 0.4,
        },
    };
    let mut number = vec![u32::MAX; surface.vertices.len()];
    for kind in 0..2 * KINDS.len() {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        for (t, _) in surface
            .triangles
            .iter()
            .zip(&kinds)
            .filter(|(_, k)| usize::from(**k) == kind)
        {
            let corners = t.map(|i| {
                let slot = number.get_mut(i as usize)?;
                if *slot == u32::MAX {
                    *slot = u32::try_from(vertices.len()).ok()?;
                    vertices.push(*surface.vertices.get(i as usize)?);
                }
                Some(*slot)
            });
            if let [Some(a), Some(b), Some(c)] = corners {
                triangles.push([a, b, c]);
            }
        }
        number.fill(u32::MAX);
        if triangles.is_empty() {
            continue;
        }
        let part = Part {
            name: KINDS[kind % KINDS.len()].into(),
            material: material(kind % KINDS.len()),
            new: kind >= KINDS.len(),
        };
        mesh.add(part, &vertices, &triangles)?;
    }
    Ok(())
}

/// The number of a triangle's kind.
fn kind(field: &Field, [a, b, c]: [[f64; 3]; 3]) -> u8 {
    let middle: [f64; 3] = std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0);
    let u: [f64; 3] = std::array::from_fn(|i| b[i] - a[i]);
    let v: [f64; 3] = std::array::from_fn(|i| c[i] - a[i]);
    let n = [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ];
    let size = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    let wet = field.relief.is_wet(middle);
    // The net winds triangles so that they face the open; a floor faces up.
    let level = n[2] > 0.7 * size && {
        let near = field.near([middle, middle]);
        field.plan.at(middle, &near).up < 0.25 + field.relief.most()
    };
    match (level, wet) {
        (false, false) => 0,
        (true, false) => 1,
        (true, true) => 2,
        (false, true) => 3,
    }
}

/// Whether the rock about a vertex is other than it was: in its cell or those around, on whose corners the
/// vertex and its triangles depend.
fn differs(before: &Field, field: &Field, vertex: [f64; 3]) -> bool {
    let cell = field.relief.rock().cell;
    let low = vertex.map(|v| (v / cell).floor() - 1.0);
    let bounds = [low.map(|v| v * cell), low.map(|v| (v + 3.0) * cell)];
    let (near, near_now) = (before.near(bounds), field.near(bounds));
    near != near_now
        && (0..64u32).any(|n| {
            let by = [n % 4, n / 4 % 4, n / 16].map(f64::from);
            let p = std::array::from_fn(|a| (low[a] + by[a]) * cell);
            before.at(p, &near) != field.at(p, &near_now)
        })
}
