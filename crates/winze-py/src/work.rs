//! Long work from Python: without the GIL, on threads of its own, and ended by Ctrl-C.
//!
//! The calling thread waits and now and then lets Python look for signals; a signal that raises cancels the work (see
//! [`winze::cancel`]), and so does a progress callback that raises. Pools of threads are kept and lent to one call at a time, so that
//! calls from several Python threads run side by side. A forked process has none of its parent's threads: it makes its own.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::Duration;

use pyo3::exceptions::{PyOSError, PyRuntimeError};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use winze::cancel::{Cancelled, Token, check, until_cancelled, watch};

/// How often signals are looked for.
const TICK: Duration = Duration::from_millis(50);

/// Pools that wait for the next call, at most.
const IDLE: usize = 4;
/// Threads of one that does, at most: more were asked for once, maybe by mistake.
const KEPT: usize = 64;

/// Threads that do one call's work at a time.
struct Workers {
    pool: ThreadPool,
    token: Token,
    /// As asked for; 0: all.
    threads: usize,
    /// The process that started them.
    process: u32,
}

static WAITING: Mutex<Vec<Workers>> = Mutex::new(Vec::new());

/// The pools that wait; nothing where another thread is at them, or was when this process was forked.
fn waiting() -> Option<MutexGuard<'static, Vec<Workers>>> {
    match WAITING.try_lock() {
        Ok(waiting) => Some(waiting),
        Err(TryLockError::Poisoned(e)) => Some(e.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

impl Workers {
    fn borrow(threads: usize) -> PyResult<Self> {
        let process = std::process::id();
        if let Some(mut waiting) = waiting() {
            if waiting.iter().any(|w| w.process != process) {
                // Their threads are in the parent; to wait for their end would be to wait for ever.
                std::mem::forget(std::mem::take(&mut *waiting));
            }
            if let Some(i) = waiting.iter().position(|w| w.threads == threads) {
                return Ok(waiting.remove(i));
            }
        }
        let token = Token::default();
        let own = token.clone();
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("winze {i}"))
            .start_handler(move |_| watch(&own))
            .build()
            .map_err(|e| PyOSError::new_err(format!("cannot start the threads: {e}")))?;
        Ok(Self {
            pool,
            token,
            threads,
            process,
        })
    }

    fn give_back(self) {
        self.token.reset();
        if self.threads > KEPT {
            return;
        }
        if let Some(mut waiting) = waiting() {
            if waiting.len() == IDLE {
                waiting.remove(0);
            }
            waiting.push(self);
        }
    }
}

/// Whom to tell how far the work is.
pub(crate) struct Told<'a> {
    callback: Option<&'a Py<PyAny>>,
    token: Token,
    raised: Mutex<Option<PyErr>>,
}

impl Told<'_> {
    /// Whether anybody listens.
    pub(crate) fn listens(&self) -> bool {
        self.callback.is_some()
    }

    /// Tells what is being done, and the share of all that is over where that is known. Unwinds where the work is cancelled.
    pub(crate) fn say(&self, what: &str, done: Option<f64>) {
        check();
        let Some(callback) = self.callback else {
            return;
        };
        if let Err(e) = Python::attach(|py| callback.call1(py, (what, done)).map(|_| ())) {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(e);
            self.token.cancel();
            check();
        }
    }
}

/// Does `work` on `threads` threads (0: all) with the GIL released.
///
/// # Errors
/// What the work or the callback raised, or `KeyboardInterrupt`.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    threads: usize,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Told<'_>) -> PyResult<T> + Send,
) -> PyResult<T> {
    let workers = Workers::borrow(threads)?;
    let told = Told {
        callback: progress,
        token: workers.token.clone(),
        raised: Mutex::new(None),
    };
    let (done, interrupted) = py.detach(|| {
        let (tell, wait) = sync_channel(1);
        workers.pool.in_place_scope(|scope| {
            let told = &told;
            scope.spawn(move |_| {
                let done = catch_unwind(AssertUnwindSafe(|| until_cancelled(|| work(told))));
                // The other end waits for it.
                let _ = tell.send(done);
            });
            let mut interrupted = None;
            loop {
                match wait.recv_timeout(TICK) {
                    Ok(done) => return (Some(done), interrupted),
                    Err(RecvTimeoutError::Disconnected) => return (None, interrupted),
                    Err(RecvTimeoutError::Timeout) if interrupted.is_none() => {
                        interrupted = signalled();
                        if interrupted.is_some() {
                            workers.token.cancel();
                        }
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    });
    workers.give_back();
    let raised = told
        .raised
        .into_inner()
        .unwrap_or_else(PoisonError::into_inner);
    if let Some(e) = interrupted.or(raised) {
        return Err(e);
    }
    match done {
        Some(Ok(Ok(result))) => result,
        Some(Ok(Err(Cancelled))) => Err(PyRuntimeError::new_err("the work was cancelled")),
        Some(Err(panic)) => {
            let text = panic
                .downcast_ref::<String>()
                .map(String::as_str)
                .or_else(|| panic.downcast_ref::<&str>().copied())
                .unwrap_or("no message");
            Err(PyRuntimeError::new_err(format!(
                "a bug in winze, please report it: {text}"
            )))
        }
        None => Err(PyRuntimeError::new_err("the work ended without a result")),
    }
}

/// What a signal's handler raised meanwhile.
#[expect(
    clippy::redundant_closure_for_method_calls,
    reason = "its lifetime is one, not any"
)]
fn signalled() -> Option<PyErr> {
    Python::attach(|py| py.check_signals()).err()
}
