//! Folders of simulated mines: a scenario played into maps, queries, the truth and a case file.

mod folder;
mod notes;
mod place;
mod sheets;

use std::path::{Path, PathBuf};

use winze_io::atomic;
use winze_sim::cases::{Case, Cases};
use winze_sim::scenario::{self, Scenario, Step};

use folder::Folder;

/// Name of the case file in its folder.
pub const CASES: &str = "cases.json";

/// What is told while a scenario is played.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told<'a> {
    /// What is under way, and how many cases are done.
    Step(Step<'a>),
    /// Something that a user must know, in a sentence: of a mesh that was moved, of triangles that were left out.
    Note(&'a str),
}

/// What a scenario that was played has left in its folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Played {
    /// The cases, as the case file [`CASES`] holds them: paths count from the folder.
    pub cases: Vec<Case>,
    /// Names of the contact sheets in the folder.
    pub sheets: Vec<String>,
    /// The notes that were told.
    pub notes: Vec<String>,
}

/// Where a run writes until it is whole. However it ends, errors and [cancelled work](winze::cancel) among them, it does not stay.
struct Making(PathBuf);

impl Drop for Making {
    fn drop(&mut self) {
        // It can be large, and is of no use; if it cannot be deleted, the next run will.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Plays `scenario` into the folder `out`, with the mines' meshes where `mesh` asks for them. The folder must be new,
/// empty, or an earlier run's of the same scenario; what that one made stays until this one is whole. The same seed
/// makes the same bits.
///
/// # Errors
/// Where the folder holds other files or cannot be written (a [`std::io::Error`] or a [`winze_io::Error`]); and a
/// [`winze_sim::Error`] where the scenario cannot be played.
pub fn simulate(
    scenario: &Scenario,
    seed: u64,
    out: &Path,
    mesh: bool,
    told: &(dyn Fn(Told<'_>) + Sync),
) -> anyhow::Result<Played> {
    let making = Making(place::claim(out, &scenario.name)?);
    let played = play(scenario, seed, &making.0, mesh, told)?;
    place::put_in_place(out, &making.0, &scenario.name, seed)?;
    Ok(played)
}

/// Plays it where it may stay unfinished.
fn play(
    scenario: &Scenario,
    seed: u64,
    making: &Path,
    mesh: bool,
    told: &(dyn Fn(Told<'_>) + Sync),
) -> anyhow::Result<Played> {
    let mut folder = Folder::new(making, scenario, mesh, told);
    let step = |step: Step<'_>| told(Told::Step(step));
    scenario::simulate(scenario, seed, &step, |made| folder.take(made))?;
    let of = scenario.cases();
    step(Step {
        what: "contact sheets",
        done: of,
        of,
    });
    let sheets = folder.sheets()?;
    let Folder { cases, notes, .. } = folder;
    let cases = Cases { cases };
    atomic::write_bytes(&making.join(CASES), cases.to_json().as_bytes())?;
    Ok(Played {
        cases: cases.cases,
        sheets,
        notes,
    })
}
