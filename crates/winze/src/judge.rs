//! The verdict over several places, and the sentence that gives its reasons.
//!
//! Places are judged against each other, by what the rock says of each or, where it does not tell, by their shape: one that fits as
//! finely as the best wherever it overlaps is a rival, even where it overlaps less, since a map may simply end there.

use crate::config::VerifyConfig;
use crate::degeneracy::{self, Unobservable};
use crate::icp::{self, Information};
use crate::outcome::Verdict;
use crate::prepare::Surface;
use crate::relief::Relief;
use crate::verify::{Candidate, Fit, as_fine, asked_enough, beyond_doubt, confirmed};

/// What [`judge`] makes of the candidates.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// The answer in a word.
    pub verdict: Verdict,
    /// And in a sentence.
    pub reason: String,
    /// Directions that the geometry leaves open at the best pose; `None` where the fit was too poor to
    /// ask.
    pub unobservable: Option<Vec<Unobservable>>,
    /// What a point-to-plane fit says about the best pose; `None` likewise.
    pub information: Option<Information>,
    /// Which of the candidates cannot be ruled out beside the first.
    pub rivals: Vec<usize>,
}

impl Judgement {
    /// A verdict that says nothing about a pose, or only that it is a poor one.
    pub(crate) fn refused(verdict: Verdict, reason: String) -> Self {
        Self {
            verdict,
            reason,
            unobservable: None,
            information: None,
            rivals: Vec::new(),
        }
    }

    /// There was nothing to judge. Where something was known `beforehand` that poses must agree with, none that does was found.
    pub(crate) fn none_found(beforehand: bool) -> Self {
        let reason = if beforehand {
            "no pose was found that agrees with the region or the attitude asked for"
        } else {
            "no pose has enough matching keypoints behind it"
        };
        Self::refused(Verdict::NotFound, reason.into())
    }
}

/// The verdict over distinct candidates, the one to answer with first.
///
/// The rules, in order. Fewer than [`VerifyConfig::min_points`] query points with a normal: `insufficient`. No
/// candidate: `not_found`.
///
/// Where the rock says that it is the same place ([`relief`](crate::relief), [`VerifyConfig::min_significance`]): a rival of which it
/// says at least [`VerifyConfig::rival_excess`] of the best's excess, or says so by
/// [`VerifyConfig::sure_significance`] on its own, or, where it says so by less than
/// [`VerifyConfig::sure_significance`], one that fits better by its shape: `ambiguous`. Too few points that lie finely, though
/// the pose is not that of its pieces: `not_found`, for the rock of one end says nothing of where a bent query's other end puts its
/// middle. A query that is bent where it lies on the map, by so much that the rest may be elsewhere ([`VerifyConfig::max_beyond`]): `not_found` too. A
/// direction with less than [`VerifyConfig::min_information_confirmed`]: `degenerate`. Else `located`.
///
/// A place that the best one reaches by moving along such directions alone is no rival ([`degeneracy::reaches`]).
///
/// Where it does not: too little overlap or too few points that lie finely: `not_found`. A rival that fits as finely: `ambiguous`. Too little
/// rock to ask: `insufficient`. An open direction: `degenerate`. Else, where the rock said no: `not_found`.
#[must_use]
pub fn judge(
    ranked: &[Candidate],
    map: &Surface<'_>,
    query: &Surface<'_>,
    config: &VerifyConfig,
) -> Judgement {
    judge_against(ranked, None, map, query, config)
}

/// The judgement of a query with too little geometry to look for; `None` for one with enough.
pub(crate) fn insufficient(query: &Surface<'_>, config: &VerifyConfig) -> Option<Judgement> {
    let with_normal = query.normals.iter().filter(|n| **n != [0.0; 3]).count();
    (with_normal < config.min_points).then(|| {
        let reason = format!(
            "{with_normal} of the query's points are left with a surface normal at a voxel size of {:.3} m; at least {} are needed",
            query.voxel, config.min_points
        );
        Judgement::refused(Verdict::Insufficient, reason)
    })
}

/// As [`judge`], where the first candidate's place may be known to fit as `finest` says
/// once refined, though the candidate itself is not. Rivals, refined, must be compared with that.
pub(crate) fn judge_against(
    ranked: &[Candidate],
    finest: Option<Fit>,
    map: &Surface<'_>,
    query: &Surface<'_>,
    config: &VerifyConfig,
) -> Judgement {
    if let Some(insufficient) = insufficient(query, config) {
        return insufficient;
    }
    let Some(best) = ranked.first() else {
        return Judgement::none_found(false);
    };
    let fit = &best.fit;
    let relief = best.relief.unwrap_or_default();
    let sure = confirmed(best, config);
    if !sure && let Some(reason) = unfit(fit, map, config) {
        return Judgement::refused(Verdict::NotFound, reason);
    }
    let information = icp::information(
        map,
        query,
        &best.map_from_query,
        config.overlap_distance.metres(map.voxel),
        config.max_points,
    );
    // Rock that lies finest unmoved resists being moved, however little its normals say so.
    let least = if sure {
        config.min_information_confirmed
    } else {
        config.min_information
    };
    let open: Vec<Unobservable> = degeneracy::directions(&information)
        .into_iter()
        .filter(|d| d.information < least)
        .collect();
    let merge = [
        config.merge_distance.metres(map.voxel),
        config.merge_angle.to_radians(),
    ];
    let centroid = query.centroid().unwrap_or_default();
    // The walls that repeat in a mine made of a few moulds can say yes a little too often to the wrong mould.
    let doubtful = sure && !beyond_doubt(best, config);
    let finest = finest.unwrap_or(*fit);
    let contradicts = |c: &Candidate| doubtful && c.fit.fitness > finest.fitness;
    // Excess counts patches: a place that is mapped in part has fewer to ask, and may be sure by them all the same.
    let as_sure = |c: &Candidate, r: &Relief| {
        let enough = r.excess() >= config.rival_excess * relief.excess();
        (enough && c.fit.overlap >= config.least_overlap) || beyond_doubt(c, config)
    };
    let is_rival = |c: &Candidate| {
        let poses = (&best.map_from_query, &c.map_from_query);
        if degeneracy::reaches(&open, poses, centroid, merge) {
            return false;
        }
        // One that could not be asked is judged by its shape.
        match asked_enough(c.relief, config) {
            Some(r) if sure => as_sure(c, &r) || contradicts(c),
            _ => {
                let as_fine = as_fine(&c.fit, fit, finest.median_point_to_plane, config);
                as_fine || contradicts(c) || beyond_doubt(c, config)
            }
        }
    };
    let rivals: Vec<usize> = (1..ranked.len())
        .filter(|i| is_rival(&ranked[*i]))
        .collect();
    let asked = format!(
        "of {} patches of wall {} ({:.0} %) lie finest where they are{}",
        relief.asked,
        relief.confirmed,
        100.0 * relief.share(),
        match relief.bend {
            Some(bend) if relief.piecewise =>
                format!(", piece by piece, {bend:.2} m (root mean square) off one rigid pose"),
            _ => String::new(),
        }
    );
    let (verdict, reason) = if !rivals.is_empty() {
        let backed = rivals.iter().map(|i| &ranked[*i]);
        let backed = backed.filter(|c| c.relief.is_some_and(|r| as_sure(c, &r)));
        let elsewhere = strongest(backed, config).map(|(c, r)| {
            let way = best.map_from_query.distance(&c.map_from_query, centroid);
            format!(
                "{} of {} do, {:.1} m and {:.0}° away",
                r.confirmed,
                r.asked,
                way.translation,
                way.rotation.to_degrees()
            )
        });
        let why = match elsewhere {
            Some(elsewhere) if sure => {
                format!(
                    "{asked}, and of those of another place {elsewhere}, where {:.0} % of the excess over chance or {:.1} standard deviations are too many",
                    100.0 * config.rival_excess,
                    config.sure_significance
                )
            }
            _ if doubtful => {
                format!(
                    "{asked}, {:.1} standard deviations more than chance gives, below the {:.1} that overrule the shape",
                    relief.significance(),
                    config.sure_significance
                )
            }
            _ if sure => {
                format!(
                    "{asked}, but that shape lies elsewhere too, where the wall cannot be asked"
                )
            }
            _ => format!(
                "as finely on at least {:.0} % of the overlap, and {asked}, too few to tell",
                100.0 * config.rival_overlap
            ),
        };
        let n = rivals.len();
        let reason = format!(
            "{n} other place{} cannot be ruled out: {why}",
            if n == 1 { "" } else { "s" }
        );
        (Verdict::Ambiguous, reason)
    } else if !sure && relief.asked < config.min_patches {
        let reason = format!(
            "the shape fits, but only {} patches of wall could be asked whether it is the same rock; at least {} are needed",
            relief.asked, config.min_patches
        );
        (Verdict::Insufficient, reason)
    } else if sure
        && !relief.piecewise
        && let Some(loose) = loose(&finest, map, config)
    {
        let reason = format!(
            "the rock says that it is this place ({asked}), but no one pose lays the query on it: {loose}; it is bent or blurred, and {} piece by piece",
            if relief.bend.is_some() {
                "cannot be followed"
            } else {
                "was not followed"
            }
        );
        (Verdict::NotFound, reason)
    } else if sure && let Some(unknown) = unknown(&relief, config) {
        let reason = format!("the rock says that it is this place ({asked}), but {unknown}");
        (Verdict::NotFound, reason)
    } else if let Some(d) = open.first() {
        let reason = format!(
            "nothing in the geometry resists {} ({:.2}, {:.2}, {:.2}): a pair of points tells {:.2} % of what it could, below {:.1} %; {asked}{}",
            match d.kind {
                degeneracy::DirectionKind::Translation => "sliding along",
                degeneracy::DirectionKind::Rotation => "turning about",
            },
            d.direction[0],
            d.direction[1],
            d.direction[2],
            100.0 * d.information,
            100.0 * least,
            if sure {
                ""
            } else {
                ", so that the place rests on its shape alone"
            }
        );
        (Verdict::Degenerate, reason)
    } else if sure {
        let theirs = strongest(&ranked[1..], config).map_or_else(String::new, |(_, r)| {
            format!(" ({} of {} patches in the best)", r.confirmed, r.asked)
        });
        let others = match ranked.len() {
            1 => "no other place came up".into(),
            2 => format!("the one other place weighed does not come close{theirs}"),
            n => format!(
                "none of the {} other places weighed comes close{theirs}",
                n - 1
            ),
        };
        let reason = format!(
            "{:.0} % of the query lies on the map's surface, half of that within {:.3} m; {asked}, {:.1} standard deviations more than the third that chance gives at most, where {:.0} are asked for; and {others}",
            100.0 * fit.overlap,
            fit.median_point_to_plane,
            relief.significance(),
            config.min_significance
        );
        (Verdict::Located, reason)
    } else {
        let reason = format!(
            "the shape fits, but not the rock: {asked}, {:.1} standard deviations more than the third that chance gives at most, where {:.0} are asked for",
            relief.significance(),
            config.min_significance
        );
        (Verdict::NotFound, reason)
    };
    Judgement {
        verdict,
        reason,
        unobservable: Some(open),
        information: Some(information),
        rivals,
    }
}

/// The one of `places`, where enough of it could be asked, of which the rock says most, and what it says.
fn strongest<'a>(
    places: impl IntoIterator<Item = &'a Candidate>,
    config: &VerifyConfig,
) -> Option<(&'a Candidate, Relief)> {
    let places = places.into_iter();
    let asked = places.filter_map(|c| Some((c, asked_enough(c.relief, config)?)));
    asked.max_by(|(_, a), (_, b)| a.excess().total_cmp(&b.excess()))
}

/// Why a pose does not fit by its shape; `None` where it does.
fn unfit(fit: &Fit, map: &Surface<'_>, config: &VerifyConfig) -> Option<String> {
    if fit.overlap < config.min_overlap || fit.overlap <= 0.0 {
        return Some(format!(
            "the best pose found puts {:.0} % of the query on the map's surface, below the {:.0} % asked for where the rock does not tell",
            100.0 * fit.overlap,
            100.0 * config.min_overlap
        ));
    }
    loose(fit, map, config)
}

/// That of what overlaps too little lies finely; `None` where enough does.
fn loose(fit: &Fit, map: &Surface<'_>, config: &VerifyConfig) -> Option<String> {
    (fit.fitness < config.min_fine_share * fit.overlap).then(|| {
        format!(
            "of the overlapping points {:.0} % lie within {:.3} m of the map's surface, below the {:.0} % asked for",
            100.0 * fit.fitness / fit.overlap,
            config.fine_tolerance.metres(map.voxel),
            100.0 * config.min_fine_share
        )
    })
}

/// That the query is bent where it lies on the map, and that too little of it does to tell what the bend does to the rest; `None` where it is
/// straight enough, or enough of it lies there, or neither was asked.
fn unknown(relief: &Relief, config: &VerifyConfig) -> Option<String> {
    let (beyond, followed) = (relief.beyond?, relief.followed?);
    (beyond > config.max_beyond).then(|| {
        format!(
            "the query is bent, and only {:.0} % of it was followed on the map: were the rest bent alike, this pose would be {beyond:.2} m off its middle, \
             more than {:.2} m",
            100.0 * followed,
            config.max_beyond
        )
    })
}

#[cfg(test)]
mod tests;
