//! The part of the map that is asked about.

use crate::error::{Error, Result};
use crate::features::Features;
use crate::prepare::Surface;
use crate::request::Near;

/// Where the query can be.
#[derive(Clone, Copy)]
pub(crate) struct Region {
    pub(crate) near: Near,
    /// From the ball's centre, metres.
    pub(crate) reach: f64,
}

impl Region {
    /// # Errors
    /// [`Error::EmptyRegion`] where nothing of the map lies within reach.
    pub(crate) fn check(&self, map: &Surface<'_>) -> Result<()> {
        let Near { centre, radius } = self.near;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "offsets within f32's range, or far from all of them"
        )]
        let (at, reach) = (
            std::array::from_fn(|a| (centre[a] - map.origin[a]) as f32),
            self.reach as f32,
        );
        if map.tree.nearest_within(at, reach).is_some() {
            return Ok(());
        }
        Err(Error::EmptyRegion {
            x: centre[0],
            y: centre[1],
            z: centre[2],
            radius_m: radius,
        })
    }

    /// The features within reach.
    pub(crate) fn cut(&self, map: &Features<'_>) -> Features<'static> {
        let within = |p: &[f32; 3]| {
            let d: [f64; 3] =
                std::array::from_fn(|a| map.origin[a] + f64::from(p[a]) - self.near.centre[a]);
            d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= self.reach * self.reach
        };
        let (points, descriptors): (Vec<_>, Vec<_>) = map
            .points
            .iter()
            .zip(map.descriptors.iter())
            .filter(|(p, _)| within(p))
            .unzip();
        Features {
            origin: map.origin,
            points: points.into(),
            descriptors: descriptors.into(),
            qualified: 0,
        }
    }
}
