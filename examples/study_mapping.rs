//! A simulated survey of a world beside a SLAM map that a simulated robot's own software made of it.
//!
//! The world is a Gazebo tunnel of triangles, the SLAM map that of a legged robot with a 16-beam LiDAR. Ours is a survey
//! of the whole world with the same kind of LiDAR. Compared are the distance of the points from the mesh, how
//! thickly they lie, and how much of the SLAM map the survey has seen. With a file name the two are drawn, from above.
//! Needs the clouds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example study_mapping -- mapping.png
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use common::{Result, data, folder_exists, quantile, read, truth};
use winze::Cloud;
use winze::kdtree::KdTree;
use winze_report::{Thumb, contact_sheet, thin};
use winze_sim::mesh_file::read_mesh;
use winze_sim::raycast::Caster;
use winze_sim::scenario::{Made, Scenario, simulate};

/// The SLAM map is thinned to about 0.1 m.
const SURVEY: &str = r#"
    name = "mapping"
    [[mine]]
    name = "tunnel"
    mesh = "MESH"
    robot = { radius = 0.4, height = 0.7 }
    [mine.map]
    sensor = { preset = "vlp16", shots_per_turn = 450 }
    motion = { scan_every = 1.0, wobble = 2.0 }
    spacing = 8.0
    voxel = 0.1
    warp = 0.05
"#;
/// Points looked at of each cloud.
const LOOKED_AT: usize = 40_000;

fn main() -> Result<()> {
    folder_exists("gazebo_tunnel")?;
    let world = data().join("gazebo_tunnel/world.ply");
    let (mesh, _) = read_mesh(&world)?;
    let caster = Caster::new(mesh)?;
    let world_from_map = truth("gazebo_tunnel/T_world_map.txt")?;
    let slam: Vec<[f64; 3]> = read("gazebo_tunnel/slam_map.pcd")?
        .iter()
        .map(|p| world_from_map.transform(p))
        .collect();
    let slam = Cloud::from_points(&slam)?.0;
    let text = SURVEY.replace("MESH", &world.display().to_string());
    let scenario = Scenario::parse(&text, "mapping")?;
    let (mut survey, mut told) = (None, String::new());
    simulate(&scenario, 0, &|_| (), |made| {
        if let Made::Map(map) = made {
            told = format!("{} scans over {:.0} m", map.scans, map.way);
            survey = Some(map.cloud.clone());
        }
        Ok::<(), winze_sim::Error>(())
    })?;
    let survey = survey.ok_or("the survey made no map")?;
    println!("{told}\n");
    println!(
        "cloud | points | within 0.05 m of the mesh % | within 0.2 m % | median m | p95 m | nearest neighbour, median m"
    );
    println!("---|---|---|---|---|---|---");
    for (name, cloud) in [("SLAM map", &slam), ("simulated survey", &survey)] {
        let off = from_mesh(&caster, cloud);
        let share =
            |d: f64| 100.0 * off.iter().filter(|v| **v <= d).count() as f64 / off.len() as f64;
        println!(
            "{name} | {} | {:.1} | {:.1} | {:.3} | {:.3} | {:.3}",
            cloud.len(),
            share(0.05),
            share(0.2),
            quantile(&off, 0.5),
            quantile(&off, 0.95),
            quantile(&spacing(cloud), 0.5)
        );
    }
    let seen = distances(&slam, &survey);
    for d in [0.1, 0.2, 0.5] {
        let share = seen.iter().filter(|v| **v <= d).count() as f64 / seen.len() as f64;
        println!(
            "\n{:.1} % of the SLAM map lies within {d} m of the survey.",
            100.0 * share
        );
    }
    if let Some(path) = std::env::args().nth(1) {
        let thumb = |title: &str, map: &Cloud, query: Vec<[f64; 3]>, note: &str| {
            (title.to_owned(), thin(map, 60_000), query, note.to_owned())
        };
        let pictures = [
            thumb("SLAM map", &slam, Vec::new(), "16 beams on legs"),
            thumb("simulated survey", &survey, Vec::new(), &told),
            thumb("both", &survey, thin(&slam, 60_000), "SLAM map in green"),
        ];
        let thumbs: Vec<Thumb<'_>> = pictures
            .iter()
            .map(|(title, map, query, note)| Thumb {
                map,
                query: query.clone(),
                in_map: true,
                title: title.clone(),
                note: note.clone(),
            })
            .collect();
        std::fs::write(&path, contact_sheet("gazebo_tunnel", &thumbs)?)?;
        println!("\n{path}");
    }
    Ok(())
}

/// Distance of points from the mesh, at most a metre.
fn from_mesh(caster: &Caster, cloud: &Cloud) -> Vec<f64> {
    thin(cloud, LOOKED_AT)
        .iter()
        .map(|p| caster.nearest(*p, 1.0).map_or(1.0, |n| n.distance))
        .collect()
}

/// Distance of each point from the next of its own cloud.
fn spacing(cloud: &Cloud) -> Vec<f64> {
    let tree = KdTree::build(cloud.points());
    let step = cloud.len().div_ceil(LOOKED_AT).max(1);
    cloud
        .points()
        .iter()
        .step_by(step)
        .filter_map(|p| {
            let mut near = Vec::new();
            tree.knn(*p, 2, f32::INFINITY, &mut near);
            Some(f64::from(near.get(1)?.distance_squared).sqrt())
        })
        .collect()
}

/// Distance of one cloud's points from the nearest of another.
fn distances(from: &Cloud, to: &Cloud) -> Vec<f64> {
    let tree = KdTree::build(to.points());
    let o = to.origin();
    thin(from, LOOKED_AT)
        .iter()
        .filter_map(|p| {
            let q: [f32; 3] = std::array::from_fn(|a| (p[a] - o[a]) as f32);
            Some(f64::from(tree.nearest(q)?.distance_squared).sqrt())
        })
        .collect()
}
