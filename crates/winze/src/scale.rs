//! The length scale, from the data.
//!
//! A map is prepared at a few voxel sizes of its own, its [`levels`]; a query takes the one that suits it
//! ([`choose`]), and everything else is a multiple of that. Sizes
//! follow from three measurements: how far points lie apart (a voxel must hold a few), how wide the passages
//! are (descriptors must see a good part of a wall, not all of the mine), and how much surface the query
//! has (a small patch must still give enough points).
//!
//! Sizes come from a fixed ladder, half an octave a step, so that clouds prepared at one time and
//! another meet at the same size, and so that a little noise in a measurement changes nothing.

use crate::cloud::Cloud;
use crate::columns::Columns;
use crate::eigen3::eigen3;
use crate::kdtree::{self, KdTree};
use crate::normals;
use crate::parallel;
use crate::refine::sample;
use crate::voxel;

/// Steps of the ladder in a factor of two.
const STEPS_PER_OCTAVE: f64 = 2.0;
/// A passage is this many voxels wide.
const VOXELS_ACROSS: f64 = 14.0;
/// A voxel is at least this many point spacings wide.
const SPACINGS_PER_VOXEL: f64 = 2.0;
/// A query has at least about this many occupied voxels, where its spacing allows.
const QUERY_POINTS: usize = 6_000;
/// Points that measurements are taken from.
const SAMPLE: usize = 20_000;
/// Points that passage widths are measured at.
const RAYS: usize = 500;
/// Neighbours that a point is judged by.
const NEIGHBOURS: usize = 12;
/// Of a neighbourhood's eigenvalues, the smallest over the middle one: above this it is no wall.
const FLATNESS: f64 = 0.2;

pub use crate::spacing::spacing;

/// What was measured of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measure {
    /// Median distance of a point to its nearest neighbour, metres; duplicates do not count.
    pub spacing: f64,
    /// Median distance from a wall straight across to the opposite one, metres; `None` where too
    /// few points face anything, as on a single wall.
    pub width: Option<f64>,
    /// The same for the tenth that is narrowest and the tenth that is widest, metres.
    pub width_range: Option<[f64; 2]>,
    /// Largest voxel on the ladder that still leaves about 6 000 points, metres.
    pub budget: f64,
}

/// Measures `cloud`; `None` where it has fewer than two distinct points.
#[must_use]
pub fn measure(cloud: &Cloud) -> Option<Measure> {
    let spacing = spacing(cloud.points())?;
    Some(of_even(cloud.clone(), spacing, spacing))
}

/// Measures a map by its base: points thinned to `voxel` metres, which is [`base_voxel`] of its raw points'
/// `spacing` unless a size was asked for.
///
/// # Errors
/// Where a column cannot be had.
pub fn measure_base<C: Columns>(
    (base, voxel): (&[[f32; 3]], f64),
    origin: [f64; 3],
    spacing: f64,
    columns: &C,
) -> Result<Measure, C::Error> {
    let mut size = 2.0 * voxel;
    let mut even = voxel::thin(base, None, origin, size, columns)?;
    // Cells of a surface grow fewer as the square of their size: one big step comes near the sample.
    #[expect(clippy::cast_precision_loss, reason = "a count")]
    let octaves = (libm::log2(even.len() as f64 / SAMPLE as f64) / 2.0 - 1.0).floor();
    let coarse = size * libm::exp2(octaves.max(0.0));
    let few = voxel::thin(&even, None, origin, coarse, columns)?;
    let few = Cloud::from_offsets(origin, few.to_vec());
    let mut measure = of_even(few, coarse, spacing);
    // Passages are measured at a size that does not grow with the map. Too fine, the roughness of a wall passes for
    // another one; too coarse, the search begins behind the other one. Both show as widths about where it begins.
    (measure.width, measure.width_range) = (None, None);
    let mut clearest = 0.0;
    for _ in 0..WIDTH_SIZES {
        if even.len() < NEIGHBOURS * WALL {
            break;
        }
        let tree = kdtree::build_in(&even, columns)?;
        let tree = tree.view();
        let rays = rays(&even, &tree);
        let across = widths(&tree, &rays, size);
        let clear = across
            .get(across.len() / 2)
            .map_or(0.0, |w| w / first(size));
        if clear > clearest {
            clearest = clear;
            measure = measure.with_widths(&across);
        }
        if clear >= CLEAR {
            break;
        }
        size *= 2.0;
        even = voxel::thin(&even, None, origin, size, columns)?;
    }
    Ok(measure)
}

/// Sizes at which the width of passages is looked for, each twice the one before, at most.
const WIDTH_SIZES: usize = 5;
/// A width so many times the distance at which the search begins is believed at once.
const CLEAR: f64 = 2.0;

impl Measure {
    /// With what `across`, ascending, tells of passages.
    fn with_widths(self, across: &[f64]) -> Self {
        let at = |tenths: usize| across.get(across.len() * tenths / 10).copied();
        Self {
            width: at(5),
            width_range: at(1).zip(at(9)).map(|(a, b)| [a, b]),
            ..self
        }
    }
}

/// Measures a cloud of points that lie `spacing` apart, given what it becomes when it is thinned to `size`.
fn of_even(mut even: Cloud, mut size: f64, spacing: f64) -> Measure {
    // Even out the density first: the nearest wall is sampled far more often than the rest.
    while even.len() > SAMPLE {
        size *= std::f64::consts::SQRT_2;
        even = voxel::downsample(&even, size);
    }
    let (walls, normals) = walls(even.points());
    let even = even.select(&walls);
    let mut budget = ladder(spacing);
    while voxel::downsample(&even, step(budget, 1)).len() > QUERY_POINTS {
        budget = step(budget, 1);
    }
    let stride = even.len().div_ceil(RAYS).max(1);
    let rays: Vec<Ray> = even
        .points()
        .iter()
        .copied()
        .zip(normals)
        .step_by(stride)
        .collect();
    let tree = KdTree::build(even.points());
    let measure = Measure {
        spacing,
        width: None,
        width_range: None,
        budget,
    };
    measure.with_widths(&widths(&tree, &rays, size))
}

/// A voxel is at least this many point spacings wide where no better one is left.
const FEWEST_SPACINGS: f64 = 1.2;

/// The voxel of a map's base, metres: the finest one on the ladder at which anything is prepared of a map
/// whose points lie `spacing` apart.
#[must_use]
pub fn base_voxel(spacing: f64) -> f64 {
    let finest = FEWEST_SPACINGS * spacing;
    let near = ladder(finest);
    if near < finest { step(near, 1) } else { near }
}

/// The voxel sizes at which a map is prepared, the finest first, metres: two or three, from what its
/// passages ask for down to what its points allow.
#[must_use]
pub fn levels(map: &Measure) -> Vec<f64> {
    let floor = SPACINGS_PER_VOXEL * map.spacing;
    let coarsest = ladder(
        map.width
            .map_or(map.budget, |w| w / VOXELS_ACROSS)
            .max(floor),
    );
    let steps = (libm::log2(coarsest / floor) * STEPS_PER_OCTAVE + 1e-9).floor();
    #[expect(clippy::cast_possible_truncation, reason = "a small number")]
    let steps = steps.clamp(0.0, 4.0) as i32;
    if steps >= 2 {
        let middle = steps.div_euclid(2) + steps % 2;
        return [steps, middle, 0].map(|s| step(coarsest, -s)).to_vec();
    }
    let (finer, coarser) = (step(coarsest, -1), step(coarsest, 1));
    if finer >= FEWEST_SPACINGS * map.spacing {
        vec![finer, coarsest, coarser]
    } else {
        vec![coarsest, coarser]
    }
}

/// Which of a map's `levels` to try for a query, as indices, the best guess first, at most `tries`. None that is finer
/// than the query's own spacing allows, unless there is no other.
#[must_use]
pub fn choose(levels: &[f64], map: &Measure, query: &Measure, tries: usize) -> Vec<usize> {
    let wanted = voxel_for(map, query);
    let mut order: Vec<usize> = (0..levels.len()).collect();
    let off = |i: &usize| libm::log2(levels[*i] / wanted).abs();
    order.sort_by(|a, b| off(a).total_cmp(&off(b)).then(a.cmp(b)));
    let fit = |i: &usize| levels[*i] >= FEWEST_SPACINGS * query.spacing;
    if order.iter().any(fit) {
        order.retain(fit);
    }
    order.truncate(tries);
    order
}

/// The voxel size for a map and a query, metres, on the ladder.
#[must_use]
pub fn voxel_for(map: &Measure, query: &Measure) -> f64 {
    let across = match (query.width, map.width) {
        (Some(w), _) | (None, Some(w)) => w / VOXELS_ACROSS,
        (None, None) => f64::INFINITY,
    };
    let floor = SPACINGS_PER_VOXEL * map.spacing.max(query.spacing);
    ladder(across.min(query.budget).max(floor))
}

/// The ladder's size nearest to `size`.
fn ladder(size: f64) -> f64 {
    let k = (libm::log2(size / 0.1) * STEPS_PER_OCTAVE).round();
    0.1 * libm::exp2(k / STEPS_PER_OCTAVE)
}

/// `k` steps up the ladder from `size`.
fn step(size: f64, k: i32) -> f64 {
    ladder(size * libm::exp2(f64::from(k) / STEPS_PER_OCTAVE))
}

/// The points whose neighbourhood is flat, with its normal. Dust fills space instead.
fn walls(points: &[[f32; 3]]) -> (Vec<u32>, Vec<[f64; 3]>) {
    let tree = KdTree::build(points);
    let flat = parallel::map_with(points.len(), Vec::new, |found, i| {
        tree.knn(points[i], NEIGHBOURS, f32::INFINITY, found);
        let (covariance, _) = normals::covariance(points, points[i], found);
        let e = eigen3(&covariance);
        (e.values[0] < FLATNESS * e.values[1]).then_some(e.vectors[0])
    });
    (0u32..)
        .zip(flat)
        .filter_map(|(i, n)| Some((i, n?)))
        .unzip()
}

/// Points that a wall must show within the cone.
const WALL: usize = 6;

/// A point of a wall and the direction across it.
type Ray = ([f32; 3], [f64; 3]);

/// Rays from points here and there, where their neighbourhood is flat.
fn rays(points: &[[f32; 3]], tree: &KdTree<'_>) -> Vec<Ray> {
    let chosen = sample(points, 3 * RAYS);
    let flat = parallel::map_with(chosen.len(), Vec::new, |found, i| {
        tree.knn(chosen[i], NEIGHBOURS, f32::INFINITY, found);
        let (covariance, _) = normals::covariance(points, chosen[i], found);
        let e = eigen3(&covariance);
        (e.values[0] < FLATNESS * e.values[1]).then_some((chosen[i], e.vectors[0]))
    });
    flat.into_iter().flatten().collect()
}

/// Where the search along a ray begins in points thinned to `size` metres.
fn first(size: f64) -> f64 {
    6.0 * size
}

/// Distances straight across, ascending; none where too few rays meet anything. A thin cone is followed both
/// ways along each ray; the first surface it meets is the opposite wall.
fn widths(tree: &KdTree<'_>, rays: &[Ray], spacing: f64) -> Vec<f64> {
    let first = first(spacing);
    let mut across: Vec<f64> = parallel::map_with(rays.len(), Vec::new, |found, i| {
        let (p, n) = rays[i];
        let mut hit = |sign: f64| -> Option<f64> {
            let mut t = first;
            while t < 60.0 * first.max(0.5) {
                let at: [f32; 3] = std::array::from_fn(|a| {
                    #[expect(clippy::cast_possible_truncation, reason = "metres")]
                    let v = (f64::from(p[a]) + sign * t * n[a]) as f32;
                    v
                });
                #[expect(clippy::cast_possible_truncation, reason = "metres")]
                tree.knn(at, WALL, (0.2 * t).max(2.0 * spacing) as f32, found);
                if found.len() == WALL {
                    return Some(t);
                }
                t *= 1.15;
            }
            None
        };
        match (hit(1.0), hit(-1.0)) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    })
    .into_iter()
    .flatten()
    .collect();
    across.sort_unstable_by(f64::total_cmp);
    if across.len() * 3 >= rays.len() {
        across
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spacing::CLOSEST;
    use crate::test_world::{cloud, drift};

    #[test]
    fn a_drift_of_four_metres_is_measured() {
        let m = measure(&cloud(&drift(60_000, 40.0, 0.2, 0.01, 1))).unwrap();
        // 2 m radius, flattened to 1.6 m in height.
        let w = m.width.unwrap();
        assert!((2.6..4.4).contains(&w), "{m:?}");
        // 40 m x 11.4 m of wall, 60 000 points: Poisson spacing ½/√density.
        assert!((0.03..0.06).contains(&m.spacing), "{m:?}");
    }

    #[test]
    fn a_single_wall_has_no_width_but_a_scale() {
        let wall: Vec<[f64; 3]> = drift(30_000, 10.0, 0.3, 0.0, 1)
            .into_iter()
            .filter(|p| p[1] > 1.0)
            .collect();
        let m = measure(&cloud(&wall)).unwrap();
        assert_eq!(m.width, None);
        let voxel = voxel_for(&m, &m);
        assert!((0.02..0.2).contains(&voxel), "{m:?}: {voxel}");
    }

    #[test]
    fn sizes_lie_on_the_ladder_and_never_below_two_spacings() {
        let m = Measure {
            spacing: 0.12,
            width: Some(4.2),
            width_range: None,
            budget: 0.8,
        };
        assert_eq!(voxel_for(&m, &m), ladder(0.3));
        let dense = Measure {
            width: Some(1.0),
            ..m
        };
        assert_eq!(voxel_for(&dense, &dense), ladder(0.24));
        for size in levels(&m) {
            assert!((ladder(size) / size - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_map_s_levels_reach_from_its_passages_down_to_its_points() {
        let levels_of = |spacing: f64, width: Option<f64>, budget: f64| {
            let m = Measure {
                spacing,
                width,
                width_range: None,
                budget,
            };
            let found = levels(&m);
            assert!(
                found.is_sorted() && found[0] >= base_voxel(spacing),
                "{m:?} {found:?}"
            );
            found
                .iter()
                .map(|v| (v * 1000.0).round())
                .collect::<Vec<_>>()
        };
        // A survey of passages 4 m wide: at 5 cm, at 1 cm, and a sparse SLAM map of 13 cm and 30 cm.
        assert_eq!(levels_of(0.054, Some(3.9), 0.4), [141.0, 200.0, 283.0]);
        assert_eq!(levels_of(0.01, Some(4.0), 0.4), [71.0, 141.0, 283.0]);
        assert_eq!(levels_of(0.127, Some(4.3), 0.4), [200.0, 283.0, 400.0]);
        assert_eq!(levels_of(0.3, Some(4.3), 0.4), [400.0, 566.0, 800.0]);
        // A single wall has no width.
        assert_eq!(levels_of(0.02, None, 0.1), [50.0, 71.0, 100.0]);
    }

    #[test]
    fn a_query_chooses_among_a_map_s_levels() {
        let measure = |spacing, width| Measure {
            spacing,
            width: Some(width),
            width_range: None,
            budget: 1.0,
        };
        let map = measure(0.05, 4.0);
        let levels = [0.1, 0.141, 0.283];
        assert_eq!(choose(&levels, &map, &measure(0.03, 4.0), 3), [2, 1, 0]);
        assert_eq!(choose(&levels, &map, &measure(0.03, 2.0), 2), [1, 0]);
        // Nothing finer than its points allow, or else the least bad.
        assert_eq!(choose(&levels, &map, &measure(0.11, 2.0), 3), [2, 1]);
        assert_eq!(choose(&levels, &map, &measure(5.0, 2.0), 1), [2]);
    }

    #[test]
    fn the_measure_of_a_base_is_near_that_of_its_cloud() {
        let c = cloud(&drift(60_000, 40.0, 0.2, 0.01, 1));
        let whole = measure(&c).unwrap();
        let base = crate::base::base_of(&c, base_voxel(whole.spacing));
        let Ok(of_base) = measure_base(
            (&base.points, base_voxel(whole.spacing)),
            c.origin(),
            whole.spacing,
            &crate::columns::Memory,
        );
        assert!((of_base.width.unwrap() / whole.width.unwrap() - 1.0).abs() < 0.2);
        let [narrow, wide] = of_base.width_range.unwrap();
        assert!(narrow <= of_base.width.unwrap() && wide >= of_base.width.unwrap());
    }

    #[test]
    fn a_long_map_s_passages_are_as_wide_as_a_short_one_s() {
        // Far more of it than the sample that sizes are otherwise taken from.
        let c = cloud(&drift(600_000, 1_500.0, 0.2, 0.01, 1));
        let spacing = spacing(c.points()).unwrap();
        let voxel = base_voxel(spacing);
        let base = crate::base::base_of(&c, voxel);
        let points = (&base.points[..], voxel);
        let Ok(m) = measure_base(points, c.origin(), spacing, &crate::columns::Memory);
        assert!((2.6..4.6).contains(&m.width.unwrap()), "{m:?}");
    }

    #[test]
    fn nothing_to_measure() {
        assert!(measure(&cloud(&[])).is_none());
        assert!(measure(&cloud(&[[1.0; 3]; 50])).is_none());
        let m = measure(&cloud(&[[0.0; 3], [1.0, 0.0, 0.0]])).unwrap();
        assert_eq!((m.spacing, m.width), (1.0, None));
    }

    #[test]
    fn copies_and_near_copies_of_points_do_not_count() {
        let points = drift(3_000, 10.0, 0.2, 0.0, 1);
        let once = measure(&cloud(&points)).unwrap();
        let copies: Vec<[f64; 3]> = (0..100).flat_map(|_| points.iter().copied()).collect();
        let often = measure(&cloud(&copies)).unwrap();
        assert!(
            (often.spacing / once.spacing - 1.0).abs() < 0.2,
            "{often:?}"
        );
        let twice: Vec<[f64; 3]> = points
            .iter()
            .flat_map(|p| [*p, [p[0] + 1e-5, p[1], p[2]]])
            .collect();
        assert!(measure(&cloud(&twice)).unwrap().spacing >= CLOSEST);
    }
}
