//! The points of a PCD file, as a stream.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::sync::{Mutex, OnceLock, PoisonError};

use super::decode::{Packed, bytes_ignored, points_ignored, row_parser, seen_from};
use super::header::{Claim, Field, Header, LONGEST};
use super::values::Data;
use crate::columns::Columns;
use crate::error::Fault;
use crate::lines::Blocks;
use crate::lzf;
use crate::scalar::Order;
use crate::stream::{Axis, Sink, Table, Told, line_count};

/// A PCD file of which the header was read.
#[derive(Debug)]
pub(crate) struct Stream {
    header: Header,
    columns: Columns,
    /// Lines of the header.
    lines: usize,
    /// How many points to read, where that is known before.
    count: Option<u64>,
    packed: Option<Packed>,
    /// The decompressed data, in a file without a name.
    unpacked: OnceLock<Mutex<File>>,
}

impl Stream {
    /// Bytes of the file that hold every header.
    pub(crate) const HEAD: usize = LONGEST + 1;

    /// From the first [`Stream::HEAD`] bytes of a file of `length` bytes.
    pub(crate) fn open(head: &[u8], file: &mut File, length: u64) -> Result<Self, Fault> {
        let header = Header::parse(head)?;
        let columns = header.find_columns()?;
        let mut stream = Self {
            lines: line_count(head, header.body),
            header,
            columns,
            count: None,
            packed: None,
            unpacked: OnceLock::new(),
        };
        let body = length.saturating_sub(stream.header.body as u64);
        // The header's own warnings are told at the end of each pass.
        let mut header = stream.header.clone();
        match stream.header.data {
            Data::Ascii => {
                stream.count = match stream.header.claim() {
                    Claim::None => None,
                    Claim::One(count) => Some(count),
                    Claim::Disputed => {
                        let mut ignore = |_: &[[f64; 3]], _| Ok(());
                        let mut sink = Sink::new(usize::MAX, &mut ignore);
                        let held = stream.ascii(file, u64::MAX, &mut sink)?;
                        Some(header.settle(held)?)
                    }
                };
            }
            Data::Binary => {
                stream.count = Some(header.settle(body / stream.header.stride.max(1))?);
            }
            Data::Compressed => {
                let mut sizes = Vec::new();
                file.seek(SeekFrom::Start(stream.header.body as u64))?;
                file.take(Packed::HEAD as u64).read_to_end(&mut sizes)?;
                stream.packed = Packed::read(&mut header, &sizes, body)?;
                stream.count = Some(stream.packed.map_or(0, |packed| packed.count));
            }
        }
        Ok(stream)
    }

    pub(crate) fn encoding(&self) -> &str {
        self.header.data.name()
    }

    pub(crate) fn count(&self) -> Option<u64> {
        self.count
    }

    pub(crate) fn fields(&self) -> Vec<String> {
        self.header.names()
    }

    pub(crate) fn viewpoint(&self) -> Option<[f64; 7]> {
        self.header.viewpoint
    }

    pub(crate) fn organised(&self) -> Option<(usize, usize)> {
        self.header.organised(self.count?)
    }

    pub(crate) fn seen_from(&self) -> Option<[f64; 3]> {
        seen_from(self.header.viewpoint, self.organised().is_some())
    }

    /// Reads all points of a file of `length` bytes.
    pub(crate) fn scan(
        &self,
        file: &mut File,
        length: u64,
        sink: &mut Sink<'_>,
    ) -> Result<Told, Fault> {
        let mut header = self.header.clone();
        let mut warnings = Vec::new();
        let points = match header.data {
            Data::Ascii => {
                let held = self.ascii(file, self.count.unwrap_or(u64::MAX), sink)?;
                let count = header.settle(held)?;
                warnings.extend(points_ignored(held, count));
                count
            }
            Data::Binary => {
                let body = header.body as u64;
                let stride = header.stride.max(1);
                let count = header.settle(length.saturating_sub(body) / stride)?;
                let table = self.table(body, |_| header.stride, 1, count)?;
                table.read(file, |rows| body + rows * stride, sink)?;
                let end = body + count * stride;
                let rest = length.saturating_sub(end);
                if any_set(file, end, rest)? {
                    warnings.push(bytes_ignored(rest));
                }
                count
            }
            Data::Compressed => match self.packed {
                None => header.settle(0).map(|_| 0)?,
                Some(packed) => {
                    let count = header.settle(packed.size / header.stride.max(1))?;
                    let unpacked = self.unpack(file, packed)?;
                    let table = self.table(0, |i| self.field_bytes(i), count, count)?;
                    let position = |rows| length / count.max(1) * rows;
                    table.read(
                        &mut Shared {
                            file: unpacked,
                            at: 0,
                        },
                        position,
                        sink,
                    )?;
                    count
                }
            },
        };
        // First what the header says, then what the data shows.
        header.warnings.append(&mut warnings);
        Ok(Told {
            points,
            warnings: header.warnings,
        })
    }

    /// Gives the first `most` points of an ascii file; returns how many it holds.
    fn ascii(&self, file: &mut File, most: u64, sink: &mut Sink<'_>) -> Result<u64, Fault> {
        let start = self.header.body as u64;
        file.seek(SeekFrom::Start(start))?;
        let mut blocks = Blocks::new(file, self.lines, start);
        let row = row_parser(&self.header, self.columns);
        let mut held = 0u64;
        loop {
            let bytes = blocks.lines()?.len();
            if bytes == 0 {
                return Ok(held);
            }
            blocks.parse(bytes, &row, |points, at| {
                let left = usize::try_from(most.saturating_sub(held)).unwrap_or(usize::MAX);
                held += points.len() as u64;
                sink.give(points.get(..left).unwrap_or(points), at)
            })?;
        }
    }

    fn field_bytes(&self, column: usize) -> u64 {
        self.header.fields.get(column).map_or(0, Field::bytes)
    }

    /// The coordinates' places: each field's byte times `spread` after `start`.
    fn table(
        &self,
        start: u64,
        step: impl Fn(usize) -> u64,
        spread: u64,
        rows: u64,
    ) -> Result<Table, Fault> {
        let mut xyz = Vec::with_capacity(3);
        for column in self.columns.xyz {
            let field = self.header.fields.get(column).ok_or(Fault::Changed)?;
            xyz.push(Axis {
                scalar: field.scalar,
                start: start.saturating_add(field.byte.saturating_mul(spread)),
                step: step(column),
            });
        }
        Ok(Table {
            xyz: xyz.try_into().map_err(|_| Fault::Changed)?,
            order: Order::Little,
            rows,
        })
    }

    /// Decompresses the data into a file, once.
    fn unpack(&self, file: &mut File, packed: Packed) -> Result<&Mutex<File>, Fault> {
        if let Some(unpacked) = self.unpacked.get() {
            return Ok(unpacked);
        }
        let start = self.header.body as u64 + Packed::HEAD as u64;
        file.seek(SeekFrom::Start(start))?;
        let no_room = |cause: std::io::Error| {
            let folder = std::env::temp_dir();
            let folder = folder.display();
            Fault::Io(std::io::Error::other(format!(
                "its decompressed points do not fit in {folder} ({cause}); make room there, or set TMPDIR"
            )))
        };
        let mut out = Spill {
            out: BufWriter::new(tempfile::tempfile().map_err(no_room)?),
            failed: None,
        };
        let result = lzf::unpack(
            &mut BufReader::new(file),
            packed.packed,
            packed.size,
            &mut out,
        );
        let _ = out.flush();
        if let Some(cause) = out.failed {
            return Err(no_room(cause));
        }
        result?.map_err(|at| Packed::damaged(&self.header, at as usize))?;
        let unpacked = out.out.into_inner().map_err(|e| no_room(e.into_error()))?;
        Ok(self.unpacked.get_or_init(|| Mutex::new(unpacked)))
    }
}

/// A reader of its own of a file that others read, too.
struct Shared<'a> {
    file: &'a Mutex<File>,
    at: u64,
}

impl Read for Shared<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.at))?;
        let read = file.read(bytes)?;
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Shared<'_> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(_) => None,
        }
        .ok_or(std::io::ErrorKind::Unsupported)?;
        Ok(self.at)
    }
}

/// Tells failures to write from those to read.
struct Spill {
    out: BufWriter<File>,
    failed: Option<std::io::Error>,
}

impl Write for Spill {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.out.write(bytes).map_err(|cause| self.fail(cause))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush().map_err(|cause| self.fail(cause))
    }
}

impl Spill {
    fn fail(&mut self, cause: std::io::Error) -> std::io::Error {
        let kind = cause.kind();
        if kind != std::io::ErrorKind::Interrupted {
            self.failed = Some(cause);
        }
        kind.into()
    }
}

/// Whether any of the `length` bytes from `start` on is not zero.
fn any_set(file: &mut File, start: u64, length: u64) -> std::io::Result<bool> {
    file.seek(SeekFrom::Start(start))?;
    let mut rest = file.take(length);
    let mut bytes = vec![0; 1 << 16];
    loop {
        let read = rest.read(&mut bytes)?;
        if read == 0 {
            return Ok(false);
        }
        if bytes.iter().take(read).any(|&byte| byte != 0) {
            return Ok(true);
        }
    }
}
