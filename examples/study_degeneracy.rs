//! Are the directions that an answer calls open the tunnel's own? Tunnels of every bareness, from blank to junction.
//!
//! Each tunnel has its own size, heading, slope and walls. A map and a query are drawn on it apart, the query is laid on the map
//! within 10 cm and half a degree of the truth, refined, asked and judged by the functions that `locate` calls (at one voxel size, with no other place to
//! weigh), and what the verdict calls open is held against the tunnel's axis. Prints the table of `docs/verdicts.md`.
//!
//! ```sh
//! cargo run --release --example study_degeneracy
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

use std::f64::consts::{PI, TAU};

use winze::config::{IcpConfig, IcpMetric};
use winze::degeneracy::{DirectionKind, directions};
use winze::icp::{align, information};
use winze::judge::judge;
use winze::prepare::prepare;
use winze::rng::Rng;
use winze::vec3::dot;
use winze::verify::{ask_relief, candidate};
use winze::{Cloud, Config, Pose};

type Error = Box<dyn std::error::Error>;

/// Tunnels of each kind.
const EACH: u64 = 40;
/// How far the map goes on at either end of the query, metres.
const BEYOND: f64 = 20.0;
/// Points per square metre of wall, of the map and of the query.
const DENSITY: [f64; 2] = [120.0, 60.0];
/// Their noise, metres.
const NOISE: [f64; 2] = [0.01, 0.02];
const VOXEL: f64 = 0.2;

/// What a tunnel is like.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// Flat floor, walls, an arched roof; relief of so many metres, root mean square.
    Drift(f64),
    /// A pipe, blank.
    Round,
    /// A blank drift with a niche in one wall, 2 m wide and 1 m deep.
    Niche,
    /// A blank drift that another one crosses.
    Junction,
}

/// A point of a wall, and the way out of the rock there.
type Spot = [[f64; 3]; 2];

/// A tunnel along x, the floor at z = 0.
struct Tunnel {
    kind: Kind,
    width: f64,
    height: f64,
    /// Along the tunnel, around it, phase, share: of the waves of its relief.
    waves: Vec<[f64; 4]>,
}

impl Tunnel {
    fn new(kind: Kind, rng: &mut Rng) -> Self {
        let waves: Vec<[f64; 4]> = (0..40)
            .map(|i| {
                let wavelength = 6.0 * 0.93f64.powi(i);
                let turn = rng.range(0.0, PI);
                let k = TAU / wavelength;
                let share = wavelength / 6.0;
                [k * turn.cos(), k * turn.sin(), rng.range(0.0, TAU), share]
            })
            .collect();
        Self {
            kind,
            width: rng.range(3.5, 6.0),
            height: rng.range(3.0, 4.5),
            waves,
        }
    }

    /// Half the width at a height.
    fn half(&self, z: f64) -> f64 {
        let spring = 0.6 * self.height;
        let up = ((z - spring) / (self.height - spring)).clamp(0.0, 1.0);
        0.5 * self.width * (1.0 - up * up).sqrt()
    }

    /// A spot of the wall and the way out of the rock there, drawn evenly enough.
    fn spot(&self, along: [f64; 2], rng: &mut Rng) -> Spot {
        let x = rng.range(along[0], along[1]);
        let spring = 0.6 * self.height;
        if self.kind == Kind::Round {
            let (s, c) = rng.range(0.0, TAU).sin_cos();
            let r = 0.5 * self.width;
            return [[x, r * c, r + r * s], [0.0, -c, -s]];
        }
        let arch = 0.5 * PI * 0.5 * (self.width + 2.0 * (self.height - spring));
        let around = self.width + 2.0 * spring + arch;
        let u = rng.range(0.0, around);
        let half = 0.5 * self.width;
        let (at, out) = if u < self.width {
            ([x, u - half, 0.0], [0.0, 0.0, 1.0])
        } else if u < self.width + spring {
            ([x, half, u - self.width], [0.0, -1.0, 0.0])
        } else if u < self.width + 2.0 * spring {
            ([x, -half, u - self.width - spring], [0.0, 1.0, 0.0])
        } else {
            let (s, c) = (PI * (u - self.width - 2.0 * spring) / arch).sin_cos();
            let rise = self.height - spring;
            let out = [0.0, -c / half, -s / rise];
            let length = (out[1] * out[1] + out[2] * out[2]).sqrt();
            ([x, half * c, spring + rise * s], out.map(|v| v / length))
        };
        let relief = match self.kind {
            Kind::Drift(metres) => metres * self.relief(x, u),
            _ => 0.0,
        };
        [std::array::from_fn(|a| at[a] + relief * out[a]), out]
    }

    /// The relief of a wall in units of its root mean square.
    fn relief(&self, x: f64, u: f64) -> f64 {
        let power: f64 = self.waves.iter().map(|w| 0.5 * w[3] * w[3]).sum();
        let sum: f64 = self
            .waves
            .iter()
            .map(|w| w[3] * (w[0] * x + w[1] * u + w[2]).sin())
            .sum();
        sum / power.sqrt()
    }

    /// Points on its walls from x = `along[0]` to `along[1]`, the middle of the query at 0.
    fn points(&self, along: [f64; 2], density: f64, noise: f64, rng: &mut Rng) -> Vec<[f64; 3]> {
        let around = 2.0 * (self.width + self.height);
        let count = |square_metres: f64| -> usize {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a count"
            )]
            let n = (density * square_metres) as usize;
            n
        };
        let own = count(around * (along[1] - along[0]));
        let mut spots: Vec<Spot> = (0..own).map(|_| self.spot(along, rng)).collect();
        let inside = |across: f64, z: f64| z > 0.0 && across.abs() < self.half(z);
        match self.kind {
            Kind::Junction => {
                // Where one drift is inside the other there is no wall.
                spots.retain(|[at, _]| !inside(at[0], at[2]));
                let reach = [-10.0, 10.0];
                for _ in 0..count(around * 20.0) {
                    let turned = self.spot(reach, rng).map(|[x, y, z]| [-y, x, z]);
                    if !inside(turned[0][1], turned[0][2]) {
                        spots.push(turned);
                    }
                }
            }
            Kind::Niche => {
                let (half, [from, to], high, deep) = (0.5 * self.width, [3.0, 5.0], 1.8, 1.0);
                let open =
                    |at: &[f64; 3]| at[1] >= half && (from..to).contains(&at[0]) && at[2] < high;
                spots.retain(|[at, _]| !open(at));
                let mut face = |area: f64, spot: &dyn Fn(f64, f64) -> Spot, rng: &mut Rng| {
                    for _ in 0..count(area) {
                        let (u, v) = (rng.range(0.0, 1.0), rng.range(0.0, 1.0));
                        spots.push(spot(u, v));
                    }
                };
                let long = to - from;
                let x = |u: f64| from + u * long;
                face(
                    long * high,
                    &|u, v| [[x(u), half + deep, v * high], [0.0, -1.0, 0.0]],
                    rng,
                );
                face(
                    long * deep,
                    &|u, v| [[x(u), half + v * deep, 0.0], [0.0, 0.0, 1.0]],
                    rng,
                );
                face(
                    long * deep,
                    &|u, v| [[x(u), half + v * deep, high], [0.0, 0.0, -1.0]],
                    rng,
                );
                // The two that a slide along the drift runs against.
                face(
                    deep * high,
                    &|u, v| [[from, half + u * deep, v * high], [1.0, 0.0, 0.0]],
                    rng,
                );
                face(
                    deep * high,
                    &|u, v| [[to, half + u * deep, v * high], [-1.0, 0.0, 0.0]],
                    rng,
                );
            }
            Kind::Drift(_) | Kind::Round => {}
        }
        let noisy = |[at, out]: Spot| {
            let off = noise * rng.normal();
            std::array::from_fn(|a| at[a] + off * out[a])
        };
        spots.into_iter().map(noisy).collect()
    }
}

/// What was called open.
#[derive(Default)]
struct Found {
    /// Refused before anything was asked.
    not_asked: usize,
    /// Tunnels with anything open.
    open: usize,
    slides: usize,
    turns: usize,
    /// Of all directions to the axis, degrees.
    angles: Vec<f64>,
    /// Information of the weakest slide, percent of a pair's.
    weakest: Vec<f64>,
    verdicts: std::collections::BTreeMap<&'static str, usize>,
}

fn study(kind: Kind, (seed, stream): (u64, u64), found: &mut Found) -> Result<(), Error> {
    let mut rng = Rng::new(seed, stream);
    let tunnel = Tunnel::new(kind, &mut rng);
    let reach = rng.range(8.0, 20.0);
    let (heading, slope) = (rng.range(0.0, TAU), rng.range(-0.3, 0.3));
    let about = |v: [f64; 3], from| Pose::from_rotation_vector(v, from);
    let map_from_tunnel = about([0.0, 0.0, heading], [500.0, -300.0, 40.0])
        .compose(&about([0.0, slope, 0.0], [0.0; 3]));
    let axis = map_from_tunnel.rotate([1.0, 0.0, 0.0]);
    let query_from_tunnel = Pose::from_rotation_vector(
        rng.direction().map(|c| 3.0 * c),
        rng.direction().map(|c| 20.0 * c),
    );
    let cloud = |points: Vec<[f64; 3]>, frame: &Pose| -> Result<Cloud, Error> {
        let moved: Vec<[f64; 3]> = points.iter().map(|p| frame.transform(*p)).collect();
        Ok(Cloud::from_points(&moved)?.0)
    };
    let long = [-reach - BEYOND, reach + BEYOND];
    let of_map = tunnel.points(long, DENSITY[0], NOISE[0], &mut rng);
    let of_query = tunnel.points([-reach, reach], DENSITY[1], NOISE[1], &mut rng);
    let config = Config::default();
    let map = prepare(&cloud(of_map, &map_from_tunnel)?, &config.prepare, VOXEL);
    let query = prepare(
        &cloud(of_query, &query_from_tunnel)?,
        &config.prepare,
        VOXEL,
    );
    let truth = map_from_tunnel.compose(&query_from_tunnel.inverse());
    let centre = truth.transform(query.centroid().unwrap_or_default());
    let off = (
        rng.direction().map(|c| 0.1 * c),
        rng.direction().map(|c| 0.5f64.to_radians() * c),
    );
    let start = truth.perturbed(off.0, off.1, centre);
    let icp = IcpConfig {
        metric: IcpMetric::PointToPlane,
        ..config.icp.clone()
    };
    let refined = align(&map, &query, &start, &icp);
    let verify = config.verify.at(VOXEL, Some(tunnel.width));
    let pose = refined.map_from_query;
    let mut places = [candidate(&map, &query, &pose, Some(refined.stop), &verify)];
    ask_relief(&mut places, &map, &query, &verify, Some(&icp));
    let judgement = judge(&places, &map, &query, &verify);
    *found.verdicts.entry(judgement.verdict.name()).or_default() += 1;
    let distance = verify.overlap_distance.metres(VOXEL);
    let told = directions(&information(
        &map,
        &query,
        &pose,
        distance,
        verify.max_points,
    ));
    found.weakest.push(100.0 * told[0].information);
    let Some(open) = judgement.unobservable else {
        found.not_asked += 1;
        return Ok(());
    };
    found.open += usize::from(!open.is_empty());
    for d in open {
        match d.kind {
            DirectionKind::Translation => found.slides += 1,
            DirectionKind::Rotation => found.turns += 1,
        }
        let cosine = dot(d.direction, axis).abs().min(1.0);
        found.angles.push(cosine.acos().to_degrees());
    }
    Ok(())
}

/// A value below which a share of the sorted values lies.
fn at(sorted: &[f64], share: f64) -> String {
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "an index"
    )]
    let i = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(i).map_or("-".into(), |v| format!("{v:.2}"))
}

fn main() -> Result<(), Error> {
    println!(
        "tunnel | of them | not asked | something open | slides | turns | to the axis, °: median | 95 % | most | weakest slide, % of a pair: least | median | most | verdicts"
    );
    println!("---|---|---|---|---|---|---|---|---|---|---|---|---");
    let kinds = [
        ("pipe, blank", Kind::Round),
        ("drift, blank", Kind::Drift(0.0)),
        ("drift, relief 1 cm", Kind::Drift(0.01)),
        ("drift, relief 2 cm", Kind::Drift(0.02)),
        ("drift, relief 5 cm", Kind::Drift(0.05)),
        ("drift, relief 10 cm", Kind::Drift(0.1)),
        ("drift, relief 20 cm", Kind::Drift(0.2)),
        ("drift, blank, one niche", Kind::Niche),
        ("junction of blank drifts", Kind::Junction),
    ];
    let mut all: Vec<f64> = Vec::new();
    for (stream, (name, kind)) in (100..).zip(kinds) {
        let mut found = Found::default();
        for seed in 0..EACH {
            study(kind, (seed, stream), &mut found)?;
        }
        found.angles.sort_by(f64::total_cmp);
        found.weakest.sort_by(f64::total_cmp);
        let (a, w) = (&found.angles, &found.weakest);
        let verdicts: Vec<String> = found
            .verdicts
            .iter()
            .map(|(v, n)| format!("{n} {v}"))
            .collect();
        println!(
            "{name} | {EACH} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {}",
            found.not_asked,
            found.open,
            found.slides,
            found.turns,
            at(a, 0.5),
            at(a, 0.95),
            at(a, 1.0),
            at(w, 0.0),
            at(w, 0.5),
            at(w, 1.0),
            verdicts.join(", ")
        );
        all.extend(found.angles);
    }
    all.sort_by(f64::total_cmp);
    println!(
        "\nAll {} open directions: median {}°, 95 % {}°, most {}° from the axis",
        all.len(),
        at(&all, 0.5),
        at(&all, 0.95),
        at(&all, 1.0)
    );
    Ok(())
}
