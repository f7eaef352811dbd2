//! What refiners made of the poses that they were given.

use std::sync::{Arc, Mutex, PoisonError};

use rustc_hash::FxHashMap;

use crate::config::IcpMetric;
use crate::pose::Pose;
use crate::refine::Refined;

/// Where refiners led to on one map. Methods that start from the same poses share them.
#[derive(Debug, Default)]
pub(crate) struct Refinements {
    /// The map's.
    mark: Arc<()>,
    known: Mutex<FxHashMap<(Refiner, [u64; 16]), Refined>>,
}

/// Which refiner; all else that it depends on is in [`Settings`](super::Settings).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Refiner {
    Ndt,
    Icp(IcpMetric),
}

/// Refinements kept; more are forgotten all at once.
const MOST_REFINEMENTS: usize = 10_000;

impl Refinements {
    /// None yet, on the map with this mark.
    pub(super) fn on(mark: &Arc<()>) -> Self {
        Self {
            mark: Arc::clone(mark),
            ..Self::default()
        }
    }

    pub(super) fn are_on(&self, mark: &Arc<()>) -> bool {
        Arc::ptr_eq(&self.mark, mark)
    }

    /// What `work` makes of a start, or made of it before.
    pub(crate) fn get(
        &self,
        refiner: Refiner,
        start: &Pose,
        work: impl FnOnce() -> Refined,
    ) -> Refined {
        let mut bits = [0; 16];
        for (slot, v) in bits.iter_mut().zip(start.to_matrix().iter().flatten()) {
            *slot = v.to_bits();
        }
        let key = (refiner, bits);
        let lock = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().get(&key) {
            return *known;
        }
        let refined = work();
        let mut known = lock();
        if known.len() >= MOST_REFINEMENTS {
            known.clear();
        }
        known.insert(key, refined);
        refined
    }
}
