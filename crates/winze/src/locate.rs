//! The main path: the whole pipeline on one page.
//!
//! ```text
//! cloud ─prepare─> Surface ─describe─> Features ─match─> correspondences ─estimate─> hypotheses
//!                                                            refine (NDT, ICP) ─> candidates
//!                                                                     verify, judge ─> Outcome
//! ```

use std::time::Instant;

use rayon::prelude::*;

use crate::cloud::Cloud;
use crate::config::{Config, IcpConfig, IcpMetric, Length, MatchingConfig, VerifyConfig};
use crate::error::{Error, Result};
use crate::features::Features;
use crate::judge::{Judgement, insufficient, judge, judge_against};
use crate::kept::{KeptMap, KeptQuery, MapAt, QueryAt, Refiner};
use crate::matching::match_descriptors;
use crate::method::Method;
use crate::ndt::NdtCells;
use crate::outcome::{Outcome, RankedHypothesis, Stage, Verdict};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{Refined, StopReason, keep_better};
use crate::region::Region;
use crate::verify::{Candidate, Fit, ask_relief, candidate, fit, hopeful, rank, same_place};
use crate::{graph, icp, ndt, ransac, scale};

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
    config.validate()?;
    let mut run = Run {
        config,
        request,
        begun: Instant::now(),
        width: None,
        map_seconds: 0.0,
        stages: Vec::new(),
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
    run.outcome(map, query.cloud(), best)
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
    /// How wide the map's passages are, metres, where that was measured.
    width: Option<f64>,
    /// Spent on the map alone.
    map_seconds: f64,
    stages: Vec<Stage>,
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

    /// How a pose is verified at a voxel size: patches of wall are no smaller than a share of the passages' width.
    pub(crate) fn verify_at(&self, voxel: f64) -> VerifyConfig {
        let verify = &self.config.verify;
        let (size, step) = (
            verify.patch_size.metres(voxel),
            verify.patch_step.metres(voxel),
        );
        let wider = (self.width.unwrap_or(0.0) * verify.patch_width / size).max(1.0);
        VerifyConfig {
            patch_size: Length::Metres(size * wider),
            patch_step: Length::Metres(step * wider),
            piece_size: Length::Metres(verify.piece_size.metres(voxel) * wider),
            ..verify.clone()
        }
    }

    /// One of the paper's methods at one voxel size.
    fn attempt(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        voxel: f64,
    ) -> Result<Attempt> {
        let verify = &self.verify_at(voxel);
        let candidates = match self.candidates(map, query, voxel, true)? {
            Ok(candidates) => candidates,
            Err(judgement) => return Ok(Attempt::refused(voxel, judgement)),
        };
        let map = map.at(voxel, self.config)?;
        let (map, query) = (&map.surface, query.at(voxel, self.config));
        let (ranked, judgement) = match candidates[..] {
            [lead, _, ..] => self.weigh_rivals(map, query, lead, &candidates, verify),
            _ => self.stage("verify", candidates.len(), || {
                let mut ranked = candidates;
                ask_relief(&mut ranked, map, &query.surface, verify, None);
                let judgement = judge(&ranked, map, &query.surface, verify);
                let n = ranked.len();
                ((ranked, judgement), n)
            }),
        };
        Ok(Attempt {
            voxel,
            judgement,
            ranked,
        })
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
            reach: near.reach(limited),
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
        let map_at = self.map_stage("prepare map", map.points(), || {
            let at = map.at(voxel, config);
            let n = at.as_ref().map_or(0, |at| at.surface.points.len());
            (at, n)
        })?;
        if map_at.surface.points.len() < MIN_MAP_POINTS {
            let reason = format!(
                "the map has {} points at a voxel size of {voxel:.3} m, too few to compare with",
                map_at.surface.points.len()
            );
            return Ok(Err(Judgement::refused(Verdict::NotFound, reason)));
        }
        if let Some(region) = region {
            region.check(&map_at.surface)?;
        }
        let starts = if request.method.uses_features() {
            self.hypotheses(map_at, query_at, voxel, region)?
        } else {
            vec![request.initial.unwrap_or_default()]
        };
        query_at.refine_on(map_at);
        let mut candidates = if request.method == Method::Auto {
            self.race(map_at, query_at, &starts, verify, last)?
        } else {
            self.refine(map_at, query_at, &starts, verify)?
        };
        let found = candidates.len();
        // Refinement may have led a pose away from what is known beforehand.
        let centroid = query_at.surface.centroid().unwrap_or_default();
        candidates.retain(|c| request.plausible(&c.map_from_query, centroid));
        if found > 0 && candidates.is_empty() {
            let reason = "no pose found agrees with the region or the attitude asked for".into();
            return Ok(Err(Judgement::refused(Verdict::NotFound, reason)));
        }
        Ok(Ok(candidates))
    }

    /// The paper's methods answer with the pose that most correspondences support, as it leaves their
    /// last stage. Whether its place has rivals is asked of all candidates refined alike.
    fn weigh_rivals(
        &mut self,
        map: &Surface<'_>,
        query: &QueryAt,
        lead: Candidate,
        candidates: &[Candidate],
        verify: &VerifyConfig,
    ) -> (Vec<Candidate>, Judgement) {
        let (query, known) = (&query.surface, &query.refinements);
        let icp_config = point_to_plane(&self.config.icp);
        let refiner = Refiner::Icp(icp_config.metric);
        let candidate =
            |r: &Refined| candidate(map, query, &r.map_from_query, Some(r.stop), verify);
        let mut refined = self.stage("refine rivals", candidates.len(), || {
            let refined: Vec<Candidate> = candidates
                .par_iter()
                .map(|c| {
                    let refined = known.get(refiner, &c.map_from_query, || {
                        icp::align(map, query, &c.map_from_query, &icp_config)
                    });
                    let after = candidate(&refined);
                    // A rival is owed what the lead got: its finer pose.
                    guarded(icp_config.keep_better, || *c, after, map, query, verify)
                })
                .collect();
            let n = refined.len();
            (refined, n)
        });
        let (request, centroid) = (self.request, query.centroid().unwrap_or_default());
        self.stage("verify", refined.len(), || {
            let own = refined.remove(0);
            let at_home = |c: &Candidate| {
                [&lead, &own]
                    .iter()
                    .any(|o| same_place(c, o, query, verify, map.voxel))
            };
            let finest = refined
                .iter()
                .filter(|c| at_home(c))
                .chain([&lead, &own])
                .map(|c| c.fit)
                .reduce(|a, b| Fit {
                    median_point_to_plane: a.median_point_to_plane.min(b.median_point_to_plane),
                    fitness: a.fitness.max(b.fitness),
                    ..a
                });
            refined.retain(|c| !at_home(c) && request.plausible(&c.map_from_query, centroid));
            let mut ranked = rank(refined, query, verify, map.voxel);
            // The rock is asked about the place, which an unrefined pose may miss by more than a patch bears.
            let mut home = [lead, own];
            ask_relief(&mut home, map, query, verify, None);
            let surest = |c: &Candidate| c.relief.map_or(f64::NEG_INFINITY, |r| r.significance());
            let [mut lead, own] = home;
            if surest(&own) > surest(&lead) && same_place(&lead, &own, query, verify, map.voxel) {
                lead.relief = own.relief;
            }
            ranked.insert(0, lead);
            ask_relief(&mut ranked, map, query, verify, None);
            let judgement = judge_against(&ranked, finest, map, query, verify);
            let n = ranked.len();
            ((ranked, judgement), n)
        })
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
        let centroid = query.surface.centroid().unwrap_or_default();
        query.describe(config);
        map.describe(config)?;
        let (map, query) = (&*map, &*query);
        let nothing = Features::default();
        let map_features = cut.as_ref().or(map.described()).unwrap_or(&nothing);
        let query_features = query.described().unwrap_or(&nothing);
        let request = self.request;
        if request.method == Method::Auto {
            return Ok(self.stage("estimate", correspondences.len(), || {
                let pairs = graph::oriented(
                    &correspondences,
                    (query_features, &query.surface),
                    (map_features, &map.surface),
                    config.graph.max_pairs,
                );
                let (outer, inner) = (map_features.origin, query_features.origin);
                let plausible =
                    |p: &Pose| request.plausible(&p.from_between_origins(outer, inner), centroid);
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
                &|pose| request.plausible(pose, centroid),
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

    /// The paper's refiners on every start that a first look leaves in the race; candidates come in
    /// the order of `starts`.
    fn refine(
        &mut self,
        map: &mut MapAt<'_>,
        query: &QueryAt,
        starts: &[Pose],
        verify: &VerifyConfig,
    ) -> Result<Vec<Candidate>> {
        let (config, method) = (self.config, self.request.method);
        let (query, known) = (&query.surface, &query.refinements);
        let mut poses: Vec<(Pose, Option<StopReason>)> =
            starts.iter().map(|p| (*p, None)).collect();
        if poses.len() > verify.refined {
            let first_look = VerifyConfig {
                overlap_distance: verify.first_look_distance,
                ..verify.clone()
            };
            poses = self.stage("shortlist", poses.len(), || {
                let overlap: Vec<f64> = poses
                    .iter()
                    .map(|(p, _)| fit(&map.surface, query, p, &first_look).overlap)
                    .collect();
                let mut order: Vec<usize> = (0..poses.len()).collect();
                // The first, on which the paper's methods build, stays whatever it looks like.
                order[1..].sort_by(|&a, &b| overlap[b].total_cmp(&overlap[a]));
                order.truncate(verify.refined);
                let kept: Vec<_> = order.into_iter().map(|i| poses[i]).collect();
                let n = kept.len();
                (kept, n)
            });
        }
        let candidates: Vec<Candidate> = if method.uses_ndt() && !poses.is_empty() {
            let (levels, map) =
                self.map_stage("make NDT cells", map.surface.points.len(), || {
                    let cells = map.cells(config);
                    let count =
                        |(levels, _): &(&[NdtCells<'_>], _)| levels.iter().map(NdtCells::len).sum();
                    let n = cells.as_ref().map_or(0, count);
                    (cells, n)
                })?;
            let candidate =
                |pose: &Pose, stop: Option<StopReason>| candidate(map, query, pose, stop, verify);
            // A start that no features found is a guess: far from the truth the residual says little.
            let guard = config.ndt.keep_better && method.uses_features();
            self.stage("refine by NDT", poses.len(), || {
                let refine = |(pose, stop): &(Pose, Option<StopReason>)| {
                    let refined = known.get(Refiner::Ndt, pose, || {
                        ndt::align(levels, map, query, pose, &config.ndt)
                    });
                    let after = candidate(&refined.map_from_query, Some(refined.stop));
                    guarded(guard, || candidate(pose, *stop), after, map, query, verify)
                };
                let refined: Vec<Candidate> = poses.par_iter().map(refine).collect();
                let n = refined.len();
                (refined, n)
            })
        } else {
            let place = |(pose, stop): &(Pose, Option<StopReason>)| {
                candidate(&map.surface, query, pose, *stop, verify)
            };
            poses.iter().map(place).collect()
        };
        let map = &map.surface;
        let candidate =
            |pose: &Pose, stop: Option<StopReason>| candidate(map, query, pose, stop, verify);
        if !method.uses_icp() || candidates.is_empty() {
            return Ok(candidates);
        }
        let icp_config = &config.icp;
        Ok(self.stage("refine by ICP", candidates.len(), || {
            let hopeful = hopeful(&candidates, verify);
            let polish = |(c, hopeful): (&Candidate, &bool)| {
                if !hopeful {
                    return *c;
                }
                let refiner = Refiner::Icp(icp_config.metric);
                let refined = known.get(refiner, &c.map_from_query, || {
                    icp::align(map, query, &c.map_from_query, icp_config)
                });
                let polished = candidate(&refined.map_from_query, Some(refined.stop));
                guarded(icp_config.keep_better, || *c, polished, map, query, verify)
            };
            let polished = candidates.par_iter().zip(&hopeful).map(polish).collect();
            (polished, hopeful.iter().filter(|h| **h).count())
        }))
    }

    fn outcome(mut self, map: &mut KeptMap<'_>, query: &Cloud, best: Attempt) -> Result<Outcome> {
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
        Ok(Outcome {
            verdict: best.judgement.verdict,
            reason: best.judgement.reason,
            confidence: None,
            map_from_query: pose,
            covariance: None,
            covariance_at: pose.and_then(|p| query.centroid().map(|c| p.transform(c))),
            unobservable: best.judgement.unobservable,
            information: best.judgement.information,
            hypotheses: best
                .ranked
                .iter()
                .map(|c| RankedHypothesis {
                    map_from_query: c.map_from_query,
                    score: c.fit.fitness,
                    median_point_to_plane: finite(c.fit.median_point_to_plane),
                    inlier_fraction: c.fit.inlier_fraction,
                    overlap: c.fit.overlap,
                    relief: c.relief,
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
        })
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
