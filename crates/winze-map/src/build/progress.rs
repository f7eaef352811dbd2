//! How far a build has come.

use std::cell::Cell;
use std::path::PathBuf;

use winze_io::{PointStream, ReadOptions};

use crate::error::{Error, Result};

/// How far a build has come.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// What is being done.
    pub step: &'a str,
    /// Share of the whole work that is done, by an estimate that grows better on the way.
    pub done: f64,
}

/// Rough costs, in seconds of one core of some machine; only their ratios matter. Opening goes three times
/// through the bytes of files.
const OPEN_A_BYTE: f64 = 3e-9;
const LOOK_A_POINT: f64 = 2e-8;
const SURVEY_A_POINT: f64 = 5e-8;
const THIN_A_POINT: f64 = 2e-7;
const LEVEL_A_POINT: f64 = 1e-5;

/// The work that is ahead and behind.
pub(super) struct Plan<'a> {
    told: Option<&'a (dyn Fn(&Progress<'_>) + Sync)>,
    all: Cell<f64>,
    done: Cell<f64>,
    /// What is underway, once it is done.
    step: Cell<f64>,
    /// What a level costs, from the one after the current to the last.
    levels: std::cell::RefCell<Vec<f64>>,
    level: Cell<f64>,
}

impl<'a> Plan<'a> {
    pub(super) fn new(told: Option<&'a (dyn Fn(&Progress<'_>) + Sync)>) -> Self {
        Self {
            told,
            all: Cell::new(1.0),
            done: Cell::new(0.0),
            step: Cell::new(0.0),
            levels: std::cell::RefCell::default(),
            level: Cell::new(0.0),
        }
    }

    fn tell(&self, step: &str, done: f64) {
        if let Some(told) = self.told {
            let done = (done / self.all.get()).clamp(0.0, 1.0);
            told(&Progress { step, done });
        }
    }

    /// Opens the clouds.
    pub(super) fn open(&self, clouds: &[PathBuf], read: &ReadOptions) -> Result<PointStream> {
        let points = PointStream::open(clouds, read, &mut |byte, bytes| {
            // Until their number is known, a point is taken for 16 bytes and a base point for two points.
            #[expect(clippy::cast_precision_loss, reason = "a share")]
            let (byte, bytes) = (byte as f64, bytes as f64 / 3.0);
            let points = bytes / 16.0;
            let passes = LOOK_A_POINT + SURVEY_A_POINT + THIN_A_POINT;
            self.all
                .set(bytes * 3.0 * OPEN_A_BYTE + points * (passes + 0.5 * LEVEL_A_POINT));
            self.done.set(byte * OPEN_A_BYTE);
            self.tell("survey", self.done.get());
        })?;
        Ok(points)
    }

    /// One pass through the points.
    pub(super) fn pass(
        &self,
        step: &str,
        points: &PointStream,
        chunk: usize,
        mut each: impl FnMut(&[[f32; 3]]) -> Result<()>,
    ) -> Result<()> {
        let cost = match step {
            "thin" => THIN_A_POINT,
            "measure spacing" => SURVEY_A_POINT,
            _ => LOOK_A_POINT,
        };
        self.step(step, 0.0);
        points.for_each(chunk, &mut |chunk| {
            each(chunk).map_err(Error::into_read)?;
            #[expect(clippy::cast_precision_loss, reason = "a count")]
            self.done.set(self.done.get() + cost * chunk.len() as f64);
            self.tell(step, self.done.get());
            Ok(())
        })?;
        Ok(())
    }

    /// The levels that are ahead, now that the base is known.
    pub(super) fn levels(&self, base: usize, base_voxel: f64, voxels: &[f64]) {
        #[expect(clippy::cast_precision_loss, reason = "a count")]
        let costs: Vec<f64> = voxels
            .iter()
            .rev()
            .map(|v| LEVEL_A_POINT * base as f64 * (base_voxel / v) * (base_voxel / v))
            .collect();
        self.all.set(self.done.get() + costs.iter().sum::<f64>());
        *self.levels.borrow_mut() = costs;
    }

    /// A step begins, so the last one is done; of a level it takes `share`.
    pub(super) fn step(&self, step: &str, share: f64) {
        self.done.set(self.done.get() + self.step.get());
        if share > 0.0 && step.starts_with("surface") {
            self.level
                .set(self.levels.borrow_mut().pop().unwrap_or(0.0));
        }
        self.step.set(share * self.level.get());
        self.tell(step, self.done.get());
    }

    pub(super) fn finish(&self) {
        self.tell("done", self.all.get());
    }
}
