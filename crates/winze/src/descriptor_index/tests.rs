use proptest::prelude::*;

use super::*;
use crate::config::{DescriptorVariant, FpfhConfig, Length};
use crate::fpfh;
use crate::rng::Rng;
use crate::test_world::{drift, surface};

fn index(descriptors: &[Descriptor]) -> DescriptorIndex<'static> {
    let Ok(columns) = build(descriptors, &Memory);
    columns.into_index()
}

fn brute(map: &[Descriptor], query: &Descriptor, k: usize, limit: f32) -> Vec<(f32, u32)> {
    let mut all: Vec<(f32, u32)> = (0u32..)
        .zip(map)
        .filter(|(_, m)| is_usable(m) && is_usable(query))
        .map(|(i, m)| (squared_distance(query, m, f32::INFINITY), i))
        .filter(|(d, _)| *d <= limit && d.is_finite())
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    all.truncate(k);
    all
}

fn check(map: &[Descriptor], query: &[Descriptor], k: usize) {
    let index = index(map);
    let mut found = Vec::new();
    for q in query {
        let expected = brute(map, q, k, f32::INFINITY);
        index.nearest(map, q, k, &mut found);
        assert_eq!(found, expected);
        let Some(last) = expected.last() else {
            continue;
        };
        for limit in [last.0, last.0 * 0.5] {
            index.nearest_within(map, q, k, limit, &mut found);
            assert_eq!(found, brute(map, q, k, limit));
        }
    }
}

/// Whole numbers: distances are exact, ties are many.
fn whole(n: usize, seed: u64, levels: f64) -> Vec<Descriptor> {
    let mut rng = Rng::new(seed, 0);
    (0..n)
        .map(|_| std::array::from_fn(|_| rng.range(0.0, levels).floor() as f32))
        .collect()
}

fn seen(draw: u64, step: usize) -> Vec<Descriptor> {
    let s = surface(&drift(30_000, 15.0, 0.3, 0.01, draw), 0.2);
    let at: Vec<u32> = (0..s.points.len() as u32).step_by(step).collect();
    let config = FpfhConfig {
        radius: Length::Metres(1.0),
        variant: DescriptorVariant::Paper,
        unsigned: false,
    };
    fpfh::descriptors(&s.points, &s.normals, &s.tree, &at, &config, s.voxel)
}

proptest! {
    #[test]
    fn brute_force_on_whole_numbers(seed in 0u64..1000, m in 0usize..900, k in 1usize..6, levels in 1.0..40.0f64, scale in -30i32..15) {
        let scaled = |d: Vec<Descriptor>| -> Vec<Descriptor> {
            d.iter().map(|d| d.map(|v| v * 10f32.powi(scale))).collect()
        };
        check(&scaled(whole(m, seed, levels)), &scaled(whole(20, seed + 1, levels)), k);
    }

    // Some axes far from others in size, far from the origin, and with numbers that overflow.
    #[test]
    fn brute_force_on_odd_scales(seed in 0u64..1000, m in 1usize..400, far in -8i32..8, odd in prop::sample::select(vec![1.0f32, 1e-40, 1e20, 3e38, f32::INFINITY, f32::NAN])) {
        let mut map = whole(m, seed, 9.0);
        let mut rng = Rng::new(seed, 7);
        for d in &mut map {
            for (i, v) in d.iter_mut().enumerate() {
                *v = *v * 0.1f32.powi(i as i32 / 4) + 10f32.powi(far);
            }
            if rng.below(20) == 0 {
                d[rng.below(33) as usize] = odd;
            }
        }
        let query: Vec<Descriptor> = map.iter().step_by(9).map(|d| d.map(|v| v * 1.001)).collect();
        check(&map, &query, 2);
        check(&map, &map[..m.min(20)], 3);
    }

    // What a damaged file may hold: anything. Queries end, and find no index that is none.
    #[test]
    fn damaged_parts_do_no_harm(seed in 0u64..10_000, m in 1usize..400, damage in 1usize..60) {
        let map = whole(m, seed, 9.0);
        let whole_index = index(&map);
        let mut rng = Rng::new(seed, 5);
        let odd = [0.0, -0.0, 1e38, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e-40, -5.0];
        let mut frame = whole_index.frame().to_vec();
        let mut nodes = whole_index.nodes().to_vec();
        let mut blocks = whole_index.blocks().to_vec();
        let mut order = whole_index.order().to_vec();
        for _ in 0..damage {
            let v = odd[rng.below(8) as usize];
            match rng.below(4) {
                0 => frame[rng.below(COORDINATES as u32) as usize][rng.below(33) as usize] = v,
                1 if !nodes.is_empty() => {
                    let node = rng.below(nodes.len() as u32) as usize;
                    nodes[node][rng.below(4) as usize][rng.below(COORDINATES as u32) as usize] = v;
                }
                2 => order[0][0] = rng.below(m as u32),
                _ => {
                    let block = rng.below(blocks.len() as u32) as usize;
                    blocks[block][rng.below(COORDINATES as u32) as usize][rng.below(16) as usize] = v;
                }
            }
        }
        let damaged = DescriptorIndex::from_parts(frame.into(), nodes.into(), blocks.into(), order.into(), m).unwrap();
        let mut found = Vec::new();
        for q in map.iter().take(20) {
            damaged.nearest(&map, q, 3, &mut found);
            prop_assert!(found.len() <= 3 && found.iter().all(|f| (f.1 as usize) < m));
            damaged.nearest(&map[..m / 2], q, 3, &mut found);
        }
    }
}

#[test]
fn brute_force_on_a_drift() {
    let (mut map, query) = (seen(1, 1), seen(2, 23));
    assert!(map.len() > 3000, "{}", map.len());
    map.extend_from_within(..500);
    map[7] = [0.0; DIMENSIONS];
    for k in [1, 2, 7] {
        check(&map, &query, k);
    }
}

#[test]
fn zero_and_broken_descriptors_are_near_nothing() {
    let mut map = whole(40, 1, 9.0);
    map[3] = [0.0; DIMENSIONS];
    map[4][0] = f32::NAN;
    map[5][32] = f32::INFINITY;
    let index = index(&map);
    let mut found = vec![(0.0, 0)];
    index.nearest(&map, &map[0], 50, &mut found);
    assert_eq!(found.len(), 37);
    for broken in 3..6 {
        assert!(found.iter().all(|f| f.1 != broken));
        index.nearest(&map, &map[broken as usize], 50, &mut found);
        assert!(found.is_empty());
        index.nearest(&map, &map[0], 50, &mut found);
    }
    index.nearest(&map, &map[0], 0, &mut found);
    assert!(found.is_empty());
    for none in [Vec::new(), vec![[0.0; DIMENSIONS]; 20]] {
        let index = self::index(&none);
        assert_eq!(index.order().len(), 0);
        index.nearest(&none, &map[0], 5, &mut found);
        assert!(found.is_empty());
        kept_and_read(&index, none.len()).unwrap();
    }
}

fn kept_and_read<'a>(index: &'a DescriptorIndex<'_>, n: usize) -> Option<DescriptorIndex<'a>> {
    DescriptorIndex::from_parts(
        index.frame().into(),
        index.nodes().into(),
        index.blocks().into(),
        index.order().into(),
        n,
    )
}

#[test]
fn parts_must_belong_together() {
    let map = whole(100, 1, 9.0);
    let index = index(&map);
    assert_eq!(kept_and_read(&index, 100).as_ref(), Some(&index));
    assert!(kept_and_read(&index, 99).is_none());
    let mut short = index.clone();
    short.nodes.to_mut().pop();
    assert!(kept_and_read(&short, 100).is_none());
    let mut short = index.clone();
    short.blocks.to_mut().pop();
    assert!(kept_and_read(&short, 100).is_none());
    let mut short = index.clone();
    short.frame.to_mut().pop();
    assert!(kept_and_read(&short, 100).is_none());
    for (leaf, lane, value) in [(0, 0, 100), (0, 3, u32::MAX), (6, 0, u32::MAX), (6, 9, 1)] {
        let mut wrong = index.clone();
        wrong.order.to_mut()[leaf][lane] = value;
        assert!(
            kept_and_read(&wrong, 100).is_none(),
            "{leaf} {lane} {value}"
        );
    }
}

#[test]
fn the_same_bits_at_any_number_of_threads() {
    // More leaves than one thread builds alone.
    let map = whole(40_000, 4, 30.0);
    let on = |n| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n);
        pool.build().unwrap().install(|| index(&map))
    };
    let one = on(1);
    assert_eq!(one, on(4));
    let mut indices: Vec<u32> = one.order().iter().flatten().copied().collect();
    indices.sort_unstable();
    assert!(indices.into_iter().eq(0..40_000));
}
