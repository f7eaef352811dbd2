//! What a run is asked besides its configuration.

use crate::cloud::Cloud;
use crate::method::Method;
use crate::outcome::Stage;
use crate::pose::Pose;
use crate::vec3::distance;

/// Told of each stage by name, as it begins (with `None`) and as it ends.
pub type Progress<'a> = dyn Fn(&str, Option<&Stage>) + Sync + 'a;

/// What a run is asked besides its configuration.
#[derive(Clone, Copy, Default)]
pub struct Request<'a> {
    /// How to look.
    pub method: Method,
    /// Where `ndt+icp` starts; the identity where there is none.
    pub initial: Option<Pose>,
    /// Both clouds have z up: poses that tilt by more than [`GRAVITY_TOLERANCE`] are refused.
    pub gravity_aligned: bool,
    /// The query's centroid is known to lie in this ball of the map: poses that put it elsewhere are
    /// refused, and nothing is matched with what lies where the query cannot reach.
    pub near: Option<Near>,
    /// Who wants to follow.
    pub progress: Option<&'a Progress<'a>>,
}

/// How far from upright a gravity-aligned pose may tilt, radians (10°).
pub const GRAVITY_TOLERANCE: f64 = 0.174_532_925;

/// A ball in the map's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Its centre, metres.
    pub centre: [f64; 3],
    /// Its radius, metres.
    pub radius: f64,
}

impl Near {
    /// How far from the ball's centre a query's points can lie, metres, where the ball holds that `centroid` of it.
    pub(crate) fn reach(&self, query: &Cloud, centroid: [f64; 3]) -> f64 {
        let furthest = query.bounds(0.0).map_or(0.0, |(low, high)| {
            let corner = |a: usize| {
                let (below, above) = (centroid[a] - low[a], high[a] - centroid[a]);
                if below > above { low[a] } else { high[a] }
            };
            distance(centroid, std::array::from_fn(corner))
        });
        self.radius + furthest
    }

    fn holds(&self, p: [f64; 3], beyond: f64) -> bool {
        distance(p, self.centre) <= self.radius + beyond
    }
}

impl Request<'_> {
    /// Whether anything is known beforehand that a pose must agree with.
    pub(crate) fn restricts(&self) -> bool {
        self.gravity_aligned || self.near.is_some()
    }

    /// Whether what is known beforehand allows a pose that puts the query's centroid there; a pose that is yet to be refined is allowed to be so
    /// many metres outside of the ball.
    pub(crate) fn plausible(&self, pose: &Pose, centroid: [f64; 3], unrefined: f64) -> bool {
        let upright = !self.gravity_aligned
            || pose.rotate([0.0, 0.0, 1.0])[2] >= libm::cos(GRAVITY_TOLERANCE);
        upright
            && self
                .near
                .is_none_or(|near| near.holds(pose.transform(centroid), unrefined))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_region_holds_the_centroid_and_lets_unrefined_poses_stray() {
        let request = Request {
            near: Some(Near {
                centre: [10.0, 0.0, 0.0],
                radius: 2.0,
            }),
            ..Request::default()
        };
        let pose = Pose::from_translation([10.0, 2.5, 0.0]);
        assert!(!request.plausible(&pose, [0.0; 3], 0.0));
        assert!(!request.plausible(&pose, [0.0; 3], 0.49));
        assert!(request.plausible(&pose, [0.0; 3], 0.51));
        assert!(request.plausible(&pose, [0.0, -0.6, 0.0], 0.0));
        assert!(request.restricts() && !Request::default().restricts());
    }

    #[test]
    fn a_region_reaches_as_far_as_the_query_from_its_centroid() {
        let near = Near {
            centre: [0.0; 3],
            radius: 2.0,
        };
        let (query, _) = Cloud::from_points(&[[0.0; 3], [3.0, 4.0, 0.0]]).unwrap();
        assert!((near.reach(&query, [0.0; 3]) - 7.0).abs() < 1e-6);
        // The centroid of points that were left out may lie outside.
        assert!((near.reach(&query, [-9.0, 4.0, 0.0]) - (2.0 + 160.0f64.sqrt())).abs() < 1e-6);
    }
}
