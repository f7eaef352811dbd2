//! The points of a text file, as a stream.

use std::fs::File;
use std::io::{Seek, SeekFrom};

use super::layout::{Detector, Layout};
use crate::error::Fault;
use crate::lines::Blocks;
use crate::stream::{Sink, Told};

/// A text file of which the first lines were read.
#[derive(Debug)]
pub(crate) struct Stream {
    layout: Layout,
}

impl Stream {
    /// From the file and its first three bytes or more.
    pub(crate) fn open(head: &[u8], file: &mut File) -> Result<Self, Fault> {
        let mut detector = Detector::new(head)?;
        let start = detector.body as u64;
        file.seek(SeekFrom::Start(start))?;
        let mut blocks = Blocks::new(file, 0, start);
        loop {
            let block = blocks.lines()?;
            if block.is_empty() {
                return Err(detector.end());
            }
            for line in block.split_inclusive(|&b| b == b'\n') {
                if let Some(layout) = detector.take(line)? {
                    return Ok(Self { layout });
                }
            }
            let length = block.len();
            blocks.pass(length);
        }
    }

    pub(crate) fn encoding(&self) -> String {
        self.layout.delimiter.to_string()
    }

    pub(crate) fn count(&self) -> Option<u64> {
        self.layout.announced.map(|(count, _)| count)
    }

    pub(crate) fn fields(&self) -> Vec<String> {
        self.layout.names.clone()
    }

    /// Reads all points.
    pub(crate) fn scan(&self, file: &mut File, sink: &mut Sink<'_>) -> Result<Told, Fault> {
        let start = self.layout.body as u64;
        file.seek(SeekFrom::Start(start))?;
        let mut blocks = Blocks::new(file, self.layout.line, start);
        let mut held = 0u64;
        loop {
            let bytes = blocks.lines()?.len();
            if bytes == 0 {
                break;
            }
            let parse = |line: &[u8]| self.layout.row(line);
            blocks.parse(bytes, parse, |points, at| {
                held += points.len() as u64;
                sink.give(points, at)
            })?;
        }
        self.layout.check_held(held)?;
        Ok(Told {
            points: held,
            warnings: self.layout.surplus(held).into_iter().collect(),
        })
    }
}
