//! A pipeline of one's own from the stage functions: every stage is a function that takes
//! references and gives back plain data, so stages can be left out, swapped or looked into.
//!
//! ```sh
//! cargo run --release --example own_pipeline -- map.pcd query.pcd
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

use std::path::Path;

use winze::config::{Config, IcpConfig, IcpMetric, Length};
use winze::features::describe;
use winze::matching::match_descriptors;
use winze::prepare::prepare;
use winze::{icp, judge, ndt, ransac, scale, verify};
use winze_io::{ReadOptions, read_cloud};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let (Some(map), Some(query)) = (args.next(), args.next()) else {
        return Err("usage: own_pipeline MAP QUERY [--upright]".into());
    };
    let map = read_cloud(Path::new(&map), &ReadOptions::default())?.cloud;
    let query = read_cloud(Path::new(&query), &ReadOptions::default())?.cloud;

    // One number decides all lengths; here it comes from the data, it could be any.
    let measure = |c| scale::measure(c).ok_or("a cloud has no two points apart");
    let voxel = scale::voxel_for(&measure(&map)?, &measure(&query)?);
    let mut config = Config::default();
    // As an example of a choice: matches that another keypoint rivals are left out.
    config.matching.ratio = 0.97;

    let (map, query) = (
        prepare(&map, &config.prepare, voxel),
        prepare(&query, &config.prepare, voxel),
    );
    println!(
        "voxel {voxel:.3} m: {} map points, {} query points",
        map.points.len(),
        query.points.len()
    );

    let (map_features, query_features) = (describe(&map, &config), describe(&query, &config));
    let correspondences = match_descriptors(
        &query_features.descriptors,
        &map_features.descriptors,
        &config.matching,
    );
    println!(
        "{} and {} keypoints, {} correspondences",
        map_features.points.len(),
        query_features.points.len(),
        correspondences.len()
    );

    // Anything that is known beforehand can rule poses out: here, that the robot stands upright.
    let upright = |pose: &winze::Pose| pose.rotate([0.0, 0.0, 1.0])[2] > 0.9;
    let any = |_: &winze::Pose| true;
    let rule: &(dyn Fn(&winze::Pose) -> bool + Sync) =
        if args.next().as_deref() == Some("--upright") {
            &upright
        } else {
            &any
        };
    let estimate = ransac::estimate(
        &correspondences,
        &query_features,
        &map_features,
        &config.ransac,
        voxel,
        0,
        rule,
    );

    let levels = ndt::levels(&map, &config.ndt);
    // ICP ends on the nearest pairs alone, here on those within a voxel.
    let fine = IcpConfig {
        metric: IcpMetric::PointToPlane,
        final_distance: Length::Voxels(1.0),
        ..config.icp.clone()
    };
    let candidates = estimate
        .hypotheses
        .iter()
        .take(8)
        .map(|h| {
            let coarse = ndt::align(&levels, &map, &query, &h.map_from_query, &config.ndt);
            let refined = icp::align(&map, &query, &coarse.map_from_query, &fine);
            println!(
                "{} inliers, NDT: {}, ICP: {}",
                h.inliers, coarse.stop, refined.stop
            );
            let (pose, stop) = (refined.map_from_query, Some(refined.stop));
            verify::candidate(&map, &query, &pose, stop, &config.verify)
        })
        .collect();
    let mut ranked = verify::rank(candidates, &query, &config.verify, voxel);
    verify::ask_relief(&mut ranked, &map, &query, &config.verify, Some(&fine));
    let judged = judge::judge(&ranked, &map, &query, &config.verify);
    println!("{}: {}", judged.verdict, judged.reason);
    if let Some(best) = ranked.first() {
        println!("{:?}", best.map_from_query.to_matrix());
    }
    Ok(())
}
