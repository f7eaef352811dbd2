//! A simulated mine as large as wanted, point by point.
//!
//! Rough drifts of about 4 m by 4 m in rows on several levels, joined by crosscuts and, from level to
//! level, by ramps. A survey goes through it in an order that does not depend on how long it lasts, so
//! that a larger map holds all of a smaller one. Walls are drawn directly, not by rays: that takes a fraction of a
//! microsecond a point and no memory to speak of.

use std::f64::consts::TAU;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::ops::Range;
use std::path::Path;

use rayon::prelude::*;
use winze::rng::Rng;
use winze::{Cloud, Pose};

use crate::common::{Result, random_frame};

/// Neighbouring points of the survey lie about so far apart, metres.
pub(crate) const PITCH: f64 = 0.05;
/// The same for queries: some 60 000 points.
const QUERY_PITCH: f64 = 0.068;
/// Standard deviation along each axis, metres.
const NOISE: f64 = 0.007;
/// Of walls and roof, largest, and of the floor, metres.
const ROUGHNESS: [f64; 2] = [0.38, 0.12];
/// Wavelengths of the roughness, metres, and their weights.
const OCTAVES: [(f64, f64); 3] = [(4.3, 0.5), (1.7, 0.32), (0.61, 0.18)];
const SEED: u64 = 20_26;

/// Length of a row, metres.
const ROW: f64 = 300.0;
/// From one row to the next, and from one level to the next.
const BETWEEN: [f64; 2] = [28.0, 24.0];
/// Rows of a level; the ramp is one more.
const ROWS: u64 = 12;
/// Length of the pieces in which drifts are drawn, metres.
const PIECE: f64 = 2.0;
/// From one sample of a drift's middle to the next.
const STEP: f64 = 0.5;

/// Length of a query and where along the first row each begins, metres.
pub(crate) const QUERY: f64 = 20.0;
pub(crate) const QUERIES: [f64; 3] = [1.0, 6.0, 11.0];

/// Numbers for `what` of thing `which`.
fn rng(what: u64, which: u64) -> Rng {
    Rng::new(SEED + (what << 32), which)
}

/// Cross sections along the middle of a floor.
struct Drift {
    samples: Vec<Section>,
    /// Stream of its points' numbers.
    number: u64,
}

#[derive(Clone, Copy)]
struct Section {
    at: [f64; 3],
    /// Horizontal, to the left.
    side: [f64; 2],
    width: f64,
    height: f64,
}

impl Drift {
    /// Along a curve that is met at even steps of its parameter from 0 to 1.
    fn along(number: u64, size: [f64; 2], curve: impl Fn(f64) -> [f64; 3]) -> Self {
        // Fine steps first, then even ones of the length.
        const FINE: u32 = 4000;
        let mut length = 0.0;
        let mut last = curve(0.0);
        let mut points = vec![last];
        for i in 1..=FINE {
            let p = curve(f64::from(i) / f64::from(FINE));
            let d: f64 = (0..3).map(|a| (p[a] - last[a]).powi(2)).sum();
            let before = length;
            length += d.sqrt();
            while points.len() as f64 * STEP <= length {
                let t = (points.len() as f64 * STEP - before) / (length - before);
                points.push(std::array::from_fn(|a| last[a] + t * (p[a] - last[a])));
            }
            last = p;
        }
        let mut rng = rng(1, number);
        let wave =
            |rng: &mut Rng, from: f64, to: f64| (TAU / rng.range(from, to), rng.range(0.0, TAU));
        let waves: [_; 4] = std::array::from_fn(|i| {
            let (from, to) = if i % 2 == 0 {
                (7.0, 13.0)
            } else {
                (17.0, 31.0)
            };
            wave(&mut rng, from, to)
        });
        let samples = (0..points.len())
            .map(|i| {
                let (a, b) = (
                    points[i.saturating_sub(1)],
                    points[(i + 1).min(points.len() - 1)],
                );
                let d = [b[0] - a[0], b[1] - a[1]];
                let n = (d[0] * d[0] + d[1] * d[1]).sqrt().max(1e-9);
                let s = STEP * i as f64;
                let swing = |k: usize| (waves[k].0 * s + waves[k].1).sin();
                Section {
                    at: points[i],
                    side: [-d[1] / n, d[0] / n],
                    width: size[0] + 0.3 * swing(0) + 0.35 * swing(1),
                    height: size[1] + 0.2 * swing(2) + 0.25 * swing(3),
                }
            })
            .collect();
        Self { samples, number }
    }

    fn length(&self) -> f64 {
        STEP * (self.samples.len().saturating_sub(1)) as f64
    }

    fn section(&self, s: f64) -> Section {
        let i = ((s / STEP) as usize).min(self.samples.len().saturating_sub(2));
        let t = s / STEP - i as f64;
        let (a, b) = (&self.samples[i], &self.samples[i + 1]);
        let mix = |a: f64, b: f64| a + t * (b - a);
        Section {
            at: std::array::from_fn(|k| mix(a.at[k], b.at[k])),
            side: std::array::from_fn(|k| mix(a.side[k], b.side[k])),
            width: mix(a.width, b.width),
            height: mix(a.height, b.height),
        }
    }

    /// The samples from the first to the last that lie near `p`.
    fn part_near(&self, p: [f64; 3]) -> Range<usize> {
        let near = |s: &Section| (0..2).all(|a| (s.at[a] - p[a]).abs() < 6.0);
        let first = self.samples.iter().position(near);
        let last = self.samples.iter().rposition(near);
        first.zip(last).map_or(0..0, |(a, b)| a..b + 1)
    }

    /// Whether a point lies in its air, well off the walls, beside one of these samples.
    fn holds(&self, p: [f64; 3], part: Range<usize>) -> bool {
        let mut best = (f64::INFINITY, 0);
        for i in part {
            let at = self.samples[i].at;
            let d = (p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2);
            if d < best.0 {
                best = (d, i);
            }
        }
        let Some(near) = self.samples.get(best.1).filter(|_| best.0 < 16.0) else {
            return false;
        };
        let d = [p[0] - near.at[0], p[1] - near.at[1]];
        let across = (d[0] * near.side[0] + d[1] * near.side[1]).abs();
        let along = (d[0] * near.side[1] - d[1] * near.side[0]).abs();
        let up = p[2] - near.at[2];
        let arched = 1.0 - 0.35 * (2.0 * across / near.width).powi(2);
        along <= STEP
            && across < 0.5 * near.width - 0.1
            && up > 0.12
            && up < arched * near.height - 0.1
    }
}

/// The outline of a drift one wide and one high, even in length: place, outward normal, and how much of
/// it is wall.
struct Outline {
    places: Vec<([f64; 2], [f64; 2], f64)>,
}

impl Outline {
    fn new() -> Self {
        // Floor from left to right, wall, roof, wall.
        let mut corners: Vec<[f64; 2]> = vec![[0.5, 0.0], [-0.5, 0.0]];
        for i in 0..=32 {
            let x = -0.5 + f64::from(i) / 32.0;
            corners.push([x, 1.0 - 0.35 * (2.0 * x).powi(2)]);
        }
        let length =
            |a: [f64; 2], b: [f64; 2]| ((b[0] - a[0]).powi(2) + (b[1] - a[1]).powi(2)).sqrt();
        let closed = |i: usize| corners[i % corners.len()];
        let all: f64 = (0..corners.len())
            .map(|i| length(closed(i), closed(i + 1)))
            .sum();
        let mut places = Vec::new();
        let (mut i, mut begun) = (0, 0.0);
        for k in 0..Self::PLACES {
            let s = all * k as f64 / Self::PLACES as f64;
            while s > begun + length(closed(i), closed(i + 1)) {
                begun += length(closed(i), closed(i + 1));
                i += 1;
            }
            let (a, b) = (closed(i), closed(i + 1));
            let l = length(a, b);
            let t = (s - begun) / l;
            let at = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
            let normal = [-(b[1] - a[1]) / l, (b[0] - a[0]) / l];
            places.push((at, normal, if i == 0 { 0.0 } else { 1.0 }));
        }
        Self { places }
    }

    const PLACES: usize = 512;
    /// Its length where it is one wide and one high.
    const LENGTH: f64 = 3.6;

    fn at(&self, share: f64) -> ([f64; 2], [f64; 2], f64) {
        let x = share * Self::PLACES as f64;
        let i = x as usize;
        let t = x - i as f64;
        let (a, b) = (
            &self.places[i % Self::PLACES],
            &self.places[(i + 1) % Self::PLACES],
        );
        let mix = |a: f64, b: f64| a + t * (b - a);
        let both = |a: [f64; 2], b: [f64; 2]| [mix(a[0], b[0]), mix(a[1], b[1])];
        (both(a.0, b.0), both(a.1, b.1), mix(a.2, b.2))
    }
}

/// Smooth random values, mostly within -1 and 1.
fn relief(p: [f64; 3]) -> f64 {
    let mut sum = 0.0;
    for (number, (wavelength, weight)) in (1u32..).zip(OCTAVES) {
        // Two values a wavelength.
        let scale = 2.0 / wavelength;
        let q = p.map(|v| v * scale);
        let cell = q.map(f64::floor);
        let f: [f64; 3] = std::array::from_fn(|a| {
            let t = q[a] - cell[a];
            t * t * (3.0 - 2.0 * t)
        });
        let c = cell.map(|v| v as i32 as u32);
        let x = [c[0], c[0].wrapping_add(1)].map(|v| v.wrapping_mul(0x9E37_79B1));
        let y = [c[1], c[1].wrapping_add(1)].map(|v| v.wrapping_mul(0x85EB_CA77));
        let z = [c[2], c[2].wrapping_add(1)].map(|v| v.wrapping_mul(0xC2B2_AE3D));
        let corner = |i: usize, j: usize, k: usize| {
            let mut h = (x[i] ^ y[j].rotate_left(11) ^ z[k].rotate_left(21))
                .wrapping_add(number.wrapping_mul(0x27D4_EB2F));
            h ^= h >> 15;
            h = h.wrapping_mul(0x2C1B_3C6D);
            h ^= h >> 12;
            h = h.wrapping_mul(0x297A_2D39);
            h ^= h >> 15;
            f64::from(h as i32) * (1.0 / 2_147_483_648.0)
        };
        let mix = |a: f64, b: f64, t: f64| a + t * (b - a);
        let face = |k: usize| {
            mix(
                mix(corner(0, 0, k), corner(1, 0, k), f[0]),
                mix(corner(0, 1, k), corner(1, 1, k), f[0]),
                f[1],
            )
        };
        sum += weight * mix(face(0), face(1), f[2]);
    }
    sum
}

/// About normal, from one draw: four parts of it added.
fn rough_normal(bits: u64) -> f64 {
    let sum: u64 = (0..4).map(|i| bits >> (16 * i) & 0xFFFF).sum();
    (sum as f64 / 65_536.0 - 2.0) * 3f64.sqrt()
}

/// Points on a drift's walls from `from` to `to` along it, in the order of a spinning scanner.
fn draw(
    drift: &Drift,
    outline: &Outline,
    [from, to]: [f64; 2],
    openings: &[&Drift],
    pitch: f64,
    stream: u64,
) -> Vec<[f32; 3]> {
    let mut rng = Rng::new(SEED + stream, drift.number << 24 | (from / PIECE) as u64);
    let middle = drift.section(0.5 * (from + to));
    let near: Vec<(&Drift, Range<usize>)> = openings
        .iter()
        .map(|other| (*other, other.part_near(middle.at)))
        .filter(|(_, part)| !part.is_empty())
        .collect();
    let around = Outline::LENGTH * 0.5 * (middle.width + middle.height);
    let (columns, rows) = (
        (around / pitch).round() as u32,
        ((to - from) / pitch).round() as u32,
    );
    let mut out = Vec::with_capacity((columns * rows) as usize);
    for column in 0..columns {
        for row in 0..rows {
            let bits = rng.next_u64();
            let aside = |bits: u64| 0.5 * ((bits & 0xFFFF) as f64 / 65_536.0 - 0.5);
            let u = (f64::from(column) + 0.5 + aside(bits)) / f64::from(columns);
            let v = (f64::from(row) + 0.5 + aside(bits >> 16)) / f64::from(rows);
            let s = drift.section(from + v * (to - from));
            let (at, normal, wall) = outline.at(u);
            let place = |across: f64, up: f64| {
                [
                    s.at[0] + across * s.side[0],
                    s.at[1] + across * s.side[1],
                    s.at[2] + up,
                ]
            };
            let (across, up) = (at[0] * s.width, at[1] * s.height);
            let depth =
                relief(place(across, up)) * (ROUGHNESS[1] + wall * (ROUGHNESS[0] - ROUGHNESS[1]));
            let p = place(across + depth * normal[0], up + depth * normal[1]);
            if near
                .iter()
                .any(|(other, part)| other.holds(p, part.clone()))
            {
                continue;
            }
            out.push(p.map(|v| (v + NOISE * rough_normal(rng.next_u64())) as f32));
        }
    }
    out
}

/// Level, place on it (the ramp is the last one a survey comes to), and across.
fn place_of(row: u64) -> (u64, u64, f64) {
    let (level, place) = (row / (ROWS + 1), row % (ROWS + 1));
    let across = if level.is_multiple_of(2) {
        place as f64
    } else {
        ROWS as f64 - 1.0 - place as f64
    };
    (level, place, BETWEEN[0] * across)
}

/// Whether a survey goes through it towards larger x.
fn goes_forth(row: u64) -> bool {
    row.is_multiple_of(2)
}

fn is_ramp(row: u64) -> bool {
    place_of(row).1 == ROWS
}

/// The middle of a row's floor, `x` metres along.
fn row_at(row: u64, x: f64) -> [f64; 3] {
    let (level, _, across) = place_of(row);
    let mut rng = rng(2, row);
    let mut wave = |amplitude: f64, from: f64, to: f64| {
        amplitude * (x * TAU / rng.range(from, to) + rng.range(0.0, TAU)).sin()
    };
    let aside = wave(2.5, 45.0, 75.0) + wave(1.5, 24.0, 40.0);
    let up = wave(0.5, 50.0, 110.0) + wave(0.3, 25.0, 45.0);
    // Surveys turn at the end of each row, so a ramp leads down the way it is gone.
    let gone = if goes_forth(row) { x } else { ROW - x };
    let down = if is_ramp(row) { gone / ROW } else { 0.0 };
    [x, across + aside, -BETWEEN[1] * (level as f64 + down) + up]
}

fn drift_of(row: u64) -> Drift {
    let forth = goes_forth(row);
    let mut rng = rng(3, row);
    let size = [rng.range(3.7, 4.4), rng.range(3.6, 4.1)];
    Drift::along(row << 8, size, |t| {
        row_at(row, ROW * if forth { t } else { 1.0 - t })
    })
}

/// Crosscuts from a row to the next: where each begins and ends along them.
fn crosscuts_after(row: u64) -> Vec<Drift> {
    let mut rng = rng(4, row);
    let forth = goes_forth(row);
    // From one level's ramp to the next one's row, and back: only where both are at one height.
    let end = if forth { ROW - 5.0 } else { 5.0 };
    let mut places = vec![[end, end]];
    if !is_ramp(row) && !is_ramp(row + 1) {
        let mut x = rng.range(12.0, 16.0);
        while x < ROW - 40.0 {
            places.push([x, x + rng.range(-6.0, 6.0)]);
            x += rng.range(30.0, 75.0);
        }
        if !forth {
            places[1..].iter_mut().for_each(|p| *p = p.map(|x| ROW - x));
        }
    }
    (0u64..)
        .zip(places)
        .map(|(i, [from, to])| {
            let (a, b) = (row_at(row, from), row_at(row + 1, to));
            let size = [rng.range(3.3, 4.2), rng.range(3.3, 3.9)];
            let bow = rng.range(-2.0, 2.0);
            Drift::along(row << 8 | (i + 1), size, |t| {
                let mut p = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
                p[0] += bow * (t * TAU * 0.5).sin();
                p
            })
        })
        .collect()
}

/// A survey of so many points as a binary PCD file. Returns the metres of drifts that it went through.
pub(crate) fn write_map(path: &Path, points: u64) -> Result<f64> {
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    write!(
        file,
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n\
         COUNT 1 1 1\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA binary\n"
    )?;
    let outline = Outline::new();
    let (mut left, mut metres) = (points, 0.0);
    let mut before: Vec<Drift> = Vec::new();
    let mut this = drift_of(0);
    for row in 0.. {
        let next = drift_of(row + 1);
        let after = crosscuts_after(row);
        let openings: Vec<_> = before.iter().chain(&after).collect();
        let ends = [&this, &next];
        let cuts = after.iter().map(|c| (c, &ends[..]));
        for (drift, openings) in std::iter::once((&this, &openings[..])).chain(cuts) {
            let pieces: Vec<f64> = (0..(drift.length() / PIECE) as u32)
                .map(|i| PIECE * f64::from(i))
                .collect();
            // Some megabytes at a time.
            for pieces in pieces.chunks(32) {
                let drawn: Vec<Vec<[f32; 3]>> = pieces
                    .par_iter()
                    .map(|s| draw(drift, &outline, [*s, s + PIECE], openings, PITCH, 0))
                    .collect();
                for points in drawn {
                    let mut bytes = Vec::with_capacity(12 * points.len());
                    for p in points.iter().take(usize::try_from(left)?) {
                        bytes.extend(p.iter().flat_map(|v| v.to_le_bytes()));
                    }
                    file.write_all(&bytes)?;
                    left = left.saturating_sub(points.len() as u64);
                    metres += PIECE;
                    if left == 0 {
                        file.flush()?;
                        return Ok(metres);
                    }
                }
            }
        }
        (before, this) = (after, next);
    }
    Ok(metres)
}

/// Query number `i` in a frame of its own, and where it lies.
pub(crate) fn query(i: usize) -> Result<(Cloud, Pose)> {
    query_from(QUERIES[i], i)
}

/// A query that begins so many metres along the first row, drawn by stream `i`, in a frame of its own, and where it lies.
pub(crate) fn query_from(metres: f64, i: usize) -> Result<(Cloud, Pose)> {
    let outline = Outline::new();
    let (row, cuts) = (drift_of(0), crosscuts_after(0));
    let openings: Vec<_> = cuts.iter().collect();
    let truth = random_frame(SEED + i as u64);
    let map_to_query = truth.inverse();
    let mut points = Vec::new();
    for piece in 0..(QUERY / PIECE) as u32 {
        let from = metres + PIECE * f64::from(piece);
        let part = [from, from + PIECE];
        let drawn = draw(&row, &outline, part, &openings, QUERY_PITCH, 1 + i as u64);
        points.extend(
            drawn
                .iter()
                .map(|p| map_to_query.transform(p.map(f64::from))),
        );
    }
    Ok((Cloud::from_points(&points)?.0, truth))
}
