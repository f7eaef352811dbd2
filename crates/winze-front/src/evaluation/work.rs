//! A job done: every method and seed on every case.

use std::path::Path;
use std::time::Instant;

use winze::{Config, KeptMap, KeptQuery, Method, Request, locate_in};
use winze_io::CloudFile;
use winze_map::Map;
use winze_report::evaluation::{Case as Truth, Inliers, MapCost};

use super::cases::Case;
use super::figure;
use super::job::{Job, Said};
use super::judged::judged;
use crate::Prior;
use crate::memory::peak_memory;
use crate::reading::read;

/// Is told what is found; its error ends the work.
type Tell<'a> = dyn FnMut(Said) -> anyhow::Result<()> + 'a;

/// Does a job and tells what it finds as soon as it does. A case that cannot be answered is told of as well, and costs
/// itself alone.
///
/// # Errors
/// Where a method is unknown; and whatever `tell` gives back.
pub fn work(job: &Job, tell: &mut dyn FnMut(Said) -> anyhow::Result<()>) -> anyhow::Result<()> {
    let parsed = job.methods.iter().map(|(name, seeds)| {
        let method: Method = name.parse().map_err(anyhow::Error::msg)?;
        Ok((method, seeds.as_slice()))
    });
    let methods: Vec<(Method, &[u64])> = parsed.collect::<anyhow::Result<_>>()?;
    for cases in job.cases.chunk_by(|a, b| a.map == b.map) {
        let Some(first) = cases.first() else { continue };
        let begun = Instant::now();
        match Opened::open(job, &first.map) {
            Ok(map) => {
                let cost = MapCost {
                    map: first.map.display().to_string(),
                    points: map.prior.points(),
                    read_seconds: begun.elapsed().as_secs_f64(),
                    work_seconds: 0.0,
                };
                on_map(job, &methods, cases, &map, cost, tell)?;
            }
            Err(e) => {
                for case in cases {
                    trouble(case, None, &e, tell)?;
                    over(case, tell)?;
                }
            }
        }
    }
    Ok(())
}

/// A map to ask.
struct Opened {
    prior: Prior,
    /// The same, where it was built beforehand.
    built: Option<Map>,
    /// The settings on it.
    config: Config,
}

impl Opened {
    fn open(job: &Job, path: &Path) -> anyhow::Result<Self> {
        let prior = Prior::open(path)?;
        let built = job.built.iter().find(|(of, _)| of == path);
        let built = built.map(|(_, file)| Map::open(file)).transpose()?;
        let config = match &prior {
            // What was not asked for otherwise is as the map was built.
            Prior::Built(map) => map.adopt_defaults(&job.config)?,
            Prior::Cloud(_) => job.config.clone(),
        };
        Ok(Self {
            prior,
            built,
            config,
        })
    }

    fn kept(&self) -> KeptMap<'_> {
        match (&self.prior, &self.built) {
            (Prior::Cloud(file), Some(built)) => {
                KeptMap::prepared(built).measured_against(&file.cloud)
            }
            _ => self.prior.kept(),
        }
    }
}

/// All cases of one map.
fn on_map(
    job: &Job,
    methods: &[(Method, &[u64])],
    cases: &[Case],
    map: &Opened,
    mut cost: MapCost,
    tell: &mut Tell<'_>,
) -> anyhow::Result<()> {
    let mut kept = map.kept();
    for case in cases {
        match Question::of(case, &mut kept, &map.config) {
            Ok(question) => answer(job, methods, &question, (map, &mut kept), &mut cost, tell)?,
            Err(e) => trouble(case, None, &e, tell)?,
        }
        over(case, tell)?;
    }
    tell(Said::Map {
        cost,
        peak: peak_memory(),
    })
}

/// A case with what its files hold.
struct Question<'a> {
    case: &'a Case,
    truth: Truth,
    query: CloudFile,
    /// The paper's metrics at the truth.
    ceiling: Option<Inliers>,
}

impl<'a> Question<'a> {
    fn of(case: &'a Case, map: &mut KeptMap<'_>, config: &Config) -> anyhow::Result<Self> {
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
        Ok(Self {
            case,
            truth,
            query,
            ceiling,
        })
    }
}

/// All methods and seeds on one case.
fn answer(
    job: &Job,
    methods: &[(Method, &[u64])],
    question: &Question<'_>,
    (map, kept_map): (&Opened, &mut KeptMap<'_>),
    cost: &mut MapCost,
    tell: &mut Tell<'_>,
) -> anyhow::Result<()> {
    let Question {
        case, truth, query, ..
    } = question;
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
                ..map.config.clone()
            };
            let outcome = match locate_in(kept_map, &mut kept, &config, &request) {
                Ok(outcome) => outcome,
                Err(e) => {
                    trouble(case, Some(*method), &e.into(), tell)?;
                    break;
                }
            };
            cost.work_seconds += outcome.map_seconds;
            let mut run = judged(case, truth, query, &outcome, &config.verify);
            run.query_kept = job.keep_query && asked;
            run.ceiling = question.ceiling;
            asked = true;
            tell(Said::Run(Box::new(run)))?;
            let figures = job.figures.as_ref().filter(|_| i == 0);
            if let Some((_, folder)) = figures.filter(|(of, _)| of == method.name())
                && let Err(e) = figure::draw(folder, case, &map.prior, query, &outcome)
            {
                tracing::warn!("{}: no picture: {e:#}", case.name);
            }
        }
    }
    Ok(())
}

fn trouble(
    case: &Case,
    method: Option<Method>,
    e: &anyhow::Error,
    tell: &mut Tell<'_>,
) -> anyhow::Result<()> {
    tell(Said::Trouble {
        case: case.name.clone(),
        method: method.map(|m| m.name().to_owned()),
        message: format!("{e:#}").replace('\n', " "),
    })
}

fn over(case: &Case, tell: &mut Tell<'_>) -> anyhow::Result<()> {
    tell(Said::Over {
        case: case.name.clone(),
        peak: peak_memory(),
    })
}
