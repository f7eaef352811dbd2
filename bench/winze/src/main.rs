//! `bench-winze`: runs one stage of winze or of kiddo by the protocol of `bench/README.md`, and makes the inputs.
#![expect(clippy::print_stdout, reason = "its figures go there")]

mod arrays;
mod inputs;
mod machine;
mod measure;
mod settings;
mod stages;
mod work;

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::{Parser, Subcommand};
use serde_json::json;

use inputs::Inputs;
use inputs::make::{Question, write_all, write_bare};
use inputs::{drift, jinchuan, sim};
use measure::{Bench, Plan};
use stages::{Done, Library, iss_about_mean};

#[derive(Debug, Parser)]
#[command(
    version,
    about,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
struct Args {
    #[command(subcommand)]
    verb: Option<Verb>,
    /// Print the stages there are, lines "library stage".
    #[arg(long, exclusive = true)]
    stages: bool,
    #[arg(long, value_enum, default_value_t = Library::Winze)]
    library: Library,
    /// Folder of the inputs.
    #[arg(long, required_unless_present = "stages")]
    inputs: Option<PathBuf>,
    #[arg(long, required_unless_present = "stages")]
    stage: Option<String>,
    /// Threads.
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Timed runs, after one to warm up.
    #[arg(long, default_value_t = 5)]
    repeat: usize,
    /// Where the result of the last run goes; of `iss` also, to FILE.mean, the keypoints by the scatter about the mean.
    #[arg(long)]
    out: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
enum Verb {
    /// Make the inputs: `FOLDER/sim` and, where WINZE_DATA is set, `FOLDER/jinchuan`.
    Inputs {
        folder: PathBuf,
        /// Instead make `FOLDER/drift`, a drift of so many points.
        #[arg(long, value_name = "POINTS")]
        drift: Option<usize>,
        /// Of the drift only what `read-pcd-binary` and `voxel` are given.
        #[arg(long, requires = "drift")]
        bare: bool,
    },
    /// Tell what this machine does a second, and what each stage must do at least.
    Limits {
        /// Folder of the inputs.
        inputs: PathBuf,
    },
    /// Run a stage of winze once, on one thread, in a function whose instructions can be counted.
    Count {
        stage: String,
        /// Folder of the inputs.
        #[arg(long)]
        inputs: PathBuf,
    },
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    match &args.verb {
        Some(Verb::Inputs {
            folder,
            drift: Some(points),
            bare: true,
        }) => Ok(write_bare(
            &folder.join("drift"),
            &drift::question(*points)?,
        )?),
        Some(Verb::Inputs { folder, drift, .. }) => make_inputs(folder, *drift),
        Some(Verb::Count { stage, inputs }) => {
            let mut bench = Bench::new(Plan::Once);
            let done = run(Library::Winze, stage, &Inputs::open(inputs)?, 1, &mut bench)?;
            println!(
                "{}",
                json!({ "stage": stage, "count": done.count, "simd": simd() })
            );
            Ok(())
        }
        Some(Verb::Limits { inputs }) => limits(&Inputs::open(inputs)?),
        None if args.stages => {
            for library in [Library::Winze, Library::Kiddo] {
                for stage in library.stages() {
                    println!("{} {stage}", library.name());
                }
            }
            Ok(())
        }
        None => measure_stage(&args),
    }
}

/// The vector instructions that this processor, or what plays one, has beyond those that every one of its kind has.
fn simd() -> String {
    #[cfg(target_arch = "x86_64")]
    let found = [
        ("sse4.2", is_x86_feature_detected!("sse4.2")),
        ("avx2", is_x86_feature_detected!("avx2")),
        ("fma", is_x86_feature_detected!("fma")),
        ("avx512f", is_x86_feature_detected!("avx512f")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let found: [(&str, bool); 0] = [];
    let names: Vec<&str> = found.iter().filter(|f| f.1).map(|f| f.0).collect();
    names.join(" ")
}

fn limits(inputs: &Inputs) -> anyhow::Result<()> {
    let mut machine = serde_json::Map::new();
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()?;
        machine.insert(
            threads.to_string(),
            pool.install(machine::measure).to_json(),
        );
    }
    println!(
        "{}",
        json!({ "machine": machine, "work": work::of(inputs)? })
    );
    Ok(())
}

/// Runs a stage in a pool of so many threads.
fn run(
    library: Library,
    stage: &str,
    inputs: &Inputs,
    threads: usize,
    bench: &mut Bench,
) -> anyhow::Result<Done> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    pool.install(|| library.run(stage, inputs, bench))
}

fn measure_stage(args: &Args) -> anyhow::Result<()> {
    let (Some(folder), Some(stage)) = (&args.inputs, &args.stage) else {
        anyhow::bail!("--inputs and --stage are wanted");
    };
    let Args { library, .. } = *args;
    let inputs = Inputs::open(folder)?;
    let mut bench = Bench::new(Plan::Timed(args.repeat));
    let done = run(library, stage, &inputs, args.threads, &mut bench)?;
    if let Some(out) = &args.out {
        arrays::write(out, &done.bytes)?;
        if library == Library::Winze && stage == "iss" {
            let mut mean = out.clone().into_os_string();
            mean.push(".mean");
            arrays::write(Path::new(&mean), &iss_about_mean(&inputs)?.bytes)?;
        }
    }
    let figures = &bench.figures;
    let line = json!({
        "library": library.name(),
        "version": library.version(),
        "stage": stage,
        "input": inputs.name,
        "threads": args.threads,
        "wall": figures.wall,
        "cpu": figures.cpu,
        "rss_before": figures.rss_before,
        "rss_peak": figures.rss_peak,
        "count": done.count,
        "note": done.note,
    });
    println!("{line}");
    Ok(())
}

fn make_inputs(folder: &Path, points: Option<usize>) -> anyhow::Result<()> {
    let make = |name: &str, question: &Question| -> anyhow::Result<()> {
        let folder = folder.join(name);
        write_all(&folder, question).with_context(|| folder.display().to_string())?;
        let queries: Vec<usize> = question.queries.iter().map(|q| q.0.len()).collect();
        println!(
            "{}: a map of {} points, queries of {queries:?}",
            folder.display(),
            question.map.len()
        );
        Ok(())
    };
    if let Some(points) = points {
        return make("drift", &drift::question(points)?);
    }
    if let Some(data) = std::env::var_os("WINZE_DATA") {
        make("jinchuan", &jinchuan::question(Path::new(&data))?)?;
    }
    make("sim", &sim::question()?)
}
