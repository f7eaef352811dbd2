//! Runs winze and watches it.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use winze_map::Map;

use crate::common::{Result, quantile};
use crate::{make, mine, name};

/// The stages of a query whose time depends on the map's size.
const OF_MAP: [&str; 7] = [
    "read map",
    "measure map",
    "prepare map",
    "describe map",
    "match",
    "make NDT cells",
    "build map tree",
];
/// Times a map is opened.
const OPENED: usize = 20;
/// Between looks at a process.
const LOOK: Duration = Duration::from_millis(20);

pub(crate) struct Plan {
    pub(crate) folder: PathBuf,
    pub(crate) winze: PathBuf,
    pub(crate) memory: String,
    /// Raw points.
    pub(crate) sizes: Vec<u64>,
    /// Threads of builds: one build for each.
    pub(crate) threads: Vec<u32>,
    /// Up to this many raw points queries are also located in the cloud itself.
    pub(crate) clouds_to: u64,
    pub(crate) out: PathBuf,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Results {
    /// Where it was measured, by what.
    date: String,
    winze: String,
    rustc: String,
    commit: String,
    processor: String,
    cores: usize,
    memory_kib: u64,
    pub(crate) sizes: Vec<Size>,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Size {
    pub(crate) raw_points: u64,
    cloud_bytes: u64,
    pub(crate) builds: Vec<Build>,
    pub(crate) map_bytes: u64,
    pub(crate) base_points: u64,
    pub(crate) levels: Vec<Level>,
    pub(crate) open: Open,
    pub(crate) in_map: Vec<Query>,
    pub(crate) in_cloud: Vec<Query>,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Level {
    voxel: f64,
    pub(crate) points: u64,
    keypoints: u64,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Build {
    command: String,
    pub(crate) threads: u32,
    pub(crate) ran: Ran,
    /// 0.3 µs a raw point and 15 µs a point of the finest level, seconds.
    pub(crate) cpu_bound: f64,
}

/// What a process took.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct Ran {
    pub(crate) wall: f64,
    pub(crate) cpu_user: f64,
    pub(crate) cpu_system: f64,
    /// Peaks: of what belongs to no file, looked at every 20 ms, and of all that was resident.
    pub(crate) anonymous_kib: u64,
    resident_kib: u64,
}

impl Ran {
    pub(crate) fn cpu(&self) -> f64 {
        self.cpu_user + self.cpu_system
    }
}

/// Seconds to open a map.
#[derive(Serialize, Deserialize)]
pub(crate) struct Open {
    /// In a process that runs, median and longest of 20, the file in memory.
    pub(crate) median: f64,
    longest: f64,
    /// Once, after the system was asked to forget the file.
    pub(crate) cold: Option<f64>,
    /// All of `winze map info`.
    info: f64,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Query {
    command: String,
    query: usize,
    verdict: String,
    error_m: Option<f64>,
    error_deg: Option<f64>,
    voxel: Option<f64>,
    /// The second run, and the first one for comparison.
    ran: Ran,
    first: Ran,
    pub(crate) seconds: f64,
    /// Of the stages whose time depends on the map's size.
    pub(crate) of_map: f64,
    stages: Vec<(String, f64)>,
}

impl Query {
    /// Located, within 0.1 m and 1° of the truth.
    pub(crate) fn right(&self) -> bool {
        self.verdict == "located"
            && self.error_m.is_some_and(|e| e < 0.1)
            && self.error_deg.is_some_and(|e| e < 1.0)
    }
}

pub(crate) fn run(plan: &Plan) -> Result<()> {
    let mut results = Results {
        date: said(Command::new("date").args(["-u", "+%F %R UTC"])),
        winze: said(Command::new(&plan.winze).arg("--version")),
        rustc: said(Command::new("rustc").arg("--version")),
        commit: said(Command::new("git").args(["rev-parse", "--short", "HEAD"])),
        processor: field("/proc/cpuinfo", "model name"),
        cores: std::thread::available_parallelism()?.get(),
        memory_kib: kib("/proc/meminfo", "MemTotal"),
        sizes: Vec::new(),
    };
    if plan.out.exists() {
        let earlier: Results = serde_json::from_slice(&fs::read(&plan.out)?)?;
        results.sizes = earlier.sizes;
    }
    for points in &plan.sizes {
        make(&plan.folder, *points)?;
        let size = plan.size(*points)?;
        tell(&size);
        results.sizes.retain(|s| s.raw_points != *points);
        results.sizes.push(size);
        results.sizes.sort_by_key(|s| s.raw_points);
        fs::write(&plan.out, serde_json::to_string_pretty(&results)? + "\n")?;
    }
    Ok(())
}

impl Plan {
    fn size(&self, points: u64) -> Result<Size> {
        let (cloud, map) = (name(points) + ".pcd", name(points) + ".wmap");
        let path = self.folder.join(&map);
        let mut builds = Vec::new();
        for threads in &self.threads {
            let command = format!(
                "map build {cloud} -o {map} --force --memory {} --threads {threads} --quiet",
                self.memory
            );
            // As far as the disk is concerned, alike.
            let _ = fs::remove_file(&path);
            let (ran, done) = self.watch(&command)?;
            if !done {
                return Err(format!("winze {command}: failed").into());
            }
            builds.push((command, *threads, ran));
        }
        let begun = Instant::now();
        let info = Command::new(&self.winze)
            .args(["map", "info", &map, "--json"])
            .current_dir(&self.folder)
            .output()?;
        let info_seconds = begun.elapsed().as_secs_f64();
        let info: Value = serde_json::from_slice(&info.stdout)?;
        let number = |v: &Value| v.as_u64().ok_or("map info: a number is missing");
        let levels: Vec<Level> = info["levels"]
            .as_array()
            .ok_or("map info: no levels")?
            .iter()
            .map(|l| {
                Ok(Level {
                    voxel: l["voxel"].as_f64().ok_or("map info: no voxel")?,
                    points: number(&l["points"])?,
                    keypoints: number(&l["keypoints"])?,
                })
            })
            .collect::<Result<_>>()?;
        let finest = levels.first().map_or(0, |l| l.points);
        let mut in_cloud = Vec::new();
        if points <= self.clouds_to {
            in_cloud = self.locate_all(&cloud)?;
        }
        Ok(Size {
            raw_points: points,
            cloud_bytes: fs::metadata(self.folder.join(&cloud))?.len(),
            builds: builds
                .into_iter()
                .map(|(command, threads, ran)| Build {
                    command: "winze ".to_owned() + &command,
                    threads,
                    ran,
                    cpu_bound: 0.3e-6 * points as f64 + 15e-6 * finest as f64,
                })
                .collect(),
            map_bytes: fs::metadata(&path)?.len(),
            base_points: number(&info["base_points"])?,
            levels,
            in_map: self.locate_all(&map)?,
            in_cloud,
            open: open(&path, info_seconds)?,
        })
    }

    fn locate_all(&self, map: &str) -> Result<Vec<Query>> {
        (0..mine::QUERIES.len())
            .map(|i| self.locate(map, i))
            .collect()
    }

    fn locate(&self, map: &str, query: usize) -> Result<Query> {
        let command = format!(
            "locate {map} query_{query}.pcd --truth query_{query}.txt --json answer.json --threads 2 --quiet"
        );
        let answer = self.folder.join("answer.json");
        let _ = fs::remove_file(&answer);
        let (first, _) = self.watch(&command)?;
        let (ran, _) = self.watch(&command)?;
        let found: Value = serde_json::from_slice(&fs::read(&answer)?)?;
        let stages: Vec<(String, f64)> = found["stages"]
            .as_array()
            .ok_or("answer: no stages")?
            .iter()
            .filter_map(|s| Some((s["name"].as_str()?.to_owned(), s["seconds"].as_f64()?)))
            .collect();
        Ok(Query {
            command: "winze ".to_owned() + &command,
            query,
            verdict: found["verdict"].as_str().unwrap_or("none").to_owned(),
            error_m: found["error"]["translation_m"].as_f64(),
            error_deg: found["error"]["rotation_deg"].as_f64(),
            voxel: found["voxel"].as_f64(),
            ran,
            first,
            seconds: found["seconds"].as_f64().unwrap_or(f64::NAN),
            of_map: stages
                .iter()
                .filter(|(name, _)| OF_MAP.contains(&name.as_str()))
                .map(|(_, seconds)| seconds)
                .sum(),
            stages,
        })
    }

    /// Runs winze to its end; also whether that was a good one.
    fn watch(&self, command: &str) -> Result<(Ran, bool)> {
        let begun = Instant::now();
        let mut child = Command::new(&self.winze)
            .args(command.split(' '))
            .current_dir(&self.folder)
            .stdout(Stdio::null())
            .spawn()?;
        let mut ran = Ran {
            wall: 0.0,
            cpu_user: 0.0,
            cpu_system: 0.0,
            anonymous_kib: 0,
            resident_kib: 0,
        };
        while !look(&child, &mut ran)? {
            sleep(LOOK);
        }
        ran.wall = begun.elapsed().as_secs_f64();
        Ok((ran, child.wait()?.success()))
    }
}

/// Takes down what a process uses; true once it has ended, while the system still keeps its account.
fn look(child: &Child, ran: &mut Ran) -> Result<bool> {
    // Hundredths of a second, on every Linux in use.
    const TICKS: f64 = 100.0;
    let status = format!("/proc/{}/status", child.id());
    ran.anonymous_kib = ran.anonymous_kib.max(kib(&status, "RssAnon"));
    ran.resident_kib = ran.resident_kib.max(kib(&status, "VmHWM"));
    let stat = fs::read_to_string(format!("/proc/{}/stat", child.id()))?;
    // The name, which may hold anything, ends at the last bracket.
    let (_, fields) = stat.rsplit_once(") ").ok_or("stat: no name")?;
    let fields: Vec<&str> = fields.split(' ').collect();
    let ticks = |i: usize| -> Result<f64> { Ok(fields.get(i).ok_or("stat: too short")?.parse()?) };
    ran.cpu_user = ticks(11)? / TICKS;
    ran.cpu_system = ticks(12)? / TICKS;
    Ok(fields.first() == Some(&"Z"))
}

fn open(map: &Path, info: f64) -> Result<Open> {
    let timed = || -> Result<f64> {
        let begun = Instant::now();
        let map = Map::open(map)?;
        let seconds = begun.elapsed().as_secs_f64();
        drop(map);
        Ok(seconds)
    };
    let warm: Vec<f64> = (0..OPENED).map(|_| timed()).collect::<Result<_>>()?;
    // GNU dd can tell the system that nobody will want the file.
    let forgotten = Command::new("dd")
        .arg(format!("if={}", map.display()))
        .args(["iflag=nocache", "count=0", "status=none"])
        .status()
        .is_ok_and(|s| s.success());
    let cold = if forgotten { Some(timed()?) } else { None };
    Ok(Open {
        median: quantile(&warm, 0.5),
        longest: quantile(&warm, 1.0),
        cold,
        info,
    })
}

fn tell(size: &Size) {
    let raw = size.raw_points as f64;
    let finest = size.levels.first().map_or(0, |l| l.points) as f64;
    println!(
        "{} raw points, {} of the base, {finest} of the finest level, {:.1} MiB, {:.0} bytes a point of it",
        size.raw_points,
        size.base_points,
        size.map_bytes as f64 / 1_048_576.0,
        size.map_bytes as f64 / finest
    );
    for b in &size.builds {
        println!(
            "  build, {} threads: {:.1} s, {:.1} s of processors ({:.1} in the system; at most {:.1}), \
             {:.0} MiB anonymous, {:.0} MiB resident",
            b.threads,
            b.ran.wall,
            b.ran.cpu(),
            b.ran.cpu_system,
            b.cpu_bound,
            b.ran.anonymous_kib as f64 / 1024.0,
            b.ran.resident_kib as f64 / 1024.0
        );
        println!(
            "    {:.2} µs a raw point, {:.2} µs a point of the finest level after 0.3 µs a raw point",
            1e6 * b.ran.cpu() / raw,
            (1e6 * b.ran.cpu() - 0.3 * raw) / finest
        );
    }
    println!(
        "  open: {:.2} ms (cold {:.2} ms), map info {:.1} ms",
        1e3 * size.open.median,
        1e3 * size.open.cold.unwrap_or(f64::NAN),
        1e3 * size.open.info
    );
    for (what, queries) in [("map", &size.in_map), ("cloud", &size.in_cloud)] {
        for q in queries {
            println!(
                "  query {} in the {what}: {}, {:.4} m off; {:.3} s, of the map {:.3} s",
                q.query,
                q.verdict,
                q.error_m.unwrap_or(f64::NAN),
                q.seconds,
                q.of_map
            );
        }
    }
}

/// What a program prints; empty where there is none.
fn said(command: &mut Command) -> String {
    let output = command.stderr(Stdio::null()).output();
    output.map_or_else(
        |_| String::new(),
        |o| String::from_utf8_lossy(&o.stdout).trim().to_owned(),
    )
}

/// What a file of the system says of `name`.
fn field(path: &str, name: &str) -> String {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines()
        .filter_map(|l| l.split_once(':'))
        .find(|(n, _)| n.trim() == name)
        .map_or_else(String::new, |(_, value)| value.trim().to_owned())
}

fn kib(path: &str, name: &str) -> u64 {
    let text = field(path, name);
    text.trim_end_matches(" kB").parse().unwrap_or(0)
}
