//! The stages, each as one library does it.

mod cloud;
mod features;
mod kiddo;
mod register;
mod relocalize;
mod search;

use anyhow::bail;

use crate::arrays::{Number, bytes, flat};
use crate::inputs::Inputs;
use crate::measure::Bench;

pub(crate) use features::iss_about_mean;
pub(crate) use register::{Arrays, Matched};

/// What came out of a stage.
#[derive(Debug, Clone, Default)]
pub(crate) struct Done {
    /// The result, raw.
    pub(crate) bytes: Vec<u8>,
    /// The number of things that came out.
    pub(crate) count: usize,
    /// What a reader of the figures should know.
    pub(crate) note: &'static str,
}

impl Done {
    fn rows<T: Number, const N: usize>(rows: &[[T; N]]) -> Self {
        Self {
            bytes: bytes(rows),
            count: rows.len(),
            note: "",
        }
    }

    fn numbers<T: Number>(numbers: &[T]) -> Self {
        Self {
            bytes: flat(numbers),
            count: numbers.len(),
            note: "",
        }
    }

    fn poses(poses: &[winze::Pose], count: usize) -> Self {
        let matrices: Vec<[f64; 4]> = poses.iter().flat_map(winze::Pose::to_matrix).collect();
        Self {
            bytes: bytes(&matrices),
            count,
            note: "",
        }
    }

    fn noted(self, note: &'static str) -> Self {
        Self { note, ..self }
    }
}

/// A library.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Library {
    /// This project.
    Winze,
    /// The k-d tree kiddo.
    Kiddo,
}

impl Library {
    /// As it is written in tables.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Winze => "winze",
            Self::Kiddo => "kiddo",
        }
    }

    pub(crate) fn version(self) -> &'static str {
        locked_version(self.name()).unwrap_or("unknown")
    }

    /// Its stages, in the order of the protocol.
    pub(crate) fn stages(self) -> Vec<&'static str> {
        self.table().iter().map(|s| s.0).collect()
    }

    fn table(self) -> &'static [(&'static str, Stage)] {
        match self {
            Self::Winze => WINZE,
            Self::Kiddo => KIDDO,
        }
    }

    /// Runs a stage on the threads of the current pool.
    pub(crate) fn run(
        self,
        stage: &str,
        inputs: &Inputs,
        bench: &mut Bench,
    ) -> anyhow::Result<Done> {
        let Some((_, run)) = self.table().iter().find(|s| s.0 == stage) else {
            let known = self.stages().join(", ");
            bail!("{} has no stage {stage:?}; it has {known}", self.name());
        };
        run(inputs, bench)
    }
}

/// The version that `Cargo.lock` names.
fn locked_version(package: &str) -> Option<&'static str> {
    let lock = include_str!("../../../../Cargo.lock");
    let mut lines = lock
        .lines()
        .skip_while(|l| *l != format!("name = \"{package}\""));
    lines
        .nth(1)?
        .strip_prefix("version = \"")?
        .strip_suffix('"')
}

/// Loads what a stage is given, measures it and hands on what came out.
type Stage = fn(&Inputs, &mut Bench) -> anyhow::Result<Done>;

const WINZE: &[(&str, Stage)] = &[
    ("read-pcd-ascii", |i, b| cloud::read(i, b, "map.ascii.pcd")),
    ("read-pcd-binary", |i, b| cloud::read(i, b, "map.pcd")),
    ("read-pcd-compressed", |i, b| {
        cloud::read(i, b, "map.compressed.pcd")
    }),
    ("read-ply", |i, b| cloud::read(i, b, "map.ply")),
    ("voxel", cloud::voxel),
    ("outliers", cloud::outliers),
    ("tree", search::tree),
    ("nearest", search::nearest),
    ("knn", search::knn),
    ("radius", search::radius),
    ("normals-knn", cloud::normals_knn),
    ("normals-radius", cloud::normals_radius),
    ("iss", features::iss),
    ("fpfh-all", features::fpfh_all),
    ("fpfh-keypoints", features::fpfh_keypoints),
    ("match", |i, b| features::matching(i, b, false)),
    ("match-mutual", |i, b| features::matching(i, b, true)),
    ("ransac", register::ransac),
    ("ndt", register::ndt),
    ("icp-point", register::icp_point),
    ("icp-plane", register::icp_plane),
    ("gicp", register::gicp),
    ("chain", register::chain),
    ("relocalize-prepared", relocalize::prepared),
    ("relocalize", relocalize::raw),
];

const KIDDO: &[(&str, Stage)] = &[
    ("tree", kiddo::tree),
    ("nearest", kiddo::nearest),
    ("knn", kiddo::knn),
    ("radius", kiddo::radius),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_those_of_the_lock_file() {
        assert_eq!(Library::Winze.version(), env!("CARGO_PKG_VERSION"));
        assert!(Library::Kiddo.version().starts_with("6."));
        assert_eq!(locked_version("no such crate"), None);
    }
}
