//! Points on a triangle mesh.

use winze::rng::Rng;

use super::Result;

/// Triangles of the mesh. (A reader of meshes belongs to the simulator; this one knows the one file.)
pub fn triangles(path: &std::path::Path) -> Result<Vec<[[f64; 3]; 3]>> {
    let bytes = std::fs::read(path)?;
    let marker = b"end_header\n";
    let start = bytes
        .windows(marker.len())
        .position(|w| w == marker)
        .ok_or("no header")?
        + marker.len();
    let header = String::from_utf8_lossy(&bytes[..start]).into_owned();
    let count = |element: &str| -> Result<usize> {
        let line = header
            .lines()
            .find_map(|l| l.strip_prefix(&format!("element {element} ")))
            .ok_or("no element")?;
        Ok(line.trim().parse()?)
    };
    let (vertices, faces) = (count("vertex")?, count("face")?);
    let float = |at: usize| -> Result<f64> {
        let b: [u8; 4] = bytes.get(at..at + 4).ok_or("file cut short")?.try_into()?;
        Ok(f64::from(f32::from_le_bytes(b)))
    };
    let vertex = |i: usize| -> Result<[f64; 3]> {
        Ok([
            float(start + 12 * i)?,
            float(start + 12 * i + 4)?,
            float(start + 12 * i + 8)?,
        ])
    };
    let first_face = start + 12 * vertices;
    (0..faces)
        .map(|f| {
            let at = first_face + 13 * f;
            let corner = |k: usize| -> Result<[f64; 3]> {
                let b: [u8; 4] = bytes
                    .get(at + 1 + 4 * k..at + 5 + 4 * k)
                    .ok_or("file cut short")?
                    .try_into()?;
                vertex(u32::from_le_bytes(b) as usize)
            };
            Ok([corner(0)?, corner(1)?, corner(2)?])
        })
        .collect()
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
