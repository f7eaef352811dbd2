//! The method `auto`: many hypotheses from all scales, weighed against each other at the finest one.
//!
//! ```text
//! for each voxel size, the best guess first:
//!     features ─graph─> hypotheses ─shortlist, NDT, ICP─> candidates ─┐
//!                                                                     v
//!     pool of distinct places <──polish, fit, ask the rock── at the finest size
//!     located? done
//! ```

use rayon::prelude::*;

use crate::error::Result;
use crate::icp;
use crate::kept::{KeptMap, KeptQuery};
use crate::locate::{Attempt, Run, candidate, point_to_plane};
use crate::outcome::Verdict;
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
            // A coarser look tells no more of a place that the rock has confirmed.
            let settled = pool
                .first()
                .is_some_and(|c| confirmed(c, &self.config.verify));
            answer = Some(Attempt {
                voxel: finest,
                judgement,
                ranked: pool.clone(),
            });
            if settled {
                break;
            }
        }
        let nothing = "no voxel size suits map and query";
        let refused = || Judgement::refused(Verdict::Insufficient, nothing.into());
        Ok(answer.unwrap_or_else(|| Attempt::refused(0.0, refused())))
    }

    /// Adds what was `found` at a voxel size to the pool, and judges the pool at the finest one.
    fn weigh(
        &mut self,
        map: &mut KeptMap<'_>,
        query: &mut KeptQuery<'_>,
        found: Vec<Candidate>,
        pool: &mut Vec<Candidate>,
        (voxel, finest): (f64, f64),
    ) -> Result<Judgement> {
        let (config, request) = (self.config, self.request);
        let verify = &self.verify_at(finest);
        let points = query.limited(config).len();
        let query = self.stage("prepare query", points, || {
            let at = query.at(finest, config);
            let n = at.surface.points.len();
            (&at.surface, n)
        });
        let map = self.map_stage("prepare map", map.points(), || {
            let at = map.at(finest, config);
            let n = at.as_ref().map_or(0, |at| at.surface.points.len());
            (at, n)
        })?;
        let map = &map.surface;
        let icp_config = point_to_plane(&config.icp);
        let found = if voxel > finest {
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
            *pool = rank(std::mem::take(pool), query, verify, finest);
            by_evidence(pool, map, query, verify, &icp_config);
            let judgement = judge(pool, map, query, verify);
            let n = pool.len();
            (judgement, n)
        }))
    }
}
