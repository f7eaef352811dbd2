//! NumPy arrays to clouds and back.

use numpy::ndarray::{ArrayView1, ArrayView2};
use numpy::{Element, IntoPyArray as _, PyArray1, PyArray2, PyArrayMethods as _, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use winze::cloud::{Dropped, offset};
use winze::{Cloud, Pose};

use crate::error::raise;

/// Rows of an array that has more than one dimension, `f32` or `f64`, in any layout that its element type can be read in.
#[derive(FromPyObject)]
pub(crate) enum Rows<'py> {
    /// Single precision.
    F32(PyReadonlyArray2<'py, f32>),
    /// Double precision.
    F64(PyReadonlyArray2<'py, f64>),
}

/// A cloud, and where its points were in the array.
pub(crate) struct Gathered {
    pub(crate) cloud: Cloud,
    /// Rows of the array that became points, where some did not.
    pub(crate) kept: Option<Vec<u32>>,
    pub(crate) dropped: Dropped,
    /// Whether it came in single precision.
    pub(crate) single: bool,
    /// Rows of the array.
    pub(crate) rows: usize,
}

impl Rows<'_> {
    /// The cloud of three coordinates a row, and an intensity, if that is what the fourth column is. The rows are read in
    /// place, whatever their order and strides; the cloud is the only copy.
    ///
    /// The GIL is released meanwhile, as NumPy does in its own loops: who writes to the array at that time gets some of both.
    pub(crate) fn gather(&self, py: Python<'_>, intensity: bool) -> PyResult<Gathered> {
        match self {
            // `as_slice` of NumPy's side calls Fortran order contiguous as well and would give the points
            // transposed; ndarray's tells the two apart.
            Self::F32(rows) => {
                let rows = rows.as_array();
                py.detach(|| gather(&rows, intensity, f64::from, |v| v, true))
            }
            Self::F64(rows) => {
                let rows = rows.as_array();
                #[expect(clippy::cast_possible_truncation, reason = "an intensity")]
                py.detach(|| gather(&rows, intensity, |v| v, |v| v as f32, false))
            }
        }
    }
}

fn gather<T: Copy + Sync>(
    rows: &ArrayView2<'_, T>,
    intensity: bool,
    wide: impl Fn(T) -> f64 + Copy + Sync,
    narrow: impl Fn(T) -> f32 + Copy + Sync,
    single: bool,
) -> PyResult<Gathered> {
    let (count, columns) = rows.dim();
    let expected = if intensity { 4 } else { 3 };
    if columns < expected {
        return Err(PyValueError::new_err(format!(
            "points of shape ({count}, {columns}) where (N, {expected}) is expected"
        )));
    }
    let of = intensity.then_some(|i: usize| narrow(rows[[i, 3]]));
    let point = |i: usize| -> [f64; 3] { std::array::from_fn(|a| wide(rows[[i, a]])) };
    // Rows that follow each other in memory are read faster.
    let contiguous = rows.as_slice().filter(|_| columns == 3);
    let (cloud, dropped) = match contiguous.map(|all| all.as_chunks::<3>().0) {
        Some(rows) => Cloud::gather(count, |i| rows[i].map(wide), of),
        None => Cloud::gather(count, point, of),
    }
    .map_err(raise)?;
    let kept = (cloud.len() < count).then(|| {
        let origin = cloud.origin();
        let stays = |i: &u32| offset(point(*i as usize), origin).is_some();
        (0u32..).take(count).filter(stays).collect()
    });
    Ok(Gathered {
        cloud,
        kept,
        dropped,
        single,
        rows: count,
    })
}

/// Rows of `N` numbers as an array, without a copy.
pub(crate) fn rows<T: Element, const N: usize>(
    py: Python<'_>,
    values: Vec<[T; N]>,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = values.len();
    PyArray1::from_vec(py, values.into_flattened()).reshape([count, N])
}

/// The points of a cloud in its own frame, `(N, 3)`, in single precision or in double.
pub(crate) fn points<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    single: bool,
) -> PyResult<Bound<'py, PyAny>> {
    if single {
        #[expect(clippy::cast_possible_truncation, reason = "asked for")]
        let narrow = || {
            if cloud.origin() == [0.0; 3] {
                cloud.points().to_vec()
            } else {
                cloud.iter().map(|p| p.map(|v| v as f32)).collect()
            }
        };
        return Ok(rows(py, py.detach(narrow))?.into_any());
    }
    Ok(rows(py, py.detach(|| cloud.iter().collect()))?.into_any())
}

/// A 4x4 matrix that must be a rigid transform, `map_from_query`.
pub(crate) fn pose(matrix: &[[f64; 4]; 4], what: &str) -> PyResult<Pose> {
    Pose::from_matrix(*matrix).map_err(|e| PyValueError::new_err(format!("{what}: {e}")))
}

/// A pose as a 4x4 array.
pub(crate) fn matrix<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Bound<'py, PyArray2<f64>>> {
    rows(py, pose.to_matrix().to_vec())
}

/// Indices that must lie in a cloud of `count` points, as Python gives them.
pub(crate) fn indices(given: &ArrayView1<'_, i64>, count: usize, what: &str) -> PyResult<Vec<u32>> {
    let one = |&i: &i64| {
        u32::try_from(i)
            .ok()
            .filter(|i| (*i as usize) < count)
            .ok_or_else(|| {
                PyValueError::new_err(format!(
                    "{what}: {i} is no row of {count}; rows count from 0"
                ))
            })
    };
    given.iter().map(one).collect()
}

/// Indices as NumPy indexes with.
pub(crate) fn index_array(
    py: Python<'_>,
    values: impl Iterator<Item = u32>,
) -> Bound<'_, PyArray1<i64>> {
    values.map(i64::from).collect::<Vec<i64>>().into_pyarray(py)
}
