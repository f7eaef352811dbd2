//! The widest vectors that the processor at hand has, for plain loops.
//!
//! The compiler vectorises a loop for the oldest processor that it builds for. [`wide`] has it compiled again
//! for newer ones, and the one that fits is taken when it runs. The operations and their order stay as written (no floats are
//! summed across lanes, no multiplication is fused with an addition), so every processor gives the same bits.

use fearless_simd::{Level, dispatch};

/// Runs `f` compiled for this processor. What it calls must be `#[inline(always)]`, and so must the closure, or it is
/// compiled for the oldest processor after all.
#[inline(always)]
pub(crate) fn wide<R>(f: impl FnOnce() -> R) -> R {
    dispatch!(Level::new(), simd => fearless_simd::Simd::vectorize(simd, f))
}

#[cfg(test)]
mod tests {
    use super::*;

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
