//! A map that was prepared beforehand.

use crate::columns::Columns;
use crate::config::Config;
use crate::descriptor_index::DescriptorIndex;
use crate::error::Result;
use crate::features::Features;
use crate::ndt::NdtCells;
use crate::prepare::{Frame, Surface, SurfaceColumns, prepare_in};
use crate::scale::Measure;
use crate::voxel;

/// Where [`locate_in`](crate::locate::locate_in) finds what was worked out about a map once and kept, such as in
/// a file.
///
/// The finest level comes first. What a level holds is what the same functions make of the map's cloud,
/// to the bit: [`level_in`], [`describe_in`](crate::features::describe_in),
/// [`cells_in`](crate::ndt::cells_in).
pub trait PreparedMap: Sync + std::fmt::Debug {
    /// Points of the cloud that the map was made of.
    fn points(&self) -> usize;

    /// What was measured of it.
    fn measure(&self) -> Measure;

    /// The voxel size of each level, metres.
    fn voxels(&self) -> &[f64];

    /// Whether the map was prepared under the settings of `config`.
    ///
    /// # Errors
    /// [`Error::Config`](crate::Error::Config) that names one of them which it was not.
    fn agrees(&self, config: &Config) -> Result<()>;

    /// The surface at a level.
    ///
    /// # Errors
    /// [`Error::Map`](crate::Error::Map) where the map is damaged, here and below.
    fn surface(&self, level: usize) -> Result<Surface<'_>>;

    /// Keypoints and descriptors at a level, and the index over the descriptors.
    ///
    /// # Errors
    /// As [`PreparedMap::surface`].
    fn features(&self, level: usize) -> Result<(Features<'_>, DescriptorIndex<'_>)>;

    /// The Gaussians of NDT at a level, coarsest first.
    ///
    /// # Errors
    /// As [`PreparedMap::surface`].
    fn cells(&self, level: usize) -> Result<Vec<NdtCells<'_>>>;
}

/// The surface of a map at `voxel` metres, from its [base](crate::base) points and their weights.
///
/// # Errors
/// Where a column cannot be had.
pub fn level_in<C: Columns>(
    (base, weights): (&[[f32; 3]], &[u32]),
    frame: Frame,
    voxel: f64,
    config: &Config,
    columns: &C,
) -> std::result::Result<SurfaceColumns<C>, C::Error> {
    let thinned = voxel::thin(base, Some(weights), frame.origin, voxel, columns)?;
    prepare_in(thinned, frame, &config.prepare, voxel, columns)
}
