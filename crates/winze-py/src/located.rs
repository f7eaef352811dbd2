//! One answer, and what is drawn of it.

use std::borrow::Cow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use winze::locate::{Near, Progress};
use winze::outcome::Stage;
use winze::{Config, KeptMap, KeptQuery, Method, Outcome, PoseDistance, Request};
use winze_front::{Page, prior, settings};
use winze_report::{Document, Source};

use crate::arrays;
use crate::cloud::Cloud;
use crate::error::raise;
use crate::map::Map;
use crate::work;

/// A prior map: a cloud, or one that was built.
#[derive(FromPyObject)]
pub(crate) enum Prior<'py> {
    Cloud(PyRef<'py, Cloud>),
    Built(PyRef<'py, Map>),
}

/// The same, to keep.
enum Asked {
    Cloud(Arc<winze::Cloud>),
    Built(Arc<winze_map::Map>),
}

impl Prior<'_> {
    fn asked(&self) -> Asked {
        match self {
            Self::Cloud(cloud) => Asked::Cloud(cloud.cloud.clone()),
            Self::Built(map) => Asked::Built(map.map.clone()),
        }
    }

    fn source(&self) -> Source {
        match self {
            Self::Cloud(cloud) => cloud.source(),
            Self::Built(map) => map.source(),
        }
    }
}

impl Asked {
    fn kept(&self) -> KeptMap<'_> {
        match self {
            Self::Cloud(cloud) => KeptMap::new(cloud),
            Self::Built(map) => KeptMap::prepared(map.as_ref()),
        }
    }

    fn built(&self) -> Option<&winze_map::Map> {
        match self {
            Self::Cloud(_) => None,
            Self::Built(map) => Some(map),
        }
    }

    fn drawn(&self) -> anyhow::Result<Cow<'_, winze::Cloud>> {
        Ok(match self {
            Self::Cloud(cloud) => Cow::Borrowed(cloud),
            Self::Built(map) => Cow::Owned(prior::drawn(map)?),
        })
    }
}

/// What pictures and the page are made of, when they are wanted.
#[pyclass(frozen, module = "winze._winze")]
pub(crate) struct Drawing {
    map: Asked,
    query: Arc<winze::Cloud>,
    outcome: Outcome,
    error: Option<PoseDistance>,
    document: Document,
    config: Config,
    command: String,
}

#[pymethods]
impl Drawing {
    /// Before and after, as PNG.
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let png = work::run(py, 0, None, |_| {
            let map = self.map.drawn().map_err(raise)?;
            winze_report::before_and_after(&map, &self.query, &self.outcome).map_err(raise)
        })?;
        Ok(PyBytes::new(py, &png))
    }

    /// The report.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        work::run(py, 0, None, |_| {
            let map = self.map.drawn().map_err(raise)?;
            let (mut kept_map, mut kept_query) = (self.map.kept(), KeptQuery::new(&self.query));
            let kept = (&mut kept_map, &mut kept_query);
            let page = Page::of(
                &map,
                kept,
                &self.outcome,
                &self.config,
                self.command.clone(),
            )
            .map_err(raise)?;
            let png =
                winze_report::before_and_after(&map, &self.query, &self.outcome).map_err(raise)?;
            Ok(page.html(&self.outcome, self.error.as_ref(), &self.document, &png))
        })
    }

    /// The answer for people, as the command line prints it.
    fn summary(&self) -> String {
        winze_report::summary(&self.outcome, self.error.as_ref())
    }
}

/// Finds a query in a map: the outcome's document, and what it can be drawn from.
#[pyfunction]
#[pyo3(signature = (map, query, *, method, set, seed, initial, gravity_aligned, near, truth, command, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "named in Python")]
pub(crate) fn locate(
    py: Python<'_>,
    map: Prior<'_>,
    query: &Cloud,
    method: &str,
    set: &str,
    seed: Option<u64>,
    initial: Option<[[f64; 4]; 4]>,
    gravity_aligned: bool,
    near: Option<[f64; 4]>,
    truth: Option<[[f64; 4]; 4]>,
    command: String,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Drawing)> {
    let method: Method = method
        .parse()
        .map_err(|e| PyValueError::new_err(format!("method: {e}")))?;
    let read = |matrix: Option<[[f64; 4]; 4]>, what: &str| {
        matrix.map(|m| arrays::pose(&m, what)).transpose()
    };
    let (initial, truth) = (read(initial, "initial")?, read(truth, "truth")?);
    if initial.is_some() && method.uses_features() {
        return Err(PyValueError::new_err(format!(
            "initial: the method {method} does not start from a pose; give method=\"ndt+icp\", or near to say roughly where"
        )));
    }
    let near = near.map(|[x, y, z, radius]| Near {
        centre: [x, y, z],
        radius,
    });
    if near.is_some_and(|n| {
        !(n.radius > 0.0 && n.radius.is_finite() && n.centre.iter().all(|c| c.is_finite()))
    }) {
        return Err(PyValueError::new_err(
            "near: give x, y, z and a radius above 0, in metres of the map's frame",
        ));
    }
    let (source, query_source) = (map.source(), query.source());
    let (map, query) = (map.asked(), query.cloud.clone());
    let config = crate::settings::seeded(set, map.built(), seed)?;
    let digest = settings::digest(&config).map_err(raise)?;
    let steps = method.stages();
    let (outcome, asked) = work::run(py, threads, progress.as_ref(), |told| {
        let over = AtomicU64::new(0);
        let say = |name: &str, stage: Option<&Stage>| {
            // More than one voxel size may be tried.
            #[expect(clippy::cast_precision_loss, reason = "a few")]
            let share = (over.load(Ordering::Relaxed) as f64 / steps as f64).min(1.0);
            match stage {
                None => told.say(name, Some(share)),
                Some(_) => {
                    over.fetch_add(1, Ordering::Relaxed);
                }
            }
        };
        let request = Request {
            method,
            initial,
            gravity_aligned,
            near,
            progress: told.listens().then_some(&say as &Progress<'_>),
        };
        let (mut kept_map, mut kept_query) = (map.kept(), KeptQuery::new(&query));
        let outcome =
            winze::locate_in(&mut kept_map, &mut kept_query, &config, &request).map_err(raise)?;
        told.say("done", Some(1.0));
        Ok((outcome, (&request).into()))
    })?;
    let error = truth.and_then(|t| outcome.error(&t, &query));
    let document = Document::new(
        &outcome,
        error.as_ref(),
        asked,
        digest,
        source,
        query_source,
    );
    let text = document.to_json();
    let drawing = Drawing {
        map,
        query,
        outcome,
        error,
        document,
        config,
        command,
    };
    Ok((text, drawing))
}
