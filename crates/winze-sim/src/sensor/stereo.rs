//! A stereo depth camera.
//!
//! It matches the pictures of two cameras a baseline apart and has its noise in disparity, pixels:
//! `d = fB/z`, so that depth along the **optical axis** errs with `σ_z = z² σ_d / (f B)` (Gallup et al.,
//! "Variable baseline/resolution stereo", CVPR 2008; RealSense "Best-known methods for tuning D400 depth
//! cameras": subpixel error about 0.08). Along the ray that is `σ_z / cos α`, `α` being the angle between
//! ray and axis. Part of the noise is shared by neighbouring pixels, since their windows overlap: surfaces
//! come out wavy rather than fuzzy.
//!
//! Dust takes contrast, `exp(-∫σ)` of it being left at a distance (Koschmieder 1924): noise grows with the
//! inverse, and below a limit nothing is matched. Left out: dust grains lit up by the projector, false
//! matches of repeated texture, offsets of a bad calibration, the strip that only one camera sees.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use winze::Pose;
use winze::rng::Rng;
use winze::vec3::dot;

use super::pulse::Echo;
use super::sight::{self, Met, Sight};
use super::{Return, ReturnOrigin, pixel_direction, range_of_count, ray_stream, within};
use crate::dust::Dust;
use crate::error::Result;
use crate::noise;
use crate::raycast::Caster;

/// A stereo depth camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stereo {
    /// Pixels of a row that are simulated: fewer than the camera's, evenly over the field of view.
    pub width: u32,
    /// Rows that are simulated.
    pub height: u32,
    /// Pixels of a row of the camera: the unit of disparity.
    pub native_width: u32,
    /// Horizontal and vertical field of view, degrees.
    pub field_of_view_deg: [f64; 2],
    /// Scans a second.
    pub scans_per_second: f64,
    /// Distance between the two cameras, metres.
    pub baseline: f64,
    /// Least depth along the axis, metres.
    pub min_range: f64,
    /// Greatest depth along the axis, metres.
    pub max_range: f64,
    /// Standard deviation of a pixel's own disparity, native pixels.
    pub disparity_sd: f64,
    /// Standard deviation of the disparity that neighbours share, native pixels.
    pub disparity_sd_shared: f64,
    /// Distance over which they share it, native pixels.
    pub shared_over: f64,
    /// Disparities are multiples of this, native pixels; 0 for none.
    pub disparity_step: f64,
    /// Share of pixels at an edge whose depth falls between the foreground and the background.
    pub bleed: f64,
    /// Size of patches of good and poor texture, metres.
    pub texture_size: f64,
    /// How much of the surface has poor texture, 0 none to 1 all: its contrast falls to nothing there.
    pub featureless: f64,
    /// Contrast below which nothing is matched.
    pub min_contrast: f64,
    /// Angle of incidence beyond which nothing is matched, degrees: the two pictures differ too much.
    pub max_incidence_deg: f64,
    /// Share of pixels lost for no reason that is modelled.
    pub dropout: f64,
}

/// Keeps the noise of a pixel apart from what its ray met.
const NOISE_STREAM: u64 = 0x5EED_0F57_E4E0_0001;
/// Keeps the shared noise apart from both.
const SHARED_STREAM: u64 = 0x5EED_0F57_E4E0_0002;
/// Keeps texture apart from other noise fields of the world.
const TEXTURE_SEED: u64 = 0x7EC5;
/// Neighbours whose ranges differ by more than this, metres, and three deviations, are an edge.
const EDGE: f64 = 0.05;

impl Stereo {
    pub(super) fn validate(&self) -> Result<()> {
        range_of_count("sensor.width", self.width, 8192)?;
        range_of_count("sensor.height", self.height, 8192)?;
        range_of_count("sensor.native_width", self.native_width, 65_536)?;
        super::field_of_view(self.field_of_view_deg)?;
        super::range_of_sensor("sensor", self.min_range, self.max_range)?;
        let rate = self.scans_per_second;
        within("sensor.scans_per_second", rate, 0.1, 1000.0, "a second")?;
        within("sensor.baseline", self.baseline, 1e-3, 10.0, "metres")?;
        within(
            "sensor.disparity_sd",
            self.disparity_sd,
            0.0,
            10.0,
            "pixels",
        )?;
        let shared = self.disparity_sd_shared;
        within("sensor.disparity_sd_shared", shared, 0.0, 10.0, "pixels")?;
        within("sensor.shared_over", self.shared_over, 1.0, 1e4, "pixels")?;
        within(
            "sensor.disparity_step",
            self.disparity_step,
            0.0,
            10.0,
            "pixels",
        )?;
        within("sensor.bleed", self.bleed, 0.0, 1.0, "as a share")?;
        within(
            "sensor.texture_size",
            self.texture_size,
            1e-3,
            1e3,
            "metres",
        )?;
        within(
            "sensor.featureless",
            self.featureless,
            0.0,
            1.0,
            "as a share",
        )?;
        within(
            "sensor.min_contrast",
            self.min_contrast,
            0.0,
            1.0,
            "as a share",
        )?;
        let slant = self.max_incidence_deg;
        within("sensor.max_incidence_deg", slant, 1.0, 90.0, "degrees")?;
        within("sensor.dropout", self.dropout, 0.0, 1.0, "as a share")
    }

    /// Focal length in native pixels times the baseline, metres: disparity times depth.
    #[must_use]
    pub fn focal_baseline(&self) -> f64 {
        let half = libm::tan(0.5 * self.field_of_view_deg[0].to_radians());
        0.5 * f64::from(self.native_width) / half * self.baseline
    }

    /// One standard deviation of depth along the axis at this depth in clean air, metres.
    #[must_use]
    pub fn depth_noise(&self, depth: f64) -> f64 {
        let step = self.disparity_step * self.disparity_step / 12.0;
        let squares = self.disparity_sd * self.disparity_sd
            + self.disparity_sd_shared * self.disparity_sd_shared;
        depth * depth * (squares + step).sqrt() / self.focal_baseline()
    }

    /// The same along a ray.
    pub(super) fn noise_along(&self, direction: [f64; 3], range: f64) -> f64 {
        let forward = direction[0].max(1e-6);
        self.depth_noise(range * forward) / forward
    }

    pub(super) fn scan(
        &self,
        caster: &Caster,
        world_from_sensor: &Pose,
        air: &Dust,
        seed: u64,
        scan: u64,
    ) -> Vec<Return> {
        let pixels = self.width.saturating_mul(self.height);
        let size = [self.width, self.height];
        let origin = world_from_sensor.translation();
        let pixel = |i: u32| {
            let direction = pixel_direction(i, size, self.field_of_view_deg);
            (direction, world_from_sensor.rotate(direction))
        };
        let sights: Vec<Sight> = (0..pixels)
            .into_par_iter()
            .map(|i| {
                let (direction, out) = pixel(i);
                let mut rng = Rng::new(seed, ray_stream(scan, i));
                sight::look(caster, origin, out, self.max_range / direction[0], &mut rng)
            })
            .collect();
        let waves = Waves::new(self, seed, scan);
        (0..pixels)
            .into_par_iter()
            .filter_map(|i| {
                let (direction, out) = pixel(i);
                let sight = sights.get(i as usize)?;
                let met = sight.met?;
                let mut rng = Rng::new(seed ^ NOISE_STREAM, ray_stream(scan, i));
                let point = std::array::from_fn(|a| origin[a] + met.range * out[a]);
                let left = libm::exp(-air.depth(origin, out, met.range));
                if rng.uniform() < self.dropout || !self.matched(&met, point, left) {
                    return None;
                }
                let (range, edge) = self
                    .edge(i, &met, &sights, |j| pixel(j).0, &mut rng)
                    .map_or((met.range, met.origin), |r| (r, ReturnOrigin::Bleed));
                let depth = range * direction[0];
                let noise = self.disparity_sd * rng.normal()
                    + self.disparity_sd_shared * waves.at(i, self.width);
                let depth = self.measured(depth, noise / left)?;
                let echo = Echo {
                    range: depth / direction[0],
                    first: sight.first,
                    origin: edge,
                    part: met.part,
                    normal: met.normal,
                    intensity: (met.reflectivity * met.cosine * left).clamp(0.0, 1.0),
                };
                Some(Return::of(direction, &echo))
            })
            .collect()
    }

    /// Depth that a true depth is measured as; `None` outside the sensor's range.
    fn measured(&self, depth: f64, disparity_noise: f64) -> Option<f64> {
        if depth < self.min_range || depth > self.max_range {
            return None;
        }
        let focal_baseline = self.focal_baseline();
        let disparity = focal_baseline / depth + disparity_noise;
        let disparity = if self.disparity_step > 0.0 {
            (disparity / self.disparity_step).round() * self.disparity_step
        } else {
            disparity
        };
        // A disparity near zero is infinitely far and reported by no camera.
        let measured = focal_baseline / disparity;
        (disparity > 0.0 && measured < 2.0 * self.max_range).then_some(measured)
    }

    /// Whether there is enough to match at a point, `left` of whose contrast dust leaves.
    fn matched(&self, met: &Met, point: [f64; 3], left: f64) -> bool {
        if met.cosine < libm::cos(self.max_incidence_deg.to_radians()) {
            return false;
        }
        let texture = if self.featureless > 0.0 {
            let v = noise::value(point.map(|c| c / self.texture_size), TEXTURE_SEED);
            (0.5 * (1.0 + v) / self.featureless).min(1.0)
        } else {
            1.0
        };
        texture * left >= self.min_contrast
    }

    /// Range of a pixel whose window straddles an edge, where its depth falls between the two sides.
    fn edge(
        &self,
        i: u32,
        met: &Met,
        sights: &[Sight],
        direction_of: impl Fn(u32) -> [f64; 3],
        rng: &mut Rng,
    ) -> Option<f64> {
        let (straddles, share) = (rng.uniform() < self.bleed, rng.uniform());
        if !straddles || met.origin != ReturnOrigin::Surface {
            return None;
        }
        let x = i % self.width;
        let neighbours = [
            (x > 0).then(|| i - 1),
            (x + 1 < self.width).then_some(i + 1),
            i.checked_sub(self.width),
            i.checked_add(self.width),
        ];
        let direction = direction_of(i);
        let limit = EDGE.max(3.0 * self.noise_along(direction, met.range));
        neighbours.into_iter().flatten().find_map(|j| {
            let other = sights.get(j as usize)?.met?;
            // A slanted surface changes its range from pixel to pixel too.
            let cosine = dot(direction_of(j), direction);
            let apart = met.range * (1.0 - cosine * cosine).max(0.0).sqrt();
            let slope = apart / met.cosine.max(0.05);
            let jump = (other.range - met.range).abs();
            let is_edge = jump > limit + 2.0 * slope && other.origin == ReturnOrigin::Surface;
            is_edge.then_some(met.range + share * (other.range - met.range))
        })
    }
}

/// The part of the noise that neighbours share: normal numbers on a coarse grid, interpolated so that the
/// variance is 1 everywhere.
struct Waves {
    columns: u32,
    rows: u32,
    /// Simulated pixels between nodes.
    spacing: f64,
    nodes: Vec<f64>,
}

impl Waves {
    fn new(sensor: &Stereo, seed: u64, scan: u64) -> Self {
        let thinning = f64::from(sensor.width) / f64::from(sensor.native_width.max(1));
        let spacing = (sensor.shared_over * thinning).max(1.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "no more nodes than pixels"
        )]
        let nodes_along = |pixels: u32| (f64::from(pixels) / spacing) as u32 + 2;
        let (columns, rows) = (nodes_along(sensor.width), nodes_along(sensor.height));
        let mut rng = Rng::new(seed ^ SHARED_STREAM, scan);
        let nodes = (0..columns.saturating_mul(rows))
            .map(|_| rng.normal())
            .collect();
        Self {
            columns,
            rows,
            spacing,
            nodes,
        }
    }

    /// At pixel `i` of pictures so many pixels wide.
    fn at(&self, i: u32, width: u32) -> f64 {
        let place = |pixel: u32, most: u32| {
            let t = f64::from(pixel) / self.spacing;
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a node's index"
            )]
            let node = (t as u32).min(most.saturating_sub(2));
            (node, t - f64::from(node))
        };
        let ((c, u), (r, v)) = (
            place(i % width.max(1), self.columns),
            place(i / width.max(1), self.rows),
        );
        let (mut sum, mut squares) = (0.0, 0.0);
        for (dc, dr, w) in [
            (0, 0, (1.0 - u) * (1.0 - v)),
            (1, 0, u * (1.0 - v)),
            (0, 1, (1.0 - u) * v),
            (1, 1, u * v),
        ] {
            let node = (r + dr) as usize * self.columns as usize + (c + dc) as usize;
            sum += w * self.nodes.get(node).copied().unwrap_or(0.0);
            squares += w * w;
        }
        sum / squares.sqrt()
    }
}
