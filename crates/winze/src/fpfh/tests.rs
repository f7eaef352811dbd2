use super::pairs::{BATCH, Batch, atan2, bins};
use super::*;
use crate::config::{DescriptorVariant, Length};
use crate::rng::Rng;
use crate::test_world::{drift, surface};

fn config(variant: DescriptorVariant, unsigned: bool) -> FpfhConfig {
    FpfhConfig {
        radius: Length::Metres(1.0),
        variant,
        unsigned,
    }
}

#[test]
fn the_arc_tangent_is_good_to_two_millionths() {
    for i in 0..=10_000 {
        let a = (f64::from(i) / 5_000.0 - 1.0) * std::f64::consts::PI;
        let (y, x) = ((3.0 * a.sin()) as f32, (3.0 * a.cos()) as f32);
        let error = (f64::from(atan2(y, x)) - f64::from(y).atan2(f64::from(x))).abs();
        assert!(
            error.min(std::f64::consts::TAU - error) < 2e-6,
            "{a}: {error:e}"
        );
    }
    assert_eq!(atan2(0.0, 0.0), 0.0);
}

#[test]
fn a_descriptor_does_not_hang_on_what_else_is_described() {
    let s = surface(&drift(60_000, 12.0, 0.3, 0.0, 1), 0.08);
    let n = s.points.len() as u32;
    assert!(n as usize > BLOCK + BLOCK / 4, "{n}");
    let config = FpfhConfig {
        radius: Length::Metres(0.3),
        ..config(DescriptorVariant::Paper, false)
    };
    let at =
        |keypoints: &[u32]| descriptors(&s.points, &s.normals, &s.tree, keypoints, &config, 0.08);
    let all = at(&(0..n).collect::<Vec<_>>());
    assert!(all.iter().filter(|d| **d != [0.0; DIMENSIONS]).count() as u32 > n / 2);
    // One alone, from both ends, and many backwards, one of them twice.
    for k in [0, 1, n / 2, n - 1] {
        assert_eq!(at(&[k])[0], all[k as usize]);
    }
    let some: Vec<u32> = (0..n).rev().step_by(7).chain([5]).collect();
    for (d, k) in at(&some).iter().zip(&some) {
        assert_eq!(*d, all[*k as usize]);
    }
}

#[test]
fn points_that_lie_on_each_other_make_no_broken_descriptor() {
    let points = [
        [0.0; 3],
        [1e-20, 0.0, 0.0],
        [0.3, 0.1, 0.0],
        [0.1, 0.4, 0.0],
    ];
    let tree = KdTree::build(&points);
    for variant in [DescriptorVariant::Pcl, DescriptorVariant::Paper] {
        let normals = [[0.0, 0.0, 1.0]; 4];
        let found = descriptors(
            &points,
            &normals,
            &tree,
            &[0, 1],
            &config(variant, false),
            0.2,
        );
        assert!(found.iter().flatten().all(|v| v.is_finite()), "{found:?}");
    }
}

#[test]
fn points_that_are_nowhere_have_no_descriptor() {
    let points = [[f32::NAN; 3]];
    let tree = KdTree::build(&points);
    let config = config(DescriptorVariant::Paper, false);
    let found = descriptors(&points, &[[0.0, 0.0, 1.0]], &tree, &[0], &config, 0.2);
    assert_eq!(found, [[0.0; DIMENSIONS]]);
}

/// One pair's `[θ, α, φ]`, scaled to `[0, 1]`.
fn pair_angles(p: [f32; 3], n: [f32; 3], q: [f32; 3], m: [f32; 3]) -> Option<[f32; 3]> {
    let mut batch = Batch::default();
    for a in 0..3 {
        batch.line[a][0] = q[a] - p[a];
        batch.normal[a][0] = m[a];
    }
    let found = batch.angles::<false>(n);
    (found.frame[0] > 0.0).then(|| [found.theta[0], found.alpha[0], found.phi[0]])
}

#[test]
fn a_hand_computed_pair() {
    // Both normals up, the second point level with the first: θ = 0, α = 0, φ = 0.
    let level = pair_angles([0.0; 3], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]).unwrap();
    for v in level {
        assert!((v - 0.5).abs() < 1e-6, "{level:?}");
    }
    // The second normal tilted 45° away: the source is the tilted one (closer to the line), so the
    // frame is u = (1,0,1)/√2, d = (−1,0,0), φ = −1/√2; θ is the quarter turn's half, ±45°.
    let s = 0.5f32.sqrt();
    let [theta, alpha, phi] =
        pair_angles([0.0; 3], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [s, 0.0, s]).unwrap();
    assert!((alpha - 0.5).abs() < 1e-6);
    assert!((phi - (1.0 - s) * 0.5).abs() < 1e-6);
    let angle = ((theta - 0.5) * 2.0 * std::f32::consts::PI).abs();
    assert!((angle - std::f32::consts::FRAC_PI_4).abs() < 1e-5);
    // No frame where the line runs along the normal, or without a line.
    assert!(pair_angles([0.0; 3], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]).is_none());
    assert!(pair_angles([0.0; 3], [1.0, 0.0, 0.0], [0.0; 3], [1.0, 0.0, 0.0]).is_none());
}

#[test]
fn bins_are_those_of_the_floor() {
    let frame = [1.0; BATCH];
    for i in 0..=22_000 {
        let unit = i as f32 / 22_000.0;
        let expected = ((unit * BINS as f32).floor() as u32).min(BINS as u32 - 1);
        assert_eq!(bins(&[unit; BATCH], &frame)[0], expected, "{unit}");
    }
    for (unit, bin) in [(-0.1, 0), (1.1, 10), (f32::NAN, 10)] {
        assert_eq!(bins(&[unit; BATCH], &frame)[3], bin, "{unit}");
    }
    assert_eq!(bins(&[0.5; BATCH], &[0.0; BATCH])[3], 15);
}

#[test]
fn unsigned_descriptors_do_not_see_the_signs() {
    let s = surface(&drift(30_000, 10.0, 0.3, 0.0, 1), 0.2);
    let keypoints: Vec<u32> = (0..s.points.len() as u32).step_by(37).collect();
    let mut rng = Rng::new(9, 0);
    let flipped: Vec<[f32; 3]> = s
        .normals
        .iter()
        .map(|n| if rng.below(2) == 0 { n.map(|c| -c) } else { *n })
        .collect();
    let c = config(DescriptorVariant::Pcl, true);
    let a = descriptors(&s.points, &s.normals, &s.tree, &keypoints, &c, s.voxel);
    assert_eq!(
        a,
        descriptors(&s.points, &flipped, &s.tree, &keypoints, &c, s.voxel)
    );
    let signed = config(DescriptorVariant::Pcl, false);
    let b = descriptors(&s.points, &s.normals, &s.tree, &keypoints, &signed, s.voxel);
    assert_ne!(
        b,
        descriptors(&s.points, &flipped, &s.tree, &keypoints, &signed, s.voxel)
    );
}

#[test]
fn nor_do_they_where_floor_and_wall_stand_at_right_angles() {
    let mut points = Vec::new();
    let mut normals = Vec::new();
    for (i, j) in (0..8).flat_map(|i| (0..8).map(move |j| (i, j))) {
        let (a, b) = (0.1 + 0.17 * i as f32, 0.13 * j as f32);
        points.extend([[a, b, 0.0], [0.0, b, a]]);
        normals.extend([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]);
    }
    let tree = KdTree::build(&points);
    let every: Vec<u32> = (0..points.len() as u32).collect();
    let config = config(DescriptorVariant::Paper, true);
    let found = |normals: &[[f32; 3]]| descriptors(&points, normals, &tree, &every, &config, 0.2);
    let turned: Vec<[f32; 3]> = (0..)
        .zip(&normals)
        .map(|(i, n)| if i % 3 == 0 { n.map(|v| -v) } else { *n })
        .collect();
    assert_eq!(found(&normals), found(&turned));
}

#[test]
fn parts_sum_to_a_hundred_and_zero_normals_to_nothing() {
    let mut s = surface(&drift(20_000, 8.0, 0.3, 0.0, 1), 0.2);
    s.normals.to_mut()[5] = [0.0; 3];
    for variant in [DescriptorVariant::Pcl, DescriptorVariant::Paper] {
        let d = descriptors(
            &s.points,
            &s.normals,
            &s.tree,
            &[3, 5, 90],
            &config(variant, false),
            s.voxel,
        );
        assert_eq!(d[1], [0.0; DIMENSIONS]);
        for part in d[0].chunks(BINS).chain(d[2].chunks(BINS)) {
            assert!((part.iter().sum::<f32>() - 100.0).abs() < 1e-3);
        }
    }
    assert!(
        descriptors(
            &[],
            &[],
            &KdTree::build(&[]),
            &[],
            &config(DescriptorVariant::Pcl, false),
            0.1
        )
        .is_empty()
    );
}

#[test]
fn a_turned_cloud_has_the_same_descriptors() {
    let points = drift(30_000, 10.0, 0.3, 0.0, 1);
    let pose = crate::Pose::from_rotation_vector([0.3, -1.0, 0.7], [4.0, 5.0, 6.0]);
    let turned: Vec<[f64; 3]> = points.iter().map(|p| pose.transform(*p)).collect();
    let describe = |p: &[[f64; 3]]| {
        let p: Vec<[f32; 3]> = p.iter().step_by(4).map(|p| p.map(|v| v as f32)).collect();
        let tree = KdTree::build(&p);
        let mut n = crate::normals::estimate(
            &p,
            &tree,
            crate::normals::Neighbourhood {
                radius: 0.6,
                least: 0,
                most: 0,
            },
        );
        crate::normals::orient_open_side(&p, &mut n, &tree, 4.0);
        descriptors(
            &p,
            &n,
            &tree,
            &[10, 200, 3000],
            &config(DescriptorVariant::Paper, false),
            0.1,
        )
    };
    for (a, b) in describe(&points).iter().zip(describe(&turned)) {
        let l1: f32 = a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum();
        assert!(l1 < 6.0, "{l1} of 300");
    }
}
