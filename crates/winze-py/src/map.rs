//! Maps that are prepared once and kept.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use pyo3::exceptions::{PyFileExistsError, PyValueError};
use pyo3::prelude::*;
use winze_front::Facts;
use winze_front::memory::half_of_what_is_free;
use winze_io::{WriteOptions, atomic, write_cloud};
use winze_map::BuildOptions;
use winze_report::Source;

use crate::arrays;
use crate::cloud::Cloud;
use crate::error::{raise, raise_saying};
use crate::work;

/// A built map, mapped from its file or in memory.
#[pyclass(frozen, module = "winze._winze")]
pub(crate) struct Map {
    pub(crate) map: Arc<winze_map::Map>,
    path: Option<PathBuf>,
}

impl Map {
    /// What an outcome says of it.
    pub(crate) fn source(&self) -> Source {
        Source {
            path: self.path.as_ref().map(|p| p.display().to_string()),
            digest: Some(self.map.digest()),
            points: winze::PreparedMap::points(self.map.as_ref()),
        }
    }
}

#[pymethods]
impl Map {
    /// Opens a file; read into memory, or mapped.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf, in_memory: bool) -> PyResult<Self> {
        let open = if in_memory {
            winze_map::Map::read
        } else {
            winze_map::Map::open
        };
        let map = py.detach(|| open(&path)).map_err(raise)?;
        Ok(Self {
            map: Arc::new(map),
            path: Some(path),
        })
    }

    /// Copies its file, whole or not at all.
    fn save(&self, py: Python<'_>, to: PathBuf, replace: bool) -> PyResult<()> {
        let Some(path) = self.path.clone() else {
            return Err(PyValueError::new_err("this map has no file to copy"));
        };
        if to.exists() && !replace {
            return Err(PyFileExistsError::new_err(format!(
                "{}: is there already; replace=True replaces it",
                to.display()
            )));
        }
        let digest = self.map.digest();
        work::run(py, 1, None, |_| {
            let now = winze_map::Map::open(&path).map_err(raise)?.digest();
            if now != digest {
                return Err(PyValueError::new_err(format!(
                    "{}: is another map by now; open it again",
                    path.display()
                )));
            }
            atomic::write(&to, |file| {
                let mut from = std::fs::File::open(&path)?;
                let mut part = vec![0; 1 << 20];
                loop {
                    winze::cancel::check();
                    let n = from.read(&mut part)?;
                    if n == 0 {
                        return Ok(());
                    }
                    file.write_all(part.get(..n).unwrap_or_default())?;
                }
            })
            .map_err(raise)
        })
    }

    #[getter]
    fn path(&self) -> Option<&PathBuf> {
        self.path.as_ref()
    }

    /// What is in it, as JSON.
    fn info(&self) -> PyResult<String> {
        let path = self.path.clone().unwrap_or_default();
        serde_json::to_string(&Facts::of(&path, &self.map)).map_err(raise)
    }

    /// Verifies every byte.
    #[pyo3(signature = (threads, progress))]
    fn check(&self, py: Python<'_>, threads: usize, progress: Option<Py<PyAny>>) -> PyResult<()> {
        let map = self.map.clone();
        work::run(py, threads, progress.as_ref(), |told| {
            #[expect(clippy::cast_precision_loss, reason = "a share")]
            let mut say = |done: u64, all: u64| {
                told.say("verify", Some(done as f64 / all.max(1) as f64));
            };
            map.check(&mut say).map_err(raise)
        })
    }

    /// Points of its finest level, to look at.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let map = self.map.clone();
        let cloud = work::run(py, 0, None, |_| {
            winze_front::prior::drawn(&map).map_err(raise)
        })?;
        arrays::points(py, &cloud, false)
    }
}

/// A cloud to build from.
#[derive(FromPyObject)]
pub(crate) enum Part<'py> {
    Cloud(PyRef<'py, Cloud>),
    File(PathBuf),
}

/// Builds a map's file.
#[pyfunction]
#[pyo3(signature = (parts, out, *, set, crs, replace, memory, scratch, threads, progress))]
#[expect(clippy::too_many_arguments, reason = "named in Python")]
pub(crate) fn build(
    py: Python<'_>,
    parts: Vec<Part<'_>>,
    out: PathBuf,
    set: &str,
    crs: Option<&str>,
    replace: bool,
    memory: Option<u64>,
    scratch: Option<PathBuf>,
    threads: usize,
    progress: Option<Py<PyAny>>,
) -> PyResult<()> {
    let config = crate::settings::config(set, None)?;
    if parts.is_empty() {
        return Err(PyValueError::new_err("clouds: none given"));
    }
    enum Given {
        File(PathBuf),
        Cloud(Arc<winze::Cloud>),
    }
    let given: Vec<Given> = parts
        .iter()
        .map(|part| match part {
            Part::Cloud(cloud) => Given::Cloud(cloud.cloud.clone()),
            Part::File(path) => Given::File(path.clone()),
        })
        .collect();
    work::run(py, threads, progress.as_ref(), |told| {
        // A map is built from files, which are read several times.
        let beside = out.parent().filter(|p| !p.as_os_str().is_empty());
        let place = scratch.as_deref().or(beside).unwrap_or(Path::new("."));
        let folder = tempfile::Builder::new()
            .prefix(".winze-arrays-")
            .tempdir_in(place)
            .map_err(|e| {
                let text = format!("{}: no scratch folder can be made: {e}", place.display());
                raise_saying(&e.into(), text)
            })?;
        let mut clouds = Vec::with_capacity(given.len());
        for (i, given) in given.iter().enumerate() {
            clouds.push(match given {
                Given::File(path) => path.clone(),
                Given::Cloud(cloud) => {
                    let path = folder.path().join(format!("array_{}.pcd", i + 1));
                    write_cloud(&path, cloud, &WriteOptions::default()).map_err(raise)?;
                    // The file is as old as nobody's: equal arrays shall give an equal map.
                    let file = std::fs::File::options()
                        .write(true)
                        .open(&path)
                        .map_err(raise)?;
                    file.set_modified(UNIX_EPOCH - Duration::from_secs(1))
                        .map_err(raise)?;
                    path
                }
            });
        }
        let say = |p: &winze_map::Progress<'_>| told.say(p.step, Some(p.done));
        let options = BuildOptions {
            memory: memory.unwrap_or_else(half_of_what_is_free),
            replace,
            crs,
            scratch: scratch.as_deref(),
            progress: Some(&say),
            ..BuildOptions::default()
        };
        winze_map::build(&clouds, &out, &config, &options)
            .map(|_| ())
            .map_err(|e| {
                // Where an array lay for a while is nobody's business.
                let place = format!("{}/", folder.path().display());
                let text = e.to_string().replace(&place, "");
                raise_saying(&e.into(), text)
            })
    })
}

/// Whether a file is, or says that it is, a built map.
#[pyfunction]
pub(crate) fn is_built(path: PathBuf) -> bool {
    winze_front::prior::is_built(&path)
}
