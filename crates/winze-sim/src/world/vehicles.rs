//! What stands on the floor: vehicles and muck piles.

use winze::rng::Rng;

use super::fittings::{Bins, Kind, Way};
use super::runs::Spot;
use super::solids::Solid;
use crate::noise;

/// Streams of random numbers for what stands elsewhere since.
const ELSEWHERE: u64 = 0x0065_6C73_6577;

/// Muck piles, against a side or a face.
pub(super) fn muck(way: &Way<'_>, bins: &mut Bins) {
    let mut rng = way.rng(Kind::Muck);
    let mut again = Rng::new(way.seed ^ ELSEWHERE, way.number);
    for s in way.places(&mut rng, way.fittings.muck) {
        let moved = rng.uniform() < way.change.muck;
        let (share, size, seed) = (rng.range(-1.0, 1.0), rng.uniform(), rng.next_u64());
        let mut s = s;
        let mut share = share;
        if moved {
            s = again.range(0.0, way.run.length());
            share = again.range(-1.0, 1.0);
        }
        let Some(spot) = way.run.at(s) else { continue };
        let radius = (0.22 + 0.2 * size) * spot.width;
        let left = share.signum() * (0.5 * spot.width - 0.5 * radius);
        let centre = spot.place(0.0, left, 0.0);
        let solid = bins.entry((Kind::Muck, moved)).or_default();
        // At its angle of repose, lumpy, its foot in the floor.
        solid.heap(centre, radius, |r, angle| {
            let (x, y) = (r * radius * libm::cos(angle), r * radius * libm::sin(angle));
            let lumps = noise::relief([x, y, 0.3], 0.7, 0.9, 3, seed);
            0.62 * radius * (1.0 - r) + lumps - 0.25 * r
        });
    }
}

/// Vehicles that stand where there is room for them.
pub(super) fn vehicles(way: &Way<'_>, bins: &mut Bins) {
    let mut rng = way.rng(Kind::Vehicle);
    let mut again = Rng::new(way.seed ^ ELSEWHERE, way.number | 1 << 40);
    for s in way.places(&mut rng, way.fittings.vehicles) {
        let moved = rng.uniform() < way.change.vehicles;
        let loader = rng.uniform() < 0.55;
        let (side, backwards) = (rng.uniform() < 0.5, rng.uniform() < 0.5);
        let mut place = parked(way, s, loader, side, backwards);
        for _ in 0..10 {
            if place.is_some() {
                break;
            }
            let s = rng.range(0.0, way.run.length());
            place = parked(way, s, loader, side, backwards);
        }
        if moved {
            place = (0..10).find_map(|_| {
                let s = again.range(0.0, way.run.length());
                parked(way, s, loader, again.uniform() < 0.5, !backwards)
            });
        }
        if let Some(solid) = place {
            bins.entry((Kind::Vehicle, moved))
                .or_default()
                .append(solid);
        }
    }
}

/// Length, width and height of a loader (LHD) and of a pick-up, metres.
const LOADER: [f64; 3] = [8.4, 2.2, 2.3];
const PICK_UP: [f64; 3] = [5.0, 1.85, 1.9];

/// A vehicle at `s`, if it fits in there and leaves room to pass.
fn parked(way: &Way<'_>, s: f64, loader: bool, left: bool, backwards: bool) -> Option<Solid> {
    let spot = way.run.at(s)?;
    let size = if loader { LOADER } else { PICK_UP };
    let least = 1.0 + size[1];
    if spot.width < least || spot.height < size[2] + 0.4 {
        return None;
    }
    let sign = if left { 1.0 } else { -1.0 };
    let aside = sign * (0.5 * (spot.width - size[1]) - 0.45 - 0.3 * way.field.relief.most());
    let near = way.near(&spot);
    let ahead = 0.5 * size[0];
    for (x, y) in [
        (1.0, 1.0),
        (1.0, -1.0),
        (-1.0, 1.0),
        (-1.0, -1.0),
        (0.0, 1.0),
        (0.0, -1.0),
    ] {
        for up in [0.8, size[2]] {
            let p = spot.place(x * ahead, aside + 0.5 * y * size[1], up);
            if way.field.at(p, &near) < 0.02 {
                return None;
            }
        }
    }
    let facing = if backwards { -1.0 } else { 1.0 };
    // Floors slope: the ends of the vehicle follow them.
    let slope = match (way.run.at(s - 1.0), way.run.at(s + 1.0)) {
        (Some(a), Some(b)) => 0.5 * (b.floor[2] - a.floor[2]),
        _ => 0.0,
    };
    let frame = Frame {
        spot,
        aside,
        facing,
        slope,
    };
    let mut solid = Solid::default();
    if loader {
        frame.loader(&mut solid);
    } else {
        frame.pick_up(&mut solid);
    }
    Some(solid)
}

/// Where a vehicle stands.
struct Frame {
    spot: Spot,
    aside: f64,
    facing: f64,
    slope: f64,
}

impl Frame {
    fn place(&self, ahead: f64, left: f64, up: f64) -> [f64; 3] {
        let ahead = self.facing * ahead;
        self.spot.place(
            ahead,
            self.aside + self.facing * left,
            up + self.slope * ahead,
        )
    }

    /// A box from `low` to `high` in the vehicle's own axes: ahead, left, up.
    fn block(&self, solid: &mut Solid, low: [f64; 3], high: [f64; 3]) {
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * (high[a] - low[a]));
        let middle: [f64; 3] = std::array::from_fn(|a| 0.5 * (high[a] + low[a]));
        let [c, s] = self.spot.along;
        let along = [half[0] * c, half[0] * s, half[0] * self.slope];
        let edges = [
            along,
            self.spot.direction(half[1], 0.0),
            [0.0, 0.0, half[2]],
        ];
        solid.block(self.place(middle[0], middle[1], middle[2]), edges);
    }

    fn wheels(&self, solid: &mut Solid, axles: [f64; 2], half_width: f64, radius: f64, tyre: f64) {
        for ahead in axles {
            for side in [-1.0, 1.0] {
                let out = self.place(ahead, side * half_width, radius);
                let inner = self.place(ahead, side * (half_width - tyre), radius);
                solid.tube(&[inner, out], radius, 14);
            }
        }
    }

    /// A load-haul-dump machine: bucket, front frame, cab, engine.
    fn loader(&self, solid: &mut Solid) {
        self.block(solid, [2.5, -1.1, 0.15], [4.2, 1.1, 1.25]);
        self.block(solid, [0.2, -0.7, 0.6], [2.7, 0.7, 1.4]);
        self.block(solid, [-4.2, -0.95, 0.55], [-0.2, 0.95, 1.65]);
        self.block(solid, [-1.6, 0.0, 1.6], [-0.3, 0.95, 2.3]);
        self.wheels(solid, [1.5, -2.2], 1.08, 0.78, 0.5);
    }

    fn pick_up(&self, solid: &mut Solid) {
        self.block(solid, [-2.5, -0.9, 0.45], [2.5, 0.9, 1.05]);
        self.block(solid, [-0.6, -0.82, 1.0], [1.2, 0.82, 1.85]);
        self.wheels(solid, [1.6, -1.5], 0.92, 0.38, 0.25);
    }
}
