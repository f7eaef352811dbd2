//! Which format a file has.

use std::fmt;
use std::path::Path;

use crate::error::{Error, Result};

/// A family of point cloud files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// Point Cloud Data, the format of the Point Cloud Library.
    Pcd,
    /// Polygon File Format; its faces are ignored.
    Ply,
    /// KITTI's Velodyne files: x, y, z and reflectance of each point as 32-bit floats, `.bin`.
    Kitti,
    /// One point a line: `.xyz`, `.txt`, `.csv`, `.asc`, `.pts`.
    Text,
}

/// How a file holds its numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// Decimal digits.
    Ascii,
    /// Little endian bytes.
    Binary,
    /// Little endian bytes, compressed (PCD's `binary_compressed`).
    Compressed,
}

/// Extensions that are read without a look at the content.
pub(crate) const READABLE: &str = ".pcd, .ply, .bin, .xyz, .txt, .csv, .asc, .pts";

/// Extensions that can be written.
const WRITABLE: &str = ".pcd, .ply, .bin, .xyz, .txt, .csv, .asc";

impl Format {
    /// The format that a file's extension names, in capitals or not.
    #[must_use]
    pub fn from_extension(path: &Path) -> Option<Self> {
        match extension(path)?.as_str() {
            "pcd" => Some(Self::Pcd),
            "ply" => Some(Self::Ply),
            "bin" => Some(Self::Kitti),
            "xyz" | "txt" | "csv" | "asc" | "pts" => Some(Self::Text),
            _ => None,
        }
    }

    /// The format that [`write_cloud`](crate::write_cloud) would write to `path`. For a look before
    /// the work whose outcome is to be written.
    ///
    /// # Errors
    /// Where the extension names no format that can be written. `.pts` is one: it promises colours
    /// or intensities by position, so it is read but not written.
    pub fn for_writing(path: &Path) -> Result<Self> {
        Self::from_extension(path)
            .filter(|_| extension(path).is_some_and(|e| e != "pts"))
            .ok_or_else(|| Error::UnknownFormat {
                file: path.display().to_string(),
                known: WRITABLE,
            })
    }

    /// The format that the first bytes show. `None` for binary data of another kind.
    #[must_use]
    pub fn from_content(bytes: &[u8]) -> Option<Self> {
        let head = bytes.get(..1024).unwrap_or(bytes);
        let text = head.trim_ascii_start();
        if head.starts_with(b"ply\n") || head.starts_with(b"ply\r\n") {
            Some(Self::Ply)
        } else if [&b"# .PCD"[..], b"VERSION", b"FIELDS"]
            .iter()
            .any(|magic| text.starts_with(magic))
        {
            Some(Self::Pcd)
        } else if head.contains(&0) {
            None
        } else {
            Some(Self::Text)
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pcd => "PCD",
            Self::Ply => "PLY",
            Self::Kitti => "KITTI",
            Self::Text => "text",
        })
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ascii => "ascii",
            Self::Binary => "binary",
            Self::Compressed => "compressed",
        })
    }
}

impl std::str::FromStr for Encoding {
    type Err = String;

    /// By its name, as it is displayed.
    fn from_str(name: &str) -> std::result::Result<Self, String> {
        match name {
            "ascii" => Ok(Self::Ascii),
            "binary" => Ok(Self::Binary),
            "compressed" => Ok(Self::Compressed),
            _ => Err("choose one of ascii, binary, compressed".into()),
        }
    }
}

/// A file's extension in lower case, without the dot.
pub(crate) fn extension(path: &Path) -> Option<String> {
    Some(path.extension()?.to_str()?.to_ascii_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extensions_are_known_in_any_case() {
        assert_eq!(
            Format::from_extension(Path::new("a/b.PCD")),
            Some(Format::Pcd)
        );
        assert_eq!(
            Format::from_extension(Path::new("b.Ply")),
            Some(Format::Ply)
        );
        assert_eq!(
            Format::from_extension(Path::new("b.pts")),
            Some(Format::Text)
        );
        assert_eq!(Format::from_extension(Path::new("b.laz")), None);
        assert_eq!(Format::from_extension(Path::new("pcd")), None);
    }

    #[test]
    fn not_all_that_is_read_can_be_written() {
        for (name, expected) in [
            ("a/b.PCD", Format::Pcd),
            ("b.ply", Format::Ply),
            ("b.bin", Format::Kitti),
            ("b.csv", Format::Text),
            ("b.asc", Format::Text),
        ] {
            assert_eq!(Format::for_writing(Path::new(name)).unwrap(), expected);
        }
        for name in ["b.pts", "b.PTS", "b.las", "b", "pcd", ""] {
            let error = Format::for_writing(Path::new(name)).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!(
                    "{name}: unknown format; known are .pcd, .ply, .bin, .xyz, .txt, .csv, .asc"
                )
            );
        }
    }

    #[test]
    fn content_tells_the_format() {
        assert_eq!(Format::from_content(b"ply\r\nformat"), Some(Format::Ply));
        assert_eq!(Format::from_content(b"# .PCD v0.7"), Some(Format::Pcd));
        assert_eq!(Format::from_content(b"VERSION .7\n"), Some(Format::Pcd));
        assert_eq!(Format::from_content(b"1 2 3\n"), Some(Format::Text));
        assert_eq!(Format::from_content(b"\x7fELF\0\0"), None);
    }
}
