//! One method over all cases, in a process of its own, so that its memory is its own; or several, which share work.
//!
//! The job comes as JSON on stdin, what is found goes as one JSON line each to stdout.

use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::Context as _;
use serde::{Deserialize, Serialize};
use winze::confidence::{Evidence, evidence};
use winze::config::VerifyConfig;
use winze::{Config, KeptMap, KeptQuery, Method, Outcome, Pose, Request, locate_in};
use winze_front::Prior;
use winze_front::reading::read;
use winze_io::{CloudFile, atomic};
use winze_map::Map;
use winze_report::evaluation::{Case as Truth, Inliers, MapCost, PoseError, Run, mark};

use super::cases::Case;

/// What a worker is to do.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Job {
    /// The methods' names, each with its seeds.
    pub(super) methods: Vec<(String, Vec<u64>)>,
    pub(super) config: Config,
    /// Keep the work on a query from seed to seed and from method to method: sooner done, but the seconds are too
    /// few.
    pub(super) keep_query: bool,
    /// Folder for a picture of each case, before and after one of the methods.
    pub(super) figures: Option<(String, PathBuf)>,
    /// Maps that were built beforehand, by the clouds they were made of.
    pub(super) built: Vec<(PathBuf, PathBuf)>,
    /// Cases on one map stand together.
    pub(super) cases: Vec<Case>,
}

/// What a worker says.
#[derive(Debug, Serialize, Deserialize)]
#[serde(tag = "said", rename_all = "snake_case")]
pub(super) enum Said {
    /// One run is over.
    Run(Box<Run>),
    /// A case gives no answer by a method, or by any.
    Trouble {
        case: String,
        method: Option<String>,
        message: String,
    },
    /// All runs of a case are over; with the most memory held so far, bytes.
    Over { case: String, peak: Option<u64> },
    /// All cases of a map are over; with the most memory held so far, bytes.
    Map { cost: MapCost, peak: Option<u64> },
}

pub(crate) fn run() -> anyhow::Result<ExitCode> {
    let job: Job = serde_json::from_reader(io::stdin().lock()).context("eval-worker: its job")?;
    let parsed = job.methods.iter().map(|(name, seeds)| {
        let method: Method = name.parse().map_err(anyhow::Error::msg)?;
        Ok((method, seeds.as_slice()))
    });
    let methods: Vec<(Method, &[u64])> = parsed.collect::<anyhow::Result<_>>()?;
    for cases in job.cases.chunk_by(|a, b| a.map == b.map) {
        let begun = Instant::now();
        let built = |cloud: &Path| job.built.iter().find(|(of, _)| of == cloud);
        let open = |case: &Case| -> anyhow::Result<(Prior, Option<Map>)> {
            let built = built(&case.map).map(|(_, file)| Map::open(file));
            Ok((Prior::open(&case.map)?, built.transpose()?))
        };
        let (map, built) = match cases.first().map(open) {
            Some(Ok(map)) => map,
            Some(Err(e)) => {
                for case in cases {
                    trouble(case, None, &e)?;
                    over(case)?;
                }
                continue;
            }
            None => continue,
        };
        let mut cost = MapCost {
            map: cases
                .first()
                .map_or_else(String::new, |c| c.map.display().to_string()),
            points: map.points(),
            read_seconds: begun.elapsed().as_secs_f64(),
            work_seconds: 0.0,
        };
        let config = match &map {
            // What was not asked for otherwise is as the map was built.
            Prior::Built(map) => map.adopt_defaults(&job.config)?,
            Prior::Cloud(_) => job.config.clone(),
        };
        let mut kept = match (&map, &built) {
            (Prior::Cloud(file), Some(built)) => {
                KeptMap::prepared(built).measured_against(&file.cloud)
            }
            _ => map.kept(),
        };
        for case in cases {
            if let Err(e) = answer(
                (&job, &config),
                &methods,
                case,
                (&map, &mut kept),
                &mut cost,
            ) {
                // Nobody listens any more.
                if crate::output::is_broken_pipe(&e) {
                    return Err(e);
                }
                trouble(case, None, &e)?;
            }
            over(case)?;
        }
        say(&Said::Map {
            cost,
            peak: peak_memory(),
        })?;
    }
    Ok(ExitCode::SUCCESS)
}

/// All methods and seeds on one case.
fn answer(
    (job, config): (&Job, &Config),
    methods: &[(Method, &[u64])],
    case: &Case,
    (prior, map): (&Prior, &mut KeptMap<'_>),
    cost: &mut MapCost,
) -> anyhow::Result<()> {
    let truth = case.truth()?;
    let query = read(&case.query)?;
    let ceiling = truth.truth.as_ref().map(|pose| {
        let metrics = map.inliers(&query.cloud, pose, &config.verify)?;
        anyhow::Ok(Inliers {
            fraction: metrics.fraction,
            rmse: metrics.rmse,
        })
    });
    let ceiling = ceiling.transpose()?;
    let mut kept = KeptQuery::new(&query.cloud);
    let mut asked = false;
    for (method, seeds) in methods {
        let request = Request {
            method: *method,
            gravity_aligned: case.gravity_aligned,
            ..Request::default()
        };
        for (i, &seed) in seeds.iter().enumerate() {
            if !job.keep_query {
                kept = KeptQuery::new(&query.cloud);
            }
            let config = Config {
                seed,
                ..config.clone()
            };
            let outcome = match locate_in(map, &mut kept, &config, &request) {
                Ok(outcome) => outcome,
                Err(e) => {
                    trouble(case, Some(*method), &e.into())?;
                    break;
                }
            };
            cost.work_seconds += outcome.map_seconds;
            let mut run = judged(case, &truth, &query, &outcome, &config.verify);
            run.query_kept = job.keep_query && asked;
            run.ceiling = ceiling;
            asked = true;
            say(&Said::Run(Box::new(run)))?;
            let figures = job.figures.as_ref().filter(|_| i == 0);
            if let Some((_, folder)) = figures.filter(|(of, _)| of == method.name())
                && let Err(e) = figure(folder, case, prior, &query, &outcome)
            {
                tracing::warn!("{}: no picture: {e:#}", case.name);
            }
        }
    }
    Ok(())
}

/// What an outcome's confidence rests on; nothing without a pose.
fn evidence_of(outcome: &Outcome, verify: &VerifyConfig) -> Option<Evidence> {
    let lead = outcome.hypotheses.first()?;
    evidence(
        outcome.verdict,
        lead.relief,
        outcome.unobservable.is_some(),
        verify,
    )
}

/// An outcome held against the truth.
fn judged(
    case: &Case,
    truth: &Truth,
    query: &CloudFile,
    outcome: &Outcome,
    verify: &VerifyConfig,
) -> Run {
    let centroid = query.cloud.centroid().unwrap_or_default();
    let open = outcome.unobservable.as_deref().unwrap_or_default();
    let worth = |pose: Option<&Pose>| mark(truth, outcome.verdict, pose, open, centroid);
    Run {
        case: case.name.clone(),
        family: case.family.clone(),
        sensor: case.sensor.clone(),
        overlap: case.overlap,
        method: outcome.method.to_owned(),
        seed: outcome.seed,
        verdict: Some(outcome.verdict),
        reason: outcome.reason.clone(),
        map_from_query: outcome.map_from_query.as_ref().map(Pose::to_matrix),
        mark: worth(outcome.map_from_query.as_ref()),
        confidence: outcome.confidence,
        evidence: evidence_of(outcome, verify),
        patches: outcome
            .hypotheses
            .first()
            .and_then(|h| h.relief)
            .map(|r| [r.asked, r.confirmed]),
        pose_error: truth.truth.as_ref().and_then(|truth| {
            let (pose, covariance) = (outcome.map_from_query?, outcome.covariance()?);
            let information = outcome.information.as_ref();
            PoseError::of(&pose, &covariance, information, truth, centroid)
        }),
        hypotheses: outcome.hypotheses.len(),
        truth_weighed: truth.truth.is_some().then(|| {
            let mut places = outcome.hypotheses.iter();
            places.any(|h| worth(Some(&h.map_from_query)).pose_right)
        }),
        inliers: outcome.inlier_fraction.map(|fraction| Inliers {
            fraction,
            rmse: outcome.inlier_rmse,
        }),
        ceiling: None,
        voxel: outcome.voxel,
        seconds: outcome.seconds - outcome.map_seconds,
        query_kept: false,
        again: Vec::new(),
    }
}

fn figure(
    folder: &Path,
    case: &Case,
    map: &Prior,
    query: &CloudFile,
    outcome: &Outcome,
) -> anyhow::Result<()> {
    let png = winze_report::before_and_after(map.picture()?.as_ref(), &query.cloud, outcome)?;
    Ok(atomic::write_bytes(
        &folder.join(figure_name(&case.name)),
        &png,
    )?)
}

/// The file of a case's picture.
pub(super) fn figure_name(case: &str) -> String {
    case.replace(['/', '\\', ':'], "_") + ".png"
}

fn trouble(case: &Case, method: Option<Method>, e: &anyhow::Error) -> anyhow::Result<()> {
    say(&Said::Trouble {
        case: case.name.clone(),
        method: method.map(|m| m.name().to_owned()),
        message: format!("{e:#}").replace('\n', " "),
    })
}

fn over(case: &Case) -> anyhow::Result<()> {
    say(&Said::Over {
        case: case.name.clone(),
        peak: peak_memory(),
    })
}

fn say(said: &Said) -> anyhow::Result<()> {
    let mut line = serde_json::to_vec(said)?;
    line.push(b'\n');
    let mut out = io::stdout().lock();
    out.write_all(&line)
        .and_then(|()| out.flush())
        .context("eval-worker: stdout")
}

/// The most memory that this process held, bytes; `None` where the system does not tell (it does on
/// Linux).
fn peak_memory() -> Option<u64> {
    high_water(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn high_water(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kib.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_memory_is_read_from_the_kernel_s_text() {
        let status = "Name:\twinze\nVmPeak:\t  9000 kB\nVmHWM:\t    1234 kB\n";
        assert_eq!(high_water(status), Some(1234 * 1024));
        assert_eq!(high_water("Name:\twinze\n"), None);
        #[cfg(target_os = "linux")]
        assert!(peak_memory().unwrap() > 1 << 20);
    }

    #[test]
    fn what_a_worker_says_is_understood() {
        let said = Said::Map {
            cost: MapCost::default(),
            peak: Some(7),
        };
        let text = serde_json::to_string(&said).unwrap();
        assert!(text.starts_with(r#"{"said":"map""#), "{text}");
        assert!(matches!(
            serde_json::from_str(&text).unwrap(),
            Said::Map { peak: Some(7), .. }
        ));
    }
}
