//! Which columns of a file hold the coordinates and the intensity.

/// Names under which an intensity goes, best first, in lower case and without CloudCompare's
/// `scalar_`. A bare `i` comes last: it may as well be the number of the point.
const INTENSITY: [&str; 7] = [
    "intensity",
    "intensities",
    "reflectance",
    "reflectivity",
    "remission",
    "amplitude",
    "i",
];

/// Indices of the columns that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Columns {
    pub(crate) xyz: [usize; 3],
    pub(crate) intensity: Option<usize>,
}

impl Columns {
    /// Finds `x`, `y`, `z` (in any case) and an intensity among `names`. The error says what is
    /// there instead.
    pub(crate) fn find(names: &[String]) -> Result<Self, String> {
        let lower: Vec<String> = names
            .iter()
            .map(|n| {
                n.to_ascii_lowercase()
                    .trim_start_matches("scalar_")
                    .to_owned()
            })
            .collect();
        let position = |wanted: &str| {
            names
                .iter()
                .position(|n| n == wanted)
                .or_else(|| lower.iter().position(|n| n == wanted))
        };
        let (Some(x), Some(y), Some(z)) = (position("x"), position("y"), position("z")) else {
            let there = match names.len() {
                0 => "none".to_owned(),
                _ => shortened(&names.join(", "), 100),
            };
            return Err(format!(
                "the columns are {there}; a cloud needs columns named x, y and z"
            ));
        };
        Ok(Self {
            xyz: [x, y, z],
            intensity: INTENSITY.into_iter().find_map(position),
        })
    }

    /// Reads the wanted columns of one line. Returns them with the number of tokens seen, all of
    /// them if `all`, else only as many as needed.
    pub(crate) fn pick<'a>(
        &self,
        tokens: impl Iterator<Item = &'a [u8]>,
        number: impl Fn(&[u8]) -> Option<f64>,
    ) -> Result<(Row, usize), String> {
        let mut row = Row::default();
        let mut seen = 0;
        for token in tokens {
            let axis = self.xyz.iter().position(|&c| c == seen);
            if axis.is_some() || self.intensity == Some(seen) {
                let value =
                    number(token).ok_or_else(|| format!("'{}' is not a number", excerpt(token)))?;
                match axis.and_then(|a| row.point.get_mut(a)) {
                    Some(slot) => *slot = value,
                    None => row.intensity = value as f32,
                }
            }
            seen += 1;
        }
        Ok((row, seen))
    }

    /// How many columns a line must have at least.
    pub(crate) fn needed(&self) -> usize {
        let last = self.xyz.iter().copied().chain(self.intensity).max();
        last.map_or(0, |c| c + 1)
    }
}

/// The wanted values of one line.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Row {
    pub(crate) point: [f64; 3],
    pub(crate) intensity: f32,
}

/// At most 60 characters of `bytes`, all of them printable.
pub(crate) fn excerpt(bytes: &[u8]) -> String {
    let bytes = bytes.trim_ascii();
    shortened(
        &String::from_utf8_lossy(bytes.get(..240).unwrap_or(bytes)),
        60,
    )
}

/// At most `limit` characters, all of them printable, with an ellipsis where something is missing.
pub(crate) fn shortened(text: &str, limit: usize) -> String {
    let clean = text.chars().map(|c| if c.is_control() { '?' } else { c });
    let mut out: String = clean.take(limit).collect();
    if text.chars().nth(limit).is_some() {
        out.pop();
        out.push('…');
    }
    out
}

/// A column's name as it is kept and shown.
pub(crate) fn name(text: &str) -> String {
    shortened(text, 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &str) -> Vec<String> {
        list.split(' ').map(str::to_owned).collect()
    }

    #[test]
    fn names_are_found_in_any_order_and_case() {
        let found = Columns::find(&names("ring Z y X scalar_Intensity")).unwrap();
        assert_eq!((found.xyz, found.intensity), ([3, 2, 1], Some(4)));
        assert_eq!(found.needed(), 5);
        // An exact name goes before one that differs in case.
        assert_eq!(Columns::find(&names("X x y z")).unwrap().xyz, [1, 2, 3]);
        assert_eq!(
            Columns::find(&names("reflectivity x y z intensity"))
                .unwrap()
                .intensity,
            Some(4)
        );
    }

    #[test]
    fn a_bare_i_is_an_intensity_only_where_nothing_better_is() {
        for (list, expected) in [
            ("i x y z", Some(0)),
            ("I x y z", Some(0)),
            ("i x y z intensity", Some(4)),
            ("i x y z scalar_Intensity", Some(4)),
            ("x y z i Reflectance", Some(4)),
            ("x y z index", None),
        ] {
            assert_eq!(
                Columns::find(&names(list)).unwrap().intensity,
                expected,
                "{list}"
            );
        }
    }

    #[test]
    fn a_missing_axis_is_told_with_what_is_there() {
        let text = Columns::find(&names("rgb x y label")).unwrap_err();
        assert!(
            text.contains("rgb, x, y, label") && text.contains("x, y and z"),
            "{text}"
        );
        assert!(Columns::find(&[]).unwrap_err().contains("none"));
    }

    #[test]
    fn excerpts_are_short_and_printable() {
        let text = excerpt(&[b"a\x07\0\xff"[..].to_vec(), vec![b'b'; 500]].concat());
        assert_eq!(text.chars().count(), 60);
        assert!(
            text.starts_with("a??\u{fffd}b") && text.ends_with('…'),
            "{text}"
        );
    }
}
