//! Odometry bends a long query. No rigid pose puts all of it on the map, but piece by piece it lies there.
//!
//! The piece that lies best at the rigid pose is refined first. Its neighbours begin where it ended, theirs where they ended, so that the
//! bend between pieces must be small and that of the whole may be large. The answer is still one pose: the rigid one that fits all pieces
//! best, in the least-squares sense over their points.

use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use crate::config::{IcpConfig, VerifyConfig};
use crate::fit::fit_rigid;
use crate::icp;
use crate::line::Line;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{StopReason, sampled};
use crate::vec3::{dot, sub, voxel_of};
use crate::verify;

/// A query laid on a map piece by piece.
#[derive(Debug, Clone)]
pub struct Bent {
    /// Takes query points to the map, as far as one rigid pose can.
    pub map_from_query: Pose,
    /// Root mean square distance of the points of the pieces that were followed from where that pose puts them, metres.
    pub bend: f64,
    /// How far off the query's centroid that may leave the pose, metres, where it bends on as it does in the pieces that were followed.
    pub beyond: f64,
    /// Share of the query's points in pieces that were followed.
    pub followed: f64,
    /// The pose of each piece, by its cell.
    poses: FxHashMap<[i64; 3], Pose>,
    size: f64,
}

impl Bent {
    /// The pose of the piece that holds an offset of the query; the rigid one where there is none.
    #[must_use]
    pub fn pose_of(&self, offset: [f64; 3]) -> Pose {
        let cell = voxel_of(offset, self.size);
        self.poses
            .get(&cell)
            .copied()
            .unwrap_or(self.map_from_query)
    }
}

/// A piece turns by no more than this against the one that it follows, radians.
const MOST_TURNED: f64 = 0.06;
/// Share of a piece's points that must lie on the map for it to be followed.
const ON_MAP: f64 = 0.5;
/// Points of a piece that its refinement looks at.
const POINTS: usize = 750;

/// What pieces of a straight query seem to be displaced by, in voxels.
const NOISE: f64 = 0.15;

/// A piece of the query.
struct Piece {
    cell: [i64; 3],
    surface: Surface<'static>,
}

/// Lays `query` on `map` from `start` on, piece by piece (see the [module](self)), in pieces of [`VerifyConfig::piece_size`].
/// `None` where no piece lies on the map, or those that do span no body.
#[must_use]
pub fn follow(
    map: &Surface<'_>,
    query: &Surface<'_>,
    start: &Pose,
    icp: &IcpConfig,
    config: &VerifyConfig,
) -> Option<Bent> {
    let size = config.piece_size.metres(map.voxel);
    let reach = config.patch_reach.metres(map.voxel);
    // From where its neighbour ended, a piece has not far to go.
    let icp = IcpConfig {
        max_points: POINTS,
        max_iterations: icp.max_iterations.div_ceil(2),
        ..icp.clone()
    };
    let pieces = cut(query, size);
    // How well each lies at the start, by the points that do.
    let lies: Vec<f64> = pieces
        .par_iter()
        .map(|p| {
            let points = p.surface.points.len();
            #[expect(clippy::cast_precision_loss, reason = "a count")]
            let points = points as f64;
            points * verify::fit(map, &p.surface, start, config).fitness
        })
        .collect();
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by(|&a, &b| lies[b].total_cmp(&lies[a]).then(a.cmp(&b)));
    let refine = |piece: &Piece, from: &Pose| -> Option<Pose> {
        let refined = icp::align(map, &piece.surface, from, &icp);
        let points = sampled(piece.surface.points.len(), POINTS);
        #[expect(clippy::cast_precision_loss, reason = "counts")]
        let on_map = refined.pairs as f64 / points.max(1) as f64;
        let centre = piece.surface.centroid()?;
        let moved = from.distance(&refined.map_from_query, centre);
        let lost = matches!(
            refined.stop,
            StopReason::TooFewPairs | StopReason::Degenerate
        );
        let stays = moved.translation <= reach && moved.rotation <= MOST_TURNED;
        (!lost && stays && on_map >= ON_MAP).then_some(refined.map_from_query)
    };

    let by_cell: FxHashMap<[i64; 3], usize> = pieces
        .iter()
        .enumerate()
        .map(|(i, p)| (p.cell, i))
        .collect();
    // Some: where it is to lie. Followed: it lies there by itself, and its neighbours may follow it.
    let mut poses: Vec<Option<Pose>> = vec![None; pieces.len()];
    let mut followed: FxHashSet<usize> = FxHashSet::default();
    for &first in &order {
        if poses[first].is_some() {
            continue;
        }
        let mut wave: Vec<(usize, Pose)> = vec![(first, *start)];
        while !wave.is_empty() {
            let found: Vec<Option<Pose>> = wave
                .par_iter()
                .map(|(i, from)| refine(&pieces[*i], from))
                .collect();
            let mut ahead: Vec<usize> = Vec::new();
            for ((i, from), found) in wave.iter().zip(found) {
                poses[*i] = Some(found.unwrap_or(*from));
                if found.is_some() {
                    followed.insert(*i);
                    ahead.extend(neighbours(pieces[*i].cell).filter_map(|c| by_cell.get(&c)));
                }
            }
            ahead.retain(|i| poses[*i].is_none());
            ahead.sort_unstable();
            ahead.dedup();
            // From the largest of the neighbours that were followed.
            let from = |i: usize| {
                neighbours(pieces[i].cell)
                    .filter_map(|c| by_cell.get(&c).copied())
                    .filter(|n| followed.contains(n))
                    .max_by_key(|&n| (pieces[n].surface.points.len(), n))
                    .and_then(|n| poses[n])
            };
            wave = ahead.iter().filter_map(|&i| Some((i, from(i)?))).collect();
        }
    }

    let mut lying: Vec<usize> = followed.into_iter().collect();
    lying.sort_unstable();
    let pairs = lying.iter().flat_map(|&i| {
        let pose = poses[i].unwrap_or(*start);
        let points = query_points(&pieces[i].surface);
        points.map(move |p| (p, pose.transform(p), 1.0))
    });
    let map_from_query = fit_rigid(pairs.clone())?;
    let normals = lying.iter().flat_map(|&i| {
        let pose = poses[i].unwrap_or(*start);
        let normals = pieces[i].surface.normals.iter();
        normals.map(move |n| pose.rotate(n.map(f64::from)))
    });
    let (mut square, mut across, mut count) = (0.0, 0.0, 0.0);
    for ((p, there, _), normal) in pairs.zip(normals) {
        let d = sub(map_from_query.transform(p), there);
        square += dot(d, d);
        across += dot(d, normal) * dot(d, normal);
        count += 1.0;
    }
    // What of the bend the walls show: a piece that has slid along a smooth one shows none, and the walls of a passage that is displaced
    // sideways face that way by half.
    let strain = (2.0 * across / f64::max(count, 1.0)).sqrt();
    let noise = NOISE * map.voxel;
    let whole: Vec<[f64; 3]> = query_points(query).collect();
    let part = lying.iter().flat_map(|&i| query_points(&pieces[i].surface));
    let line = Line::of(&whole, &part.collect::<Vec<_>>(), query.centroid()?);
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let all = query.points.len().max(1) as f64;
    let poses = pieces.iter().zip(&poses);
    Some(Bent {
        map_from_query,
        bend: (square / f64::max(count, 1.0)).sqrt(),
        beyond: line.beyond((strain * strain - noise * noise).max(0.0).sqrt()),
        followed: count / all,
        poses: poses
            .filter_map(|(piece, pose)| Some((piece.cell, (*pose)?)))
            .collect(),
        size,
    })
}

/// The points of a piece, in the query's own frame.
fn query_points<'a>(piece: &'a Surface<'_>) -> impl Iterator<Item = [f64; 3]> + Clone + 'a {
    let origin = piece.origin;
    let at = move |p: &[f32; 3]| std::array::from_fn(|a| f64::from(p[a]) + origin[a]);
    piece.points.iter().map(at)
}

/// The pieces of `query` in cells of `size` metres, in the order of their cells.
fn cut(query: &Surface<'_>, size: f64) -> Vec<Piece> {
    let mut cells: FxHashMap<[i64; 3], Vec<u32>> = FxHashMap::default();
    for (i, p) in (0u32..).zip(query.points.iter()) {
        let cell = voxel_of(p.map(f64::from), size);
        cells.entry(cell).or_default().push(i);
    }
    let mut cells: Vec<([i64; 3], Vec<u32>)> = cells.into_iter().collect();
    cells.sort_unstable();
    let piece = |(cell, indices): ([i64; 3], Vec<u32>)| {
        let of = |of: &[[f32; 3]]| -> Vec<[f32; 3]> {
            indices.iter().map(|i| of[*i as usize]).collect()
        };
        Piece {
            cell,
            surface: Surface {
                origin: query.origin,
                voxel: query.voxel,
                points: of(&query.points).into(),
                normals: of(&query.normals).into(),
                ..Surface::default()
            },
        }
    };
    cells.into_iter().map(piece).collect()
}

/// The 26 cells around one.
fn neighbours([x, y, z]: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    let steps = (-1..=1).flat_map(|i| (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [i, j, k])));
    steps.filter(|s| *s != [0; 3]).map(move |[i, j, k]| {
        [
            x.saturating_add(i),
            y.saturating_add(j),
            z.saturating_add(k),
        ]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{IcpMetric, Length};
    use crate::relief::{Patch, ask, patches};
    use crate::test_world::{drift, surface};

    fn settings() -> (IcpConfig, VerifyConfig) {
        let icp = IcpConfig {
            metric: IcpMetric::PointToPlane,
            ..IcpConfig::default()
        };
        let verify = VerifyConfig {
            piece_size: Length::Metres(6.0),
            ..VerifyConfig::default()
        };
        (icp, verify)
    }

    /// Bent to an arc that leaves the map's walls by up to two metres, far more than a piece may move.
    fn arc(x: f64) -> f64 {
        let off = (x - 10.0) / 34.0;
        2.0 * off * off
    }

    #[test]
    fn a_bent_query_lies_on_the_map_piece_by_piece() {
        let map = surface(&drift(160_000, 50.0, 0.3, 0.01, 1), 0.15);
        let straight = drift(120_000, 45.0, 0.3, 0.01, 2);
        let bent: Vec<[f64; 3]> = straight
            .iter()
            .map(|&[x, y, z]| [x, y + arc(x), z])
            .collect();
        let query = surface(&bent, 0.15);
        let (icp, config) = settings();
        let found = follow(&map, &query, &Pose::identity(), &icp, &config).unwrap();
        assert!(found.followed > 0.95, "{}", found.followed);
        // The best that one rigid pose can do, by the same points before they were bent.
        let best = fit_rigid(bent.iter().zip(&straight).map(|(b, s)| (*b, *s, 1.0))).unwrap();
        let off = found.map_from_query.distance(&best, [22.0, 0.5, 0.0]);
        assert!(off.translation < 0.06 && off.rotation < 0.01, "{off:?}");
        let left: f64 = bent
            .iter()
            .zip(&straight)
            .map(|(b, s)| sub(best.transform(*b), *s))
            .map(|d| dot(d, d))
            .sum();
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let bend = (left / bent.len() as f64).sqrt();
        assert!((found.bend - bend).abs() < 0.03, "{} {bend}", found.bend);

        let patches = patches(&query, 1.5, 300);
        let asked = |pose_of: &(dyn Fn(&Patch) -> Pose + Sync)| {
            ask(&map, query.origin, &patches, pose_of, [0.75, 0.6])
        };
        let rigid = asked(&|_| best);
        let piecewise = asked(&|p| found.pose_of(p.centre()));
        assert!(
            piecewise.share() > rigid.share() + 0.1 && piecewise.share() > 0.7,
            "{rigid:?} {piecewise:?}"
        );
    }

    #[test]
    fn what_is_straight_stays_and_what_is_elsewhere_does_not_follow() {
        let map = surface(&drift(120_000, 40.0, 0.3, 0.01, 1), 0.15);
        let query = surface(&drift(80_000, 30.0, 0.3, 0.01, 2), 0.15);
        let (icp, config) = settings();
        let near = Pose::from_translation([0.05, -0.04, 0.03]);
        let found = follow(&map, &query, &near, &icp, &config).unwrap();
        let off = found
            .map_from_query
            .distance(&Pose::identity(), [15.0, 0.0, 0.0]);
        assert!(
            off.translation < 0.02 && found.bend < 0.03,
            "{off:?} {}",
            found.bend
        );
        let far = Pose::from_translation([500.0, 0.0, 0.0]);
        assert!(follow(&map, &query, &far, &icp, &config).is_none());
        assert!(follow(&map, &Surface::default(), &near, &icp, &config).is_none());
    }
}
