//! The widest vectors that the processor at hand has, for plain loops.
//!
//! The compiler vectorises a loop for the oldest processor that it builds for. [`wide`] has it compiled again
//! for newer ones, and the one that fits is taken when it runs. The operations and their order stay as written (no floats are
//! summed across lanes, no multiplication is fused with an addition), so every processor gives the same bits.

use fearless_simd::{Level, dispatch};

#[cfg(test)]
mod levels;

/// The processor's vectors; a test may ask for narrower ones.
#[inline(always)]
pub(crate) fn level() -> Level {
    #[cfg(test)]
    if let Some(narrower) = levels::chosen() {
        return narrower;
    }
    Level::new()
}

/// Runs `f` compiled for this processor. What it calls must be `#[inline(always)]`, and so must the closure, or it is
/// compiled for the oldest processor after all.
#[inline(always)]
pub(crate) fn wide<R>(f: impl FnOnce() -> R) -> R {
    dispatch!(level(), simd => fearless_simd::Simd::vectorize(simd, f))
}

/// The places of the bits that are set, ascending.
#[inline(always)]
pub(crate) fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let place = word.trailing_zeros() as usize;
        word &= word.wrapping_sub(1);
        (place < 64).then_some(place)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn set_bits_come_in_order() {
        assert_eq!(bits(0).count(), 0);
        assert_eq!(bits(1 << 63 | 0b1010).collect::<Vec<_>>(), [1, 3, 63]);
        assert!(bits(u64::MAX).eq(0..64));
    }

    #[test]
    fn the_same_bits_as_a_plain_loop() {
        let values: Vec<f32> = (0..1003).map(|i| 0.37 * (i as f32 - 500.0)).collect();
        #[inline(always)]
        fn each(values: &[f32], out: &mut [f32]) {
            for (out, v) in out.iter_mut().zip(values) {
                *out = (v * v + 3.0 * v).abs().sqrt() / (1.0 + v * v);
            }
        }
        let (mut plain, mut fast) = (vec![0.0; 1003], vec![0.0; 1003]);
        each(&values, &mut plain);
        wide(
            #[inline(always)]
            || each(&values, &mut fast),
        );
        assert_eq!(plain, fast);
    }
}
