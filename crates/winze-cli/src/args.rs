//! What can be typed.

use std::path::{Path, PathBuf};

use clap::{ArgAction, Parser, Subcommand};
use winze::Method;
use winze::locate::Near;
use winze_front::Layers;
use winze_io::Encoding;

/// Find a robot in its own map, underground.
///
/// winze answers where a point cloud (the query) lies in a prior map, with no initial guess: here
/// it is, or I don't know.
#[derive(Debug, Parser)]
#[command(
    name = "winze",
    version,
    propagate_version = true,
    max_term_width = 100
)]
pub(crate) struct Args {
    #[command(flatten)]
    pub(crate) global: Global,
    #[command(subcommand)]
    pub(crate) verb: Verb,
}

#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Everywhere")]
pub(crate) struct Global {
    /// Say nothing but errors, show no progress.
    #[arg(long, short, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Say more; twice for still more.
    #[arg(long, short, global = true, action = ArgAction::Count)]
    pub(crate) verbose: u8,
    /// Threads to use; 0 for all processors. The answer does not depend on it.
    #[arg(long, global = true, default_value_t = 0, value_name = "N", value_parser = threads)]
    pub(crate) threads: usize,
    /// Settings from a TOML file; `winze config` prints one to start from.
    #[arg(long, global = true, value_name = "FILE.toml")]
    pub(crate) config: Option<PathBuf>,
    /// One setting, such as `scale.voxel=0.3` or `icp.max_distance="3 voxels"`; may be repeated.
    #[arg(long, global = true, value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
    /// Seed of every random choice.
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u64).range(..=i64::MAX as u64))]
    pub(crate) seed: Option<u64>,
}

impl Global {
    /// The settings that were given.
    pub(crate) fn layers(&self) -> Layers<'_> {
        Layers {
            file: self.config.as_deref(),
            set: &self.set,
            seed: self.seed,
        }
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum Verb {
    /// Simulate a small mine and a query, locate it, show the answer: start here.
    Demo(Demo),
    /// Find a query cloud in a prior map.
    ///
    /// Exits with 0 where the query is located, 1 where the answer is another one (ambiguous,
    /// degenerate, not_found, insufficient), 2 on an error.
    Locate(Locate),
    /// Answer a question again that `winze locate --bundle` kept, with the settings of then, and say whether the
    /// answer is the same.
    ///
    /// Exits as `locate` does where the answer is the one given then, to the bit, with 2 where it is not.
    Replay(Replay),
    /// Prepare a map once and keep it: build, info, check.
    #[command(subcommand)]
    Map(MapVerb),
    /// Simulate a mine: a map, queries and the truth, by a built-in scenario or one of your own.
    ///
    /// Without a scenario, lists those that are built in.
    Sim(Sim),
    /// Run methods over cases with known truth, and print how often and how well they answer.
    ///
    /// Exits with 0 where every case was answered, rightly or not, 2 on an error, also of a single case
    /// (the others are in the tables all the same).
    Eval(Eval),
    /// One method over cases, for `eval`.
    #[command(hide = true)]
    EvalWorker,
    /// Tell what is in cloud files.
    Info(Info),
    /// Convert a cloud file to another format, by the extensions.
    Convert(Convert),
    /// Print the effective settings as a commented TOML file.
    Config,
    /// Print a completion script for a shell.
    Completions(Completions),
    /// Print the manual page.
    Man,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Demo {
    /// Folder for the clouds, the picture, the report and the outcome.
    #[arg(long, short, value_name = "DIR", default_value = "winze-demo")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Locate {
    /// The prior map: a PCD, PLY, KITTI or text cloud, or a map that `winze map build` made.
    pub(crate) map: PathBuf,
    /// The query: a cloud in a frame of its own.
    pub(crate) query: PathBuf,
    /// auto, or one of the paper's five: fpfh, fpfh+ndt, fpfh+icp, ndt+icp, fpfh+ndt+icp.
    #[arg(long, short, default_value_t = Method::Auto, value_name = "NAME")]
    pub(crate) method: Method,
    /// Both clouds have z up: poses that tilt by more than 10 degrees are refused.
    #[arg(long)]
    pub(crate) gravity_aligned: bool,
    /// The query's middle lies in this ball of the map's frame, metres.
    #[arg(long, value_name = "X,Y,Z,RADIUS", allow_hyphen_values = true, value_parser = near)]
    pub(crate) near: Option<Near>,
    /// Start pose map_from_query for ndt+icp, a 4x4 matrix in a text file; else the identity.
    #[arg(long, value_name = "T.txt")]
    pub(crate) initial: Option<PathBuf>,
    /// The true map_from_query, a 4x4 matrix in a text file: adds the pose error.
    #[arg(long, value_name = "T.txt")]
    pub(crate) truth: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) outputs: Outputs,
    /// Keep the question, the answer and the part of the map that was looked at in one file, for `winze replay`. The
    /// question is asked again to see that the file is complete; where it cannot be made, the exit code is 2.
    #[arg(long, value_name = "FILE.zip")]
    pub(crate) bundle: Option<PathBuf>,
}

/// What may be made of an answer.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct Outputs {
    /// Write the outcome as JSON; `-` for stdout, the summary then goes to stderr.
    #[arg(long, value_name = "FILE|-")]
    pub(crate) json: Option<PathBuf>,
    /// Write a page with the answer, the picture and the stages, to look at in a browser.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    /// Draw both clouds before and after, side by side.
    #[arg(long, value_name = "FILE.png")]
    pub(crate) picture: Option<PathBuf>,
    /// Write the query as it lies in the map.
    #[arg(long, value_name = "FILE")]
    pub(crate) save_aligned: Option<PathBuf>,
}

impl Outputs {
    /// The files asked for.
    pub(crate) fn files(&self) -> Vec<&Path> {
        [&self.json, &self.report, &self.picture, &self.save_aligned]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
            .filter(|p| *p != Path::new("-"))
            .collect()
    }

    /// Whether any of them is drawn.
    pub(crate) fn drawn(&self) -> bool {
        self.picture.is_some() || self.report.is_some()
    }

    /// Whether the JSON goes to stdout.
    pub(crate) fn json_to_stdout(&self) -> bool {
        self.json.as_deref() == Some(Path::new("-"))
    }
}

#[derive(Debug, clap::Args)]
pub(crate) struct Replay {
    /// A bundle that `winze locate --bundle` wrote.
    pub(crate) bundle: PathBuf,
    /// Ask the whole map, which must be the one that was asked then; else the part of it in the bundle.
    #[arg(long, value_name = "MAP")]
    pub(crate) map: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) outputs: Outputs,
}

#[derive(Debug, Subcommand)]
pub(crate) enum MapVerb {
    /// Do all the work on a map once and keep it in a file: points, normals, keypoints, descriptors,
    /// neighbours and Gaussians at scales of its own.
    ///
    /// The file is replaced as a whole or not at all. It does not depend on the number of threads or
    /// on the memory.
    Build(MapBuild),
    /// Tell what a built map is and what it was made of.
    Info(MapInfo),
    /// Verify every byte and structure of built maps.
    Check(MapCheck),
}

#[derive(Debug, clap::Args)]
pub(crate) struct MapBuild {
    /// Clouds in one frame, which together are the map.
    #[arg(required = true)]
    pub(crate) clouds: Vec<PathBuf>,
    /// The map's file.
    #[arg(long, short, value_name = "FILE.wmap")]
    pub(crate) out: PathBuf,
    /// Replace the file if it is there.
    #[arg(long)]
    pub(crate) force: bool,
    /// Memory to work in, such as 800M or 4G; half of what is free if not given. It sets how many points are read at
    /// a time; what grows with the map lies in scratch files, which the system keeps in memory as far as there is any.
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    pub(crate) memory: Option<u64>,
    /// Folder for scratch files (up to 60 bytes a point of the clouds); else that of the map. A compressed PCD is unpacked
    /// in the system's folder for temporary files.
    #[arg(long, value_name = "DIR")]
    pub(crate) scratch: Option<PathBuf>,
    /// Coordinate reference system of the clouds, kept with the map, such as EPSG:32633.
    #[arg(long, value_name = "NAME")]
    pub(crate) crs: Option<String>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct MapInfo {
    /// A built map.
    pub(crate) file: PathBuf,
    /// As one line of JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct MapCheck {
    /// Built maps.
    #[arg(required = true)]
    pub(crate) files: Vec<PathBuf>,
}

/// A number of bytes with K, M or G behind it, or without.
fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || format!("{text:?} is no size; write 800M or 4G");
    let upper = text.trim().to_ascii_uppercase();
    let upper = upper.trim_end_matches("IB").trim_end_matches('B');
    let (number, unit) = match upper.char_indices().last() {
        Some((at, 'K')) => (&upper[..at], 10),
        Some((at, 'M')) => (&upper[..at], 20),
        Some((at, 'G')) => (&upper[..at], 30),
        Some((at, 'T')) => (&upper[..at], 40),
        _ => (upper, 0),
    };
    let number: f64 = number.trim().parse().map_err(|_| wrong())?;
    let bytes = number * f64::from(1u32 << 10).powi(unit / 10);
    if !(1.0..1e18).contains(&bytes) {
        return Err(wrong());
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 1 and 1e18"
    )]
    let bytes = bytes as u64;
    Ok(bytes)
}

#[derive(Debug, clap::Args)]
pub(crate) struct Sim {
    /// A built-in scenario's name, or a TOML file.
    pub(crate) scenario: Option<String>,
    /// Folder for maps, queries, truth and cases.json.
    #[arg(long, short, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Print the scenario instead of playing it.
    #[arg(long)]
    pub(crate) show: bool,
    /// At most this many queries of each family, the first ones.
    #[arg(long, value_name = "N")]
    pub(crate) count: Option<usize>,
    /// Leave out the mines' meshes, which can be large.
    #[arg(long)]
    pub(crate) no_mesh: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Eval {
    /// A cases.json, or a folder that holds one.
    pub(crate) cases: PathBuf,
    /// A method as for `locate`; may be repeated.
    #[arg(long, short, default_value = "auto", value_name = "NAME")]
    pub(crate) method: Vec<Method>,
    /// Run each case with so many seeds, from --seed on; 20 with --paper, else 1. (auto and ndt+icp draw
    /// nothing at random and run once.)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub(crate) seeds: Option<u64>,
    /// Print the paper's two tables beside its own figures: its five methods, and auto, on its six clouds.
    #[arg(long, conflicts_with_all = ["method", "only", "family", "every"])]
    pub(crate) paper: bool,
    /// Only cases of this name, `*` for anything; may be repeated.
    #[arg(long, value_name = "PATTERN")]
    pub(crate) only: Vec<String>,
    /// Only cases of this family, `*` for anything; may be repeated.
    #[arg(long, value_name = "PATTERN")]
    pub(crate) family: Vec<String>,
    /// Of those, only every N-th. In the built-in scenarios sensors and attitudes take turns: an N without the factors 2
    /// and 3, such as 5 or 7, meets them all.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = stride)]
    pub(crate) every: usize,
    /// Run all methods in one process, which does the work that they share once. Sooner done, but seconds and memory
    /// are no method's own. With --paper, whose tables hold neither, it is always so.
    #[arg(long)]
    pub(crate) together: bool,
    /// Run so many methods at once, each on its share of the threads. Sooner done, but the seconds are those
    /// of a busy machine; one after the other by default.
    #[arg(long, value_name = "N", value_parser = stride, conflicts_with_all = ["together", "paper"])]
    pub(crate) jobs: Option<usize>,
    /// Note each run in this file as it ends. Runs that it holds already, of the same cases and settings, are not
    /// made again: so a long evaluation goes on where it was cut short. It does not know whether maps, queries or the
    /// program itself have changed since.
    #[arg(long, value_name = "FILE", conflicts_with = "figures")]
    pub(crate) journal: Option<PathBuf>,
    /// Write everything, every run included, as JSON; `-` for stdout, the tables then go to stderr.
    #[arg(long, value_name = "FILE|-")]
    pub(crate) json: Option<PathBuf>,
    /// Write a page with the tables and pictures of the failures, to look at in a browser.
    #[arg(long, value_name = "FILE.html")]
    pub(crate) report: Option<PathBuf>,
    /// Draw each of the paper's clouds before and after the full chain, into this folder.
    #[arg(long, value_name = "DIR", requires = "paper")]
    pub(crate) figures: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Info {
    /// Cloud files.
    #[arg(required = true, value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,
    /// As JSON, one line a file.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Convert {
    /// The cloud to read.
    pub(crate) input: PathBuf,
    /// The cloud to write: .pcd, .ply, .bin (KITTI), .xyz, .txt, .csv.
    pub(crate) output: PathBuf,
    /// ascii, binary or compressed; the format's usual one where it is not given.
    #[arg(long, value_name = "NAME")]
    pub(crate) encoding: Option<Encoding>,
}

#[derive(Debug, clap::Args)]
pub(crate) struct Completions {
    /// bash, elvish, fish, powershell or zsh.
    pub(crate) shell: clap_complete::Shell,
}

fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n <= 1024 => Ok(n),
        _ => Err("give a number from 0 (all processors) to 1024".into()),
    }
}

fn stride(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n) if n > 0 => Ok(n),
        _ => Err("give a number from 1 on".into()),
    }
}

fn near(text: &str) -> Result<Near, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|t| t.trim().parse()).collect();
    let numbers = numbers.unwrap_or_default();
    match numbers[..] {
        // No coordinate is further out than a bundle holds.
        [x, y, z, radius] if numbers.iter().all(|v| v.abs() <= 1e9) && radius > 0.0 => Ok(Near {
            centre: [x, y, z],
            radius,
        }),
        _ => Err("give four numbers up to 1e9, such as 120,-35,4,25, the last above 0".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory as _;
        Args::command().debug_assert();
    }

    #[test]
    fn regions_parse() {
        let n = near("1,-2.5, 3,10").unwrap();
        assert_eq!((n.centre, n.radius), ([1.0, -2.5, 3.0], 10.0));
        for bad in [
            "",
            "1,2,3",
            "1,2,3,0",
            "1,2,x,4",
            "1,2,3,4,5",
            "1,2,3,inf",
            "1,abc,2,3,400",
        ] {
            assert!(near(bad).is_err(), "{bad}");
        }
    }
}
