//! Tests of the tree against brute force and a peer.

use super::*;
use crate::rng::Rng;
use proptest::prelude::*;

fn brute(points: &[[f32; 3]], q: [f32; 3]) -> Vec<Neighbour> {
    let mut all: Vec<Neighbour> = (0u32..)
        .zip(points)
        .map(|(index, p)| Neighbour {
            index,
            distance_squared: squared([p[0] - q[0], p[1] - q[1], p[2] - q[2]]),
        })
        .collect();
    all.sort_by(|a, b| {
        a.distance_squared
            .total_cmp(&b.distance_squared)
            .then(a.index.cmp(&b.index))
    });
    all
}

fn check(points: &[[f32; 3]], q: [f32; 3], k: usize, radius: f32) {
    let tree = KdTree::build(points);
    let expected = brute(points, q);
    assert_eq!(tree.nearest(q), expected.first().copied());
    let mut found = Vec::new();
    tree.knn(q, k, f32::INFINITY, &mut found);
    assert_eq!(found, expected[..k.min(expected.len())]);
    let inside: Vec<Neighbour> = expected
        .iter()
        .copied()
        .filter(|n| n.distance_squared <= radius * radius)
        .collect();
    tree.knn(q, points.len(), radius, &mut found);
    assert_eq!(found, inside);
    found.clear();
    tree.within(q, radius, |index, distance_squared| {
        found.push(Neighbour {
            index,
            distance_squared,
        });
    });
    found.sort_by(|a, b| {
        a.distance_squared
            .total_cmp(&b.distance_squared)
            .then(a.index.cmp(&b.index))
    });
    assert_eq!(found, inside);
    assert_eq!(tree.nearest_within(q, radius), inside.first().copied());
}

fn cloud(n: usize, snap: f32, seed: u64) -> Vec<[f32; 3]> {
    let mut rng = Rng::new(seed, 0);
    (0..n)
        .map(|_| {
            std::array::from_fn(|a| {
                let v = rng.range(-5.0, 5.0) as f32 * [10.0, 1.0, 0.2][a];
                if snap > 0.0 {
                    (v / snap).round() * snap
                } else {
                    v
                }
            })
        })
        .collect()
}

#[test]
fn ordered_bits_are_ordered_as_floats_are() {
    let values = [f32::MIN, -1.5, -1e-40, -0.0, 0.0, 1e-40, 1.0, 1.5, f32::MAX];
    assert!(values.map(ordered).is_sorted());
    for v in values {
        assert_eq!(unordered(ordered(v)).to_bits(), v.to_bits());
    }
}

#[test]
fn empty_single_and_broken() {
    let tree = KdTree::build(&[]);
    assert!(tree.is_empty() && tree.nearest([0.0; 3]).is_none());
    let tree = KdTree::build(&[[f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    assert_eq!(tree.len(), 1);
    assert_eq!(tree.nearest([0.0; 3]).unwrap().index, 1);
    assert!(tree.nearest([f32::NAN, 0.0, 0.0]).is_none());
    assert!(tree.nearest([f32::INFINITY, 0.0, 0.0]).is_none());
    assert!(
        tree.nearest([f32::MAX, 0.0, 0.0]).is_none(),
        "its distance overflows"
    );
    assert!(tree.nearest_within([0.0; 3], 0.5).is_none());
}

#[test]
fn identical_points_are_told_apart_by_index() {
    let points = vec![[1.0, 2.0, 3.0]; 1000];
    let tree = KdTree::build(&points);
    assert_eq!(tree.nearest([1.0, 2.0, 3.0]).unwrap().index, 0);
    let mut found = Vec::new();
    tree.knn([0.0; 3], 7, f32::INFINITY, &mut found);
    assert_eq!(
        found.iter().map(|n| n.index).collect::<Vec<_>>(),
        [0, 1, 2, 3, 4, 5, 6]
    );
}

#[test]
fn the_parallel_build_is_the_serial_build() {
    let points = cloud(100_000, 0.01, 3);
    let pool = |n| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .unwrap()
    };
    let one = pool(1).install(|| KdTree::build(&points));
    assert_eq!(one, pool(4).install(|| KdTree::build(&points)));
}

#[test]
fn agrees_with_kiddo_on_a_tunnel() {
    let points = cloud(20_000, 0.0, 5);
    let tree = KdTree::build(&points);
    let oracle = kiddo::ImmutableKdTree::<f32, 3>::new_from_slice(&points).unwrap();
    for q in cloud(500, 0.0, 6) {
        let theirs = oracle
            .query(&q)
            .nearest_one::<kiddo::SquaredEuclidean<f32>>()
            .execute();
        let ours = tree.nearest(q).unwrap();
        assert!(
            (ours.distance_squared - theirs.distance).abs() <= 1e-6 * theirs.distance.max(1e-3)
        );
    }
}

proptest! {
    #[test]
    fn exact_on_random_clouds(seed in 0u64..10_000, n in 1usize..400, k in 1usize..40, r in 0.05f32..20.0) {
        check(&cloud(n, 0.0, seed), cloud(1, 0.0, seed + 1)[0], k, r);
    }

    #[test]
    fn exact_on_grid_snapped_clouds_full_of_ties(seed in 0u64..10_000, n in 1usize..400, k in 1usize..40, r in 0u8..12) {
        check(&cloud(n, 0.5, seed), cloud(1, 0.5, seed + 1)[0], k, f32::from(r) * 0.5);
    }
}
