//! What winze found, for people and for programs: a picture before and after, a page, a summary on the
//! terminal, the outcome as JSON.

pub mod canvas;
pub mod contact_sheet;
pub mod criteria;
pub mod document;
pub mod evaluation;
pub mod page;
pub mod picture;
pub mod scene;
pub mod summary;
pub mod table;
pub mod thumbnail;

pub use contact_sheet::{Thumb, contact_sheet};
pub use document::{Asked, Document, Source};
pub use evaluation::{Evaluation, evaluation_page};
pub use page::{Report, page};
pub use picture::{before_and_after, thin};
pub use scene::{Judged, Limits, Scene, scene, scene_of_run};
pub use summary::summary;
pub use table::Table;
pub use thumbnail::thumbnail;

/// What can go wrong when a picture is made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The PNG encoder refused.
    #[error("cannot encode the picture: {0}")]
    Png(#[from] png::EncodingError),
    /// The plotting library refused.
    #[error("cannot draw the diagram: {0}")]
    Plot(String),
}
