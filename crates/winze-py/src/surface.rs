//! A prepared cloud as Python holds it.

use std::sync::Arc;

use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays;

/// Points at one voxel size with normals and a neighbour tree.
#[pyclass(frozen, module = "winze._winze")]
pub(crate) struct Surface {
    pub(crate) surface: Arc<winze::prepare::Surface<'static>>,
}

#[pymethods]
impl Surface {
    fn __len__(&self) -> usize {
        self.surface.points.len()
    }

    #[getter]
    fn voxel(&self) -> f64 {
        self.surface.voxel
    }

    /// Points in the cloud's frame.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        arrays::rows(py, self.surface.iter().collect())
    }

    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::rows(py, self.surface.normals.to_vec())
    }
}
