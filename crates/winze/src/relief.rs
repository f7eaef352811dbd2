//! Is it the same rock? Evidence patch by patch.
//!
//! One drift has the shape of the next, so that a query fits its twin within a few centimetres. But no two walls have
//! the same relief. A patch of the query's surface, a metre or two wide, is laid on the map's surface where the pose puts it, and then half a
//! patch further up, down, left, right and across: where the pose is right it lies most finely unmoved, where it is not,
//! another place is mostly as good. Offset and tilt of each patch are fitted anew each time, so that neither a bent query nor the last
//! centimetres of a pose matter, and much of the shape that a look-alike shares, such as the curve of a roof, cancels.
//!
//! The share of patches that say yes needs no noise level and no threshold in metres. Among seventeen places as good as each
//! other it would be one in seventeen; shape that does not cancel, such as the foot of a wall, leaves a patch only the drift's
//! direction to move in, which makes it [one in three](BY_CHANCE) at most by chance.

use rayon::prelude::*;

use crate::cancel;
use crate::pose::Pose;
use crate::prepare::Surface;
use crate::vec3::{cross, dot, norm, scale, sub, voxel_of};

/// What the patches said about one pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Relief {
    /// Patches that could be asked: those with map surface on all sides.
    pub asked: usize,
    /// Those that lie more finely where they are than moved any way.
    pub confirmed: usize,
    /// How far off one rigid pose the pieces of the query lie ([`bend`](crate::bend)), root mean square, metres; `None`
    /// where that was not asked.
    pub bend: Option<f64>,
    /// How far off the query's centroid that may leave the pose, where part of the query is not on the map, metres; `None` likewise.
    pub beyond: Option<f64>,
    /// Share of the query's points in pieces that were found to lie on the map by themselves.
    pub followed: Option<f64>,
    /// The patches were asked where the pieces lie, not where the rigid pose puts them.
    pub piecewise: bool,
}

impl Relief {
    /// Share of the patches asked that say yes; 0 where none was.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    pub fn share(&self) -> f64 {
        self.confirmed as f64 / self.asked.max(1) as f64
    }

    /// Patches that say yes beyond those that do by chance; negative where it is fewer.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    pub fn excess(&self) -> f64 {
        self.confirmed as f64 - self.asked as f64 * BY_CHANCE
    }

    /// The excess in standard deviations of what chance gives.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "counts")]
    pub fn significance(&self) -> f64 {
        let variance = self.asked as f64 * BY_CHANCE * (1.0 - BY_CHANCE);
        self.excess() / variance.max(f64::MIN_POSITIVE).sqrt()
    }
}

/// Share of patches that say yes by chance, at most.
pub const BY_CHANCE: f64 = 1.0 / 3.0;
/// Directions that a patch is moved in,
const DIRECTIONS: usize = 8;
/// each by a step and by so many steps.
const FURTHER: f64 = 1.7;
const WAYS: usize = 2 * DIRECTIONS;
/// Points that a patch needs.
const LEAST: usize = 14;
/// Share of a patch's points that must lie on the map, wherever it is moved to.
const ON_MAP: f64 = 0.75;
/// Of a patch that has lost already, so many points or up to twice as many are moved on, where it has them.
const COUNTED: usize = 32;
/// Ways that must lead to map surface.
const LEAST_WAYS: usize = 11;
/// Cosine to the patch's mean normal that a point's must reach, and the map's there.
const SIDE: f64 = 0.7;

/// A piece of the query's surface: offsets, their mean, and its normal.
#[derive(Debug, Clone, PartialEq)]
pub struct Patch {
    points: Vec<[f64; 3]>,
    centre: [f64; 3],
    normal: [f64; 3],
}

impl Patch {
    /// Mean of its points, as an offset.
    #[must_use]
    pub fn centre(&self) -> [f64; 3] {
        self.centre
    }

    /// Its mean unit normal.
    #[must_use]
    pub fn normal(&self) -> [f64; 3] {
        self.normal
    }
}

/// The patches of `query`, of about `size` metres, at most `most` of them, evenly chosen.
#[must_use]
pub fn patches(query: &Surface<'_>, size: f64, most: usize) -> Vec<Patch> {
    let mut keyed: Vec<([i64; 3], u8, u32)> = (0u32..)
        .zip(query.points.iter().zip(query.normals.iter()))
        .filter(|(_, (_, n))| **n != [0.0; 3])
        .map(|(i, (p, n))| {
            let cell = voxel_of(p.map(f64::from), size);
            // Floor and wall meet in one cell; the sides a normal can face keep them apart.
            let axis = (0..3)
                .max_by(|&a, &b| n[a].abs().total_cmp(&n[b].abs()))
                .unwrap_or(0);
            #[expect(clippy::cast_possible_truncation, reason = "0 to 5")]
            let side = 2 * axis as u8 + u8::from(n[axis] < 0.0);
            (cell, side, i)
        })
        .collect();
    keyed.sort_unstable();
    let patch = |group: &[([i64; 3], u8, u32)]| -> Option<Patch> {
        let at = |i: u32, of: &[[f32; 3]]| of[i as usize].map(f64::from);
        let mut mean = [0.0; 3];
        for (.., i) in group {
            let n = at(*i, &query.normals);
            (0..3).for_each(|a| mean[a] += n[a]);
        }
        let length = norm(mean);
        if !(length > 0.0) {
            return None;
        }
        let normal = scale(mean, 1.0 / length);
        let points: Vec<[f64; 3]> = group
            .iter()
            .filter(|(.., i)| dot(at(*i, &query.normals), normal) >= SIDE)
            .map(|(.., i)| at(*i, &query.points))
            .collect();
        if points.len() < LEAST {
            return None;
        }
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let n = points.len() as f64;
        let centre = std::array::from_fn(|a| points.iter().map(|p| p[a]).sum::<f64>() / n);
        Some(Patch {
            points,
            centre,
            normal,
        })
    };
    let all: Vec<Patch> = keyed
        .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
        .filter_map(patch)
        .collect();
    if all.len() <= most {
        return all;
    }
    let chosen = (0..most).filter_map(|i| all.get(i * all.len() / most));
    chosen.cloned().collect()
}

/// Asks `patches` of a query with offsets from `query_origin` whether the pose of each (`map_from_query`) puts it on the rock it was seen
/// on. `lengths`, metres: by how much each is moved to see whether it lies as finely there, and how far from it the
/// map's surface may lie.
#[must_use]
pub fn ask(
    map: &Surface<'_>,
    query_origin: [f64; 3],
    patches: &[Patch],
    pose_of: &(dyn Fn(&Patch) -> Pose + Sync),
    lengths: [f64; 2],
) -> Relief {
    answers(map, query_origin, patches, pose_of, lengths)
        .into_iter()
        .flatten()
        .fold(Relief::default(), |r, yes| Relief {
            asked: r.asked + 1,
            confirmed: r.confirmed + usize::from(yes),
            ..r
        })
}

/// What each patch says, as [`ask`] asks it; `None` where the map has too little surface around to ask.
#[must_use]
pub fn answers(
    map: &Surface<'_>,
    query_origin: [f64; 3],
    patches: &[Patch],
    pose_of: &(dyn Fn(&Patch) -> Pose + Sync),
    lengths: [f64; 2],
) -> Vec<Option<bool>> {
    let answer = |patch: &Patch| {
        cancel::check();
        let pose = pose_of(patch).between_origins(map.origin, query_origin);
        confirms(map, patch, &pose, lengths)
    };
    patches.par_iter().map(answer).collect()
}

/// Whether a patch lies most finely where the pose puts it; `None` where the map has too little surface around.
fn confirms(
    map: &Surface<'_>,
    patch: &Patch,
    pose: &Pose,
    [step, reach]: [f64; 2],
) -> Option<bool> {
    let normal = pose.rotate(patch.normal);
    let centre = pose.transform(patch.centre);
    let across = if normal[2].abs() < 0.9 {
        [0.0, 0.0, 1.0]
    } else {
        [1.0, 0.0, 0.0]
    };
    let u = cross(normal, across);
    let u = scale(u, 1.0 / norm(u).max(1e-12));
    let v = cross(normal, u);
    let points: Vec<[f64; 3]> = patch.points.iter().map(|p| pose.transform(*p)).collect();
    let frame = Frame {
        map,
        centre,
        axes: [u, v, normal],
        reach,
    };
    let own = frame.roughness(&points, [0.0, 0.0])?;
    // A patch that has lost is moved on only to see that there is surface to ask it on, for which few of its points do.
    let few: Vec<[f64; 3]> = points
        .iter()
        .step_by((points.len() / COUNTED).max(1))
        .copied()
        .collect();
    let (mut ways, mut finest) = (0, true);
    for k in 0..WAYS {
        let decided = ways >= LEAST_WAYS && !finest;
        if decided || ways + (WAYS - k) < LEAST_WAYS {
            break;
        }
        let (s, c) = libm::sincos(std::f64::consts::TAU * k as f64 / DIRECTIONS as f64);
        let step = if k < DIRECTIONS { step } else { FURTHER * step };
        let shift = [step * c, step * s];
        if !finest {
            ways += usize::from(frame.meets(&few, shift));
        } else if let Some(moved) = frame.roughness(&points, shift) {
            finest = own < moved;
            ways += 1;
        }
    }
    (ways >= LEAST_WAYS).then_some(finest)
}

/// Where a patch lies on the map.
struct Frame<'a> {
    map: &'a Surface<'a>,
    centre: [f64; 3],
    /// Two along the patch, then its normal.
    axes: [[f64; 3]; 3],
    reach: f64,
}

impl Frame<'_> {
    /// Mean square of what is left of the patch's distances from the map's surface once offset and tilt are taken out, where
    /// it is moved along itself by `shift`; `None` where too little of it meets surface.
    fn roughness(&self, points: &[[f64; 3]], shift: [f64; 2]) -> Option<f64> {
        let moved = self.moved(shift);
        let mut missing = most_missing(points.len());
        let mut found: Vec<[f64; 3]> = Vec::with_capacity(points.len());
        for p in points {
            let Some(height) = self.height(p, moved) else {
                missing = missing.checked_sub(1)?;
                continue;
            };
            let d = sub(*p, self.centre);
            found.push([dot(d, self.axes[0]), dot(d, self.axes[1]), height]);
        }
        Some(about_plane(&found))
    }

    /// Whether [`roughness`](Self::roughness) would find enough of the points on surface.
    fn meets(&self, points: &[[f64; 3]], shift: [f64; 2]) -> bool {
        let moved = self.moved(shift);
        let (most, mut missing) = (most_missing(points.len()), 0);
        points.iter().all(|p| {
            missing += usize::from(self.height(p, moved).is_none());
            missing <= most
        })
    }

    /// A shift along the patch, in the map's axes.
    fn moved(&self, shift: [f64; 2]) -> [f64; 3] {
        let [u, v, _] = self.axes;
        std::array::from_fn(|a| shift[0] * u[a] + shift[1] * v[a])
    }

    /// How far a point of the patch, `moved`, lies from the tangent plane of the map's nearest point, along the patch's normal; `None`
    /// where there is no such surface, or it faces another way.
    fn height(&self, point: &[f64; 3], moved: [f64; 3]) -> Option<f64> {
        let at: [f64; 3] = std::array::from_fn(|a| point[a] + moved[a]);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "offsets within f32's range"
        )]
        let near = self
            .map
            .tree
            .nearest_within(at.map(|c| c as f32), self.reach as f32)?;
        let i = near.index as usize;
        let (q, m) = (
            self.map.points[i].map(f64::from),
            self.map.normals[i].map(f64::from),
        );
        let facing = dot(m, self.axes[2]);
        (facing >= SIDE).then(|| dot(sub(at, q), m) / facing)
    }
}

/// Points of so many that may lie off the map.
#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts"
)]
fn most_missing(points: usize) -> usize {
    ((1.0 - ON_MAP) * points as f64) as usize
}

/// Mean square distance, along the third axis, of points from the plane fitted to them.
fn about_plane(points: &[[f64; 3]]) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let n = points.len().max(1) as f64;
    let mean: [f64; 3] = std::array::from_fn(|a| points.iter().map(|p| p[a]).sum::<f64>() / n);
    let (mut xx, mut xy, mut yy, mut xz, mut yz, mut zz) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for p in points {
        let [x, y, z] = sub(*p, mean);
        xx += x * x;
        xy += x * y;
        yy += y * y;
        xz += x * z;
        yz += y * z;
        zz += z * z;
    }
    let det = xx * yy - xy * xy;
    if !(det > 1e-9 * xx * yy) {
        return zz / n;
    }
    let (a, b) = ((xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det);
    (zz - a * xz - b * yz).max(0.0) / n
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_world::{drift, surface};

    const LENGTHS: [f64; 2] = [0.75, 0.6];

    fn asked(map: &Surface<'_>, query: &Surface<'_>, pose: Pose) -> Relief {
        let patches = patches(query, 1.5, 300);
        ask(map, query.origin, &patches, &|_| pose, LENGTHS)
    }

    #[test]
    fn the_rock_knows_its_place_and_no_other() {
        let map = surface(&drift(120_000, 40.0, 0.3, 0.01, 1), 0.15);
        let part: Vec<[f64; 3]> = drift(120_000, 40.0, 0.3, 0.01, 2)
            .into_iter()
            .filter(|p| p[0] > 5.0 && p[0] < 25.0)
            .collect();
        let query = surface(&part, 0.15);
        let right = asked(&map, &query, Pose::identity());
        assert!(right.asked > 60 && right.share() > 0.8, "{right:?}");
        assert!(right.significance() > 8.0);
        // A few centimetres off it is still the same rock, ten metres on it is not, and where there is no map nothing is asked.
        let near = asked(&map, &query, Pose::from_translation([0.05, -0.04, 0.03]));
        assert!(near.share() > 0.7, "{near:?}");
        for metres in [-4.0, 6.0, 11.0] {
            let wrong = asked(&map, &query, Pose::from_translation([metres, 0.0, 0.0]));
            assert!(wrong.asked > 30 && wrong.significance() < 1.0, "{wrong:?}");
        }
        let nowhere = asked(&map, &query, Pose::from_translation([500.0, 0.0, 0.0]));
        assert_eq!(nowhere, Relief::default());
        assert_eq!((nowhere.share(), nowhere.excess()), (0.0, 0.0));
        assert!(nowhere.significance() == 0.0);
    }

    #[test]
    fn a_bare_tube_says_no_more_than_chance() {
        let map = surface(&drift(120_000, 40.0, 0.0, 0.01, 1), 0.15);
        let query = surface(&drift(60_000, 20.0, 0.0, 0.01, 2), 0.15);
        let bare = asked(&map, &query, Pose::from_translation([10.0, 0.0, 0.0]));
        assert!(bare.asked > 60 && bare.significance() < 1.0, "{bare:?}");
    }

    #[test]
    fn few_points_make_no_patches() {
        let few = surface(&drift(60, 20.0, 0.3, 0.01, 2), 0.2);
        assert!(patches(&few, 2.0, 100).is_empty());
        let many = surface(&drift(60_000, 20.0, 0.3, 0.01, 2), 0.2);
        assert!(patches(&many, 2.0, 10).len() <= 10);
        assert!(patches(&Surface::default(), 2.0, 10).is_empty());
    }
}
