//! What a ray meets and what lies nearest, in a [`Mesh`].
//!
//! The tree over the triangles is parry's, in `f32` with boxes widened by what `f32` may lose; every
//! triangle it leads to is measured in `f64`. So a range is as exact as the corners, the nearest
//! triangle is the nearest (the lowest index where two tie), and a ray does not slip through the edge that
//! two triangles share (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2013).

use std::cell::Cell;

use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode};
use parry3d::query::Ray;
use winze::vec3::{add, cross, dot, norm, scale, sub};

use crate::error::{Error, Result};
use crate::mesh::Mesh;

/// Where a ray meets the mesh first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Way from the ray's origin, in lengths of its direction: metres where that is a unit vector.
    pub range: f64,
    /// Index of the triangle.
    pub triangle: u32,
    /// Index of its part in [`Mesh::parts`].
    pub part: u16,
    /// Unit normal of the triangle, on the side from which the ray comes.
    pub normal: [f64; 3],
}

/// The point of the mesh nearest to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Its distance, metres.
    pub distance: f64,
    /// The point of the mesh.
    pub point: [f64; 3],
    /// Unit normal of the triangle, on the side of the point that asked.
    pub normal: [f64; 3],
    /// Index of the triangle.
    pub triangle: u32,
    /// Index of its part in [`Mesh::parts`].
    pub part: u16,
}

/// A mesh with a tree over its triangles.
pub struct Caster {
    mesh: Mesh,
    tree: Bvh,
    /// Bounds of all triangles, widened like the boxes of the tree.
    low: [f64; 3],
    high: [f64; 3],
}

/// The most triangles that the tree numbers.
const MAX_TRIANGLES: usize = 1 << 30;

impl Caster {
    /// Builds the tree.
    ///
    /// # Errors
    /// [`Error::EmptyMesh`] without a triangle, [`Error::TooLarge`] beyond 2³⁰.
    pub fn new(mesh: Mesh) -> Result<Self> {
        let (low, high) = mesh.bounds().ok_or(Error::EmptyMesh {
            broken: 0,
            degenerate: 0,
        })?;
        if mesh.triangles().len() > MAX_TRIANGLES {
            return Err(Error::TooLarge { what: "triangles" });
        }
        // What coordinates of this size lose in `f32`, a few times over.
        let reach = (0..3)
            .map(|a| low[a].abs().max(high[a].abs()) + (high[a] - low[a]))
            .fold(0.0, f32::max);
        let margin = 8.0 * f32::EPSILON * reach;
        let boxes: Vec<Aabb> = (0..mesh.triangles().len())
            .map(|i| {
                let [a, b, c] = mesh
                    .corners(i)
                    .unwrap_or_default()
                    .map(|v| Vector::new(v[0], v[1], v[2]));
                Aabb::new(a.min(b).min(c) - margin, a.max(b).max(c) + margin)
            })
            .collect();
        Ok(Self {
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            mesh,
            low: low.map(|v| f64::from(v - margin)),
            high: high.map(|v| f64::from(v + margin)),
        })
    }

    /// The mesh.
    #[must_use]
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Bytes that the tree takes, beside the mesh.
    #[must_use]
    pub fn tree_bytes(&self) -> usize {
        self.tree.total_memory_size()
    }

    /// The first triangle in front of `origin` along `direction`, a unit vector, whichever way it is
    /// wound; `None` where there is none within `max_range` metres, or where an argument is not finite or
    /// zero (`max_range` may be infinite). A triangle that touches the origin itself is not in front of it.
    #[must_use]
    pub fn cast(&self, origin: [f64; 3], direction: [f64; 3], max_range: f64) -> Option<Hit> {
        if !(max_range > 0.0) || !origin.iter().all(|v| v.is_finite()) {
            return None;
        }
        let line = Line::new(direction)?;
        let (enter, leave) = self.within_bounds(origin, direction)?;
        let last = max_range.min(leave);
        if enter > last {
            return None;
        }
        // From where it enters the bounds, `f32` is good enough for the boxes.
        let start = add(origin, scale(direction, enter));
        let best: Cell<Option<(f64, u32)>> = Cell::new(None);
        let vector = |v: [f64; 3]| Vector::new(narrow(v[0]), narrow(v[1]), narrow(v[2]));
        let ray = Ray::new(vector(start), vector(direction));
        self.tree
            .cast_ray(&ray, ceiling(last - enter), |triangle, _| {
                let corners = self.mesh.corners(triangle as usize)?;
                let way = enter + line.meets(start, corners.map(|c| c.map(f64::from)))?;
                if !(way > 0.0 && way <= max_range) {
                    return None;
                }
                if best.get().is_none_or(|b| (way, triangle) < b) {
                    best.set(Some((way, triangle)));
                }
                Some(ceiling(way - enter))
            });
        let (range, triangle) = best.get()?;
        let normal = self.normal(triangle)?;
        let facing = if dot(normal, direction) > 0.0 {
            scale(normal, -1.0)
        } else {
            normal
        };
        Some(Hit {
            range,
            triangle,
            part: self.part(triangle),
            normal: facing,
        })
    }

    /// The nearest point of the mesh no further than `within` metres from `point`; `None` where there is
    /// none or where an argument is not a number (`within` may be infinite).
    #[must_use]
    pub fn nearest(&self, point: [f64; 3], within: f64) -> Option<Nearest> {
        if !(within >= 0.0) || !point.iter().all(|v| v.is_finite()) {
            return None;
        }
        let best: Cell<Option<(f64, u32, [f64; 3])>> = Cell::new(None);
        self.tree.find_best(
            ceiling(within),
            |node: &BvhNode, _| {
                let (low, high) = (node.mins().to_array(), node.maxs().to_array());
                let outside = std::array::from_fn(|a| {
                    let p = point[a];
                    (f64::from(low[a]) - p).max(p - f64::from(high[a])).max(0.0)
                });
                narrow(norm(outside))
            },
            |triangle, _| {
                let corners = self.mesh.corners(triangle as usize)?;
                let on = closest_point(point, corners.map(|c| c.map(f64::from)));
                let distance = norm(sub(point, on));
                if !(distance <= within) {
                    return None;
                }
                if best
                    .get()
                    .is_none_or(|(d, t, _)| (distance, triangle) < (d, t))
                {
                    best.set(Some((distance, triangle, on)));
                }
                Some(ceiling(distance))
            },
        );
        let (distance, triangle, on) = best.get()?;
        let normal = self.normal(triangle)?;
        let facing = if dot(normal, sub(point, on)) < 0.0 {
            scale(normal, -1.0)
        } else {
            normal
        };
        Some(Nearest {
            distance,
            point: on,
            normal: facing,
            triangle,
            part: self.part(triangle),
        })
    }

    /// Where a line enters and leaves the bounds of the mesh, ahead of its origin.
    fn within_bounds(&self, origin: [f64; 3], direction: [f64; 3]) -> Option<(f64, f64)> {
        let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
        for a in 0..3 {
            if direction[a] == 0.0 {
                if origin[a] < self.low[a] || origin[a] > self.high[a] {
                    return None;
                }
                continue;
            }
            let s = (self.low[a] - origin[a]) / direction[a];
            let t = (self.high[a] - origin[a]) / direction[a];
            enter = enter.max(s.min(t));
            leave = leave.min(s.max(t));
        }
        (enter <= leave && enter.is_finite()).then_some((enter, leave))
    }

    fn part(&self, triangle: u32) -> u16 {
        let part = self.mesh.part_of().get(triangle as usize);
        part.copied().unwrap_or_default()
    }

    fn normal(&self, triangle: u32) -> Option<[f64; 3]> {
        let [a, b, c] = self
            .mesh
            .corners(triangle as usize)?
            .map(|v| v.map(f64::from));
        let n = cross(sub(b, a), sub(c, a));
        Some(scale(n, 1.0 / norm(n)))
    }
}

/// A direction, prepared: the axis it follows most comes last, the others are sheared onto it.
struct Line {
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Line {
    /// `None` unless the direction is finite and not zero.
    fn new(direction: [f64; 3]) -> Option<Self> {
        let size = direction.map(f64::abs);
        let z = if size[0] > size[1] && size[0] > size[2] {
            0
        } else if size[1] > size[2] {
            1
        } else {
            2
        };
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        let d = axes.map(|a| direction[a]);
        let shear = [d[0] / d[2], d[1] / d[2], 1.0 / d[2]];
        (norm(direction) > 0.0 && shear.iter().all(|v| v.is_finite()))
            .then_some(Self { axes, shear })
    }

    /// Way from `origin` to a triangle, `None` where the line passes it or runs in its plane. Not negative.
    fn meets(&self, origin: [f64; 3], corners: [[f64; 3]; 3]) -> Option<f64> {
        let [x, y, z] = self.axes;
        let sheared = corners.map(|c| {
            let d = sub(c, origin);
            [
                d[x] - self.shear[0] * d[z],
                d[y] - self.shear[1] * d[z],
                self.shear[2] * d[z],
            ]
        });
        let [a, b, c] = sheared;
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let total = u + v + w;
        if total == 0.0 {
            return None;
        }
        let way = (u * a[2] + v * b[2] + w * c[2]) / total;
        (way >= 0.0).then_some(way)
    }
}

/// The point of a triangle nearest to `p` (Ericson, "Real-Time Collision Detection", 5.1.5).
fn closest_point(p: [f64; 3], [a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let (ab, ac) = (sub(b, a), sub(c, a));
    let ap = sub(p, a);
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return add(a, scale(ab, d1 / (d1 - d3)));
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return add(a, scale(ac, d2 / (d2 - d6)));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return add(b, scale(sub(c, b), share));
    }
    let total = va + vb + vc;
    add(a, add(scale(ab, vb / total), scale(ac, vc / total)))
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "for the boxes, which are widened"
)]
fn narrow(v: f64) -> f32 {
    v as f32
}

/// Not below `v` after rounding to `f32`, and above what the boxes at that distance may round to; finite,
/// since a missed box counts as infinitely far.
fn ceiling(v: f64) -> f32 {
    narrow(v * (1.0 + 1e-6) + 1e-30).min(f32::MAX)
}

#[cfg(test)]
mod tests;
