//! Spacing and base: the steps that read the clouds.

use std::path::PathBuf;

use winze::base::{BasePoints, Cell, merge, run};
use winze::columns::Columns as _;
use winze::spacing::{self, SpacingSurvey, Surveyed};
use winze_io::PointStream;

use super::{Work, named};
use crate::error::{Error, Result};
use crate::scratch::{Column, Scratch};

/// Bytes that a raw point takes in memory on its way into a run, at most: itself, its key, its cell
/// twice.
const BYTES_A_POINT: u64 = 128;
/// Points read at a time.
const CHUNKS: [u64; 2] = [1 << 14, 1 << 23];

/// The base of a map in scratch files.
pub(super) struct Base {
    pub(super) points: Column<[f32; 3]>,
    pub(super) weights: Column<u32>,
}

impl Work<'_> {
    /// Points to take at a time.
    fn chunk(&self) -> usize {
        let [least, most] = CHUNKS;
        let chunk = (self.options.memory / 2 / BYTES_A_POINT).clamp(least, most);
        usize::try_from(chunk).unwrap_or(1 << 14)
    }

    /// How far apart the points lie, metres: one pass, or more where the first guess was too near.
    pub(super) fn spacing(&self, points: &PointStream, clouds: &[PathBuf]) -> Result<f64> {
        let stride = spacing::stride(points.len());
        let mut chosen = Vec::new();
        let (mut index, mut guess) = (0u64, None);
        let mut first = Vec::new();
        self.plan
            .pass("look at points", points, self.chunk(), |chunk| {
                if guess.is_none() {
                    first = chunk.iter().take(200_000).copied().collect();
                    guess = Some(spacing::spacing(&first).unwrap_or(0.1));
                }
                for p in chunk {
                    if index.is_multiple_of(stride) {
                        chosen.push(*p);
                    }
                    index += 1;
                }
                Ok(())
            })?;
        let mut reach = 3.0 * guess.unwrap_or(0.1);
        loop {
            let mut survey = SpacingSurvey::new(chosen.clone(), reach);
            self.plan
                .pass("measure spacing", points, self.chunk(), |chunk| {
                    survey.add(chunk);
                    Ok(())
                })?;
            match survey.finish() {
                Surveyed::Spacing(Some(spacing)) => return Ok(spacing),
                Surveyed::Spacing(None) => {
                    return Err(Error::TooFew {
                        file: named(clouds),
                        points: 1,
                        least: super::MIN_POINTS,
                    });
                }
                Surveyed::LookFurther(further) => reach = further,
            }
        }
    }

    /// One point a voxel: a pass that leaves sorted runs, which are merged.
    pub(super) fn base(&self, points: &PointStream, voxel: f64) -> Result<Base> {
        let origin = points.origin();
        let mut runs: Vec<Column<Cell>> = Vec::new();
        self.plan.pass("thin", points, self.chunk(), |chunk| {
            let mut out = self.scratch.writer::<Cell>()?;
            out.append(&run(chunk, origin, voxel))?;
            runs.push(out.finish()?);
            Ok(())
        })?;
        self.plan.step("merge", 0.0);
        let mut base = self.scratch.writer::<[f32; 3]>()?;
        let mut weights = self.scratch.writer::<u32>()?;
        let to = BasePoints::new(origin, voxel);
        let cells = runs.iter().map(|r| r.iter().copied().map(Ok)).collect();
        merge(cells, |cell| {
            if u32::try_from(base.len() + 2).is_err() {
                return Err(winze::Error::TooManyPoints {
                    what: "the thinned map",
                    count: base.len() + 1,
                    limit: u32::MAX as usize - 1,
                }
                .into());
            }
            let (point, weight) = to.point(&cell);
            base.push(point)?;
            weights.push(weight)
        })?;
        Ok(Base {
            points: base.finish()?,
            weights: weights.finish()?,
        })
    }
}

impl Base {
    /// Smallest and largest corner in the map's frame, leaving out `share` of the points at each end of each
    /// axis.
    pub(super) fn bounds(
        &self,
        origin: [f64; 3],
        share: f64,
        scratch: &Scratch,
    ) -> Result<[[f64; 3]; 2]> {
        let points: &[[f32; 3]] = &self.points;
        let mut bounds = [origin; 2];
        let mut values = scratch.zeros::<f32>(points.len())?;
        let values: &mut [f32] = &mut values;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            clippy::cast_sign_loss,
            reason = "an index from a share of a count"
        )]
        let skip = (share.clamp(0.0, 0.4) * points.len() as f64) as usize;
        let Some(last) = points.len().checked_sub(1) else {
            return Ok(bounds);
        };
        let [low, high] = &mut bounds;
        for (a, (low, high)) in low.iter_mut().zip(high.iter_mut()).enumerate() {
            for (value, p) in values.iter_mut().zip(points) {
                *value = p.get(a).copied().unwrap_or_default();
            }
            let mut at = |i| f64::from(*values.select_nth_unstable_by(i, f32::total_cmp).1);
            (*low, *high) = (*low + at(skip), *high + at(last - skip));
        }
        Ok(bounds)
    }
}
