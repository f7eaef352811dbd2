//! How thick a map's walls are.

use std::collections::HashMap;

use winze::eigen3::eigen3;

/// Radius of a patch in voxels of the base.
pub(super) const PATCH: f64 = 3.0;
/// Patches that are measured.
const PATCHES: usize = 1_000;
/// Points that a patch must hold.
const LEAST: f64 = 8.0;

/// Count, sum and products of a patch's offsets from its middle.
#[derive(Clone, Copy, Default)]
struct Moments {
    count: f64,
    sum: [f64; 3],
    products: [f64; 6],
}

impl Moments {
    fn add(&mut self, d: [f64; 3]) {
        let [x, y, z] = d;
        self.count += 1.0;
        for (sum, v) in self.sum.iter_mut().zip(d) {
            *sum += v;
        }
        let products = [x * x, x * y, x * z, y * y, y * z, z * z];
        for (sum, v) in self.products.iter_mut().zip(products) {
            *sum += v;
        }
    }

    /// Mean square distance from the plane of best fit.
    fn thickness_squared(&self) -> f64 {
        let n = self.count;
        let [x, y, z] = self.sum.map(|s| s / n);
        let means = [x * x, x * y, x * z, y * y, y * z, z * z];
        let mut covariance = [0.0; 6];
        for ((c, p), m) in covariance.iter_mut().zip(self.products).zip(means) {
            *c = p / n - m;
        }
        let [least, ..] = eigen3(&covariance).values;
        least.max(0.0)
    }
}

/// The median over patches of `radius` metres of the root mean square distance of their points from a plane;
/// `None` where too few hold enough points.
pub(super) fn floor(points: &[[f32; 3]], radius: f64) -> Option<f64> {
    let stride = points.len().div_ceil(PATCHES).max(1);
    let middles: Vec<[f64; 3]> = points
        .iter()
        .step_by(stride)
        .map(|p| p.map(f64::from))
        .collect();
    #[expect(clippy::cast_possible_truncation, reason = "saturates")]
    let cell = |p: [f64; 3]| p.map(|v| (v / radius).floor() as i64);
    let mut near: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (i, p) in middles.iter().enumerate() {
        let [x, y, z] = cell(*p);
        for dz in -1..=1 {
            for dy in -1..=1 {
                for dx in -1..=1 {
                    near.entry([x + dx, y + dy, z + dz]).or_default().push(i);
                }
            }
        }
    }
    let mut patches = vec![Moments::default(); middles.len()];
    for p in points {
        let p = p.map(f64::from);
        for &i in near.get(&cell(p)).into_iter().flatten() {
            if let (Some([x, y, z]), Some(patch)) = (middles.get(i), patches.get_mut(i)) {
                let d = [p[0] - x, p[1] - y, p[2] - z];
                if d.iter().map(|v| v * v).sum::<f64>() <= radius * radius {
                    patch.add(d);
                }
            }
        }
    }
    let mut found: Vec<f64> = patches
        .iter()
        .filter(|p| p.count >= LEAST)
        .map(|p| p.thickness_squared().sqrt())
        .collect();
    found.sort_unstable_by(f64::total_cmp);
    (found.len() * 10 >= middles.len())
        .then(|| found.get(found.len() / 2).copied())
        .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;
    use winze::rng::Rng;

    #[test]
    fn the_thickness_of_a_noisy_wall() {
        let mut rng = Rng::new(3, 0);
        let points: Vec<[f32; 3]> = (0..40_000)
            .map(|_| {
                [
                    rng.range(0.0, 10.0),
                    0.02 * rng.normal(),
                    rng.range(0.0, 10.0),
                ]
                .map(|v| v as f32)
            })
            .collect();
        let found = floor(&points, 0.3).unwrap();
        // The plane of best fit takes a little of it.
        assert!((0.017..0.021).contains(&found), "{found}");
        assert_eq!(floor(&points[..200], 0.05), None);
        assert_eq!(floor(&[], 0.05), None);
    }
}
