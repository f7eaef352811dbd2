//! How far apart the points of a cloud lie, whether it is at hand or comes in pieces.

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use crate::cancel;
use crate::kdtree::KdTree;
use crate::parallel;
use crate::refine::sample;

/// Points at which spacing is measured.
const SAMPLE: u64 = 2_000;

/// Points nearer to each other than this, metres, are one measured twice, with rounding.
pub(crate) const CLOSEST: f64 = 0.001;

/// Points that one thread looks at in turn.
const PIECE: usize = 1 << 15;

/// Of `count` points each this many-th is one at which spacing is measured.
#[must_use]
pub fn stride(count: u64) -> u64 {
    count.div_ceil(SAMPLE).max(1)
}

/// Median distance from a point to the nearest that does not lie at the same place, over an even sample,
/// metres, at least a millimetre; `None` where there are no two distinct points.
#[must_use]
pub fn spacing(points: &[[f32; 3]]) -> Option<f64> {
    let tree = KdTree::build(points);
    #[expect(clippy::cast_possible_truncation, reason = "a small number")]
    let chosen = sample(points, SAMPLE as usize);
    let nearest = parallel::map_with(
        chosen.len(),
        || (),
        |(), i| Some(tree.nearest_other(chosen[i])?.distance_squared),
    );
    median(nearest.into_iter().flatten().collect())
}

fn median(mut squared: Vec<f32>) -> Option<f64> {
    if squared.is_empty() {
        return None;
    }
    let middle = squared.len() / 2;
    let d2 = *squared.select_nth_unstable_by(middle, f32::total_cmp).1;
    Some(f64::from(d2).sqrt().max(CLOSEST))
}

/// The same as [`spacing`], of points that come in pieces.
#[derive(Debug, Clone)]
pub struct SpacingSurvey {
    chosen: Vec<[f32; 3]>,
    reach: f32,
    /// Those of the chosen that lie in a cell or next to it.
    near: FxHashMap<[i32; 3], Vec<u32>>,
    /// Squared distance from each to the nearest other point that came so far.
    nearest: Vec<f32>,
}

/// What a [`SpacingSurvey`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Surveyed {
    /// The spacing, metres; `None` where all points are the same.
    Spacing(Option<f64>),
    /// Most of the points have no neighbour within reach: look once more, with this reach, metres.
    LookFurther(f64),
}

impl SpacingSurvey {
    /// At the points `chosen` (each [`stride`]-th), looking no further than `reach` metres.
    #[must_use]
    pub fn new(chosen: Vec<[f32; 3]>, reach: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "metres")]
        let reach = reach.clamp(1e-4, 1e6) as f32;
        let mut near: FxHashMap<[i32; 3], Vec<u32>> = FxHashMap::default();
        for (i, p) in (0u32..).zip(&chosen) {
            let c = cell(*p, reach);
            for z in -1..=1 {
                for y in -1..=1 {
                    for x in -1..=1 {
                        near.entry([c[0] + x, c[1] + y, c[2] + z])
                            .or_default()
                            .push(i);
                    }
                }
            }
        }
        let nearest = vec![f32::INFINITY; chosen.len()];
        Self {
            chosen,
            reach,
            near,
            nearest,
        }
    }

    /// Takes the next piece.
    pub fn add(&mut self, points: &[[f32; 3]]) {
        let (chosen, near, reach) = (&self.chosen, &self.near, self.reach);
        let found: Vec<Vec<f32>> = points
            .par_chunks(PIECE)
            .map(|piece| {
                cancel::check();
                let mut found = vec![f32::INFINITY; chosen.len()];
                for p in piece {
                    for &i in near.get(&cell(*p, reach)).into_iter().flatten() {
                        let q = chosen[i as usize];
                        let d = [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
                        // As the tree rounds it.
                        let d2 = (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2];
                        if d2 > 0.0 && d2 < found[i as usize] {
                            found[i as usize] = d2;
                        }
                    }
                }
                found
            })
            .collect();
        for piece in found {
            for (nearest, d2) in self.nearest.iter_mut().zip(piece) {
                *nearest = nearest.min(d2);
            }
        }
    }

    /// The spacing, or how far to look for it.
    #[must_use]
    pub fn finish(self) -> Surveyed {
        let limit = self.reach * self.reach;
        let within = self.nearest.iter().filter(|d2| **d2 <= limit).count();
        // Whatever lies beyond the reach cannot be the median.
        if within > self.nearest.len() / 2 {
            return Surveyed::Spacing(median(self.nearest));
        }
        if self.reach >= 1e6 {
            let known = self.nearest.into_iter().filter(|d2| d2.is_finite());
            return Surveyed::Spacing(median(known.collect()));
        }
        Surveyed::LookFurther(8.0 * f64::from(self.reach))
    }
}

fn cell(p: [f32; 3], size: f32) -> [i32; 3] {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturates, far from its bounds"
    )]
    p.map(|v| {
        // In 64 bits, lest neighbours end up two cells apart.
        let at = (f64::from(v) / f64::from(size)).floor() as i32;
        at.clamp(i32::MIN + 1, i32::MAX - 1)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    fn survey(points: &[[f32; 3]], mut reach: f64, piece: usize) -> (Option<f64>, usize) {
        let step = stride(points.len() as u64) as usize;
        let chosen: Vec<[f32; 3]> = points.iter().step_by(step).copied().collect();
        for looks in 1.. {
            let mut survey = SpacingSurvey::new(chosen.clone(), reach);
            points.chunks(piece).for_each(|p| survey.add(p));
            match survey.finish() {
                Surveyed::Spacing(spacing) => return (spacing, looks),
                Surveyed::LookFurther(further) => reach = further,
            }
        }
        unreachable!()
    }

    #[test]
    fn pieces_give_the_spacing_of_the_whole() {
        let mut rng = Rng::new(4, 0);
        let mut points: Vec<[f32; 3]> = (0..9_000)
            .map(|_| rng.direction().map(|v| (20.0 * v) as f32))
            .collect();
        // Copies do not count.
        points.extend_from_within(..3_000);
        let whole = spacing(&points);
        assert!(whole.is_some());
        for (reach, piece) in [(5.0, 12_000), (1.0, 100), (0.01, 5_000)] {
            let (found, looks) = survey(&points, reach, piece);
            assert_eq!(found, whole, "{reach} {piece}");
            assert_eq!(looks > 1, reach < 0.1);
        }
    }

    #[test]
    fn nothing_apart_has_no_spacing() {
        assert_eq!(survey(&[[1.0; 3]; 50], 1.0, 7).0, None);
        assert_eq!(spacing(&[[1.0; 3]; 50]), None);
        assert_eq!(survey(&[], 1.0, 7).0, None);
        let two = [[0.0; 3], [70.0, 0.0, 0.0]];
        assert_eq!(survey(&two, 0.1, 1).0, Some(70.0));
        assert_eq!(spacing(&two), Some(70.0));
    }
}
