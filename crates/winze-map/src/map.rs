//! A prepared map, opened.

use std::borrow::Cow;
use std::path::Path;

use winze::descriptor_index::DescriptorIndex;
use winze::features::Features;
use winze::fpfh::Descriptor;
use winze::kdtree::{KdTree, Node};
use winze::ndt::{Gaussian, NdtCells};
use winze::prepare::Surface;
use winze::scale::Measure;
use winze::{Config, PreparedMap};

use crate::container::{Container, Entry, Tag};
use crate::error::{Error, Result};
use crate::meta::{LevelMeta, Meta};
use crate::{sections, settings};

/// A prepared map in its file. What it holds is read when it is asked for, and verified then: the
/// checksum of a section, and the structure of what is in it.
#[derive(Debug)]
pub struct Map {
    file: Container,
    meta: Meta,
    voxels: Vec<f64>,
}

impl Map {
    /// Opens a map by mapping its file into memory: in milliseconds, whatever its size.
    ///
    /// Nobody may cut the file short or write to it meanwhile: the process would be killed by the
    /// system, or see other numbers. `winze map build` never does; it puts a new file in the place of the old
    /// one. For drives that may vanish there is [`Map::read`].
    ///
    /// # Errors
    /// Where the file cannot be opened, is no map, is cut short or damaged, or was made by a newer winze.
    pub fn open(path: &Path) -> Result<Self> {
        Self::of(Container::open(path)?)
    }

    /// Opens a map by reading all of its file into memory.
    ///
    /// # Errors
    /// As [`Map::open`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::of(Container::read(path)?)
    }

    /// A map from the bytes of its file; `name` is used in messages.
    ///
    /// # Errors
    /// As [`Map::open`].
    pub fn from_bytes(name: &str, bytes: &[u8]) -> Result<Self> {
        Self::of(Container::from_bytes(name, bytes)?)
    }

    fn of(file: Container) -> Result<Self> {
        let bytes = file.section::<u8>(sections::META, 0)?;
        let malformed = |problem: String| Error::Malformed {
            file: file.file().to_owned(),
            place: "section META 0".to_owned(),
            problem,
        };
        let meta = Meta::read(bytes, file.length()).map_err(malformed)?;
        check(&meta).map_err(malformed)?;
        let voxels = meta.levels.iter().map(|l| l.voxel).collect();
        Ok(Self { file, meta, voxels })
    }

    /// What it is and what it was made of.
    #[must_use]
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// The sections of its file.
    pub fn sections(&self) -> impl ExactSizeIterator<Item = Entry> + '_ {
        self.file.entries()
    }

    /// Sections that this winze does not know and passes over.
    pub fn unknown_sections(&self) -> impl Iterator<Item = Entry> + '_ {
        self.file.unknown(sections::KNOWN)
    }

    /// `sha256:` and the hash of what it tells of itself, which names its sources' digests and its settings.
    #[must_use]
    pub fn digest(&self) -> String {
        let bytes = self.file.section::<u8>(sections::META, 0);
        winze_io::digest(bytes.unwrap_or_default())
    }

    /// Size of its file, bytes.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.file.length()
    }

    /// `config` with the settings that shaped this map in the place of its own.
    ///
    /// # Errors
    /// Where those settings cannot be read back.
    pub fn adopt(&self, config: &Config) -> Result<Config> {
        Ok(settings::adopted(&self.meta.settings, config, false)?)
    }

    /// The same, but for settings that are not their default in `config`: somebody asked for those.
    ///
    /// # Errors
    /// As [`Map::adopt`].
    pub fn adopt_defaults(&self, config: &Config) -> Result<Config> {
        Ok(settings::adopted(&self.meta.settings, config, true)?)
    }

    /// Verifies all there is: every byte against its checksum, every structure. `progress` is told of bytes
    /// done, of all.
    ///
    /// # Errors
    /// For the first thing that is wrong.
    pub fn check(&self, progress: &mut dyn FnMut(u64, u64)) -> Result<()> {
        self.file.verify_all(progress)?;
        for level in 0..self.meta.levels.len() {
            self.level_surface(level)?;
            self.level_features(level)?;
            self.level_cells(level)?;
        }
        Ok(())
    }

    fn level(&self, level: usize) -> Result<(u32, &LevelMeta)> {
        let number = u32::try_from(level).ok();
        number.zip(self.meta.levels.get(level)).ok_or_else(|| {
            let problem = format!("has no level {level}");
            self.malformed("section META 0", problem)
        })
    }

    fn malformed(&self, place: impl Into<String>, problem: impl Into<String>) -> Error {
        Error::Malformed {
            file: self.file.file().to_owned(),
            place: place.into(),
            problem: problem.into(),
        }
    }

    /// A section of as many elements as the map tells of.
    fn column<T>(&self, tag: Tag, number: u32, count: u64) -> Result<&[T]>
    where
        T: zerocopy::FromBytes + zerocopy::Immutable + zerocopy::KnownLayout,
    {
        let column = self.file.section::<T>(tag, number)?;
        if column.len() as u64 == count {
            return Ok(column);
        }
        let place = format!("section {} {number}", tag.escape_ascii());
        let problem = format!("has {} elements instead of {count}", column.len());
        Err(self.malformed(place, problem))
    }

    fn level_surface(&self, level: usize) -> Result<Surface<'_>> {
        let (number, meta) = self.level(level)?;
        let points = self.column::<[f32; 3]>(sections::POINTS, number, meta.points)?;
        let normals = self.column::<[f32; 3]>(sections::NORMALS, number, meta.points)?;
        let nodes = self.file.section::<Node>(sections::NODES, number)?;
        let [x, y, z] = sections::AXES;
        let axes = [
            self.column::<f32>(x, number, meta.points)?,
            self.column::<f32>(y, number, meta.points)?,
            self.column::<f32>(z, number, meta.points)?,
        ];
        if !all_finite(points.as_flattened()) || !all_finite(normals.as_flattened()) {
            let place = format!("level {level}");
            return Err(self.malformed(place, "holds numbers that are not finite"));
        }
        let tree = KdTree::from_parts(nodes, axes).ok_or_else(|| {
            self.malformed(
                format!("section NODE {number}"),
                "is no tree over the points",
            )
        })?;
        Ok(Surface {
            origin: self.meta.origin,
            voxel: meta.voxel,
            points: Cow::Borrowed(points),
            normals: Cow::Borrowed(normals),
            tree,
        })
    }

    fn level_features(&self, level: usize) -> Result<(Features<'_>, DescriptorIndex<'_>)> {
        let (number, meta) = self.level(level)?;
        let points = self.column::<[f32; 3]>(sections::KEYPOINTS, number, meta.keypoints)?;
        let descriptors =
            self.column::<Descriptor>(sections::DESCRIPTORS, number, meta.keypoints)?;
        if !all_finite(points.as_flattened()) || !all_finite(descriptors.as_flattened()) {
            let place = format!("features of level {level}");
            return Err(self.malformed(place, "hold numbers that are not finite"));
        }
        let index = DescriptorIndex::from_parts(
            Cow::Borrowed(self.file.section(sections::INDEX_FRAME, number)?),
            Cow::Borrowed(self.file.section(sections::INDEX_NODES, number)?),
            Cow::Borrowed(self.file.section(sections::INDEX_BLOCKS, number)?),
            Cow::Borrowed(self.file.section(sections::INDEX_ORDER, number)?),
            descriptors.len(),
        )
        .ok_or_else(|| {
            let place = format!("section IDXO {number}");
            self.malformed(place, "is no index over the descriptors")
        })?;
        let features = Features {
            origin: self.meta.origin,
            points: Cow::Borrowed(points),
            descriptors: Cow::Borrowed(descriptors),
            qualified: usize::try_from(meta.qualified).unwrap_or(usize::MAX),
        };
        Ok((features, index))
    }

    fn level_cells(&self, level: usize) -> Result<Vec<NdtCells<'_>>> {
        let (number, meta) = self.level(level)?;
        let sizes = meta.ndt_sizes.iter().zip(&meta.ndt_cells).enumerate();
        sizes
            .map(|(i, (size, count))| {
                let number = sections::resolution(number, i);
                let gaussians = self.column::<Gaussian>(sections::GAUSSIANS, number, *count)?;
                let places = self.column::<[i32; 3]>(sections::CELLS, number, *count)?;
                let table = self.file.section::<u32>(sections::TABLE, number)?;
                let finite = gaussians.as_flattened().iter().all(|v| v.is_finite());
                NdtCells::from_parts(*size, gaussians, places, table)
                    .filter(|_| finite)
                    .ok_or_else(|| {
                        let place = format!("section GTAB {number}");
                        self.malformed(place, "is no table of the cells")
                    })
            })
            .collect()
    }
}

impl PreparedMap for Map {
    fn points(&self) -> usize {
        usize::try_from(self.meta.points).unwrap_or(usize::MAX)
    }

    fn measure(&self) -> Measure {
        self.meta.measure.into()
    }

    fn voxels(&self) -> &[f64] {
        &self.voxels
    }

    fn agrees(&self, config: &Config) -> winze::Result<()> {
        settings::agree(&self.meta.settings, config)
    }

    fn surface(&self, level: usize) -> winze::Result<Surface<'_>> {
        self.level_surface(level).map_err(into_core)
    }

    fn features(&self, level: usize) -> winze::Result<(Features<'_>, DescriptorIndex<'_>)> {
        self.level_features(level).map_err(into_core)
    }

    fn cells(&self, level: usize) -> winze::Result<Vec<NdtCells<'_>>> {
        self.level_cells(level).map_err(into_core)
    }
}

fn into_core(error: Error) -> winze::Error {
    winze::Error::Map(error.to_string())
}

fn all_finite(values: &[f32]) -> bool {
    values.iter().all(|v| v.is_finite())
}

/// What is written must make sense before anything is worked out by it.
fn check(meta: &Meta) -> std::result::Result<(), String> {
    let finite = |v: &[f64]| v.iter().all(|v| v.is_finite());
    let positive = |v: f64| v > 0.0 && v < 1e6;
    if !finite(&meta.origin) || !finite(meta.bounds.as_flattened()) {
        return Err("the origin or the bounds are not finite".into());
    }
    let measure = &meta.measure;
    if !positive(measure.spacing)
        || !positive(measure.budget)
        || measure.width.is_some_and(|w| !positive(w))
        || measure
            .width_range
            .is_some_and(|r| !r.iter().all(|w| positive(*w)))
    {
        return Err("what was measured is no length".into());
    }
    if meta.levels.is_empty() || meta.levels.len() > 16 {
        return Err(format!("tells of {} levels", meta.levels.len()));
    }
    for (i, level) in meta.levels.iter().enumerate() {
        let ascending = i
            .checked_sub(1)
            .and_then(|before| meta.levels.get(before))
            .is_none_or(|before| before.voxel < level.voxel);
        if !positive(level.voxel)
            || !ascending
            || level.ndt_sizes.len() != level.ndt_cells.len()
            || level.ndt_sizes.len() > 64
            || !level.ndt_sizes.iter().all(|s| positive(*s))
        {
            return Err(format!("level {i} makes no sense"));
        }
    }
    Ok(())
}
