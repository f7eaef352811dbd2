//! Scenarios that ship with winze, as the TOML files that anybody could write.

const ALL: &[(&str, &str)] = &[
    ("paper", include_str!("../../scenarios/paper.toml")),
    ("dust", include_str!("../../scenarios/dust.toml")),
    ("aliasing", include_str!("../../scenarios/aliasing.toml")),
    (
        "low-overlap",
        include_str!("../../scenarios/low-overlap.toml"),
    ),
    (
        "long-drift",
        include_str!("../../scenarios/long-drift.toml"),
    ),
    (
        "out-of-map",
        include_str!("../../scenarios/out-of-map.toml"),
    ),
    ("changed", include_str!("../../scenarios/changed.toml")),
];

/// Their names.
pub fn names() -> impl Iterator<Item = &'static str> {
    ALL.iter().map(|(name, _)| *name)
}

/// The TOML text of one.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    ALL.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    #[test]
    fn all_are_sound_and_as_large_as_they_should_be() {
        for name in names() {
            let scenario = Scenario::open(name).unwrap();
            assert_eq!(scenario.name, name);
            let least = if name == "paper" { 6 } else { 200 };
            assert!(scenario.cases() >= least, "{name}: {}", scenario.cases());
        }
        assert!(text("nothing").is_none());
    }
}
