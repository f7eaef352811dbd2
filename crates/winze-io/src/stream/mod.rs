//! Point cloud files of any size, read in bounded memory and as often as needed.
//!
//! [`CloudStream`] gives a file's points as they are; [`PointStream`] gives one or more files as the
//! one cloud that [`read_cloud`](crate::read_cloud) would make of them. Both hold a few megabytes,
//! whatever the file's size, and beside that:
//! * text, and ascii PCD and PLY, hold the longest line where that is longer than a megabyte;
//! * `binary_compressed` PCD is decompressed once into a file without a name in the system's folder
//!   for temporary files (`TMPDIR`), where it takes up to 4 GiB until the stream is dropped.

mod points;
mod table;

use std::fs::{self, File, Metadata};
use std::io::{self, Read, Seek};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

pub use points::{PointStream, StreamedFile};
pub(crate) use table::{Axis, Table};

use crate::error::{Error, Fault, Result};
use crate::format::{Format, READABLE};
use crate::read::named;
use crate::{kitti, pcd, ply, text};

type Put<'a> = dyn FnMut(&[[f64; 3]], u64) -> std::result::Result<(), Fault> + 'a;

/// Where the points go: at most `chunk` at a time, with the byte of the file they end before, as far
/// as that can be told.
pub(crate) struct Sink<'a> {
    chunk: usize,
    each: &'a mut Put<'a>,
}

impl<'a> Sink<'a> {
    pub(crate) fn new(chunk: usize, each: &'a mut Put<'a>) -> Self {
        Self {
            chunk: chunk.max(1),
            each,
        }
    }

    pub(crate) fn give(&mut self, points: &[[f64; 3]], at: u64) -> std::result::Result<(), Fault> {
        points
            .chunks(self.chunk)
            .try_for_each(|part| (self.each)(part, at))
    }
}

/// What a pass over a file showed.
#[derive(Debug)]
pub(crate) struct Told {
    pub(crate) points: u64,
    pub(crate) warnings: Vec<String>,
}

/// How many lines end within the first `length` of `bytes`.
pub(crate) fn line_count(bytes: &[u8], length: usize) -> usize {
    bytes
        .iter()
        .take(length)
        .filter(|&&byte| byte == b'\n')
        .count()
}

/// By what a file is known again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Identity {
    length: u64,
    modified: Option<SystemTime>,
}

impl Identity {
    fn of(metadata: &Metadata) -> Self {
        Self {
            length: metadata.len(),
            modified: metadata.modified().ok(),
        }
    }
}

#[derive(Debug)]
enum Kind {
    Pcd(pcd::Stream),
    Ply(ply::Stream),
    Kitti(kitti::Stream),
    Text(text::Stream),
}

/// A point cloud file, opened to be read as a stream.
#[derive(Debug)]
pub struct CloudStream {
    path: PathBuf,
    kind: Kind,
    /// What the content looks like.
    shown: Option<Format>,
    identity: Identity,
}

impl CloudStream {
    /// Reads a file's header. (Of a text file that is all up to the first point; and an ascii PCD
    /// file whose POINTS and WIDTH times HEIGHT differ is read to its end, since that decides.)
    ///
    /// # Errors
    /// As [`read_cloud`](crate::read_cloud), and where the path is no regular file, which alone can
    /// be read more than once.
    pub fn open(path: &Path) -> Result<Self> {
        let name = || path.display().to_string();
        if path.is_dir() {
            return Err(Error::Folder { file: name() });
        }
        let io = |cause| Error::io(path, "be read", cause);
        if !fs::metadata(path).map_err(io)?.is_file() {
            let problem = "is a pipe or device, which can be read only once; copy it to a file";
            return Err(io(io::Error::other(problem)));
        }
        let mut file = File::open(path).map_err(io)?;
        let identity = Identity::of(&file.metadata().map_err(io)?);
        let mut head = Vec::new();
        let longest = pcd::Stream::HEAD.max(ply::Stream::HEAD) as u64;
        file.by_ref()
            .take(longest)
            .read_to_end(&mut head)
            .map_err(io)?;
        let shown = Format::from_content(&head);
        let format =
            Format::from_extension(path)
                .or(shown)
                .ok_or_else(|| Error::UnknownFormat {
                    file: name(),
                    known: READABLE,
                })?;
        let length = identity.length;
        let kind = match format {
            Format::Pcd => pcd::Stream::open(&head, &mut file, length).map(Kind::Pcd),
            Format::Ply => ply::Stream::open(&head).map(Kind::Ply),
            Format::Kitti => kitti::Stream::open(length).map(Kind::Kitti),
            Format::Text => text::Stream::open(&head, &mut file).map(Kind::Text),
        };
        Ok(Self {
            path: path.to_owned(),
            kind: kind.map_err(|fault| named(fault, format, shown).of(&name()))?,
            shown,
            identity,
        })
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The file's format.
    #[must_use]
    pub fn format(&self) -> Format {
        match self.kind {
            Kind::Pcd(_) => Format::Pcd,
            Kind::Ply(_) => Format::Ply,
            Kind::Kitti(_) => Format::Kitti,
            Kind::Text(_) => Format::Text,
        }
    }

    /// The format's own name for how numbers are held, such as `binary_compressed`.
    #[must_use]
    pub fn encoding(&self) -> String {
        match &self.kind {
            Kind::Pcd(file) => file.encoding().to_owned(),
            Kind::Ply(file) => file.encoding().to_owned(),
            Kind::Kitti(_) => kitti::ENCODING.to_owned(),
            Kind::Text(file) => file.encoding(),
        }
    }

    /// Size of the file.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.identity.length
    }

    /// Names of all columns of the file, in order.
    #[must_use]
    pub fn fields(&self) -> Vec<String> {
        match &self.kind {
            Kind::Pcd(file) => file.fields(),
            Kind::Ply(file) => file.fields(),
            Kind::Kitti(_) => kitti::fields(),
            Kind::Text(file) => file.fields(),
        }
    }

    /// Width and height, where the points form an image.
    #[must_use]
    pub fn organised(&self) -> Option<(usize, usize)> {
        match &self.kind {
            Kind::Pcd(file) => file.organised(),
            Kind::Ply(_) | Kind::Kitti(_) | Kind::Text(_) => None,
        }
    }

    /// PCD's VIEWPOINT as written: `tx ty tz qw qx qy qz`.
    #[must_use]
    pub fn viewpoint(&self) -> Option<[f64; 7]> {
        match &self.kind {
            Kind::Pcd(file) => file.viewpoint(),
            Kind::Ply(_) | Kind::Kitti(_) | Kind::Text(_) => None,
        }
    }

    /// Where the sensor stood, where the file really says so: as in [`winze::Cloud::viewpoint`].
    #[must_use]
    pub fn seen_from(&self) -> Option<[f64; 3]> {
        match &self.kind {
            Kind::Pcd(file) => file.seen_from(),
            Kind::Ply(_) | Kind::Kitti(_) | Kind::Text(_) => None,
        }
    }

    /// How many points the header announces. Nothing says yet that they are there.
    #[must_use]
    pub fn points_in_header(&self) -> Option<u64> {
        match &self.kind {
            Kind::Pcd(file) => file.count(),
            Kind::Ply(file) => Some(file.count()),
            Kind::Kitti(file) => Some(file.count()),
            Kind::Text(file) => file.count(),
        }
    }

    /// Reads all points from the file's beginning, in order, at most `chunk` at a time (and as few
    /// as suits the file), as they are: those that are not finite and those at zero included.
    ///
    /// # Errors
    /// Where the file is broken or cut short, as [`read_cloud`](crate::read_cloud); points may have
    /// been given before that shows. [`Error::Changed`] where it is not the file that was opened. Any
    /// error of `each`, which ends the reading.
    pub fn for_each(
        &self,
        chunk: usize,
        each: &mut dyn FnMut(&[[f64; 3]]) -> Result<()>,
    ) -> Result<()> {
        let mut put =
            |points: &[[f64; 3]], _| each(points).map_err(|error| Fault::Passed(Box::new(error)));
        self.scan(&mut Sink::new(chunk, &mut put)).map(|_| ())
    }

    fn scan(&self, sink: &mut Sink<'_>) -> Result<Told> {
        self.with_file(|file| {
            let length = self.identity.length;
            match &self.kind {
                Kind::Pcd(pcd) => pcd.scan(file, length, sink),
                Kind::Ply(ply) => ply.scan(file, length, sink),
                Kind::Kitti(kitti) => kitti.scan(file, sink),
                Kind::Text(text) => text.scan(file, sink),
            }
        })
    }

    /// Opens the file again and looks before and after `read` whether it is the same.
    fn with_file<T>(
        &self,
        read: impl FnOnce(&mut File) -> std::result::Result<T, Fault>,
    ) -> Result<T> {
        self.opened(read).map_err(|fault| {
            let fault = named(fault, self.format(), self.shown);
            fault.of(&self.path.display().to_string())
        })
    }

    fn opened<T>(
        &self,
        read: impl FnOnce(&mut File) -> std::result::Result<T, Fault>,
    ) -> std::result::Result<T, Fault> {
        let mut file = File::open(&self.path)?;
        self.check(&file)?;
        file.rewind()?;
        match read(&mut file) {
            Ok(value) => self.check(&file).map(|()| value),
            Err(fault @ Fault::Passed(_)) => Err(fault),
            // In a file that is written to, anything may look broken.
            Err(fault) => self.check(&file).and(Err(fault)),
        }
    }

    fn check(&self, file: &File) -> std::result::Result<(), Fault> {
        if Identity::of(&file.metadata()?) == self.identity {
            Ok(())
        } else {
            Err(Fault::Changed)
        }
    }
}
