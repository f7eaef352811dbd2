//! What odometry does to the part of a query that is not in the map.
//!
//! A pose is fitted to the part that lies on the map. The rest hangs on it by the query's own SLAM, and the pose of the whole, the rigid one
//! that fits all of its points to where they truly are, is another one. How far apart the two may be follows from how odometry errs
//! ([`OdometryConfig`]): both poses are linear in its errors.
//!
//! The query is taken as a [line](crate::line).

use nalgebra::Vector3;

use crate::config::OdometryConfig;
use crate::line::{Line, MOST_TURNED, SECTIONS};

use super::add_outer;

/// The covariance, in axes of the map and about `centre`, of the pose of `all` points of a query against the pose of those `on_map`, where
/// a bend is seen to put `beyond` metres between them at the centroid. Zero where all are on the map.
pub(super) fn extrapolate(
    all: &[[f64; 3]],
    on_map: &[[f64; 3]],
    centre: [f64; 3],
    odometry: &OdometryConfig,
    beyond: f64,
) -> [[f64; 6]; 6] {
    let mut covariance = [[0.0; 6]; 6];
    if all.is_empty() || on_map.is_empty() {
        return covariance;
    }
    let line = Line::of(all, on_map, centre);
    let mut add = |motion: &dyn Fn(f64) -> (Vector3<f64>, Vector3<f64>)| {
        add_outer(&mut covariance, &line.apart(&line.motion(motion)));
    };
    // The turn that would leave so much, about no one knows which axis.
    let seen = (beyond / line.off_by_turning().max(f64::MIN_POSITIVE)).min(MOST_TURNED);
    let nothing = Vector3::zeros();
    // Steps that are all too long.
    add(&|way| (line.axis * (odometry.scale * way), nothing));
    for k in 0..3 {
        let axis: Vector3<f64> = Vector3::ith(k, 1.0);
        // Gravity holds the tilt, nothing holds the heading.
        let held = if k == 2 { 1.0 } else { odometry.tilt };
        let turning = axis * (held * odometry.turn.to_radians()).max(seen);
        add(&|way| (turning.cross(&line.axis) * (way * way / 2.0), turning * way));
        // Each step's own error acts on all that comes after it.
        let root = line.step.sqrt();
        let turned = axis * (held * odometry.turn_walk.to_radians() * root);
        let moved = axis * (odometry.walk * root);
        for step in 1..SECTIONS {
            #[expect(clippy::cast_precision_loss, reason = "a small count")]
            let from = step as f64 * line.step;
            add(&|way| match way - from {
                after if after > 0.0 => (turned.cross(&line.axis) * after, turned),
                _ => (nothing, nothing),
            });
            add(&|way| (if way > from { moved } else { nothing }, nothing));
        }
    }
    covariance
}
