//! Methods asked over cases with known truth.
//!
//! [`work`] does a [`Job`] and says what it finds, in whichever process it runs; a [`Gathering`] takes in what is said,
//! so that what broke off stays in every denominator; [`assembled`] makes the [`Evaluation`] of it. [`evaluate`] is all
//! of that in the process that calls it.
//!
//! [`Evaluation`]: winze_report::Evaluation

mod assembled;
pub mod cases;
mod evaluate;
mod figure;
mod gathering;
mod job;
mod judged;
mod text;
mod work;

pub use assembled::{Asked, Found, assembled};
pub use cases::{Case, Choice};
pub use evaluate::evaluate;
pub use figure::figure_name;
pub use gathering::Gathering;
pub use job::{Job, Said, by_map, cost_name, seeds_of};
pub use text::text;
pub use work::work;
