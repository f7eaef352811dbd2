//! How long something takes, and how much memory.

use std::fs;
use std::hint::black_box;
use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};

/// How often a stage runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Plan {
    /// Once to warm up, then so many times.
    Timed(usize),
    /// Once and nothing else, in [`counted`].
    Once,
}

/// What was measured of a stage.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Figures {
    /// Wall time of each run, seconds.
    pub(crate) wall: Vec<f64>,
    /// User and system time of the process over each run, seconds.
    pub(crate) cpu: Vec<f64>,
    /// Resident memory just before the warm-up, bytes.
    pub(crate) rss_before: u64,
    /// The largest since, bytes.
    pub(crate) rss_peak: u64,
}

/// Runs stages and keeps what was measured of the last one.
#[derive(Debug)]
pub(crate) struct Bench {
    plan: Plan,
    pub(crate) figures: Figures,
}

impl Bench {
    pub(crate) fn new(plan: Plan) -> Self {
        Self {
            plan,
            figures: Figures::default(),
        }
    }

    /// Runs `work` as planned and gives back what its last run gave. Results are dropped outside of the measured time, each before the next
    /// is made.
    pub(crate) fn run<T>(
        &mut self,
        mut work: impl FnMut() -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        let repeat = match self.plan {
            Plan::Once => return counted(&mut work),
            Plan::Timed(repeat) => repeat,
        };
        forget_peak();
        let mut figures = Figures {
            rss_before: memory("VmRSS:"),
            ..Figures::default()
        };
        let mut last = black_box(work()?);
        for _ in 0..repeat {
            drop(last);
            let (wall, cpu) = (Instant::now(), cpu_seconds());
            last = black_box(work()?);
            figures.cpu.push(cpu_seconds() - cpu);
            figures.wall.push(wall.elapsed().as_secs_f64());
        }
        figures.rss_peak = memory("VmHWM:");
        self.figures = figures;
        Ok(last)
    }
}

/// Instructions are counted in here: callgrind is told its name by `bench/instructions`.
#[inline(never)]
fn counted<T>(work: &mut dyn FnMut() -> anyhow::Result<T>) -> anyhow::Result<T> {
    black_box(work())
}

/// User and system time of all threads of the process so far, seconds.
fn cpu_seconds() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    #[expect(clippy::cast_precision_loss, reason = "seconds of a process")]
    let seconds = t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64;
    seconds
}

/// One line of what the system tells of the process's memory, bytes; 0 where it does not.
fn memory(line: &str) -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    of_status(&status, line).unwrap_or(0)
}

fn of_status(status: &str, line: &str) -> Option<u64> {
    let value = status.lines().find_map(|l| l.strip_prefix(line))?;
    let kilobytes: u64 = value.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kilobytes)
}

/// Lets the largest resident memory count from now on.
fn forget_peak() {
    // Where that is refused the figure stays what it was before, which `rss_before` shows.
    let _ = fs::write("/proc/self/clear_refs", "5");
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn every_run_but_the_first_is_timed_and_the_last_result_stays() {
        let mut bench = Bench::new(Plan::Timed(3));
        let mut runs = 0;
        let last = bench.run(|| {
            runs += 1;
            let begun = Instant::now();
            while begun.elapsed().as_millis() < 20 {}
            Ok(runs)
        });
        assert_eq!(last.unwrap(), 4);
        assert_eq!((bench.figures.wall.len(), bench.figures.cpu.len()), (3, 3));
        assert!(bench.figures.wall.iter().all(|s| *s >= 0.02));
        assert!(bench.figures.cpu.iter().all(|s| *s > 0.0));
    }

    #[test]
    fn once_is_once() {
        let mut bench = Bench::new(Plan::Once);
        let mut runs = 0;
        bench
            .run(|| {
                runs += 1;
                Ok(())
            })
            .unwrap();
        assert_eq!(runs, 1);
        assert_eq!(bench.figures, Figures::default());
    }

    #[test]
    fn a_failed_run_is_an_error() {
        let mut bench = Bench::new(Plan::Timed(2));
        assert!(
            bench
                .run(|| -> anyhow::Result<()> { anyhow::bail!("no") })
                .is_err()
        );
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn memory_taken_in_a_run_is_seen_at_the_peak() {
        let mut bench = Bench::new(Plan::Timed(1));
        let size = 64 << 20;
        bench.run(|| Ok(black_box(vec![1u8; size]).len())).unwrap();
        let f = &bench.figures;
        assert!(
            f.rss_before > 0 && f.rss_peak >= f.rss_before + (size as u64) * 9 / 10,
            "{f:?}"
        );
    }

    #[test]
    fn status_lines_are_read() {
        let status = "VmPeak:\t  200 kB\nVmHWM:\t     12 kB\nVmRSS:\t 7 kB\n";
        assert_eq!(of_status(status, "VmHWM:"), Some(12 * 1024));
        assert_eq!(of_status(status, "VmSwap:"), None);
    }
}
