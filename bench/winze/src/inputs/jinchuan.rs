//! A real drift of the Jinchuan mine and a second survey of it.

use std::path::Path;

use anyhow::Context as _;
use winze::Cloud;
use winze_io::{ReadOptions, read_cloud, read_transform};

use super::make::Question;

const VOXEL: f64 = 0.3;

/// From the folder of the real clouds.
pub(crate) fn question(data: &Path) -> anyhow::Result<Question> {
    let folder = data.join("jinchuan");
    let read = |name: &str| -> anyhow::Result<Cloud> {
        let path = folder.join(name);
        let file = read_cloud(&path, &ReadOptions::default())
            .with_context(|| path.display().to_string())?;
        anyhow::ensure!(
            file.cloud.origin() == [0.0; 3],
            "{name}: its origin is not 0"
        );
        Ok(file.cloud)
    };
    Ok(Question {
        map: read("map_2025-05-13.pcd")?,
        queries: vec![(
            read("query_2025-04-21.pcd")?,
            read_transform(&folder.join("T_map_query.txt"))?,
        )],
        voxel: VOXEL,
        seed: 1,
    })
}
