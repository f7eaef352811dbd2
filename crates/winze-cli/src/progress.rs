//! A bar on the terminal while a run takes longer than a blink.

use std::io::{self, IsTerminal as _, Write};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use winze::outcome::Stage;

/// Runs shorter than this show nothing.
const PATIENCE: Duration = Duration::from_millis(700);

/// Steps of a bar for a share.
const SHARES: u64 = 1000;

/// The bar on the terminal, if one is up: whoever writes to stderr has it step aside.
static SHOWN: Mutex<Option<ProgressBar>> = Mutex::new(None);

/// Shows which stage is under way. Quiet where stderr is no terminal. Goes away when it is dropped.
pub(crate) struct Progress {
    bar: ProgressBar,
    over: Arc<Mutex<bool>>,
}

impl Progress {
    /// A bar for a run of about `steps` stages; more are added as they come.
    pub(crate) fn new(quiet: bool, steps: u64) -> Self {
        Self::styled(quiet, steps, "{bar:24} {pos:>2}/{len} {msg} {elapsed}")
    }

    /// A bar for a known number of things of a kind, with the time that is left.
    pub(crate) fn counted(quiet: bool, things: usize) -> Self {
        let things = u64::try_from(things).unwrap_or(u64::MAX);
        let template = "{bar:24} {pos}/{len}, {elapsed}, {eta} left: {msg}";
        Self::styled(quiet, things, template)
    }

    /// A bar for work that tells what share of it is done, with the time that is left.
    pub(crate) fn shared(quiet: bool) -> Self {
        Self::styled(
            quiet,
            SHARES,
            "{bar:24} {percent} %, {elapsed}, {eta} left: {msg}",
        )
    }

    /// This share of the work is done, and something is being done.
    pub(crate) fn share(&self, what: &str, done: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_precision_loss,
            clippy::cast_sign_loss,
            reason = "a share of a small number"
        )]
        let at = (done.clamp(0.0, 1.0) * SHARES as f64) as u64;
        if self.bar.position() != at {
            self.bar.set_position(at);
        }
        if self.bar.message() != what {
            self.say(what);
        }
    }

    fn styled(quiet: bool, steps: u64, template: &str) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        let progress = Self {
            bar,
            over: Arc::default(),
        };
        if !quiet && io::stderr().is_terminal() {
            progress.show_later();
        }
        progress
    }

    fn show_later(&self) {
        let (bar, over) = (self.bar.clone(), Arc::clone(&self.over));
        std::thread::spawn(move || {
            std::thread::sleep(PATIENCE);
            // Held until the bar is up, so that it cannot come up after the end.
            let Ok(over) = over.lock() else { return };
            if !*over {
                bar.set_draw_target(ProgressDrawTarget::stderr());
                bar.enable_steady_tick(Duration::from_millis(120));
                if let Ok(mut shown) = SHOWN.lock() {
                    *shown = Some(bar);
                }
            }
        });
    }

    /// Begins a step with no stages of its own.
    pub(crate) fn say(&self, what: &str) {
        self.bar.set_message(what.to_owned());
    }

    /// Begins a step, with so many done before it.
    pub(crate) fn at(&self, what: &str, done: u64) {
        self.bar.set_position(done);
        self.say(what);
    }

    /// One of the things of [`Progress::counted`] is done.
    pub(crate) fn step(&self, what: &str) {
        self.say(what);
        self.bar.inc(1);
    }

    /// Told by the pipeline of each stage as it begins and ends.
    pub(crate) fn told(&self, name: &str, ended: Option<&Stage>) {
        let Some(stage) = ended else {
            return self.say(name);
        };
        tracing::debug!(
            "{name}: {:.3} s, {} in, {} out",
            stage.seconds,
            stage.count_in,
            stage.count_out
        );
        if self.bar.length() == Some(self.bar.position()) {
            self.bar.inc_length(1);
        }
        self.bar.inc(1);
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        if let Ok(mut over) = self.over.lock() {
            *over = true;
        }
        if let Ok(mut shown) = SHOWN.lock() {
            *shown = None;
        }
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}

/// Standard error, which the bar leaves alone while something is written.
#[derive(Default)]
pub(crate) struct BesideTheBar;

impl Write for BesideTheBar {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let bar = SHOWN.lock().ok().and_then(|shown| shown.clone());
        let write = || io::stderr().lock().write_all(bytes);
        match bar {
            Some(bar) => bar.suspend(write),
            None => write(),
        }
        .map(|()| bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().lock().flush()
    }
}
