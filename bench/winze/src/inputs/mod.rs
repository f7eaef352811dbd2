//! The inputs of the stages: a folder of raw arrays and cloud files.

pub(crate) mod drift;
pub(crate) mod jinchuan;
pub(crate) mod make;
pub(crate) mod sim;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use winze::{Cloud, Pose};

use crate::arrays::{self, Number};

/// A folder of inputs.
#[derive(Debug, Clone)]
pub(crate) struct Inputs {
    folder: PathBuf,
    /// The folder's name.
    pub(crate) name: String,
    /// The voxel size, metres, in which most lengths count.
    pub(crate) voxel: f64,
    /// How many queries there are.
    pub(crate) queries: usize,
}

impl Inputs {
    pub(crate) fn open(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join("settings.json");
        let text = fs::read_to_string(&path)
            .with_context(|| format!("{}: cannot be read", path.display()))?;
        let settings: serde_json::Value = serde_json::from_str(&text)?;
        let Some(voxel) = settings["voxel"].as_f64() else {
            bail!("{}: no \"voxel\"", path.display());
        };
        let name = folder.canonicalize()?;
        let name = name.file_name().unwrap_or_default().to_string_lossy();
        let queries = (0..).take_while(|i| folder.join(format!("query_{i}.f32")).exists());
        Ok(Self {
            folder: folder.to_owned(),
            name: name.into_owned(),
            voxel,
            queries: queries.count(),
        })
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    pub(crate) fn rows<T: Number, const N: usize>(
        &self,
        name: &str,
    ) -> anyhow::Result<Vec<[T; N]>> {
        arrays::read(&self.path(name))
    }

    pub(crate) fn indices(&self, name: &str) -> anyhow::Result<Vec<u32>> {
        arrays::read_flat(&self.path(name))
    }

    /// The cloud of a file of points.
    pub(crate) fn cloud(&self, name: &str) -> anyhow::Result<Cloud> {
        Ok(Cloud::with_origin([0.0; 3], self.rows(name)?)?)
    }

    /// The poses of a file of 4 x 4 matrices.
    pub(crate) fn poses(&self, name: &str) -> anyhow::Result<Vec<Pose>> {
        let rows: Vec<[f64; 4]> = self.rows(name)?;
        let (matrices, rest) = rows.as_chunks::<4>();
        ensure!(rest.is_empty(), "{name} holds no 4 x 4 matrices");
        matrices
            .iter()
            .map(|m| Ok(Pose::from_matrix(*m)?))
            .collect()
    }

    pub(crate) fn pose(&self, name: &str) -> anyhow::Result<Pose> {
        let poses = self.poses(name)?;
        let [pose] = poses[..] else {
            bail!("{name} is no 4 x 4 matrix");
        };
        Ok(pose)
    }
}
