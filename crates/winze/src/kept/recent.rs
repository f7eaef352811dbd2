//! The last few of some things.

use std::convert::Infallible;

/// What was made for the last few voxel sizes.
#[derive(Debug)]
pub(super) struct Recent<T> {
    most: usize,
    /// The one last asked for at the end.
    pub(super) held: Vec<(f64, T)>,
}

impl<T> Recent<T> {
    pub(super) fn new(most: usize) -> Self {
        Self {
            most,
            held: Vec::new(),
        }
    }

    pub(super) fn clear(&mut self) {
        self.held.clear();
    }

    pub(super) fn at(&mut self, voxel: f64, make: impl FnOnce() -> T) -> &mut T {
        let made: std::result::Result<_, Infallible> = self.try_at(voxel, || Ok(make()));
        let Ok(made) = made;
        made
    }

    pub(super) fn try_at<E>(
        &mut self,
        voxel: f64,
        make: impl FnOnce() -> std::result::Result<T, E>,
    ) -> std::result::Result<&mut T, E> {
        let known = self
            .held
            .iter()
            .position(|(v, _)| v.to_bits() == voxel.to_bits());
        let entry = match known {
            Some(i) => self.held.remove(i),
            None => {
                // Before the new one is made, so that no more than `most` are ever there.
                if self.held.len() >= self.most {
                    self.held.remove(0);
                }
                (voxel, make()?)
            }
        };
        self.held.push(entry);
        let last = self.held.len() - 1;
        Ok(&mut self.held[last].1)
    }
}
