//! Seeded pseudo-random numbers: xoshiro256++ (Blackman & Vigna 2018), seeded by splitmix64.
//!
//! Own, because a result must not move when a dependency changes its generator.

/// A generator; the same seed and stream give the same numbers on every machine.
#[derive(Debug, Clone)]
pub struct Rng {
    state: [u64; 4],
}

impl Rng {
    /// A generator for `seed`. Different `stream`s of one seed are independent, so that work can
    /// be split into blocks whose numbers do not depend on who computes them.
    #[must_use]
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut s = seed ^ stream.wrapping_mul(0xD1B5_4A32_D192_ED03).rotate_left(32);
        let mut next = || {
            s = s.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = s;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            z ^ (z >> 31)
        };
        Self {
            state: [next(), next(), next(), next()],
        }
    }

    /// 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        let s = &mut self.state;
        let out = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        out
    }

    /// Uniform in `[0, 1)`, 53 bits.
    pub fn uniform(&mut self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64")]
        let v = (self.next_u64() >> 11) as f64;
        v * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Uniform in `[low, high)`.
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Uniform in `0..n` (Lemire's multiply-shift; the bias is below 2⁻³² for any `n` in use).
    /// Zero for `n = 0`.
    pub fn below(&mut self, n: u32) -> u32 {
        let wide = u128::from(self.next_u64()) * u128::from(n);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the product's top is below n"
        )]
        let v = (wide >> 64) as u32;
        v
    }

    /// Standard normal, by the polar method of Marsaglia.
    pub fn normal(&mut self) -> f64 {
        loop {
            let (x, y) = (self.range(-1.0, 1.0), self.range(-1.0, 1.0));
            let s = x * x + y * y;
            if s > 0.0 && s < 1.0 {
                return x * (-2.0 * libm::log(s) / s).sqrt();
            }
        }
    }

    /// A direction uniform on the unit sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let v: [f64; 3] = std::array::from_fn(|_| self.range(-1.0, 1.0));
            let n2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
            if n2 > 1e-4 && n2 <= 1.0 {
                let n = n2.sqrt();
                return v.map(|c| c / n);
            }
        }
    }

    /// A rotation vector uniform over all attitudes (the uniform quaternions of Shoemake 1992).
    pub fn attitude(&mut self) -> [f64; 3] {
        use std::f64::consts::TAU;
        let (u, a, b) = (self.uniform(), self.uniform() * TAU, self.uniform() * TAU);
        let (r1, r2) = ((1.0 - u).sqrt(), u.sqrt());
        let mut w = r2 * libm::cos(b);
        let mut v = [r1 * libm::sin(a), r1 * libm::cos(a), r2 * libm::sin(b)];
        if w < 0.0 {
            w = -w;
            v = v.map(|c| -c);
        }
        let n = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        if n < 1e-12 {
            return [0.0; 3];
        }
        let angle = 2.0 * libm::atan2(n, w);
        v.map(|c| c * angle / n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_these_forever() {
        // Reference values of xoshiro256++ after splitmix64 seeding with 0, by the authors' C code.
        let mut rng = Rng::new(0, 0);
        assert_eq!(rng.next_u64(), 0x5317_5D61_490B_23DF);
        assert_eq!(rng.next_u64(), 0x61DA_6F3D_C380_D507);
        assert_eq!(rng.next_u64(), 0x5C0F_DF91_EC9A_7BFC);
    }

    #[test]
    fn moments_and_bounds() {
        let mut rng = Rng::new(7, 1);
        let n = 100_000;
        let (mut mean, mut variance) = (0.0, 0.0);
        let mut buckets = [0; 5];
        for _ in 0..n {
            let x = rng.normal();
            mean += x;
            variance += x * x;
            buckets[rng.below(5) as usize] += 1;
        }
        assert!((mean / f64::from(n)).abs() < 0.02);
        assert!((variance / f64::from(n) - 1.0).abs() < 0.02);
        assert!(
            buckets.iter().all(|b| (19_000..21_000).contains(b)),
            "{buckets:?}"
        );
        assert_eq!(rng.below(0), 0);
    }

    #[test]
    fn streams_differ() {
        assert_ne!(Rng::new(1, 0).next_u64(), Rng::new(1, 1).next_u64());
        assert_ne!(Rng::new(1, 0).next_u64(), Rng::new(0, 1).next_u64());
    }
}
