//! The only module with unsafe code: it maps files into memory.
//!
//! The compiler takes a slice for memory that nobody else changes. A mapped file is only as constant
//! as its owners leave it, and no program can make sure of that. What we do about it stands at each
//! function.

#![allow(unsafe_code)]

use std::fs::File;
use std::io;

use memmap2::{Mmap, MmapMut};

/// Maps a whole file for reading.
///
/// Another process can still write into the file or cut it short. Written bytes show up in the
/// slice; touching a page behind a new, nearer end kills this process with SIGBUS on Unix (Windows
/// refuses to cut a mapped file short). Hence the rule that maps are replaced by renaming, never
/// rewritten: a mapping keeps the file it was made of, also when its name goes to another file.
/// Whoever cannot rely on that (a network drive, a disk that may be pulled out) reads the file into
/// memory instead.
pub(crate) fn read_only(file: &File) -> io::Result<Mmap> {
    // SAFETY: sound while nobody writes into the file or cuts it short. winze itself never does: it
    // writes maps with `winze_io::atomic`, under a new inode. Others are told not to, in the docs of
    // `Container::open`. Where they do it all the same, the process may be killed, or read values
    // that it did not check, and what the language promises no longer holds. What keeps the harm
    // small is that the values are plain numbers, any bytes of which are valid, and that indices
    // among them are checked where they are used.
    unsafe { Mmap::map(file) }
}

/// Maps a whole scratch file for reading and writing.
///
/// For files that this process has just made and that have no name: nobody else has them.
pub(crate) fn scratch(file: &File) -> io::Result<MmapMut> {
    // SAFETY: the file has no name and only this process has it open; it is neither written to
    // otherwise nor cut short after this call, as its only handle is dropped by the callers.
    unsafe { MmapMut::map_mut(file) }
}
