//! Find a robot in its own map, underground.

pub mod cloud;
pub mod eigen3;
pub mod error;
pub mod fit;
pub mod kdtree;
mod parallel;
pub mod pose;
pub mod rng;
mod symmetric;
pub mod voxel;

pub use cloud::Cloud;
pub use error::{Error, Result};
pub use pose::{Pose, PoseDistance};
