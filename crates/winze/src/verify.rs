//! Does the query really lie there? Dense evidence for each pose, on which the verdict rests ([`judge`](mod@crate::judge)).
//!
//! The paper's inlier share at 0.5 m is nearly as high in a passage's twin as in the passage itself.
//! Point-to-plane residuals are several times larger there, so fitness is counted at a fine
//! tolerance in the normal direction, and the rock is asked, patch by patch, whether it is the same ([`relief`]).

use crate::bend;
use crate::config::{IcpConfig, VerifyConfig};
use crate::parallel;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{StopReason, sample};
use crate::relief::{self, Patch, Relief};

/// How well the query's surface lies on the map's at one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Share of query points with map surface within the overlap distance.
    pub overlap: f64,
    /// Share of query points that also lie within the fine tolerance of its tangent plane.
    pub fitness: f64,
    /// Median distance of the overlapping points from the tangent planes, metres; infinite where
    /// nothing overlaps.
    pub median_point_to_plane: f64,
    /// Mean over the query points of the distance from the tangent plane, metres, where twice the fine
    /// tolerance is the most that counts and what a point that does not overlap adds.
    ///
    /// It tells poses of one place apart ([`keep_better`](crate::refine::keep_better)): each point has a say in proportion, while
    /// those that the map does not hold say the same at either pose.
    pub bounded_residual: f64,
    /// Share of query points within the paper's inlier distance of a prepared map point.
    pub inlier_fraction: f64,
}

/// A pose with the evidence for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Takes query points to the map.
    pub map_from_query: Pose,
    /// The evidence.
    pub fit: Fit,
    /// Whether it is the same rock, patch by patch; `None` where that was not asked.
    pub relief: Option<Relief>,
    /// Why its refiner stopped; `None` where it was not refined.
    pub stop: Option<StopReason>,
}

/// A query point's distance from the nearest point of the map and from its tangent plane; `None` where there is none
/// within reach.
type Residual = Option<(f64, f64)>;

/// Residuals of the points that are looked at.
fn residuals(
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    config: &VerifyConfig,
) -> Vec<Residual> {
    let chosen = sample(&query.points, config.max_points);
    let pose = map_from_query.between_origins(map.origin, query.origin);
    let overlap = config.overlap_distance.metres(map.voxel);
    #[expect(clippy::cast_possible_truncation, reason = "metres")]
    let radius = overlap.max(config.inlier_distance) as f32;
    parallel::map_with(
        chosen.len(),
        || (),
        |(), i| {
            let p = pose.transform(chosen[i].map(f64::from));
            #[expect(
                clippy::cast_possible_truncation,
                reason = "offsets within f32's range"
            )]
            let near = map.tree.nearest_within(p.map(|v| v as f32), radius)?;
            let (q, n) = (
                map.points[near.index as usize],
                map.normals[near.index as usize],
            );
            let out: f64 = (0..3)
                .map(|a| (p[a] - f64::from(q[a])) * f64::from(n[a]))
                .sum();
            // Without a normal the distance itself stands in.
            let distance = f64::from(near.distance_squared).sqrt();
            Some((distance, if n == [0.0; 3] { distance } else { out.abs() }))
        },
    )
}

/// What a point adds to [`Fit::bounded_residual`].
fn bounded(residual: &Residual, overlap: f64, most: f64) -> f64 {
    match residual {
        Some((distance, plane)) if *distance <= overlap => plane.min(most),
        _ => most,
    }
}

/// How much more finely the query lies on the map at pose `after` than at pose `before`, on average over its points
/// ([`Fit::bounded_residual`]), metres, and the standard error of that, were the points independent.
#[must_use]
pub fn gain(
    map: &Surface<'_>,
    query: &Surface<'_>,
    (before, after): (&Pose, &Pose),
    config: &VerifyConfig,
) -> (f64, f64) {
    let overlap = config.overlap_distance.metres(map.voxel);
    let most = 2.0 * config.fine_tolerance.metres(map.voxel);
    let at = |pose| residuals(map, query, pose, config);
    let gains: Vec<f64> = at(before)
        .iter()
        .zip(&at(after))
        .map(|(b, a)| bounded(b, overlap, most) - bounded(a, overlap, most))
        .collect();
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = gains.len().max(1) as f64;
    let mean = gains.iter().sum::<f64>() / n;
    let square: f64 = gains.iter().map(|g| (g - mean) * (g - mean)).sum();
    (mean, (square / n).sqrt() / n.sqrt())
}

/// Measures how `query` lies on `map` at `map_from_query`, at no more than
/// [`VerifyConfig::max_points`] of its points.
#[must_use]
pub fn fit(
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    config: &VerifyConfig,
) -> Fit {
    let residuals = residuals(map, query, map_from_query, config);
    let overlap = config.overlap_distance.metres(map.voxel);
    let tolerance = config.fine_tolerance.metres(map.voxel);
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    let share = |count: usize| count as f64 / residuals.len().max(1) as f64;
    let mut planes: Vec<f64> = residuals
        .iter()
        .flatten()
        .filter(|(d, _)| *d <= overlap)
        .map(|(_, r)| *r)
        .collect();
    let inliers = residuals
        .iter()
        .flatten()
        .filter(|(d, _)| *d < config.inlier_distance)
        .count();
    let fine = planes.iter().filter(|r| **r <= tolerance).count();
    let most = 2.0 * tolerance;
    let bounded: f64 = residuals.iter().map(|r| bounded(r, overlap, most)).sum();
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    let bounded_residual = if residuals.is_empty() {
        most
    } else {
        bounded / residuals.len() as f64
    };
    let median_point_to_plane = if planes.is_empty() {
        f64::INFINITY
    } else {
        let middle = planes.len() / 2;
        *planes.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    Fit {
        overlap: share(planes.len()),
        fitness: share(fine),
        median_point_to_plane,
        bounded_residual,
        inlier_fraction: share(inliers),
    }
}

/// A pose with the evidence of its [`fit`], and why its refiner stopped. The rock is not asked ([`ask_relief`]).
#[must_use]
pub fn candidate(
    map: &Surface<'_>,
    query: &Surface<'_>,
    map_from_query: &Pose,
    stop: Option<StopReason>,
    config: &VerifyConfig,
) -> Candidate {
    Candidate {
        map_from_query: *map_from_query,
        fit: fit(map, query, map_from_query, config),
        relief: None,
        stop,
    }
}

/// Orders candidates, the fittest first, and drops those that another one has swallowed: poses that
/// differ by less than the merge distance at the query's centroid and by less than the merge angle.
#[must_use]
pub fn rank(
    mut candidates: Vec<Candidate>,
    query: &Surface<'_>,
    config: &VerifyConfig,
    voxel: f64,
) -> Vec<Candidate> {
    candidates.sort_by(|a, b| b.fit.fitness.total_cmp(&a.fit.fitness));
    let mut distinct: Vec<Candidate> = Vec::new();
    for c in candidates {
        if !distinct
            .iter()
            .any(|d| same_place(d, &c, query, config, voxel))
        {
            distinct.push(c);
        }
    }
    distinct
}

/// Which candidates are worth the last refinement: the first always, on which the paper's methods
/// build, and all that fit within [`VerifyConfig::hopeless_residual`] times the finest of those with
/// enough overlap. Those that no refiner has seen are all worth it.
pub(crate) fn hopeful(candidates: &[Candidate], config: &VerifyConfig) -> Vec<bool> {
    let finest = candidates
        .iter()
        .filter(|c| c.fit.overlap >= config.min_overlap)
        .map(|c| c.fit.median_point_to_plane)
        .fold(f64::INFINITY, f64::min);
    let limit = config.hopeless_residual * finest;
    candidates
        .iter()
        .enumerate()
        .map(|(i, c)| i == 0 || c.stop.is_none() || c.fit.median_point_to_plane <= limit)
        .collect()
}

/// Asks the rock ([`relief`]) at the best of `ranked` places, [`VerifyConfig::refined`] of them, but for the hopeless. Places that were asked
/// before keep what they know.
///
/// Where a `bend` is given, the query may have been bent by odometry: of the first two places those that the rock confirms, or both where it
/// confirms none, are asked again piece by piece, each piece refined as that says ([`bend`]). Where the pieces say more,
/// the place's pose becomes the rigid one that fits them best.
pub fn ask_relief(
    ranked: &mut [Candidate],
    map: &Surface<'_>,
    query: &Surface<'_>,
    config: &VerifyConfig,
    bend: Option<&IcpConfig>,
) {
    let lengths = [
        config.patch_step.metres(map.voxel),
        config.patch_reach.metres(map.voxel),
    ];
    let size = config.patch_size.metres(map.voxel);
    let patches = relief::patches(query, size, config.patches);
    let ask = |pose_of: &PoseOf<'_>| relief::ask(map, query.origin, &patches, pose_of, lengths);
    let hopeful = hopeful(ranked, config);
    for (c, hopeful) in ranked.iter_mut().take(config.refined).zip(hopeful) {
        if !hopeful {
            continue;
        }
        let pose = c.map_from_query;
        c.relief.get_or_insert_with(|| ask(&|_| pose));
    }
    if let Some(icp) = bend {
        unbend(ranked, map, query, config, icp, &ask);
    }
    // Whatever has the shape of a place that is believed is asked too, however late it comes.
    let sure: Vec<Fit> = ranked
        .iter()
        .filter(|c| confirmed(c, config))
        .map(|c| c.fit)
        .collect();
    for c in ranked.iter_mut().filter(|c| c.relief.is_none()) {
        let alike = |fit: &Fit| as_fine(&c.fit, fit, fit.median_point_to_plane, config);
        if sure.iter().any(alike) {
            let pose = c.map_from_query;
            c.relief = Some(ask(&|_| pose));
        }
    }
}

/// A place fits as finely as another one whose median residual, refined, is `finest`, on enough of its overlap.
pub(crate) fn as_fine(fit: &Fit, other: &Fit, finest: f64, config: &VerifyConfig) -> bool {
    fit.overlap >= config.rival_overlap * other.overlap
        && fit.median_point_to_plane <= config.rival_residual * finest
}

/// Where the patches of a query lie.
type PoseOf<'a> = dyn Fn(&Patch) -> Pose + Sync + 'a;

/// Lays the query down piece by piece at the places that may need it, see [`ask_relief`].
fn unbend(
    ranked: &mut [Candidate],
    map: &Surface<'_>,
    query: &Surface<'_>,
    config: &VerifyConfig,
    icp: &IcpConfig,
    ask: &dyn Fn(&PoseOf<'_>) -> Relief,
) {
    let sure = ranked.iter().any(|c| confirmed(c, config));
    for c in ranked.iter_mut().take(UNBENT) {
        let rigid = c.relief.unwrap_or_default();
        if rigid.bend.is_some() || (sure && !confirmed(c, config)) {
            continue;
        }
        let Some(bent) = bend::follow(map, query, &c.map_from_query, icp, config) else {
            continue;
        };
        let asked = Relief {
            bend: Some(bent.bend),
            beyond: Some(bent.beyond),
            followed: Some(bent.followed),
            piecewise: true,
            ..ask(&|p: &Patch| bent.pose_of(p.centre()))
        };
        c.relief = Some(Relief {
            bend: Some(bent.bend),
            beyond: Some(bent.beyond),
            followed: Some(bent.followed),
            ..rigid
        });
        let unbent = Candidate {
            map_from_query: bent.map_from_query,
            relief: Some(asked),
            ..*c
        };
        // How far the rest of a bent query is off, no one knows.
        let matters =
            bent.bend > config.straight.metres(map.voxel) && bent.followed >= config.min_followed;
        if matters && confirmed(&unbent, config) && asked.excess() >= rigid.excess() {
            *c = Candidate {
                fit: fit(map, query, &bent.map_from_query, config),
                ..unbent
            };
        }
    }
}

/// Places that are asked piece by piece.
const UNBENT: usize = 2;

/// What the rock says, where enough of it could be asked.
#[must_use]
pub fn asked_enough(relief: Option<Relief>, config: &VerifyConfig) -> Option<Relief> {
    relief.filter(|r| r.asked >= config.min_patches)
}

/// Whether enough of the rock says that it is the same, at a pose with so much overlap.
#[must_use]
pub fn rock_confirms(overlap: f64, relief: Option<Relief>, config: &VerifyConfig) -> bool {
    overlap >= config.least_overlap
        && asked_enough(relief, config).is_some_and(|r| r.significance() >= config.min_significance)
}

/// And says so by enough that no shape overrules it.
#[must_use]
pub fn rock_is_sure(overlap: f64, relief: Option<Relief>, config: &VerifyConfig) -> bool {
    let significance = relief.map_or(0.0, |r| r.significance());
    rock_confirms(overlap, relief, config) && significance >= config.sure_significance
}

/// As [`rock_confirms`], of a candidate.
pub(crate) fn confirmed(candidate: &Candidate, config: &VerifyConfig) -> bool {
    rock_confirms(candidate.fit.overlap, candidate.relief, config)
}

/// As [`rock_is_sure`], of a candidate.
pub(crate) fn beyond_doubt(candidate: &Candidate, config: &VerifyConfig) -> bool {
    rock_is_sure(candidate.fit.overlap, candidate.relief, config)
}

/// Orders distinct candidates by how much of the rock says yes, asked at the fittest, then by fitness. Two that a bent query's pieces have
/// led to one place become one.
pub(crate) fn by_evidence(
    pool: &mut Vec<Candidate>,
    map: &Surface<'_>,
    query: &Surface<'_>,
    config: &VerifyConfig,
    icp: &IcpConfig,
) {
    pool.sort_by(|a, b| b.fit.fitness.total_cmp(&a.fit.fitness));
    ask_relief(pool, map, query, config, Some(icp));
    let excess = |c: &Candidate| {
        if confirmed(c, config) {
            c.relief.map_or(0.0, |r| r.excess())
        } else {
            0.0
        }
    };
    pool.sort_by(|a, b| {
        let by_rock = excess(b).total_cmp(&excess(a));
        by_rock.then(b.fit.fitness.total_cmp(&a.fit.fitness))
    });
    let mut distinct: Vec<Candidate> = Vec::with_capacity(pool.len());
    for c in pool.drain(..) {
        let held = |d: &Candidate| {
            let bend = d.relief.filter(|r| r.piecewise).and_then(|r| r.bend);
            nearer(d, &c, query, config, map.voxel, bend.unwrap_or(0.0))
        };
        if !distinct.iter().any(held) {
            distinct.push(c);
        }
    }
    *pool = distinct;
}

/// Two candidates differ by less than the merge distance at the query's centroid and by less than
/// the merge angle.
#[must_use]
pub fn same_place(
    a: &Candidate,
    b: &Candidate,
    query: &Surface<'_>,
    config: &VerifyConfig,
    voxel: f64,
) -> bool {
    nearer(a, b, query, config, voxel, 0.0)
}

/// As [`same_place`], where the merge distance is longer by so many metres.
fn nearer(
    a: &Candidate,
    b: &Candidate,
    query: &Surface<'_>,
    config: &VerifyConfig,
    voxel: f64,
    longer: f64,
) -> bool {
    let centroid = query.centroid().unwrap_or_default();
    let apart = a.map_from_query.distance(&b.map_from_query, centroid);
    apart.translation < config.merge_distance.metres(voxel) + longer
        && apart.rotation < config.merge_angle.to_radians()
}

#[cfg(test)]
mod tests;
