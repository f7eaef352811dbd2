//! The frames that clouds come in, and how a map's own errors displace it.

use winze::Pose;
use winze::rng::Rng;

use super::{Frame, QuerySpec};
use crate::motion::Trajectory;
use crate::noise;

/// The query's frame: `query_from_world`, and whether its z is up.
pub(super) fn frame(
    spec: &QuerySpec,
    i: usize,
    trajectory: &Trajectory,
    world_from_map: &Pose,
    rng: &mut Rng,
) -> (Pose, bool) {
    if let Some([x, y, z, yaw, pitch, roll]) = spec.map_from_query {
        let [yaw, pitch, roll] = [yaw, pitch, roll].map(f64::to_radians);
        let map_from_query = Pose::from_yaw_pitch_roll(yaw, pitch, roll, [x, y, z]);
        let tilt = libm::acos(map_from_query.rotate([0.0, 0.0, 1.0])[2].clamp(-1.0, 1.0));
        let query_from_world = world_from_map.compose(&map_from_query).inverse();
        return (query_from_world, tilt < 3f64.to_radians());
    }
    let first = trajectory
        .world_from_sensor
        .first()
        .copied()
        .unwrap_or_default();
    let heading = first.yaw_pitch_roll()[0];
    let world_from_first = Pose::from_yaw_pitch_roll(heading, 0.0, 0.0, first.translation());
    let (yaw, attitude, direction, far) = (
        rng.range(-std::f64::consts::PI, std::f64::consts::PI),
        rng.attitude(),
        rng.direction(),
        rng.uniform(),
    );
    let level = match spec.frame {
        // Every sensor comes level and tilted.
        Frame::Mixed => (i / spec.sensors.len().max(1)).is_multiple_of(2),
        Frame::Level | Frame::FirstPose => true,
        Frame::Tilted => false,
    };
    let turn = match (spec.frame, level) {
        (Frame::FirstPose, _) => [0.0; 3],
        (_, true) => [0.0, 0.0, yaw],
        (_, false) => attitude,
    };
    let place = direction.map(|v| v * spec.away * far);
    let query_from_first = Pose::from_rotation_vector(turn, place);
    (query_from_first.compose(&world_from_first.inverse()), level)
}

/// A point displaced by what loop closures left of a survey's drift.
pub(super) fn warped(p: [f64; 3], sd: f64, seed: u64) -> [f64; 3] {
    if sd <= 0.0 {
        return p;
    }
    let at = p.map(|v| v / WARP_LENGTH);
    let mut axis = 0u64;
    p.map(|v| {
        axis += 1;
        v + WARP_GAIN * sd * noise::value(at, seed.wrapping_add(axis))
    })
}

/// Distance over which a survey's remaining error changes, metres.
const WARP_LENGTH: f64 = 25.0;
/// Value noise has a standard deviation of about 0.3.
const WARP_GAIN: f64 = 3.3;
