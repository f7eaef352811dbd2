//! The descriptor index beside brute force, one thread: FPFHs of rough drifts, of which queries are
//! seen again with other points. Maps beyond what the drifts give hold noisy copies.
//!
//! ```sh
//! cargo bench -p winze --bench descriptors
//! ```

#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use std::collections::BTreeMap;
use std::sync::{LazyLock, Mutex};

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use winze::columns::Memory;
use winze::config::Config;
use winze::descriptor_index::{DescriptorIndex, build};
use winze::fpfh::{self, DIMENSIONS, Descriptor};
use winze::rng::Rng;
use winze::{Cloud, prepare};

const SIZES: [usize; 5] = [1_000, 3_000, 10_000, 100_000, 1_000_000];
const QUERIES: usize = 1024;
const DRIFTS: u64 = 8;
const VOXEL: f64 = 0.15;

fn main() {
    divan::main();
}

/// FPFHs at every `step`th prepared point of a drift 60 m long; `draw` picks other points of it.
fn describe(world: u64, draw: u64, step: usize) -> Vec<Descriptor> {
    let mut rng = Rng::new(world, 0);
    let bumps: Vec<[f64; 4]> = (0..24)
        .map(|i| {
            let k = std::f64::consts::TAU / (6.0 * 0.85f64.powi(i));
            let along = rng.range(-1.0, 1.0);
            let around = (2.0 * k * (1.0 - along * along).sqrt()).round();
            [k * along, around, rng.range(0.0, 6.0), 0.85f64.powi(i)]
        })
        .collect();
    let total: f64 = bumps.iter().map(|b| b[3]).sum();
    let mut rng = Rng::new(draw, 1);
    let points: Vec<[f64; 3]> = (0..200_000)
        .map(|_| {
            let (x, a) = (rng.range(0.0, 60.0), rng.range(0.0, std::f64::consts::TAU));
            let bump: f64 = bumps
                .iter()
                .map(|b| b[3] * (b[0] * x + b[1] * a + b[2]).sin())
                .sum();
            let r = 2.0 + 1.2 * bump / total + 0.01 * rng.normal();
            [x, r * a.cos(), 0.8 * r * a.sin()]
        })
        .collect();
    let (cloud, _) = Cloud::from_points(&points).unwrap();
    let config = Config::default();
    let s = prepare::prepare(&cloud, &config.prepare, VOXEL);
    let at: Vec<u32> = (0u32..).take(s.points.len()).step_by(step).collect();
    fpfh::descriptors(&s.points, &s.normals, &s.tree, &at, &config.fpfh, s.voxel)
}

static SEEN: LazyLock<Vec<Descriptor>> =
    LazyLock::new(|| (0..DRIFTS).flat_map(|w| describe(w, 1, 1)).collect());

static QUERY: LazyLock<Vec<Descriptor>> = LazyLock::new(|| {
    let all: Vec<Descriptor> = (0..DRIFTS).flat_map(|w| describe(w, 2, 7)).collect();
    let step = all.len() / QUERIES;
    all.into_iter().step_by(step).take(QUERIES).collect()
});

/// `n` descriptors, each part summing to 100 again after the noise.
fn map(n: usize) -> Vec<Descriptor> {
    let seen = &*SEEN;
    let mut rng = Rng::new(3, 0);
    (0..n)
        .map(|i| {
            if n <= seen.len() {
                return seen[i * seen.len() / n];
            }
            let mut d = seen[i % seen.len()];
            if i < seen.len() {
                return d;
            }
            for v in &mut d {
                *v = (*v + 0.5 * v.sqrt() * rng.normal() as f32).max(0.0);
            }
            for part in d.chunks_exact_mut(DIMENSIONS / 3) {
                let scale = 100.0 / part.iter().sum::<f32>().max(1e-3);
                part.iter_mut().for_each(|v| *v *= scale);
            }
            d
        })
        .collect()
}

type Kept = &'static (Vec<Descriptor>, DescriptorIndex<'static>);

fn world(n: usize) -> Kept {
    static KEPT: Mutex<BTreeMap<usize, Kept>> = Mutex::new(BTreeMap::new());
    let mut kept = KEPT.lock().unwrap();
    kept.entry(n).or_insert_with(|| {
        let map = map(n);
        let Ok(index) = build(&map, &Memory);
        Box::leak(Box::new((map, index.into_index())))
    })
}

fn one_thread<R: Send>(f: impl FnOnce() -> R + Send) -> R {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.build().unwrap().install(f)
}

#[divan::bench(name = "build", args = SIZES, max_time = 10)]
fn build_index(bencher: Bencher<'_, '_>, n: usize) {
    let (map, _) = world(n);
    bencher.counter(ItemsCount::new(n)).bench(|| {
        one_thread(|| {
            let Ok(index) = build(black_box(map), &Memory);
            index.view().order().len()
        })
    });
}

#[divan::bench(name = "nearest: index", args = SIZES, consts = [1, 2], max_time = 10)]
fn nearest_index<const K: usize>(bencher: Bencher<'_, '_>, n: usize) {
    let (map, index) = world(n);
    let mut found = Vec::new();
    let query = &*QUERY;
    bencher
        .counter(ItemsCount::new(query.len()))
        .bench_local(|| {
            let mut sum = 0.0;
            for q in query {
                index.nearest(map, black_box(q), K, &mut found);
                sum += found[0].0;
            }
            sum
        });
}

#[divan::bench(name = "nearest: brute force", args = SIZES, max_time = 10)]
fn nearest_brute(bencher: Bencher<'_, '_>, n: usize) {
    let groups = groups(&world(n).0);
    let query = &*QUERY;
    bencher
        .counter(ItemsCount::new(query.len()))
        .bench(|| brute(black_box(query), &groups));
}

const LANES: usize = 16;
type Group = [[f32; LANES]; DIMENSIONS];

/// Sixteen descriptors side by side, a row a dimension.
fn groups(map: &[Descriptor]) -> Vec<Group> {
    let lane =
        |chunk: &[Descriptor], d: usize, l: usize| chunk.get(l).map_or(f32::INFINITY, |r| r[d]);
    map.chunks(LANES)
        .map(|chunk| std::array::from_fn(|d| std::array::from_fn(|l| lane(chunk, d, l))))
        .collect()
}

/// The nearest one of each, group by group, so that the query stays in cache.
fn brute(query: &[Descriptor], groups: &[Group]) -> Vec<(f32, usize)> {
    let mut best = vec![(f32::INFINITY, usize::MAX); query.len()];
    for (g, group) in groups.iter().enumerate() {
        for (q, best) in query.iter().zip(&mut best) {
            let mut sums = [0.0f32; LANES];
            for (x, lane) in q.iter().zip(group) {
                for l in 0..LANES {
                    let d = lane[l] - x;
                    sums[l] += d * d;
                }
            }
            if sums.iter().fold(false, |any, s| any | (*s < best.0)) {
                for (l, s) in sums.iter().enumerate() {
                    if *s < best.0 {
                        *best = (*s, g * LANES + l);
                    }
                }
            }
        }
    }
    best
}
