//! The stages, one function each.

use std::borrow::Cow;
use std::sync::Arc;

use numpy::{IntoPyArray as _, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use winze::config::Orientation;
use winze::features::Features;
use winze::fpfh::{DIMENSIONS, Descriptor, descriptors};
use winze::iss;
use winze::kdtree::KdTree;
use winze::matching::{Correspondence, match_descriptors};
use winze::refine::Refined;
use winze::{Config, Pose, icp as icp_stage, ndt as ndt_stage, prepare as prepare_stage};

use crate::arrays::{self, index_array};
use crate::cloud::Cloud;
use crate::settings::config;
use crate::surface::Surface;
use crate::work;

type Prepared = prepare_stage::Surface<'static>;

/// Points with a tree, or such as need one yet.
#[derive(FromPyObject)]
pub(crate) enum Points<'py> {
    Cloud(PyRef<'py, Cloud>),
    Surface(PyRef<'py, Surface>),
}

/// The same, without Python.
enum Looked {
    Cloud(Arc<winze::Cloud>),
    Surface(Arc<Prepared>),
}

impl Points<'_> {
    fn looked(&self) -> Looked {
        match self {
            Self::Cloud(cloud) => Looked::Cloud(cloud.cloud.clone()),
            Self::Surface(surface) => Looked::Surface(surface.surface.clone()),
        }
    }
}

impl Looked {
    fn points(&self) -> &[[f32; 3]] {
        match self {
            Self::Cloud(cloud) => cloud.points(),
            Self::Surface(surface) => &surface.points,
        }
    }

    fn tree(&self) -> Cow<'_, KdTree<'_>> {
        match self {
            Self::Cloud(cloud) => Cow::Owned(KdTree::build(cloud.points())),
            Self::Surface(surface) => Cow::Borrowed(&surface.tree),
        }
    }
}

/// Median distance from a point to the nearest other, metres.
#[pyfunction]
#[pyo3(signature = (cloud, threads))]
pub(crate) fn spacing(py: Python<'_>, cloud: &Cloud, threads: usize) -> PyResult<Option<f64>> {
    let cloud = cloud.cloud.clone();
    work::run(py, threads, None, |_| {
        Ok(winze::spacing::spacing(cloud.points()))
    })
}

/// The voxel size at which a query is best compared with a map, metres.
#[pyfunction]
#[pyo3(signature = (map, query, threads))]
pub(crate) fn choose_voxel(
    py: Python<'_>,
    map: &Cloud,
    query: &Cloud,
    threads: usize,
) -> PyResult<f64> {
    let (map, query) = (map.cloud.clone(), query.cloud.clone());
    work::run(py, threads, None, move |_| {
        let measure = |cloud: &winze::Cloud, what: &str| {
            winze::scale::measure(cloud).ok_or_else(|| {
                PyValueError::new_err(format!(
                    "{what}: no two points apart, so no voxel size suits it"
                ))
            })
        };
        let (map, query) = (measure(&map, "map")?, measure(&query, "query")?);
        Ok(winze::scale::voxel_for(&map, &query))
    })
}

/// One point a voxel.
#[pyfunction]
#[pyo3(signature = (cloud, voxel, threads))]
pub(crate) fn voxel_downsample(
    py: Python<'_>,
    cloud: &Cloud,
    voxel: f64,
    threads: usize,
) -> PyResult<Cloud> {
    positive(voxel, "voxel")?;
    let (own, single) = (cloud.cloud.clone(), cloud.single());
    let thinned = work::run(py, threads, None, |_| {
        Ok(winze::voxel::downsample(&own, voxel))
    })?;
    Ok(Cloud::made(thinned, single))
}

fn positive(length: f64, what: &str) -> PyResult<()> {
    if length > 0.0 && length.is_finite() {
        return Ok(());
    }
    Err(PyValueError::new_err(format!(
        "{what}: {length} is no length above 0; give metres"
    )))
}

/// Rows of the points that stay.
#[pyfunction]
#[pyo3(signature = (cloud, set, voxel, threads))]
pub(crate) fn remove_outliers<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    set: &str,
    voxel: f64,
    threads: usize,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    positive(voxel, "voxel")?;
    let (cloud, config) = (cloud.cloud.clone(), config(set, None)?);
    let kept = work::run(py, threads, None, |_| {
        Ok(prepare_stage::confirmed(&cloud, &config.prepare, voxel))
    })?;
    Ok(index_array(py, kept.into_iter()))
}

/// A unit normal a point, zero where it is undefined.
#[pyfunction]
#[pyo3(signature = (cloud, set, voxel, viewpoint, threads))]
pub(crate) fn estimate_normals<'py>(
    py: Python<'py>,
    cloud: &Cloud,
    set: &str,
    voxel: f64,
    viewpoint: Option<[f64; 3]>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    positive(voxel, "voxel")?;
    let (cloud, mut config) = (cloud.cloud.clone(), config(set, None)?);
    if viewpoint.is_some() {
        config.prepare.orientation = Orientation::Auto;
    }
    let normals = work::run(py, threads, None, |_| {
        Ok(prepare_stage::normals(
            &cloud,
            &config.prepare,
            voxel,
            viewpoint,
        ))
    })?;
    arrays::rows(py, normals)
}

/// Thinned, cleaned, with normals and a tree.
#[pyfunction]
#[pyo3(signature = (cloud, set, voxel, threads))]
pub(crate) fn prepare(
    py: Python<'_>,
    cloud: &Cloud,
    set: &str,
    voxel: f64,
    threads: usize,
) -> PyResult<Surface> {
    positive(voxel, "voxel")?;
    let (cloud, config) = (cloud.cloud.clone(), config(set, None)?);
    let surface = work::run(py, threads, None, |_| {
        Ok(prepare_stage::prepare(&cloud, &config.prepare, voxel))
    })?;
    Ok(Surface {
        surface: Arc::new(surface),
    })
}

/// Rows, saliency, and how many passed the test.
type FoundKeypoints<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f32>>, usize);

/// ISS keypoints.
#[pyfunction]
#[pyo3(signature = (points, set, voxel, threads))]
pub(crate) fn iss_keypoints<'py>(
    py: Python<'py>,
    points: Points<'_>,
    set: &str,
    voxel: f64,
    threads: usize,
) -> PyResult<FoundKeypoints<'py>> {
    positive(voxel, "voxel")?;
    let (looked, config) = (points.looked(), config(set, None)?);
    let found = work::run(py, threads, None, |_| {
        Ok(iss::keypoints(
            looked.points(),
            &looked.tree(),
            &config.iss,
            voxel,
        ))
    })?;
    Ok((
        index_array(py, found.indices.into_iter()),
        found.saliency.into_pyarray(py),
        found.qualified,
    ))
}

/// FPFH descriptors at some rows, or at all.
#[pyfunction]
#[pyo3(signature = (points, normals, keypoints, set, voxel, threads))]
pub(crate) fn fpfh<'py>(
    py: Python<'py>,
    points: Points<'_>,
    normals: Option<PyReadonlyArray2<'_, f32>>,
    keypoints: Option<PyReadonlyArray1<'_, i64>>,
    set: &str,
    voxel: f64,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    positive(voxel, "voxel")?;
    let (looked, config) = (points.looked(), config(set, None)?);
    let count = looked.points().len();
    let normals: Cow<'_, [[f32; 3]]> = match (&normals, &looked) {
        (Some(normals), _) => {
            let rows = normals.as_array();
            if rows.dim() != (count, 3) {
                return Err(PyValueError::new_err(format!(
                    "normals: shape {:?} where ({count}, 3) is expected, one a point",
                    rows.dim()
                )));
            }
            let row = |i: usize| std::array::from_fn(|a| rows[[i, a]]);
            Cow::Owned((0..count).map(row).collect())
        }
        (None, Looked::Surface(surface)) => Cow::Borrowed(&*surface.normals),
        (None, Looked::Cloud(_)) => {
            return Err(PyValueError::new_err(
                "normals: none; give those of estimate_normals, or a Surface, which has its own",
            ));
        }
    };
    #[expect(clippy::cast_possible_truncation, reason = "a cloud's size")]
    let keypoints: Vec<u32> = match keypoints {
        Some(rows) => arrays::indices(&rows.as_array(), count, "keypoints")?,
        None => (0..count as u32).collect(),
    };
    let found = work::run(py, threads, None, |_| {
        let tree = looked.tree();
        Ok(descriptors(
            looked.points(),
            &normals,
            &tree,
            &keypoints,
            &config.fpfh,
            voxel,
        ))
    })?;
    arrays::rows(py, found)
}

fn read_descriptors(given: &PyReadonlyArray2<'_, f32>, what: &str) -> PyResult<Vec<Descriptor>> {
    let rows = given.as_array();
    let (count, columns) = rows.dim();
    if columns != DIMENSIONS {
        return Err(PyValueError::new_err(format!(
            "{what}: shape ({count}, {columns}) where (N, {DIMENSIONS}) is expected, an FPFH descriptor a row"
        )));
    }
    let row = |i: usize| std::array::from_fn(|a| rows[[i, a]]);
    Ok((0..count).map(row).collect())
}

/// Pairs of rows, and how far apart their descriptors are.
type Matched<'py> = (Bound<'py, PyArray2<i64>>, Bound<'py, PyArray1<f32>>);

/// Nearest descriptors.
#[pyfunction]
#[pyo3(signature = (query, map, set, threads))]
pub(crate) fn match_features<'py>(
    py: Python<'py>,
    query: PyReadonlyArray2<'_, f32>,
    map: PyReadonlyArray2<'_, f32>,
    set: &str,
    threads: usize,
) -> PyResult<Matched<'py>> {
    let (query, map) = (
        read_descriptors(&query, "query")?,
        read_descriptors(&map, "map")?,
    );
    let config = config(set, None)?;
    let found = work::run(py, threads, None, |_| {
        Ok(match_descriptors(&query, &map, &config.matching))
    })?;
    let pairs: Vec<[i64; 2]> = found
        .iter()
        .map(|c| [i64::from(c.query), i64::from(c.map)])
        .collect();
    let distances: Vec<f32> = found.iter().map(|c| c.distance).collect();
    Ok((arrays::rows(py, pairs)?, distances.into_pyarray(py)))
}

/// A pose, its inlier correspondences and their RMSE.
type Supported<'py> = (Bound<'py, PyArray2<f64>>, usize, f64);

/// Poses from correspondences by sampling, the best first; and how many samples were drawn.
#[pyfunction]
#[pyo3(signature = (query, map, pairs, set, voxel, seed, threads))]
#[expect(clippy::too_many_arguments, reason = "named in Python")]
pub(crate) fn ransac<'py>(
    py: Python<'py>,
    query: &Cloud,
    map: &Cloud,
    pairs: PyReadonlyArray2<'_, i64>,
    set: &str,
    voxel: f64,
    seed: u64,
    threads: usize,
) -> PyResult<(Vec<Supported<'py>>, u64)> {
    positive(voxel, "voxel")?;
    let config = config(set, None)?;
    let pairs = pairs.as_array();
    if pairs.ncols() != 2 {
        return Err(PyValueError::new_err(format!(
            "correspondences: shape {:?} where (K, 2) is expected: a row of the query's keypoints and one of the map's",
            pairs.dim()
        )));
    }
    let of_query = arrays::indices(
        &pairs.column(0),
        query.cloud.len(),
        "correspondences, query",
    )?;
    let of_map = arrays::indices(&pairs.column(1), map.cloud.len(), "correspondences, map")?;
    let mut correspondences: Vec<Correspondence> = of_query
        .into_iter()
        .zip(of_map)
        .map(|(query, map)| Correspondence {
            query,
            map,
            distance: 0.0,
        })
        .collect();
    // A keypoint's own stand together, as matching leaves them.
    correspondences.sort_by_key(|c| c.query);
    let features = |cloud: &winze::Cloud| Features {
        origin: cloud.origin(),
        points: Cow::Owned(cloud.points().to_vec()),
        ..Features::default()
    };
    let (query, map) = (query.cloud.clone(), map.cloud.clone());
    let found = work::run(py, threads, None, |_| {
        Ok(winze::ransac::estimate(
            &correspondences,
            &features(&query),
            &features(&map),
            &config.ransac,
            voxel,
            seed,
            &|_| true,
        ))
    })?;
    let one = |h: &winze::ransac::Hypothesis| -> PyResult<_> {
        Ok((arrays::matrix(py, &h.map_from_query)?, h.inliers, h.rmse))
    };
    let hypotheses = found.hypotheses.iter().map(one).collect::<PyResult<_>>()?;
    Ok((hypotheses, found.samples))
}

/// Pose, why it stopped, iterations, pairs, and the information matrix with the point that it is about.
type Aligned<'py> = (
    Bound<'py, PyArray2<f64>>,
    String,
    usize,
    usize,
    Bound<'py, PyArray2<f64>>,
    [f64; 3],
);

fn aligned<'py>(py: Python<'py>, refined: &Refined) -> PyResult<Aligned<'py>> {
    let stop = serde_json::to_value(refined.stop).map_err(crate::error::raise)?;
    Ok((
        arrays::matrix(py, &refined.map_from_query)?,
        stop.as_str().unwrap_or_default().to_owned(),
        refined.iterations,
        refined.pairs,
        arrays::rows(py, refined.information.matrix.to_vec())?,
        refined.information.about,
    ))
}

/// Refinement of a start pose on two surfaces.
fn refine<'py>(
    py: Python<'py>,
    (map, query): (&Surface, &Surface),
    start: &[[f64; 4]; 4],
    set: &str,
    threads: usize,
    by: impl FnOnce(&Prepared, &Prepared, &Pose, &Config) -> Refined + Send,
) -> PyResult<Aligned<'py>> {
    let (start, config) = (arrays::pose(start, "initial")?, config(set, None)?);
    let (map, query) = (map.surface.clone(), query.surface.clone());
    let refined = work::run(py, threads, None, |_| Ok(by(&map, &query, &start, &config)))?;
    aligned(py, &refined)
}

/// Refinement by NDT.
#[pyfunction]
#[pyo3(signature = (map, query, start, set, threads))]
pub(crate) fn ndt<'py>(
    py: Python<'py>,
    map: &Surface,
    query: &Surface,
    start: [[f64; 4]; 4],
    set: &str,
    threads: usize,
) -> PyResult<Aligned<'py>> {
    refine(
        py,
        (map, query),
        &start,
        set,
        threads,
        |map, query, start, config| {
            let levels = ndt_stage::levels(map, &config.ndt);
            ndt_stage::align(&levels, map, query, start, &config.ndt)
        },
    )
}

/// Refinement by ICP.
#[pyfunction]
#[pyo3(signature = (map, query, start, set, threads))]
pub(crate) fn icp<'py>(
    py: Python<'py>,
    map: &Surface,
    query: &Surface,
    start: [[f64; 4]; 4],
    set: &str,
    threads: usize,
) -> PyResult<Aligned<'py>> {
    refine(
        py,
        (map, query),
        &start,
        set,
        threads,
        |map, query, start, config| icp_stage::align(map, query, start, &config.icp),
    )
}

/// The paper's inlier share and RMSE at a pose.
#[pyfunction]
#[pyo3(signature = (map, query, pose, distance, threads))]
pub(crate) fn inliers(
    py: Python<'_>,
    map: &Cloud,
    query: &Cloud,
    pose: [[f64; 4]; 4],
    distance: f64,
    threads: usize,
) -> PyResult<(f64, Option<f64>)> {
    let pose = arrays::pose(&pose, "pose")?;
    positive(distance, "distance")?;
    let (map, query) = (map.cloud.clone(), query.cloud.clone());
    let found = work::run(py, threads, None, |_| {
        let tree = KdTree::build(map.points());
        Ok(winze::metrics::inliers(
            &tree,
            map.origin(),
            &query,
            &pose,
            distance,
        ))
    })?;
    Ok((found.fraction, found.rmse))
}
