//! Fine registration of real pairs from 20 starts, 0.5 m and 5° off: how many come home.
//!
//! Prints the table of `docs/fine-registration.md`. Needs the clouds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example study_fine_registration
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use std::time::Instant;

use common::{Result, folder_exists, off, quantile, read, truth};
use winze::config::{Config, IcpConfig, IcpMetric, Length, NdtForm, PrepareConfig};
use winze::prepare::{Surface, prepare};
use winze::{Cloud, Pose, icp, ndt, scale};

fn main() -> Result<()> {
    folder_exists("pairs")?;
    println!(
        "pair | voxel m | refiner | within 0.05 m and 0.5° | error m, median (max) | error deg, median (max) | ms each"
    );
    println!("---|---|---|---|---|---|---");
    for (name, map, query, t) in [
        (
            "outdoor",
            "pairs/outdoor_target.ply",
            "pairs/outdoor_source.ply",
            "pairs/outdoor_T_target_source.txt",
        ),
        (
            "room",
            "pairs/room_scan1.pcd",
            "pairs/room_scan2.pcd",
            "pairs/room_T_1_2.txt",
        ),
    ] {
        study(name, &read(map)?, &read(query)?, &truth(t)?)?;
    }
    Ok(())
}

fn study(name: &str, map: &Cloud, query: &Cloud, truth: &Pose) -> Result<()> {
    let config = Config::default();
    let measure = |c| scale::measure(c).ok_or("nothing to measure");
    let voxel = scale::voxel_for(&measure(map)?, &measure(query)?);
    let centroid = query.centroid().unwrap_or_default();
    // What becomes of it where a ball that holds one LiDAR ring still gives a normal.
    let ball = PrepareConfig {
        normal_least: 0,
        ..config.prepare.clone()
    };
    let ball = prepare(map, &ball, voxel);
    let cloud = query;
    let (map, query) = (
        prepare(map, &config.prepare, voxel),
        prepare(query, &config.prepare, voxel),
    );
    let levels = ndt::levels(&map, &config.ndt);
    let mut plain = config.ndt.clone();
    plain.form = NdtForm::Plain;
    plain.max_iterations = 200;
    // Half a metre and five degrees put pairs further apart than the default bound, which follows NDT.
    let wide = |metric| IcpConfig {
        metric,
        max_distance: Length::Metres(1.5),
        max_iterations: 200,
        ..config.icp.clone()
    };
    let (plane, point) = (wide(IcpMetric::PointToPlane), wide(IcpMetric::PointToPoint));
    type Refiner<'a> = Box<dyn Fn(&Surface<'_>, &Surface<'_>, &Pose) -> Pose + 'a>;
    let refiners: [(&str, Refiner<'_>); 6] = [
        (
            "ICP point-to-plane",
            Box::new(|m, q, s| icp::align(m, q, s, &plane).map_from_query),
        ),
        (
            "NDT",
            Box::new(|m, q, s| ndt::align(&levels, m, q, s, &config.ndt).map_from_query),
        ),
        (
            "NDT, then ICP point-to-plane",
            Box::new(|m, q, s| {
                let coarse = ndt::align(&levels, m, q, s, &config.ndt);
                icp::align(m, q, &coarse.map_from_query, &plane).map_from_query
            }),
        ),
        (
            "ICP point-to-point",
            Box::new(|m, q, s| icp::align(m, q, s, &point).map_from_query),
        ),
        (
            "NDT, the paper's plain form",
            Box::new(|m, q, s| ndt::align(&levels, m, q, s, &plain).map_from_query),
        ),
        (
            "ICP point-to-plane, `prepare.normal_least = 0`",
            Box::new(|_, q, s| icp::align(&ball, q, s, &plane).map_from_query),
        ),
    ];
    for (refiner, align) in &refiners {
        let (mut metres, mut degrees, mut home) = (Vec::new(), Vec::new(), 0);
        let begun = Instant::now();
        for seed in 0..20 {
            let start = off(truth, cloud, seed);
            let error = align(&map, &query, &start).distance(truth, centroid);
            home += usize::from(error.translation < 0.05 && error.rotation < 0.5f64.to_radians());
            metres.push(error.translation);
            degrees.push(error.rotation.to_degrees());
        }
        println!(
            "{name} | {voxel:.3} | {refiner} | {home} of 20 | {:.3} ({:.3}) | {:.2} ({:.2}) | {:.0}",
            quantile(&metres, 0.5),
            quantile(&metres, 1.0),
            quantile(&degrees, 0.5),
            quantile(&degrees, 1.0),
            begun.elapsed().as_secs_f64() * 1000.0 / 20.0
        );
    }
    Ok(())
}
