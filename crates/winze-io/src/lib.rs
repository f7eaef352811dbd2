//! Point cloud files for [winze]: PCD, PLY, KITTI's and plain text to and from [`winze::Cloud`], and
//! rigid transforms to and from text.
//!
//! ```
//! # fn main() -> winze_io::Result<()> {
//! # let folder = tempfile::tempdir().unwrap();
//! # let path = folder.path().join("map.csv");
//! # std::fs::write(&path, "x,y,z\n431234.567,4499980.459,312.0\nnan,nan,nan\n").unwrap();
//! use winze_io::{ReadOptions, WriteOptions, read_cloud, write_cloud};
//!
//! let file = read_cloud(&path, &ReadOptions::default())?;
//! assert_eq!((file.cloud.len(), file.report.non_finite), (1, 1));
//! write_cloud(&path.with_extension("pcd"), &file.cloud, &WriteOptions::default())?;
//! # Ok(())
//! # }
//! ```
//!
//! Coordinates keep a tenth of a millimetre within 1 km of the cloud's middle and a millimetre
//! within 16 km, wherever the file's own origin lies. Files are data from outside: whatever they
//! hold, reading them gives a cloud or an [`Error`] that says where the file is wrong, takes memory
//! in proportion to the file's size, and never panics. (A point takes 12 bytes in
//! the cloud and, unless all coordinates are small and in PCD or in binary PLY, 24 more while it is
//! read. What a file spends on it can be as little as three bytes, or, where `binary_compressed`
//! packs those as tightly as LZF can, 88 times less: such a file takes a thousand
//! times its size.)

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

pub mod atomic;
mod columns;
mod encode;
mod error;
mod format;
mod kitti;
mod lines;
mod lzf;
mod narrow;
mod pcd;
mod ply;
mod raw;
mod read;
mod scalar;
pub mod stream;
mod text;
mod trajectory;
mod transform;
mod write;

pub use error::{Error, Place, Result};
pub use format::{Encoding, Format};
pub use read::{
    CloudFile, NoReturns, ReadOptions, ReadReport, digest, read_bytes, read_cloud, read_cloud_as,
    read_cloud_bytes,
};
pub use stream::{CloudStream, PointStream, StreamedFile};
pub use trajectory::write_trajectory;
pub use transform::{read_transform, read_transform_bytes, write_transform};
pub use write::{WriteOptions, WriteReport, write_cloud, write_cloud_bytes};
