//! Points in records of one length.

use std::io;

use rayon::prelude::*;
use winze::cloud::{is_small, offset, origin_of, origin_stride};

use super::{Narrow, Seen, Source, narrow};
use crate::scalar::{Order, Scalar};

/// Where one number of each record lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) scalar: Scalar,
    pub(crate) offset: usize,
}

/// Records of one length, one a point.
#[derive(Debug)]
pub(crate) struct Records {
    /// The first record's byte in the source.
    pub(crate) start: u64,
    pub(crate) stride: usize,
    pub(crate) order: Order,
    pub(crate) xyz: [Place; 3],
    pub(crate) intensity: Option<Place>,
}

/// About this many bytes of records are read at a time.
const BLOCK: usize = 1 << 18;

impl Records {
    /// Reads the first `count` records, all of which are there.
    pub(crate) fn read(&self, source: &dyn Source, count: usize) -> Option<Narrow> {
        if count == 0 || self.stride > BLOCK {
            return None;
        }
        // A file that holds something else at once is not worth more memory.
        let mut first = vec![[0.0; 3]; self.rows().min(count)];
        let buffers = &mut Buffers::default();
        let seen = self.fill(source, 0, &mut first, &mut [], buffers).ok()?;
        drop(first);
        let small = || {
            let (narrow, seen) = self.in_blocks(count, |first, points, intensity, buffers| {
                self.fill(source, first, points, intensity, buffers)
            })?;
            (!seen.wide).then_some(narrow)
        };
        let found = if seen.wide { None } else { small() };
        found.or_else(|| self.read_around(source, count))
    }

    /// Reads records that lie around an origin that is to be found, all of them.
    fn read_around(&self, source: &dyn Source, count: usize) -> Option<Narrow> {
        let stride = usize::try_from(origin_stride(count as u64)).ok()?;
        let buffers = &mut Buffers::default();
        let mut one = [[0.0; 3]];
        let mut sample = Vec::with_capacity(count.div_ceil(stride));
        for i in (0..count).step_by(stride) {
            self.wide(source, i, &mut one, &mut buffers.bytes).ok()?;
            sample.extend(one);
        }
        let origin = origin_of(&sample);
        let (narrow, seen) = self.in_blocks(count, |first, points, intensity, buffers| {
            self.fill_around(origin, source, first, (points, intensity), buffers)
        })?;
        let odd = seen.broken || seen.zeros > 0;
        (seen.wide && !odd).then_some(Narrow { origin, ..narrow })
    }

    /// Records that are read at a time.
    fn rows(&self) -> usize {
        BLOCK / self.stride.max(1)
    }

    /// Has `fill` fill the points and intensities of each block of records, given the first one's number.
    fn in_blocks(
        &self,
        count: usize,
        fill: impl Fn(usize, &mut [[f32; 3]], &mut [f32], &mut Buffers) -> io::Result<Seen> + Sync,
    ) -> Option<(Narrow, Seen)> {
        let rows = self.rows();
        let mut points = vec![[0.0; 3]; count];
        let mut intensity = vec![0.0; if self.intensity.is_some() { count } else { 0 }];
        let mut rest = intensity.as_mut_slice();
        let mut blocks = Vec::with_capacity(count.div_ceil(rows));
        for block in points.chunks_mut(rows) {
            let length = block.len().min(rest.len());
            let (part, others) = rest.split_at_mut(length);
            rest = others;
            blocks.push((block, part));
        }
        let seen = blocks
            .into_par_iter()
            .enumerate()
            .map_init(Buffers::default, |buffers, (i, (points, intensity))| {
                winze::cancel::check();
                fill(i * rows, points, intensity, buffers)
            })
            .try_reduce(Seen::default, |a, b| Ok(a.and(b)))
            .ok()?;
        let narrow = Narrow {
            origin: [0.0; 3],
            points,
            intensity: self.intensity.map(|_| intensity),
            zeros: seen.zeros,
            broken: seen.broken,
        };
        Some((narrow, seen))
    }

    /// The bytes of `count` records from `first` on.
    fn bytes<'a>(
        &self,
        source: &'a dyn Source,
        first: usize,
        count: usize,
        buffer: &'a mut Vec<u8>,
    ) -> io::Result<&'a [u8]> {
        let start = self.start + first as u64 * self.stride as u64;
        source.bytes(start, count * self.stride, buffer)
    }

    /// Reads the records from `first` on, of which all are small, or it is seen that they are not.
    fn fill(
        &self,
        source: &dyn Source,
        first: usize,
        points: &mut [[f32; 3]],
        intensity: &mut [f32],
        buffers: &mut Buffers,
    ) -> io::Result<Seen> {
        let bytes = self.bytes(source, first, points.len(), &mut buffers.bytes)?;
        let [x, y, z] = self.xyz;
        let plain = |place: &Place| place.scalar == Scalar::F32 && self.order == Order::Little;
        let mut wide = false;
        if self.xyz.iter().all(plain) && y.offset == x.offset + 4 && z.offset == x.offset + 8 {
            for (record, point) in from(bytes, x).chunks(self.stride).zip(points.iter_mut()) {
                if let Some(raw) = record.first_chunk::<12>() {
                    let (four, _) = raw.as_chunks::<4>();
                    for (v, raw) in point.iter_mut().zip(four) {
                        *v = f32::from_le_bytes(*raw);
                    }
                }
            }
        } else {
            for (axis, place) in self.xyz.into_iter().enumerate() {
                let mut slots = points.iter_mut().filter_map(|p| p.get_mut(axis));
                self.each(bytes, place, |v| {
                    let (short, far) = narrow(v);
                    wide |= far;
                    if let Some(slot) = slots.next() {
                        *slot = short;
                    }
                });
            }
        }
        self.fill_intensity(bytes, intensity);
        let mut seen = Seen::of(points);
        seen.wide |= wide;
        Ok(seen)
    }

    /// Reads the records from `first` on as offsets from `origin`. What is not finite or too far out is seen as broken.
    fn fill_around(
        &self,
        origin: [f64; 3],
        source: &dyn Source,
        first: usize,
        (points, intensity): (&mut [[f32; 3]], &mut [f32]),
        buffers: &mut Buffers,
    ) -> io::Result<Seen> {
        let wide = &mut buffers.points;
        wide.resize(points.len(), [0.0; 3]);
        let bytes = self.wide(source, first, wide, &mut buffers.bytes)?;
        self.fill_intensity(bytes, intensity);
        let mut seen = Seen::default();
        for (slot, p) in points.iter_mut().zip(&*wide) {
            match offset(*p, origin) {
                Some(offset) => *slot = offset,
                None => seen.broken = true,
            }
            seen.zeros += usize::from(*p == [0.0; 3]);
            seen.wide |= !is_small(p);
        }
        Ok(seen)
    }

    /// The coordinates of the records from `first` on, as they are, and the records' bytes.
    fn wide<'a>(
        &self,
        source: &'a dyn Source,
        first: usize,
        points: &mut [[f64; 3]],
        buffer: &'a mut Vec<u8>,
    ) -> io::Result<&'a [u8]> {
        let bytes = self.bytes(source, first, points.len(), buffer)?;
        for (axis, place) in self.xyz.into_iter().enumerate() {
            let mut slots = points.iter_mut().filter_map(|p| p.get_mut(axis));
            self.each(bytes, place, |v| {
                if let Some(slot) = slots.next() {
                    *slot = v;
                }
            });
        }
        Ok(bytes)
    }

    fn fill_intensity(&self, bytes: &[u8], intensity: &mut [f32]) {
        if let Some(place) = self.intensity {
            let mut slots = intensity.iter_mut();
            self.each(bytes, place, |v| {
                if let Some(slot) = slots.next() {
                    *slot = v as f32;
                }
            });
        }
    }

    /// The number at `place` of each record.
    fn each(&self, bytes: &[u8], place: Place, put: impl FnMut(f64)) {
        let Place { scalar, .. } = place;
        scalar.each(self.order, from(bytes, place), self.stride, put);
    }
}

fn from(bytes: &[u8], place: Place) -> &[u8] {
    bytes.get(place.offset..).unwrap_or_default()
}

/// What a thread uses again from block to block.
#[derive(Debug, Default)]
struct Buffers {
    bytes: Vec<u8>,
    points: Vec<[f64; 3]>,
}

#[cfg(test)]
mod tests {
    use winze::Cloud;

    use super::*;

    /// Reads points from records of x, y, z in 64 bits and an intensity in 8.
    fn read(points: &[[f64; 3]]) -> Option<Narrow> {
        let mut bytes = vec![9; 5];
        for (i, p) in points.iter().enumerate() {
            bytes.extend(p.iter().flat_map(|v| v.to_be_bytes()));
            bytes.push(i as u8);
        }
        let place = |axis: usize| Place {
            scalar: Scalar::F64,
            offset: 8 * axis,
        };
        let records = Records {
            start: 5,
            stride: 25,
            order: Order::Big,
            xyz: [place(0), place(1), place(2)],
            intensity: Some(Place {
                scalar: Scalar::U8,
                offset: 24,
            }),
        };
        records.read(&&bytes[..], points.len())
    }

    #[test]
    fn points_lie_around_the_origin_of_the_cloud_that_they_make() {
        let near = |i: i32| [f64::from(i) * 0.01, f64::from(-i % 97), 0.3];
        let far = |i: i32| {
            let [x, y, z] = near(i);
            [x + 431_234.567, y + 4_499_980.459, z]
        };
        let count = 30_000;
        let last_far = |i: i32| [near(i)[0] + 900.0, near(i)[1], 2.0];
        for points in [
            (0..count).map(near).collect::<Vec<_>>(),
            (0..count).map(far).collect(),
            // The first block is small, the others are not.
            (0..count).map(last_far).collect(),
            (0..3).map(far).collect(),
        ] {
            let narrow = read(&points).unwrap();
            let (cloud, _) = Cloud::from_points(&points).unwrap();
            assert_eq!(narrow.origin, cloud.origin());
            assert!(narrow.points == cloud.points());
            assert_eq!((narrow.zeros, narrow.broken), (0, false));
            let intensity = narrow.intensity.unwrap();
            assert!((0..points.len()).all(|i| intensity[i] == f32::from(i as u8)));
        }
        // What has anything to drop is for others.
        for odd in [
            [f64::NAN, 0.0, 0.0],
            [0.0; 3],
            [431_234.0, 4_400_000.0, 0.0],
        ] {
            let mut points: Vec<[f64; 3]> = (0..count).map(far).collect();
            points[17_000] = odd;
            assert!(read(&points).is_none(), "{odd:?}");
        }
        assert!(read(&[[1e-60, 0.0, 0.0]; 20]).is_none());
    }
}
