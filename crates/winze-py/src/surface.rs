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

    #[getter]
    fn origin(&self) -> [f64; 3] {
        self.surface.origin
    }

    /// Points in the cloud's frame.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let origin = self.surface.origin;
        let of =
            |p: &[f32; 3]| -> [f64; 3] { std::array::from_fn(|a| origin[a] + f64::from(p[a])) };
        arrays::rows(py, self.surface.points.iter().map(of).collect())
    }

    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::rows(py, self.surface.normals.to_vec())
    }
}
