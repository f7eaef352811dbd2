//! Command lines, for a page and for whoever wants a run again.

use std::fmt::Write as _;
use std::path::Path;

use super::cases::Case;
use crate::args::{Eval, Global};

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

/// The command line of this run.
pub(super) fn command() -> String {
    let words = std::env::args().skip(1).map(|a| quoted(&a));
    std::iter::once("winze".to_owned())
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}

/// A word as a shell takes it for one.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "_-./=+,:@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_a_shell() {
        assert_eq!(quoted("paper/cloud_1"), "paper/cloud_1");
        assert_eq!(quoted("fpfh.radius=3 voxels"), "'fpfh.radius=3 voxels'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
