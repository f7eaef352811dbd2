//! Files as one cloud, as a stream.

use std::io::Read;
use std::path::PathBuf;
use std::thread;

use sha2::{Digest, Sha256};
use winze::cloud;

use super::{CloudStream, Sink, Told};
use crate::error::{Error, Fault, Result};
use crate::read::{ReadOptions, ReadReport, digest_text, far_warning, is_zero, no_returns_warning};

/// Bytes that are hashed at a time.
const HASHED: usize = 1 << 18;

/// Points of a file that are surveyed at a time.
const SURVEYED: usize = 1 << 16;

/// The most passes that opening takes.
const PASSES: u64 = 3;

/// One file of a [`PointStream`].
#[derive(Debug, Clone, PartialEq)]
pub struct StreamedFile {
    /// The file, as given.
    pub path: PathBuf,
    /// What was read and what is dropped, as [`read_cloud`](crate::read_cloud) says it; but `far` is
    /// counted from the origin of all files together.
    pub report: ReadReport,
}

/// One or more files as one cloud, in order.
///
/// Its points are exactly those of the [`Cloud`](winze::Cloud) that
/// [`read_cloud`](crate::read_cloud) makes of a single file. Several files are as one that holds the
/// points of all, save that points at exactly (0, 0, 0) are judged file by file. There may be more of
/// them than a `Cloud` can hold.
#[derive(Debug)]
pub struct PointStream {
    streams: Vec<CloudStream>,
    files: Vec<StreamedFile>,
    origin: [f64; 3],
    len: u64,
}

/// What the first pass finds in a file.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Survey {
    points: u64,
    non_finite: u64,
    zeros: u64,
    small: bool,
    /// Corners of the finite points.
    low: [f64; 3],
    high: [f64; 3],
}

impl Survey {
    const EMPTY: Self = Self {
        points: 0,
        non_finite: 0,
        zeros: 0,
        small: true,
        low: [f64::INFINITY; 3],
        high: [f64::NEG_INFINITY; 3],
    };

    fn add(&mut self, points: &[[f64; 3]]) {
        self.points += points.len() as u64;
        for p in points {
            if !is_finite(p) {
                self.non_finite += 1;
                continue;
            }
            self.zeros += u64::from(is_zero(p));
            self.small &= cloud::is_small(p);
            for ((low, high), v) in self.low.iter_mut().zip(&mut self.high).zip(p) {
                *low = low.min(*v);
                *high = high.max(*v);
            }
        }
    }

    /// Whether points may lie too far from `origin`.
    fn reaches_far(&self, origin: [f64; 3]) -> bool {
        let beyond = |corner: [f64; 3]| cloud::offset(corner, origin).is_none();
        self.points > self.non_finite && (beyond(self.low) || beyond(self.high))
    }
}

fn is_finite(p: &[f64; 3]) -> bool {
    p.iter().all(|v| v.is_finite())
}

/// The finite points of some that are no beams without a return.
struct Kept<'a> {
    points: std::slice::Iter<'a, [f64; 3]>,
    zeros_stay: bool,
}

impl<'a> Iterator for Kept<'a> {
    type Item = &'a [f64; 3];

    fn next(&mut self) -> Option<Self::Item> {
        let zeros_stay = self.zeros_stay;
        self.points
            .find(|p| is_finite(p) && (zeros_stay || !is_zero(p)))
    }
}

/// Tells how far opening has come.
struct Progress<'a> {
    told: &'a mut dyn FnMut(u64, u64),
    /// Bytes of all files, and of those files of this pass that are done.
    all: u64,
    done: u64,
    pass: u64,
}

impl Progress<'_> {
    fn at(&mut self, byte: u64) {
        let done = (self.done + byte).min(self.all);
        (self.told)(self.pass * self.all + done, PASSES * self.all);
    }

    /// This many passes are done or turned out not to be needed.
    fn passed(&mut self, passes: u64) {
        (self.pass, self.done) = (passes, 0);
        self.at(0);
    }
}

impl PointStream {
    /// Opens files and goes through them once to count and, where `options` ask for it, to hash
    /// them; once more where the origin is not (0, 0, 0) at once; and again where points may lie
    /// too far from it. `progress` hears of the bytes done, of all passes together; a pass that is
    /// not needed counts as done.
    ///
    /// # Errors
    /// As [`read_cloud`](crate::read_cloud), except that no number of points is too large.
    /// [`Error::Changed`] where a file changes meanwhile.
    pub fn open(
        paths: &[PathBuf],
        options: &ReadOptions,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<Self> {
        let streams = paths
            .iter()
            .map(|path| CloudStream::open(path))
            .collect::<Result<Vec<_>>>()?;
        let mut progress = Progress {
            told: progress,
            all: streams.iter().map(CloudStream::bytes).sum(),
            done: 0,
            pass: 0,
        };
        let mut surveys = Vec::with_capacity(streams.len());
        let mut files = Vec::with_capacity(streams.len());
        for stream in &streams {
            let (survey, told, digest) = first_pass(stream, options.digest, &mut progress)?;
            progress.done += stream.bytes();
            let zeros = fits(survey.zeros);
            let drops = options.no_returns.drops(zeros);
            files.push(report(stream, &survey, told, digest, drops));
            surveys.push(survey);
        }
        let mut all = Self {
            streams,
            files,
            origin: [0.0; 3],
            len: 0,
        };
        progress.passed(1);
        all.len = all.finite();
        if !surveys.iter().all(|survey| survey.small) {
            all.origin = all.find_origin(&mut progress)?;
        }
        progress.passed(2);
        if surveys.iter().any(|survey| survey.reaches_far(all.origin)) {
            all.drop_far(&mut progress)?;
        }
        progress.passed(PASSES);
        Ok(all)
    }

    /// What all offsets count from.
    #[must_use]
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// How many points there are, without those that are dropped.
    #[must_use]
    pub fn len(&self) -> u64 {
        self.len
    }

    /// No points at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Where the sensor stood, where the only file really says so.
    #[must_use]
    pub fn viewpoint(&self) -> Option<[f64; 3]> {
        match self.streams.as_slice() {
            [stream] => stream.seen_from(),
            _ => None,
        }
    }

    /// What each file was like.
    #[must_use]
    pub fn files(&self) -> &[StreamedFile] {
        &self.files
    }

    /// All points as offsets from the origin, in order, `chunk` at a time; the last time there may
    /// be fewer.
    ///
    /// # Errors
    /// [`Error::Changed`] where a file is no longer the one that was opened, any other that reading
    /// it gives, and any error of `each`, which ends the reading.
    pub fn for_each(
        &self,
        chunk: usize,
        each: &mut dyn FnMut(&[[f32; 3]]) -> Result<()>,
    ) -> Result<()> {
        let chunk = chunk.max(1);
        let mut ready: Vec<[f32; 3]> = Vec::new();
        let mut put =
            |offsets: &[[f32; 3]]| each(offsets).map_err(|error| Fault::Passed(Box::new(error)));
        for (stream, file) in self.streams.iter().zip(&self.files) {
            let expected = file.report.points_in_file - dropped(&file.report);
            let mut given = 0;
            self.pass(stream, file, |points, _| {
                for p in points {
                    let Some(offset) = cloud::offset(*p, self.origin) else {
                        continue;
                    };
                    // Never more than was said, not even before the file's end shows that it changed.
                    if given == expected {
                        return Err(Fault::Changed);
                    }
                    given += 1;
                    ready.push(offset);
                    if ready.len() == chunk {
                        put(&ready)?;
                        ready.clear();
                    }
                }
                Ok(())
            })?;
            if given != expected {
                return Err(changed(stream));
            }
        }
        if !ready.is_empty() {
            put(&ready).map_err(|fault| fault.of(""))?;
        }
        Ok(())
    }

    /// Finite points without those taken for beams without a return.
    fn finite(&self) -> u64 {
        let finite = |r: &ReadReport| r.points_in_file - r.non_finite - r.no_returns;
        self.files.iter().map(|f| finite(&f.report) as u64).sum()
    }

    /// Goes through the finite points of one file that are no beams without a return.
    fn pass(
        &self,
        stream: &CloudStream,
        file: &StreamedFile,
        mut each: impl FnMut(Kept<'_>, u64) -> std::result::Result<(), Fault>,
    ) -> Result<()> {
        let zeros_stay = file.report.no_returns == 0;
        let mut put = |points: &[[f64; 3]], at| {
            let kept = Kept {
                points: points.iter(),
                zeros_stay,
            };
            each(kept, at)
        };
        let told = stream.scan(&mut Sink::new(SURVEYED, &mut put))?;
        if told.points != file.report.points_in_file as u64 {
            return Err(changed(stream));
        }
        Ok(())
    }

    /// The second pass: the origin from evenly spaced points of all files.
    fn find_origin(&self, progress: &mut Progress<'_>) -> Result<[f64; 3]> {
        let stride = cloud::origin_stride(self.finite());
        let mut sample = Vec::new();
        let mut next = 0u64;
        let mut seen = 0u64;
        for (stream, file) in self.streams.iter().zip(&self.files) {
            self.pass(stream, file, |points, at| {
                for p in points {
                    if seen == next {
                        sample.push(*p);
                        next += stride;
                    }
                    seen += 1;
                }
                progress.at(at);
                Ok(())
            })?;
            progress.done += stream.bytes();
        }
        Ok(cloud::origin_of(&sample))
    }

    /// The third pass: counts the points that lie too far from the origin.
    fn drop_far(&mut self, progress: &mut Progress<'_>) -> Result<()> {
        let mut counts = Vec::with_capacity(self.files.len());
        for (stream, file) in self.streams.iter().zip(&self.files) {
            let mut far = 0;
            self.pass(stream, file, |points, at| {
                far += points
                    .filter(|p| cloud::offset(**p, self.origin).is_none())
                    .count();
                progress.at(at);
                Ok(())
            })?;
            progress.done += stream.bytes();
            counts.push(far);
        }
        let far = counts.iter().sum();
        cloud::check_far(far, fits(self.finite())).map_err(|cause| {
            let mut file = String::new();
            if let Some(first) = self.streams.first() {
                file = first.path().display().to_string();
            }
            if self.streams.len() > 1 {
                let others = self.streams.len() - 1;
                file.push_str(&format!(" and {others} more"));
            }
            Error::Rejected { file, cause }
        })?;
        self.len -= far as u64;
        for (file, far) in self.files.iter_mut().zip(counts) {
            file.report.far = far;
            file.report.warnings.extend(far_warning(far));
        }
        Ok(())
    }
}

fn changed(stream: &CloudStream) -> Error {
    Fault::Changed.of(&stream.path().display().to_string())
}

fn fits(count: u64) -> usize {
    usize::try_from(count).unwrap_or(usize::MAX)
}

fn dropped(report: &ReadReport) -> usize {
    report.non_finite + report.no_returns + report.far
}

/// Counts a file's points and, beside it, hashes its bytes.
fn first_pass(
    stream: &CloudStream,
    digest: bool,
    progress: &mut Progress<'_>,
) -> Result<(Survey, Told, String)> {
    let mut survey = Survey::EMPTY;
    let mut scan = || {
        let mut put = |points: &[[f64; 3]], at| {
            survey.add(points);
            progress.at(at);
            Ok(())
        };
        stream.scan(&mut Sink::new(SURVEYED, &mut put))
    };
    if !digest {
        let told = scan()?;
        return Ok((survey, told, String::new()));
    }
    let io = |cause| Error::io(stream.path(), "be read", cause);
    let (told, digest) = thread::scope(|scope| {
        // A thread of its own: in rayon's pool the scan's own pieces might wait behind it.
        let hash = thread::Builder::new()
            .spawn_scoped(scope, || hash(stream))
            .map_err(io)?;
        let told = scan();
        let digest = hash
            .join()
            .unwrap_or_else(|_| Err(io(std::io::Error::other("hashing failed"))));
        Ok::<_, Error>((told, digest))
    })?;
    // What is wrong with the points comes first.
    let told = told?;
    Ok((survey, told, digest?))
}

fn hash(stream: &CloudStream) -> Result<String> {
    stream.with_file(|file| {
        let mut hash = Sha256::new();
        let mut bytes = vec![0; HASHED];
        let mut left = stream.bytes();
        while left > 0 {
            let length = fits(left).min(HASHED);
            let part = bytes.get_mut(..length).unwrap_or_default();
            file.read_exact(part)?;
            hash.update(&*part);
            left -= length as u64;
        }
        Ok(digest_text(hash))
    })
}

fn report(
    stream: &CloudStream,
    survey: &Survey,
    told: Told,
    digest: String,
    drops: bool,
) -> StreamedFile {
    let no_returns = if drops { fits(survey.zeros) } else { 0 };
    let mut warnings = told.warnings;
    warnings.extend(no_returns_warning(no_returns));
    StreamedFile {
        path: stream.path().to_owned(),
        report: ReadReport {
            format: stream.format(),
            encoding: stream.encoding(),
            points_in_file: fits(survey.points),
            non_finite: fits(survey.non_finite),
            no_returns,
            far: 0,
            fields: stream.fields(),
            organised: stream.organised(),
            viewpoint: stream.viewpoint(),
            warnings,
            digest,
            bytes: stream.bytes(),
        },
    }
}
