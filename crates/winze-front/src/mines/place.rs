//! The folder of a simulated mine: taken over, made anew in a place of its own, put in place when it is whole.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use winze_io::atomic;

use super::CASES;
use crate::claim::claim_folder;

/// Says whose folder it is.
const SIGN: &str = "README.txt";
/// Where a run writes until it is whole, in the folder that it is to be in.
const MAKING: &str = ".making";
/// Folders of what a run makes.
const FOLDERS: [&str; 5] = ["maps", "queries", "truth", "trajectories", "meshes"];

fn first_line(name: &str) -> String {
    format!("Made by `winze sim {name}`")
}

/// Takes the folder over, which must be new, empty, or an earlier run's of the same scenario, and makes a place in
/// it for this run. What the earlier run made stays until this one is whole.
pub(super) fn claim(out: &Path, name: &str) -> anyhow::Result<PathBuf> {
    let first = first_line(name);
    claim_folder(out, SIGN, |sign| sign.starts_with(&first))?;
    // From here on the folder is ours, however the run ends.
    let sign = out.join(SIGN);
    if !sign.exists() {
        let text = format!("{first}, which has not ended.\n");
        atomic::write_bytes(&sign, text.as_bytes())?;
    }
    let making = out.join(MAKING);
    if making.exists() {
        std::fs::remove_dir_all(&making)
            .with_context(|| format!("{}: cannot be deleted", making.display()))?;
    }
    for folder in FOLDERS {
        let folder = making.join(folder);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    Ok(making)
}

/// Replaces what an earlier run made by what this one did. The case file goes first and comes last: a folder that
/// has one is whole.
pub(super) fn put_in_place(out: &Path, making: &Path, name: &str, seed: u64) -> anyhow::Result<()> {
    let old =
        std::fs::read_dir(out).with_context(|| format!("{}: cannot be read", out.display()))?;
    let mut old: Vec<PathBuf> = old.flatten().map(|entry| entry.path()).collect();
    old.sort_by_key(|path| path.file_name().is_none_or(|f| f != CASES));
    for path in old {
        let file = path.file_name().map(|f| f.to_string_lossy().into_owned());
        let file = file.unwrap_or_default();
        let sheet = file.starts_with("contact_sheet") && file.ends_with(".png");
        let gone = if FOLDERS.contains(&file.as_str()) {
            std::fs::remove_dir_all(&path)
        } else if file == CASES || sheet {
            std::fs::remove_file(&path)
        } else {
            Ok(())
        };
        gone.with_context(|| format!("{}: cannot be deleted", path.display()))?;
    }
    let text = format!(
        "{}, seed {seed}, which writes over these files when it is run again.

cases.json          which query is asked in which map, and the right answer
maps/               the prior maps
queries/            the queries, each in a frame of its own
truth/              map_from_query of each, a 4x4 matrix, where the query lies in the map
trajectories/       where the sensor was (map frame) and where odometry believed it to be (query frame)
meshes/             the mines themselves, world frame, also as later queries found them; not with --no-mesh
contact_sheet*.png  every query on its map
",
        first_line(name)
    );
    atomic::write_bytes(&out.join(SIGN), text.as_bytes())?;
    let new = std::fs::read_dir(making)
        .with_context(|| format!("{}: cannot be read", making.display()))?;
    let mut new: Vec<PathBuf> = new.flatten().map(|entry| entry.path()).collect();
    new.sort_by_key(|path| path.file_name().is_some_and(|f| f == CASES));
    for path in new {
        let Some(file) = path.file_name() else {
            continue;
        };
        std::fs::rename(&path, out.join(file))
            .with_context(|| format!("{}: cannot be put in its place", path.display()))?;
    }
    std::fs::remove_dir_all(making)
        .with_context(|| format!("{}: cannot be deleted", making.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_with_other_files_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let out: PathBuf = folder.path().join("new");
        let run = |seed: u64, file: &str| {
            let making = claim(&out, "dust").unwrap();
            std::fs::write(making.join("maps").join(file), "x").unwrap();
            std::fs::write(making.join(CASES), format!("{{\"seed\": {seed}}}")).unwrap();
            making
        };
        let making = run(1, "one.pcd");
        assert!(!out.join(CASES).exists(), "a run that has not ended");
        put_in_place(&out, &making, "dust", 1).unwrap();
        assert!(out.join(CASES).exists() && !making.exists());
        // A run that fails leaves what was there; one that ends replaces it.
        let making = run(2, "two.pcd");
        assert!(out.join("maps/one.pcd").exists());
        put_in_place(&out, &making, "dust", 2).unwrap();
        assert!(!out.join("maps/one.pcd").exists() && out.join("maps/two.pcd").exists());
        assert!(claim(&out, "paper").is_err(), "another scenario's");
        let other = folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        std::fs::write(other.join("thesis.txt"), "mine").unwrap();
        assert!(claim(&other, "dust").is_err());
    }
}
