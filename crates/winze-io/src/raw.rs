//! What every decoder hands over: coordinates in `f64` and what the file said about them.

use crate::error::Fault;

/// A file's points before any is dropped.
#[derive(Debug, Default)]
pub(crate) struct Raw {
    /// Coordinates in the file's own frame.
    pub(crate) points: Vec<[f64; 3]>,
    /// One a point, or none at all.
    pub(crate) intensity: Option<Vec<f32>>,
    /// The file's own name for its encoding.
    pub(crate) encoding: String,
    /// Names of all columns, in order.
    pub(crate) fields: Vec<String>,
    /// Width and height of an image-like cloud.
    pub(crate) organised: Option<(usize, usize)>,
    /// PCD's viewpoint as written: `tx ty tz qw qx qy qz`.
    pub(crate) viewpoint: Option<[f64; 7]>,
    /// Where the sensor stood, where the file really says so.
    pub(crate) seen_from: Option<[f64; 3]>,
    /// What a user should know, a sentence each.
    pub(crate) warnings: Vec<String>,
}

/// A number of points that fits a cloud. Checked before memory is taken.
pub(crate) fn point_count(count: u64) -> Result<usize, Fault> {
    let limit = u32::MAX as usize - 1;
    let count = usize::try_from(count).unwrap_or(usize::MAX);
    if count > limit {
        return Err(Fault::Rejected(winze::Error::TooManyPoints {
            what: "the file",
            count,
            limit,
        }));
    }
    Ok(count)
}
