//! Command lines that give one run of an evaluation again.

use std::fmt::Write as _;
use std::path::Path;

use winze_front::evaluation::Case;

use crate::args::{Eval, Global};
use crate::command::quoted;

/// Command lines that give one run again: as it was judged, and by `locate`.
pub(super) fn again(
    args: &Eval,
    global: &Global,
    case: &Case,
    method: &str,
    seed: u64,
) -> Vec<String> {
    let mut settings = format!(" --method {method} --seed {seed}");
    if let Some(path) = &global.config {
        let _ = write!(
            settings,
            " --config {}",
            quoted(&path.display().to_string())
        );
    }
    for set in &global.set {
        let _ = write!(settings, " --set {}", quoted(set));
    }
    let path = |p: &Path| quoted(&p.display().to_string());
    let upright = if case.gravity_aligned {
        " --gravity-aligned"
    } else {
        ""
    };
    vec![
        format!(
            "winze eval {} --only {}{settings}",
            path(&args.cases),
            quoted(&case.name)
        ),
        format!(
            "winze locate {} {}{upright}{settings}",
            path(&case.map),
            path(&case.query)
        ),
    ]
}
