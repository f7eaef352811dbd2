use super::nearest::threshold;
use super::*;
use crate::test_world::{drift, surface};

#[test]
fn a_group_finds_what_each_of_its_points_would() {
    let s = surface(&drift(20_000, 12.0, 0.3, 0.0, 1), 0.2);
    let mut near = Neighbours::default();
    for radius in [0.05, 0.5, 1.3] {
        // Neighbours in memory, then points from all over the place.
        for step in [1, 97] {
            let group: Vec<[f32; 3]> = s
                .points
                .iter()
                .skip(500)
                .step_by(step)
                .take(GROUP)
                .copied()
                .collect();
            let mut left = 0..group.len();
            while !left.is_empty() {
                let together = near.gather(&s.tree, radius, left.clone(), |k| group[k]);
                left.start = together.end;
                for p in &group[together] {
                    let mut expected = Vec::new();
                    s.tree.within(*p, radius, |index, distance_squared| {
                        expected.push(Neighbour {
                            index,
                            distance_squared,
                        });
                    });
                    expected.sort_unstable_by_key(|n| n.index);
                    assert_eq!(near.of(&s.tree, *p), expected);
                }
            }
        }
    }
}

#[test]
fn the_nearest_of_a_group_are_those_of_the_tree() {
    let s = surface(&drift(20_000, 12.0, 0.3, 0.0, 1), 0.2);
    let mut near = Neighbours::default();
    let mut expected = Vec::new();
    // Neighbours in memory, then points from all over the place, then a few of one place.
    let neighbours = s.points.chunks(GROUP).step_by(40).map(<[_]>::to_vec);
    let scattered: Vec<[f32; 3]> = s.points.iter().step_by(97).copied().collect();
    let same = vec![s.points[7]; 3];
    for group in neighbours.chain([scattered, same]) {
        let together = near.gather(&s.tree, 0.6, 0..group.len(), |k| group[k]);
        for p in &group[together] {
            for count in [1, 9, 20] {
                s.tree.knn(*p, count, f32::INFINITY, &mut expected);
                expected.retain(|n| n.distance_squared <= 0.6 * 0.6);
                let found = near.distance_sum_of_nearest(*p, count, 0.1);
                let moments = near.moments_of_nearest(*p, count, 0.1);
                if found.is_none() || moments.is_none() {
                    assert!(expected.len() < count && found.is_none() && moments.is_none());
                    continue;
                }
                let sum: f64 = expected
                    .iter()
                    .map(|n| f64::from(n.distance_squared).sqrt())
                    .sum();
                let (found, limit) = found.unwrap();
                assert!((found - sum).abs() <= 1e-6 * sum);
                assert!(expected.iter().all(|n| n.distance_squared <= limit));
                check(&moments.unwrap().0, &s.points, *p, &expected);
            }
            let expected: Vec<Neighbour> = near.of(&s.tree, *p).to_vec();
            let out = |n: &Neighbour| {
                let q = s.points[n.index as usize];
                f64::from(0.6 * (q[0] - p[0]) + 0.8 * (q[2] - p[2])).clamp(-0.2, 0.2)
            };
            let balance: f64 = expected.iter().map(out).sum();
            let found = f64::from(near.balance(*p, [0.6, 0.0, 0.8], 0.2));
            assert!((found - balance).abs() < 1e-5 * (1.0 + expected.len() as f64));
            check(&near.moments_within(*p), &s.points, *p, &expected);
        }
    }
    let first = s.points[0];
    assert!(near.distance_sum_of_nearest(first, 0, 0.1).is_none());
    near.gather_up_to(100, &s.tree, 1e3, 0..1, |_| first);
    assert!(near.distance_sum_of_nearest(first, 9, 0.1).is_none());
    assert!(near.places.len() <= 100);
    near.gather(&s.tree, 1e3, 0..1, |_| first);
    assert!(near.distance_sum_of_nearest(first, 9, 0.1).is_some());
}

/// Against sums in 64 bits.
fn check(moments: &Moments, points: &[[f32; 3]], p: [f32; 3], neighbours: &[Neighbour]) {
    assert_eq!(moments.count as usize, neighbours.len());
    let (mut sum, mut square) = ([0.0f64; 3], [0.0f64; 6]);
    for n in neighbours {
        let q = points[n.index as usize];
        let d: [f64; 3] = std::array::from_fn(|a| f64::from(q[a] - p[a]));
        let products = [
            d[0] * d[0],
            d[0] * d[1],
            d[0] * d[2],
            d[1] * d[1],
            d[1] * d[2],
            d[2] * d[2],
        ];
        sum.iter_mut().zip(d).for_each(|(s, d)| *s += d);
        square.iter_mut().zip(products).for_each(|(s, d)| *s += d);
    }
    let scale = 1e-6 * (1.0 + square[0] + square[3] + square[5]);
    for (a, b) in moments.sum.iter().zip(sum) {
        assert!((a - b).abs() < 10.0 * scale, "{a} {b}");
    }
    for (a, b) in moments.square.iter().zip(square) {
        assert!((a - b).abs() < scale, "{a} {b}");
    }
}

#[test]
fn numbers_that_occur_twice_have_no_threshold_between_them() {
    let squared: Vec<f32> = (0..64).map(|i| (i / 4) as f32).collect();
    for count in 1..=64 {
        let found = dispatch!(level(), simd => threshold(simd, &squared, (20.0, 64), count, 9.0));
        match found {
            Some(limit) => {
                let within = squared.iter().filter(|d| **d <= limit).count();
                assert_eq!(within, count);
            }
            None => assert_ne!(count % 4, 0),
        }
    }
}

#[test]
fn an_empty_tree_has_no_neighbours() {
    let tree = KdTree::build(&[]);
    let mut near = Neighbours::default();
    near.gather(&tree, 1.0, 0..1, |_| [0.0; 3]);
    assert!(near.of(&tree, [0.0; 3]).is_empty());
}
