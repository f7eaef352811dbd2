//! Fewer points that look the same.

use winze::{Cloud, spacing, voxel};

/// A cloud's points, or one for each of many small cubes.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Thinned {
    /// In the cloud's frame, metres.
    pub(crate) points: Vec<[f64; 3]>,
    /// How far apart neighbours lie, metres.
    pub(crate) spacing: f64,
}

/// Cube sizes that are tried.
const TRIES: usize = 6;

impl Thinned {
    /// At most `most` points of `cloud`, as evenly spread as can be: a scanner leaves most of its points where it stood.
    pub(crate) fn of(cloud: &Cloud, most: usize) -> Self {
        let mut spacing = spacing::spacing(cloud.points()).unwrap_or(0.1);
        if cloud.len() <= most {
            return Self {
                points: cloud.iter().collect(),
                spacing,
            };
        }
        for _ in 0..TRIES {
            let thin = voxel::downsample(cloud, spacing);
            if thin.len() <= most {
                return Self {
                    points: thin.iter().collect(),
                    spacing,
                };
            }
            #[expect(clippy::cast_precision_loss, reason = "counts")]
            let over = thin.len() as f64 / most.max(1) as f64;
            // Surfaces: four times as many points at half the size.
            spacing *= 1.1 * over.sqrt();
        }
        Self {
            points: crate::picture::thin(cloud, most),
            spacing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_is_thinned_evenly() {
        let points: Vec<[f64; 3]> = (0..90_000)
            .map(|i| [f64::from(i % 300) * 0.01, f64::from(i / 300) * 0.01, 0.0])
            .collect();
        let (cloud, _) = Cloud::from_points(&points).unwrap();
        let all = Thinned::of(&cloud, 100_000);
        assert_eq!(all.points.len(), 90_000);
        assert!((all.spacing - 0.01).abs() < 1e-4);
        let few = Thinned::of(&cloud, 5_000);
        assert!(
            few.points.len() <= 5_000 && few.points.len() > 2_000,
            "{}",
            few.points.len()
        );
        let left = few.points.iter().filter(|p| p[0] < 1.5).count();
        assert!((left * 2).abs_diff(few.points.len()) < few.points.len() / 10);
        assert_eq!(Thinned::of(&Cloud::default(), 10).points.len(), 0);
    }
}
