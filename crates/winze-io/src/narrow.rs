//! The quick way from a file to a cloud whose coordinates are all small: straight into its 32-bit offsets, a block at a
//! time, with nothing held beside them.
//!
//! It is taken where nothing is odd. Everything else, and whatever is wrong with a file, is left to the decoders that
//! hold coordinates in 64 bits: they say what they say whether or not this way was tried first.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use winze::cloud::SMALL;

use crate::columns::{Columns, Row};
use crate::lines::{pieces, quick_number};
use crate::scalar::{Order, Scalar};

/// Bytes of a file that are read wherever they are needed.
pub(crate) trait Source: Sync {
    fn length(&self) -> u64;

    /// Fills `into` with the bytes from `start` on.
    fn read(&self, start: u64, into: &mut [u8]) -> io::Result<()>;

    /// The same as a slice, which may be `buffer`'s.
    fn bytes<'a>(
        &'a self,
        start: u64,
        length: usize,
        buffer: &'a mut Vec<u8>,
    ) -> io::Result<&'a [u8]> {
        buffer.resize(length, 0);
        self.read(start, buffer)?;
        Ok(buffer)
    }
}

impl Source for &[u8] {
    fn length(&self) -> u64 {
        self.len() as u64
    }

    fn read(&self, start: u64, into: &mut [u8]) -> io::Result<()> {
        into.copy_from_slice(part(self, start, into.len())?);
        Ok(())
    }

    fn bytes<'a>(&'a self, start: u64, length: usize, _: &'a mut Vec<u8>) -> io::Result<&'a [u8]> {
        part(self, start, length)
    }
}

fn part(bytes: &[u8], start: u64, length: usize) -> io::Result<&[u8]> {
    usize::try_from(start)
        .ok()
        .and_then(|start| bytes.get(start..)?.get(..length))
        .ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
}

/// A regular file.
pub(crate) struct Opened {
    file: Mutex<File>,
    length: u64,
}

impl Opened {
    pub(crate) fn new(file: File, length: u64) -> Self {
        Self {
            file: Mutex::new(file),
            length,
        }
    }
}

impl Source for Opened {
    fn length(&self) -> u64 {
        self.length
    }

    fn read(&self, start: u64, into: &mut [u8]) -> io::Result<()> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(into)
    }
}

/// A source read from one place to its end.
struct Onwards<'a> {
    source: &'a dyn Source,
    at: u64,
}

impl Read for Onwards<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.source.length().saturating_sub(self.at);
        let length = usize::try_from(left).unwrap_or(usize::MAX).min(into.len());
        let into = into.get_mut(..length).unwrap_or_default();
        self.source.read(self.at, into)?;
        self.at += length as u64;
        Ok(length)
    }
}

/// All points of a file as offsets from (0, 0, 0), those that are to be dropped included.
#[derive(Debug, Default)]
pub(crate) struct Narrow {
    pub(crate) points: Vec<[f32; 3]>,
    /// One a point, or none at all.
    pub(crate) intensity: Option<Vec<f32>>,
    /// How many lie at exactly (0, 0, 0).
    pub(crate) zeros: usize,
    /// Whether a coordinate is not finite.
    pub(crate) broken: bool,
}

/// What is special among points.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    zeros: usize,
    broken: bool,
    /// A finite one is not small.
    wide: bool,
}

impl Seen {
    fn and(self, other: Self) -> Self {
        Self {
            zeros: self.zeros + other.zeros,
            broken: self.broken | other.broken,
            wide: self.wide | other.wide,
        }
    }

    fn of(points: &[[f32; 3]]) -> Self {
        // As whole numbers, absolute values are in the order of the numbers, and those that are not finite come last.
        let limit = (SMALL as f32).to_bits() as i32;
        let mut odd = false;
        let mut zeros = 0u32;
        for p in points {
            let [x, y, z] = p.map(|v| v.abs().to_bits() as i32);
            odd |= (x > limit) | (y > limit) | (z > limit);
            zeros += u32::from((x | y | z) == 0);
        }
        let mut seen = Self {
            zeros: zeros as usize,
            ..Self::default()
        };
        if odd {
            for p in points {
                let finite = p.iter().all(|v| v.is_finite());
                seen.broken |= !finite;
                seen.wide |= finite && p.iter().any(|v| f64::from(v.abs()) > SMALL);
            }
        }
        seen
    }
}

/// A number in 32 bits, and whether that is too much for it here: it is finite, and not small, or so small that it
/// becomes zero.
#[inline(always)]
fn narrow(v: f64) -> (f32, bool) {
    let short = v as f32;
    (
        short,
        (v.abs() > SMALL && v.is_finite()) | (short == 0.0 && v != 0.0),
    )
}

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
        let rows = BLOCK / self.stride.max(1);
        let mut first = vec![[0.0; 3]; rows.min(count)];
        if self
            .fill(source, 0, &mut first, &mut [], &mut Vec::new())
            .ok()?
            .wide
        {
            return None;
        }
        drop(first);
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
            .map_init(Vec::new, |buffer, (i, (points, intensity))| {
                winze::cancel::check();
                self.fill(source, i * rows, points, intensity, buffer)
            })
            .try_reduce(Seen::default, |a, b| Ok(a.and(b)))
            .ok()?;
        (!seen.wide).then_some(Narrow {
            points,
            intensity: self.intensity.map(|_| intensity),
            zeros: seen.zeros,
            broken: seen.broken,
        })
    }

    /// Reads the records from `first` on.
    fn fill(
        &self,
        source: &dyn Source,
        first: usize,
        points: &mut [[f32; 3]],
        intensity: &mut [f32],
        buffer: &mut Vec<u8>,
    ) -> io::Result<Seen> {
        let start = self.start + first as u64 * self.stride as u64;
        let bytes = source.bytes(start, points.len() * self.stride, buffer)?;
        let from = |place: Place| bytes.get(place.offset..).unwrap_or_default();
        let [x, y, z] = self.xyz;
        let plain = |place: &Place| place.scalar == Scalar::F32 && self.order == Order::Little;
        let mut wide = false;
        if self.xyz.iter().all(plain) && y.offset == x.offset + 4 && z.offset == x.offset + 8 {
            for (record, point) in from(x).chunks(self.stride).zip(points.iter_mut()) {
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
                place
                    .scalar
                    .each(self.order, from(place), self.stride, |v| {
                        let (short, far) = narrow(v);
                        wide |= far;
                        if let Some(slot) = slots.next() {
                            *slot = short;
                        }
                    });
            }
        }
        if let Some(place) = self.intensity {
            let mut slots = intensity.iter_mut();
            place
                .scalar
                .each(self.order, from(place), self.stride, |v| {
                    if let Some(slot) = slots.next() {
                        *slot = v as f32;
                    }
                });
        }
        let mut seen = Seen::of(points);
        seen.wide |= wide;
        Ok(seen)
    }
}

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
    wide: bool,
    /// How many bytes are used up.
    at: u64,
    /// The bytes that came of a number that is not whole yet, and how many it lacks.
    held: Vec<u8>,
    missing: usize,
}

impl Scatter {
    pub(crate) fn new(xyz: [Run; 3], intensity: Option<Run>, count: usize) -> Self {
        let [x, y, z] = xyz.map(Some);
        Self {
            runs: [x, y, z, intensity],
            points: vec![[0.0; 3]; count],
            intensity: vec![0.0; if intensity.is_some() { count } else { 0 }],
            wide: false,
            at: 0,
            held: Vec::new(),
            missing: 0,
        }
    }

    /// `None` where the points are for the other decoders.
    pub(crate) fn finish(self) -> Option<Narrow> {
        if self.wide || self.points.is_empty() {
            return None;
        }
        let seen = self
            .points
            .par_chunks(1 << 14)
            .map(Seen::of)
            .reduce(Seen::default, Seen::and);
        (!seen.wide).then_some(Narrow {
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
                    // All are looked at in the end; one shows early what is of no use.
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
            self.wide |= wide;
        }
        self.at = end - cut.0 as u64;
        cut
    }
}

impl Write for Scatter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.wide {
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

/// The source's bytes from `start` on, to be read in order.
pub(crate) fn onwards(source: &dyn Source, start: u64) -> impl Read {
    Onwards { source, at: start }
}

/// Text is read this many bytes at a time, and parsed in pieces.
const TEXT_BLOCK: usize = 1 << 20;
const TEXT_PIECE: usize = 1 << 17;
/// Longer lines are for the other decoders.
const LONGEST_LINE: usize = 16 << 20;

/// Which number of a line goes where: an axis, the intensity (3), or nowhere (4).
pub(crate) struct Line {
    slots: Vec<usize>,
}

impl Line {
    /// Of so many columns. `None` where they are too many to be looked at one by one.
    pub(crate) fn new(wanted: Columns, columns: u64) -> Option<Self> {
        let columns = usize::try_from(columns).ok().filter(|&n| n <= 64)?;
        let slot = |column: usize| {
            let axis = wanted.xyz.iter().position(|&c| c == column);
            axis.unwrap_or(if wanted.intensity == Some(column) {
                3
            } else {
                4
            })
        };
        Some(Self {
            slots: (0..columns).map(slot).collect(),
        })
    }

    /// The numbers of the first line of `text`, and what follows it. `None` where it is not just as many plain numbers
    /// as there are columns.
    #[inline]
    fn parse<'a>(&self, text: &'a [u8]) -> Option<([f64; 4], &'a [u8])> {
        // A remark, or a line that is trimmed otherwise.
        if matches!(text.trim_ascii_start(), [] | [b'#', ..]) {
            return None;
        }
        let mut values = [0.0; 4];
        let mut rest = text;
        for &slot in &self.slots {
            while let [b' ' | b'\t', tail @ ..] = rest {
                rest = tail;
            }
            let before = rest;
            if let Some(value) = values.get_mut(slot) {
                (*value, rest) = quick_number(rest)?;
            } else {
                while let [byte, tail @ ..] = rest
                    && !byte.is_ascii_whitespace()
                    && *byte != 0x0b
                {
                    rest = tail;
                }
            }
            let ends = matches!(rest, [] | [b' ' | b'\t' | b'\r' | b'\n', ..]);
            if rest.len() == before.len() || !ends {
                return None;
            }
        }
        while let [b' ' | b'\t', tail @ ..] = rest {
            rest = tail;
        }
        match rest {
            [] => Some((values, rest)),
            [b'\n', tail @ ..] | [b'\r', b'\n', tail @ ..] => Some((values, tail)),
            _ => None,
        }
    }
}

/// Reads lines from `start` on, of which `expected` hold points. Those that `line` does not take go to `parse`. `None`
/// where that refuses one.
pub(crate) fn text(
    source: &dyn Source,
    start: u64,
    expected: usize,
    with_intensity: bool,
    line: &Line,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String> + Sync,
) -> Option<Narrow> {
    let mut all = Narrow {
        intensity: with_intensity.then(Vec::new),
        ..Narrow::default()
    };
    // A point takes at least two bytes a column.
    let left = source.length().saturating_sub(start);
    let most = usize::try_from(left).ok()? / (2 * line.slots.len().max(1)) + 1;
    all.points.reserve_exact(expected.min(most));
    if let Some(intensity) = &mut all.intensity {
        intensity.reserve_exact(expected.min(most));
    }
    let mut input = onwards(source, start);
    let mut held = Vec::new();
    loop {
        let had = held.len();
        held.resize(had + TEXT_BLOCK, 0);
        let mut filled = had;
        while let Some(room) = held.get_mut(filled..).filter(|room| !room.is_empty()) {
            match input.read(room).ok()? {
                0 => break,
                read => filled += read,
            }
        }
        let ended = filled < held.len();
        held.truncate(filled);
        // What was held before has no end of a line.
        let last = held
            .get(had..)
            .and_then(|new| new.iter().rposition(|&b| b == b'\n'));
        let end = match last {
            _ if ended => held.len(),
            Some(last) => had + last + 1,
            None if held.len() > LONGEST_LINE => return None,
            None => 0,
        };
        let block = held.get(..end).unwrap_or_default();
        let parts: Vec<Option<(Narrow, Seen)>> = pieces(block, 0, TEXT_PIECE)
            .into_par_iter()
            .map(|(_, piece)| {
                winze::cancel::check();
                text_piece(piece, with_intensity, line, &parse)
            })
            .collect();
        for part in parts {
            let (part, seen) = part?;
            if seen.wide {
                return None;
            }
            all.points.extend_from_slice(&part.points);
            if let (Some(all), Some(part)) = (&mut all.intensity, part.intensity) {
                all.extend_from_slice(&part);
            }
            all.zeros += seen.zeros;
            all.broken |= seen.broken;
        }
        if ended {
            return (!all.points.is_empty()).then_some(all);
        }
        held.drain(..end);
    }
}

fn text_piece(
    piece: &[u8],
    with_intensity: bool,
    line: &Line,
    parse: impl Fn(&[u8]) -> Result<Option<Row>, String>,
) -> Option<(Narrow, Seen)> {
    let mut out = Narrow {
        intensity: with_intensity.then(Vec::new),
        ..Narrow::default()
    };
    let mut rest = piece;
    let mut wide = false;
    while !rest.is_empty() {
        let [x, y, z, intensity] = match line.parse(rest) {
            Some((values, tail)) => {
                rest = tail;
                values
            }
            None => {
                let end = rest.iter().position(|&b| b == b'\n');
                let (line, tail) = rest.split_at(end.map_or(rest.len(), |at| at + 1));
                rest = tail;
                match parse(line.trim_ascii()).ok()? {
                    None => continue,
                    Some(row) => {
                        let [x, y, z] = row.point;
                        [x, y, z, f64::from(row.intensity)]
                    }
                }
            }
        };
        out.points.push([x, y, z].map(|v| {
            let (short, far) = narrow(v);
            wide |= far;
            short
        }));
        if let Some(all) = &mut out.intensity {
            all.push(intensity as f32);
        }
    }
    let mut seen = Seen::of(&out.points);
    seen.wide |= wide;
    Some((out, seen))
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

    #[test]
    fn what_is_not_small_or_not_finite_is_seen() {
        let seen = |points: &[[f32; 3]]| {
            let Seen {
                zeros,
                broken,
                wide,
            } = Seen::of(points);
            (zeros, broken, wide)
        };
        assert_eq!(
            seen(&[[0.0, -0.0, 0.0], [1024.0, -1024.0, 1e-30]]),
            (1, false, false)
        );
        assert_eq!(seen(&[[0.0, 1024.5, 0.0]]), (0, false, true));
        assert_eq!(
            seen(&[[f32::NAN, 5000.0, 0.0], [f32::INFINITY; 3]]),
            (0, true, false)
        );
        assert_eq!(narrow(1_024.000_001), (1024.0, true));
        assert_eq!(narrow(1e-60), (0.0, true));
        assert_eq!(narrow(-0.25), (-0.25, false));
        assert!(!narrow(f64::NAN).1 && !narrow(f64::INFINITY).1);
    }

    #[test]
    fn lines_are_parsed_only_where_they_are_plain() {
        let wanted = Columns {
            xyz: [1, 2, 3],
            intensity: Some(0),
        };
        let line = Line::new(wanted, 5).unwrap();
        let parse = |text: &'static str| line.parse(text.as_bytes());
        let values = [1.0, 2.5, -3.0, 9.0];
        assert_eq!(parse(" 9 1\t2.5  -3 a \r\nb"), Some((values, &b"b"[..])));
        assert_eq!(parse("9 1 2.5 -3 a"), Some((values, &b""[..])));
        for odd in [
            "",
            "9 1 2.5 -3\na",
            "9 1 2.5 -3 a b\n",
            "9 1 2.5 -3x a",
            "nan 1 2 3 4",
            "# 1",
        ] {
            assert_eq!(parse(odd), None, "{odd}");
        }
        assert!(Line::new(wanted, 65).is_none());
    }
}
