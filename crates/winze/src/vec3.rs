//! Vectors of three numbers.

/// `a + b`.
#[must_use]
pub fn add(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[must_use]
pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `a` times `s`.
#[must_use]
pub fn scale(a: [f64; 3], s: f64) -> [f64; 3] {
    a.map(|v| v * s)
}

/// The scalar product.
#[must_use]
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product.
#[must_use]
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// Its length.
#[must_use]
pub fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// The distance between two points.
#[must_use]
pub fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    norm(sub(a, b))
}

/// The length of a line of points.
#[must_use]
pub fn line_length(line: &[[f64; 3]]) -> f64 {
    line.windows(2)
        .map(|ends| match ends {
            [a, b] => distance(*a, *b),
            _ => 0.0,
        })
        .sum()
}

/// The voxel of an edge, metres, that a point lies in.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    reason = "nothing is 2^63 voxels wide"
)]
pub fn voxel_of(point: [f64; 3], edge: f64) -> [i64; 3] {
    point.map(|v| (v / edge).floor() as i64)
}
