//! What the machine can do: how many bytes a second it moves, and how many additions and multiplications a second its
//! vectors do, without fusing the two (winze never does, since then every processor gives the same bits).

use std::hint::black_box;
use std::time::Instant;

use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

/// The limits of some threads together.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// Bytes read and written a second, of arrays that fit no cache.
    pub(crate) bandwidth: f64,
    /// Additions and multiplications of `f32` a second.
    pub(crate) single: f64,
    /// The same of `f64`.
    pub(crate) double: f64,
}

impl Limits {
    pub(crate) fn to_json(self) -> serde_json::Value {
        let Self {
            bandwidth,
            single,
            double,
        } = self;
        serde_json::json!({ "bandwidth": bandwidth, "single": single, "double": double })
    }
}

/// Numbers of the arrays that are streamed, together: far more than any cache holds.
const STREAMED: usize = 3 << 26;
/// The best of so many: whatever else the machine does only takes away.
const TRIES: usize = 5;

/// Measures the threads of the current pool.
pub(crate) fn measure() -> Limits {
    let single = best(|| {
        let rounds = 1 << 21;
        let ops: usize = rayon::broadcast(|_| single(rounds)).into_iter().sum();
        ops as f64
    });
    let double = best(|| {
        let rounds = 1 << 20;
        let ops: usize = rayon::broadcast(|_| double(rounds)).into_iter().sum();
        ops as f64
    });
    Limits {
        bandwidth: bandwidth(),
        single,
        double,
    }
}

fn best(work: impl Fn() -> f64) -> f64 {
    (0..TRIES)
        .map(|_| {
            let begun = Instant::now();
            let done = work();
            done / begun.elapsed().as_secs_f64()
        })
        .fold(0.0, f64::max)
}

/// `c = a + 3 b` over long arrays (the triad of STREAM, McCalpin 1995): two are read, one is written.
fn bandwidth() -> f64 {
    let third = STREAMED / 3;
    let (a, b) = (vec![1.0f32; third], vec![2.0f32; third]);
    let mut c = vec![0.0f32; third];
    let mut run = || {
        c.par_chunks_mut(1 << 16)
            .zip(a.par_chunks(1 << 16))
            .zip(b.par_chunks(1 << 16))
            .for_each(|((c, a), b)| {
                wide(
                    #[inline(always)]
                    || {
                        for ((c, a), b) in c.iter_mut().zip(a).zip(b) {
                            *c = a + 3.0 * b;
                        }
                    },
                );
            });
    };
    run();
    (0..TRIES)
        .map(|_| {
            let begun = Instant::now();
            run();
            (12 * third) as f64 / begun.elapsed().as_secs_f64()
        })
        .fold(0.0, f64::max)
}

#[inline(always)]
fn wide<R>(f: impl FnOnce() -> R) -> R {
    dispatch!(Level::new(), simd => Simd::vectorize(simd, f))
}

/// Numbers that are worked on side by side: enough to keep the units busy while each waits for its last result.
const LANES: usize = 128;

macro_rules! rounds_of {
    ($name:ident, $float:ty, $lanes:expr) => {
        /// Operations done in so many rounds.
        fn $name(rounds: usize) -> usize {
            let mut x = [0.5; $lanes];
            let (by, and) = (black_box(0.999 as $float), black_box(0.001 as $float));
            wide(
                #[inline(always)]
                || {
                    for _ in 0..rounds {
                        for x in &mut x {
                            *x = *x * by + and;
                        }
                    }
                },
            );
            black_box(x);
            2 * $lanes * rounds
        }
    };
}
rounds_of!(single, f32, LANES);
rounds_of!(double, f64, LANES / 2);
