//! From clouds to a map's file, in bounded memory.
//!
//! ```text
//! clouds ─survey─> spacing ─base─> base points ─measure─> levels ─each: thin, clean, normals,
//!                                                          keypoints, descriptors, Gaussians─> file
//! ```
//!
//! Points are read in a stream, several times over. What grows with the map lies in scratch files that are
//! mapped ([`Scratch`](crate::Scratch)); work goes through them chunk by chunk, in an order in which neighbours in
//! space are neighbours in the file. Nothing that is worked out depends on the size of a chunk.

mod base;
mod level;
mod noise;
mod progress;

use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use winze::prepare::Frame;
use winze::scale::{self, Measure};
use winze::{Config, Error as CoreError};
use winze_io::{PointStream, ReadOptions};

pub use progress::Progress;

use crate::container::{self, ContainerWriter};
use crate::error::{Error, Result};
use crate::meta::{Meta, SourceMeta};
use crate::scratch::Scratch;
use crate::{sections, settings};
use base::Base;
use progress::Plan;

/// Bytes of the name of a coordinate reference system.
const LONGEST_CRS: usize = 8192;
/// Points that a map must have.
const MIN_POINTS: u64 = 100;

/// How to build a map.
#[derive(Clone, Copy)]
pub struct BuildOptions<'a> {
    /// Memory to work in, bytes: it sets how many points are taken at a time. What grows with the map lies in scratch
    /// files whatever this is. The map does not depend on it.
    pub memory: u64,
    /// Replace a file that is there already.
    pub replace: bool,
    /// The coordinate reference system of the clouds, such as `EPSG:32633`.
    pub crs: Option<&'a str>,
    /// Where scratch files go; the map's own folder where there is none.
    pub scratch: Option<&'a Path>,
    /// How to read the clouds.
    pub read: ReadOptions,
    /// Who wants to follow.
    pub progress: Option<&'a (dyn Fn(&Progress<'_>) + Sync)>,
}

impl Default for BuildOptions<'_> {
    /// A gigabyte, and nothing is replaced.
    fn default() -> Self {
        Self {
            memory: 1 << 30,
            replace: false,
            crs: None,
            scratch: None,
            read: ReadOptions::default(),
            progress: None,
        }
    }
}

/// Builds a map of all points of `clouds` taken together, which share one frame, and writes it to `out`.
///
/// The file is written under another name beside `out`, synced, and renamed: whenever this ends, `out` is
/// what it was or the whole new map. The same files (their names and dates are told in the map) and settings give the
/// same bytes, at any number of threads and whatever the memory.
///
/// # Errors
/// Where a cloud cannot be read, holds too little to make a map of, or the file cannot be written;
/// [`Error::Exists`] where it is there and is not to be replaced.
pub fn build(
    clouds: &[PathBuf],
    out: &Path,
    config: &Config,
    options: &BuildOptions<'_>,
) -> Result<Meta> {
    config.validate()?;
    if config.prepare.denoise_first {
        return Err(CoreError::Config {
            key: "prepare.denoise_first".into(),
            value: "true".into(),
            rule: "a map's clouds are thinned as they are read; leave it false".into(),
        }
        .into());
    }
    refuse_existing(out, options)?;
    let crs = options.crs.map_or(0, str::len);
    if crs > LONGEST_CRS {
        return Err(CoreError::Map(format!(
            "a CRS of {crs} bytes is too long; name it, such as EPSG:32633, instead of describing it"
        ))
        .into());
    }
    let folder = match (options.scratch, out.parent()) {
        (Some(folder), _) => folder,
        (None, Some(parent)) if !parent.as_os_str().is_empty() => parent,
        (None, _) => Path::new("."),
    };
    // Found out now rather than after the clouds were read.
    if options.scratch.is_some()
        && let Err(cause) = std::fs::read_dir(folder)
    {
        return Err(Error::Scratch {
            folder: folder.display().to_string(),
            bytes: 0,
            cause,
        });
    }
    let work = Work {
        config,
        options,
        scratch: Scratch::new(folder),
        plan: Plan::new(options.progress),
    };
    winze_io::atomic::remove_abandoned(out);
    let mut made = None;
    container::write(out, |file| {
        made = Some(work.run(clouds, file)?);
        // Somebody else may have put a file there meanwhile.
        refuse_existing(out, options)?;
        Ok(())
    })?;
    made.ok_or_else(|| CoreError::Map("nothing was written".into()).into())
}

fn refuse_existing(out: &Path, options: &BuildOptions<'_>) -> Result<()> {
    if out.exists() && !options.replace {
        return Err(Error::Exists {
            file: out.display().to_string(),
        });
    }
    Ok(())
}

/// What all steps share.
struct Work<'a> {
    config: &'a Config,
    options: &'a BuildOptions<'a>,
    scratch: Scratch,
    plan: Plan<'a>,
}

impl Work<'_> {
    fn run(&self, clouds: &[PathBuf], file: &mut ContainerWriter<'_>) -> Result<Meta> {
        let points = self.plan.open(clouds, &self.options.read)?;
        if points.len() < MIN_POINTS {
            return Err(too_few(clouds, points.len()));
        }
        let spacing = self.spacing(&points, clouds)?;
        let asked = self.config.scale.voxel;
        let voxel = if asked > 0.0 {
            asked
        } else {
            scale::base_voxel(spacing)
        };
        let base = self.base(&points, voxel)?;
        let frame = Frame {
            origin: points.origin(),
            viewpoint: points.viewpoint(),
        };
        let measure = self.measure((&base, voxel), frame, spacing)?;
        let voxels = if asked > 0.0 {
            vec![asked]
        } else {
            scale::levels(&measure)
        };
        let bounds = base.bounds(frame.origin, 0.0, &self.scratch)?;
        let robust_bounds = base.bounds(frame.origin, 0.001, &self.scratch)?;
        self.check_size(
            clouds,
            robust_bounds,
            voxels.first().copied().unwrap_or(voxel),
        )?;
        let noise_patch = noise::PATCH * voxel;
        // Centroids of wide cells say nothing of how thick walls are.
        let fine = voxel <= scale::base_voxel(spacing);
        let noise_floor = fine
            .then(|| noise::floor(&base.points, noise_patch))
            .flatten();
        self.plan.levels(base.points.len(), voxel, &voxels);
        let mut levels = Vec::new();
        for (number, voxel) in (0u32..).zip(&voxels) {
            let level = self.level(&base, frame, number, *voxel, file)?;
            if number == 0 && level.points < MIN_POINTS {
                return Err(too_few(clouds, level.points));
            }
            levels.push(level);
        }
        let meta = Meta {
            winze: env!("CARGO_PKG_VERSION").to_owned(),
            points: points.len(),
            origin: frame.origin,
            crs: self.options.crs.map(str::to_owned),
            bounds,
            robust_bounds,
            measure: measure.into(),
            noise_floor,
            noise_patch,
            base_voxel: voxel,
            base_points: base.points.len() as u64,
            levels,
            sources: sources(&points),
            settings: settings::shaping(self.config).into_iter().collect(),
            config_digest: settings::digest(self.config),
        };
        let text = meta.write(file.length())?;
        write(file.section(sections::META, 0, &text))?;
        self.plan.finish();
        Ok(meta)
    }

    fn measure(&self, (base, voxel): (&Base, f64), frame: Frame, spacing: f64) -> Result<Measure> {
        self.plan.step("measure", 0.0);
        let points = (&base.points[..], voxel);
        scale::measure_base(points, frame.origin, spacing, &self.scratch)
    }

    /// # Errors
    /// For a cloud smaller than what a descriptor describes.
    fn check_size(&self, clouds: &[PathBuf], bounds: [[f64; 3]; 2], finest: f64) -> Result<()> {
        let [low, high] = bounds;
        let size = (0..3)
            .filter_map(|a| Some(high.get(a)? - low.get(a)?))
            .fold(0.0, f64::max);
        let radius = self.config.fpfh.radius.metres(finest);
        if size >= radius {
            return Ok(());
        }
        Err(Error::TooSmall {
            file: named(clouds),
            size,
            radius,
        })
    }
}

/// An error of a writer in the words of this crate.
fn write(result: std::io::Result<()>) -> Result<()> {
    result.map_err(Error::Write)
}

fn named(clouds: &[PathBuf]) -> String {
    let names: Vec<String> = clouds.iter().map(|c| c.display().to_string()).collect();
    names.join(", ")
}

fn too_few(clouds: &[PathBuf], points: u64) -> Error {
    Error::TooFew {
        file: named(clouds),
        points,
        least: MIN_POINTS,
    }
}

fn sources(points: &PointStream) -> Vec<SourceMeta> {
    let files = points.files().iter();
    files
        .map(|file| {
            let r = &file.report;
            let modified = std::fs::metadata(&file.path)
                .and_then(|m| m.modified())
                .ok()
                .and_then(|t| t.duration_since(UNIX_EPOCH).ok());
            SourceMeta {
                name: file
                    .path
                    .file_name()
                    .map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
                digest: r.digest.clone(),
                bytes: r.bytes,
                format: format!("{} {}", r.format, r.encoding),
                points: r.points_in_file as u64,
                dropped: [r.non_finite, r.no_returns, r.far].map(|n| n as u64),
                modified: modified.map(|d| d.as_secs()),
            }
        })
        .collect()
}
