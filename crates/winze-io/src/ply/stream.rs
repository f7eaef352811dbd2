//! The vertices of a PLY file, as a stream.

use std::fs::File;
use std::io::{BufReader, Seek, SeekFrom};

use super::decode::{Vertices, cut};
use super::header::{Data, LONGEST};
use super::walk::Body;
use crate::error::Fault;
use crate::lines::{Blocks, skip_lines};
use crate::scalar::Order;
use crate::stream::{Axis, Sink, Table, Told, line_count};

/// Vertices with lists are handed over this many at a time.
const BLOCK: usize = 1 << 14;

/// A PLY file of which the header was read.
#[derive(Debug)]
pub(crate) struct Stream {
    file: Vertices,
    /// Lines of the header.
    lines: usize,
}

impl Stream {
    /// Bytes of the file that hold every header.
    pub(crate) const HEAD: usize = LONGEST + 1;

    /// From the first [`Stream::HEAD`] bytes.
    pub(crate) fn open(head: &[u8]) -> Result<Self, Fault> {
        let file = Vertices::parse(head)?;
        Ok(Self {
            lines: line_count(head, file.body),
            file,
        })
    }

    pub(crate) fn encoding(&self) -> &str {
        self.file.data.name()
    }

    pub(crate) fn count(&self) -> u64 {
        self.file.vertex.count
    }

    pub(crate) fn fields(&self) -> Vec<String> {
        self.file.names.clone()
    }

    /// Reads all vertices of a file of `length` bytes.
    pub(crate) fn scan(
        &self,
        file: &mut File,
        length: u64,
        sink: &mut Sink<'_>,
    ) -> Result<Told, Fault> {
        file.seek(SeekFrom::Start(self.file.body as u64))?;
        match self.file.data {
            Data::Ascii => self.ascii(file, sink)?,
            Data::Binary(order) => self.binary(file, order, length, sink)?,
        }
        Ok(Told {
            points: self.file.vertex.count,
            warnings: self.file.warnings.clone(),
        })
    }

    fn ascii(&self, file: &mut File, sink: &mut Sink<'_>) -> Result<(), Fault> {
        let Vertices { before, vertex, .. } = &self.file;
        let mut blocks = Blocks::new(file, self.lines, self.file.body as u64);
        for element in before.iter().filter(|e| !e.properties.is_empty()) {
            let skipped = blocks.skip(element.count)?;
            skipped.map_err(|held| cut(element, held))?;
        }
        let mut left = vertex.count;
        while left > 0 {
            let block = blocks.lines()?;
            if block.is_empty() {
                return Err(cut(vertex, vertex.count - left));
            }
            let (end, seen) = match skip_lines(block, left) {
                Ok(end) => (end, left),
                Err(seen) => (block.len(), seen),
            };
            let parse = |line: &[u8]| self.file.row(line);
            let parsed = blocks.parse(end, parse, |points, at| sink.give(points, at));
            if let Err(Fault::Malformed(..)) = parsed {
                // That lines are missing weighs more than that one is broken.
                let skipped = blocks.skip(left)?;
                skipped.map_err(|held| cut(vertex, vertex.count - left + held))?;
            }
            parsed?;
            left -= seen;
        }
        Ok(())
    }

    fn binary(
        &self,
        file: &mut File,
        order: Order,
        length: u64,
        sink: &mut Sink<'_>,
    ) -> Result<(), Fault> {
        let Vertices { before, vertex, .. } = &self.file;
        let source = BufReader::with_capacity(1 << 18, file.try_clone()?);
        let left = length.saturating_sub(self.file.body as u64);
        let mut body = Body::new(source, order, left);
        body.skip_elements(before)?;
        let Some(stride) = vertex.fixed_size() else {
            let mut points = Vec::new();
            let mut read = 0u64;
            // Only a measure of progress: vertices differ in length.
            let mean = left / vertex.count.max(1);
            self.file.varied(&mut body, |row| {
                points.push(row.point);
                if points.len() == BLOCK {
                    read += BLOCK as u64;
                    sink.give(&points, read * mean)?;
                    points.clear();
                }
                Ok(())
            })?;
            return sink.give(&points, length);
        };
        self.file.check_held(body.left(), stride)?;
        let start = length - body.left();
        let table = Table {
            xyz: self.file.columns.xyz.map(|column| {
                let (offset, scalar) = self.file.place(column);
                Axis {
                    scalar,
                    start: start + offset as u64,
                    step: stride,
                }
            }),
            order,
            rows: vertex.count,
        };
        table.read(file, |rows| start + rows * stride, sink)
    }
}
