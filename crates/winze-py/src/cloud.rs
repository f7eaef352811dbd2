//! A cloud as Python holds it, and cloud files.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use winze_io::{Encoding, ReadOptions, WriteOptions, read_cloud, write_cloud};
use winze_report::Source;

use crate::arrays::{self, Gathered, Rows};
use crate::error::raise;
use crate::work;

/// A cloud that stages and questions share without a copy.
#[pyclass(frozen, module = "winze._winze")]
pub(crate) struct Cloud {
    pub(crate) cloud: Arc<winze::Cloud>,
    /// Rows of the array that it came from.
    rows: usize,
    kept: Option<Vec<u32>>,
    /// Points that are in it no more: not finite, no returns, too far from the rest.
    dropped: [usize; 3],
    single: bool,
    path: Option<PathBuf>,
    digest: Option<String>,
}

impl Cloud {
    /// A cloud that a stage made.
    pub(crate) fn made(cloud: winze::Cloud, single: bool) -> Self {
        Self {
            rows: cloud.len(),
            cloud: Arc::new(cloud),
            kept: None,
            dropped: [0; 3],
            single,
            path: None,
            digest: None,
        }
    }

    /// What an outcome says of it.
    pub(crate) fn source(&self) -> Source {
        Source {
            path: self.path.as_ref().map(|p| p.display().to_string()),
            digest: self.digest.clone(),
            points: self.cloud.len(),
        }
    }

    pub(crate) fn single(&self) -> bool {
        self.single
    }
}

#[pymethods]
impl Cloud {
    /// Of rows of three coordinates; the fourth column is an intensity, or is passed over.
    #[new]
    #[pyo3(signature = (points, fourth_is_intensity, intensity, viewpoint))]
    fn new(
        py: Python<'_>,
        points: Rows<'_>,
        fourth_is_intensity: bool,
        intensity: Option<PyReadonlyArray1<'_, f32>>,
        viewpoint: Option<[f64; 3]>,
    ) -> PyResult<Self> {
        let Gathered {
            mut cloud,
            kept,
            dropped,
            single,
            rows,
        } = points.gather(py, fourth_is_intensity)?;
        if let Some(intensity) = intensity {
            let all = intensity.as_array();
            if all.len() != rows {
                return Err(PyValueError::new_err(format!(
                    "intensity: {} values for {rows} points",
                    all.len()
                )));
            }
            let of: Vec<f32> = match &kept {
                Some(kept) => kept.iter().map(|&i| all[i as usize]).collect(),
                None => all.iter().copied().collect(),
            };
            cloud = cloud.with_intensities(of);
        }
        Ok(Self {
            cloud: Arc::new(cloud.seen_from(viewpoint)),
            rows,
            kept,
            dropped: [dropped.non_finite, 0, dropped.far],
            single,
            path: None,
            digest: None,
        })
    }

    fn __len__(&self) -> usize {
        self.cloud.len()
    }

    /// Points in the cloud's frame, in the precision that they came in unless asked for otherwise.
    #[pyo3(signature = (single=None))]
    fn points<'py>(&self, py: Python<'py>, single: Option<bool>) -> PyResult<Bound<'py, PyAny>> {
        arrays::points(py, &self.cloud, single.unwrap_or(self.single))
    }

    /// Offsets from the origin, a copy.
    fn offsets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let offsets = py.detach(|| self.cloud.points().to_vec());
        Ok(arrays::rows(py, offsets)?.into_any())
    }

    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.cloud.origin()
    }

    #[getter]
    fn viewpoint(&self) -> Option<[f64; 3]> {
        self.cloud.viewpoint()
    }

    #[getter]
    fn intensity<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f32>>> {
        self.cloud.intensity().map(|v| PyArray1::from_slice(py, v))
    }

    #[getter]
    fn is_single(&self) -> bool {
        self.single
    }

    /// Rows of the array that it came from.
    #[getter]
    fn rows(&self) -> usize {
        self.rows
    }

    /// Which of them became points, where not all did.
    #[getter]
    fn kept<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<i64>>> {
        let kept = self.kept.as_ref()?;
        Some(arrays::index_array(py, kept.iter().copied()))
    }

    #[getter]
    fn dropped(&self) -> [usize; 3] {
        self.dropped
    }

    #[getter]
    fn path(&self) -> Option<&PathBuf> {
        self.path.as_ref()
    }

    #[getter]
    fn digest(&self) -> Option<&str> {
        self.digest.as_deref()
    }

    /// Smallest and largest corner, nothing for an empty cloud.
    fn bounds(&self) -> Option<([f64; 3], [f64; 3])> {
        self.cloud.bounds(0.0)
    }

    fn transformed(&self, py: Python<'_>, matrix: [[f64; 4]; 4]) -> PyResult<Self> {
        let pose = arrays::pose(&matrix, "pose")?;
        let moved = py.detach(|| self.cloud.transformed(&pose)).map_err(raise)?;
        // Single precision does not reach far from the origin.
        let single = self.single && moved.origin() == [0.0; 3];
        Ok(Self::made(moved, single))
    }

    /// The same points with another intensity or viewpoint, where one is given.
    #[pyo3(signature = (intensity, viewpoint))]
    fn with_more(
        &self,
        py: Python<'_>,
        intensity: Option<PyReadonlyArray1<'_, f32>>,
        viewpoint: Option<[f64; 3]>,
    ) -> PyResult<Self> {
        let mut cloud = py.detach(|| (*self.cloud).clone());
        if let Some(intensity) = intensity {
            let all = intensity.as_array();
            if all.len() != cloud.len() {
                return Err(PyValueError::new_err(format!(
                    "intensity: {} values for {} points",
                    all.len(),
                    cloud.len()
                )));
            }
            cloud = cloud.with_intensities(all.iter().copied().collect());
        }
        if viewpoint.is_some() {
            cloud = cloud.seen_from(viewpoint);
        }
        Ok(Self {
            cloud: Arc::new(cloud),
            rows: self.rows,
            kept: self.kept.clone(),
            dropped: self.dropped,
            single: self.single,
            path: None,
            digest: None,
        })
    }

    /// The cloud that had these parts, to the bit.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "what `Cloud.__reduce__` gives")]
    fn restored(
        offsets: PyReadonlyArray2<'_, f32>,
        origin: [f64; 3],
        intensity: Option<PyReadonlyArray1<'_, f32>>,
        viewpoint: Option<[f64; 3]>,
        dropped: [usize; 3],
        single: bool,
        path: Option<PathBuf>,
        digest: Option<String>,
    ) -> PyResult<Self> {
        let rows = offsets.as_array();
        let row = |i: usize| std::array::from_fn(|a| rows[[i, a]]);
        if rows.ncols() != 3 {
            return Err(PyValueError::new_err("offsets: (N, 3) is expected"));
        }
        let points = (0..rows.nrows()).map(row).collect();
        let mut cloud = winze::Cloud::with_origin(origin, points).map_err(raise)?;
        if let Some(intensity) = intensity {
            cloud = cloud.with_intensities(intensity.as_array().iter().copied().collect());
        }
        Ok(Self {
            dropped,
            path,
            digest,
            ..Self::made(cloud.seen_from(viewpoint), single)
        })
    }

    /// The points of some rows.
    fn select(&self, py: Python<'_>, rows: PyReadonlyArray1<'_, i64>) -> PyResult<Self> {
        let rows = arrays::indices(&rows.as_array(), self.cloud.len(), "rows")?;
        let chosen = py.detach(|| self.cloud.select(&rows));
        Ok(Self::made(chosen, self.single))
    }
}

/// Reads a cloud file; with what the reader has to tell.
#[pyfunction]
#[pyo3(signature = (path, threads))]
pub(crate) fn read(py: Python<'_>, path: PathBuf, threads: usize) -> PyResult<(Cloud, Py<PyDict>)> {
    let file = work::run(py, threads, None, |_| {
        read_cloud(&path, &ReadOptions::default()).map_err(raise)
    })?;
    let r = file.report;
    let told = PyDict::new(py);
    told.set_item("format", r.format.to_string())?;
    told.set_item("encoding", r.encoding)?;
    told.set_item("points_in_file", r.points_in_file)?;
    told.set_item("fields", r.fields)?;
    told.set_item("organised", r.organised)?;
    told.set_item("warnings", r.warnings)?;
    let cloud = Cloud {
        rows: file.cloud.len(),
        cloud: Arc::new(file.cloud),
        kept: None,
        dropped: [r.non_finite, r.no_returns, r.far],
        single: false,
        path: Some(path),
        digest: Some(r.digest),
    };
    Ok((cloud, told.unbind()))
}

/// Writes a text file, whole or not at all.
#[pyfunction]
pub(crate) fn write_text(py: Python<'_>, path: PathBuf, text: &str) -> PyResult<()> {
    py.detach(|| winze_io::atomic::write_bytes(&path, text.as_bytes()))
        .map_err(raise)
}

/// Writes a cloud file; warnings.
#[pyfunction]
#[pyo3(signature = (path, cloud, encoding, threads))]
pub(crate) fn write(
    py: Python<'_>,
    path: PathBuf,
    cloud: &Cloud,
    encoding: Option<&str>,
    threads: usize,
) -> PyResult<Vec<String>> {
    let encoding: Option<Encoding> = encoding
        .map(|name| {
            name.parse()
                .map_err(|e| PyValueError::new_err(format!("encoding: {e}")))
        })
        .transpose()?;
    let report = work::run(py, threads, None, |_| {
        write_cloud(&path, &cloud.cloud, &WriteOptions { encoding }).map_err(raise)
    })?;
    Ok(report.warnings)
}
