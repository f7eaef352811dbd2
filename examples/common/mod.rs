//! What the studies share: where the real clouds lie, and small statistics.
#![allow(dead_code, unreachable_pub, reason = "each study uses a part")]

pub mod mesh;
pub mod mine;
pub mod picture;

use std::path::{Path, PathBuf};

use winze::rng::Rng;
use winze::{Cloud, Outcome, Pose, Verdict};
use winze_io::{ReadOptions, read_cloud, read_transform};

pub type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// The folder of the real clouds: `WINZE_DATA`, else `../shared/data`, taken from the project's root.
pub fn data() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = root.join(
        std::env::var_os("WINZE_DATA")
            .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from),
    );
    folder.canonicalize().unwrap_or(folder)
}

pub fn read(path: &str) -> Result<Cloud> {
    Ok(read_cloud(&data().join(path), &ReadOptions::default())?.cloud)
}

pub fn truth(path: &str) -> Result<Pose> {
    Ok(read_transform(&data().join(path))?)
}

/// Any attitude, up to 100 m away.
pub fn random_frame(seed: u64) -> Pose {
    let mut rng = Rng::new(seed, 77);
    let place = [
        rng.range(-100.0, 100.0),
        rng.range(-100.0, 100.0),
        rng.range(-100.0, 100.0),
    ];
    Pose::from_rotation_vector(rng.attitude(), place)
}

/// The truth moved by 0.5 m and turned by 5° about the query's centroid, in seeded directions.
pub fn off(truth: &Pose, query: &Cloud, seed: u64) -> Pose {
    let mut rng = Rng::new(seed, 3);
    let (shift, turn) = (
        rng.direction().map(|v| 0.5 * v),
        rng.direction().map(|v| v * 5f64.to_radians()),
    );
    truth.perturbed(
        shift,
        turn,
        truth.transform(query.centroid().unwrap_or_default()),
    )
}

/// Both halves of the Jinchuan query along the drift, which runs along the map's x there.
pub fn halves(query: &Cloud, truth: &Pose) -> [Cloud; 2] {
    let along: Vec<f64> = query.iter().map(|p| truth.transform(p)[0]).collect();
    let middle = quantile(&along, 0.5);
    [
        part(query, |p| truth.transform(p)[0] < middle),
        part(query, |p| truth.transform(p)[0] >= middle),
    ]
}

/// The share `q` of the way through the sorted values; NaN where there are none.
pub fn quantile(values: &[f64], q: f64) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    let last = v.len().saturating_sub(1);
    v.get((q * last as f64).round() as usize)
        .copied()
        .unwrap_or(f64::NAN)
}

/// How runs of one kind went.
#[derive(Default)]
pub struct Tally {
    pub runs: usize,
    pub located_right: usize,
    pub pose_right: usize,
    pub wrong_accepts: usize,
    pub metres: Vec<f64>,
    pub degrees: Vec<f64>,
    pub inliers: Vec<f64>,
    pub rmse: Vec<f64>,
    pub seconds: Vec<f64>,
}

impl Tally {
    /// Adds a run whose truth is known; right is within 0.5 m and 5°.
    pub fn add(&mut self, outcome: &Outcome, truth: &Pose, query: &Cloud, seconds: f64) {
        self.runs += 1;
        self.seconds.push(seconds);
        let error = outcome.error(truth, query);
        let right = error.is_some_and(|e| e.translation < 0.5 && e.rotation < 5f64.to_radians());
        let located = outcome.verdict == Verdict::Located;
        self.located_right += usize::from(located && right);
        self.wrong_accepts += usize::from(located && !right);
        self.pose_right += usize::from(right);
        if let Some(e) = error.filter(|_| right) {
            self.metres.push(e.translation);
            self.degrees.push(e.rotation.to_degrees());
            self.inliers.extend(outcome.inlier_fraction);
            self.rmse.extend(outcome.inlier_rmse);
        }
    }

    pub const HEAD: &str = "runs | located rightly | wrong accepts | best pose right | error m, median (max) * | error deg, median (max) * | inlier % * | inlier RMSE m * | seconds, median (max)";
    pub const RULE: &str = "---|---|---|---|---|---|---|---|---";

    /// One row; errors and metrics over the runs whose pose was right.
    pub fn row(&self) -> String {
        let pair = |v: &[f64], digits: usize| {
            if v.is_empty() {
                "-".to_owned()
            } else {
                format!(
                    "{:.digits$} ({:.digits$})",
                    quantile(v, 0.5),
                    quantile(v, 1.0)
                )
            }
        };
        let one = |v: &[f64], scale: f64, digits: usize| {
            if v.is_empty() {
                "-".to_owned()
            } else {
                format!("{:.digits$}", scale * quantile(v, 0.5))
            }
        };
        format!(
            "{} | {} | {} | {} | {} | {} | {} | {} | {}",
            self.runs,
            self.located_right,
            self.wrong_accepts,
            self.pose_right,
            pair(&self.metres, 3),
            pair(&self.degrees, 3),
            one(&self.inliers, 100.0, 2),
            one(&self.rmse, 1.0, 4),
            pair(&self.seconds, 2),
        )
    }
}

/// The part of `cloud` for which `keep` holds.
pub fn part(cloud: &Cloud, keep: impl Fn([f64; 3]) -> bool) -> Cloud {
    let indices: Vec<u32> = (0u32..)
        .zip(cloud.iter())
        .filter(|(_, p)| keep(*p))
        .map(|(i, _)| i)
        .collect();
    cloud.select(&indices)
}

pub fn folder_exists(name: &str) -> Result<()> {
    let folder: &Path = &data().join(name);
    if folder.is_dir() {
        return Ok(());
    }
    Err(format!(
        "{}: no such folder; set WINZE_DATA to where the real clouds lie",
        folder.display()
    )
    .into())
}
