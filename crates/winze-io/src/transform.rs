//! Rigid transforms as text: a 4×4 matrix, `T_a_b.txt`, that takes points in frame b to frame a.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use winze::Pose;

use crate::atomic;
use crate::columns::excerpt;
use crate::error::{Error, Fault, Place, Result};
use crate::lines::number;

/// Reads a transform: sixteen numbers, row by row, on as many lines as there are. Between them
/// stand blanks, commas, semicolons or brackets; `#` starts a comment.
///
/// # Errors
/// Where the file cannot be read, holds anything but sixteen numbers, or they are no rigid
/// transform.
pub fn read_transform(path: &Path) -> Result<Pose> {
    let file = path.display().to_string();
    if path.is_dir() {
        return Err(Error::Folder { file });
    }
    let bytes = fs::read(path).map_err(|cause| Error::io(path, "be read", cause))?;
    parse(&bytes).map_err(|fault| fault.of(&file))
}

/// Like [`read_transform`], from bytes at hand.
///
/// # Errors
/// As [`read_transform`].
pub fn read_transform_bytes(bytes: &[u8]) -> Result<Pose> {
    parse(bytes).map_err(|fault| fault.of("transform"))
}

/// Writes a transform as four rows of four numbers, exact to the last bit.
///
/// # Errors
/// Where the file cannot be written.
pub fn write_transform(path: &Path, pose: &Pose) -> Result<()> {
    atomic::write_bytes(path, format(pose).as_bytes())
}

fn format(pose: &Pose) -> String {
    let mut text = String::new();
    for [a, b, c, d] in pose.to_matrix() {
        // Debug formatting is the shortest that reads back the same, with exponents where short.
        let _ = writeln!(text, "{a:?} {b:?} {c:?} {d:?}");
    }
    text
}

fn parse(bytes: &[u8]) -> std::result::Result<Pose, Fault> {
    let mut values = [0.0; 16];
    let mut count = 0;
    for (i, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let content = line.split(|&b| b == b'#').next().unwrap_or_default();
        let between = |b: &u8| b.is_ascii_whitespace() || matches!(b, b',' | b';' | b'[' | b']');
        for token in content.split(between).filter(|t| !t.is_empty()) {
            let value = number(token).ok_or_else(|| {
                Fault::malformed(
                    Place::Line(i + 1),
                    format!("'{}' is not a number", excerpt(token)),
                )
            })?;
            if let Some(slot) = values.get_mut(count) {
                *slot = value;
            }
            count += 1;
        }
    }
    if count != 16 {
        return Err(Fault::malformed(
            Place::File,
            format!("holds {count} numbers; a transform is 16, four rows of four"),
        ));
    }
    let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p] = values;
    Pose::from_matrix([[a, b, c, d], [e, f, g, h], [i, j, k, l], [m, n, o, p]])
        .map_err(Fault::Rejected)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> String {
        parse(text.as_bytes()).unwrap_err().of("T.txt").to_string()
    }

    #[test]
    fn sixteen_numbers_in_any_layout() {
        let expected = Pose::from_translation([1.0, -2.0, 0.5]);
        for text in [
            "1 0 0 1\n0 1 0 -2\n0 0 1 0.5\n0 0 0 1\n",
            "1 0 0 1 0 1 0 -2 0 0 1 .5 0 0 0 1",
            "# T_map_query\r\n1,0,0,1\r\n0,1,0,-2 # two\r\n0,0,1,5e-1\r\n0,0,0,1",
            "[[1, 0, 0, 1],\n [0, 1, 0, -2],\n [0, 0, 1, 0.5],\n [0, 0, 0, 1]]\n",
        ] {
            assert_eq!(
                read_transform_bytes(text.as_bytes()).unwrap(),
                expected,
                "{text}"
            );
        }
    }

    #[test]
    fn anything_else_is_refused() {
        assert!(message("").contains("holds 0 numbers"));
        assert!(message("1 0 0 1\n0 1 0 -2\n0 0 1 0.5\n").contains("holds 12 numbers"));
        assert!(message(&"1 ".repeat(17)).contains("holds 17 numbers"));
        assert!(message("1 0 0 1\n0 one 0 -2\n").contains("line 2: 'one' is not a number"));
        assert!(message(&"1 ".repeat(16)).contains("not a rigid transform"));
        assert!(message(&"nan ".repeat(16)).contains("not a rigid transform"));
    }

    #[test]
    fn what_is_written_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("T.txt");
        let pose = Pose::exp([5e5, 4.5e6, -0.1, 1.2, -0.7, 2.0]);
        write_transform(&path, &pose).unwrap();
        let back = read_transform(&path).unwrap();
        assert!(pose.distance(&back, [10.0, 20.0, 30.0]).translation < 1e-9);
        assert!(pose.distance(&back, [0.0; 3]).rotation < 1e-12);
        assert!(matches!(
            read_transform(folder.path()),
            Err(Error::Folder { .. })
        ));
        let missing = read_transform(&folder.path().join("none.txt")).unwrap_err();
        assert!(missing.to_string().contains("no such file"));
    }
}
