//! Named sections in one file.
//!
//! A container knows nothing of what its sections mean. Each is found by a tag of four bytes and a
//! number, starts at a multiple of 64 bytes, and has a checksum that is verified when the section is
//! first used. A section of a tag that nobody knows harms nobody.
//!
//! ```
//! # fn main() -> winze_map::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("a.wmap");
//! use winze_map::container::{self, Container};
//!
//! container::write(&path, |file| file.section(*b"PNTS", 0, &[[1_f32, 2., 3.], [4., 5., 6.]]))?;
//! let file = Container::open(&path)?;
//! assert_eq!(file.section::<[f32; 3]>(*b"PNTS", 0)?[1], [4., 5., 6.]);
//! # Ok(())
//! # }
//! ```

mod bytes;
mod crc;
mod layout;
mod parse;
mod reader;
mod writer;

pub use layout::{Id, Tag, VERSION, is_map};
pub use reader::{Container, Entry};
pub use writer::{ContainerWriter, SectionWriter, write};

#[cfg(test)]
mod damage;
#[cfg(test)]
mod tests;
