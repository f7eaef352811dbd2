//! Fast point feature histograms (Rusu, Blodow & Beetz 2009), 33 numbers a keypoint.
//!
//! For each pair of a point and a neighbour within the radius, three angles between their normals
//! and the line that joins them go into three histograms of eleven bins: the point's SPFH. The FPFH of a
//! keypoint sums the SPFHs of its neighbours, nearer ones more ([`DescriptorVariant`](crate::config::DescriptorVariant)).
//!
//! Neighbours come from the whole prepared cloud, not from the keypoints alone. Normals that are
//! undefined (`[0, 0, 0]`) take no part.
//!
//! Order of the 33 numbers, as in PCL and Open3D: eleven bins of θ = atan2(w·n, u·n) over ±π, of
//! α = v·n over ±1, of φ = u·d over ±1, in the Darboux frame u, v = d×u, w = u×v of the pair.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use crate::cancel;
use crate::columns::{Columns, Memory};
use crate::config::FpfhConfig;
use crate::kdtree::KdTree;
use crate::neighbours::{GROUP, LANES};
use crate::simd::bits;

mod around;
mod pairs;
#[cfg(test)]
mod tests;

use around::{Search, finished, mark};

/// Bins of one histogram.
pub const BINS: usize = 11;
/// Numbers of one descriptor: three histograms.
pub const DIMENSIONS: usize = 3 * BINS;

/// One descriptor; each of its three parts sums to 100, or 200 in the variant of Open3D.
pub type Descriptor = [f32; DIMENSIONS];

/// Descriptors at `keypoints` (indices into `points`) at the pipeline's `voxel` size (metres).
///
/// `normals` must be unit or zero, one a point, oriented by one rule for the whole cloud; with
/// [`FpfhConfig::unsigned`] their signs do not matter. A keypoint whose own normal is undefined or
/// that has no neighbour with a normal gets a zero descriptor.
#[must_use]
pub fn descriptors(
    points: &[[f32; 3]],
    normals: &[[f32; 3]],
    tree: &KdTree<'_>,
    keypoints: &[u32],
    config: &FpfhConfig,
    voxel: f64,
) -> Vec<Descriptor> {
    let Ok(found) = descriptors_in((points, normals), tree, keypoints, config, voxel, &Memory);
    found
}

/// Keypoints described at a time: their neighbours' SPFHs are held meanwhile.
const BLOCK: usize = 1 << 14;

/// As [`descriptors`] of `(points, normals)`, in `columns`.
///
/// # Errors
/// Where a column cannot be had.
pub fn descriptors_in<C: Columns>(
    (points, normals): (&[[f32; 3]], &[[f32; 3]]),
    tree: &KdTree<'_>,
    keypoints: &[u32],
    config: &FpfhConfig,
    voxel: f64,
    columns: &C,
) -> Result<C::Column<Descriptor>, C::Error> {
    #[expect(clippy::cast_possible_truncation, reason = "a radius in metres")]
    let radius = config.radius.metres(voxel) as f32;
    let mut out = columns.zeros::<Descriptor>(keypoints.len())?;
    // Where a point's SPFH is found in its block, one up; 0 for none. By its place in the tree's leaf order.
    let mut slot = columns.zeros::<u32>(tree.len())?;
    let ordered = by_place(keypoints, points.len(), tree, columns)?;
    let seen: Vec<AtomicU64> = (0..tree.len().div_ceil(64)).map(|_| 0.into()).collect();
    let cloud = Described {
        normals,
        tree,
        radius,
    };
    for block in ordered.chunks(BLOCK) {
        let places: Vec<u32> = block.iter().map(|[place, _]| *place).collect();
        // SPFHs are wanted at the keypoints and all their neighbours, each once, in memory order, so that those that
        // follow each other share their neighbours.
        let needed = cloud.neighbours_of(&places, &seen);
        for (number, place) in (1u32..).zip(&needed) {
            slot[*place as usize] = number;
        }
        let mut spfh = vec![[0.0; DIMENSIONS]; needed.len()];
        cloud.by_groups(&needed, &mut spfh, |search, places, rows| {
            search.take_normals(&cloud);
            for (place, row) in places.iter().zip(rows) {
                *row = search.spfh(
                    cloud.at(*place),
                    cloud.normal(*place),
                    radius,
                    config.unsigned,
                );
            }
        });
        let mut made = vec![[0.0; DIMENSIONS]; places.len()];
        cloud.by_groups(&places, &mut made, |search, places, made| {
            search.take_slots(&slot);
            for (place, made) in places.iter().zip(made) {
                // A keypoint without a normal has no number for a place.
                let own = slot[*place as usize] as usize;
                if let Some(own) = own.checked_sub(1).and_then(|own| spfh.get(own)) {
                    let (sum, count) =
                        search.weighed(&spfh, cloud.at(*place), radius, config.variant);
                    *made = finished(sum, count, own, config.variant);
                }
            }
        });
        for ([_, which], made) in block.iter().zip(made) {
            out[*which as usize] = made;
        }
        for place in needed {
            slot[place as usize] = 0;
        }
    }
    Ok(out)
}

/// The places of keypoints in the tree's leaf order, ascending, and where each stands in `keypoints`. Those that are not in
/// the tree, for they are not finite, are left out.
fn by_place<C: Columns>(
    keypoints: &[u32],
    points: usize,
    tree: &KdTree<'_>,
    columns: &C,
) -> Result<C::Column<[u32; 2]>, C::Error> {
    const NOWHERE: u32 = u32::MAX;
    let mut places = columns.zeros::<u32>(if tree.order().is_empty() { 0 } else { points })?;
    places.fill(NOWHERE);
    for (place, name) in (0u32..).zip(tree.order()) {
        places[*name as usize] = place;
    }
    let place = |name: u32| {
        if !places.is_empty() {
            places[name as usize]
        } else if (name as usize) < tree.len() {
            name
        } else {
            NOWHERE
        }
    };
    let found = keypoints.iter().filter(|k| place(**k) != NOWHERE).count();
    let mut ordered = columns.zeros::<[u32; 2]>(found)?;
    let known = (0u32..)
        .zip(keypoints)
        .filter(|(_, k)| place(**k) != NOWHERE);
    for (out, (which, k)) in ordered.iter_mut().zip(known) {
        *out = [place(*k), which];
    }
    ordered.par_sort_unstable();
    Ok(ordered)
}

/// What is described.
struct Described<'a> {
    normals: &'a [[f32; 3]],
    tree: &'a KdTree<'a>,
    radius: f32,
}

impl Described<'_> {
    fn at(&self, place: u32) -> [f32; 3] {
        let (_, axes) = self.tree.parts();
        axes.map(|a| a[place as usize])
    }

    fn normal(&self, place: u32) -> [f32; 3] {
        self.normals[self.tree.name(place as usize) as usize]
    }

    /// Fills `out`, one value a place (they ascend), by groups that lie together; `f` finds what lies near them gathered.
    fn by_groups<T: Send>(
        &self,
        places: &[u32],
        out: &mut [T],
        f: impl Fn(&mut Search, &[u32], &mut [T]) + Sync,
    ) {
        let near = |a: &u32, b: &u32| *a as usize / GROUP == *b as usize / GROUP;
        let mut rest = out;
        let mut groups = Vec::new();
        for group in places.chunk_by(near) {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(group.len());
            groups.push((group, own));
            rest = others;
        }
        groups.into_par_iter().with_min_len(16).for_each_init(
            Search::default,
            |search, (group, out)| {
                cancel::check();
                let mut left = 0..group.len();
                while !left.is_empty() {
                    let at = |k: usize| self.at(group[k]);
                    let together = search.near.gather(self.tree, self.radius, left.clone(), at);
                    left.start = together.end;
                    f(search, &group[together.clone()], &mut out[together]);
                }
            },
        );
    }

    /// The places that have a normal and lie near any of `places`, ascending. `seen` is a bit a place, all 0 before and after.
    fn neighbours_of(&self, places: &[u32], seen: &[AtomicU64]) -> Vec<u32> {
        self.by_groups(places, &mut vec![(); places.len()], |search, places, _| {
            let (all, axes) = search.near.gathered();
            search.within.clear();
            search.within.resize(axes[0].len() / LANES, 0);
            for place in places {
                mark(axes, self.at(*place), self.radius, &mut search.within);
            }
            for (block, within) in all.chunks(LANES).zip(&search.within) {
                for k in bits(*within) {
                    let place = block[k] as usize;
                    let (word, bit) = (&seen[place / 64], 1 << (place % 64));
                    if word.load(Ordering::Relaxed) & bit == 0 {
                        word.fetch_or(bit, Ordering::Relaxed);
                    }
                }
            }
        });
        let mut needed = Vec::new();
        for (first, word) in (0u32..).step_by(64).zip(seen) {
            let marked = word.load(Ordering::Relaxed);
            if marked == 0 {
                continue;
            }
            word.store(0, Ordering::Relaxed);
            for place in bits(marked).map(|k| first + k as u32) {
                if self.normal(place) != [0.0; 3] {
                    needed.push(place);
                }
            }
        }
        needed
    }
}
