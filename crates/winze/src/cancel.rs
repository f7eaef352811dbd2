//! Stopping work that nobody waits for any more.
//!
//! A caller that may lose patience (a person at a notebook) runs the work on threads that [`watch`] a [`Token`]. Once
//! it is cancelled, whatever those threads do for winze ends soon, wherever it is: loops look at the token every
//! thousand points or so, and unwind. Nobody else pays but a thread-local look a chunk.
//!
//! ```
//! use winze::cancel::{Cancelled, Token, until_cancelled, watch};
//!
//! let token = Token::default();
//! let own = token.clone();
//! let pool = rayon::ThreadPoolBuilder::new().start_handler(move |_| watch(&own)).build().unwrap();
//! token.cancel();
//! let (cloud, _) = winze::Cloud::from_points(&vec![[0.0; 3]; 5000]).unwrap();
//! let tree = winze::kdtree::KdTree::build(cloud.points());
//! let done = pool.install(|| until_cancelled(|| winze::denoise::statistical(cloud.points(), &tree, 12, 3.0)));
//! assert_eq!(done, Err(Cancelled));
//! ```

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Tells threads that [`watch`] it to stop. Clones are the same token.
#[derive(Debug, Clone, Default)]
pub struct Token(Arc<AtomicBool>);

impl Token {
    /// Ends the work of the threads that watch.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it is cancelled.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Lets the threads that watch work again.
    pub fn reset(&self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

/// Work that was cancelled; there is no result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

thread_local! {
    static WATCHED: RefCell<Option<Token>> = const { RefCell::new(None) };
}

/// From now on this thread's work for winze ends when `token` is cancelled. For all threads of a pool: in its start
/// handler.
pub fn watch(token: &Token) {
    WATCHED.set(Some(token.clone()));
}

/// Unwinds, to the next [`until_cancelled`], where the token that this thread watches is cancelled. Loops of winze do
/// so by themselves; a callback that they call may do it too.
pub fn check() {
    if WATCHED.with_borrow(|token| token.as_ref().is_some_and(Token::is_cancelled)) {
        // No panic: the hook is not told, nothing is printed.
        resume_unwind(Box::new(Cancelled));
    }
}

/// Does some work; [`Cancelled`] where that was ended by a token. Any other panic goes on.
///
/// # Errors
/// [`Cancelled`].
pub fn until_cancelled<R>(work: impl FnOnce() -> R) -> Result<R, Cancelled> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| {
        if payload.is::<Cancelled>() {
            Cancelled
        } else {
            resume_unwind(payload)
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_world::{cloud, drift};
    use crate::{Config, locate};

    fn pool(token: &Token) -> rayon::ThreadPool {
        let own = token.clone();
        rayon::ThreadPoolBuilder::new()
            .num_threads(2)
            .start_handler(move |_| watch(&own))
            .build()
            .unwrap()
    }

    fn walls(draw: u64) -> crate::Cloud {
        cloud(&drift(30_000, 24.0, 0.3, 0.005, draw))
    }

    #[test]
    fn cancelled_work_ends_and_the_threads_work_again() {
        let token = Token::default();
        let pool = pool(&token);
        let (map, query) = (walls(1), walls(2));
        let run = || pool.install(|| until_cancelled(|| locate(&map, &query, &Config::default())));
        let whole = run().unwrap().unwrap();
        token.cancel();
        assert_eq!(run().unwrap_err(), Cancelled);
        token.reset();
        let again = run().unwrap().unwrap();
        assert_eq!(whole.map_from_query, again.map_from_query);
    }

    #[test]
    fn it_ends_in_the_middle_too() {
        let token = Token::default();
        let pool = pool(&token);
        let (map, query) = (walls(1), walls(2));
        let told = std::sync::Mutex::new(Vec::new());
        let progress = |name: &str, stage: Option<&crate::outcome::Stage>| {
            if stage.is_none() {
                told.lock().unwrap().push(name.to_owned());
            }
            if name == "describe map" {
                token.cancel();
            }
        };
        let request = crate::Request {
            progress: Some(&progress),
            ..Default::default()
        };
        let done = pool.install(|| {
            until_cancelled(|| crate::locate_by(&map, &query, &Config::default(), &request))
        });
        assert_eq!(done.unwrap_err(), Cancelled);
        assert_eq!(told.into_inner().unwrap().last().unwrap(), "describe map");
    }

    #[test]
    fn other_panics_are_not_swallowed() {
        let other = catch_unwind(|| until_cancelled(|| resume_unwind(Box::new("other"))));
        assert!(other.unwrap_err().is::<&str>());
        check();
    }
}
