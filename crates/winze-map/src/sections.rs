//! The sections of a map, see `docs/map-format.md`.

use crate::container::Tag;

/// [`Meta`](crate::Meta) as JSON.
pub(crate) const META: Tag = *b"META";
/// Points of a level.
pub(crate) const POINTS: Tag = *b"PNTS";
/// Their normals.
pub(crate) const NORMALS: Tag = *b"NRML";
/// Nodes of the tree over them.
pub(crate) const NODES: Tag = *b"NODE";
/// Their coordinates, a section an axis, for the tree.
pub(crate) const AXES: [Tag; 3] = [*b"AXSX", *b"AXSY", *b"AXSZ"];
/// Keypoints.
pub(crate) const KEYPOINTS: Tag = *b"KEYP";
/// Their descriptors.
pub(crate) const DESCRIPTORS: Tag = *b"DESC";
/// The index over them: principal axes, nodes, coordinates a leaf, indices a leaf.
pub(crate) const INDEX_FRAME: Tag = *b"IDXF";
pub(crate) const INDEX_NODES: Tag = *b"IDXN";
pub(crate) const INDEX_BLOCKS: Tag = *b"IDXB";
pub(crate) const INDEX_ORDER: Tag = *b"IDXO";
/// Gaussians of NDT; their number is 64 times the level's plus the resolution's.
pub(crate) const GAUSSIANS: Tag = *b"GAUS";
/// Their cells.
pub(crate) const CELLS: Tag = *b"GCEL";
/// The table to look cells up by.
pub(crate) const TABLE: Tag = *b"GTAB";

/// All of them.
pub(crate) const KNOWN: &[Tag] = &[
    META,
    POINTS,
    NORMALS,
    NODES,
    AXES[0],
    AXES[1],
    AXES[2],
    KEYPOINTS,
    DESCRIPTORS,
    INDEX_FRAME,
    INDEX_NODES,
    INDEX_BLOCKS,
    INDEX_ORDER,
    GAUSSIANS,
    CELLS,
    TABLE,
];

/// The number of a resolution's sections at a level.
pub(crate) fn resolution(level: u32, size: usize) -> u32 {
    64 * level + u32::try_from(size).unwrap_or(63).min(63)
}
