//! Parallel loops whose answers do not depend on the number of threads.
//!
//! Floating-point sums depend on their order, so partial results are made over chunks of a fixed
//! size and joined in order, never in the order in which threads finish.

use rayon::prelude::*;
use std::ops::Range;

use crate::cancel;

/// Items a chunk holds. Fixed: it is part of the answer.
const CHUNK: usize = 1024;

/// `f` over consecutive ranges that cover `0..n`, the results in order.
pub(crate) fn chunks<R: Send>(n: usize, f: impl Fn(Range<usize>) -> R + Sync) -> Vec<R> {
    (0..n.div_ceil(CHUNK))
        .into_par_iter()
        .map(|c| {
            cancel::check();
            f(c * CHUNK..((c + 1) * CHUNK).min(n))
        })
        .collect()
}

/// Fills `out`, one value a place, computed with scratch space that a chunk shares.
pub(crate) fn fill<S, T: Send>(
    out: &mut [T],
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize) -> T + Sync,
) {
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, part)| {
        cancel::check();
        let mut s = scratch();
        for (k, place) in part.iter_mut().enumerate() {
            *place = f(&mut s, c * CHUNK + k);
        }
    });
}

/// As [`fill`], by groups of `size` places that follow each other: `f` is given a group's range and its places. A chunk is a
/// whole number of groups.
pub(crate) fn fill_groups<S, T: Send>(
    out: &mut [T],
    size: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, Range<usize>, &mut [T]) + Sync,
) {
    out.par_chunks_mut(CHUNK).enumerate().for_each(|(c, part)| {
        cancel::check();
        let mut s = scratch();
        let mut start = c * CHUNK;
        for group in part.chunks_mut(size) {
            let end = start + group.len();
            f(&mut s, start..end, group);
            start = end;
        }
    });
}

/// One value for each of `0..n`, computed with scratch space that a chunk shares.
pub(crate) fn map_with<S, T: Send>(
    n: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize) -> T + Sync,
) -> Vec<T> {
    let parts = chunks(n, |range| {
        let mut s = scratch();
        range.map(|i| f(&mut s, i)).collect::<Vec<T>>()
    });
    let mut out = Vec::with_capacity(n);
    for part in parts {
        out.extend(part);
    }
    out
}

/// The sum over `0..n` of what `f` adds to each chunk's accumulator, chunk by chunk in order.
pub(crate) fn sum<A: Default + Send>(
    n: usize,
    f: impl Fn(&mut A, usize) + Sync,
    add: impl Fn(&mut A, A),
) -> A {
    let parts = chunks(n, |range| {
        let mut a = A::default();
        for i in range {
            f(&mut a, i);
        }
        a
    });
    let mut total = A::default();
    for part in parts {
        add(&mut total, part);
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_sums_do_not_depend_on_threads() {
        let values: Vec<f32> = (0..100_000).map(|i| (i as f32 * 0.37).sin()).collect();
        let run = |threads| {
            rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap()
                .install(|| {
                    sum(
                        values.len(),
                        |a: &mut f32, i| *a += values[i],
                        |a, b| *a += b,
                    )
                    .to_bits()
                })
        };
        assert_eq!(run(1), run(3));
        assert_eq!(run(1), run(8));
    }

    #[test]
    fn every_index_once_in_order() {
        let got = map_with(5000, || 0, |_, i| i);
        assert_eq!(got, (0..5000).collect::<Vec<_>>());
        assert!(map_with(0, || 0, |_, i| i).is_empty());
    }
}
