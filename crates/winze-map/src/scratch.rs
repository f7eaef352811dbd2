//! Long columns in scratch files instead of memory.
//!
//! The system writes out what does not fit in memory and reads it back when it is used. The files
//! have no name: whatever becomes of the process, they go with it.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::path::{Path, PathBuf};

use memmap2::MmapMut;
use winze::columns::{Columns, Plain};
use zerocopy::{FromBytes, IntoBytes};

use crate::error::{Error, Result};
use crate::mapping;

/// Columns of fewer bytes stay in memory: a file would cost more than it saves.
const SMALL: usize = 1 << 20;

/// A folder for scratch files, which had better be on a fast disk with room to spare.
#[derive(Debug, Clone)]
pub struct Scratch {
    folder: PathBuf,
}

impl Scratch {
    /// Scratch files in `folder`, which must exist by the time of the first column.
    pub fn new(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
        }
    }

    /// The folder.
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// A column that grows element by element, for data whose length is not known beforehand.
    ///
    /// # Errors
    /// Where no file can be made in the folder.
    pub fn writer<T: Plain>(&self) -> Result<ScratchWriter<T>> {
        let file = self.file().map_err(|e| self.refused(0, e))?;
        Ok(ScratchWriter {
            scratch: self.clone(),
            out: BufWriter::with_capacity(1 << 16, file),
            len: 0,
            elements: PhantomData,
        })
    }

    fn file(&self) -> io::Result<File> {
        tempfile::tempfile_in(&self.folder)
    }

    fn refused(&self, bytes: u64, cause: io::Error) -> Error {
        Error::Scratch {
            folder: self.folder.display().to_string(),
            bytes,
            cause,
        }
    }

    /// A mapped file of `len` zeros.
    ///
    /// The zeros are really written, so that a full disk is an error here and not a SIGBUS when a
    /// value is stored later. File systems that never write in place (btrfs, ZFS) or that compress
    /// can still run out of room then, and so can network drives.
    fn mapped_zeros<T: Plain>(&self, len: usize, bytes: usize) -> io::Result<Column<T>> {
        const ZEROS: &[u8] = &[0; 1 << 18];
        let mut file = self.file()?;
        let mut missing = bytes;
        while missing > 0 {
            let now = ZEROS.get(..missing).unwrap_or(ZEROS);
            file.write_all(now)?;
            missing -= now.len();
        }
        Column::mapped(&file, len)
    }
}

impl Columns for Scratch {
    type Error = Error;
    type Column<T: Plain> = Column<T>;

    fn zeros<T: Plain>(&self, len: usize) -> Result<Column<T>> {
        let Some(bytes) = len.checked_mul(size_of::<T>()) else {
            return Err(self.refused(u64::MAX, io::ErrorKind::FileTooLarge.into()));
        };
        if bytes < SMALL {
            return Ok(Column(Place::Memory(vec![T::new_zeroed(); len])));
        }
        self.mapped_zeros(len, bytes)
            .map_err(|e| self.refused(bytes as u64, e))
    }
}

/// A column of numbers, in memory or in a scratch file; gone when dropped.
///
/// Loops had better take the slice once: each dereference checks that the bytes fit the type.
#[derive(Debug)]
pub struct Column<T>(Place<T>);

#[derive(Debug)]
enum Place<T> {
    Memory(Vec<T>),
    /// `Column::mapped` has checked that it is a slice of `T`.
    File(MmapMut),
}

impl<T: Plain> Column<T> {
    /// The file, which has the bytes of `len` elements. It stays as long as the mapping does.
    fn mapped(file: &File, len: usize) -> io::Result<Self> {
        let map = mapping::scratch(file)?;
        match <[T]>::ref_from_bytes(&map) {
            Ok(elements) if elements.len() == len => Ok(Self(Place::File(map))),
            _ => Err(io::Error::other("the file was mapped in another size")),
        }
    }
}

impl<T: Plain> Deref for Column<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            Place::Memory(elements) => elements,
            Place::File(map) => <[T]>::ref_from_bytes(map).unwrap_or_default(),
        }
    }
}

impl<T: Plain> DerefMut for Column<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Place::Memory(elements) => elements,
            Place::File(map) => <[T]>::mut_from_bytes(map).unwrap_or_default(),
        }
    }
}

/// Elements that go into a scratch file as they come.
#[derive(Debug)]
pub struct ScratchWriter<T> {
    scratch: Scratch,
    out: BufWriter<File>,
    /// Elements so far.
    len: usize,
    elements: PhantomData<fn(T)>,
}

impl<T: Plain> ScratchWriter<T> {
    /// Adds one element.
    ///
    /// # Errors
    /// Where the disk is full.
    pub fn push(&mut self, element: T) -> Result<()> {
        self.append(&[element])
    }

    /// Adds elements.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn append(&mut self, elements: &[T]) -> Result<()> {
        self.out
            .write_all(elements.as_bytes())
            .map_err(|e| self.scratch.refused(self.bytes(), e))?;
        self.len += elements.len();
        Ok(())
    }

    /// How many elements there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// All of them, as a column.
    ///
    /// # Errors
    /// Where the disk is full, or the file cannot be mapped.
    pub fn finish(self) -> Result<Column<T>> {
        let (scratch, len, bytes) = (self.scratch.clone(), self.len, self.bytes());
        let file = self
            .out
            .into_inner()
            .map_err(io::IntoInnerError::into_error);
        // No bytes cannot be mapped.
        file.and_then(|file| match len {
            0 => Ok(Column(Place::Memory(Vec::new()))),
            _ => Column::mapped(&file, len),
        })
        .map_err(|e| scratch.refused(bytes, e))
    }

    fn bytes(&self) -> u64 {
        (self.len as u64).saturating_mul(size_of::<T>() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANY: usize = 300_000;

    fn names(folder: &Path) -> usize {
        std::fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn columns_are_zero_keep_their_values_and_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::new(folder.path());
        let mut a = scratch.zeros::<[f32; 3]>(MANY).unwrap();
        let mut b = scratch.zeros::<u64>(MANY).unwrap();
        let mut c = scratch.zeros::<u16>(7).unwrap();
        assert!(matches!(a.0, Place::File(_)) && matches!(b.0, Place::File(_)));
        assert!(matches!(c.0, Place::Memory(_)));
        assert!(a.iter().all(|v| *v == [0.; 3]) && b.iter().all(|v| *v == 0));
        assert_eq!((a.len(), b.len(), &*c), (MANY, MANY, &[0; 7][..]));
        for (i, (a, b)) in a.iter_mut().zip(b.iter_mut()).enumerate() {
            *a = [i as f32, 1., -1.];
            *b = u64::MAX - i as u64;
        }
        c[3] = 9;
        assert_eq!(names(folder.path()), 0, "scratch files have no names");
        for (i, (a, b)) in a.iter().zip(b.iter()).enumerate() {
            assert_eq!((*a, *b), ([i as f32, 1., -1.], u64::MAX - i as u64));
        }
        assert_eq!(&*c, [0, 0, 0, 9, 0, 0, 0]);
        drop((a, b, c));
        assert_eq!(names(folder.path()), 0);
    }

    #[test]
    fn a_column_of_nothing_is_fine_at_either_side_of_the_threshold() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::new(folder.path());
        assert!(scratch.zeros::<f64>(0).unwrap().is_empty());
        for bytes in [SMALL - 1, SMALL, SMALL + 1] {
            let mut column = scratch.zeros::<u8>(bytes).unwrap();
            assert_eq!(matches!(column.0, Place::File(_)), bytes >= SMALL);
            *column.last_mut().unwrap() = 3;
            assert_eq!((column.len(), column[bytes - 1]), (bytes, 3));
        }
    }

    #[test]
    fn what_is_written_piece_by_piece_becomes_a_column() {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::new(folder.path());
        let writer = scratch.writer::<u32>().unwrap();
        assert!(writer.is_empty() && writer.finish().unwrap().is_empty());
        for len in [1_u32, 1000, 500_000] {
            let mut writer = scratch.writer().unwrap();
            writer.push([0, len]).unwrap();
            let rest: Vec<_> = (1..len).map(|i| [i, len]).collect();
            rest.chunks(777).for_each(|c| writer.append(c).unwrap());
            assert_eq!(writer.len(), len as usize);
            let mut column = writer.finish().unwrap();
            assert_eq!(column.len(), len as usize);
            assert!((0..len).zip(column.iter()).all(|(i, v)| *v == [i, len]));
            column[0] = [7, 7];
            assert_eq!(column[0], [7, 7]);
            assert_eq!(names(folder.path()), 0);
        }
    }

    #[test]
    fn folders_that_will_not_do_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let missing = Scratch::new(folder.path().join("no such"));
        let told = missing.zeros::<u8>(SMALL).unwrap_err().to_string();
        let wanted =
            "no such: no scratch file of 1048576 bytes: there is no such folder; create it";
        assert!(told.contains(wanted), "{told}");
        missing.writer::<u8>().unwrap_err();
        assert!(missing.zeros::<u8>(5).is_ok(), "needs no file");

        let file = folder.path().join("file");
        std::fs::write(&file, "").unwrap();
        let told = Scratch::new(&file).zeros::<u8>(SMALL).unwrap_err();
        assert!(told.to_string().contains("it is no folder"), "{told}");

        let told = Scratch::new(folder.path()).zeros::<u64>(usize::MAX);
        assert!(matches!(told, Err(Error::Scratch { .. })));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn folders_that_nobody_can_write_to_are_told() {
        // Not even root makes files there.
        let told = Scratch::new("/proc").zeros::<u8>(SMALL).unwrap_err();
        let told = told.to_string();
        assert!(told.starts_with("/proc: no scratch file of 1048576 bytes: "));
        assert!(
            told.ends_with("or name another folder for scratch files"),
            "{told}"
        );
    }
}
