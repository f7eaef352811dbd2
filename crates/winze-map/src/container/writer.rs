//! Writing a container, front to back.

use std::collections::BTreeSet;
use std::io::{self, Write};
use std::marker::PhantomData;
use std::path::Path;

use crc32fast::Hasher;
use zerocopy::{Immutable, IntoBytes};

use super::layout::{
    ALIGN, END_MAGIC, Header, Id, Line, MAGIC, ORDER_MARK, Tag, Trailer, VERSION, aligned,
};
use crate::error::Result;

/// Writes the container `path` with `fill`. The file appears whole or not at all, as with
/// [`winze_io::atomic::write`].
///
/// An [`Error`](crate::Error) that `fill` turns into an [`io::Error`] with `?` comes out as it was.
///
/// # Errors
/// Where the file cannot be written, and where `fill` fails.
pub fn write(
    path: &Path,
    fill: impl FnOnce(&mut ContainerWriter<'_>) -> io::Result<()>,
) -> Result<()> {
    winze_io::atomic::write(path, |out| {
        let mut writer = ContainerWriter::new(out)?;
        fill(&mut writer)?;
        writer.finish().map(|_| ())
    })?;
    Ok(())
}

/// Writes sections one after the other, to where nothing can be taken back.
pub struct ContainerWriter<'w> {
    out: &'w mut dyn Write,
    /// Bytes written so far.
    at: u64,
    lines: Vec<Line>,
    ids: BTreeSet<Id>,
    /// A section was begun and not ended, or a write failed: what follows cannot be in order.
    broken: bool,
}

impl std::fmt::Debug for ContainerWriter<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ContainerWriter")
            .field("at", &self.at)
            .field("lines", &self.lines)
            .field("broken", &self.broken)
            .finish_non_exhaustive()
    }
}

impl<'w> ContainerWriter<'w> {
    /// Begins a container. `out` had better be buffered.
    ///
    /// # Errors
    /// Where `out` cannot be written to.
    pub fn new(out: &'w mut dyn Write) -> io::Result<Self> {
        let mut writer = Self {
            out,
            at: 0,
            lines: Vec::new(),
            ids: BTreeSet::new(),
            broken: false,
        };
        let header = Header {
            magic: MAGIC,
            version: VERSION,
            order: ORDER_MARK,
        };
        writer.put(&header.encode())?;
        Ok(writer)
    }

    /// Bytes written so far.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.at
    }

    /// Writes a section whose elements are at hand.
    ///
    /// # Errors
    /// Where there is such a section already, and where the system refuses.
    pub fn section<T: IntoBytes + Immutable>(
        &mut self,
        tag: Tag,
        number: u32,
        elements: &[T],
    ) -> io::Result<()> {
        self.stream(tag, number, |section| section.append(elements))
    }

    /// Writes a section that comes in pieces.
    ///
    /// # Errors
    /// Where there is such a section already, where `fill` fails, and where the system refuses.
    /// Nothing but errors comes from this writer after one of the latter two.
    pub fn stream<T: IntoBytes + Immutable>(
        &mut self,
        tag: Tag,
        number: u32,
        fill: impl FnOnce(&mut SectionWriter<'_, 'w, T>) -> io::Result<()>,
    ) -> io::Result<()> {
        let id = Id { tag, number };
        let element = u32::try_from(size_of::<T>())
            .ok()
            .filter(|&e| e > 0)
            .ok_or_else(|| misuse(format!("section {id}: elements of no or too many bytes")))?;
        if self.ids.contains(&id) {
            return Err(misuse(format!("section {id} is written twice")));
        }
        self.pad()?;
        let offset = self.at;
        let mut section = SectionWriter {
            file: self,
            crc: Hasher::new(),
            elements: PhantomData,
        };
        let filled = fill(&mut section);
        let crc = std::mem::take(&mut section.crc).finalize();
        if let Err(failed) = filled {
            self.broken = true;
            return Err(failed);
        }
        self.ids.insert(id);
        self.lines.push(Line {
            id,
            offset,
            length: self.at - offset,
            crc,
            element,
        });
        Ok(())
    }

    /// Ends the container, and says how many bytes it has. `out` is not flushed.
    ///
    /// # Errors
    /// Where a write failed before, or fails now.
    pub fn finish(mut self) -> io::Result<u64> {
        self.pad()?;
        let table_offset = self.at;
        let mut crc = Hasher::new();
        for line in std::mem::take(&mut self.lines) {
            let bytes = line.encode();
            crc.update(&bytes);
            self.put(&bytes)?;
        }
        let table_length = self.at - table_offset;
        self.pad()?;
        let trailer = Trailer {
            table_offset,
            table_length,
            total: self.at + ALIGN,
            table_crc: crc.finalize(),
            magic: END_MAGIC,
        };
        self.put(&trailer.encode())?;
        Ok(self.at)
    }

    /// Writes zeros up to the next multiple of 64.
    fn pad(&mut self) -> io::Result<()> {
        let next = aligned(self.at).unwrap_or(self.at);
        let zeros = [0; ALIGN as usize];
        let missing = usize::try_from(next - self.at).unwrap_or_default();
        self.put(zeros.get(..missing).unwrap_or_default())
    }

    fn put(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.broken {
            return Err(misuse("written on after a section had failed".into()));
        }
        self.out
            .write_all(bytes)
            .inspect_err(|_| self.broken = true)?;
        self.at += bytes.len() as u64;
        Ok(())
    }
}

/// Takes the elements of one section. One of bytes is also an [`io::Write`].
#[derive(Debug)]
pub struct SectionWriter<'a, 'w, T> {
    file: &'a mut ContainerWriter<'w>,
    crc: Hasher,
    elements: PhantomData<fn(T)>,
}

impl<T: IntoBytes + Immutable> SectionWriter<'_, '_, T> {
    /// Adds elements to the section.
    ///
    /// # Errors
    /// Where the system refuses.
    pub fn append(&mut self, elements: &[T]) -> io::Result<()> {
        let bytes = elements.as_bytes();
        self.crc.update(bytes);
        self.file.put(bytes)
    }
}

impl Write for SectionWriter<'_, '_, u8> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.append(bytes).map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn misuse(problem: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, problem)
}
