//! Which FPFH variant finds more: recall of correspondences and of poses over small pieces of a
//! real drift, in random frames, against the whole map.
//!
//! Prints the table of `docs/descriptors.md`. Needs the clouds of `WINZE_DATA`.
//!
//! ```sh
//! cargo run --release --example study_descriptors
//! ```
#![expect(clippy::print_stdout, reason = "it is what an example does")]

mod common;

use common::{Result, folder_exists, part, random_frame, read, truth};
use winze::config::{Config, DescriptorVariant};
use winze::features::describe;
use winze::matching::match_descriptors;
use winze::metrics::pose_error;
use winze::prepare::prepare;
use winze::{Cloud, Pose, ransac};

/// Radius of a piece, metres: about 10 m of drift.
const RADIUS: f64 = 5.0;
const STATIONS: u32 = 24;

fn main() -> Result<()> {
    folder_exists("jinchuan")?;
    let map = read("jinchuan/map_2025-05-13.pcd")?;
    let in_map =
        read("jinchuan/query_2025-04-21.pcd")?.transformed(&truth("jinchuan/T_map_query.txt")?)?;
    let pieces: Result<Vec<(Cloud, Pose)>> = (0..STATIONS)
        .map(|s| {
            // Stations along this drift, which runs nearly straight.
            let x = -10.0 + 3.4 * f64::from(s);
            let middle = [x, 2.5 - 0.1 * (x + 8.0), 1.0];
            let near = |p: [f64; 3]| {
                (0..3).map(|a| (p[a] - middle[a]).powi(2)).sum::<f64>() < RADIUS * RADIUS
            };
            let frame = random_frame(u64::from(s));
            let piece = part(&in_map, near).transformed(&frame)?;
            Ok((piece, frame.inverse()))
        })
        .collect();
    let pieces = pieces?;
    println!(
        "voxel m | variant | signs | right correspondences | of all | share | best hypothesis right | some hypothesis right (of {STATIONS})"
    );
    println!("---|---|---|---|---|---|---|---");
    for voxel in [0.2, 0.283, 0.4] {
        for variant in [
            DescriptorVariant::Paper,
            DescriptorVariant::Pcl,
            DescriptorVariant::Open3d,
        ] {
            for unsigned in [false, true] {
                let mut config = Config::default();
                config.fpfh.variant = variant;
                config.fpfh.unsigned = unsigned;
                row(&map, &pieces, &config, voxel);
            }
        }
    }
    Ok(())
}

fn row(map: &Cloud, pieces: &[(Cloud, Pose)], config: &Config, voxel: f64) {
    let map = describe(&prepare(map, &config.prepare, voxel), config);
    let (mut right, mut all, mut first, mut any) = (0, 0, 0, 0);
    for (piece, truth) in pieces {
        let query = describe(&prepare(piece, &config.prepare, voxel), config);
        let correspondences =
            match_descriptors(&query.descriptors, &map.descriptors, &config.matching);
        let local = truth.between_origins(map.origin, query.origin);
        all += correspondences.len();
        right += correspondences
            .iter()
            .filter(|c| {
                let p = local.transform(query.points[c.query as usize].map(f64::from));
                let m = map.points[c.map as usize];
                let d2: f64 = (0..3).map(|a| (p[a] - f64::from(m[a])).powi(2)).sum();
                d2.sqrt() < 2.0 * voxel
            })
            .count();
        let found = ransac::estimate(
            &correspondences,
            &query,
            &map,
            &config.ransac,
            voxel,
            0,
            &|_| true,
        );
        let good = |pose: &Pose| {
            pose_error(pose, truth, piece)
                .is_some_and(|e| e.translation < 1.5 && e.rotation < 12f64.to_radians())
        };
        first += usize::from(
            found
                .hypotheses
                .first()
                .is_some_and(|h| good(&h.map_from_query)),
        );
        any += usize::from(found.hypotheses.iter().any(|h| good(&h.map_from_query)));
    }
    println!(
        "{voxel} | {} | {} | {right} | {all} | {:.1} % | {first} | {any}",
        config.fpfh.variant,
        if config.fpfh.unsigned {
            "none"
        } else {
            "open side"
        },
        100.0 * right as f64 / all.max(1) as f64
    );
}
