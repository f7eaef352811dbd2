//! Where bytes come from.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::sync::{Mutex, PoisonError};

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

/// The source's bytes from `start` on, to be read in order.
pub(crate) fn onwards(source: &dyn Source, start: u64) -> impl Read {
    Onwards { source, at: start }
}
