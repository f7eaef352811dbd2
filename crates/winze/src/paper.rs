//! The paper's methods: one voxel size, the pose that most correspondences support, its refiners in a chain.
//!
//! Akhihiero & Gross 2025 compare five such chains ([`Method`](crate::method::Method)). The answer is theirs; the verdict on it, which the paper
//! does not have, weighs what else RANSAC found.

use rayon::prelude::*;

use crate::config::VerifyConfig;
use crate::error::Result;
use crate::judge::{Judgement, judge, judge_against};
use crate::kept::{KeptMap, KeptQuery, MapAt, QueryAt, Refiner};
use crate::locate::{Attempt, Run, guarded, point_to_plane};
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::refine::{Refined, StopReason};
use crate::verify::{Candidate, Fit, ask_relief, candidate, hopeful, rank, same_place};
use crate::{icp, ndt};

impl Run<'_> {
    /// One of the paper's methods at one voxel size.
    pub(crate) fn attempt(
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
        let (request, centroid) = (self.request, self.centroid);
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
            refined.retain(|c| !at_home(c) && request.plausible(&c.map_from_query, centroid, 0.0));
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

    /// Of the poses that RANSAC found, the first and those that a first look leaves in the race.
    pub(crate) fn first_and_fittest(
        &mut self,
        map: &Surface<'_>,
        query: &Surface<'_>,
        poses: Vec<Pose>,
        verify: &VerifyConfig,
    ) -> Vec<Pose> {
        if poses.len() <= verify.refined {
            return poses;
        }
        // The first, on which the paper's methods build, stays whatever it looks like.
        self.shortlist(map, query, &poses, verify, (1, verify.refined))
    }

    /// The paper's refiners on every start; candidates come in the order of `starts`.
    pub(crate) fn refine(
        &mut self,
        map: &mut MapAt<'_>,
        query: &QueryAt,
        starts: &[Pose],
        verify: &VerifyConfig,
    ) -> Result<Vec<Candidate>> {
        let (config, method) = (self.config, self.request.method);
        let (query, known) = (&query.surface, &query.refinements);
        let candidates: Vec<Candidate> = if method.uses_ndt() && !starts.is_empty() {
            let (levels, map) = self.cells(map)?;
            let candidate =
                |pose: &Pose, stop: Option<StopReason>| candidate(map, query, pose, stop, verify);
            // A start that no features found is a guess: far from the truth the residual says little.
            let guard = config.ndt.keep_better && method.uses_features();
            self.stage("refine by NDT", starts.len(), || {
                let refine = |pose: &Pose| {
                    let refined = known.get(Refiner::Ndt, pose, || {
                        ndt::align(levels, map, query, pose, &config.ndt)
                    });
                    let after = candidate(&refined.map_from_query, Some(refined.stop));
                    guarded(guard, || candidate(pose, None), after, map, query, verify)
                };
                let refined: Vec<Candidate> = starts.par_iter().map(refine).collect();
                let n = refined.len();
                (refined, n)
            })
        } else {
            let place = |pose: &Pose| candidate(&map.surface, query, pose, None, verify);
            starts.iter().map(place).collect()
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
}
