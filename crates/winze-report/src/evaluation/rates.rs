//! Shares with their uncertainty, and quantiles.

use serde::{Deserialize, Serialize};

/// Standard normal quantile of a two-sided 95 % interval.
const Z: f64 = 1.959_963_984_540_054;

/// A share of counted things with its Wilson 95 % interval.
///
/// The interval takes the runs as independent; several seeds of one case are not, and then it is too
/// narrow. Wilson, "Probable inference, the law of succession, and statistical inference", 1927.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Rate {
    /// How many have the property.
    pub count: usize,
    /// Of how many.
    pub of: usize,
    /// Their share; null where there are none to ask.
    pub share: Option<f64>,
    /// Lower end of the interval.
    pub low: Option<f64>,
    /// Upper end.
    pub high: Option<f64>,
}

impl Rate {
    /// `count` out of `of`.
    #[must_use]
    pub fn new(count: usize, of: usize) -> Self {
        if of == 0 {
            return Self::default();
        }
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let (n, p) = (of as f64, count as f64 / of as f64);
        let widened = 1.0 + Z * Z / n;
        let centre = (p + Z * Z / (2.0 * n)) / widened;
        let half = Z / widened * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        Self {
            count,
            of,
            share: Some(p),
            // Exact at the ends, whatever rounding says.
            low: Some(if count == 0 {
                0.0
            } else {
                (centre - half).max(0.0)
            }),
            high: Some(if count == of {
                1.0
            } else {
                (centre + half).min(1.0)
            }),
        }
    }

    /// Those of `items` that `has` is true of.
    pub(crate) fn of<T>(items: &[T], has: impl Fn(&T) -> bool) -> Self {
        Self::new(items.iter().filter(|i| has(i)).count(), items.len())
    }
}

/// What a number is like over many runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quantiles {
    /// The median.
    pub median: f64,
    /// 95 % are at most this.
    pub p95: f64,
    /// The largest.
    pub max: f64,
}

impl Quantiles {
    /// Of finite values; `None` where there are none.
    #[must_use]
    pub fn of(values: &[f64]) -> Option<Self> {
        Some(Self {
            median: quantile(values, 0.5)?,
            p95: quantile(values, 0.95)?,
            max: quantile(values, 1.0)?,
        })
    }
}

/// The value below which a share `q` (0 to 1) of the finite `values` lies, linear between neighbours in
/// order; `None` where there are none.
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let at = q.clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an index"
    )]
    let (below, above) = (at.floor() as usize, at.ceil() as usize);
    let (a, b) = (*sorted.get(below)?, *sorted.get(above)?);
    Some(a + (b - a) * (at - at.floor()))
}

/// The median over all values, infinite ones among them; `None` where it is itself infinite.
pub(super) fn median_of_all(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted.len() / 2;
    let above = *sorted.get(middle)?;
    let below = if sorted.len().is_multiple_of(2) {
        *sorted.get(middle.checked_sub(1)?)?
    } else {
        above
    };
    let median = 0.5 * (below + above);
    median.is_finite().then_some(median)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_intervals_by_hand() {
        // 8 of 10, a textbook's example: 0.4902 to 0.9433.
        let r = Rate::new(8, 10);
        assert!((r.low.unwrap() - 0.4902).abs() < 5e-5, "{r:?}");
        assert!((r.high.unwrap() - 0.9433).abs() < 5e-5, "{r:?}");
        // None of n: the upper end is z²/(n + z²).
        let r = Rate::new(0, 100);
        assert_eq!((r.share, r.low), (Some(0.0), Some(0.0)));
        assert!((r.high.unwrap() - Z * Z / (100.0 + Z * Z)).abs() < 1e-12);
        let r = Rate::new(100, 100);
        assert!((r.low.unwrap() - 100.0 / (100.0 + Z * Z)).abs() < 1e-12);
        assert_eq!(r.high, Some(1.0));
        assert_eq!(Rate::new(0, 0).share, None);
    }

    #[test]
    fn quantiles_by_hand() {
        let values = [4.0, 1.0, f64::INFINITY, 3.0, 2.0];
        assert_eq!(quantile(&values, 0.5), Some(2.5));
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(quantile(&values, 1.0), Some(4.0));
        assert!((quantile(&values, 0.95).unwrap() - 3.85).abs() < 1e-12);
        assert_eq!(quantile(&[7.0], 0.95), Some(7.0));
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(Quantiles::of(&[f64::NAN]), None);
    }
}
