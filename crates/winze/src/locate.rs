//! The main path: the whole pipeline on one page.
//!
//! ```text
//! cloud ─prepare─> Surface ─describe─> Features ─match─> correspondences ─estimate─> hypotheses
//!                                                            refine (NDT, ICP) ─> candidates
//!                                                                     verify, judge ─> Outcome
//! ```

use std::time::Instant;

use rayon::prelude::*;

use crate::cancel;
use crate::cloud::Cloud;
use crate::confidence::confidence;
use crate::config::{Config, IcpConfig, IcpMetric, MatchingConfig, VerifyConfig};
use crate::covariance::{self, Covariance};
use crate::error::{Error, Result};
use crate::features::Features;
use crate::judge::{Judgement, insufficient};
use crate::kept::{KeptMap, KeptQuery, MapAt, QueryAt};
use crate::matching::match_descriptors;
use crate::method::Method;
use crate::ndt::NdtCells;
use crate::outcome::{Outcome, RankedHypothesis, Stage, Verdict};
use crate::part::{Look, Trail};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::keep_better;
use crate::region::Region;
use crate::verify::{Candidate, fit};
use crate::{graph, ransac, scale};

pub use crate::request::{GRAVITY_TOLERANCE, Near, Progress, Request};

/// Points that a map must have, before and after preparation.
const MIN_MAP_POINTS: usize = 100;

/// Finds `query` in `map` by the method `auto`, with no initial guess.
///
/// # Errors
/// [`Error::Config`] for a value outside its domain, [`Error::EmptyMap`] for a map without usable
/// points, [`Error::EmptyRegion`] where none of them lies near the region asked for. A query that cannot be found is no error but a [`Verdict`].
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
    let mut map = KeptMap::once(map);
    locate_in(&mut map, &mut KeptQuery::once(query), config, request)
}

/// Finds `query` in `map` by any method, and keeps the work on both for the next question: the
/// same answer as [`locate_by`]'s, sooner. A stage whose work was kept takes no time.
///
/// # Errors
/// As [`locate`].
pub fn locate_in(
    map: &mut KeptMap<'_>,
    query: &mut KeptQuery<'_>,
    config: &Config,
    request: &Request<'_>,
) -> Result<Outcome> {
    Ok(locate_traced(map, query, config, request)?.0)
}

/// As [`locate_in`], and where the run looked: what a [`MapPart`](crate::part::MapPart) is cut by.
///
/// # Errors
/// As [`locate`].
pub fn locate_traced(
    map: &mut KeptMap<'_>,
    query: &mut KeptQuery<'_>,
    config: &Config,
    request: &Request<'_>,
) -> Result<(Outcome, Trail)> {
    config.validate()?;
    let mut run = Run {
        config,
        request,
        begun: Instant::now(),
        centroid: query.cloud().centroid().unwrap_or_default(),
        width: None,
        map_seconds: 0.0,
        stages: Vec::new(),
        trail: Trail::default(),
    };
    if map.points() < MIN_MAP_POINTS {
        return Err(Error::EmptyMap {
            points: map.points(),
        });
    }
    map.settle(config)?;
    query.settle(config);
    let sizes = run.sizes(map, query).ok_or(Error::EmptyMap { points: 1 })?;
    let best = match sizes.first() {
        None => None,
        Some(_) if request.method == Method::Auto => Some(run.search(map, query, &sizes)?),
        Some(&voxel) => Some(run.attempt(map, query, voxel)?),
    };
    let best = best.unwrap_or_else(|| {
        let usable = query.limited(config).len();
        let reason = format!(
            "the query has {usable} usable points{}, no two of them apart",
            if usable < query.cloud().len() {
                " within the range limits"
            } else {
                ""
            }
        );
        Attempt::refused(0.0, Judgement::refused(Verdict::Insufficient, reason))
    });
    run.outcome(map, query, best)
}

/// What one voxel size gave.
pub(crate) struct Attempt {
    pub(crate) voxel: f64,
    pub(crate) judgement: Judgement,
    pub(crate) ranked: Vec<Candidate>,
}

impl Attempt {
    /// The last answer that any voxel size gave.
    pub(crate) fn last(answer: Option<Self>) -> Self {
        answer.unwrap_or_else(|| {
            let reason = "no voxel size suits map and query".into();
            Self::refused(0.0, Judgement::refused(Verdict::Insufficient, reason))
        })
    }

    pub(crate) fn refused(voxel: f64, judgement: Judgement) -> Self {
        Self {
            voxel,
            judgement,
            ranked: Vec::new(),
        }
    }
}

pub(crate) struct Run<'a> {
    pub(crate) config: &'a Config,
    pub(crate) request: &'a Request<'a>,
    begun: Instant,
    /// The query's, of all its points: what a region is asked for.
    pub(crate) centroid: [f64; 3],
    /// How wide the map's passages are, metres, where that was measured.
    width: Option<f64>,
    /// Spent on the map alone.
    map_seconds: f64,
    stages: Vec<Stage>,
    pub(crate) trail: Trail,
}

impl Run<'_> {
    /// Voxel sizes to try: the one that was set, else the map's own, the best for the query first. Only `auto` tries
    /// more than one. Empty where the query has no two distinct points, `None` where the map has none.
    fn sizes(&mut self, map: &mut KeptMap<'_>, query: &mut KeptQuery<'_>) -> Option<Vec<f64>> {
        let config = self.config;
        if config.scale.voxel > 0.0 {
            return Some(vec![config.scale.voxel]);
        }
        let map_measure = self.map_stage("measure map", map.points(), || {
            let measure = map.measure(config);
            (measure, usize::from(measure.is_some()))
        })?;
        self.width = map_measure.width;
        let points = query.limited(config).len();
        let query_measure = self.stage("measure query", points, || {
            let measure = query.measure(config);
            (measure, usize::from(measure.is_some()))
        });
        let tries = if self.request.method == Method::Auto {
            config.scale.tries
        } else {
            1
        };
        let voxels = map.voxels(&map_measure);
        let chosen = query_measure.map_or_else(Vec::new, |query| {
            scale::choose(&voxels, &map_measure, &query, tries)
        });
        Some(chosen.into_iter().map(|i| voxels[i]).collect())
    }

    /// How far off a pose that is yet to be refined may be, metres.
    fn unrefined(&self, voxel: f64) -> f64 {
        self.config.verify.first_look_distance.metres(voxel)
    }

    /// Whether what is known beforehand allows a refined pose.
    pub(crate) fn plausible(&self, candidate: &Candidate) -> bool {
        let pose = &candidate.map_from_query;
        self.request.plausible(pose, self.centroid, 0.0)
    }

    /// How a pose is verified at a voxel size.
    pub(crate) fn verify_at(&self, voxel: f64) -> VerifyConfig {
        self.config.verify.at(voxel, self.width)
    }

    /// Refined poses at one voxel size, or the verdict where there is nothing to refine. `last`: nothing finer follows.
    pub(crate) fn candidates(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        voxel: f64,
        last: bool,
    ) -> Result<std::result::Result<Vec<Candidate>, Judgement>> {
        let (config, request) = (self.config, self.request);
        let verify = &config.verify;
        let limited = query.limited(config);
        let points = limited.len();
        let region = request.near.map(|near| Region {
            near,
            reach: near.reach(limited, self.centroid) + self.unrefined(voxel),
        });
        let query_at = self.stage("prepare query", points, || {
            let at = query.at(voxel, config);
            let n = at.surface.points.len();
            (at, n)
        });
        // Nothing need be done on the map for a query that is too poor to look for.
        if let Some(judgement) = insufficient(&query_at.surface, verify) {
            return Ok(Err(judgement));
        }
        let map_at = self.prepared_map(map, voxel)?;
        if map_at.len() < MIN_MAP_POINTS {
            let reason = format!(
                "the map has {} points at a voxel size of {voxel:.3} m, too few to compare with",
                map_at.len()
            );
            return Ok(Err(Judgement::refused(Verdict::NotFound, reason)));
        }
        let begun = self.stages.len();
        let starts = match map_at.recalled()? {
            Some(look) => self.recall(look),
            None => self.starts(map_at, query_at, voxel, region)?,
        };
        self.trail.found(voxel, &self.stages[begun..], &starts);
        query_at.refine_on(map_at);
        let mut candidates = if request.method == Method::Auto {
            self.race(map_at, query_at, &starts, verify, last)?
        } else {
            self.refine(map_at, query_at, &starts, verify)?
        };
        self.trail
            .led_to
            .extend(candidates.iter().map(|c| c.map_from_query));
        let found = candidates.len();
        // Refinement may have led a pose away from what is known beforehand.
        candidates.retain(|c| self.plausible(c));
        if found > 0 && candidates.is_empty() {
            return Ok(Err(Judgement::none_found(true)));
        }
        Ok(Ok(candidates))
    }

    /// The map at a voxel size.
    pub(crate) fn prepared_map<'m, 'a>(
        &mut self,
        map: &'m mut KeptMap<'a>,
        voxel: f64,
    ) -> Result<&'m mut MapAt<'a>> {
        let config = self.config;
        self.trail.asked(voxel);
        self.map_stage("prepare map", map.points(), || {
            let at = map.at(voxel, config);
            let n = at.as_ref().map_or(0, |at| at.len());
            (at, n)
        })
    }

    /// Poses to refine, from the whole map, those that a first look leaves in the race.
    fn starts(
        &mut self,
        map: &mut MapAt<'_>,
        query: &mut QueryAt,
        voxel: f64,
        region: Option<Region>,
    ) -> Result<Vec<Pose>> {
        if let Some(region) = region {
            region.check(&map.surface)?;
        }
        let request = self.request;
        if !request.method.uses_features() {
            return Ok(vec![request.initial.unwrap_or_default()]);
        }
        let starts = self.hypotheses(map, query, voxel, region)?;
        let (map, query) = (&map.surface, &query.surface);
        let verify = &self.config.verify;
        Ok(if request.method == Method::Auto {
            self.fittest(map, query, starts, verify)
        } else {
            self.first_and_fittest(map, query, starts, verify)
        })
    }

    /// Of some poses, `most` of them: the first few, which stay whatever they look like, and those of the others at which most of the query lies near
    /// the map.
    pub(crate) fn shortlist(
        &mut self,
        map: &Surface<'_>,
        query: &Surface<'_>,
        poses: &[Pose],
        verify: &VerifyConfig,
        (stay, most): (usize, usize),
    ) -> Vec<Pose> {
        let first_look = VerifyConfig {
            overlap_distance: verify.first_look_distance,
            ..verify.clone()
        };
        self.stage("shortlist", poses.len(), || {
            let look = |p: &Pose| fit(map, query, p, &first_look).overlap;
            let overlap: Vec<f64> = poses.par_iter().map(look).collect();
            let mut order: Vec<usize> = (0..poses.len()).collect();
            order[stay..].sort_by(|&a, &b| overlap[b].total_cmp(&overlap[a]));
            order.truncate(most);
            let kept: Vec<Pose> = order.into_iter().map(|i| poses[i]).collect();
            let n = kept.len();
            (kept, n)
        })
    }

    /// The Gaussians of a map, and its surface.
    pub(crate) fn cells<'m, 'a>(
        &mut self,
        map: &'m mut MapAt<'a>,
    ) -> Result<(&'m [NdtCells<'a>], &'m Surface<'a>)> {
        let (config, points) = (self.config, map.len());
        let whole = map.counted();
        let made = self.map_stage("make NDT cells", points, || {
            let cells = map.cells(config);
            let count = |(levels, _): &(&[NdtCells<'_>], _)| levels.iter().map(NdtCells::len).sum();
            let made = cells.as_ref().map_or(0, count);
            let n = whole.unwrap_or(made);
            (cells.map(|cells| (cells, n)), n)
        });
        let (cells, n) = made?;
        self.trail.made(n);
        Ok(cells)
    }

    /// The same from what an earlier run found on the whole map.
    fn recall(&mut self, look: &Look) -> Vec<Pose> {
        for stage in &look.stages {
            self.stage(&stage.name, stage.count_in, || ((), stage.count_out));
        }
        look.starts.clone()
    }

    /// Describe, match, estimate.
    fn hypotheses(
        &mut self,
        map: &mut MapAt<'_>,
        query: &mut QueryAt,
        voxel: f64,
        region: Option<Region>,
    ) -> Result<Vec<Pose>> {
        let config = self.config;
        self.map_stage("describe map", map.surface.points.len(), || {
            let described = map.describe(config).map(|(f, _)| f.points.len());
            let n = described.as_ref().copied().unwrap_or_default();
            (described, n)
        })?;
        let keypoints = self.stage("describe query", query.surface.points.len(), || {
            let n = query.describe(config).points.len();
            (n, n)
        });
        let cut = match region {
            Some(region) => Some(region.cut(&map.describe(config)?.0)),
            None => None,
        };
        let matching = if self.request.method == Method::Auto {
            MatchingConfig {
                neighbours: config.graph.neighbours,
                mutual: false,
                ratio: 1.0,
            }
        } else {
            config.matching.clone()
        };
        let correspondences = self.stage("match", keypoints, || {
            let matches = match &cut {
                Some(cut) => {
                    let own = query.describe(config);
                    Ok(match_descriptors(
                        &own.descriptors,
                        &cut.descriptors,
                        &matching,
                    ))
                }
                None => query.matches(map, config, &matching).map(<[_]>::to_vec),
            };
            let n = matches.as_ref().map_or(0, Vec::len);
            (matches, n)
        })?;
        query.describe(config);
        map.describe(config)?;
        let (map, query) = (&*map, &*query);
        let nothing = Features::default();
        let map_features = cut.as_ref().or(map.described()).unwrap_or(&nothing);
        let query_features = query.described().unwrap_or(&nothing);
        let request = self.request;
        let unrefined = self.unrefined(voxel);
        let centroid = self.centroid;
        let plausible = |p: &Pose| request.plausible(p, centroid, unrefined);
        if request.method == Method::Auto {
            return Ok(self.stage("estimate", correspondences.len(), || {
                let pairs = graph::oriented(
                    &correspondences,
                    (query_features, &query.surface),
                    (map_features, &map.surface),
                    config.graph.max_pairs,
                );
                let (outer, inner) = (map_features.origin, query_features.origin);
                let plausible = |p: &Pose| plausible(&p.from_between_origins(outer, inner));
                let found: Vec<Pose> = graph::poses(&pairs, &config.graph, voxel, &plausible)
                    .iter()
                    .map(|h| h.map_from_query.from_between_origins(outer, inner))
                    .collect();
                let n = found.len();
                (found, n)
            }));
        }
        let estimate = self.stage("estimate", correspondences.len(), || {
            let e = ransac::estimate(
                &correspondences,
                query_features,
                map_features,
                &config.ransac,
                voxel,
                config.seed,
                &plausible,
            );
            let n = e.hypotheses.len();
            (e, n)
        });
        Ok(estimate
            .hypotheses
            .iter()
            .map(|h| h.map_from_query)
            .collect())
    }

    /// The covariance at the pose answered, about the query's centroid.
    fn covariance(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        best: &Attempt,
    ) -> Result<Option<Covariance>> {
        let (Some(lead), Some(open)) = (best.ranked.first(), &best.judgement.unobservable) else {
            return Ok(None);
        };
        let config = self.config;
        let verify = self.verify_at(best.voxel);
        let at = lead.map_from_query.transform(self.centroid);
        let map = map.at(best.voxel, config)?;
        let query = query.at(best.voxel, config);
        Ok(self.stage("covariance", query.surface.points.len(), || {
            let estimated = covariance::estimate(
                &map.surface,
                &query.surface,
                &lead.map_from_query,
                open,
                &verify,
                &config.odometry,
                lead.relief.and_then(|r| r.beyond),
            );
            let n = usize::from(estimated.is_some());
            (estimated.map(|c| c.about(at)), n)
        }))
    }

    fn outcome(
        mut self,
        map: &mut KeptMap<'_>,
        kept: &mut KeptQuery<'_>,
        best: Attempt,
    ) -> Result<(Outcome, Trail)> {
        let covariance = self.covariance(map, kept, &best)?;
        let query = kept.cloud();
        let verify = &self.config.verify;
        let pose = best.ranked.first().map(|c| c.map_from_query);
        let inliers = match pose {
            Some(pose) => {
                self.map_stage("build map tree", map.points(), || {
                    let made = map.reference();
                    let n = made.as_ref().copied().unwrap_or_default();
                    (made, n)
                })?;
                Some(self.stage("metrics", query.len(), || {
                    (map.inliers(query, &pose, verify), query.len())
                })?)
            }
            None => None,
        };
        let finite = |v: f64| v.is_finite().then_some(v);
        let weighed = best.ranked.iter().map(|c| c.map_from_query);
        self.trail.led_to.extend(weighed);
        let outcome = Outcome {
            verdict: best.judgement.verdict,
            reason: best.judgement.reason,
            confidence: best.ranked.first().and_then(|lead| {
                confidence(
                    self.request.method,
                    best.judgement.verdict,
                    lead.relief,
                    best.judgement.unobservable.is_some(),
                    self.config,
                )
            }),
            map_from_query: pose,
            covariance: covariance.map(|c| c.matrix),
            covariance_at: pose.map(|p| p.transform(self.centroid)),
            unobservable: best.judgement.unobservable,
            information: best.judgement.information,
            hypotheses: best
                .ranked
                .iter()
                .enumerate()
                .map(|(i, c)| RankedHypothesis {
                    map_from_query: c.map_from_query,
                    score: c.fit.fitness,
                    median_point_to_plane: finite(c.fit.median_point_to_plane),
                    inlier_fraction: c.fit.inlier_fraction,
                    overlap: c.fit.overlap,
                    relief: c.relief,
                    rival: best.judgement.rivals.contains(&i),
                    stop: c.stop,
                })
                .collect(),
            inlier_fraction: inliers.map(|m| m.fraction),
            inlier_rmse: inliers.and_then(|m| m.rmse),
            inlier_distance: verify.inlier_distance,
            inlier_reference: map.inlier_reference(),
            voxel: (best.voxel > 0.0).then_some(best.voxel),
            stages: self.stages,
            seconds: self.begun.elapsed().as_secs_f64(),
            map_seconds: self.map_seconds,
            method: self.request.method.name(),
            seed: self.config.seed,
            map_points: map.points(),
            query_points: query.len(),
        };
        Ok((outcome, self.trail))
    }

    /// Runs a stage that looks at the map alone.
    pub(crate) fn map_stage<T>(
        &mut self,
        name: &str,
        count_in: usize,
        work: impl FnOnce() -> (T, usize),
    ) -> T {
        let result = self.stage(name, count_in, work);
        self.map_seconds += self.stages.last().map_or(0.0, |s| s.seconds);
        result
    }

    /// Runs one stage, timed and told; `work` answers its result and how many things came out.
    pub(crate) fn stage<T>(
        &mut self,
        name: &str,
        count_in: usize,
        work: impl FnOnce() -> (T, usize),
    ) -> T {
        cancel::check();
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

/// What a refiner led to, or, where a `guard` is set, the finer of that and what it began with.
pub(crate) fn guarded(
    guard: bool,
    before: impl FnOnce() -> Candidate,
    after: Candidate,
    map: &Surface<'_>,
    query: &Surface<'_>,
    verify: &VerifyConfig,
) -> Candidate {
    if guard {
        keep_better(map, query, before(), after, verify)
    } else {
        after
    }
}

pub(crate) fn point_to_plane(config: &IcpConfig) -> IcpConfig {
    IcpConfig {
        metric: IcpMetric::PointToPlane,
        ..config.clone()
    }
}

#[cfg(test)]
mod tests;
