//! Command lines, as a shell takes them, for whoever wants a run again.

/// The command line of this run.
pub(crate) fn command() -> String {
    let words = std::env::args().skip(1).map(|a| quoted(&a));
    std::iter::once("winze".to_owned())
        .chain(words)
        .collect::<Vec<_>>()
        .join(" ")
}

/// A word as a shell takes it for one.
pub(crate) fn quoted(word: &str) -> String {
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
