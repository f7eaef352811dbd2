//! What hangs on the walls: bolts, welded mesh, sets, pipes, trays, ducts.
//!
//! Each kind and each way has random numbers of its own, so that a change of one leaves the others.

use std::collections::BTreeMap;

use rayon::prelude::*;
use winze::rng::Rng;
use winze::vec3::{cross, distance};

use super::field::Field;
use super::kinds::{Change, Fittings};
use super::runs::{Run, Spot};
use super::solids::{Solid, unit};
use super::vehicles;
use crate::error::Result;
use crate::mesh::{Material, Mesh, Part};

/// Kinds of fittings, in the order of their parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Bolts,
    WeldedMesh,
    Arches,
    Timber,
    Pipes,
    CableTrays,
    Duct,
    Muck,
    Vehicle,
}

impl Kind {
    fn part(self, new: bool) -> Part {
        let (name, reflectivity) = match self {
            Self::Bolts => ("bolt", 0.5),
            Self::WeldedMesh => ("mesh", 0.5),
            Self::Arches => ("arch", 0.35),
            Self::Timber => ("timber", 0.45),
            Self::Pipes => ("pipe", 0.4),
            Self::CableTrays => ("cable tray", 0.4),
            Self::Duct => ("duct", 0.6),
            Self::Muck => ("muck", 0.25),
            Self::Vehicle => ("vehicle", 0.55),
        };
        Part {
            name: name.into(),
            material: Material {
                reflectivity,
                wet: 0.0,
            },
            new,
        }
    }
}

/// Solids by kind, and whether they are new.
pub(super) type Bins = BTreeMap<(Kind, bool), Solid>;

/// What the fitting of one way goes by.
pub(super) struct Way<'a> {
    pub(super) field: &'a Field,
    pub(super) run: &'a Run,
    pub(super) number: u64,
    pub(super) fittings: &'a Fittings,
    pub(super) change: Change,
    pub(super) seed: u64,
}

/// No mesh or bolts closer than this to a face, metres.
const FACE: f64 = 5.0;

/// Adds the fittings of all ways, one part a kind, and one more of what is new since.
pub(super) fn add(
    mesh: &mut Mesh,
    field: &Field,
    runs: &[Run],
    fittings: &Fittings,
    change: Option<&Change>,
    seed: u64,
) -> Result<()> {
    if *fittings == Fittings::default() && change.is_none_or(|c| c.mesh <= 0.0) {
        return Ok(());
    }
    let nothing = Change {
        advance: 0.5,
        ..Change::default()
    };
    let parts: Vec<Bins> = runs
        .par_iter()
        .enumerate()
        .map(|(number, run)| {
            Way {
                field,
                run,
                number: number as u64,
                fittings,
                change: change.cloned().unwrap_or_else(|| nothing.clone()),
                seed,
            }
            .fitted()
        })
        .collect();
    let mut all = Bins::new();
    for (key, solid) in parts.into_iter().flatten() {
        all.entry(key).or_default().append(solid);
    }
    for ((kind, new), solid) in all {
        mesh.add(kind.part(new), &solid.vertices, &solid.triangles)?;
    }
    Ok(())
}

impl Way<'_> {
    fn fitted(&self) -> Bins {
        let mut bins = Bins::new();
        self.bolts(&mut bins);
        self.welded_mesh(&mut bins);
        self.sets(&mut bins);
        let f = self.fittings;
        self.lines(&mut bins, Kind::Pipes, f.pipes);
        self.lines(&mut bins, Kind::CableTrays, f.cable_trays);
        self.lines(&mut bins, Kind::Duct, f.duct);
        vehicles::muck(self, &mut bins);
        vehicles::vehicles(self, &mut bins);
        bins
    }

    /// Random numbers of a kind.
    pub(super) fn rng(&self, kind: Kind) -> Rng {
        Rng::new(self.seed, (self.number << 16) | 0x4600 | kind as u64)
    }

    /// Random places on the way, `density` per 100 m.
    pub(super) fn places(&self, rng: &mut Rng, density: f64) -> Vec<f64> {
        let length = self.run.length();
        let expected = density * length / 100.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a density times a length, both bounded"
        )]
        let count = (expected + rng.uniform()).floor() as u32;
        (0..count).map(|_| rng.range(0.0, length)).collect()
    }

    /// The openings about a spot.
    pub(super) fn near(&self, spot: &Spot) -> Vec<u32> {
        let reach = 0.5 * spot.width + spot.height + 6.0;
        self.field
            .near([spot.floor.map(|c| c - reach), spot.floor.map(|c| c + reach)])
    }

    /// The planned wall's distance from a place beside a spot.
    fn clearance(&self, p: [f64; 3], near: &[u32]) -> f64 {
        self.field.plan.at(p, near).clearance
    }

    fn rough(&self) -> f64 {
        self.field.relief.most()
    }

    /// Where a ray from a metre or so above the floor, `angle` up from the left, meets the rock; `None` at
    /// the mouth of another drift.
    fn wall(&self, spot: &Spot, angle: f64, near: &[u32]) -> Option<([f64; 3], [f64; 3])> {
        let from = spot.place(0.0, 0.0, 0.35 * spot.height);
        let along = spot.direction(libm::cos(angle), libm::sin(angle));
        let (wide, high) = (0.5 * spot.width, 0.65 * spot.height);
        let most = (wide * wide + high * high).sqrt() + self.rough();
        let s = self.field.reach(from, along, most, near)?;
        let p = std::array::from_fn(|a| from[a] + s * along[a]);
        Some((p, along.map(|c| -c)))
    }

    fn bolts(&self, bins: &mut Bins) {
        let mut rng = self.rng(Kind::Bolts);
        let end = self.run.length() - self.bare_end();
        for s in self.places(&mut rng, self.fittings.bolts) {
            let angle = rng.range(0.15, 3.0);
            let turn = rng.range(0.0, 1.5);
            let Some(spot) = self.run.at(s).filter(|_| s < end) else {
                continue;
            };
            let Some((p, n)) = self.wall(&spot, angle, &self.near(&spot)) else {
                continue;
            };
            let solid = bins.entry((Kind::Bolts, false)).or_default();
            let flat = [spot.along[0], spot.along[1], 0.0];
            let other = unit(cross(n, flat));
            let (c, t) = (0.1 * libm::cos(turn), 0.1 * libm::sin(turn));
            let edge = |x: f64, y: f64| std::array::from_fn(|a| x * flat[a] + y * other[a]);
            let at = |by: f64| std::array::from_fn(|a| p[a] + by * n[a]);
            solid.block(at(0.02), [edge(c, t), edge(-t, c), n.map(|v| 0.008 * v)]);
            solid.tube(&[at(0.0), at(0.14)], 0.015, 5);
        }
    }

    fn bare_end(&self) -> f64 {
        if self.run.heading.is_some() {
            FACE
        } else {
            0.0
        }
    }

    fn welded_mesh(&self, bins: &mut Bins) {
        const STRETCH: f64 = 3.0;
        const ROWS: u32 = 12;
        const COLUMNS: u32 = 26;
        let (had, has) = {
            let had = self.fittings.mesh;
            (had, had + self.change.mesh * (1.0 - had))
        };
        let mut rng = self.rng(Kind::WeldedMesh);
        let end = self.run.length() - self.bare_end();
        let mut start = 0.0;
        while has > 0.0 && start + STRETCH <= end {
            let rank = rng.uniform();
            if rank < has {
                let row = |r: u32| -> Vec<Option<([f64; 3], [f64; 3])>> {
                    let spot = self
                        .run
                        .at(start + STRETCH * f64::from(r) / f64::from(ROWS));
                    let Some(spot) = spot else { return Vec::new() };
                    let near = self.near(&spot);
                    let column = |c: u32| {
                        let angle = -0.1 + 3.34 * f64::from(c) / f64::from(COLUMNS);
                        let (p, n) = self.wall(&spot, angle, &near)?;
                        Some((std::array::from_fn(|a| p[a] + 0.04 * n[a]), n))
                    };
                    (0..=COLUMNS).map(column).collect()
                };
                let rows: Vec<_> = (0..=ROWS).map(row).collect();
                let solid = bins.entry((Kind::WeldedMesh, rank >= had)).or_default();
                let mut wire = |a: &Option<([f64; 3], [f64; 3])>, b: &Option<_>| {
                    if let (Some((p, n)), Some((q, _))) = (a, b)
                        && distance(*p, *q) < 1.0
                    {
                        solid.strip(*p, *q, *n, 0.012);
                    }
                };
                for row in &rows {
                    row.iter()
                        .zip(row.iter().skip(1))
                        .for_each(|(a, b)| wire(a, b));
                }
                for (this, next) in rows.iter().zip(rows.iter().skip(1)) {
                    this.iter().zip(next).for_each(|(a, b)| wire(a, b));
                }
            }
            start += STRETCH;
        }
    }

    /// Steel arches and timber sets, on both sides of which there must be a wall.
    fn sets(&self, bins: &mut Bins) {
        for (kind, density) in [
            (Kind::Arches, self.fittings.arches),
            (Kind::Timber, self.fittings.timber),
        ] {
            if density <= 0.0 {
                continue;
            }
            let mut s = 50.0 / density;
            while let Some(spot) = self.run.at(s) {
                s += 100.0 / density;
                let near = self.near(&spot);
                let inset = 0.5 * self.rough() + 0.12;
                let wide = 0.5 * spot.width - inset;
                let high = spot.height - inset;
                let walled = |left: f64| {
                    let beside = self.clearance(spot.place(0.0, left, 1.2), &near);
                    (0.0..inset + 0.5).contains(&beside)
                };
                if !walled(wide) || !walled(-wide) {
                    continue;
                }
                let solid = bins.entry((kind, false)).or_default();
                if kind == Kind::Arches {
                    // Upright to the springing line, a half ellipse above it.
                    let spring = 0.55 * high;
                    let mut points = vec![spot.place(0.0, wide, -0.1)];
                    for i in 0..=16u32 {
                        let a = std::f64::consts::PI * f64::from(i) / 16.0;
                        let up = spring + (high - spring) * libm::sin(a);
                        points.push(spot.place(0.0, wide * libm::cos(a), up));
                    }
                    points.push(spot.place(0.0, -wide, -0.1));
                    solid.tube(&points, 0.09, 4);
                } else {
                    let top = 0.82 * high;
                    let along = [0.1 * spot.along[0], 0.1 * spot.along[1], 0.0];
                    for left in [wide, -wide] {
                        let half = [along, spot.direction(0.1, 0.0), [0.0, 0.0, 0.5 * top]];
                        solid.block(spot.place(0.0, left, 0.5 * top - 0.1), half);
                    }
                    let half = [along, spot.direction(wide + 0.15, 0.0), [0.0, 0.0, 0.11]];
                    solid.block(spot.place(0.0, 0.0, top), half);
                }
            }
        }
    }

    /// What runs along the way, in stretches of 30 m, with gaps at the mouths of other drifts.
    fn lines(&self, bins: &mut Bins, kind: Kind, share: f64) {
        const STRETCH: f64 = 30.0;
        const STEP: f64 = 1.5;
        let mut rng = self.rng(kind);
        let length = self.run.length() - 1.0;
        let side = if rng.uniform() < 0.5 { 1.0 } else { -1.0 };
        let mut start = 1.0;
        while start < length {
            let end = (start + STRETCH).min(length);
            if rng.uniform() < share {
                // Above each other: two pipes; the others are single.
                let levels: &[f64] = if kind == Kind::Pipes {
                    &[1.9, 1.55]
                } else {
                    &[2.15]
                };
                for up in levels {
                    self.line(bins, kind, [start, end], STEP, side, *up);
                }
            }
            start += STRETCH;
        }
    }

    fn line(&self, bins: &mut Bins, kind: Kind, ends: [f64; 2], step: f64, side: f64, up: f64) {
        let solid = bins.entry((kind, false)).or_default();
        let mut points: Vec<[f64; 3]> = Vec::new();
        let mut s = ends[0];
        let mut flush = |points: &mut Vec<[f64; 3]>| {
            if points.len() > 1 {
                match kind {
                    Kind::Pipes => solid.tube(points, 0.075, 8),
                    Kind::Duct => solid.tube(points, 0.35, 14),
                    _ => {
                        for (a, b) in points.iter().zip(points.iter().skip(1)) {
                            tray(solid, *a, *b);
                        }
                    }
                }
            }
            points.clear();
        };
        while s <= ends[1] {
            let spot = self.run.at(s);
            s += step;
            let Some(spot) = spot else { continue };
            let (radius, left, up) = if kind == Kind::Duct {
                // Hung from the back, sagging between its hangers.
                let sag = 0.04 * libm::sin(1.3 * s);
                let up = spot.height - self.rough() - 0.5 + sag;
                (0.35, 0.12 * side * spot.width, up)
            } else {
                let aside = 0.5 * spot.width - 0.6 * self.rough() - 0.2;
                // Pipes and trays on opposite walls.
                let side = if kind == Kind::Pipes { side } else { -side };
                (0.15, side * aside, up.min(0.6 * spot.height))
            };
            let p = spot.place(0.0, left, up);
            let beside = self.clearance(p, &self.near(&spot));
            let hangs = kind == Kind::Duct || beside < self.rough() + 0.9;
            if beside > 0.5 * radius && hangs {
                points.push(p);
            } else {
                flush(&mut points);
            }
        }
        flush(&mut points);
    }
}

/// A cable tray with its cables: a flat box.
fn tray(solid: &mut Solid, a: [f64; 3], b: [f64; 3]) {
    let half = std::array::from_fn(|i| 0.5 * (b[i] - a[i]));
    let middle = std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
    let across = unit(cross(half, [0.0, 0.0, 1.0])).map(|c| 0.15 * c);
    solid.block(middle, [half, across, [0.0, 0.0, 0.04]]);
}
