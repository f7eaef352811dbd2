//! A rough mine, a survey of it and drives through it, for the studies of refinement.

use winze::rng::Rng;
use winze::{Cloud, Pose};
use winze_sim::lidar::{Lidar, cast};
use winze_sim::mine::{Drift, Mine};

use super::Result;

/// Where a drive leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Route {
    /// 18 m along the main drift, all of it surveyed.
    Mapped,
    /// 9 m along the main drift, then 12 m into a crosscut that the survey did not enter.
    HalfMapped,
    /// One turn on the spot in the main drift.
    OneTurn,
}

/// What is asked of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trip {
    pub route: Route,
    /// Share of shots that dust returns.
    pub dust: f64,
    /// Rings of a spinning LiDAR, else as many directions drawn at random from the same solid angle.
    pub rings: bool,
}

impl Trip {
    pub const CLEAN: Self = Self {
        route: Route::Mapped,
        dust: 0.0,
        rings: true,
    };
}

/// A query in a frame of its own, and where it lies.
pub struct Drive {
    pub query: Cloud,
    /// Takes query points to the map, exactly.
    pub truth: Pose,
}

/// The way of the main drift in the middle of the drives, map frame.
pub const ALONG: [f64; 3] = [0.986, -0.164, 0.032];

/// A prior map, and a drive for each of the `trips`: a main drift of blasted rock with a bend and a
/// crosscut. Any other world may stand here.
pub fn scene(trips: &[Trip], seed: u64) -> Result<(Cloud, Vec<Drive>)> {
    let drift = |from: [f64; 3], to: [f64; 3], width: f64| Drift {
        from,
        to,
        width,
        height: 3.8,
    };
    let mine = Mine {
        drifts: vec![
            drift([0.0, 0.0, 0.0], [35.0, 3.0, 0.8], 4.4),
            drift([33.0, 2.5, 0.8], [66.0, -9.0, 2.4], 4.4),
            drift([42.0, 0.5, 1.2], [49.0, 16.0, 1.5], 3.8),
        ],
        roughness: 0.35,
        // The octaves of one relief have seeds that follow each other.
        seed: 100 * seed,
    };
    let survey = Lidar {
        beams: 20,
        elevation: [-0.75, 0.75],
        shots: 300,
        range: 40.0,
        range_noise: 0.015,
        dust: 0.0,
    };
    let mut map = Vec::new();
    for (leg, [from, to]) in (0u64..).zip([
        [[6.0, 0.7, 0.2], [33.0, 2.8, 0.8]],
        [[34.0, 2.2, 0.8], [61.0, -7.2, 2.2]],
    ]) {
        for (pose, turn) in way(from, to, 3.0, seed, leg << 16) {
            map.extend(survey.turn(&mine, &pose, seed, turn));
        }
    }
    let drives = trips
        .iter()
        .map(|trip| drive(&mine, &survey, trip, seed))
        .collect::<Result<_>>()?;
    Ok((Cloud::from_points(&map)?.0, drives))
}

fn drive(mine: &Mine, survey: &Lidar, trip: &Trip, seed: u64) -> Result<Drive> {
    let lidar = Lidar {
        beams: 16,
        elevation: [-0.5, 0.6],
        range_noise: 0.02,
        dust: trip.dust,
        ..*survey
    };
    let main = [[35.0, 1.8, 0.9], [43.5, -1.2, 1.3]];
    let legs = match trip.route {
        Route::Mapped => vec![[[26.0, 2.0, 0.6], [34.0, 2.4, 0.8]], main],
        Route::HalfMapped => vec![main, [[43.0, 2.5, 1.2], [47.5, 13.0, 1.5]]],
        Route::OneTurn => vec![[[38.0, 0.8, 1.0]; 2]],
    };
    let mut query = Vec::new();
    for (leg, [from, to]) in (8u64..).zip(legs) {
        for (pose, turn) in way(from, to, 1.5, seed, leg << 16) {
            query.extend(if trip.rings {
                lidar.turn(mine, &pose, seed, turn)
            } else {
                random_turn(&lidar, mine, &pose, seed, turn)
            });
        }
    }
    let mut rng = Rng::new(seed, 99);
    let place = [
        rng.range(-60.0, 60.0),
        rng.range(-60.0, 60.0),
        rng.range(-10.0, 10.0),
    ];
    let query_from_map = Pose::from_rotation_vector(rng.attitude(), place);
    let moved: Vec<[f64; 3]> = query.iter().map(|p| query_from_map.transform(*p)).collect();
    Ok(Drive {
        query: Cloud::from_points(&moved)?.0,
        truth: query_from_map.inverse(),
    })
}

/// Sensor poses every `every` metres from one floor point to another, 1.4 m above the floor, each
/// with its turn's number.
fn way(from: [f64; 3], to: [f64; 3], every: f64, seed: u64, first: u64) -> Vec<(Pose, u64)> {
    let d: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
    let turns = ((d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / every).ceil() as u32;
    let heading = d[1].atan2(d[0]);
    let mut rng = Rng::new(seed, first | 0xFFFF);
    (0..=turns)
        .map(|turn| {
            let share = f64::from(turn) / f64::from(turns.max(1));
            let at: [f64; 3] =
                std::array::from_fn(|a| from[a] + share * d[a] + if a == 2 { 1.4 } else { 0.0 });
            let wobble = [rng.range(-0.03, 0.03), rng.range(-0.03, 0.03)];
            let pose = Pose::from_yaw_pitch_roll(heading, wobble[0], wobble[1], at);
            (pose, first + u64::from(turn))
        })
        .collect()
}

/// As many shots as a turn has, each in a direction of its own.
fn random_turn(lidar: &Lidar, mine: &Mine, pose: &Pose, seed: u64, turn: u64) -> Vec<[f64; 3]> {
    let mut rng = Rng::new(seed, 1 << 40 | turn);
    let [low, high] = lidar.elevation.map(f64::sin);
    (0..lidar.beams * lidar.shots)
        .filter_map(|_| {
            let up = rng.range(low, high);
            let azimuth = rng.range(0.0, std::f64::consts::TAU);
            let flat = (1.0 - up * up).sqrt();
            let direction = pose.rotate([flat * azimuth.cos(), flat * azimuth.sin(), up]);
            let origin = pose.translation();
            let range =
                cast(mine, origin, direction, lidar.range)? + lidar.range_noise * rng.normal();
            Some(std::array::from_fn(|a| origin[a] + range * direction[a]))
        })
        .collect()
}
