//! The method `auto`: many hypotheses from all scales, weighed against each other at the finest one.
//!
//! ```text
//! for each voxel size, the best guess first:
//!     features ─graph─> hypotheses ─shortlist, NDT, ICP─> candidates ─┐
//!                                                                     v
//!     pool of distinct places <──polish, fit, ask the rock── at the finest size
//!     the rock confirms the best place beyond doubt? done
//! it confirms none: the pool again at coarser sizes, whose larger patches see past noise and bends
//! ```

use rayon::prelude::*;

use crate::config::{IcpConfig, NdtConfig, VerifyConfig};
use crate::error::Result;
use crate::judge::{Judgement, judge};
use crate::kept::{KeptMap, KeptQuery, MapAt, QueryAt};
use crate::locate::{Attempt, Run, guarded, point_to_plane};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::verify::{
    Candidate, beyond_doubt, by_evidence, candidate, confirmed, hopeful, rank, same_place,
};
use crate::{icp, ndt};

/// Times as many hypotheses begin with NDT as go on to ICP.
const SHORTLIST: usize = 2;
/// Query points that tell a place from no place.
const GLANCE: usize = 1_500;

impl Run<'_> {
    /// `sizes` are the voxel sizes to look at, the best guess first.
    pub(crate) fn search(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        sizes: &[f64],
    ) -> Result<Attempt> {
        let finest = sizes.iter().copied().fold(f64::INFINITY, f64::min);
        let mut pool: Vec<Candidate> = Vec::new();
        let mut answer: Option<Attempt> = None;
        let verify = self.verify_at(finest);
        for &voxel in sizes {
            let found = match self.candidates(map, query, voxel, voxel <= finest)? {
                Ok(found) => found,
                Err(judgement) => {
                    answer.get_or_insert_with(|| Attempt::refused(voxel, judgement));
                    continue;
                }
            };
            let judgement = self.weigh(map, query, found, &mut pool, (voxel, finest), &verify)?;
            answer = Some(Attempt {
                voxel: finest,
                judgement,
                ranked: pool.clone(),
            });
            // What the rock confirms by a little, another size may yet contradict.
            if pool.first().is_some_and(|c| beyond_doubt(c, &verify)) {
                return Ok(Attempt::last(answer));
            }
        }
        if pool.is_empty() || leads(&pool, &verify) {
            return Ok(Attempt::last(answer));
        }
        // What noise or a bend has blurred is told by larger patches, if by any.
        let mut coarser: Vec<f64> = sizes.iter().copied().filter(|v| *v > finest).collect();
        coarser.sort_by(f64::total_cmp);
        for voxel in coarser {
            let verify = self.verify_at(voxel);
            let mut again = Vec::new();
            let fittest = pool.len().min(self.config.verify.refined);
            let found = pool[..fittest].to_vec();
            let judgement = self.weigh(map, query, found, &mut again, (finest, voxel), &verify)?;
            if leads(&again, &verify) {
                answer = Some(Attempt {
                    voxel,
                    judgement,
                    ranked: again,
                });
                break;
            }
        }
        Ok(Attempt::last(answer))
    }

    /// Of the poses that features led to, those that a first look leaves in the race.
    pub(crate) fn fittest(
        &mut self,
        map: &Surface<'_>,
        query: &Surface<'_>,
        starts: Vec<Pose>,
        verify: &VerifyConfig,
    ) -> Vec<Pose> {
        let glance = VerifyConfig {
            max_points: at_most(verify.max_points, GLANCE),
            ..verify.clone()
        };
        // What most correspondences support stays, whatever it looks like: of a query that is mostly dust or mostly unmapped
        // little lies anywhere.
        let supported = starts.len().min(verify.refined / 2);
        let most = SHORTLIST * verify.refined;
        self.shortlist(map, query, &starts, &glance, (supported, most))
    }

    /// Refines `poses` in stages that let go of the poor ones early, each looking more closely at fewer: NDT, and of what then lies
    /// on the map, ICP. `last`: no finer size follows.
    pub(crate) fn race(
        &mut self,
        map: &mut MapAt<'_>,
        query: &QueryAt,
        poses: &[Pose],
        verify: &VerifyConfig,
        last: bool,
    ) -> Result<Vec<Candidate>> {
        let config = self.config;
        let query = &query.surface;
        let glance = &VerifyConfig {
            max_points: at_most(verify.max_points, GLANCE),
            ..verify.clone()
        };
        if poses.is_empty() {
            return Ok(Vec::new());
        }
        let (levels, map) = self.cells(map)?;
        let ndt_config = NdtConfig {
            max_points: at_most(config.ndt.max_points, GLANCE),
            ..config.ndt.clone()
        };
        let places = self.stage("refine by NDT", poses.len(), || {
            let refine = |pose: &Pose| {
                let refined = ndt::align(levels, map, query, pose, &ndt_config);
                let (pose, stop) = (refined.map_from_query, Some(refined.stop));
                candidate(map, query, &pose, stop, glance)
            };
            let refined: Vec<Candidate> = poses.par_iter().map(refine).collect();
            let (first, rest) = refined.split_at(refined.len().min(verify.refined / 2));
            let mut places = rank(rest.to_vec(), query, verify, map.voxel);
            places.truncate(verify.refined);
            places.extend_from_slice(first);
            let places = rank(places, query, verify, map.voxel);
            let n = places.len();
            (places, n)
        });
        let mut icp_config = point_to_plane(&config.icp);
        if !last {
            icp_config.max_points = at_most(icp_config.max_points, 2 * GLANCE);
        }
        Ok(self.stage("refine by ICP", places.len(), || {
            let hopeful = hopeful(&places, verify);
            let refine = |(c, hopeful): (&Candidate, &bool)| {
                let before = || candidate(map, query, &c.map_from_query, c.stop, verify);
                if !hopeful {
                    return before();
                }
                let refined = icp::align(map, query, &c.map_from_query, &icp_config);
                let (pose, stop) = (refined.map_from_query, Some(refined.stop));
                let after = candidate(map, query, &pose, stop, verify);
                guarded(icp_config.keep_better, before, after, map, query, verify)
            };
            let refined = places.par_iter().zip(&hopeful).map(refine).collect();
            (refined, hopeful.iter().filter(|h| **h).count())
        }))
    }

    /// Adds what was `found` at a `voxel` size to the pool, and judges the pool `at` another.
    fn weigh(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        found: Vec<Candidate>,
        pool: &mut Vec<Candidate>,
        (voxel, at): (f64, f64),
        verify: &VerifyConfig,
    ) -> Result<Judgement> {
        let (config, request, centroid) = (self.config, self.request, self.centroid);
        let points = query.limited(config).len();
        let query = self.stage("prepare query", points, || {
            let made = query.at(at, config);
            let n = made.surface.points.len();
            (&made.surface, n)
        });
        let map = &self.prepared_map(map, at)?.surface;
        let icp_config = point_to_plane(&config.icp);
        // From where the last size left it, a right pose has not far to go; a wrong one never arrives.
        let polish_config = IcpConfig {
            max_iterations: icp_config.max_iterations.div_ceil(2),
            max_points: at_most(icp_config.max_points, 2 * GLANCE),
            ..icp_config.clone()
        };
        let mut found = if voxel != at {
            self.stage("polish", found.len(), || {
                let hopeful = hopeful(&found, verify);
                let polish = |(c, hopeful): (&Candidate, &bool)| {
                    let (mut pose, mut stop) = (c.map_from_query, c.stop);
                    if *hopeful {
                        let refined = icp::align(map, query, &pose, &polish_config);
                        (pose, stop) = (refined.map_from_query, Some(refined.stop));
                    }
                    candidate(map, query, &pose, stop, verify)
                };
                let polished: Vec<Candidate> = found.par_iter().zip(&hopeful).map(polish).collect();
                (polished, hopeful.iter().filter(|h| **h).count())
            })
        } else {
            found
        };
        Ok(self.stage("verify", found.len(), || {
            let plausible = |c: &Candidate| request.plausible(&c.map_from_query, centroid, 0.0);
            // A confirmed place is not asked anew for having been found anew.
            let known = |c: &Candidate| {
                let held = |d: &Candidate| same_place(d, c, query, verify, at);
                pool.iter().any(|d| confirmed(d, verify) && held(d))
            };
            found.retain(|c| plausible(c) && !known(c));
            pool.append(&mut found);
            *pool = rank(std::mem::take(pool), query, verify, at);
            by_evidence(pool, map, query, verify, &icp_config);
            // The pieces of a bent query may have led it out of what is known beforehand.
            pool.retain(plausible);
            let n = pool.len();
            if n == 0 && request.restricts() {
                return (Judgement::none_found(true), n);
            }
            (judge(pool, map, query, verify), n)
        }))
    }
}

/// A limit on points of its `own`, where 0 is none, made no larger than `points`.
fn at_most(own: usize, points: usize) -> usize {
    if own == 0 { points } else { own.min(points) }
}

/// The rock has confirmed the place that leads.
fn leads(pool: &[Candidate], verify: &VerifyConfig) -> bool {
    pool.first().is_some_and(|c| confirmed(c, verify))
}
