use super::*;
use crate::rng::Rng;

fn cloud(points: &[[f64; 3]]) -> Cloud {
    Cloud::from_points(points).unwrap().0
}

#[test]
fn centroids_of_a_hand_made_cloud() {
    let c = cloud(&[
        [0.1, 0.1, 0.1],
        [0.3, 0.1, 0.1],
        [1.1, 0.0, 0.0],
        [-0.1, 0.0, 0.0],
    ]);
    let d = downsample(&c, 1.0);
    assert_eq!(d.len(), 3);
    let expected = [[-0.1f32, 0.0, 0.0], [0.2, 0.1, 0.1], [1.1, 0.0, 0.0]];
    for (a, b) in d.points().iter().zip(&expected) {
        for i in 0..3 {
            assert!((a[i] - b[i]).abs() < 1e-6);
        }
    }
}

#[test]
fn density_does_not_matter() {
    let mut rng = Rng::new(1, 0);
    let mut plane = |n: usize| {
        let p: Vec<[f64; 3]> = (0..n)
            .map(|_| [rng.range(0.0, 10.0), rng.range(0.0, 10.0), 0.05])
            .collect();
        downsample(&cloud(&p), 0.5).len()
    };
    assert_eq!((plane(200_000), plane(20_000)), (400, 400));
}

#[test]
fn no_extent_or_voxel_size_makes_keys_collide() {
    // 30 km at a tenth of a millimetre: 3e8 cells an axis, 2.7e25 in all.
    let points: Vec<[f64; 3]> = (0..100).map(|i| [f64::from(i) * 150.0; 3]).collect();
    assert_eq!(downsample(&cloud(&points), 1e-4).len(), 100);
    assert_eq!(downsample(&cloud(&points), 1e-300).len(), 100);
    assert_eq!(downsample(&cloud(&points), 1e300).len(), 1);
    assert_eq!(downsample(&cloud(&points), 0.0).len(), 100);
    assert_eq!(downsample(&cloud(&points), f64::NAN).len(), 100);
}

#[test]
fn cells_do_not_hang_on_the_origin_or_on_a_stray_point() {
    let mut rng = Rng::new(2, 0);
    let mut points: Vec<[f64; 3]> = (0..5000)
        .map(|_| std::array::from_fn(|_| rng.range(0.0, 20.0)))
        .collect();
    let before = downsample(&cloud(&points), 0.5);
    points.push([-700.3, 0.0, 0.0]);
    let after = downsample(&cloud(&points), 0.5);
    assert_eq!(after.len(), before.len() + 1);
    assert!(before.points().iter().all(|p| after.points().contains(p)));
}

#[test]
fn buckets_tables_and_groups_give_the_same_bits() {
    let mut rng = Rng::new(4, 0);
    // The last are several chunks.
    for (half, origin, count) in [
        (3.0, [0.0; 3], 60_000),
        (40.0, [4.3e5, -4.5e6, 312.0], 60_000),
        (400.0, [0.0; 3], 60_000),
        (10.0, [0.0; 3], 300_000),
    ] {
        let points: Vec<[f64; 3]> = (0..count)
            .map(|_| std::array::from_fn(|a| origin[a] + rng.range(-half, half)))
            .collect();
        let intensity: Vec<f32> = (0..count).map(|i| (i % 251) as f32 * 0.1).collect();
        let (c, _) = Cloud::with_intensity(&points, Some(&intensity)).unwrap();
        for voxel in [0.01, 0.2, 0.7, 5.0, 1e4] {
            let lattice = Lattice::of(&c, voxel).unwrap();
            let expected = by_group(&c, voxel);
            assert_eq!(by_bucket(&c, &lattice), expected, "{half} {voxel}");
            assert_eq!(downsample(&c, voxel), expected);
        }
    }
}

#[test]
fn the_same_bits_at_any_thread_count() {
    let mut rng = Rng::new(3, 0);
    let points: Vec<[f64; 3]> = (0..300_000)
        .map(|_| std::array::from_fn(|_| rng.range(0.0, 20.0)))
        .collect();
    let c = cloud(&points);
    let run = |n| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .unwrap();
        pool.install(|| downsample(&c, 0.3))
    };
    assert_eq!(run(1), run(5));
}

#[test]
fn intensities_are_averaged() {
    let (c, _) =
        Cloud::with_intensity(&[[0.1; 3], [0.2; 3], [5.0; 3]], Some(&[1.0, 3.0, 7.0])).unwrap();
    assert_eq!(downsample(&c, 1.0).intensity(), Some(&[2.0, 7.0][..]));
}
