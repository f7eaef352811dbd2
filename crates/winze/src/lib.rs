//! Find a robot in its own map, underground.

pub mod cloud;
pub mod config;
pub mod denoise;
pub mod eigen3;
pub mod error;
pub mod features;
pub mod fit;
pub mod fpfh;
pub mod icp;
pub mod iss;
pub mod kdtree;
pub mod matching;
pub mod ndt;
pub mod normals;
mod parallel;
pub mod pose;
pub mod prepare;
pub mod ransac;
pub mod refine;
pub mod rng;
pub mod scale;
mod solve;
mod symmetric;
#[cfg(test)]
mod test_world;
pub mod voxel;

pub use cloud::Cloud;
pub use config::Config;
pub use error::{Error, Result};
pub use pose::{Pose, PoseDistance};
