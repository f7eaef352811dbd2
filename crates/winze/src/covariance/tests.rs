//! Tests of the covariance: against motions made by hand, and against errors that were really made.

use proptest::prelude::*;

use super::*;
use crate::config::{IcpConfig, IcpMetric};
use crate::degeneracy::directions;
use crate::icp;
use crate::rng::Rng;
use crate::test_world::{drift, surface};

fn outer(v: [f64; 6]) -> [[f64; 6]; 6] {
    let mut m = [[0.0; 6]; 6];
    add_outer(&mut m, &v);
    m
}

fn assert_near(a: &[[f64; 6]; 6], b: &[[f64; 6]; 6], tolerance: f64) {
    let largest = b.iter().flatten().fold(0.0f64, |m, v| m.max(v.abs()));
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        assert!((a - b).abs() <= tolerance * largest, "{a} {b} of {largest}");
    }
}

proptest! {
    /// One motion, told about two points and in two frames.
    #[test]
    fn moves_with_its_point_and_its_frame(
        turn in prop::array::uniform3(-1e-6f64..1e-6),
        shift in prop::array::uniform3(-1e-5f64..1e-5),
        at in prop::array::uniform3(-20.0f64..20.0),
        other in prop::array::uniform3(-20.0f64..20.0),
        frame in prop::array::uniform3(-3.0f64..3.0),
    ) {
        let pose = Pose::from_rotation_vector([0.3, -1.0, 0.5], [4.0, 2.0, -7.0]);
        let (about, point) = (pose.transform(at), pose.transform(other));
        let moved = pose.perturbed(shift, turn, about);
        let own = Covariance { matrix: outer(perturbation(&pose, &moved, at)), about };
        let elsewhere = outer(perturbation(&pose, &moved, other));
        assert_near(&own.about(point).matrix, &elsewhere, 1e-3);
        assert_near(&own.about(point).about(about).matrix, &own.matrix, 1e-9);

        let frame_from_map = Pose::from_rotation_vector(frame, [100.0, -30.0, 5.0]);
        let (pose, moved) = (frame_from_map.compose(&pose), frame_from_map.compose(&moved));
        let there = own.in_frame(&frame_from_map);
        assert_near(&there.matrix, &outer(perturbation(&pose, &moved, at)), 1e-3);
        for (a, b) in there.about.iter().zip(pose.transform(at)) {
            prop_assert!((a - b).abs() < 1e-9);
        }
    }
}

#[test]
fn the_envelope_is_below_neither() {
    let mut rng = Rng::new(3, 3);
    let mut random = || {
        let mut m = [[0.0; 6]; 6];
        for _ in 0..8 {
            add_outer(&mut m, &std::array::from_fn(|_| rng.normal()));
        }
        m
    };
    for _ in 0..20 {
        let (a, b) = (random(), random());
        let larger = envelope(&a, &b);
        for below in [a, b] {
            let rest: [[f64; 6]; 6] =
                std::array::from_fn(|i| std::array::from_fn(|j| larger[i][j] - below[i][j]));
            assert!(eigen(rest).values[0] > -1e-9 * eigen(larger).values[5]);
        }
        assert_near(&envelope(&a, &a), &a, 1e-9);
        assert_near(&envelope(&b, &a), &larger, 1e-9);
    }
}

#[test]
fn the_squared_error_counts_in_its_own_units() {
    let mut matrix = [[0.0; 6]; 6];
    for (i, row) in matrix.iter_mut().enumerate() {
        row[i] = if i < 3 { 0.04 } else { 0.0001 };
    }
    let covariance = Covariance {
        matrix,
        about: [0.0; 3],
    };
    let nees = covariance.nees([0.2, 0.0, -0.4, 0.01, 0.0, 0.0]).unwrap();
    assert!((nees - 6.0).abs() < 1e-9, "{nees}");
    matrix[2][2] = 0.0;
    assert_eq!(
        Covariance {
            matrix,
            about: [0.0; 3]
        }
        .nees([0.0; 6]),
        None
    );
}

/// Errors of fits of one query, drawn so many times, and two covariances of each: by blocks, and as if all points were independent.
fn errors(draws: u64, spoil: &dyn Fn(&mut Rng, &mut Vec<[f64; 3]>)) -> [f64; 2] {
    let map = surface(&drift(240_000, 60.0, 0.3, 0.01, 1), 0.15);
    let icp_config = IcpConfig {
        metric: IcpMetric::PointToPlane,
        ..IcpConfig::default()
    };
    let config = VerifyConfig::default();
    let mut nees = [0.0; 2];
    for draw in 0..draws {
        let mut points = drift(120_000, 60.0, 0.3, 0.01, 100 + draw);
        points.retain(|p| p[0] > 5.0 && p[0] < 55.0);
        spoil(&mut Rng::new(draw, 9), &mut points);
        let query = surface(&points, 0.15);
        let found = icp::align(&map, &query, &Pose::identity(), &icp_config);
        let pose = found.map_from_query;
        let at = query.centroid().unwrap();
        let error = perturbation(&pose, &Pose::identity(), at);
        let blocks = estimate(
            &map,
            &query,
            &pose,
            &[],
            &config,
            // The map and the truth are one world.
            &OdometryConfig {
                map: 0.0,
                ..OdometryConfig::default()
            },
            None,
        )
        .unwrap();
        let distance = config.overlap_distance.metres(map.voxel);
        let told = icp::information(&map, &query, &pose, distance, config.max_points);
        let independent = inverse_hessian(&told);
        for (sum, covariance) in nees.iter_mut().zip([blocks, independent.unwrap()]) {
            *sum += covariance.nees(error).unwrap();
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    nees.map(|sum| sum / draws as f64)
}

#[test]
fn covers_the_errors_of_plain_noise() {
    let [blocks, _] = errors(12, &|_, _| ());
    assert!((1.5..12.0).contains(&blocks), "mean NEES {blocks}");
}

#[test]
fn covers_errors_that_neighbours_share() {
    // Every two metres along the drift are shifted as one, as an odometry would.
    let shifts = |rng: &mut Rng, points: &mut Vec<[f64; 3]>| {
        let of: Vec<[f64; 3]> = (0..30)
            .map(|_| std::array::from_fn(|_| 0.03 * rng.normal()))
            .collect();
        for p in points {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "metres of drift"
            )]
            let shift = of[(p[0] / 2.0) as usize];
            (0..3).for_each(|a| p[a] += shift[a]);
        }
    };
    let [blocks, independent] = errors(12, &shifts);
    assert!((1.5..14.0).contains(&blocks), "mean NEES {blocks}");
    assert!(
        independent > 60.0,
        "mean NEES {independent}, were they independent"
    );
}

#[test]
fn an_open_direction_is_as_wide_as_the_tunnel_is_long() {
    let map = surface(&drift(120_000, 40.0, 0.0, 0.005, 1), 0.15);
    let mut points = drift(60_000, 40.0, 0.0, 0.005, 2);
    points.retain(|p| p[0] > 15.0 && p[0] < 25.0);
    let query = surface(&points, 0.15);
    let config = VerifyConfig::default();
    let pose = Pose::identity();
    let information = icp::information(&map, &query, &pose, 0.2, 0);
    let open: Vec<Unobservable> = directions(&information)
        .into_iter()
        .filter(|d| d.information < config.min_information && d.kind == DirectionKind::Translation)
        .collect();
    assert_eq!(open.len(), 1, "{open:?}");
    let covariance = estimate(
        &map,
        &query,
        &pose,
        &open,
        &config,
        &OdometryConfig::default(),
        None,
    )
    .unwrap();
    let sigma: [f64; 3] = std::array::from_fn(|i| covariance.matrix[i][i].sqrt());
    // It slides by some 15 m to either end.
    assert!(sigma[0] > 4.0 && sigma[0] < 16.0, "{sigma:?}");
    assert!(sigma[1] < 0.05 && sigma[2] < 0.05, "{sigma:?}");
}

#[test]
fn too_little_to_tell_is_told() {
    let map = surface(&drift(60_000, 20.0, 0.3, 0.01, 1), 0.2);
    let config = VerifyConfig::default();
    let away = Pose::from_translation([900.0, 0.0, 0.0]);
    let none = estimate(
        &map,
        &map,
        &away,
        &[],
        &config,
        &OdometryConfig::default(),
        None,
    );
    assert_eq!(none, None);
    assert_eq!(
        estimate(
            &map,
            &Surface::default(),
            &away,
            &[],
            &config,
            &OdometryConfig::default(),
            None,
        ),
        None
    );
}

#[test]
fn the_inverse_hessian_by_hand() {
    let mut matrix = [[0.0; 6]; 6];
    (0..6).for_each(|i| matrix[i][i] = 100.0);
    let mut information = Information {
        matrix,
        about: [1.0, 2.0, 3.0],
        moments: [[0.0; 3]; 3],
        pairs: 300,
        residual_variance: 0.0004,
    };
    let covariance = inverse_hessian(&information).unwrap();
    assert!((covariance.matrix[4][4].sqrt() - 0.002).abs() < 1e-12);
    assert_eq!(covariance.about, [1.0, 2.0, 3.0]);
    information.matrix[0][0] = 0.0;
    assert_eq!(inverse_hessian(&information), None);
}

#[test]
fn displacements_by_hand() {
    // Six sections off by 2 cm in each of two level directions and by 1 mm upright: 12 level and 6 upright, of which three each are the pose's.
    let section = [(2.0 * 4e-4, 2), (1e-6, 1)];
    let close = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-9;
    let apart = variances(&[section; 6]).unwrap();
    assert!(close(apart[0], 12.0 * 4e-4 / 9.0) && close(apart[1], 6e-6 / 3.0));
    // Too few upright ones: one number for both.
    let both = variances(&[section; 4]).unwrap();
    assert!(close(both[0], (8.0 * 4e-4 + 4e-6) / 6.0) && both[0] == both[1]);
    assert_eq!(variances(&[section; 3]), None);
}

#[test]
fn the_map_s_own_error_is_level() {
    let points = drift(20_000, 20.0, 0.3, 0.01, 1);
    let map = surface(&points, 0.2);
    let residuals = Residuals::of(&map, &map, &Pose::identity(), &VerifyConfig::default());
    let odometry = OdometryConfig {
        map: 0.02,
        ..OdometryConfig::default()
    };
    let sigma = residuals.of_map(&odometry).matrix;
    let of = |i: usize| sigma[i][i].sqrt();
    assert!((of(0) - 0.02).abs() < 1e-12 && (of(2) - 0.002).abs() < 1e-12);
    // Root mean square distance from the middle of 20 m of drift: about 6 m.
    assert!((of(5) * 6.0 - 0.02).abs() < 0.002, "{}", of(5));
    assert!((of(3) - 0.1 * of(5)).abs() < 1e-12);
}

#[test]
fn what_is_not_on_the_map_hangs_on_the_rest_by_odometry() {
    let points = |length: f64| -> Vec<[f64; 3]> {
        let at = |i: u32| {
            let a = f64::from(i) * 2.4;
            let x = length * (f64::from(i) + 0.5) / 6_000.0;
            [x, 2.0 * libm::cos(a), 2.0 * libm::sin(a)]
        };
        (0..6_000).map(at).collect()
    };
    let none = OdometryConfig {
        scale: 0.0,
        turn: 0.0,
        turn_walk: 0.0,
        walk: 0.0,
        map: 0.0,
        tilt: 0.0,
    };
    let (all, half, middle) = (points(60.0), points(30.0), [30.0, 0.0, 0.0]);
    // Steps 1 % too long: the middle of the whole is 0.3 m further, that of the half 0.15 m, which is all that the map sees.
    let scale = OdometryConfig {
        scale: 0.01,
        ..none.clone()
    };
    let longer = extrapolate(&all, &half, middle, &scale, 0.0);
    assert!((longer[0][0].sqrt() - 0.15).abs() < 0.003, "{longer:?}");
    assert!(longer[1][1] < 1e-9 && longer[5][5] < 1e-12, "{longer:?}");
    // Headings turn about the vertical: the query is off sideways, and its heading with it; nothing lifts it.
    let turn = OdometryConfig {
        turn: 0.1,
        ..none.clone()
    };
    let turned = extrapolate(&all, &half, middle, &turn, 0.0);
    // By hand, of a thin line: k/2 L² ((1-f)²/4 - f²/12 + 1/12) with f = ½, and k L (1 - f) / 2.
    let k = 0.1f64.to_radians();
    let (off, heading) = (k / 2.0 * 3600.0 * 0.125, k * 60.0 * 0.25);
    assert!(
        (turned[1][1].sqrt() / off - 1.0).abs() < 0.05,
        "{turned:?} {off}"
    );
    assert!(
        (turned[5][5].sqrt() / heading - 1.0).abs() < 0.05,
        "{turned:?} {heading}"
    );
    assert!(turned[2][2] < 1e-9 && turned[4][4] < 1e-12, "{turned:?}");
    // A bend that is seen to leave the middle half a metre off does.
    let seen = extrapolate(&all, &half, middle, &none, 0.5);
    for i in [1, 2] {
        assert!((seen[i][i].sqrt() - 0.5).abs() < 0.01, "{seen:?}");
    }
    let tilting = OdometryConfig {
        tilt: 0.5,
        ..turn.clone()
    };
    let tilted = extrapolate(&all, &half, middle, &tilting, 0.0);
    assert!(
        (tilted[2][2] / turned[1][1] - 0.25).abs() < 0.01,
        "{tilted:?}"
    );
    // What walks goes any way: by the covariance of a walk and of its integral, and what a mean and a fitted line make of them.
    let weights = |length: f64, i: usize| -> (f64, f64) {
        let s = 60.0 * (f64::from(u32::try_from(i).unwrap()) + 0.5) / 300.0;
        let inside = if s < length {
            300.0 * length / 60.0
        } else {
            f64::INFINITY
        };
        let middle = length / 2.0;
        let sloped = (30.0 - middle) * (s - middle) / (length * length / 12.0);
        (s, (1.0 + sloped) / inside)
    };
    let variance = |kernel: &dyn Fn(f64, f64) -> f64| -> f64 {
        let apart = |i: usize| weights(60.0, i).1 - weights(30.0, i).1;
        let pairs = (0..300).flat_map(|i| (0..300).map(move |j| (i, j)));
        pairs
            .map(|(i, j)| apart(i) * apart(j) * kernel(weights(60.0, i).0, weights(60.0, j).0))
            .sum()
    };
    let walk = OdometryConfig {
        walk: 0.01,
        ..none.clone()
    };
    let walked = extrapolate(&all, &half, middle, &walk, 0.0);
    let expected = 1e-4 * variance(&f64::min);
    for i in [1, 2] {
        assert!(
            (walked[i][i] / expected - 1.0).abs() < 0.1,
            "{walked:?} {expected}"
        );
    }
    let wander = OdometryConfig {
        turn_walk: 0.2,
        ..none
    };
    let wandered = extrapolate(&all, &half, middle, &wander, 0.0);
    let integral = |s: f64, t: f64| {
        let (less, more) = (s.min(t), s.max(t));
        less * less * (3.0 * more - less) / 6.0
    };
    let rate = 0.2f64.to_radians();
    let expected = rate * rate * variance(&integral);
    assert!(
        (wandered[1][1] / expected - 1.0).abs() < 0.1,
        "{wandered:?} {expected}"
    );
    let all_of_it = extrapolate(&all, &all, middle, &OdometryConfig::default(), 0.3);
    assert!(all_of_it.iter().flatten().all(|v| v.abs() < 1e-18));
}
