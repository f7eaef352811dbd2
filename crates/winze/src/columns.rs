//! Where long columns of numbers are kept while a map is made.
//!
//! A map of a whole mine does not fit in memory beside its neighbours' work. What grows with it is kept in
//! columns that somebody else provides: [`Memory`] for a cloud at hand, a mapped scratch file for
//! a map under construction. The algorithms are the same, and so are the bits.

use std::convert::Infallible;
use std::ops::DerefMut;

use zerocopy::{FromBytes, Immutable, IntoBytes};

/// Numbers, or arrays of them, that are nothing but their bytes.
pub trait Plain: Copy + Send + Sync + FromBytes + IntoBytes + Immutable + 'static {}

impl<T: Copy + Send + Sync + FromBytes + IntoBytes + Immutable + 'static> Plain for T {}

/// Who provides columns.
pub trait Columns: Sync {
    /// Why a column could not be had.
    type Error: Send;
    /// A column; it is gone when dropped.
    type Column<T: Plain>: DerefMut<Target = [T]> + Send + Sync;

    /// A column of `len` zeros.
    ///
    /// # Errors
    /// Where there is no room for it.
    fn zeros<T: Plain>(&self, len: usize) -> Result<Self::Column<T>, Self::Error>;
}

/// Columns in memory.
#[derive(Debug, Clone, Copy, Default)]
pub struct Memory;

impl Columns for Memory {
    type Error = Infallible;
    type Column<T: Plain> = Vec<T>;

    fn zeros<T: Plain>(&self, len: usize) -> Result<Vec<T>, Infallible> {
        Ok(vec![T::new_zeroed(); len])
    }
}
