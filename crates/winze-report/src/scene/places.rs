//! The places that were weighed: where each puts the query, how far the query's points lie from the map there, and what the rock says.

use rayon::prelude::*;
use serde::Serialize;
use winze::outcome::RankedHypothesis;
use winze::prepare::Surface;
use winze::relief::{self, Patch};
use winze::{Outcome, Pose};

use super::Judged;

/// A place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Place {
    /// Its number among the hypotheses, from 0.
    index: usize,
    rival: bool,
    /// The rock was asked piece by piece.
    piecewise: bool,
    /// Where the query's centroid lies in the scene, metres.
    at: [f64; 3],
    /// The query's axes in those of the map, a row a line.
    turn: [[f64; 3]; 3],
    /// Share of the query with map within reach.
    overlap: f64,
    /// Share that lies finely.
    fine: f64,
}

impl Place {
    pub(super) fn is_rival(&self) -> bool {
        self.rival
    }

    /// `middle` is the query's centroid in its own frame, `origin` the scene's in the map's.
    fn at(pose: &Pose, index: usize, middle: [f64; 3], origin: [f64; 3]) -> Self {
        let at = pose.transform(middle);
        let m = pose.to_matrix();
        Self {
            index,
            rival: false,
            piecewise: false,
            at: std::array::from_fn(|a| at[a] - origin[a]),
            turn: std::array::from_fn(|r| [m[r][0], m[r][1], m[r][2]]),
            overlap: 0.0,
            fine: 0.0,
        }
    }
}

/// Places for the viewer.
pub(super) fn places(
    outcome: &Outcome,
    shown: &[(usize, &RankedHypothesis)],
    middle: [f64; 3],
    origin: [f64; 3],
) -> Vec<Place> {
    let of = |(i, h): &(usize, &RankedHypothesis)| Place {
        rival: h.rival,
        piecewise: h.relief.is_some_and(|r| r.piecewise),
        overlap: h.overlap,
        fine: h.score,
        ..Place::at(&h.map_from_query, *i, middle, origin)
    };
    // A pose without hypotheses is shown too.
    match (&outcome.map_from_query, shown) {
        (Some(pose), []) => of_poses(&[pose], middle, origin),
        _ => shown.iter().map(of).collect(),
    }
}

/// Places of which nothing is known but where they are; all but the first are of note.
pub(super) fn of_poses(poses: &[&Pose], middle: [f64; 3], origin: [f64; 3]) -> Vec<Place> {
    let place = |(i, pose): (usize, &&Pose)| Place {
        rival: i > 0,
        ..Place::at(pose, i, middle, origin)
    };
    poses.iter().enumerate().map(place).collect()
}

/// How far from the map's surface the query's points lie at each place, a byte a point.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Colours {
    /// What counts as lying finely, metres.
    fine: f64,
    /// What 254 means, metres, and all beyond.
    most: f64,
    /// A point without map surface within this distance, metres, is 255.
    reach: f64,
    places: Vec<Bytes>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(transparent)]
struct Bytes(#[serde(serialize_with = "super::base64")] Vec<u8>);

/// What is drawn as the worst residual, in fine tolerances.
const WORST: f64 = 3.0;
/// The byte of a point off the map.
const OFF_MAP: u8 = 255;

impl Colours {
    /// See [`Scene::reach`](super::Scene::reach).
    pub(super) fn reach(&self) -> [f64; 3] {
        [self.fine, self.most, self.reach]
    }

    /// Of the query's points, in the order that they are packed in.
    pub(super) fn of(
        points: &[[f64; 3]],
        shown: &[(usize, &RankedHypothesis)],
        judged: &Judged<'_>,
    ) -> Self {
        let fine = judged.verify.fine_tolerance.metres(judged.map.voxel);
        let reach = judged.verify.overlap_distance.metres(judged.map.voxel);
        let most = (WORST * fine).min(reach);
        let byte = |p: &[f64; 3], pose: &Pose| {
            let Some(out) = residual(judged.map, pose.transform(*p), reach) else {
                return OFF_MAP;
            };
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "0 to 254"
            )]
            let byte = (out / most * 254.0).min(254.0).round() as u8;
            byte
        };
        let at = |pose: &Pose| Bytes(points.par_iter().map(|p| byte(p, pose)).collect());
        Self {
            fine,
            most,
            reach,
            places: shown.iter().map(|(_, h)| at(&h.map_from_query)).collect(),
        }
    }
}

/// Distance of a point of the map's frame from the tangent plane of the nearest map point, as [`winze::verify`] takes it; `None` where that
/// lies beyond `reach`.
fn residual(map: &Surface<'_>, p: [f64; 3], reach: f64) -> Option<f64> {
    let offset: [f64; 3] = std::array::from_fn(|a| p[a] - map.origin[a]);
    #[expect(
        clippy::cast_possible_truncation,
        reason = "offsets within f32's range"
    )]
    let near = map
        .tree
        .nearest_within(offset.map(|v| v as f32), reach as f32)?;
    let i = near.index as usize;
    let (q, n) = (map.points.get(i)?, map.normals.get(i)?);
    if *n == [0.0; 3] {
        return Some(f64::from(near.distance_squared).sqrt());
    }
    let out: f64 = (0..3)
        .map(|a| (offset[a] - f64::from(q[a])) * f64::from(n[a]))
        .sum();
    Some(out.abs())
}

/// The patches of wall that were asked, and what each says at each place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Patches {
    /// About how wide each is, metres.
    size: f64,
    /// Centre from the query's centroid, then normal, in the query's axes.
    at: Vec<[f64; 6]>,
    /// A letter a patch: `y` lies finest where it is, `n` does not, `-` could not be asked; null where they were asked piece by piece, or not.
    answers: Vec<Option<String>>,
}

impl Patches {
    /// As the verdict asked them.
    pub(super) fn of(
        shown: &[(usize, &RankedHypothesis)],
        judged: &Judged<'_>,
        middle: [f64; 3],
    ) -> Option<Self> {
        let Judged { map, query, verify } = judged;
        let size = verify.patch_size.metres(map.voxel);
        let patches = relief::patches(query, size, verify.patches);
        let lengths = [&verify.patch_step, &verify.patch_reach].map(|l| l.metres(map.voxel));
        let asked = |h: &RankedHypothesis| {
            if h.relief.is_none_or(|r| r.piecewise) {
                return None;
            }
            let pose = h.map_from_query;
            let answers = relief::answers(map, query.origin, &patches, &|_| pose, lengths);
            let letter = |answer: &Option<bool>| match answer {
                Some(true) => 'y',
                Some(false) => 'n',
                None => '-',
            };
            Some(answers.iter().map(letter).collect())
        };
        let answers: Vec<Option<String>> = shown.iter().map(|(_, h)| asked(h)).collect();
        answers.iter().any(Option::is_some).then(|| Self {
            size,
            at: patches
                .iter()
                .map(|p| from_middle(p, query.origin, middle))
                .collect(),
            answers,
        })
    }
}

fn from_middle(patch: &Patch, origin: [f64; 3], middle: [f64; 3]) -> [f64; 6] {
    let (c, n) = (patch.centre(), patch.normal());
    std::array::from_fn(|a| {
        if a < 3 {
            c[a] + origin[a] - middle[a]
        } else {
            n[a - 3]
        }
    })
}
