//! Find a robot in its own map, underground.
//!
//! winze answers where a point cloud (the **query**: a submap from LiDAR or depth-camera SLAM, in
//! a frame of its own) lies in a prior map (the **map**), with no initial guess. The answer is a
//! 6-DoF pose `map_from_query` and a [`Verdict`]: here it is, or I don't know, and why.
//!
//! ```
//! use winze::{Cloud, Config, Pose, Verdict};
//! # fn drift(draw: u64) -> Vec<[f64; 3]> {
//! #     let mut rng = winze::rng::Rng::new(draw, 0);
//! #     (0..40_000).map(|_| {
//! #         let (x, a) = (rng.range(0.0, 24.0), rng.range(0.0, 6.283_185));
//! #         let bump = 0.25 * (1.1 * x + (2.0 * a).sin()).sin() + 0.15 * (2.3 * x + 3.0 * a.cos()).sin()
//! #             + 0.1 * (0.7 * x * x / 8.0 + 2.0 * a.sin()).cos();
//! #         let r = 2.0 + bump;
//! #         [x, r * a.cos(), 0.8 * r * a.sin()]
//! #     }).collect()
//! # }
//! # fn main() -> winze::Result<()> {
//! # let (map_points, seen_again) = (drift(1), drift(2));
//! // A prior map, and the same drift seen again in another frame.
//! let (map, _) = Cloud::from_points(&map_points)?;
//! let truth = Pose::from_yaw_pitch_roll(2.0, 0.1, -0.2, [40.0, -12.0, 3.0]);
//! let (query, _) = Cloud::from_points(&seen_again)?;
//! let query = query.transformed(&truth.inverse())?;
//!
//! let outcome = winze::locate(&map, &query, &Config::default())?;
//! assert_eq!(outcome.verdict, Verdict::Located, "{}", outcome.reason);
//! let error = outcome.error(&truth, &query).unwrap();
//! assert!(error.translation < 0.05 && error.rotation < 0.01);
//! # Ok(())
//! # }
//! ```
//!
//! # The pipeline
//!
//! [`locate()`] is the whole of it on one page. Each arrow is a public function that takes references
//! and one section of the [`Config`] and gives back plain data, so that a pipeline of one's own
//! needs nothing else:
//!
//! | stage | function | gives |
//! |---|---|---|
//! | length scale from the data | [`scale::measure`], [`scale::levels`], [`scale::choose`] | voxel sizes |
//! | thin, clean, normals | [`prepare::prepare`] | [`Surface`](prepare::Surface) |
//! | ISS keypoints, FPFH | [`features::describe`] | [`Features`](features::Features) |
//! | nearest descriptors | [`matching::match_descriptors`] | [`Correspondence`](matching::Correspondence)s |
//! | RANSAC; agreement | [`ransac::estimate`]; [`graph::oriented`], [`graph::poses`] | [`Hypothesis`](ransac::Hypothesis)es, best first |
//! | NDT, ICP | [`ndt::align`], [`icp::align`] | [`Refined`](refine::Refined) |
//! | dense evidence, the rock asked, verdict | [`verify::fit`], [`verify::ask_relief`], [`judge::judge`] | [`Verdict`] |
//!
//! Where a map is asked more than once, [`locate_in`] with a [`KeptMap`] does the work on it once; a
//! [`PreparedMap`] keeps it from one day to the next.
//!
//! # What is guaranteed
//!
//! * The same input, configuration and seed give the same bits, at any number of threads and on
//!   any processor: randomness is seeded, float sums run in a fixed order, and transcendental functions do
//!   not come from the platform.
//! * No input makes it panic. What cannot be located is a [`Verdict`], what cannot be used an [`Error`].
//! * Coordinates far from the origin (UTM) keep a millimetre: see [`Cloud`].
//! * Work runs on the rayon pool that the caller is in; the library starts no threads of its own. Where its threads
//!   [watch a token](cancel), the work can be stopped.
//!
//! Metres, radians and seconds; right-handed frames; `a_from_b` takes points of frame b to frame a.

pub mod base;
pub mod bend;
pub mod cancel;
pub mod cloud;
pub mod columns;
pub mod confidence;
pub mod config;
pub mod covariance;
pub mod degeneracy;
pub mod denoise;
pub mod descriptor_index;
pub mod eigen3;
pub mod error;
pub mod features;
pub mod fit;
pub mod fpfh;
pub mod graph;
pub mod icp;
pub mod iss;
pub mod judge;
pub mod kdtree;
pub mod kept;
mod line;
pub mod locate;
pub mod matching;
pub mod method;
pub mod metrics;
pub mod ndt;
mod neighbours;
pub mod normals;
pub mod outcome;
mod paper;
mod parallel;
pub mod part;
pub mod pose;
pub mod prepare;
pub mod prepared;
pub mod ransac;
pub mod refine;
mod region;
pub mod relief;
mod request;
pub mod rng;
pub mod scale;
mod search;
mod simd;
pub mod solve;
pub mod spacing;
mod symmetric;
#[cfg(test)]
mod test_world;
pub mod vec3;
pub mod verify;
pub mod voxel;

pub use cloud::Cloud;
pub use config::Config;
pub use error::{Error, Result};
pub use kept::{KeptMap, KeptQuery};
pub use locate::{Request, locate, locate_by, locate_in, locate_traced};
pub use method::Method;
pub use outcome::{Outcome, Verdict};
pub use part::MapPart;
pub use pose::{Pose, PoseDistance};
pub use prepared::PreparedMap;
