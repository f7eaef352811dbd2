//! The neighbour tree beside kiddo's immutable one: a million points on a bent tunnel with a flat
//! floor, ten thousand queries near the walls, one thread.
//!
//! ```sh
//! cargo bench -p winze --bench neighbours
//! ```

#![allow(missing_docs, clippy::unwrap_used, reason = "a benchmark")]

use std::num::NonZero;
use std::sync::LazyLock;

use divan::{Bencher, black_box};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use winze::kdtree::KdTree;
use winze::rng::Rng;

const POINTS: usize = 1_000_000;
const QUERIES: usize = 10_000;
const RADIUS: f32 = 0.25;
const K: usize = 20;

static CLOUD: LazyLock<Vec<[f32; 3]>> = LazyLock::new(|| tunnel(POINTS, 0.0, 1));
static NEAR: LazyLock<Vec<[f32; 3]>> = LazyLock::new(|| tunnel(QUERIES, 0.05, 2));
static OURS: LazyLock<KdTree<'static>> = LazyLock::new(|| KdTree::build(&CLOUD));
static KIDDO: LazyLock<ImmutableKdTree<f32, 3>> =
    LazyLock::new(|| ImmutableKdTree::new_from_slice(&CLOUD).unwrap());

/// Points on a bent tunnel of 400 m, 2.5 m radius, its floor at -1.5 m.
fn tunnel(n: usize, noise: f64, seed: u64) -> Vec<[f32; 3]> {
    let mut rng = Rng::new(seed, 0);
    (0..n)
        .map(|_| {
            let (s, a) = (rng.range(0.0, 400.0), rng.range(0.0, std::f64::consts::TAU));
            let r = 2.5 + 0.1 * (3.0 * s).sin() * (5.0 * a).cos() + noise * rng.normal();
            let z = (r * a.sin()).max(-1.5 + 0.02 * rng.normal());
            let y = r * a.cos() + 30.0 * (s / 80.0).sin();
            [s as f32, y as f32, z as f32]
        })
        .collect()
}

fn main() {
    divan::main();
}

#[divan::bench(name = "build: winze")]
fn build_winze(bencher: Bencher<'_, '_>) {
    bencher.bench(|| KdTree::build(black_box(&CLOUD)));
}

#[divan::bench(name = "build: kiddo")]
fn build_kiddo(bencher: Bencher<'_, '_>) {
    bencher.bench(|| ImmutableKdTree::<f32, 3>::new_from_slice(black_box(&CLOUD)).unwrap());
}

#[divan::bench(name = "nearest: winze")]
fn nearest_winze(bencher: Bencher<'_, '_>) {
    let tree = &*OURS;
    bencher.bench(|| {
        NEAR.iter()
            .map(|q| tree.nearest(*q).unwrap().distance_squared)
            .sum::<f32>()
    });
}

#[divan::bench(name = "nearest: kiddo")]
fn nearest_kiddo(bencher: Bencher<'_, '_>) {
    let tree = &*KIDDO;
    bencher.bench(|| {
        NEAR.iter()
            .map(|q| {
                tree.query(q)
                    .nearest_one::<SquaredEuclidean<f32>>()
                    .execute()
                    .distance
            })
            .sum::<f32>()
    });
}

#[divan::bench(name = "20 nearest: winze")]
fn knn_winze(bencher: Bencher<'_, '_>) {
    let tree = &*OURS;
    bencher.bench(|| {
        let mut found = Vec::with_capacity(K);
        let mut sum = 0.0;
        for q in NEAR.iter() {
            tree.knn(*q, K, f32::INFINITY, &mut found);
            sum += found.last().unwrap().distance_squared;
        }
        sum
    });
}

#[divan::bench(name = "20 nearest: kiddo")]
fn knn_kiddo(bencher: Bencher<'_, '_>) {
    let tree = &*KIDDO;
    let k = NonZero::new(K).unwrap();
    bencher.bench(|| {
        NEAR.iter()
            .map(|q| {
                let found = tree
                    .query(q)
                    .nearest_n::<SquaredEuclidean<f32>>(k)
                    .execute();
                found.last().unwrap().distance
            })
            .sum::<f32>()
    });
}

#[divan::bench(name = "within 0.25 m: winze")]
fn within_winze(bencher: Bencher<'_, '_>) {
    let tree = &*OURS;
    bencher.bench(|| {
        let mut sum = 0.0;
        for q in NEAR.iter() {
            tree.within(*q, RADIUS, |_, d| sum += d);
        }
        sum
    });
}

#[divan::bench(name = "within 0.25 m: kiddo")]
fn within_kiddo(bencher: Bencher<'_, '_>) {
    let tree = &*KIDDO;
    bencher.bench(|| {
        NEAR.iter()
            .map(|q| {
                let found = tree
                    .query(q)
                    .within::<SquaredEuclidean<f32>>(RADIUS * RADIUS)
                    .unsorted()
                    .execute();
                found.iter().map(|n| n.distance).sum::<f32>()
            })
            .sum::<f32>()
    });
}
