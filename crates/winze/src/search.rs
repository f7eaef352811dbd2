//! The method `auto`: many hypotheses from all scales, weighed against each other at the finest one.
//!
//! ```text
//! for each voxel size, the best guess first:
//!     features ─graph─> hypotheses ─shortlist, NDT, ICP─> candidates ─┐
//!                                                                     v
//!     pool of distinct places <──polish, fit, ask the rock── at the finest size
//!     located? done
//! not located: the pool again at coarser sizes, whose larger patches see past noise and bends
//! ```

use rayon::prelude::*;

use crate::error::Result;
use crate::icp;
use crate::kept::{KeptMap, KeptQuery};
use crate::locate::{Attempt, Run, candidate, point_to_plane};
use crate::verify::{Candidate, Judgement, by_evidence, confirmed, hopeful, judge, rank};

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
        for &voxel in sizes {
            let found = match self.candidates(map, query, voxel)? {
                Ok(found) => found,
                Err(judgement) => {
                    answer.get_or_insert_with(|| Attempt::refused(voxel, judgement));
                    continue;
                }
            };
            let judgement = self.weigh(map, query, found, &mut pool, (voxel, finest))?;
            answer = Some(Attempt {
                voxel: finest,
                judgement,
                ranked: pool.clone(),
            });
            if self.settled(&pool) {
                return Ok(Attempt::last(answer));
            }
        }
        // What noise or a bend has blurred is told by larger patches, if by any.
        let mut coarser: Vec<f64> = sizes.iter().copied().filter(|v| *v > finest).collect();
        coarser.sort_by(f64::total_cmp);
        for voxel in coarser {
            let mut again = Vec::new();
            let found = pool.clone();
            let judgement = self.weigh(map, query, found, &mut again, (finest, voxel))?;
            if self.settled(&again) {
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

    /// The rock has confirmed the place that leads.
    fn settled(&self, pool: &[Candidate]) -> bool {
        let first = pool.first();
        first.is_some_and(|c| confirmed(c, &self.config.verify))
    }

    /// Adds what was `found` at a `voxel` size to the pool, and judges the pool `at` another.
    fn weigh(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        found: Vec<Candidate>,
        pool: &mut Vec<Candidate>,
        (voxel, at): (f64, f64),
    ) -> Result<Judgement> {
        let (config, request) = (self.config, self.request);
        let verify = &self.verify_at(at);
        let points = query.limited(config).len();
        let query = self.stage("prepare query", points, || {
            let made = query.at(at, config);
            let n = made.surface.points.len();
            (&made.surface, n)
        });
        let map = self.map_stage("prepare map", map.points(), || {
            let made = map.at(at, config);
            let n = made.as_ref().map_or(0, |m| m.surface.points.len());
            (made, n)
        })?;
        let map = &map.surface;
        let icp_config = point_to_plane(&config.icp);
        let found = if voxel != at {
            self.stage("polish", found.len(), || {
                let hopeful = hopeful(&found, verify);
                let polish = |(c, hopeful): (&Candidate, &bool)| {
                    let (mut pose, mut stop) = (c.map_from_query, c.stop);
                    if *hopeful {
                        let refined = icp::align(map, query, &pose, &icp_config);
                        (pose, stop) = (refined.map_from_query, Some(refined.stop));
                    }
                    candidate(pose, stop, map, query, verify)
                };
                let polished: Vec<Candidate> = found.par_iter().zip(&hopeful).map(polish).collect();
                (polished, hopeful.iter().filter(|h| **h).count())
            })
        } else {
            found
        };
        let centroid = query.centroid().unwrap_or_default();
        Ok(self.stage("verify", found.len(), || {
            let plausible = |c: &Candidate| request.plausible(&c.map_from_query, centroid);
            pool.extend(found.into_iter().filter(plausible));
            *pool = rank(std::mem::take(pool), query, verify, at);
            by_evidence(pool, map, query, verify, &icp_config);
            let judgement = judge(pool, map, query, verify);
            let n = pool.len();
            (judgement, n)
        }))
    }
}
