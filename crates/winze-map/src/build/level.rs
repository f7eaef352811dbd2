//! One level: all that is prepared at one voxel size, written as it is made.

use winze::descriptor_index;
use winze::features::describe_in;
use winze::ndt::{cells_in, sizes};
use winze::prepare::Frame;
use winze::prepared::level_in;

use super::base::Base;
use super::{Work, write};
use crate::container::ContainerWriter;
use crate::error::Result;
use crate::meta::LevelMeta;
use crate::sections;

impl Work<'_> {
    pub(super) fn level(
        &self,
        base: &Base,
        frame: Frame,
        number: u32,
        voxel: f64,
        file: &mut ContainerWriter<'_>,
    ) -> Result<LevelMeta> {
        let (config, scratch) = (self.config, &self.scratch);
        let say = |what: &str, share: f64| {
            self.plan.step(&format!("{what} at {voxel:.3} m"), share);
        };
        say("surface", 0.35);
        let weighted = (&base.points[..], &base.weights[..]);
        let columns = level_in(weighted, frame, voxel, config, scratch)?;
        let surface = columns.view();
        let (nodes, axes) = surface.tree.parts();
        write(file.section(sections::POINTS, number, &surface.points))?;
        write(file.section(sections::NORMALS, number, &surface.normals))?;
        write(file.section(sections::NODES, number, nodes))?;
        for (tag, axis) in sections::AXES.into_iter().zip(axes) {
            write(file.section(tag, number, axis))?;
        }
        say("keypoints and descriptors", 0.5);
        let most = config.iss.max_map_keypoints;
        let features = describe_in(&surface, config, most, scratch)?;
        write(file.section(sections::KEYPOINTS, number, &features.points))?;
        write(file.section(sections::DESCRIPTORS, number, &features.descriptors))?;
        say("descriptor index", 0.05);
        let index = descriptor_index::build(&features.descriptors, scratch)?;
        let index = index.view();
        write(file.section(sections::INDEX_FRAME, number, index.frame()))?;
        write(file.section(sections::INDEX_NODES, number, index.nodes()))?;
        write(file.section(sections::INDEX_BLOCKS, number, index.blocks()))?;
        write(file.section(sections::INDEX_ORDER, number, index.order()))?;
        say("Gaussians", 0.1);
        let ndt = &config.ndt;
        let ndt_sizes = sizes(voxel, ndt);
        let mut ndt_cells = Vec::new();
        for (i, &size) in ndt_sizes.iter().enumerate() {
            let points = &surface.points;
            let cells = cells_in(points, size, ndt.min_points, ndt.eigenvalue_floor, scratch)?;
            let number = sections::resolution(number, i);
            write(file.section(sections::GAUSSIANS, number, &cells.gaussians))?;
            write(file.section(sections::CELLS, number, &cells.places))?;
            write(file.section(sections::TABLE, number, &cells.table))?;
            ndt_cells.push(cells.places.len() as u64);
        }
        Ok(LevelMeta {
            voxel,
            points: surface.points.len() as u64,
            keypoints: features.points.len() as u64,
            qualified: features.qualified as u64,
            ndt_sizes,
            ndt_cells,
        })
    }
}
