use winze::vec3::distance;

use super::*;

const TOLERANCE: Tolerance = Tolerance {
    translation: 0.5,
    rotation: 0.0873,
};

/// A square tube along x from 0 to `length`, 4 m wide and high, that `bumps` tell apart: its walls
/// swell by `bumps(x)` metres. With ends where `capped`.
fn tube(length: f64, y: f64, capped: bool, bumps: impl Fn(f64) -> f64) -> Vec<Witness> {
    let mut out = Vec::new();
    let mut add = |point: [f64; 3], normal: [f64; 3]| {
        out.push(Witness {
            point: [point[0], point[1] + y, point[2]],
            normal,
            sigma: 0.01,
            new: false,
        });
    };
    let steps = (length / 0.1) as i32;
    for i in 0..=steps {
        let x = f64::from(i) * 0.1;
        let half = 2.0 + bumps(x);
        let slope = (bumps(x + 1e-4) - bumps(x - 1e-4)) / 2e-4;
        let steep = (1.0 + slope * slope).sqrt();
        let wall = |side: f64| [slope / steep, side / steep, 0.0];
        for k in 0..40 {
            let v = -2.0 + 0.1 * f64::from(k) + 0.05;
            add([x, -half, v], wall(1.0));
            add([x, half, v], wall(-1.0));
            add([x, v, -2.0], [0.0, 0.0, 1.0]);
            add([x, v, 2.0], [0.0, 0.0, -1.0]);
        }
    }
    if capped {
        for (x, n) in [(0.0, 1.0), (length, -1.0)] {
            for i in 0..40 {
                for k in 0..40 {
                    let at = |v: i32| -1.95 + 0.1 * f64::from(v);
                    add([x, at(i), at(k)], [n, 0.0, 0.0]);
                }
            }
        }
    }
    out
}

/// Labels of what was seen from the middle line of a tube.
fn labels_of(map: &MappedSurface, witnesses: &[Witness]) -> Labels {
    let xs = || witnesses.iter().map(|w| w.point[0]);
    let (low, high) = (xs().fold(f64::MAX, f64::min), xs().fold(f64::MIN, f64::max));
    let stands: Vec<[f64; 3]> = (0..=10)
        .map(|i| [low + 0.1 * f64::from(i) * (high - low), 0.0, 0.0])
        .collect();
    let query = Seen {
        witnesses,
        stands: &stands,
    };
    label(map, query, TOLERANCE, 1)
}

fn places(length: f64, y: f64) -> Vec<[f64; 3]> {
    (1..(length / 0.5) as i32)
        .map(|i| [0.5 * f64::from(i), y, 0.0])
        .collect()
}

fn between(all: &[Witness], low: f64, high: f64) -> Vec<Witness> {
    all.iter()
        .filter(|w| w.point[0] >= low && w.point[0] <= high)
        .copied()
        .collect()
}

/// Bumps of a size and place that do not repeat.
fn odd(x: f64) -> f64 {
    0.3 * libm::sin(x) + 0.25 * libm::sin(0.53 * x * x.sqrt() + 1.0)
}

#[test]
fn a_bare_tube_leaves_the_way_along_it_open() {
    let all = tube(40.0, 0.0, false, |_| 0.0);
    let map = MappedSurface::new(&all, &places(40.0, 0.0));
    let labels = labels_of(&map, &between(&all, 15.0, 25.0));
    assert!(labels.overlap > 0.999);
    assert_eq!(labels.unobservable.len(), 1, "{labels:?}");
    assert!(!labels.unobservable[0].rotation);
    assert!(labels.unobservable[0].direction[0].abs() > 0.999);
    // Along it is one place; turned by 180 degrees it is another.
    assert!(
        labels.alternatives.iter().all(|p| p.angle() > 3.0),
        "{labels:?}"
    );
}

#[test]
fn a_like_stretch_further_along_an_open_drift_is_another_place() {
    // Bare but for a swelling in the middle: the query is open where it was, and cannot slide past that.
    let all = tube(60.0, 0.0, false, |x| {
        0.6 * libm::exp(-(x - 30.0) * (x - 30.0) / 4.0)
    });
    let map = MappedSurface::new(&all, &places(60.0, 0.0));
    let labels = labels_of(&map, &between(&all, 8.0, 18.0));
    assert_eq!(labels.unobservable.len(), 1, "{labels:?}");
    let beyond = |p: &Pose| p.angle() < 0.1 && p.translation()[0] > 25.0;
    assert!(labels.alternatives.iter().any(beyond), "{labels:?}");
    let beside = |p: &Pose| p.angle() < 0.1 && p.translation()[0].abs() < 8.0;
    assert!(!labels.alternatives.iter().any(beside), "{labels:?}");
}

#[test]
fn relief_tells_where() {
    let all = tube(40.0, 0.0, true, odd);
    let map = MappedSurface::new(&all, &places(40.0, 0.0));
    let labels = labels_of(&map, &between(&all, 12.0, 24.0));
    assert!(labels.unobservable.is_empty(), "{labels:?}");
    assert!(labels.alternatives.is_empty(), "{labels:?}");
}

#[test]
fn a_twin_is_found_and_a_lookalike_is_not() {
    let mut all = tube(30.0, 0.0, true, odd);
    let query = between(&all, 8.0, 20.0);
    all.extend(tube(30.0, 30.0, true, odd));
    let mut spots = places(30.0, 0.0);
    spots.extend(places(30.0, 30.0));
    let map = MappedSurface::new(&all, &spots);
    let labels = labels_of(&map, &query);
    assert_eq!(labels.alternatives.len(), 1, "{labels:?}");
    let t = labels.alternatives[0].translation();
    assert!(distance(t, [0.0, 30.0, 0.0]) < 0.05, "{t:?}");
    // The same plan with other relief: a person might be fooled, the surface is not.
    let mut other = tube(30.0, 0.0, true, odd);
    other.extend(tube(30.0, 30.0, true, |x| {
        odd(x) + 0.15 * libm::sin(2.3 * x)
    }));
    let map = MappedSurface::new(&other, &spots);
    assert!(labels_of(&map, &query).alternatives.is_empty());
}

#[test]
fn a_rival_of_a_long_drive_that_holds_its_ends_but_not_its_middle_is_found() {
    let drift = tube(60.0, 0.0, false, odd);
    let query = between(&drift, 4.0, 56.0);
    let twin = tube(60.0, 30.0, false, odd);
    let mapped = [
        between(&drift, 0.0, 20.0),
        between(&drift, 28.0, 40.0),
        between(&twin, 0.0, 20.0),
        between(&twin, 40.0, 52.0),
    ];
    let mut spots = places(60.0, 0.0);
    spots.extend(places(60.0, 30.0));
    let map = MappedSurface::new(&mapped.concat(), &spots);
    let labels = labels_of(&map, &query);
    assert_eq!(labels.alternatives.len(), 1, "{labels:?}");
    let t = labels.alternatives[0].translation();
    assert!(distance(t, [0.0, 30.0, 0.0]) < 0.05, "{t:?}");
}

#[test]
fn overlap_counts_mapped_surface_and_leaves_new_things_aside() {
    let all = tube(40.0, 0.0, false, odd);
    let map = MappedSurface::new(&between(&all, 0.0, 20.0), &places(20.0, 0.0));
    let mut query = between(&all, 10.0, 30.0);
    let labels = labels_of(&map, &query);
    assert!((labels.overlap - 0.51).abs() < 0.02, "{}", labels.overlap);
    query.extend(
        tube(10.0, 1.0, false, |_| -1.5)
            .into_iter()
            .map(|w| Witness { new: true, ..w }),
    );
    assert_eq!(labels_of(&map, &query).overlap, labels.overlap);
}

#[test]
fn what_lies_beside_other_walls_is_no_rival_at_little_overlap() {
    // Four tenths of the query are mapped; two other drifts of like size have other relief.
    let mut all = between(&tube(40.0, 0.0, true, odd), 0.0, 16.0);
    let query = between(&tube(40.0, 0.0, true, odd), 9.6, 25.6);
    let mut spots = places(16.0, 0.0);
    for (y, shift) in [(30.0, 3.0), (60.0, 7.0)] {
        all.extend(tube(40.0, y, true, |x| odd(x + shift)));
        spots.extend(places(40.0, y));
    }
    let map = MappedSurface::new(&all, &spots);
    let labels = labels_of(&map, &query);
    assert!((labels.overlap - 0.41).abs() < 0.03, "{}", labels.overlap);
    assert!(labels.alternatives.is_empty(), "{labels:?}");
    assert!(labels.unobservable.is_empty(), "{labels:?}");
}

#[test]
fn nothing_in_nothing_out() {
    let map = MappedSurface::new(&[], &[]);
    let labels = labels_of(&map, &[]);
    assert_eq!(labels.overlap, 0.0);
    assert!(labels.alternatives.is_empty() && labels.unobservable.is_empty());
    assert!(map.is_empty());
}
