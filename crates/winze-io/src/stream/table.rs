//! Binary numbers at fixed places of a file, a block of rows at a time.

use std::io::{Read, Seek, SeekFrom};

use super::Sink;
use crate::error::Fault;
use crate::scalar::{Column, Order, Scalar};

/// About this many bytes are read at a time.
const BLOCK: u64 = 1 << 20;

/// Where rows are longer than this, numbers are read one by one: a row may be as long as the file.
const WIDE: u64 = 1 << 16;

/// Where the numbers of one axis lie.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axis {
    pub(crate) scalar: Scalar,
    /// The first number's byte in the source.
    pub(crate) start: u64,
    /// From one number to the next.
    pub(crate) step: u64,
}

/// `rows` points, all of whose numbers are there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Table {
    pub(crate) xyz: [Axis; 3],
    pub(crate) order: Order,
    pub(crate) rows: u64,
}

impl Table {
    /// Reads all points. `position` tells from the number of points read how far in the file that
    /// is.
    pub(crate) fn read(
        &self,
        source: &mut (impl Read + Seek),
        position: impl Fn(u64) -> u64,
        sink: &mut Sink<'_>,
    ) -> Result<(), Fault> {
        let step = self.xyz.iter().map(|a| a.step).max().unwrap_or(1).max(1);
        let block = (BLOCK / step).clamp(1, BLOCK / 16);
        let mut bytes = Vec::new();
        let mut points = Vec::new();
        let mut row = 0;
        while row < self.rows {
            let count = block.min(self.rows - row);
            points.resize(count as usize, [0.0; 3]);
            match self.together() {
                Some((start, span)) => {
                    let length = (count - 1) * step + span;
                    fetch(source, start + row * step, length, &mut bytes)?;
                    let columns = self.xyz.map(|axis| Column {
                        scalar: axis.scalar,
                        order: self.order,
                        bytes: bytes
                            .get((axis.start - start) as usize..)
                            .unwrap_or_default(),
                        stride: step as usize,
                    });
                    Column::fill_all(columns, &mut points);
                }
                None => {
                    for (i, axis) in self.xyz.iter().enumerate() {
                        self.read_axis(source, i, *axis, row, &mut points, &mut bytes)?;
                    }
                }
            }
            row += count;
            sink.give(&points, position(row))?;
        }
        Ok(())
    }

    /// The first byte of the first point and how many bytes hold it, where the points lie one
    /// after the other.
    fn together(&self) -> Option<(u64, u64)> {
        let step = self.xyz.first()?.step;
        let start = self.xyz.iter().map(|a| a.start).min()?;
        let end = self
            .xyz
            .iter()
            .map(|a| a.start + a.scalar.size() as u64)
            .max()?;
        let together = self.xyz.iter().all(|a| a.step == step);
        (together && step <= WIDE && end - start <= step).then_some((start, end - start))
    }

    /// Fills one axis of `points`, the first of which is point `row`.
    fn read_axis(
        &self,
        source: &mut (impl Read + Seek),
        index: usize,
        axis: Axis,
        row: u64,
        points: &mut [[f64; 3]],
        bytes: &mut Vec<u8>,
    ) -> Result<(), Fault> {
        let size = axis.scalar.size() as u64;
        let start = axis.start + row * axis.step;
        // A wide row makes a block of few.
        let (parts, stride) = if axis.step <= WIDE {
            (points.len().max(1), axis.step as usize)
        } else {
            (1, size as usize)
        };
        for (i, part) in points.chunks_mut(parts).enumerate() {
            let length = (part.len() as u64 - 1) * stride as u64 + size;
            let offset = i as u64 * parts as u64 * axis.step;
            fetch(source, start + offset, length, bytes)?;
            let column = Column {
                scalar: axis.scalar,
                order: self.order,
                bytes,
                stride,
            };
            column.fill(part, index, 0);
        }
        Ok(())
    }
}

/// Reads `length` bytes from byte `start` on.
fn fetch(
    source: &mut (impl Read + Seek),
    start: u64,
    length: u64,
    bytes: &mut Vec<u8>,
) -> Result<(), Fault> {
    bytes.resize(length as usize, 0);
    source.seek(SeekFrom::Start(start))?;
    source.read_exact(bytes)?;
    Ok(())
}
