//! Descriptor matching: nearest neighbours by Euclidean distance in descriptor space.
//!
//! Exact: by a [`DescriptorIndex`] over each side's descriptors, or one by one where they are few.

use rayon::prelude::*;

use crate::cancel;
use crate::columns::Memory;
use crate::config::MatchingConfig;
use crate::descriptor_index::{DescriptorIndex, Seen, build};
use crate::fpfh::Descriptor;

mod tiles;

use tiles::Tiles;

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

/// Nearest descriptors as (squared distance, index), nearest first.
type Nearest = Vec<(f32, u32)>;

/// The matches of each query descriptor among the map's, ordered by query keypoint, then by
/// distance.
///
/// The `neighbours` nearest map descriptors of each query descriptor. With `mutual`, a match stays
/// only if the query descriptor is in turn among the `neighbours` nearest of its map descriptor.
/// With a `ratio` below 1, a query descriptor whose nearest match is not closer than `ratio` times
/// the next one (the first beyond its `neighbours`) is dropped (Lowe 2004). Descriptors that are all
/// zero or not finite match nothing. Equal distances are ordered by index.
#[must_use]
pub fn match_descriptors(
    query: &[Descriptor],
    map: &[Descriptor],
    config: &MatchingConfig,
) -> Vec<Correspondence> {
    if map.len() <= FEW {
        return match_few(query, map, config);
    }
    let Ok(index) = build(map, &Memory);
    match_indexed(query, map, &index.view(), config)
}

/// So many map descriptors are compared one by one.
const FEW: usize = 2048;
/// Searches that one thread does in a row, at least.
const RUN: usize = 16;

fn match_few(
    query: &[Descriptor],
    map: &[Descriptor],
    config: &MatchingConfig,
) -> Vec<Correspondence> {
    let tiles = Tiles::of(map);
    let mut lists: Vec<Nearest> = query
        .par_iter()
        .with_min_len(RUN)
        .map(|q| {
            cancel::check();
            let mut found = Nearest::new();
            tiles.nearest_within(q, asked(config), f32::INFINITY, &mut found);
            accepted(found, config)
        })
        .collect();
    if config.mutual && config.neighbours > 0 {
        let tiles = Tiles::of(query);
        if config.neighbours == 1 {
            keep_each_others(&mut lists, |claims| {
                let first = |&(m, d2, q): &Claim| !tiles.any_before(&map[m as usize], (d2, q));
                claims.par_iter().with_min_len(RUN).map(first).collect()
            });
        } else {
            keep_mutual(&mut lists, map, |d, limit, found| {
                tiles.nearest_within(d, config.neighbours, limit, found);
            });
        }
    }
    flat(lists)
}

/// [`match_descriptors`] with an index at hand that was built from the map's descriptors.
#[must_use]
pub fn match_indexed(
    query: &[Descriptor],
    map: &[Descriptor],
    map_index: &DescriptorIndex<'_>,
    config: &MatchingConfig,
) -> Vec<Correspondence> {
    let seen = map_index.see(query);
    // Like ones follow each other, so that what they look at is in the cache.
    let order = map_index.in_order(&seen);
    let found: Vec<Nearest> = order
        .par_iter()
        .map(|&i| {
            cancel::check();
            let i = i as usize;
            let mut found = Nearest::new();
            let query = (&query[i], &seen[i]);
            map_index.nearest_seen(map, query, asked(config), f32::INFINITY, &mut found);
            accepted(found, config)
        })
        .collect();
    let mut lists = vec![Nearest::new(); query.len()];
    for (list, i) in found.into_iter().zip(order) {
        lists[i as usize] = list;
    }
    if config.mutual && config.neighbours > 0 {
        let index = map_index.over_seen(query, &seen);
        let index = index.view();
        if config.neighbours == 1 {
            keep_each_others(&mut lists, |claims| {
                let claimed: Vec<Descriptor> = claims.iter().map(|c| map[c.0 as usize]).collect();
                let seen = index.see(&claimed);
                let first = |(&(_, d2, q), m): (&Claim, (&Descriptor, &Seen))| {
                    !index.any_before(query, m, (d2, q))
                };
                let asked = claims.par_iter().zip(claimed.par_iter().zip(&seen));
                asked.map(first).collect()
            });
        } else {
            keep_mutual(&mut lists, map, |d, limit, found| {
                index.nearest_within(query, d, config.neighbours, limit, found);
            });
        }
    }
    flat(lists)
}

/// How many nearest ones are looked for.
fn asked(config: &MatchingConfig) -> usize {
    match config.neighbours {
        0 => 0,
        k => k.saturating_add((config.ratio < 1.0).into()),
    }
}

/// Of the nearest that were found, those that are matches.
fn accepted(mut found: Nearest, config: &MatchingConfig) -> Nearest {
    #[expect(clippy::cast_possible_truncation, reason = "a ratio")]
    let ratio = config.ratio as f32;
    if let (true, Some(first), Some(next)) = (
        config.ratio < 1.0,
        found.first(),
        found.get(config.neighbours),
    ) && first.0.sqrt() >= ratio * next.0.sqrt()
    {
        found.clear();
    }
    found.truncate(config.neighbours);
    found
}

fn flat(lists: Vec<Nearest>) -> Vec<Correspondence> {
    (0u32..)
        .zip(lists)
        .flat_map(|(query, list)| {
            list.into_iter().map(move |(d2, map)| Correspondence {
                query,
                map,
                distance: d2.sqrt(),
            })
        })
        .collect()
}

/// A match as the map sees it: map descriptor, squared distance, query descriptor.
type Claim = (u32, f32, u32);

/// Of single matches, keeps those whose map descriptor has no nearer query descriptor, as `first` says of each.
fn keep_each_others(lists: &mut [Nearest], first: impl Fn(&[Claim]) -> Vec<bool>) {
    // Of those that found the same one the nearest alone can be its own nearest.
    let mut claims: Vec<Claim> = (0u32..)
        .zip(&*lists)
        .flat_map(|(q, list)| list.iter().map(move |&(d2, m)| (m, d2, q)))
        .collect();
    claims
        .par_sort_unstable_by(|a, b| (a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))).then(a.2.cmp(&b.2)));
    claims.dedup_by_key(|c| c.0);
    let kept = first(&claims);
    for list in &mut *lists {
        list.clear();
    }
    for (&(m, d2, q), _) in claims.iter().zip(kept).filter(|(_, kept)| *kept) {
        lists[q as usize].push((d2, m));
    }
}

/// Of each query descriptor's matches, keeps those whose map descriptor has it among its nearest, which `nearest`
/// finds within a squared distance.
fn keep_mutual(
    lists: &mut [Nearest],
    map: &[Descriptor],
    nearest: impl Fn(&Descriptor, f32, &mut Nearest) + Sync,
) {
    // Only what was matched is asked back, and no further than its furthest match.
    let mut asked: Vec<(u32, f32)> = lists.iter().flatten().map(|&(d2, m)| (m, d2)).collect();
    asked.par_sort_unstable_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)));
    asked.dedup_by_key(|a| a.0);
    let back: Vec<Nearest> = asked
        .par_iter()
        .map(|&(m, limit)| {
            cancel::check();
            let mut found = Nearest::new();
            if let Some(d) = map.get(m as usize) {
                nearest(d, limit, &mut found);
            }
            found
        })
        .collect();
    for (q, list) in (0u32..).zip(lists) {
        list.retain(|&(_, m)| {
            asked
                .binary_search_by_key(&m, |a| a.0)
                .is_ok_and(|i| back[i].iter().any(|b| b.1 == q))
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fpfh::DIMENSIONS;
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
            // The other way of the two.
            let Ok(index) = build(&d, &Memory);
            for mutual in [false, true] {
                let config = config(k, mutual, 1.0);
                prop_assert_eq!(match_indexed(&q, &d, &index.view(), &config), match_few(&q, &d, &config));
            }
        }
    }

    /// What [`match_descriptors`] promises, straight from its words.
    fn plainly(
        query: &[Descriptor],
        map: &[Descriptor],
        config: &MatchingConfig,
    ) -> Vec<Correspondence> {
        let usable = |d: &Descriptor| d.iter().any(|v| *v != 0.0);
        let nearest = |from: &Descriptor, to: &[Descriptor]| {
            let mut all: Nearest = (0u32..)
                .zip(to)
                .filter(|(_, t)| usable(t) && usable(from))
                .map(|(i, t)| {
                    let mut sum = 0.0f32;
                    for (a, b) in t.iter().zip(from) {
                        sum += (a - b) * (a - b);
                    }
                    (sum, i)
                })
                .filter(|n| n.0 < f32::INFINITY)
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            all
        };
        let k = config.neighbours;
        let mut out = Vec::new();
        for (q, d) in (0u32..).zip(query) {
            let found = nearest(d, map);
            if config.ratio < 1.0 && found.len() > k {
                let (first, next) = (found[0].0.sqrt(), found[k].0.sqrt());
                if first >= config.ratio as f32 * next {
                    continue;
                }
            }
            for &(d2, m) in found.iter().take(k) {
                let back = nearest(&map[m as usize], query);
                if !config.mutual || back.iter().take(k).any(|b| b.1 == q) {
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

    proptest! {
        // Not whole numbers, zeros and broken ones among them; near copies, for the ratio test.
        #[test]
        fn the_same_bits_as_the_plain_way(seed in 0u64..1000, n in 0usize..60, m in 0usize..150, k in 1usize..5, mutual: bool, ratio in 0.3..1.3f64) {
            let mut rng = Rng::new(seed, 3);
            let mut d = random(m, seed, 30.0);
            for row in &mut d {
                let v = rng.range(0.1, 3.0) as f32;
                *row = match rng.below(12) {
                    0 => [0.0; DIMENSIONS],
                    1 => [f32::NAN; DIMENSIONS],
                    2 => [1e30; DIMENSIONS],
                    _ => row.map(|x| x * v),
                };
            }
            let mut q = random(n, seed + 1, 30.0);
            for row in &mut q {
                if m > 0 && rng.below(3) > 0 {
                    let near = d[rng.below(m as u32) as usize];
                    *row = near.map(|x| x + rng.range(-0.5, 0.5) as f32 * x.abs().min(1.0));
                }
            }
            let config = config(k, mutual, ratio.min(1.0));
            let expected = plainly(&q, &d, &config);
            prop_assert_eq!(&match_descriptors(&q, &d, &config), &expected);
            let Ok(index) = build(&d, &Memory);
            prop_assert_eq!(&match_indexed(&q, &d, &index.view(), &config), &expected);
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
