//! The main path: the whole pipeline on one page.
//!
//! ```text
//! cloud ─prepare─> Surface ─describe─> Features ─match─> correspondences ─estimate─> hypotheses
//!                                                            refine (NDT, ICP) ─> candidates
//!                                                                     verify, judge ─> Outcome
//! ```

use std::time::Instant;

use crate::cloud::Cloud;
use crate::config::{Config, IcpConfig, IcpMetric};
use crate::denoise::within_range;
use crate::error::{Error, Result};
use crate::features::{Features, describe};
use crate::kdtree::KdTree;
use crate::matching::match_descriptors;
use crate::method::Method;
use crate::ndt::NdtCells;
use crate::outcome::{Outcome, RankedHypothesis, Stage, Verdict};
use crate::pose::Pose;
use crate::prepare::{Surface, limit_range, prepare};
use crate::verify::{Candidate, fit, judge, rank};
use crate::{icp, metrics, ndt, ransac, scale};

/// Told of each stage by name, as it begins (with `None`) and as it ends.
pub type Progress<'a> = dyn Fn(&str, Option<&Stage>) + Sync + 'a;

/// What a run is asked besides its configuration.
#[derive(Clone, Copy, Default)]
pub struct Request<'a> {
    /// How to look.
    pub method: Method,
    /// Where `ndt+icp` starts; the identity where there is none.
    pub initial: Option<Pose>,
    /// Both clouds have z up to within [`GRAVITY_TOLERANCE`]: poses that tilt more are not pursued.
    pub gravity_aligned: bool,
    /// The query's centroid is known to lie in this ball of the map.
    pub near: Option<Near>,
    /// Who wants to follow.
    pub progress: Option<&'a Progress<'a>>,
}

/// How far from upright a gravity-aligned pose may tilt, radians (10°).
pub const GRAVITY_TOLERANCE: f64 = 0.174_532_925;

/// A ball in the map's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Near {
    /// Its centre, metres.
    pub centre: [f64; 3],
    /// Its radius, metres.
    pub radius: f64,
}

impl Near {
    /// The part of `map` that a query can touch: the ball, widened by the query's own reach.
    fn crop(&self, map: &Cloud, query: &Cloud) -> Cloud {
        let reach = query.bounds(0.0).map_or(0.0, |(low, high)| {
            (0..3)
                .map(|a| (high[a] - low[a]) * (high[a] - low[a]))
                .sum::<f64>()
                .sqrt()
        });
        map.select(&within_range(map, self.centre, 0.0, self.radius + reach))
    }

    fn holds(&self, p: [f64; 3]) -> bool {
        (0..3)
            .map(|a| (p[a] - self.centre[a]) * (p[a] - self.centre[a]))
            .sum::<f64>()
            <= self.radius * self.radius
    }
}

impl Request<'_> {
    /// Whether what is known beforehand speaks for a pose that puts the query's centroid there.
    fn plausible(&self, pose: &Pose, centroid: [f64; 3]) -> bool {
        let upright = !self.gravity_aligned
            || pose.rotate([0.0, 0.0, 1.0])[2] >= libm::cos(GRAVITY_TOLERANCE);
        upright
            && self
                .near
                .is_none_or(|near| near.holds(pose.transform(centroid)))
    }
}

/// Finds `query` in `map` by the method `auto`, with no initial guess.
///
/// # Errors
/// [`Error::Config`] for a value outside its domain, [`Error::EmptyMap`] for a map without usable
/// points. A query that cannot be found is no error but a [`Verdict`].
pub fn locate(map: &Cloud, query: &Cloud, config: &Config) -> Result<Outcome> {
    locate_by(map, query, config, &Request::default())
}

/// Finds `query` in `map` by any method.
///
/// # Errors
/// As [`locate`].
pub fn locate_by(
    map: &Cloud,
    query: &Cloud,
    config: &Config,
    request: &Request<'_>,
) -> Result<Outcome> {
    config.validate()?;
    let mut run = Run {
        config,
        request,
        begun: Instant::now(),
        stages: Vec::new(),
    };
    let limited = limit_range(query, &config.prepare);
    let cropped = request.near.map(|near| near.crop(map, &limited));
    let (whole_map, map) = (map, cropped.as_ref().unwrap_or(map));
    let sizes = run.stage("measure scale", map.len() + query.len(), || {
        let sizes = sizes(map, &limited, config, request.method);
        let n = sizes.as_ref().map_or(0, Vec::len);
        (sizes, n)
    })?;
    let mut best: Option<Attempt> = None;
    for voxel in sizes {
        let attempt = run.attempt(map, &limited, voxel)?;
        let settled = attempt.verdict != Verdict::NotFound;
        if best.as_ref().is_none_or(|b| attempt.better_than(b)) {
            best = Some(attempt);
        }
        if settled {
            break;
        }
    }
    Ok(run.outcome(whole_map, query, best))
}

/// Voxel sizes to try: the one that was set, else those that the data suggest. Only `auto` tries
/// more than one. Empty where the query has no two distinct points.
fn sizes(map: &Cloud, query: &Cloud, config: &Config, method: Method) -> Result<Vec<f64>> {
    if config.scale.voxel > 0.0 {
        return Ok(vec![config.scale.voxel]);
    }
    let map_measure = scale::measure(map).ok_or(Error::EmptyMap {
        points: map.len().min(1),
    })?;
    let tries = if method == Method::Auto {
        config.scale.tries
    } else {
        1
    };
    Ok(scale::measure(query).map_or_else(Vec::new, |m| scale::candidates(&map_measure, &m, tries)))
}

/// What one voxel size gave.
struct Attempt {
    voxel: f64,
    verdict: Verdict,
    reason: String,
    unobservable: Option<Vec<crate::degeneracy::Unobservable>>,
    ranked: Vec<Candidate>,
}

impl Attempt {
    fn insufficient(voxel: f64, reason: String) -> Self {
        Self {
            voxel,
            verdict: Verdict::Insufficient,
            reason,
            unobservable: None,
            ranked: Vec::new(),
        }
    }

    fn better_than(&self, other: &Self) -> bool {
        let key = |a: &Self| {
            let settled = a.verdict != Verdict::NotFound && a.verdict != Verdict::Insufficient;
            (settled, a.ranked.first().map_or(-1.0, |c| c.fit.fitness))
        };
        key(self) > key(other)
    }
}

struct Run<'a> {
    config: &'a Config,
    request: &'a Request<'a>,
    begun: Instant,
    stages: Vec<Stage>,
}

impl Run<'_> {
    fn attempt(&mut self, map: &Cloud, query: &Cloud, voxel: f64) -> Result<Attempt> {
        let config = self.config;
        let surface = |c: &Cloud| {
            let s = prepare(c, &config.prepare, voxel);
            let n = s.points.len();
            (s, n)
        };
        let map = self.stage("prepare map", map.len(), || surface(map));
        if map.points.len() < config.verify.min_points {
            return Err(Error::EmptyMap {
                points: map.points.len(),
            });
        }
        let query = self.stage("prepare query", query.len(), || surface(query));
        let with_normal = query.normals.iter().filter(|n| **n != [0.0; 3]).count();
        if with_normal < config.verify.min_points {
            let reason = format!(
                "{with_normal} of the query's points are left with a surface normal at a voxel size of {voxel:.3} m; at least {} are needed",
                config.verify.min_points
            );
            return Ok(Attempt::insufficient(voxel, reason));
        }
        let starts = if self.request.method.uses_features() {
            self.hypotheses(&map, &query, voxel)
        } else {
            vec![self.request.initial.unwrap_or_default()]
        };
        let candidates = self.refine(&map, &query, &starts);
        let (ranked, (verdict, reason, unobservable)) =
            self.stage("verify", candidates.len(), || {
                let ranked = rank(candidates, &query, &config.verify, voxel);
                let judged = judge(&ranked, &map, &query, &config.verify);
                let n = ranked.len();
                ((ranked, judged), n)
            });
        Ok(Attempt {
            voxel,
            verdict,
            reason,
            unobservable,
            ranked,
        })
    }

    /// Describe, match, estimate.
    fn hypotheses(&mut self, map: &Surface, query: &Surface, voxel: f64) -> Vec<Pose> {
        let config = self.config;
        let features = |s: &Surface| {
            let f = describe(s, config);
            let n = f.points.len();
            (f, n)
        };
        let map_features: Features = self.stage("describe map", map.points.len(), || features(map));
        let query_features: Features =
            self.stage("describe query", query.points.len(), || features(query));
        let correspondences = self.stage("match", query_features.points.len(), || {
            let c = match_descriptors(
                &query_features.descriptors,
                &map_features.descriptors,
                &config.matching,
            );
            let n = c.len();
            (c, n)
        });
        let (request, centroid) = (self.request, query.centroid().unwrap_or_default());
        let estimate = self.stage("estimate", correspondences.len(), || {
            let e = ransac::estimate(
                &correspondences,
                &query_features,
                &map_features,
                &config.ransac,
                voxel,
                config.seed,
                &|pose| request.plausible(pose, centroid),
            );
            let n = e.hypotheses.len();
            (e, n)
        });
        let keep = if self.request.method == Method::Auto {
            usize::MAX
        } else {
            1
        };
        estimate
            .hypotheses
            .iter()
            .take(keep)
            .map(|h| h.map_from_query)
            .collect()
    }

    /// The method's refiners on every start that a first look leaves in the race.
    fn refine(&mut self, map: &Surface, query: &Surface, starts: &[Pose]) -> Vec<Candidate> {
        let config = self.config;
        let method = self.request.method;
        let judged = |pose: Pose| Candidate {
            map_from_query: pose,
            fit: fit(map, query, &pose, &config.verify),
        };
        let mut poses = starts.to_vec();
        if poses.len() > config.verify.refined {
            poses = self.stage("shortlist", poses.len(), || {
                let mut coarse: Vec<Candidate> = poses.iter().map(|p| judged(*p)).collect();
                coarse.sort_by(|a, b| b.fit.inlier_fraction.total_cmp(&a.fit.inlier_fraction));
                let kept: Vec<Pose> = coarse
                    .iter()
                    .take(config.verify.refined)
                    .map(|c| c.map_from_query)
                    .collect();
                let n = kept.len();
                (kept, n)
            });
        }
        if method.uses_ndt() && !poses.is_empty() {
            poses = self.stage("refine by NDT", poses.len(), || {
                let levels: Vec<NdtCells> = ndt::levels(map, &config.ndt);
                let refined: Vec<Pose> = poses
                    .iter()
                    .map(|p| ndt::align(&levels, map, query, p, &config.ndt).map_from_query)
                    .collect();
                let n = refined.len();
                (refined, n)
            });
        }
        if method.uses_icp() && !poses.is_empty() {
            let icp_config = if method == Method::Auto {
                IcpConfig {
                    metric: IcpMetric::PointToPlane,
                    ..config.icp.clone()
                }
            } else {
                config.icp.clone()
            };
            poses = self.stage("refine by ICP", poses.len(), || {
                let refined: Vec<Pose> = poses
                    .iter()
                    .map(|p| icp::align(map, query, p, &icp_config).map_from_query)
                    .collect();
                let n = refined.len();
                (refined, n)
            });
        }
        poses.into_iter().map(judged).collect()
    }

    fn outcome(mut self, map: &Cloud, query: &Cloud, best: Option<Attempt>) -> Outcome {
        let verify = &self.config.verify;
        let best = best.unwrap_or_else(|| {
            Attempt::insufficient(
                0.0,
                format!(
                    "the query has {} usable points, no two of them apart",
                    query.len()
                ),
            )
        });
        let pose = best.ranked.first().map(|c| c.map_from_query);
        let inliers = pose.map(|pose| {
            self.stage("metrics", query.len(), || {
                let tree = KdTree::build(map.points());
                (
                    metrics::inliers(&tree, map.origin(), query, &pose, verify.inlier_distance),
                    query.len(),
                )
            })
        });
        let finite = |v: f64| v.is_finite().then_some(v);
        Outcome {
            verdict: best.verdict,
            reason: best.reason,
            confidence: None,
            map_from_query: pose,
            covariance: None,
            covariance_at: pose.and_then(|p| query.centroid().map(|c| p.transform(c))),
            unobservable: best.unobservable,
            hypotheses: best
                .ranked
                .iter()
                .map(|c| RankedHypothesis {
                    map_from_query: c.map_from_query,
                    score: c.fit.fitness,
                    median_point_to_plane: finite(c.fit.median_point_to_plane),
                    inlier_fraction: c.fit.inlier_fraction,
                    overlap: c.fit.overlap,
                })
                .collect(),
            inlier_fraction: inliers.map(|m| m.fraction),
            inlier_rmse: inliers.map(|m| m.rmse),
            inlier_distance: verify.inlier_distance,
            inlier_reference: "map as read",
            voxel: (best.voxel > 0.0).then_some(best.voxel),
            stages: self.stages,
            seconds: self.begun.elapsed().as_secs_f64(),
            method: self.request.method.name(),
            seed: self.config.seed,
            map_points: map.len(),
            query_points: query.len(),
        }
    }

    /// Runs one stage, timed and told; `work` answers its result and how many things came out.
    fn stage<T>(&mut self, name: &str, count_in: usize, work: impl FnOnce() -> (T, usize)) -> T {
        if let Some(progress) = self.request.progress {
            progress(name, None);
        }
        let begun = Instant::now();
        let (result, count_out) = work();
        let stage = Stage {
            name: name.into(),
            seconds: begun.elapsed().as_secs_f64(),
            count_in,
            count_out,
        };
        if let Some(progress) = self.request.progress {
            progress(name, Some(&stage));
        }
        self.stages.push(stage);
        result
    }
}
