//! PCD, the format of the Point Cloud Library: versions .5 to .7, ascii, binary and
//! binary_compressed.
//!
//! Points are in the file's own frame; like the Point Cloud Library, this crate does not apply
//! VIEWPOINT to them.

mod decode;
mod header;
mod stream;
mod values;
mod write;

pub(crate) use decode::{decode, decode_narrow};
pub(crate) use stream::Stream;
pub(crate) use write::write;
