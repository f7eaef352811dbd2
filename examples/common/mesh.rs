//! Points on a triangle mesh.

use winze::rng::Rng;
use winze_sim::mesh_file::read_mesh;

use super::Result;

/// The corners of the triangles of a mesh file.
pub fn triangles(path: &std::path::Path) -> Result<Vec<[[f64; 3]; 3]>> {
    let (mesh, _) = read_mesh(path)?;
    Ok((0..mesh.triangles().len())
        .filter_map(|i| mesh.corners(i))
        .map(|corners| corners.map(|v| v.map(f64::from)))
        .collect())
}

/// About 120 points a square metre on the triangles, 2 cm noise, those inside the region.
pub fn sample(
    triangles: &[[[f64; 3]; 3]],
    seed: u64,
    inside: impl Fn([f64; 3]) -> bool,
) -> Vec<[f64; 3]> {
    let mut rng = Rng::new(seed, 11);
    let mut out = Vec::new();
    let mut owed = 0.0;
    for [a, b, c] in triangles {
        let (u, v): ([f64; 3], [f64; 3]) = (
            std::array::from_fn(|i| b[i] - a[i]),
            std::array::from_fn(|i| c[i] - a[i]),
        );
        let n = [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ];
        owed += 120.0 * 0.5 * (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
        while owed >= 1.0 {
            owed -= 1.0;
            let (mut s, mut t) = (rng.uniform(), rng.uniform());
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let p: [f64; 3] =
                std::array::from_fn(|i| a[i] + s * u[i] + t * v[i] + 0.02 * rng.normal());
            if inside(p) {
                out.push(p);
            }
        }
    }
    out
}
