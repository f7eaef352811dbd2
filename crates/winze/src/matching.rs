//! Descriptor matching: nearest neighbours by Euclidean distance in descriptor space.
//!
//! Exact, by a [`DescriptorIndex`] over each side's descriptors.

use rayon::prelude::*;

use crate::cancel;
use crate::columns::Memory;
use crate::config::MatchingConfig;
use crate::descriptor_index::{DescriptorIndex, build};
use crate::fpfh::Descriptor;

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
    let Ok(index) = build(map, &Memory);
    match_indexed(query, map, &index.view(), config)
}

/// [`match_descriptors`] with an index at hand that was built from the map's descriptors.
#[must_use]
pub fn match_indexed(
    query: &[Descriptor],
    map: &[Descriptor],
    map_index: &DescriptorIndex<'_>,
    config: &MatchingConfig,
) -> Vec<Correspondence> {
    let k = config.neighbours;
    if k == 0 {
        return Vec::new();
    }
    let ratio_test = config.ratio < 1.0;
    let mut lists: Vec<Nearest> = query
        .par_iter()
        .map(|q| {
            cancel::check();
            let mut found = Nearest::new();
            map_index.nearest(map, q, k.saturating_add(ratio_test.into()), &mut found);
            #[expect(clippy::cast_possible_truncation, reason = "a ratio")]
            let ratio = config.ratio as f32;
            if let (true, Some(first), Some(next)) = (ratio_test, found.first(), found.get(k))
                && first.0.sqrt() >= ratio * next.0.sqrt()
            {
                found.clear();
            }
            found.truncate(k);
            found
        })
        .collect();
    if config.mutual {
        keep_mutual(&mut lists, query, map, k);
    }
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

/// Of each query descriptor's matches, keeps those whose map descriptor has it among its `k` nearest.
fn keep_mutual(lists: &mut [Nearest], query: &[Descriptor], map: &[Descriptor], k: usize) {
    let Ok(index) = build(query, &Memory);
    let index = index.view();
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
                index.nearest_within(query, d, k, limit, &mut found);
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
            prop_assert_eq!(match_descriptors(&q, &d, &config), plainly(&q, &d, &config));
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
