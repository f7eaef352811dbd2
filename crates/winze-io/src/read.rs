//! From files to clouds.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use sha2::{Digest, Sha256};
use winze::Cloud;

use crate::columns::Columns;
use crate::error::{Error, Fault, Result};
use crate::format::{Format, READABLE};
use crate::narrow::{Narrow, Opened, Source};
use crate::raw::Raw;
use crate::{kitti, pcd, ply, text};

/// This many points at exactly (0, 0, 0) are no coincidence.
const NO_RETURNS: usize = 10;

/// What to do with points at exactly (0, 0, 0), which is how many drivers write a beam that came
/// back from nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum NoReturns {
    /// Drop them where there are at least ten: fewer may be real.
    #[default]
    Auto,
    /// They are points like all others.
    Keep,
    /// Drop them all.
    Drop,
}

/// How to read a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadOptions {
    /// What to do with points at exactly (0, 0, 0).
    pub no_returns: NoReturns,
    /// Whether to hash the file's bytes. On processors without SHA instructions that takes several
    /// times as long as reading the points.
    pub digest: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            no_returns: NoReturns::Auto,
            digest: true,
        }
    }
}

/// A cloud and what its file was like.
#[derive(Debug, Clone, PartialEq)]
pub struct CloudFile {
    /// The points, in the file's own frame, metres.
    pub cloud: Cloud,
    /// What was read and what was dropped.
    pub report: ReadReport,
}

/// What a file was like. `points_in_file` is the sum of the cloud's points, `non_finite`,
/// `no_returns` and `far`.
#[derive(Debug, Clone, PartialEq)]
pub struct ReadReport {
    /// The file's format.
    pub format: Format,
    /// The format's own name for how numbers are held, such as `binary_compressed`.
    pub encoding: String,
    /// Points that the file holds.
    pub points_in_file: usize,
    /// Points dropped because a coordinate was NaN or infinite.
    pub non_finite: usize,
    /// Points dropped because they lie at exactly (0, 0, 0), see [`NoReturns`].
    pub no_returns: usize,
    /// Points dropped because they lie hopelessly far from the rest.
    pub far: usize,
    /// Names of all columns of the file, in order.
    pub fields: Vec<String>,
    /// Width and height, where the points form an image.
    pub organised: Option<(usize, usize)>,
    /// PCD's VIEWPOINT as written: `tx ty tz qw qx qy qz`. It is not applied to the points.
    pub viewpoint: Option<[f64; 7]>,
    /// What a user should know about this file, a sentence each.
    pub warnings: Vec<String>,
    /// `sha256:` and the hash of the file's bytes in hex; empty where it was not asked for.
    pub digest: String,
    /// Size of the file.
    pub bytes: u64,
}

impl ReadReport {
    /// Columns that a [`Cloud`] has no place for: all but the coordinates and the intensity.
    #[must_use]
    pub fn unread_fields(&self) -> Vec<&str> {
        let Ok(columns) = Columns::find(&self.fields) else {
            return Vec::new();
        };
        let read: Vec<usize> = columns.xyz.into_iter().chain(columns.intensity).collect();
        self.fields
            .iter()
            .enumerate()
            .filter(|(i, name)| !read.contains(i) && name.as_str() != "_")
            .map(|(_, name)| name.as_str())
            .collect()
    }
}

/// Reads a cloud. The format is the one the file's extension names, else the one its first bytes
/// show.
///
/// An ascii file that was cut within its very last number cannot be told from a whole one, nor can a
/// text file that was cut at the end of a line, unless its first line announces how many points
/// there are. All other truncations are errors.
///
/// # Errors
/// Where the file cannot be read, breaks the rules of its format, is cut short, or where
/// [`Cloud::with_intensity`] refuses its points. A text file without points is an error; a PCD or
/// PLY file that announces none gives an empty cloud.
pub fn read_cloud(path: &Path, options: &ReadOptions) -> Result<CloudFile> {
    if !options.digest
        && let Some(file) = read_narrow(path, options)
    {
        return Ok(file);
    }
    read_cloud_as(path, &read_bytes(path)?, options)
}

/// As [`read_cloud`], without the whole file in memory. `None` where that is not the way for this file, or anything is
/// wrong with it.
fn read_narrow(path: &Path, options: &ReadOptions) -> Option<CloudFile> {
    if !fs::metadata(path).ok()?.is_file() {
        return None;
    }
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    let longest = pcd::Stream::HEAD.max(ply::Stream::HEAD) as u64;
    let mut head = Vec::new();
    file.by_ref().take(longest).read_to_end(&mut head).ok()?;
    let format = Format::from_extension(path).or_else(|| Format::from_content(&head))?;
    decode_narrow(&head, &Opened::new(file, length), format, options)
}

/// All bytes of a file, which may be a pipe.
///
/// # Errors
/// Where it cannot be read.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    if path.is_dir() {
        let file = path.display().to_string();
        return Err(Error::Folder { file });
    }
    fs::read(path).map_err(|cause| Error::io(path, "be read", cause))
}

/// Like [`read_cloud`], where the file's bytes are at hand.
///
/// # Errors
/// As [`read_cloud`].
pub fn read_cloud_as(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<CloudFile> {
    let file = path.display().to_string();
    let shown = Format::from_content(bytes);
    let format = Format::from_extension(path)
        .or(shown)
        .ok_or_else(|| Error::UnknownFormat {
            file: file.clone(),
            known: READABLE,
        })?;
    decode(bytes, format, options).map_err(|fault| named(fault, format, shown).of(&file))
}

/// A fault with a hint, where the content `shown` is not the format that the name says.
pub(crate) fn named(fault: Fault, format: Format, shown: Option<Format>) -> Fault {
    match (fault, shown) {
        (Fault::Malformed(place, problem), Some(shown))
            if shown != format && shown != Format::Text =>
        {
            let extension = shown.to_string().to_ascii_lowercase();
            Fault::Malformed(
                place,
                format!("{problem}; its content looks like {shown}: name it .{extension}"),
            )
        }
        (fault, _) => fault,
    }
}

/// Like [`read_cloud`], from bytes at hand.
///
/// # Errors
/// As [`read_cloud`].
pub fn read_cloud_bytes(bytes: &[u8], format: Format, options: &ReadOptions) -> Result<CloudFile> {
    decode(bytes, format, options).map_err(|fault| fault.of("input"))
}

fn decode(
    bytes: &[u8],
    format: Format,
    options: &ReadOptions,
) -> std::result::Result<CloudFile, Fault> {
    let decoder = || match format {
        Format::Pcd => pcd::decode(bytes),
        Format::Ply => ply::decode(bytes),
        Format::Kitti => kitti::decode(bytes),
        Format::Text => text::decode(bytes),
    };
    let finisher = || match decode_narrow(bytes, &bytes, format, options) {
        Some(file) => Ok(file),
        None => finish(decoder()?, format, options, bytes.len() as u64),
    };
    if !options.digest {
        return finisher();
    }
    let (file, digest) = rayon::join(finisher, || digest(bytes));
    let mut file = file?;
    file.report.digest = digest;
    Ok(file)
}

fn decode_narrow(
    head: &[u8],
    source: &dyn Source,
    format: Format,
    options: &ReadOptions,
) -> Option<CloudFile> {
    let (raw, narrow) = match format {
        Format::Pcd => pcd::decode_narrow(head, source)?,
        Format::Ply => ply::decode_narrow(head, source)?,
        Format::Kitti => kitti::decode_narrow(source)?,
        Format::Text => return None,
    };
    finish_narrow(raw, narrow, format, options, source.length())
}

/// Like [`finish`], of points that already are offsets from the cloud's origin, of which none is far.
fn finish_narrow(
    mut raw: Raw,
    narrow: Narrow,
    format: Format,
    options: &ReadOptions,
    bytes: u64,
) -> Option<CloudFile> {
    let Narrow {
        origin,
        mut points,
        mut intensity,
        zeros,
        broken,
    } = narrow;
    let points_in_file = points.len();
    let drop_zeros = options.no_returns.drops(zeros);
    let no_returns = if drop_zeros { zeros } else { 0 };
    raw.warnings.extend(no_returns_warning(no_returns));
    if broken || drop_zeros {
        let keep =
            |p: &[f32; 3]| p.iter().all(|v| v.is_finite()) && !(drop_zeros && *p == [0.0; 3]);
        let mut kept = points.iter().map(keep);
        if let Some(intensity) = &mut intensity {
            intensity.retain(|_| kept.next().unwrap_or(true));
        }
        points.retain(keep);
    }
    let kept = points.len();
    let mut cloud = Cloud::with_origin(origin, points).ok()?;
    if let Some(intensity) = intensity {
        cloud = cloud.with_intensities(intensity);
    }
    let dropped = (points_in_file - no_returns - kept, 0);
    Some(made(
        cloud,
        raw,
        (format, bytes),
        (points_in_file, no_returns),
        dropped,
    ))
}

fn finish(
    mut raw: Raw,
    format: Format,
    options: &ReadOptions,
    bytes: u64,
) -> std::result::Result<CloudFile, Fault> {
    let points_in_file = raw.points.len();
    let no_returns = drop_no_returns(&mut raw, options.no_returns);
    raw.warnings.extend(no_returns_warning(no_returns));
    let (cloud, dropped) =
        Cloud::with_intensity(&raw.points, raw.intensity.as_deref()).map_err(Fault::Rejected)?;
    raw.warnings.extend(far_warning(dropped.far));
    let dropped = (dropped.non_finite, dropped.far);
    Ok(made(
        cloud,
        raw,
        (format, bytes),
        (points_in_file, no_returns),
        dropped,
    ))
}

/// A cloud with its report: what the file is and its size, how many points it holds and how many of them are no returns, and how
/// many were not finite or too far.
fn made(
    cloud: Cloud,
    raw: Raw,
    (format, bytes): (Format, u64),
    (points_in_file, no_returns): (usize, usize),
    (non_finite, far): (usize, usize),
) -> CloudFile {
    CloudFile {
        cloud: cloud.seen_from(raw.seen_from),
        report: ReadReport {
            format,
            encoding: raw.encoding,
            points_in_file,
            non_finite,
            no_returns,
            far,
            fields: raw.fields,
            organised: raw.organised,
            viewpoint: raw.viewpoint,
            warnings: raw.warnings,
            digest: String::new(),
            bytes,
        },
    }
}

pub(crate) fn no_returns_warning(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "{count} points at exactly (0, 0, 0) were taken for beams without a return and dropped"
        )
    })
}

pub(crate) fn far_warning(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "{count} points lie more than {:.0} km from the rest and were dropped",
            winze::cloud::MAX_OFFSET / 1000.0
        )
    })
}

/// Whether a point may be a beam without a return.
pub(crate) fn is_zero(point: &[f64; 3]) -> bool {
    *point == [0.0; 3]
}

impl NoReturns {
    /// Whether a file's points at exactly (0, 0, 0) are dropped, of which there are so many.
    pub(crate) fn drops(self, zeros: usize) -> bool {
        match self {
            Self::Auto => zeros >= NO_RETURNS,
            Self::Keep => false,
            Self::Drop => zeros > 0,
        }
    }
}

fn drop_no_returns(raw: &mut Raw, rule: NoReturns) -> usize {
    let zeros = raw.points.iter().filter(|p| is_zero(p)).count();
    if !rule.drops(zeros) {
        return 0;
    }
    if let Some(intensity) = &mut raw.intensity {
        let mut points = raw.points.iter();
        intensity.retain(|_| points.next().is_none_or(|p| !is_zero(p)));
    }
    raw.points.retain(|p| !is_zero(p));
    zeros
}

/// A digest of bytes, with the name of its kind.
#[must_use]
pub fn digest(bytes: &[u8]) -> String {
    let mut hash = Sha256::new();
    for part in bytes.chunks(1 << 24) {
        winze::cancel::check();
        hash.update(part);
    }
    digest_text(hash)
}

/// The text of a finished hash.
pub(crate) fn digest_text(hash: Sha256) -> String {
    use std::fmt::Write as _;
    let mut text = String::from("sha256:");
    for byte in hash.finalize() {
        let _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, no_returns: NoReturns) -> CloudFile {
        let options = ReadOptions {
            no_returns,
            ..ReadOptions::default()
        };
        read_cloud_bytes(text.as_bytes(), Format::Text, &options).unwrap()
    }

    #[test]
    fn no_returns_are_dropped_where_they_are_many() {
        let text =
            |zeros: usize| format!("x y z i\n1 2 3 4\n{}5 6 7 8\n", "0 -0 0 9\n".repeat(zeros));
        for (zeros, rule, dropped) in [
            (9, NoReturns::Auto, 0),
            (10, NoReturns::Auto, 10),
            (10, NoReturns::Keep, 0),
            (1, NoReturns::Drop, 1),
            (0, NoReturns::Drop, 0),
        ] {
            let CloudFile { cloud, report } = read(&text(zeros), rule);
            assert_eq!(
                (report.no_returns, report.points_in_file),
                (dropped, zeros + 2)
            );
            assert_eq!(cloud.len(), zeros + 2 - dropped);
            assert_eq!(
                cloud.intensity().map(|i| [i[0], i[cloud.len() - 1]]),
                Some([4.0, 8.0])
            );
            assert_eq!(report.warnings.len(), usize::from(dropped > 0));
        }
    }

    #[test]
    fn all_that_is_dropped_is_counted() {
        let mut text = "1 2 3\n".repeat(500);
        text.push_str("nan 0 0\n1e9 0 0\ninf 1 1\n");
        let CloudFile { cloud, report } = read(&text, NoReturns::Auto);
        assert_eq!((cloud.len(), report.non_finite, report.far), (500, 2, 1));
        assert_eq!(report.points_in_file, 503);
        assert!(report.warnings[0].contains("1 points lie more than 16 km"));
    }

    #[test]
    fn the_digest_is_that_of_the_bytes() {
        let file = read("1 2 3\n", NoReturns::Auto);
        assert_eq!(file.report.bytes, 6);
        assert_eq!(
            file.report.digest,
            "sha256:1def07dbe06eeb097aafec8a40329937cd20c93a83634b8221ea2b41a894310c"
        );
    }

    #[test]
    fn files_are_read_by_extension_then_by_content() {
        let folder = tempfile::tempdir().unwrap();
        let put = |name: &str, content: &[u8]| {
            let path = folder.path().join(name);
            fs::write(&path, content).unwrap();
            read_cloud(&path, &ReadOptions::default())
        };
        let pcd = b"# .PCD\nFIELDS x y z\nWIDTH 1\nSIZE 4 4 4\nTYPE F F F\nDATA ascii\n1 2 3\n";
        assert_eq!(put("a.PCD", pcd).unwrap().report.format, Format::Pcd);
        assert_eq!(put("noname", pcd).unwrap().report.format, Format::Pcd);
        assert_eq!(put("b.dat", b"1 2 3").unwrap().report.format, Format::Text);
        let error = put("c.ply", pcd).unwrap_err().to_string();
        assert!(
            error.contains("c.ply: line 1") && error.ends_with("looks like PCD: name it .pcd"),
            "{error}"
        );
        let error = put("d.laz", b"LASF\0\0").unwrap_err().to_string();
        assert!(
            error.contains("unknown format; known are .pcd, .ply, .bin"),
            "{error}"
        );
        let error = put("e.xyz", b"").unwrap_err().to_string();
        assert!(error.contains("e.xyz: holds no points"), "{error}");
        let error = read_cloud(folder.path(), &ReadOptions::default()).unwrap_err();
        assert!(error.to_string().contains("is a folder"));
        let error =
            read_cloud(&folder.path().join("none.pcd"), &ReadOptions::default()).unwrap_err();
        assert!(error.to_string().contains("no such file"));
        let two_places = "0 0 0\n1e6 0 0\n".repeat(9);
        let error = put("wide.xyz", two_places.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(error.contains("wide.xyz: cloud too wide"), "{error}");
    }
}
