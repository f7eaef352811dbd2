//! A junction that looks alike under quarter turns: what is found, and what is said of it.
//!
//! Points sampled on the mesh of a tunnel world, with 2 cm noise, around its junction and along
//! 25 m of tunnel, in arbitrary frames, sought in a SLAM map of the same world. Prints the table of
//! `docs/junction.md`. Needs the clouds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example study_junction
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use common::mesh::{sample, triangles};
use common::{Result, data, folder_exists, random_frame, read, truth};
use winze::locate::Near;
use winze::rng::Rng;
use winze::{Cloud, Config, Pose, Request, Verdict};

/// The junction's middle in the world.
const JUNCTION: [f64; 2] = [40.0, 0.0];

fn main() -> Result<()> {
    folder_exists("gazebo_tunnel")?;
    let map = read("gazebo_tunnel/slam_map.pcd")?;
    let world_from_map = truth("gazebo_tunnel/T_world_map.txt")?;
    let world = triangles(&data().join("gazebo_tunnel/world.ply"))?;
    println!(
        "query: the junction and | runs | located | of these wrong | ambiguous | other | best pose right | right place among those weighed | located with --near | of these wrong"
    );
    println!("---|---|---|---|---|---|---|---|---|---");
    type Region = (&'static str, fn(f64, f64) -> bool);
    let regions: [Region; 5] = [
        ("25 m of the north arm, 10 m of the others", |x, y| {
            x.abs() < 10.0 && y > -8.0 && y < 25.0
        }),
        ("25 m of the east arm (mapped for 20 m)", |x, y| {
            y.abs() < 10.0 && x > -8.0 && x < 25.0
        }),
        ("25 m of the south arm (mapped for 18 m)", |x, y| {
            x.abs() < 10.0 && y < 8.0 && y > -25.0
        }),
        ("25 m of the west arm (mapped for 20 m)", |x, y| {
            y.abs() < 10.0 && x < 8.0 && x > -25.0
        }),
        ("12.5 m of every arm", |x, y| x.hypot(y) < 12.5),
    ];
    for (name, inside) in regions {
        let mut counts = [0usize; 8];
        for seed in 0..10 {
            let points = sample(&world, seed, |p| {
                inside(p[0] - JUNCTION[0], p[1] - JUNCTION[1])
            });
            let frame = random_frame(seed);
            let query: Vec<[f64; 3]> = points.iter().map(|p| frame.transform(*p)).collect();
            let (query, _) = Cloud::from_points(&query)?;
            let map_from_query = world_from_map.inverse().compose(&frame.inverse());
            let config = Config {
                seed,
                ..Config::default()
            };
            let outcome = winze::locate(&map, &query, &config)?;
            let centroid = query.centroid().unwrap_or_default();
            let right = |pose: &Pose| {
                let d = pose.distance(&map_from_query, centroid);
                d.translation < 0.5 && d.rotation < 5f64.to_radians()
            };
            let best = outcome.map_from_query.is_some_and(|p| right(&p));
            let located = outcome.verdict == Verdict::Located;
            counts[0] += usize::from(located);
            counts[1] += usize::from(located && !best);
            counts[2] += usize::from(outcome.verdict == Verdict::Ambiguous);
            counts[3] += usize::from(!located && outcome.verdict != Verdict::Ambiguous);
            counts[4] += usize::from(best);
            counts[5] += usize::from(outcome.hypotheses.iter().any(|h| right(&h.map_from_query)));
            // Somebody knows roughly where the robot is: 3 m off, and sure of 6 m.
            let off = Rng::new(seed, 5).direction();
            let middle = map_from_query.transform(centroid);
            let request = Request {
                near: Some(Near {
                    centre: std::array::from_fn(|a| middle[a] + 3.0 * off[a]),
                    radius: 6.0,
                }),
                ..Request::default()
            };
            let outcome = winze::locate_by(&map, &query, &config, &request)?;
            let located = outcome.verdict == Verdict::Located;
            let best = outcome.map_from_query.is_some_and(|p| right(&p));
            counts[6] += usize::from(located);
            counts[7] += usize::from(located && !best);
        }
        let cells: Vec<String> = counts.iter().map(ToString::to_string).collect();
        println!("{name} | 10 | {}", cells.join(" | "));
    }
    Ok(())
}
