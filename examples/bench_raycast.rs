//! Rays a second in a large cave, beside another library's.
//!
//! Spins of 32 beams × 1024 shots from eight places of the cave, one thread. obvhs follows rays in `f32`
//! through its compressed eight-wide tree; winze's caster measures in `f64`, watertight. Prints a table.
//! Needs the worlds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example bench_raycast
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::time::{Duration, Instant};

use common::{Result, data, folder_exists, quantile};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::builder::build_cwbvh_from_tris;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::triangle::Triangle;
use winze_sim::free_space::{FreeSpace, Robot};
use winze_sim::mesh_file::read_mesh;
use winze_sim::raycast::Caster;

/// Furthest hit, metres.
const RANGE: f64 = 120.0;
/// Runs of each; the medians are printed.
const RUNS: usize = 5;

fn main() -> Result<()> {
    folder_exists("worlds")?;
    let (mesh, _) = read_mesh(&data().join("worlds/cave_01.ply"))?;
    let triangles: Vec<Triangle> = (0..mesh.triangles().len())
        .filter_map(|i| mesh.corners(i))
        .map(|[a, b, c]| Triangle {
            v0: a.into(),
            v1: b.into(),
            v2: c.into(),
        })
        .collect();
    let count = triangles.len();
    let (mut ours, mut theirs) = (Runs::default(), Runs::default());
    let caster = Caster::new(mesh.clone())?;
    let free = FreeSpace::measure(
        &caster,
        &Robot {
            radius: 0.5,
            height: 0.8,
        },
    )?;
    let rays = rays(&free);
    for _ in 0..RUNS {
        let begun = Instant::now();
        let caster = Caster::new(mesh.clone())?;
        ours.build.push(begun.elapsed().as_secs_f64());
        let begun = Instant::now();
        let tree = build_cwbvh_from_tris(
            &triangles,
            BvhBuildParams::medium_build(),
            &mut Duration::default(),
        );
        // In the order of the tree, ready to be hit.
        let ready: Vec<RtTriangle> = tree
            .primitive_indices
            .iter()
            .filter_map(|i| triangles.get(*i as usize))
            .map(Into::into)
            .collect();
        theirs.build.push(begun.elapsed().as_secs_f64());
        ours.bytes = caster.tree_bytes();
        theirs.bytes = size_of_val(tree.nodes.as_slice())
            + size_of_val(tree.primitive_indices.as_slice())
            + ready.len() * size_of::<RtTriangle>();
        let begun = Instant::now();
        ours.ranges = rays
            .iter()
            .map(|(o, d)| caster.cast(*o, *d, RANGE).map(|h| h.range))
            .collect();
        ours.cast.push(begun.elapsed().as_secs_f64());
        let begun = Instant::now();
        theirs.ranges = rays
            .iter()
            .map(|(o, d)| cast(&tree, &ready, *o, *d))
            .collect();
        theirs.cast.push(begun.elapsed().as_secs_f64());
    }
    println!(
        "cave_01, {count} triangles, {} rays from 8 places, up to {RANGE} m, one thread, median of {RUNS}\n",
        rays.len()
    );
    println!(
        "caster | build s | Mray/s | bytes a triangle beside the mesh | hits | sum of ranges m"
    );
    println!("---|---|---|---|---|---");
    ours.print("winze (parry3d 0.31 tree, `f64` hits)", count);
    theirs.print("obvhs 0.4.0 CWBVH, medium build, `f32`", count);
    let mut apart: Vec<f64> = Vec::new();
    let mut differ = 0;
    for pair in ours.ranges.iter().zip(&theirs.ranges) {
        match pair {
            (Some(a), Some(b)) => apart.push((a - b).abs()),
            (None, None) => {}
            _ => differ += 1,
        }
    }
    println!(
        "\nRanges differ by {:.1e} m (median), {:.1e} m (99.9 %), {:.1e} m (most); {} by more than 1 mm; {differ} \
         rays are a hit for one and none for the other.",
        quantile(&apart, 0.5),
        quantile(&apart, 0.999),
        quantile(&apart, 1.0),
        apart.iter().filter(|d| **d > 1e-3).count()
    );
    Ok(())
}

#[derive(Default)]
struct Runs {
    build: Vec<f64>,
    cast: Vec<f64>,
    bytes: usize,
    ranges: Vec<Option<f64>>,
}

impl Runs {
    fn print(&self, name: &str, triangles: usize) {
        let hits: Vec<f64> = self.ranges.iter().filter_map(|r| *r).collect();
        println!(
            "{name} | {:.2} | {:.3} | {:.0} | {} | {:.3}",
            quantile(&self.build, 0.5),
            1e-6 * self.ranges.len() as f64 / quantile(&self.cast, 0.5),
            self.bytes as f64 / triangles as f64,
            hits.len(),
            hits.iter().sum::<f64>()
        );
    }
}

type Line = ([f64; 3], [f64; 3]);

/// Spins of 32 beams, 45 degrees up to 45 down, from places spread over the cave.
fn rays(free: &FreeSpace<'_>) -> Vec<Line> {
    let places = free.places();
    let mut out = Vec::new();
    for k in 0..8 {
        let Some(origin) = places.get((2 * k + 1) * places.len() / 16) else {
            continue;
        };
        for shot in 0..1024 {
            let azimuth = std::f64::consts::TAU * f64::from(shot) / 1024.0;
            for beam in 0..32 {
                let elevation = (f64::from(beam) / 31.0 - 0.5) * std::f64::consts::FRAC_PI_2;
                let (c, s) = (elevation.cos(), elevation.sin());
                out.push((*origin, [c * azimuth.cos(), c * azimuth.sin(), s]));
            }
        }
    }
    out
}

fn cast(tree: &CwBvh, ready: &[RtTriangle], o: [f64; 3], d: [f64; 3]) -> Option<f64> {
    let single = |v: [f64; 3]| v.map(|c| c as f32);
    let ray = Ray::new(single(o).into(), single(d).into(), 0.0, RANGE as f32);
    let mut hit = RayHit::none();
    tree.ray_traverse(ray, &mut hit, |ray, id| ready[id].intersect(ray))
        .then_some(f64::from(hit.t))
}
