//! The quick way from a file to a cloud: straight into its 32-bit offsets, a block at a time, with nothing held beside them. From (0, 0, 0)
//! where all coordinates are small; of binary [`Records`] also from another origin.
//!
//! It is taken where nothing is odd. Everything else, and whatever is wrong with a file, is left to the decoders that
//! hold coordinates in 64 bits: they say what they say whether or not this way was tried first.

use winze::cloud::SMALL;

mod records;
mod scatter;
mod source;
mod text;

pub(crate) use records::{Place, Records};
pub(crate) use scatter::{Run, Scatter};
pub(crate) use source::{Opened, Source, onwards};
pub(crate) use text::{Line, text};

/// All points of a file as offsets, those that are to be dropped included.
#[derive(Debug, Default)]
pub(crate) struct Narrow {
    /// What they count from: the origin of the cloud that they make.
    pub(crate) origin: [f64; 3],
    pub(crate) points: Vec<[f32; 3]>,
    /// One a point, or none at all.
    pub(crate) intensity: Option<Vec<f32>>,
    /// How many lie at exactly (0, 0, 0).
    pub(crate) zeros: usize,
    /// Whether a coordinate is not finite.
    pub(crate) broken: bool,
}

/// What is special among points.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    zeros: usize,
    broken: bool,
    /// A finite one is not small.
    wide: bool,
}

impl Seen {
    fn and(self, other: Self) -> Self {
        Self {
            zeros: self.zeros + other.zeros,
            broken: self.broken | other.broken,
            wide: self.wide | other.wide,
        }
    }

    fn of(points: &[[f32; 3]]) -> Self {
        // As whole numbers, absolute values are in the order of the numbers, and those that are not finite come last.
        let limit = (SMALL as f32).to_bits() as i32;
        let mut odd = false;
        let mut zeros = 0u32;
        for p in points {
            let [x, y, z] = p.map(|v| v.abs().to_bits() as i32);
            odd |= (x > limit) | (y > limit) | (z > limit);
            zeros += u32::from((x | y | z) == 0);
        }
        let mut seen = Self {
            zeros: zeros as usize,
            ..Self::default()
        };
        if odd {
            for p in points {
                let finite = p.iter().all(|v| v.is_finite());
                seen.broken |= !finite;
                seen.wide |= finite && p.iter().any(|v| f64::from(v.abs()) > SMALL);
            }
        }
        seen
    }
}

/// A number in 32 bits, and whether that is too much for it here: it is finite, and not small, or so small that it
/// becomes zero.
#[inline(always)]
fn narrow(v: f64) -> (f32, bool) {
    let short = v as f32;
    (
        short,
        (v.abs() > SMALL && v.is_finite()) | (short == 0.0 && v != 0.0),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_small_or_not_finite_is_seen() {
        let seen = |points: &[[f32; 3]]| {
            let Seen {
                zeros,
                broken,
                wide,
            } = Seen::of(points);
            (zeros, broken, wide)
        };
        assert_eq!(
            seen(&[[0.0, -0.0, 0.0], [1024.0, -1024.0, 1e-30]]),
            (1, false, false)
        );
        assert_eq!(seen(&[[0.0, 1024.5, 0.0]]), (0, false, true));
        assert_eq!(
            seen(&[[f32::NAN, 5000.0, 0.0], [f32::INFINITY; 3]]),
            (0, true, false)
        );
        assert_eq!(narrow(1_024.000_001), (1024.0, true));
        assert_eq!(narrow(1e-60), (0.0, true));
        assert_eq!(narrow(-0.25), (-0.25, false));
        assert!(!narrow(f64::NAN).1 && !narrow(f64::INFINITY).1);
    }
}
