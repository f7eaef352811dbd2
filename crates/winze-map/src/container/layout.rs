//! The fixed parts of a container, byte by byte, as `docs/map-format.md` lists them.
//!
//! Header, table and trailer are little-endian. The numbers in sections are as the machine has them;
//! a mark in the header tells which way round that is.

use std::fmt;

/// What a section is called; printable ASCII reads best in messages.
pub type Tag = [u8; 4];

/// A section's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id {
    /// What kind of data.
    pub tag: Tag,
    /// Which one of the kind.
    pub number: u32,
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.tag.escape_ascii(), self.number)
    }
}

/// The format version that is written, and the newest that is read.
pub const VERSION: u32 = 1;
/// The oldest format version that is read.
pub(super) const OLDEST: u32 = 1;

pub(super) const MAGIC: [u8; 8] = *b"WINZEMAP";
/// Whether a file that begins with these bytes says that it is a container, of whatever version.
#[must_use]
pub fn is_map(first: &[u8; 8]) -> bool {
    *first == MAGIC
}

pub(super) const END_MAGIC: [u8; 8] = *b"WMAP END";
/// In the header in the byte order of the machine that wrote the file.
pub(super) const ORDER_MARK: u32 = 0x0A0B_0C0D;

/// Sections, table and trailer start at multiples of this: a cache line, and enough for any number.
pub(super) const ALIGN: u64 = 64;
pub(super) const HEADER: usize = 64;
pub(super) const TRAILER: usize = 64;
pub(super) const ENTRY: usize = 40;

/// The next multiple of [`ALIGN`]; none where it does not fit 64 bits.
pub(super) fn aligned(at: u64) -> Option<u64> {
    at.checked_next_multiple_of(ALIGN)
}

/// One line of the section table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Line {
    pub(super) id: Id,
    pub(super) offset: u64,
    pub(super) length: u64,
    pub(super) crc: u32,
    /// Bytes of one element.
    pub(super) element: u32,
}

impl Line {
    pub(super) fn encode(&self) -> [u8; ENTRY] {
        let mut bytes = Out::<ENTRY>::new();
        bytes.put(&self.id.tag);
        bytes.put(&self.id.number.to_le_bytes());
        bytes.put(&self.offset.to_le_bytes());
        bytes.put(&self.length.to_le_bytes());
        bytes.put(&self.crc.to_le_bytes());
        bytes.put(&self.element.to_le_bytes());
        bytes.bytes
    }

    /// The line, and whether what is reserved is zero.
    pub(super) fn decode(bytes: &[u8; ENTRY]) -> (Self, bool) {
        let mut from = In(bytes);
        let line = Self {
            id: Id {
                tag: from.take(),
                number: from.u32(),
            },
            offset: from.u64(),
            length: from.u64(),
            crc: from.u32(),
            element: from.u32(),
        };
        (line, from.rest_is_zero())
    }
}

/// What a container starts with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) magic: [u8; 8],
    pub(super) version: u32,
    /// As this machine reads it.
    pub(super) order: u32,
}

impl Header {
    pub(super) fn encode(&self) -> [u8; HEADER] {
        let mut bytes = Out::<HEADER>::new();
        bytes.put(&self.magic);
        bytes.put(&self.version.to_le_bytes());
        bytes.put(&self.order.to_ne_bytes());
        bytes.sealed()
    }

    /// The header, and whether what is reserved is zero.
    pub(super) fn decode(bytes: &[u8; HEADER]) -> (Self, bool) {
        let mut from = In(body(bytes));
        let header = Self {
            magic: from.take(),
            version: from.u32(),
            order: u32::from_ne_bytes(from.take()),
        };
        (header, from.rest_is_zero())
    }
}

/// What a container ends with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Trailer {
    pub(super) table_offset: u64,
    pub(super) table_length: u64,
    /// Bytes of the whole file.
    pub(super) total: u64,
    pub(super) table_crc: u32,
    pub(super) magic: [u8; 8],
}

impl Trailer {
    pub(super) fn encode(&self) -> [u8; TRAILER] {
        let mut bytes = Out::<TRAILER>::new();
        bytes.put(&self.table_offset.to_le_bytes());
        bytes.put(&self.table_length.to_le_bytes());
        bytes.put(&self.total.to_le_bytes());
        bytes.put(&self.table_crc.to_le_bytes());
        bytes.put(&[0; 24]);
        bytes.put(&self.magic);
        bytes.sealed()
    }

    /// The trailer, and whether what is reserved is zero.
    pub(super) fn decode(bytes: &[u8; TRAILER]) -> (Self, bool) {
        let mut from = In(body(bytes));
        let (table_offset, table_length) = (from.u64(), from.u64());
        let (total, table_crc) = (from.u64(), from.u32());
        let reserved: [u8; 24] = from.take();
        let trailer = Self {
            table_offset,
            table_length,
            total,
            table_crc,
            magic: from.take(),
        };
        (trailer, reserved == [0; 24])
    }
}

/// Whether the last four bytes are the checksum of those before.
pub(super) fn is_sealed(bytes: &[u8; 64]) -> bool {
    bytes
        .split_last_chunk()
        .is_some_and(|(body, crc)| crc32fast::hash(body) == u32::from_le_bytes(*crc))
}

/// What the checksum covers.
fn body(bytes: &[u8; 64]) -> &[u8] {
    bytes.split_last_chunk::<4>().map_or(&[], |(body, _)| body)
}

/// A fixed number of bytes, filled from the start.
struct Out<const N: usize> {
    bytes: [u8; N],
    at: usize,
}

impl<const N: usize> Out<N> {
    fn new() -> Self {
        Self {
            bytes: [0; N],
            at: 0,
        }
    }

    fn put(&mut self, part: &[u8]) {
        let free = self.bytes.iter_mut().skip(self.at);
        for (to, from) in free.zip(part) {
            *to = *from;
        }
        self.at += part.len();
    }

    /// With the checksum of all before in the last four bytes.
    fn sealed(mut self) -> [u8; N] {
        if let Some((body, crc)) = self.bytes.split_last_chunk_mut() {
            *crc = crc32fast::hash(body).to_le_bytes();
        }
        self.bytes
    }
}

/// Takes numbers from the front; zeros where nothing is left.
struct In<'a>(&'a [u8]);

impl In<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        match self.0.split_first_chunk() {
            Some((part, rest)) => {
                self.0 = rest;
                *part
            }
            None => [0; N],
        }
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    fn rest_is_zero(&self) -> bool {
        self.0.iter().all(|&b| b == 0)
    }
}
