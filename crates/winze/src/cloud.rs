//! A point cloud: `f32` offsets from an `f64` origin.
//!
//! A northing of 4 500 000 m held in an `f32` is off by up to 0.25 m. Held as an offset from an
//! origin in the cloud's middle it keeps a millimetre out to [`MAX_OFFSET`].

use crate::error::{Error, Result};

/// Largest offset from the origin, metres, at which an `f32` still keeps a millimetre
/// (its step is 2⁻¹⁰ m just below 2¹⁴ m).
pub const MAX_OFFSET: f64 = 16_384.0;

/// Coordinates up to this size keep their file's own origin: the step is then below 0.07 mm.
pub const SMALL: f64 = 1_024.0;

/// A cloud whose far points number more than this share is refused instead of thinned.
const FAR_SHARE: f64 = 0.01;

/// Finite points as offsets from an origin, metres, right-handed.
///
/// Invariant of every constructor: all offsets are finite and within [`MAX_OFFSET`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cloud {
    origin: [f64; 3],
    points: Vec<[f32; 3]>,
    intensity: Option<Vec<f32>>,
    viewpoint: Option<[f64; 3]>,
}

/// Points that did not make it into a [`Cloud`], by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dropped {
    /// A coordinate was NaN or infinite.
    pub non_finite: usize,
    /// More than [`MAX_OFFSET`] from the cloud's middle: stray returns or broken values.
    pub far: usize,
}

impl Cloud {
    /// From coordinates in any frame, metres. Points that are not finite, and the few that lie
    /// hopelessly far from the rest, are dropped and counted.
    ///
    /// The origin is `(0, 0, 0)` where all coordinates are small, else the median point rounded to
    /// whole metres: it comes from the bulk of the points, so that no stray return moves it.
    ///
    /// # Errors
    /// [`Error::TooWide`] where more than 1 % of the points lie too far out;
    /// [`Error::TooManyPoints`] above 2³² − 2 points.
    pub fn from_points(coordinates: &[[f64; 3]]) -> Result<(Self, Dropped)> {
        Self::with_intensity(coordinates, None)
    }

    /// Like [`Cloud::from_points`], with one intensity a point.
    ///
    /// # Errors
    /// As [`Cloud::from_points`]. Intensities are ignored unless there is one for each point.
    pub fn with_intensity(
        coordinates: &[[f64; 3]],
        intensity: Option<&[f32]>,
    ) -> Result<(Self, Dropped)> {
        let intensity = intensity.filter(|i| i.len() == coordinates.len());
        Self::gather(
            coordinates.len(),
            |i| coordinates[i],
            intensity.map(|all| |i: usize| all[i]),
        )
    }

    /// As [`Cloud::with_intensity`], from wherever the coordinates lie: `point` tells those of point `i`, the same each
    /// time it is asked. Nothing is held but the cloud.
    ///
    /// # Errors
    /// As [`Cloud::from_points`].
    pub fn gather(
        count: usize,
        point: impl Fn(usize) -> [f64; 3],
        intensity: Option<impl Fn(usize) -> f32>,
    ) -> Result<(Self, Dropped)> {
        let limit = u32::MAX as usize - 1;
        if count > limit {
            return Err(Error::TooManyPoints {
                what: "the cloud",
                count,
                limit,
            });
        }
        let origin = robust_origin(count, &point);
        let mut dropped = Dropped::default();
        let mut points = Vec::with_capacity(count);
        let mut kept_intensity = intensity.as_ref().map(|_| Vec::with_capacity(count));
        for i in 0..count {
            let p = point(i);
            if !is_finite(&p) {
                dropped.non_finite += 1;
                continue;
            }
            let Some(offset) = offset(p, origin) else {
                dropped.far += 1;
                continue;
            };
            points.push(offset);
            if let (Some(kept), Some(of)) = (&mut kept_intensity, &intensity) {
                kept.push(of(i));
            }
        }
        check_far(dropped.far, count - dropped.non_finite)?;
        let cloud = Self {
            origin,
            points,
            intensity: kept_intensity,
            viewpoint: None,
        };
        Ok((cloud, dropped))
    }

    /// The same points with one intensity each; they stay without, unless there is one for each.
    #[must_use]
    pub fn with_intensities(mut self, intensity: Vec<f32>) -> Self {
        self.intensity = Some(intensity).filter(|i| i.len() == self.points.len());
        self
    }

    /// The same cloud, said to be seen from one place (in the cloud's frame, metres). Only for
    /// clouds that one sensor saw from one pose; normals are then turned towards it.
    #[must_use]
    pub fn seen_from(mut self, viewpoint: Option<[f64; 3]>) -> Self {
        self.viewpoint = viewpoint.filter(|v| v.iter().all(|c| c.is_finite()));
        self
    }

    /// The `f64` origin that all offsets count from.
    #[must_use]
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// Offsets from the origin.
    #[must_use]
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// The offsets alone.
    #[must_use]
    pub fn into_points(self) -> Vec<[f32; 3]> {
        self.points
    }

    /// One intensity a point, where the file had them.
    #[must_use]
    pub fn intensity(&self) -> Option<&[f32]> {
        self.intensity.as_deref()
    }

    /// Where the sensor stood, where that is known.
    #[must_use]
    pub fn viewpoint(&self) -> Option<[f64; 3]> {
        self.viewpoint
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// No points at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Point `i` in the cloud's frame, `f64`. Panics where `i` is out of range, like indexing.
    #[must_use]
    pub fn point(&self, i: usize) -> [f64; 3] {
        std::array::from_fn(|a| self.origin[a] + f64::from(self.points[i][a]))
    }

    /// All points in the cloud's frame, `f64`.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = [f64; 3]> + '_ {
        self.points
            .iter()
            .map(|p| std::array::from_fn(|a| self.origin[a] + f64::from(p[a])))
    }

    /// The mean point, `None` for an empty cloud.
    #[must_use]
    pub fn centroid(&self) -> Option<[f64; 3]> {
        centroid(&self.points).map(|c| std::array::from_fn(|a| self.origin[a] + c[a]))
    }

    /// The points whose indices are given, in that order, with their intensities.
    #[must_use]
    pub fn select(&self, indices: &[u32]) -> Self {
        Self {
            origin: self.origin,
            points: indices.iter().map(|&i| self.points[i as usize]).collect(),
            intensity: self
                .intensity
                .as_ref()
                .map(|v| indices.iter().map(|&i| v[i as usize]).collect()),
            viewpoint: self.viewpoint,
        }
    }

    /// From offsets that another cloud of that origin had: the same cloud, to the bit.
    ///
    /// # Errors
    /// [`Error::TooWide`] where one is not finite or beyond [`MAX_OFFSET`].
    pub fn with_origin(origin: [f64; 3], offsets: Vec<[f32; 3]>) -> Result<Self> {
        #[expect(clippy::cast_possible_truncation, reason = "a power of two")]
        let limit = MAX_OFFSET as f32;
        // One by one only where some are: a look at many at a time is much faster.
        let fine = |part: &[f32]| part.iter().fold(true, |fine, v| fine & (v.abs() <= limit));
        let far = if offsets.as_flattened().chunks(4096).all(fine) {
            0
        } else {
            let far = |p: &&[f32; 3]| !p.iter().all(|v| v.abs() <= limit);
            offsets.iter().filter(far).count()
        };
        if far > 0 || !origin.iter().all(|v| v.is_finite()) {
            return Err(Error::TooWide {
                far,
                total: offsets.len(),
                limit_m: MAX_OFFSET,
            });
        }
        Ok(Self::from_offsets(origin, offsets))
    }

    /// Offsets that are known to be finite and in reach.
    pub(crate) fn from_offsets(origin: [f64; 3], points: Vec<[f32; 3]>) -> Self {
        Self {
            origin,
            points,
            ..Self::default()
        }
    }

    /// The same origin and viewpoint with other points, which lie among the old ones.
    pub(crate) fn with_offsets(&self, points: Vec<[f32; 3]>, intensity: Option<Vec<f32>>) -> Self {
        Self {
            origin: self.origin,
            points,
            intensity,
            viewpoint: self.viewpoint,
        }
    }

    /// The cloud moved by `pose`: the answer's points lie in the outer frame of `pose`.
    ///
    /// # Errors
    /// As [`Cloud::from_points`] (a turned cloud may stick out further along an axis).
    pub fn transformed(&self, pose: &crate::Pose) -> Result<Self> {
        let moved: Vec<[f64; 3]> = self.iter().map(|p| pose.transform(p)).collect();
        let (cloud, _) = Self::with_intensity(&moved, self.intensity())?;
        Ok(cloud.seen_from(self.viewpoint.map(|v| pose.transform(v))))
    }

    /// Smallest and largest corner in the cloud's frame, leaving out `share` of the points at
    /// each end of each axis (0 for the exact bounds). `None` for an empty cloud.
    #[must_use]
    pub fn bounds(&self, share: f64) -> Option<([f64; 3], [f64; 3])> {
        let n = self.points.len();
        let last = n.checked_sub(1)?;
        #[expect(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "an index from a share of a count"
        )]
        let skip = ((last as f64 * share.clamp(0.0, 0.5)) as usize).min(last / 2);
        let mut low = [0.0; 3];
        let mut high = [0.0; 3];
        for a in 0..3 {
            let mut v: Vec<f32> = self.points.iter().map(|p| p[a]).collect();
            low[a] = self.origin[a] + f64::from(*v.select_nth_unstable_by(skip, f32::total_cmp).1);
            high[a] = self.origin[a]
                + f64::from(*v.select_nth_unstable_by(last - skip, f32::total_cmp).1);
        }
        Some((low, high))
    }
}

/// The mean of `points` as offsets, summed in order in `f64`.
pub(crate) fn centroid(points: &[[f32; 3]]) -> Option<[f64; 3]> {
    if points.is_empty() {
        return None;
    }
    let mut sum = [0.0f64; 3];
    for p in points {
        for a in 0..3 {
            sum[a] += f64::from(p[a]);
        }
    }
    #[expect(clippy::cast_precision_loss, reason = "counts stay far below 2^53")]
    let n = points.len() as f64;
    Some(sum.map(|s| s / n))
}

fn is_finite(point: &[f64; 3]) -> bool {
    point.iter().all(|v| v.is_finite())
}

/// Zero where everything is near zero, else the median of at most 10 001 evenly spaced points,
/// rounded to whole metres.
fn robust_origin(count: usize, point: &impl Fn(usize) -> [f64; 3]) -> [f64; 3] {
    let finite = || (0..count).map(point).filter(is_finite);
    if finite().all(|p| is_small(&p)) {
        return [0.0; 3];
    }
    let stride = origin_stride(finite().count() as u64);
    let stride = usize::try_from(stride).unwrap_or(usize::MAX);
    let sample: Vec<[f64; 3]> = finite().step_by(stride).collect();
    origin_of(&sample)
}

/// A point as offset from a cloud's origin; `None` where it is not finite or lies beyond [`MAX_OFFSET`].
#[must_use]
#[inline]
pub fn offset(point: [f64; 3], origin: [f64; 3]) -> Option<[f32; 3]> {
    let offset: [f64; 3] = std::array::from_fn(|a| point[a] - origin[a]);
    if !offset.iter().all(|v| v.abs() <= MAX_OFFSET) {
        return None;
    }
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the origin is chosen for it"
    )]
    Some(offset.map(|v| v as f32))
}

/// Whether a finite point may stay in a frame whose origin is `(0, 0, 0)`; where all may, that is
/// the cloud's origin.
#[must_use]
#[inline]
pub fn is_small(point: &[f64; 3]) -> bool {
    point.iter().all(|v| v.abs() <= SMALL)
}

/// Of `count` finite points that are not all small, each how manieth, from the first on, is in the
/// sample for [`origin_of`].
#[must_use]
pub fn origin_stride(count: u64) -> u64 {
    count.div_ceil(10_001).max(1)
}

/// Refuses a cloud of which too many of its `total` finite points lie too far out.
///
/// # Errors
/// [`Error::TooWide`] where they are more than 1 %.
pub fn check_far(far: usize, total: usize) -> Result<()> {
    #[expect(clippy::cast_precision_loss, reason = "a share")]
    if far as f64 > FAR_SHARE * total as f64 {
        return Err(Error::TooWide {
            far,
            total,
            limit_m: MAX_OFFSET,
        });
    }
    Ok(())
}

/// The origin of a cloud whose points are not all small, from every
/// [`origin_stride`]th finite one.
#[must_use]
pub fn origin_of(sample: &[[f64; 3]]) -> [f64; 3] {
    if sample.is_empty() {
        return [0.0; 3];
    }
    let median: [f64; 3] = std::array::from_fn(|a| {
        let mut v: Vec<f64> = sample.iter().map(|p| p[a]).collect();
        let middle = v.len() / 2;
        *v.select_nth_unstable_by(middle, f64::total_cmp).1
    });
    if median.iter().all(|m| m.abs() <= SMALL) {
        [0.0; 3]
    } else {
        median.map(f64::round)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pose;

    #[test]
    fn utm_coordinates_keep_a_tenth_of_a_millimetre() {
        let points: Vec<[f64; 3]> = (0..1000)
            .map(|i| {
                let i = f64::from(i);
                [
                    431_234.567_8 + i * 0.317,
                    4_499_980.459_1 - i * 0.123,
                    312.001 + i * 0.01,
                ]
            })
            .collect();
        let (cloud, dropped) = Cloud::from_points(&points).unwrap();
        assert_eq!(dropped, Dropped::default());
        for (a, b) in cloud.iter().zip(&points) {
            for i in 0..3 {
                assert!((a[i] - b[i]).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn small_coordinates_are_kept_to_the_bit() {
        let points = [[0.1f32, -512.3, 7.7], [3.0, 4.0, 5.0]];
        let wide: Vec<[f64; 3]> = points.iter().map(|p| p.map(f64::from)).collect();
        let (cloud, _) = Cloud::from_points(&wide).unwrap();
        assert_eq!(cloud.origin(), [0.0; 3]);
        assert_eq!(cloud.points(), points);
    }

    #[test]
    fn gathered_points_make_the_same_cloud() {
        let points: Vec<[f64; 3]> = (0..3000)
            .map(|i| {
                [
                    4e5 + f64::from(i) * 0.1,
                    5e6,
                    if i % 100 == 7 { f64::NAN } else { 3.0 },
                ]
            })
            .collect();
        let intensity: Vec<f32> = (0..3000u16).map(f32::from).collect();
        let one = Cloud::with_intensity(&points, Some(&intensity)).unwrap();
        let reversed = |i: usize| points[2999 - i];
        let other = Cloud::gather(3000, reversed, Some(|i: usize| intensity[2999 - i])).unwrap();
        assert_eq!(one.1, other.1);
        assert_eq!(one.0.len(), 2970);
        let mut back: Vec<u32> = (0..2970).collect();
        back.reverse();
        assert_eq!(other.0.select(&back).intensity(), one.0.intensity());
        assert_eq!(other.0.point(0), one.0.point(2969));
    }

    #[test]
    fn a_cloud_is_made_again_from_its_parts() {
        let (cloud, _) = Cloud::from_points(&[[5e5, 4e6, 300.1], [5e5 + 7.7, 4e6, 299.0]]).unwrap();
        let again = Cloud::with_origin(cloud.origin(), cloud.points().to_vec());
        assert_eq!(again.unwrap(), cloud);
        for broken in [f32::NAN, f32::INFINITY, 2e4] {
            assert!(Cloud::with_origin([0.0; 3], vec![[0.0, broken, 0.0]]).is_err());
        }
    }

    #[test]
    fn only_finite_points_in_reach_have_an_offset() {
        assert_eq!(offset([5.0, 6.0, 7.0], [4.0; 3]), Some([1.0, 2.0, 3.0]));
        for broken in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 2e4] {
            assert_eq!(offset([0.0, broken, 0.0], [0.0; 3]), None);
        }
    }

    #[test]
    fn broken_values_are_dropped_and_counted() {
        let mut points: Vec<[f64; 3]> = (0..1000).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        points.push([1e30, 0.0, 0.0]);
        points.push([f64::NAN, 0.0, 0.0]);
        points.push([0.0, f64::INFINITY, 0.0]);
        let (cloud, dropped) = Cloud::from_points(&points).unwrap();
        assert_eq!((cloud.len(), dropped.non_finite, dropped.far), (1000, 2, 1));
        assert_eq!(cloud.origin(), [0.0; 3]);
    }

    #[test]
    fn a_cloud_of_two_distant_halves_is_refused() {
        let points: Vec<[f64; 3]> = (0..100)
            .map(|i| [f64::from(i % 2) * 1e5, 0.0, 0.0])
            .collect();
        assert!(matches!(
            Cloud::from_points(&points),
            Err(Error::TooWide {
                far: 50,
                total: 100,
                ..
            })
        ));
    }

    #[test]
    fn empty_and_all_broken_clouds_are_empty() {
        assert!(Cloud::from_points(&[]).unwrap().0.is_empty());
        let (cloud, dropped) = Cloud::from_points(&[[f64::NAN; 3]; 4]).unwrap();
        assert!(cloud.is_empty() && cloud.centroid().is_none() && cloud.bounds(0.0).is_none());
        assert_eq!(dropped.non_finite, 4);
    }

    #[test]
    fn bounds_ignore_the_share_asked_for() {
        let mut points: Vec<[f64; 3]> = (0..=100).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        points[50] = [900.0, 0.0, 0.0];
        let (cloud, _) = Cloud::from_points(&points).unwrap();
        assert_eq!(cloud.bounds(0.0).unwrap().1[0], 900.0);
        assert!(cloud.bounds(0.02).unwrap().1[0] <= 100.0);
    }

    #[test]
    fn transformed_moves_points_viewpoint_and_keeps_intensity() {
        let (cloud, _) = Cloud::with_intensity(&[[1.0, 2.0, 3.0]], Some(&[9.0])).unwrap();
        let moved = cloud
            .seen_from(Some([0.0; 3]))
            .transformed(&Pose::from_translation([5e5, 4e6, 0.0]))
            .unwrap();
        assert_eq!(moved.point(0), [500_001.0, 4_000_002.0, 3.0]);
        assert_eq!(moved.viewpoint(), Some([5e5, 4e6, 0.0]));
        assert_eq!(moved.intensity(), Some(&[9.0][..]));
    }
}
