//! Simulated mines with exact truth.
//!
//! A mine is a solid block with drifts cut out of it, given by its signed distance; a LiDAR is
//! carried through the drifts and its rays are followed to the rock. Everything is seeded and gives
//! the same bits at any thread count.

pub mod lidar;
pub mod mine;
pub mod noise;
pub mod scene;

pub use scene::{Scene, demo};
