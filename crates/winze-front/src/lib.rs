//! What the command line of [winze] and its Python module have in common: from files and settings to an answer and its
//! page, folders of simulated mines, answers over cases.
//!
//! Nothing here prints or keeps anything between calls: what is worth knowing comes back, is told to the caller's
//! closure, or goes to [`tracing`]. Errors are [`anyhow`]'s; the typed ones they came from ([`winze::Error`],
//! [`winze_io::Error`], [`winze_map::Error`], [`std::io::Error`]) are in their chain.

pub mod claim;
pub mod evaluation;
pub mod facts;
pub mod memory;
pub mod mines;
pub mod page;
pub mod prior;
pub mod reading;
pub mod settings;

pub use facts::Facts;
pub use page::Page;
pub use prior::Prior;
pub use settings::Layers;
