//! Reading a container.

use std::fs::File;
use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};

use zerocopy::{FromBytes, Immutable, KnownLayout};

use super::bytes::{Bytes, Owned};
use super::crc::crc;
use super::layout::{Id, Line, Tag};
use super::parse::{self, Frame};
use crate::error::{Error, Result};
use crate::mapping;

/// A file of sections, open for reading.
///
/// Sections are verified when they are first asked for: their checksum, their element size, their
/// alignment. One that fails fails every time.
#[derive(Debug)]
pub struct Container {
    /// As given, for messages.
    file: String,
    bytes: Bytes,
    frame: Frame,
    /// What is known of each section, in the order of the file. No lock: a thread that waits for
    /// rayon while it holds one could be handed work that wants the same section.
    states: Vec<AtomicU8>,
}

// What is known of a section: the greater outdoes the smaller, for good.
const UNVERIFIED: u8 = 0;
const INTACT: u8 = 1;
const DAMAGED: u8 = 2;

/// What the table says of a section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// What it is called.
    pub id: Id,
    /// Where its bytes begin in the file.
    pub offset: u64,
    /// How many bytes it has.
    pub length: u64,
    /// Bytes of each of its elements.
    pub element: u32,
    /// Whether its checksum was found to match; none where that has not been looked at yet.
    pub intact: Option<bool>,
}

impl Container {
    /// Maps a file into memory and checks its frame, in time that depends on the number of sections
    /// and not on their size.
    ///
    /// The file must not be written into or cut short while it is open: values that were verified
    /// could change, and touching a page behind the new end kills the process (SIGBUS on Unix). Copy
    /// a new map beside the old one and rename it, as [`write()`](super::write()) does; whoever has the old
    /// one open keeps it. Where nobody can promise that, as on network drives and removable disks,
    /// use [`read`](Self::read).
    ///
    /// # Errors
    /// Where the file cannot be mapped, is no container, or is one of another version; where it is
    /// cut short, grown, or damaged outside its sections.
    pub fn open(path: &Path) -> Result<Self> {
        let (file, length) = open(path)?;
        if length == 0 {
            return Self::check(path.display().to_string(), Bytes::Owned(Owned::default()));
        }
        let map = mapping::read_only(&file).map_err(|e| Error::io(path, "be read", e))?;
        Self::check(path.display().to_string(), Bytes::Mapped(map))
    }

    /// Like [`open`](Self::open), but reads the whole file into memory, where nobody can change it.
    ///
    /// # Errors
    /// As [`open`](Self::open), and where there is not enough memory.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, length) = open(path)?;
        let owned = Owned::read(file, length).map_err(|e| Error::io(path, "be read", e))?;
        Self::check(path.display().to_string(), Bytes::Owned(owned))
    }

    /// A copy of bytes at hand, which messages call `name`.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self> {
        let owned = Owned::read(bytes, bytes.len() as u64)
            .map_err(|e| Error::io(Path::new(name), "be read", e))?;
        Self::check(name.into(), Bytes::Owned(owned))
    }

    fn check(file: String, bytes: Bytes) -> Result<Self> {
        let frame = parse::frame(&file, bytes.as_slice())?;
        let states = frame.lines.iter().map(|_| UNVERIFIED.into()).collect();
        Ok(Self {
            file,
            bytes,
            frame,
            states,
        })
    }

    /// The elements of a section.
    ///
    /// # Errors
    /// Where there is no such section, its checksum does not match, or its elements have another
    /// size than `T`.
    pub fn section<T: FromBytes + Immutable + KnownLayout>(
        &self,
        tag: Tag,
        number: u32,
    ) -> Result<&[T]> {
        let id = Id { tag, number };
        let (line, state) = self.find(id).ok_or_else(|| Error::MissingSection {
            file: self.file.clone(),
            section: id.to_string(),
        })?;
        let wanted = size_of::<T>();
        if usize::try_from(line.element) != Ok(wanted) {
            let problem = format!("elements of {} bytes instead of {wanted}", line.element);
            return Err(self.malformed(id, problem));
        }
        let bytes = self.payload(line);
        if state.load(Ordering::Relaxed) == UNVERIFIED {
            state.fetch_max(verdict(line, bytes, &mut |_| ()), Ordering::Relaxed);
        }
        if state.load(Ordering::Relaxed) != INTACT {
            return Err(self.damaged(format!("section {id}")));
        }
        // Everything was checked when the file was opened, but for what a type wants beyond 64 bytes.
        <[T]>::ref_from_bytes(bytes).map_err(|problem| {
            let at = line.offset;
            self.malformed(id, format!("its elements at byte {at}: {problem}"))
        })
    }

    /// Whether there is such a section.
    #[must_use]
    pub fn contains(&self, tag: Tag, number: u32) -> bool {
        self.find(Id { tag, number }).is_some()
    }

    /// All sections, in the order of the file.
    pub fn entries(&self) -> impl ExactSizeIterator<Item = Entry> + '_ {
        let sections = self.frame.lines.iter().zip(&self.states);
        sections.map(|(line, state)| Entry {
            id: line.id,
            offset: line.offset,
            length: line.length,
            element: line.element,
            intact: match state.load(Ordering::Relaxed) {
                UNVERIFIED => None,
                state => Some(state == INTACT),
            },
        })
    }

    /// The sections with none of these tags: those of a newer or another program.
    pub fn unknown<'a>(&'a self, known: &'a [Tag]) -> impl Iterator<Item = Entry> + 'a {
        self.entries().filter(|e| !known.contains(&e.id.tag))
    }

    /// The file, as given.
    #[must_use]
    pub fn file(&self) -> &str {
        &self.file
    }

    /// Bytes of the whole file.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.bytes.as_slice().len() as u64
    }

    /// Verifies each byte of the file, also of sections that nobody knows, and again if it was
    /// verified before. `progress` gets the bytes of sections done and in all.
    ///
    /// # Errors
    /// Where anything is damaged; all damaged sections are named.
    pub fn verify_all(&self, progress: &mut dyn FnMut(u64, u64)) -> Result<()> {
        let again = parse::frame(&self.file, self.bytes.as_slice())?;
        if again != self.frame {
            return Err(self.damaged("section table, which changed while the file was open".into()));
        }
        let all = self.frame.lines.iter().map(|line| line.length).sum();
        let mut done = 0;
        let mut damaged = Vec::new();
        for (line, state) in self.frame.lines.iter().zip(&self.states) {
            let mut more = |bytes| {
                done += bytes;
                progress(done, all);
            };
            let found = verdict(line, self.payload(line), &mut more);
            // One that was damaged before stays so, whatever its bytes are by now.
            if state.fetch_max(found, Ordering::Relaxed).max(found) != INTACT {
                damaged.push(line.id.to_string());
            }
        }
        if damaged.is_empty() {
            return Ok(());
        }
        let more = damaged.len().saturating_sub(NAMED);
        damaged.truncate(NAMED);
        let mut section = format!("section {}", damaged.join(", "));
        if more > 0 {
            section += &format!(" and {more} more");
        }
        Err(self.damaged(section))
    }

    fn find(&self, id: Id) -> Option<(&Line, &AtomicU8)> {
        let i = *self.frame.by_id.get(&id)?;
        Some((self.frame.lines.get(i)?, self.states.get(i)?))
    }

    /// Its end was checked when the file was opened.
    fn payload(&self, line: &Line) -> &[u8] {
        let end = line.offset.saturating_add(line.length);
        parse::slice(self.bytes.as_slice(), line.offset, end).unwrap_or_default()
    }

    fn damaged(&self, section: String) -> Error {
        Error::Damaged {
            file: self.file.clone(),
            section,
        }
    }

    fn malformed(&self, id: Id, problem: String) -> Error {
        Error::Malformed {
            file: self.file.clone(),
            place: format!("section {id}"),
            problem,
        }
    }
}

/// So many damaged sections are named in a message.
const NAMED: usize = 8;

fn verdict(line: &Line, bytes: &[u8], progress: &mut dyn FnMut(u64)) -> u8 {
    if crc(bytes, progress) == line.crc {
        INTACT
    } else {
        DAMAGED
    }
}

/// Opens a regular file, and says how long it is.
fn open(path: &Path) -> Result<(File, u64)> {
    let refused = |cause| Error::io(path, "be read", cause);
    // Before it is opened: opening a pipe would wait for somebody to write into it.
    let metadata = std::fs::metadata(path).map_err(refused)?;
    if metadata.is_dir() {
        let file = path.display().to_string();
        return Err(winze_io::Error::Folder { file }.into());
    }
    if !metadata.is_file() {
        return Err(Error::NotAMap {
            file: path.display().to_string(),
            problem: "it is no regular file".into(),
        });
    }
    let file = File::open(path).map_err(refused)?;
    let length = file.metadata().map_err(refused)?.len();
    Ok((file, length))
}
