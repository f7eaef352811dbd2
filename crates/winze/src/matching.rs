//! Descriptor matching: nearest neighbours by Euclidean distance in descriptor space.
//!
//! Brute force over all pairs, sixteen at a time in lanes of fixed order: 33 dimensions leave a tree
//! little to prune, and this is exact.

use rayon::prelude::*;

use crate::config::MatchingConfig;
use crate::fpfh::{DIMENSIONS, Descriptor};

/// A query keypoint and a map keypoint that look alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// Index among the query's keypoints.
    pub query: u32,
    /// Index among the map's keypoints.
    pub map: u32,
    /// Euclidean distance of their descriptors.
    pub distance: f32,
}

/// Query descriptors that one thread compares with all of the map's.
const TILE: usize = 512;
/// Tiles in work at once, at most.
const BATCH: usize = 32;
/// Map descriptors side by side: their distances are summed in lanes, dimension after dimension.
const LANES: usize = 16;

/// The matches of each query descriptor among the map's, ordered by query keypoint, then by
/// distance.
///
/// The `neighbours` nearest map descriptors of each query descriptor. With `mutual`, a match stays
/// only if the query descriptor is in turn among the `neighbours` nearest of its map descriptor.
/// With a `ratio` below 1, a query descriptor whose nearest match is not closer than `ratio` times
/// the next one (the first beyond its `neighbours`) is dropped (Lowe 2004). All-zero
/// descriptors match nothing. Equal distances are ordered by index.
#[must_use]
pub fn match_descriptors(
    query: &[Descriptor],
    map: &[Descriptor],
    config: &MatchingConfig,
) -> Vec<Correspondence> {
    let k = config.neighbours;
    if k == 0 {
        return Vec::new();
    }
    let ratio_test = config.ratio < 1.0;
    let (forward, backward) = nearest(
        query,
        map,
        k + usize::from(ratio_test),
        if config.mutual { k } else { 0 },
    );
    let mut out = Vec::new();
    for (q, i) in (0u32..).zip(0..query.len()) {
        let found = forward.of(i);
        let ambiguous = ratio_test
            && match (found.first(), found.get(k)) {
                #[expect(clippy::cast_possible_truncation, reason = "a ratio")]
                (Some(first), Some(next)) => first.0.sqrt() >= config.ratio as f32 * next.0.sqrt(),
                _ => false,
            };
        if ambiguous {
            continue;
        }
        for &(d2, m) in found.iter().take(k) {
            let returned =
                !config.mutual || backward.of(m as usize).iter().any(|&(_, back)| back == q);
            if returned {
                out.push(Correspondence {
                    query: q,
                    map: m,
                    distance: d2.sqrt(),
                });
            }
        }
    }
    out
}

/// Descriptors in groups of [`LANES`], a row a dimension, so that the loop over a group vectorises.
/// Lanes without a usable descriptor hold infinity and are near nothing.
fn groups(map: &[Descriptor]) -> Vec<[[f32; LANES]; DIMENSIONS]> {
    map.chunks(LANES)
        .map(|chunk| {
            std::array::from_fn(|d| {
                std::array::from_fn(|l| match chunk.get(l) {
                    Some(row) if is_usable(row) => row[d],
                    _ => f32::INFINITY,
                })
            })
        })
        .collect()
}

fn is_usable(d: &Descriptor) -> bool {
    d.iter().any(|v| *v != 0.0)
}

/// For each of some descriptors the `k` nearest of the others, as (squared distance, index), nearest
/// first. Empty places hold infinity.
struct Lists {
    k: usize,
    places: Vec<(f32, u32)>,
}

impl Lists {
    fn new(count: usize, k: usize) -> Self {
        Self {
            k,
            places: vec![(f32::INFINITY, u32::MAX); count * k],
        }
    }

    /// The filled places of list `i`.
    fn of(&self, i: usize) -> &[(f32, u32)] {
        let list = &self.places[i * self.k..(i + 1) * self.k];
        &list[..list.partition_point(|n| n.0 < f32::INFINITY)]
    }

    /// What a distance must stay below to get into list `i`.
    #[inline]
    fn limit(&self, i: usize) -> f32 {
        self.places[(i + 1) * self.k - 1].0
    }

    /// Puts `new` into list `i` if it is among its nearest. Of equal ones the first that came stays
    /// first: offered in the order of their indices, ties keep that order.
    #[inline]
    fn offer(&mut self, i: usize, new: (f32, u32)) {
        let list = &mut self.places[i * self.k..(i + 1) * self.k];
        let mut at = list.len();
        while at > 0 && new.0 < list[at - 1].0 {
            at -= 1;
        }
        if at < list.len() {
            list[at..].rotate_right(1);
            list[at] = new;
        }
    }
}

/// The `k` nearest of `map` for each of `query`, and `back` (which may be 0) of `query` for each of
/// `map`, from the same distances.
fn nearest(query: &[Descriptor], map: &[Descriptor], k: usize, back: usize) -> (Lists, Lists) {
    let groups = groups(map);
    let mut forward = Lists {
        k,
        places: Vec::with_capacity(query.len() * k),
    };
    let mut backward = Lists::new(map.len(), back);
    // A few tiles at a time: each holds lists for the whole map.
    for (b, batch) in query.chunks(TILE * BATCH).enumerate() {
        let tiles: Vec<(Lists, Lists)> = batch
            .par_chunks(TILE)
            .enumerate()
            .map(|(t, rows)| tile((b * BATCH + t) * TILE, rows, &groups, k, back))
            .collect();
        for (rows, columns) in tiles {
            forward.places.extend(rows.places);
            // Tiles come in the order of the query's indices.
            for m in 0..if back > 0 { map.len() } else { 0 } {
                for new in columns.of(m) {
                    backward.offer(m, *new);
                }
            }
        }
    }
    (forward, backward)
}

/// All distances between some of the query's descriptors, from index `first` on, and all of the
/// map's.
fn tile(
    first: usize,
    rows: &[Descriptor],
    groups: &[[[f32; LANES]; DIMENSIONS]],
    k: usize,
    back: usize,
) -> (Lists, Lists) {
    let mut forward = Lists::new(rows.len(), k);
    let mut backward = Lists::new(groups.len() * LANES, back);
    // The columns' limits side by side, so that one comparison dismisses a whole group.
    let mut limits = vec![[if back > 0 { f32::INFINITY } else { 0.0 }; LANES]; groups.len()];
    for ((g, group), limits) in groups.iter().enumerate().zip(&mut limits) {
        for (i, row) in rows.iter().enumerate().filter(|(_, r)| is_usable(r)) {
            let distances = squared_distances(row, group);
            let limit = forward.limit(i);
            if distances.iter().fold(false, |any, d| any | (*d < limit)) {
                for (l, &d2) in distances.iter().enumerate() {
                    #[expect(clippy::cast_possible_truncation, reason = "below 2^32 keypoints")]
                    forward.offer(i, (d2, (g * LANES + l) as u32));
                }
            }
            if distances
                .iter()
                .zip(limits.iter())
                .fold(false, |any, (d, l)| any | (d < l))
            {
                for (l, &d2) in distances.iter().enumerate() {
                    let m = g * LANES + l;
                    #[expect(clippy::cast_possible_truncation, reason = "below 2^32 keypoints")]
                    backward.offer(m, (d2, (first + i) as u32));
                    limits[l] = backward.limit(m);
                }
            }
        }
    }
    (forward, backward)
}

/// Squared distances of `row` from a group, each summed over the dimensions in order.
#[inline]
fn squared_distances(row: &Descriptor, group: &[[f32; LANES]; DIMENSIONS]) -> [f32; LANES] {
    let mut sums = [0.0f32; LANES];
    for (x, lane) in row.iter().zip(group) {
        for l in 0..LANES {
            let d = lane[l] - x;
            sums[l] += d * d;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use proptest::prelude::*;

    fn random(n: usize, seed: u64, levels: f64) -> Vec<Descriptor> {
        let mut rng = Rng::new(seed, 0);
        (0..n)
            .map(|_| std::array::from_fn(|_| (rng.range(0.0, levels)).floor() as f32))
            .collect()
    }

    fn brute(query: &[Descriptor], map: &[Descriptor], k: usize) -> Vec<Vec<(f64, u32)>> {
        query
            .iter()
            .map(|q| {
                let mut all: Vec<(f64, u32)> = (0u32..)
                    .zip(map)
                    .map(|(i, m)| {
                        (
                            q.iter().zip(m).map(|(a, b)| f64::from(a - b).powi(2)).sum(),
                            i,
                        )
                    })
                    .collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                all.truncate(k);
                all
            })
            .collect()
    }

    fn config(neighbours: usize, mutual: bool, ratio: f64) -> MatchingConfig {
        MatchingConfig {
            neighbours,
            mutual,
            ratio,
        }
    }

    proptest! {
        // Integer descriptors: distances are exact, ties are many.
        #[test]
        fn the_nearest_of_brute_force(seed in 0u64..1000, n in 1usize..90, m in 1usize..700, k in 1usize..5, levels in 2.0..40.0f64) {
            let (q, d) = (random(n, seed, levels), random(m, seed + 1, levels));
            let expected = brute(&q, &d, k);
            let back = brute(&d, &q, k);
            let usable = |d: &Descriptor| d.iter().any(|v| *v != 0.0);
            prop_assume!(q.iter().all(usable) && d.iter().all(usable));
            let all: Vec<(u32, u32)> = (0u32..).zip(&expected).flat_map(|(i, l)| l.iter().map(move |e| (i, e.1))).collect();
            let ours: Vec<(u32, u32)> = match_descriptors(&q, &d, &config(k, false, 1.0)).iter().map(|c| (c.query, c.map)).collect();
            prop_assert_eq!(&ours, &all);
            let mutual: Vec<(u32, u32)> = all.into_iter().filter(|&(i, j)| back[j as usize].iter().any(|b| b.1 == i)).collect();
            let ours: Vec<(u32, u32)> = match_descriptors(&q, &d, &config(k, true, 1.0)).iter().map(|c| (c.query, c.map)).collect();
            prop_assert_eq!(ours, mutual);
        }
    }

    #[test]
    fn the_ratio_test_drops_what_has_a_double() {
        let mut d = random(3, 1, 50.0);
        let q = vec![d[0].map(|v| v + 0.5), d[2].map(|v| v + 0.1)];
        d[1] = d[0].map(|v| v + 1.0);
        let kept = match_descriptors(&q, &d, &config(1, false, 0.8));
        assert_eq!(kept.len(), 1);
        assert_eq!((kept[0].query, kept[0].map), (1, 2));
        assert!((kept[0].distance - 0.1 * 33f32.sqrt()).abs() < 1e-3);
    }

    #[test]
    fn empty_and_zero_descriptors_match_nothing() {
        let d = random(5, 1, 9.0);
        let zero = vec![[0.0; DIMENSIONS]; 3];
        for (a, b) in [
            (&d, &zero),
            (&zero, &d),
            (&zero, &zero),
            (&d, &Vec::new()),
            (&Vec::new(), &d),
        ] {
            assert!(match_descriptors(a, b, &config(2, true, 0.9)).is_empty());
        }
    }
}
