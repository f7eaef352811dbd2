//! A bar on the terminal while a run takes longer than a blink.

use std::cell::RefCell;
use std::io::IsTerminal as _;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use winze::outcome::Stage;

/// Runs shorter than this show nothing.
const PATIENCE: Duration = Duration::from_millis(700);

/// Stages a run has at least; more are added as they come.
const STAGES: u64 = 11;

/// Shows which stage is under way. Quiet where stderr is no terminal.
pub(crate) struct Progress {
    state: Mutex<RefCell<State>>,
}

struct State {
    bar: ProgressBar,
    begun: Instant,
    wanted: bool,
    shown: bool,
}

impl Progress {
    pub(crate) fn new(quiet: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(STAGES), ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos:>2}/{len} {msg} {elapsed}") {
            bar.set_style(style);
        }
        let state = State {
            bar,
            begun: Instant::now(),
            wanted: !quiet && std::io::stderr().is_terminal(),
            shown: false,
        };
        Self {
            state: Mutex::new(RefCell::new(state)),
        }
    }

    /// Begins a step with no stages of its own.
    pub(crate) fn say(&self, what: &str) {
        self.told(what, None);
    }

    /// Told by the pipeline of each stage as it begins and ends.
    pub(crate) fn told(&self, name: &str, ended: Option<&Stage>) {
        let Ok(cell) = self.state.lock() else { return };
        let mut state = cell.borrow_mut();
        if let Some(stage) = ended {
            tracing::debug!(
                "{name}: {:.3} s, {} in, {} out",
                stage.seconds,
                stage.count_in,
                stage.count_out
            );
            if state.bar.length() == Some(state.bar.position()) {
                state.bar.inc_length(1);
            }
            state.bar.inc(1);
        } else {
            state.bar.set_message(name.to_owned());
        }
        if state.wanted && !state.shown && state.begun.elapsed() > PATIENCE {
            state.bar.set_draw_target(ProgressDrawTarget::stderr());
            state.bar.enable_steady_tick(Duration::from_millis(120));
            state.shown = true;
        }
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        if let Ok(state) = self.state.lock() {
            state.borrow().bar.finish_and_clear();
        }
    }
}
