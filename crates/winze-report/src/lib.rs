//! What winze found, for people and for programs: a picture before and after, a page, a summary on the
//! terminal, the outcome as JSON.

pub mod canvas;
pub mod document;
pub mod page;
pub mod picture;
pub mod summary;

pub use document::{Asked, Document, Source};
pub use page::page;
pub use picture::before_and_after;
pub use summary::summary;

/// What can go wrong when a picture is made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The PNG encoder refused.
    #[error("cannot encode the picture: {0}")]
    Png(#[from] png::EncodingError),
}
