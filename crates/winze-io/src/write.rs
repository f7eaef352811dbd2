//! From clouds to files.

use std::io::{self, Write};
use std::path::Path;

use winze::Cloud;

use crate::encode::needs_double;
use crate::error::{Error, Result};
use crate::format::{Encoding, Format, extension};
use crate::{atomic, kitti, pcd, ply, text};

/// How to write a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WriteOptions {
    /// How the numbers are held. `None`: binary for PCD and PLY, ascii for text.
    pub encoding: Option<Encoding>,
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WriteReport {
    /// The file's format.
    pub format: Format,
    /// How the numbers are held.
    pub encoding: Encoding,
    /// Points written.
    pub points: usize,
    /// Size of the file.
    pub bytes: u64,
    /// What the file does not hold, a sentence each.
    pub warnings: Vec<String>,
}

/// Writes a cloud in the format that the extension names; the file appears whole or not at all.
///
/// Binary coordinates are 32-bit floats where no coordinate moves by more than 0.1 mm, else 64-bit
/// floats. Ascii coordinates are exact where the cloud's origin is zero, else rounded to 0.1 mm.
/// KITTI's files hold 32-bit floats alone. Intensities are written where the cloud has them (in KITTI's, 0 where it has none). The viewpoint goes into a PCD file's
/// VIEWPOINT; elsewhere it is lost, as is one at exactly (0, 0, 0), PCD's default: the report's
/// warnings say so.
///
/// # Errors
/// Where the extension names no format that can be written ([`Format::for_writing`] tells that ahead),
/// the format does not know the encoding or cannot hold the coordinates, or the file cannot be written.
pub fn write_cloud(path: &Path, cloud: &Cloud, options: &WriteOptions) -> Result<WriteReport> {
    let format = Format::for_writing(path)?;
    let encoding = encoding(format, cloud, options, &path.display().to_string())?;
    let commas = extension(path).as_deref() == Some("csv");
    let mut bytes = 0;
    atomic::write(path, |w| {
        let mut counter = Counter { inner: w, bytes: 0 };
        encode(&mut counter, cloud, format, encoding, commas)?;
        bytes = counter.bytes;
        Ok(())
    })?;
    Ok(WriteReport {
        format,
        encoding,
        points: cloud.len(),
        bytes,
        warnings: warnings(cloud, format),
    })
}

/// Like [`write_cloud`], to bytes. Text gets blanks between its columns.
///
/// # Errors
/// Where the format does not know the encoding or cannot hold the coordinates, or the cloud is too large for it.
pub fn write_cloud_bytes(cloud: &Cloud, format: Format, options: &WriteOptions) -> Result<Vec<u8>> {
    let encoding = encoding(format, cloud, options, "output")?;
    let mut bytes = Vec::new();
    encode(&mut bytes, cloud, format, encoding, false)
        .map_err(|cause| Error::io(Path::new("output"), "be written", cause))?;
    Ok(bytes)
}

fn encoding(format: Format, cloud: &Cloud, options: &WriteOptions, file: &str) -> Result<Encoding> {
    let refused = |problem: String| Error::Encoding {
        file: file.to_owned(),
        problem,
    };
    let (default, others): (_, &[Encoding]) = match format {
        Format::Pcd => (Encoding::Binary, &[Encoding::Ascii, Encoding::Compressed]),
        Format::Ply => (Encoding::Binary, &[Encoding::Ascii]),
        Format::Kitti => (Encoding::Binary, &[]),
        Format::Text => (Encoding::Ascii, &[]),
    };
    let wanted = options.encoding.unwrap_or(default);
    if wanted == default || others.contains(&wanted) {
        if format == Format::Kitti && needs_double(cloud) {
            return Err(refused(
                "the coordinates do not fit KITTI's 32-bit floats to 0.1 mm; write .pcd or .ply, \
                 or move the cloud towards the origin first"
                    .into(),
            ));
        }
        return Ok(wanted);
    }
    let mut known = default.to_string();
    for other in others {
        known.push_str(" or ");
        known.push_str(&other.to_string());
    }
    Err(refused(format!(
        "{format} cannot be written {wanted}; choose {known}"
    )))
}

fn encode(
    w: &mut dyn Write,
    cloud: &Cloud,
    format: Format,
    encoding: Encoding,
    commas: bool,
) -> io::Result<()> {
    match format {
        Format::Pcd => pcd::write(w, cloud, encoding),
        Format::Ply => ply::write(w, cloud, encoding == Encoding::Ascii),
        Format::Kitti => kitti::write(w, cloud),
        Format::Text => text::write(w, cloud, commas),
    }
}

fn warnings(cloud: &Cloud, format: Format) -> Vec<String> {
    let lost = match (cloud.viewpoint(), format) {
        (None, _) => None,
        (Some(v), Format::Pcd) if v != [0.0; 3] => None,
        (Some(_), Format::Pcd) => {
            Some("the sensor's place is the origin, which PCD cannot tell from its default".into())
        }
        (Some(_), _) => Some(format!(
            "the sensor's place is not kept: {format} has no room for it"
        )),
    };
    lost.into_iter().collect()
}

struct Counter<'a> {
    inner: &'a mut dyn Write,
    bytes: u64,
}

impl Write for Counter<'_> {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let written = self.inner.write(data)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_names_and_encodings_list_what_would_do() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, encoding| {
            let options = WriteOptions { encoding };
            write_cloud(&folder.path().join(name), &Cloud::default(), &options)
        };
        for name in ["a.las", "a", "a.pts"] {
            let error = write(name, None).unwrap_err().to_string();
            assert!(
                error.ends_with("known are .pcd, .ply, .bin, .xyz, .txt, .csv, .asc"),
                "{error}"
            );
        }
        let error = write("a.ply", Some(Encoding::Compressed))
            .unwrap_err()
            .to_string();
        assert!(
            error.ends_with("PLY cannot be written compressed; choose binary or ascii"),
            "{error}"
        );
        assert!(write("a.xyz", Some(Encoding::Binary)).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn the_report_counts_bytes_and_tells_what_is_lost() {
        let folder = tempfile::tempdir().unwrap();
        let (cloud, _) = Cloud::with_intensity(&[[1.0, 2.0, 3.0]], Some(&[0.5])).unwrap();
        for (name, viewpoint, warnings) in [
            ("a.pcd", None, 0),
            ("a.pcd", Some([1.0, 0.0, 0.0]), 0),
            ("a.pcd", Some([0.0; 3]), 1),
            ("a.ply", Some([1.0, 0.0, 0.0]), 1),
            ("a.csv", None, 0),
        ] {
            let path = folder.path().join(name);
            let cloud = cloud.clone().seen_from(viewpoint);
            let report = write_cloud(&path, &cloud, &WriteOptions::default()).unwrap();
            assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
            assert_eq!(
                (report.points, report.warnings.len()),
                (1, warnings),
                "{name}"
            );
        }
        let text = std::fs::read_to_string(folder.path().join("a.csv")).unwrap();
        assert_eq!(text, "x,y,z,intensity\n1,2,3,0.5\n");
    }
}
