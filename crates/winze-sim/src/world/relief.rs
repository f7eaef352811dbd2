//! Relief: how the rock strays from its plan.

use super::kinds::Rock;
use super::plan::mix;
use crate::noise;

/// Relief of a world's rock, and where it is wet.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Relief {
    rock: Rock,
    seed: u64,
    /// Wavelength and weight of each octave; the weights sum to one.
    octaves: Vec<(f64, f64)>,
    /// Edges of the blocks between joints: along the beds twice, then across them.
    joints: [f64; 3],
    /// Above these values of their noises the floor is under water, the walls are wet.
    wet_above: f64,
}

/// Length of puddles and of wet stretches, metres.
const WET_LENGTH: f64 = 5.0;
/// Where floor ends and wall begins, metres above the plan's floor.
const FLOOR_TOP: [f64; 2] = [0.15, 0.7];

impl Relief {
    /// Relief with bumps of at most `longest` metres and beds of `bed` metres.
    pub(super) fn new(rock: Rock, longest: f64, bed: f64, seed: u64) -> Self {
        let mut octaves = Vec::new();
        let (mut wavelength, mut weight) = (longest, 1.0);
        // Eight octaves of a factor 0.45 span from metres to a centimetre.
        while octaves.len() < 8 && (octaves.is_empty() || wavelength >= 2.0 * rock.cell) {
            octaves.push((wavelength, weight));
            wavelength *= 0.45;
            weight *= 0.55;
        }
        let total: f64 = octaves.iter().map(|o| o.1).sum();
        for octave in &mut octaves {
            octave.1 /= total;
        }
        let mut relief = Self {
            rock,
            seed,
            octaves,
            joints: [2.6 * bed, 1.9 * bed, bed],
            wet_above: f64::INFINITY,
        };
        relief.wet_above = relief.quantile(1.0 - rock.wet);
        relief
    }

    /// The value that the noise of wetness stays under with this probability.
    fn quantile(&self, share: f64) -> f64 {
        if share >= 1.0 {
            return f64::INFINITY;
        }
        let mut values: Vec<f64> = (0..4096u32)
            .map(|i| {
                let [x, y, z] = [i % 16, i / 16 % 16, i / 256].map(|v| 37.31 * f64::from(v));
                self.wetness([x, 1.07 * y, 1.13 * z])
            })
            .collect();
        values.sort_by(f64::total_cmp);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of 4096"
        )]
        let at = (share * 4096.0) as usize;
        values.get(at).copied().unwrap_or(f64::INFINITY)
    }

    /// The rock it is the relief of.
    pub(super) fn rock(&self) -> &Rock {
        &self.rock
    }

    /// How far the rock can stray, metres.
    pub(super) fn most(&self) -> f64 {
        self.rock.roughness
    }

    fn wetness(&self, p: [f64; 3]) -> f64 {
        noise::value(p.map(|v| v / WET_LENGTH), self.seed ^ 0x0077_6574)
            + 0.4 * noise::value(p.map(|v| 2.9 * v / WET_LENGTH), self.seed ^ 0x0077_6575)
    }

    /// Whether the rock at `p` is wet.
    pub(super) fn is_wet(&self, p: [f64; 3]) -> bool {
        self.rock.wet > 0.0 && self.wetness(p) > self.wet_above
    }

    /// How far the rock steps back at `p`, `up` metres above the floor; within plus or minus the roughness.
    pub(super) fn offset(&self, p: [f64; 3], up: f64) -> f64 {
        let t = ((up - FLOOR_TOP[0]) / (FLOOR_TOP[1] - FLOOR_TOP[0])).clamp(0.0, 1.0);
        let wall = t * t * (3.0 - 2.0 * t);
        let mut floor = self.rock.floor_roughness;
        if wall < 1.0 && self.rock.wet > 0.0 {
            // Standing water is level.
            let depth = (self.wetness(p) - self.wet_above + 0.05) / 0.05;
            floor *= 1.0 - 0.95 * depth.clamp(0.0, 1.0);
        }
        let amplitude = self.rock.roughness * mix(floor, 1.0, wall);
        if amplitude <= 0.0 {
            return 0.0;
        }
        let rolling = if self.rock.blocky < 1.0 {
            self.rolling(p)
        } else {
            0.0
        };
        let blocks = if self.rock.blocky > 0.0 {
            self.blocks(p)
        } else {
            0.0
        };
        amplitude * mix(rolling, blocks, self.rock.blocky)
    }

    /// Octaves of noise in [-1, 1], spread over that range.
    fn rolling(&self, p: [f64; 3]) -> f64 {
        let mut sum = 0.0;
        for (i, (wavelength, weight)) in (0u64..).zip(&self.octaves) {
            sum += weight * noise::value(p.map(|v| v / wavelength), self.seed.wrapping_add(i));
        }
        spread(2.5 * sum)
    }

    /// Steps along joints and beds in [-1, 1]: blocks in two sizes, their planes bent a little.
    fn blocks(&self, p: [f64; 3]) -> f64 {
        // Beds dip gently, joints strike across the axes.
        const AXES: [[f64; 3]; 3] = [[0.79, 0.61, 0.06], [-0.60, 0.79, 0.10], [0.01, -0.12, 0.99]];
        let bent = 0.3 * noise::value(p.map(|v| v / 2.7), self.seed ^ 0x626c);
        let along = AXES.map(|a| a[0] * p[0] + a[1] * p[1] + a[2] * p[2]);
        let scaled = |by: f64| -> [f64; 3] {
            std::array::from_fn(|a| (along[a] + bent * self.joints[a]) / (by * self.joints[a]))
        };
        let large = steps(scaled(1.0), self.seed ^ 0x626d);
        let small = steps(scaled(0.37), self.seed ^ 0x626e);
        spread(1.1 * large + 0.4 * small)
    }
}

/// Keeps a value within (-1, 1), steep in the middle.
fn spread(v: f64) -> f64 {
    v / (1.0 + v * v).sqrt()
}

/// A random value for each unit cell, in [-1, 1], with narrow ramps between them.
fn steps(p: [f64; 3], seed: u64) -> f64 {
    const RAMP: f64 = 0.12;
    let cell = p.map(f64::floor);
    let f: [f64; 3] = std::array::from_fn(|a| {
        let t = ((p[a] - cell[a]) / RAMP).min(1.0);
        t * t * (3.0 - 2.0 * t)
    });
    #[expect(
        clippy::cast_possible_truncation,
        reason = "mines are smaller than 2^63 metres"
    )]
    let c = cell.map(|v| v as i64);
    let corner = |i: i64, j: i64, k: i64| noise::lattice([c[0] + i, c[1] + j, c[2] + k], seed);
    // Within a cell, beyond the ramps, only its own value counts.
    if f == [1.0; 3] {
        return corner(0, 0, 0);
    }
    let row = |j: i64, k: i64| mix(corner(-1, j, k), corner(0, j, k), f[0]);
    let face = |k: i64| mix(row(-1, k), row(0, k), f[1]);
    mix(face(-1), face(0), f[2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::spec::WorldSpec;

    fn rock() -> Rock {
        Rock {
            roughness: 0.3,
            ..WorldSpec::default().rock()
        }
    }

    /// Mean and standard deviation over many places.
    fn spread_of(relief: &Relief, up: f64) -> (f64, f64) {
        let values = (0..20_000u32).map(|i| {
            let [x, y] = [i % 200, i / 200].map(|v| 0.83 * f64::from(v));
            relief.offset([x, 1.3, y], up)
        });
        let (mut sum, mut squares) = (0.0, 0.0);
        for v in values {
            assert!(v.abs() <= relief.most());
            sum += v;
            squares += v * v;
        }
        let mean = sum / 20_000.0;
        (mean, (squares / 20_000.0 - mean * mean).sqrt())
    }

    #[test]
    fn amplitude_is_as_specified() {
        for blocky in [0.0, 0.5, 1.0] {
            let relief = Relief::new(Rock { blocky, ..rock() }, 3.5, 0.5, 4);
            let (mean, deviation) = spread_of(&relief, 2.0);
            assert!(mean.abs() < 0.04, "{mean}");
            assert!((0.06..0.18).contains(&deviation), "{blocky}: {deviation}");
            let (_, floor) = spread_of(&relief, 0.0);
            assert!((floor / deviation - 0.3).abs() < 0.01);
        }
    }

    #[test]
    fn relief_has_power_from_metres_to_the_cell() {
        let relief = Relief::new(
            Rock {
                blocky: 0.0,
                ..rock()
            },
            3.5,
            0.5,
            4,
        );
        assert!(relief.octaves.len() >= 4, "{:?}", relief.octaves);
        // The structure function: how much two places differ, by their distance.
        let differ = |by: f64| {
            let squares = (0..4000u32).map(|i| {
                let x = 1.7 * f64::from(i);
                let d = relief.offset([x + by, 0.4, 0.8], 2.0) - relief.offset([x, 0.4, 0.8], 2.0);
                d * d
            });
            (squares.sum::<f64>() / 4000.0).sqrt()
        };
        let (near, middle, far) = (differ(0.1), differ(0.6), differ(3.0));
        assert!(
            near > 0.012 && middle > 1.8 * near && far > 1.3 * middle,
            "{near} {middle} {far}"
        );
    }

    #[test]
    fn the_wet_share_is_as_specified() {
        let relief = Relief::new(Rock { wet: 0.2, ..rock() }, 3.5, 0.5, 4);
        let wet = (0..40_000u32)
            .filter(|i| relief.is_wet([1.1 * f64::from(i % 200), 1.1 * f64::from(i / 200), 0.3]));
        let share = wet.count();
        assert!((5000..11_000).contains(&share), "{share}");
        let dry = Relief::new(rock(), 3.5, 0.5, 4);
        assert!(!dry.is_wet([1.0, 2.0, 3.0]));
    }

    #[test]
    fn blocks_step() {
        let relief = Relief::new(
            Rock {
                blocky: 1.0,
                ..rock()
            },
            3.5,
            0.5,
            4,
        );
        let offsets = (0..4000u32).map(|i| relief.offset([0.01 * f64::from(i), 0.2, 1.0], 2.0));
        let offsets: Vec<f64> = offsets.collect();
        let still = offsets.windows(2).filter(|w| (w[1] - w[0]).abs() < 1e-9);
        let share = still.count();
        assert!((1500..3900).contains(&share), "{share}");
        let largest = offsets
            .windows(2)
            .map(|w| (w[1] - w[0]).abs())
            .fold(0.0, f64::max);
        assert!(largest < 0.2, "ramps, not cliffs: {largest}");
    }
}
