//! PLY, the polygon file format, of which only the vertices are read.
//!
//! The decoder is our own. `ply-rs-bw` 4.0, which the tests compare with, refuses `nan`, `.5` and
//! `5.` in ascii files, makes as many elements without properties as a header of 100 bytes claims,
//! and takes longer for binary vertices alone than this crate takes for the finished cloud (see
//! the benchmark `read`).

mod decode;
mod header;
mod stream;
mod walk;
mod write;

pub(crate) use decode::{decode, decode_narrow};
pub(crate) use stream::Stream;
pub(crate) use write::write;
