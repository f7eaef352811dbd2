//! The Python module `winze._winze`: what `python/winze` is built on.
//!
//! Here arrays become clouds and back, the GIL is released and Ctrl-C is heard; all the work is done by the Rust
//! crates. What people call, with its documentation and types, is in `python/winze`.

mod arrays;
mod cloud;
mod error;
mod evaluate;
mod located;
mod map;
mod schema;
mod settings;
mod simulate;
mod stages;
mod surface;
mod work;

use pyo3::prelude::*;

#[pymodule]
mod _winze {
    #[pymodule_export]
    use super::cloud::{Cloud, read, write, write_text};
    #[pymodule_export]
    use super::evaluate::{evaluate, read_cases};
    #[pymodule_export]
    use super::located::{Drawing, locate};
    #[pymodule_export]
    use super::map::{Map, build, is_built};
    #[pymodule_export]
    use super::schema::config_schema;
    #[pymodule_export]
    use super::settings::{config_text, parse_config};
    #[pymodule_export]
    use super::simulate::{demo, scenarios, simulate};
    #[pymodule_export]
    use super::stages::{
        choose_voxel, estimate_normals, fpfh, icp, inliers, iss_keypoints, match_features, ndt,
        prepare, ransac, remove_outliers, spacing, voxel_downsample,
    };
    #[pymodule_export]
    use super::surface::Surface;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
