//! Smooth random relief: value noise in octaves.

/// Value noise on a unit lattice, smooth to the second derivative, in `[-1, 1]`; the same for the same
/// `seed` everywhere.
#[must_use]
pub fn value(p: [f64; 3], seed: u64) -> f64 {
    let cell = p.map(f64::floor);
    let f: [f64; 3] = std::array::from_fn(|a| {
        let t = p[a] - cell[a];
        t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    });
    #[expect(
        clippy::cast_possible_truncation,
        reason = "mines are smaller than 2^63 metres"
    )]
    let c = cell.map(|v| v as i64);
    let corner = |i: i64, j: i64, k: i64| lattice([c[0] + i, c[1] + j, c[2] + k], seed);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let face = |k: i64| {
        let low = mix(corner(0, 0, k), corner(1, 0, k), f[0]);
        let high = mix(corner(0, 1, k), corner(1, 1, k), f[0]);
        mix(low, high, f[1])
    };
    mix(face(0), face(1), f[2])
}

/// A random value in `[-1, 1]` for each lattice point.
pub(crate) fn lattice(c: [i64; 3], seed: u64) -> f64 {
    let mut h = seed ^ 0x9E37_79B9_7F4A_7C15;
    for v in c {
        #[expect(clippy::cast_sign_loss, reason = "bits to be mixed")]
        let bits = v as u64;
        h = (h ^ bits).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        h ^= h >> 29;
        h = h.wrapping_mul(0x94D0_49BB_1331_11EB);
        h ^= h >> 32;
    }
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64")]
    let unit = (h >> 11) as f64 / 9_007_199_254_740_992.0;
    2.0 * unit - 1.0
}

/// Octaves of value noise: wavelengths from `longest` metres down by halves and a bit, amplitudes
/// falling with them, scaled so that the sum stays within `amplitude`.
#[must_use]
pub fn relief(p: [f64; 3], amplitude: f64, longest: f64, octaves: u32, seed: u64) -> f64 {
    let (mut sum, mut total, mut weight, mut wavelength) = (0.0, 0.0, 1.0, longest);
    for octave in 0..octaves {
        sum += weight
            * value(
                p.map(|v| v / wavelength),
                seed.wrapping_add(u64::from(octave)),
            );
        total += weight;
        weight *= 0.5;
        wavelength *= 0.45;
    }
    amplitude * sum / f64::max(total, 1e-9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lattice_points_are_met_and_the_rest_is_smooth() {
        assert_eq!(value([3.0, -2.0, 7.0], 5), lattice([3, -2, 7], 5));
        let mut last = value([0.0, 0.3, 0.3], 1);
        for i in 1..2000 {
            let v = value([f64::from(i) * 0.005, 0.3, 0.3], 1);
            assert!((v - last).abs() < 0.03 && v.abs() <= 1.0);
            last = v;
        }
    }

    #[test]
    fn relief_stays_within_its_amplitude_and_follows_its_seed() {
        let mut largest: f64 = 0.0;
        for i in 0..2000 {
            let v = relief([f64::from(i) * 0.37, 1.3, -0.2], 0.4, 4.0, 5, 9);
            assert!(v.abs() <= 0.4);
            largest = largest.max(v.abs());
        }
        assert!(largest > 0.15);
        assert_ne!(
            relief([1.0; 3], 0.4, 4.0, 5, 1),
            relief([1.0; 3], 0.4, 4.0, 5, 2)
        );
    }
}
