//! Simulated mines with exact truth.
//!
//! ```text
//! scenario (TOML) ──> world (or a mesh file) ──> Caster ──> free space ──> ways ──> trajectories
//!                                                  │                                   │ sensor, dust
//!                                                  └───────────────────────────────> scans
//!                                                                                      │ survey, with odometry's drift
//!  cases.json, clouds <── labels (noise-free surface) <────────────────────── maps and queries with their truth
//! ```
//!
//! Everything is seeded and gives the same bits at any thread count.

pub mod cases;
pub mod dust;
pub mod error;
pub mod free_space;
pub mod labels;
pub mod lidar;
pub mod mesh;
pub mod mesh_file;
pub mod mine;
pub mod motion;
pub mod noise;
pub mod raycast;
pub mod scenario;
pub mod scene;
pub mod sensor;
pub mod survey;
pub mod world;

pub use error::{Error, Result};
pub use scene::{Scene, demo};
