//! Simple solids of triangles.

use winze::vec3::{cross, norm, sub};

/// Triangles of a part.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Solid {
    pub(super) vertices: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The unit vector of `v`; up where it has no direction.
pub(super) fn unit(v: [f64; 3]) -> [f64; 3] {
    let n = norm(v);
    if n > 1e-9 {
        v.map(|c| c / n)
    } else {
        [0.0, 0.0, 1.0]
    }
}

impl Solid {
    fn vertex(&mut self, p: [f64; 3]) -> u32 {
        let number = u32::try_from(self.vertices.len()).unwrap_or(u32::MAX);
        #[expect(clippy::cast_possible_truncation, reason = "metres near the origin")]
        self.vertices.push(p.map(|c| c as f32));
        number
    }

    fn quad(&mut self, [a, b, c, d]: [u32; 4]) {
        self.triangles.push([a, b, c]);
        self.triangles.push([a, c, d]);
    }

    /// Adds what another holds.
    pub(super) fn append(&mut self, other: Self) {
        let first = u32::try_from(self.vertices.len()).unwrap_or(u32::MAX);
        self.vertices.extend(other.vertices);
        let moved = other
            .triangles
            .into_iter()
            .map(|t| t.map(|i| first.saturating_add(i)));
        self.triangles.extend(moved);
    }

    /// A box about `centre` with these half edges as vectors.
    pub(super) fn block(&mut self, centre: [f64; 3], half: [[f64; 3]; 3]) {
        let corners: [u32; 8] = std::array::from_fn(|n| {
            let sign = |a: usize| if n >> a & 1 == 1 { 1.0 } else { -1.0 };
            self.vertex(std::array::from_fn(|i| {
                centre[i] + sign(0) * half[0][i] + sign(1) * half[1][i] + sign(2) * half[2][i]
            }))
        });
        let faces = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        for face in faces {
            self.quad(face.map(|i: usize| corners[i]));
        }
    }

    /// A closed tube along a line of points.
    pub(super) fn tube(&mut self, points: &[[f64; 3]], radius: f64, sides: u32) {
        let mut last: Option<Vec<u32>> = None;
        for (i, p) in points.iter().enumerate() {
            let before = points.get(i.wrapping_sub(1)).unwrap_or(p);
            let after = points.get(i + 1).unwrap_or(p);
            let along = unit(sub(*after, *before));
            let side = if along[2].abs() < 0.9 {
                [0.0, 0.0, 1.0]
            } else {
                [1.0, 0.0, 0.0]
            };
            let u = unit(cross(along, side));
            let v = cross(along, u);
            let ring: Vec<u32> = (0..sides)
                .map(|k| {
                    let a = std::f64::consts::TAU * (f64::from(k) + 0.5) / f64::from(sides);
                    let (c, s) = (radius * libm::cos(a), radius * libm::sin(a));
                    self.vertex(std::array::from_fn(|j| p[j] + c * u[j] + s * v[j]))
                })
                .collect();
            if let Some(last) = &last {
                let next = ring.iter().cycle().skip(1);
                let last_next = last.iter().cycle().skip(1);
                for (((a, b), c), d) in last.iter().zip(last_next).zip(next).zip(&ring) {
                    self.quad([*a, *b, *c, *d]);
                }
            }
            if i == 0 || i + 1 == points.len() {
                let middle = self.vertex(*p);
                for (a, b) in ring.iter().zip(ring.iter().cycle().skip(1)) {
                    self.triangles.push([middle, *a, *b]);
                }
            }
            last = Some(ring);
        }
    }

    /// A flat wire from `a` to `b` that faces `towards`.
    pub(super) fn strip(&mut self, a: [f64; 3], b: [f64; 3], towards: [f64; 3], width: f64) {
        let side = unit(cross(sub(b, a), towards)).map(|c| 0.5 * width * c);
        let off = |p: [f64; 3], by: f64| std::array::from_fn(|i| p[i] + by * side[i]);
        let corners = [off(a, -1.0), off(b, -1.0), off(b, 1.0), off(a, 1.0)];
        let corners = corners.map(|p| self.vertex(p));
        self.quad(corners);
    }

    /// A round heap: `height_at(r, angle)` above `centre`, for shares `r` of the radius from 0 to 1.
    pub(super) fn heap(
        &mut self,
        centre: [f64; 3],
        radius: f64,
        height_at: impl Fn(f64, f64) -> f64,
    ) {
        const RINGS: u32 = 12;
        const SECTORS: u32 = 30;
        let top = self.vertex([centre[0], centre[1], centre[2] + height_at(0.0, 0.0)]);
        let mut last: Option<Vec<u32>> = None;
        for ring in 1..=RINGS {
            let r = f64::from(ring) / f64::from(RINGS);
            let points: Vec<u32> = (0..SECTORS)
                .map(|k| {
                    let a = std::f64::consts::TAU * f64::from(k) / f64::from(SECTORS);
                    self.vertex([
                        centre[0] + r * radius * libm::cos(a),
                        centre[1] + r * radius * libm::sin(a),
                        centre[2] + height_at(r, a),
                    ])
                })
                .collect();
            let next = points.iter().cycle().skip(1);
            match &last {
                None => {
                    for (a, b) in points.iter().zip(next) {
                        self.triangles.push([top, *a, *b]);
                    }
                }
                Some(last) => {
                    let last_next = last.iter().cycle().skip(1);
                    for (((a, b), c), d) in last.iter().zip(&points).zip(next).zip(last_next) {
                        self.quad([*a, *b, *c, *d]);
                    }
                }
            }
            last = Some(points);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume enclosed by consistently wound triangles, by the divergence theorem.
    fn volume(s: &Solid) -> f64 {
        let at = |i: u32| s.vertices[i as usize].map(f64::from);
        let six = s.triangles.iter().map(|t| {
            let [a, b, c] = t.map(at);
            let n = cross(b, c);
            a[0] * n[0] + a[1] * n[1] + a[2] * n[2]
        });
        (six.sum::<f64>() / 6.0).abs()
    }

    #[test]
    fn a_block_has_its_volume() {
        let mut s = Solid::default();
        s.block(
            [1.0, 2.0, 3.0],
            [[1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 2.0]],
        );
        assert_eq!((s.vertices.len(), s.triangles.len()), (8, 12));
        assert!((volume(&s) - 8.0).abs() < 1e-5);
    }

    #[test]
    fn a_tube_has_its_radius_all_along() {
        let mut s = Solid::default();
        s.tube(&[[0.0; 3], [2.0, 0.0, 0.0], [5.0, 0.0, 0.0]], 0.1, 8);
        assert_eq!(s.triangles.len(), 2 * 16 + 16);
        for v in &s.vertices {
            let r = (v[1] * v[1] + v[2] * v[2]).sqrt();
            assert!(r < 1e-6 || (r - 0.1).abs() < 1e-6);
        }
    }

    #[test]
    fn heaps_and_strips_have_area() {
        let mut s = Solid::default();
        s.heap([0.0; 3], 2.0, |r, _| 1.0 - r);
        assert_eq!(s.triangles.len(), 30 + 11 * 60);
        s.strip([0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], 0.02);
        let mut both = s.clone();
        both.append(s.clone());
        assert_eq!(both.triangles.len(), 2 * s.triangles.len());
        assert!(
            both.triangles
                .iter()
                .flatten()
                .all(|i| (*i as usize) < both.vertices.len())
        );
    }
}
