//! A map, a query and the truth between them.

use winze::rng::Rng;
use winze::{Cloud, Error, Pose};

use crate::lidar::{Lidar, Return};
use crate::mine::{Drift, Mine};

/// A prior map, a query in a frame of its own, and where it lies.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The prior map.
    pub map: Cloud,
    /// The query.
    pub query: Cloud,
    /// Takes query points to the map, exactly.
    pub map_from_query: Pose,
}

/// The mine of `winze demo`: a main drift with a bend, crosscuts and stubs, about 200 m in all. The map is
/// a survey of nearly all of it; the query a later drive of some 30 m past a junction, with dust, in a frame
/// that is turned and tens of metres away, reaching into a heading that the map does not hold.
///
/// # Errors
/// None for the worlds made here; the type is that of [`Cloud::from_points`].
pub fn demo(seed: u64) -> Result<Scene, Error> {
    let drift = |from: [f64; 3], to: [f64; 3], width: f64| Drift {
        from,
        to,
        width,
        height: 3.8,
    };
    let mine = Mine {
        drifts: vec![
            drift([0.0, 0.0, 0.0], [45.0, 4.0, 1.0], 4.4),
            drift([43.0, 3.5, 1.0], [88.0, -12.0, 3.2], 4.4),
            drift([22.0, 2.0, 0.5], [27.0, 27.0, 0.8], 3.8),
            drift([60.0, -2.0, 1.9], [52.0, -26.0, 1.6], 4.0),
            drift([70.0, -6.0, 2.3], [80.0, 14.0, 2.9], 3.8),
            drift([10.0, 1.0, 0.2], [12.0, -9.0, 0.3], 3.4),
            drift([38.0, 3.4, 0.8], [36.0, 11.0, 0.9], 3.4),
        ],
        roughness: 0.3,
        seed,
    };
    let survey = Lidar {
        beams: 24,
        elevation: [-0.75, 0.75],
        shots: 360,
        range: 40.0,
        range_noise: 0.015,
        dust: 0.0,
    };
    let driven = Lidar {
        beams: 16,
        elevation: [-0.5, 0.6],
        range_noise: 0.02,
        dust: 0.06,
        ..survey
    };
    let surveyed: Vec<[[f64; 3]; 2]> = vec![
        [[2.0, 0.2, 0.0], [44.0, 3.8, 1.0]],
        [[45.0, 3.3, 1.1], [86.0, -11.3, 3.1]],
        [[22.5, 5.0, 0.5], [26.5, 25.0, 0.8]],
        [[59.0, -5.0, 1.9], [53.0, -24.0, 1.6]],
    ];
    let mut map = Vec::new();
    for (leg, [from, to]) in (0u64..).zip(&surveyed) {
        map.extend(drive(&mine, &survey, *from, *to, 2.5, seed, leg << 16));
    }
    let mut query = drive(
        &mine,
        &driven,
        [52.0, 1.0, 1.5],
        [71.0, -5.8, 2.3],
        1.5,
        seed,
        8 << 16,
    );
    query.extend(drive(
        &mine,
        &driven,
        [71.5, -3.0, 2.4],
        [76.0, 6.0, 2.7],
        1.5,
        seed,
        9 << 16,
    ));
    let mut rng = Rng::new(seed, 99);
    let place = [
        rng.range(-60.0, 60.0),
        rng.range(-60.0, 60.0),
        rng.range(-10.0, 10.0),
    ];
    let query_from_map = Pose::from_rotation_vector(rng.attitude(), place);
    let moved: Vec<[f64; 3]> = query.iter().map(|p| query_from_map.transform(*p)).collect();
    Ok(Scene {
        map: Cloud::from_points(&map)?.0,
        query: Cloud::from_points(&moved)?.0,
        map_from_query: query_from_map.inverse(),
    })
}

/// Turns of the LiDAR every `every` metres from one floor point to another, 1.4 m above the floor.
fn drive(
    mine: &Mine,
    lidar: &Lidar,
    from: [f64; 3],
    to: [f64; 3],
    every: f64,
    seed: u64,
    first: u64,
) -> Vec<Return> {
    let d: [f64; 3] = std::array::from_fn(|a| to[a] - from[a]);
    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a few dozen"
    )]
    let turns = (length / every).ceil() as u32;
    let heading = libm::atan2(d[1], d[0]);
    let mut rng = Rng::new(seed, first | 0xFFFF);
    let mut out = Vec::new();
    for turn in 0..=turns {
        let share = f64::from(turn) / f64::from(turns.max(1));
        let at: [f64; 3] =
            std::array::from_fn(|a| from[a] + share * d[a] + if a == 2 { 1.4 } else { 0.0 });
        let wobble = [rng.range(-0.03, 0.03), rng.range(-0.03, 0.03)];
        let pose = Pose::from_yaw_pitch_roll(heading, wobble[0], wobble[1], at);
        out.extend(lidar.turn(mine, &pose, seed, first + u64::from(turn)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use winze::kdtree::KdTree;

    #[test]
    fn the_truth_puts_the_query_on_the_map() {
        let scene = demo(0).unwrap();
        assert!(scene.map.len() > 200_000, "{}", scene.map.len());
        assert!(scene.query.len() > 50_000, "{}", scene.query.len());
        let tree = KdTree::build(scene.map.points());
        let m = winze::metrics::inliers(
            &tree,
            scene.map.origin(),
            &scene.query,
            &scene.map_from_query,
            0.5,
        );
        assert!(m.fraction > 0.75 && m.fraction < 0.99, "{m:?}");
        let off = winze::metrics::inliers(
            &tree,
            scene.map.origin(),
            &scene.query,
            &Pose::identity(),
            0.5,
        );
        assert!(off.fraction < 0.4, "{off:?}");
        assert_ne!(demo(1).unwrap().query, scene.query);
    }
}
