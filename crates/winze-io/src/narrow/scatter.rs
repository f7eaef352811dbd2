//! Points in columns, one after the other.

use std::io::{self, Write};

use super::{Narrow, Seen, narrow};
use crate::scalar::{Order, Scalar};

/// A column of numbers one after the other, in unpacked bytes that come in order.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    pub(crate) scalar: Scalar,
    pub(crate) start: u64,
}

/// Puts the numbers of columns where they belong while the bytes come.
#[derive(Debug)]
pub(crate) struct Scatter {
    /// x, y, z and the intensity.
    runs: [Option<Run>; 4],
    points: Vec<[f32; 3]>,
    intensity: Vec<f32>,
    /// Which axis comes last, and what was seen of the points that it made whole.
    last: usize,
    seen: Seen,
    /// How many bytes are used up.
    at: u64,
    /// The bytes that came of a number that is not whole yet, and how many it lacks.
    held: Vec<u8>,
    missing: usize,
}

impl Scatter {
    pub(crate) fn new(xyz: [Run; 3], intensity: Option<Run>, count: usize) -> Self {
        let last = (0..3).max_by_key(|&a| xyz.get(a).map(|run| run.start));
        let [x, y, z] = xyz.map(Some);
        Self {
            runs: [x, y, z, intensity],
            points: vec![[0.0; 3]; count],
            intensity: vec![0.0; if intensity.is_some() { count } else { 0 }],
            last: last.unwrap_or_default(),
            seen: Seen::default(),
            at: 0,
            held: Vec::new(),
            missing: 0,
        }
    }

    /// `None` where the points are for the other decoders.
    pub(crate) fn finish(self) -> Option<Narrow> {
        let seen = self.seen;
        if self.points.is_empty() {
            return None;
        }
        (!seen.wide).then_some(Narrow {
            origin: [0.0; 3],
            points: self.points,
            intensity: self.runs.last().copied().flatten().map(|_| self.intensity),
            zeros: seen.zeros,
            broken: seen.broken,
        })
    }

    /// Takes all numbers that are whole in `bytes`, which follow those that came before. Returns how many bytes at the end
    /// belong to one that is not, and how many it lacks.
    fn put(&mut self, bytes: &[u8]) -> (usize, usize) {
        let end = self.at + bytes.len() as u64;
        let mut cut = (0, 0);
        let mut made_whole = 0..0;
        for (axis, run) in self.runs.iter().enumerate() {
            let Some(Run { scalar, start }) = *run else {
                continue;
            };
            let size = scalar.size() as u64;
            let last = end.min(start + self.points.len() as u64 * size);
            let first = self.at.saturating_sub(start) / size;
            let from = start + first * size;
            if from >= last {
                continue;
            }
            let whole = (last - from) / size * size;
            if from + whole < last {
                let tail = last - from - whole;
                cut = (tail as usize, (size - tail) as usize);
            }
            let skipped = (from - self.at) as usize;
            let numbers = bytes.get(skipped..skipped + whole as usize);
            let numbers = numbers.unwrap_or_default();
            let first = first as usize;
            let mut wide = false;
            match self.points.get_mut(first..).filter(|_| axis < 3) {
                Some(points) if scalar == Scalar::F32 => {
                    let (numbers, _) = numbers.as_chunks::<4>();
                    // All are looked at once they are whole; one shows early what is of no use.
                    wide |= numbers
                        .first()
                        .is_some_and(|raw| narrow(f64::from(f32::from_le_bytes(*raw))).1);
                    for (point, raw) in points.iter_mut().zip(numbers) {
                        if let Some(slot) = point.get_mut(axis) {
                            *slot = f32::from_le_bytes(*raw);
                        }
                    }
                }
                Some(points) => {
                    let mut slots = points.iter_mut().filter_map(|p| p.get_mut(axis));
                    scalar.each(Order::Little, numbers, scalar.size(), |v| {
                        let (short, far) = narrow(v);
                        wide |= far;
                        if let Some(slot) = slots.next() {
                            *slot = short;
                        }
                    });
                }
                None => {
                    let mut slots = self.intensity.iter_mut().skip(first);
                    scalar.each(Order::Little, numbers, scalar.size(), |v| {
                        if let Some(slot) = slots.next() {
                            *slot = v as f32;
                        }
                    });
                }
            }
            self.seen.wide |= wide;
            if axis == self.last {
                made_whole = first..first + whole as usize / scalar.size();
            }
        }
        let points = self.points.get(made_whole).unwrap_or_default();
        self.seen = self.seen.and(Seen::of(points));
        self.at = end - cut.0 as u64;
        cut
    }
}

impl Write for Scatter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.seen.wide {
            return Err(io::ErrorKind::InvalidData.into());
        }
        let mut rest = bytes;
        if !self.held.is_empty() {
            let (missing, others) = rest.split_at(self.missing.min(rest.len()));
            self.held.extend_from_slice(missing);
            self.missing -= missing.len();
            if self.missing > 0 {
                return Ok(bytes.len());
            }
            let number = std::mem::take(&mut self.held);
            self.put(&number);
            rest = others;
        }
        let (tail, missing) = self.put(rest);
        let tail = rest.get(rest.len() - tail..).unwrap_or_default();
        self.held.extend_from_slice(tail);
        self.missing = missing;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_come_in_pieces_of_any_size_are_put_together() {
        let count = 37usize;
        let column = |f: &dyn Fn(usize) -> Vec<u8>| (0..count).flat_map(f).collect::<Vec<u8>>();
        let x = column(&|i| (i as f64 * 0.5).to_le_bytes().to_vec());
        let pad = column(&|i| vec![i as u8; 3]);
        let z = column(&|i| (i as f32 - 9.0).to_le_bytes().to_vec());
        let y = column(&|i| (i as i16).to_le_bytes().to_vec());
        let intensity = column(&|i| vec![i as u8]);
        let starts = [0, x.len() + pad.len() + z.len(), x.len() + pad.len()];
        let kinds = [Scalar::F64, Scalar::I16, Scalar::F32];
        let run = |a: usize| Run {
            scalar: kinds[a],
            start: starts[a] as u64,
        };
        let last = Run {
            scalar: Scalar::U8,
            start: (starts[1] + y.len()) as u64,
        };
        let bytes = [x, pad, z, y, intensity].concat();
        for piece in 1..bytes.len() {
            let mut scatter = Scatter::new([run(0), run(1), run(2)], Some(last), count);
            for part in bytes.chunks(piece) {
                scatter.write_all(part).unwrap();
            }
            let narrow = scatter.finish().unwrap();
            for (i, p) in narrow.points.iter().enumerate() {
                let i = i as f32;
                assert_eq!(*p, [i * 0.5, i, i - 9.0], "{piece}");
            }
            assert_eq!(narrow.intensity.unwrap()[36], 36.0);
            assert_eq!((narrow.zeros, narrow.broken), (0, false));
        }
    }
}
