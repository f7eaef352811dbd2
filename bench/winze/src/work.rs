//! What a stage must at least do: the bytes that come in and go out, and the arithmetic that its definition asks for.
//!
//! Finding neighbours is counted as the distances to those that are found and nothing else, so that what a search does in vain counts
//! against it. An operation is an addition, a multiplication or a comparison of one number; a division, a square root and one step of
//! a polynomial count as one each.

use anyhow::Context;
use serde_json::{Value, json};
use winze::config::IcpMetric;
use winze::kdtree::KdTree;
use winze::{Pose, icp, ndt};

use crate::inputs::Inputs;
use crate::settings::{self, NEAREST, SEARCH_RADIUS};
use crate::stages::{Arrays, Matched};

type Rows = serde_json::Map<String, Value>;

/// Bytes of a point.
const POINT: usize = 12;
/// Bytes of a descriptor.
const DESCRIPTOR: usize = 132;

/// A squared distance: three differences, three squares, two sums.
const DISTANCE: usize = 8;
/// A neighbour's part of a covariance: an offset, its sum, six products and their sums.
const SCATTER: usize = 3 + 3 + 12;
/// Eigenvalues of a symmetric 3 x 3 matrix, by the closed form.
const EIGENVALUES: usize = 60;
/// With the vector of one.
const EIGENVECTOR: usize = EIGENVALUES + 40;
/// The features of a pair of points with normals, and their bins: four products, a frame, an arc tangent.
const FEATURES: usize = 70;
/// A histogram, weighted and summed.
const WEIGHED: usize = 2 * 33;
/// A point moved by a pose.
const MOVED: usize = 18;
/// The upper half of a 6 x 6 matrix and a vector of 6, by one residual.
const ROW: usize = 2 * (21 + 6) + 12;
/// One cell's part of NDT's gradient and Hessian.
const CELL: usize = 150;

/// The work of each stage of a folder of inputs: `{stage: {"bytes": .., "ops": ..}}`.
pub(crate) fn of(inputs: &Inputs) -> anyhow::Result<Value> {
    let size = |name: &str| -> anyhow::Result<usize> {
        Ok(std::fs::metadata(inputs.path(name))?.len().try_into()?)
    };
    let mut rows = Rows::new();
    let mut row = |stage: &str, bytes: usize, ops: usize| {
        rows.insert(stage.to_owned(), json!({ "bytes": bytes, "ops": ops }));
    };
    let n = size("map.f32")? / POINT;
    let thin: Vec<[f32; 3]> = inputs.rows("map_thin.f32")?;
    let m = thin.len();
    // A cloud holds intensities too.
    for (stage, file) in [
        ("read-pcd-ascii", "map.ascii.pcd"),
        ("read-pcd-binary", "map.pcd"),
        ("read-pcd-compressed", "map.compressed.pcd"),
        ("read-ply", "map.ply"),
    ] {
        // Each byte of text is looked at once.
        let text = if stage == "read-pcd-ascii" {
            size(file)?
        } else {
            0
        };
        row(stage, size(file)? + 16 * n, text);
    }
    row("voxel", POINT * (n + m), 9 * n);
    row("outliers", POINT * m + 4 * m, m * NEAREST * (DISTANCE + 2));
    row("tree", 2 * POINT * n + 4 * n, n * levels(n));

    let probes: Vec<[f32; 3]> = inputs.rows("probes.f32")?;
    let map = KdTree::build(&inputs.rows::<f32, 3>("map.f32")?);
    let p = probes.len();
    // What a probe finds is read from where it lies; down the tree it is compared once a level.
    let found = pairs(&map, &probes, SEARCH_RADIUS * inputs.voxel);
    row(
        "nearest",
        p * (POINT + POINT + 8),
        p * (levels(n) + DISTANCE),
    );
    let nearest = NEAREST * POINT;
    row(
        "knn",
        p * (POINT + nearest + 8 * NEAREST),
        p * (levels(n) + NEAREST * DISTANCE),
    );
    row(
        "radius",
        p * (POINT + 4) + found.min(n) * POINT,
        p * levels(n) + found * DISTANCE,
    );
    drop(map);

    let tree = KdTree::build(&thin);
    let voxels = |v: f64| pairs(&tree, &thin, v * inputs.voxel);
    let per_neighbour = DISTANCE + SCATTER;
    row(
        "normals-knn",
        2 * POINT * m,
        m * (NEAREST * per_neighbour + EIGENVECTOR),
    );
    row(
        "normals-radius",
        2 * POINT * m,
        voxels(2.5) * per_neighbour + m * EIGENVECTOR,
    );
    row(
        "iss",
        POINT * m,
        voxels(6.0) * per_neighbour + m * EIGENVALUES,
    );
    let near = 5.0 * inputs.voxel;
    let all = voxels(5.0);
    row(
        "fpfh-all",
        2 * POINT * m + DESCRIPTOR * m,
        all * (DISTANCE + FEATURES + WEIGHED),
    );
    let keypoints = inputs.indices("map_keypoints.u32")?;
    let at: Vec<[f32; 3]> = keypoints.iter().map(|&i| thin[i as usize]).collect();
    let (described, weighed) = reached(&tree, &thin, &at, near);
    row(
        "fpfh-keypoints",
        2 * POINT * m + DESCRIPTOR * at.len(),
        described * (DISTANCE + FEATURES) + weighed * WEIGHED,
    );
    let (q, k) = (size("query_fpfh.f32")? / DESCRIPTOR, at.len());
    // Every one with every other: what an index saves shows as more than all of the machine.
    for stage in ["match", "match-mutual"] {
        row(stage, DESCRIPTOR * (q + k) + 8 * q, q * k * 3 * 33);
    }
    // Three edges a sample on both sides, and one pose by which all pairs are counted.
    let matched = Matched::of(inputs)?;
    let (samples, pairs) = (
        matched.estimate(inputs.voxel).samples as usize,
        matched.pairs.len(),
    );
    row(
        "ransac",
        2 * POINT * pairs,
        samples * 6 * DISTANCE + pairs * (MOVED + DISTANCE),
    );
    let starts = inputs.poses("start.f64")?;
    refiners(inputs, &starts, &mut row)?;
    let chain = chain(
        &rows,
        starts.len(),
        [n, m],
        [
            size("query_0.f32")? / POINT,
            size("query_thin.f32")? / POINT,
        ],
    )?;
    rows.insert("chain".to_owned(), chain);
    Ok(Value::Object(rows))
}

/// The chain's parts, from the rows of its stages, for both clouds, of which the numbers of points are given as they are and thinned.
/// Outliers are removed from raw points; the chain refines from one start, its stages from `starts`.
fn chain(rows: &Rows, starts: usize, map: [usize; 2], query: [usize; 2]) -> anyhow::Result<Value> {
    let both = |of: usize| (map[of] + query[of]) as f64;
    let times = [
        ("outliers", both(0) / map[1] as f64),
        ("voxel", both(0) / map[0] as f64),
        ("normals-knn", both(1) / map[1] as f64),
        ("iss", both(1) / map[1] as f64),
        ("fpfh-keypoints", both(1) / map[1] as f64),
        ("match", 1.0),
        ("ransac", 1.0),
        ("ndt", 1.0 / starts as f64),
        ("icp-point", 1.0 / starts as f64),
    ];
    let sum = |what: &str| -> anyhow::Result<u64> {
        let part = |(stage, times): &(&str, f64)| {
            let row = rows.get(*stage).and_then(|row| row[what].as_f64());
            row.map(|of_one| (of_one * times) as u64)
                .context("a stage of the chain has no row")
        };
        times.iter().map(part).sum()
    };
    Ok(json!({ "bytes": sum("bytes")?, "ops": sum("ops")? }))
}

/// The refiners, from all starts, at as many iterations as each takes.
fn refiners(
    inputs: &Inputs,
    starts: &[Pose],
    row: &mut impl FnMut(&str, usize, usize),
) -> anyhow::Result<()> {
    let (map, query) = (Arrays::of(inputs, "map")?, Arrays::of(inputs, "query")?);
    let times = starts.len();
    let (map, query) = (map.as_map(), query.as_query());
    let (m, q) = (map.points.len(), query.points.len());
    let config = settings::ndt();
    let cells = ndt::levels(&map, &config);
    let iterations: usize = starts
        .iter()
        .map(|start| ndt::align(&cells, &map, &query, start, &config).iterations)
        .sum();
    // Each iteration derives once and tries a step at least once; each point meets a cell at least.
    let each = q * (2 * MOVED + CELL + 30);
    row(
        "ndt",
        times * POINT * (m + q),
        times * m * SCATTER + iterations * each,
    );
    for (stage, metric, residual) in [
        ("icp-point", IcpMetric::PointToPoint, 2 * 3 * 3 + 12),
        ("icp-plane", IcpMetric::PointToPlane, ROW),
        ("gicp", IcpMetric::Generalized, 3 * ROW),
    ] {
        let config = settings::icp(metric);
        let iterations: usize = starts
            .iter()
            .map(|start| icp::align(&map, &query, start, &config).iterations)
            .sum();
        let each = q * (MOVED + levels(m) + DISTANCE + residual);
        let tree = m * levels(m);
        // GICP makes both clouds' covariances itself.
        let own = |n: usize| n * (levels(n) + NEAREST * (DISTANCE + SCATTER) + EIGENVECTOR);
        let (bytes, made) = match metric {
            IcpMetric::Generalized => (POINT * (m + q), own(m) + own(q)),
            _ => (POINT * (2 * m + q), tree),
        };
        row(stage, times * bytes, times * made + iterations * each);
    }
    Ok(())
}

/// Levels of a tree over `n` points down to leaves of 16.
fn levels(n: usize) -> usize {
    n.div_ceil(16).next_power_of_two().ilog2() as usize
}

/// Pairs of a point with one of the tree's within `radius` metres.
fn pairs(tree: &KdTree<'_>, points: &[[f32; 3]], radius: f64) -> usize {
    let mut count = 0;
    for p in points {
        tree.within(*p, radius as f32, |_, _| count += 1);
    }
    count
}

/// Pairs of the points within `radius` of one of `at` with their own neighbours, and of those of `at` with theirs.
fn reached(tree: &KdTree<'_>, points: &[[f32; 3]], at: &[[f32; 3]], radius: f64) -> (usize, usize) {
    let mut near = vec![false; points.len()];
    for p in at {
        tree.within(*p, radius as f32, |i, _| near[i as usize] = true);
    }
    let described: Vec<[f32; 3]> = points
        .iter()
        .zip(&near)
        .filter(|(_, near)| **near)
        .map(|(p, _)| *p)
        .collect();
    (pairs(tree, &described, radius), pairs(tree, at, radius))
}
