//! Plain text, one point a line: `.xyz`, `.txt`, `.csv`, `.asc`, `.pts`.
//!
//! * Columns stand between blanks or tabs, commas, or semicolons; whichever the first line of
//!   numbers shows. Between semicolons, `1,5` is one and a half.
//! * Columns are named by a row of names above the numbers, or by a comment that has as many names
//!   as there are columns; units in brackets and quotes are ignored. A column of row numbers may be
//!   without a name. Without any names the first three columns are x, y and z, and **no other column
//!   is read**: a fourth one may be an intensity, a colour, a time or a label, and only a name can
//!   tell.
//! * Lines that are blank or start with `#` or `//` are passed over; so is a count of points on
//!   the first line.
//! * `nan`, `inf` and, between commas or semicolons, nothing at all are coordinates without a
//!   value. Anything else that is not a number is an error: a file of text that was cut short or
//!   mangled should not pass for a smaller cloud. So is a count on the first line with fewer points
//!   below it. (Without a count, a file cut at the end of a line cannot be told from a whole one.)

mod layout;
mod stream;

use std::io::{self, Write};

use winze::Cloud;

use crate::encode::ascii_rows;
use crate::error::Fault;
use crate::lines::parse_rows;
use crate::raw::Raw;
use layout::Layout;
pub(crate) use stream::Stream;

/// Decodes a whole text file.
pub(crate) fn decode(bytes: &[u8]) -> Result<Raw, Fault> {
    let layout = Layout::detect(bytes)?;
    let with_intensity = layout.columns.intensity.is_some();
    let rows = parse_rows(bytes, layout.body, with_intensity, |line| layout.row(line))?;
    let held = rows.points.len() as u64;
    layout.check_held(held)?;
    Ok(Raw {
        points: rows.points,
        intensity: layout.columns.intensity.map(|_| rows.intensity),
        encoding: layout.delimiter.to_string(),
        warnings: layout.surplus(held).into_iter().collect(),
        fields: layout.names,
        ..Raw::default()
    })
}

/// Writes `cloud` as text: with commas under a row of names, or with blanks under a comment that
/// names the columns.
pub(crate) fn write(w: &mut dyn Write, cloud: &Cloud, commas: bool) -> io::Result<()> {
    let names: &[&str] = match cloud.intensity() {
        Some(_) => &["x", "y", "z", "intensity"],
        None => &["x", "y", "z"],
    };
    if commas {
        writeln!(w, "{}", names.join(","))?;
        ascii_rows(w, cloud, ',')
    } else {
        writeln!(w, "# {}", names.join(" "))?;
        ascii_rows(w, cloud, ' ')
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(text: &str) -> Vec<[f64; 3]> {
        decode(text.as_bytes()).unwrap().points
    }

    fn message(text: &str) -> String {
        decode(text.as_bytes()).unwrap_err().of("a.xyz").to_string()
    }

    #[test]
    fn every_delimiter_gives_the_same_points() {
        let expected = [[1.5, -2.0, 3.25], [4.0, 5.0, 1e3]];
        for text in [
            "1.5 -2 3.25\n4 5 1e3\n",
            "  1.5\t-2   3.25 \r\n\r\n4\t5\t1e3",
            "1.5,-2,3.25\n4, 5 ,1e3,\n",
            "1.5;-2;3.25\n4;5;1e3\n",
            "1,5;-2,0;3,25\n4;5;1e3\n",
            "\u{feff}# a comment\n// another\n1.5 -2 3.25 9 9\n# in between\n4 5 1e3\n",
            "2\n1.5 -2 3.25\n4 5 1e3\n",
            "\"1.5\",\"-2\",\"3.25\"\n4,5,1e3\n",
        ] {
            assert_eq!(points(text), expected, "{text}");
        }
    }

    #[test]
    fn names_choose_the_columns() {
        for text in [
            "time,Z,Y,X,Intensity\n0,3,2,1,7\n",
            "# time z y x intensity\n0 3 2 1 7\n",
            "//T Z Y X Scalar_Intensity\n0 3 2 1 7\n",
            "\"time [s]\";\"z [m]\";\"y [m]\";\"x (m)\";\"intensity\"\n0;3;2;1;7\n",
            "# t [s] z [m] y [m] x [m] i\n0 3 2 1 7\n",
            ",z,y,x,intensity\n0,3,2,1,7\n",
            "\"\";z;y;x;intensity\r\n0;3;2;1;7\r\n",
            "0,z,y,x,intensity\n0,3,2,1,7\n",
            "# made on Monday\n\ntime z y x reflectance\n0 3 2 1 7\n",
        ] {
            let raw = decode(text.as_bytes()).unwrap();
            assert_eq!(raw.points, [[1.0, 2.0, 3.0]], "{text}");
            assert_eq!(raw.intensity.as_deref(), Some(&[7.0][..]), "{text}");
        }
    }

    #[test]
    fn a_fourth_column_without_a_name_is_not_an_intensity() {
        let raw = decode(b"# scan of x y z\n1 2 3 4\n").unwrap();
        assert_eq!((raw.points, raw.intensity), (vec![[1.0, 2.0, 3.0]], None));
        assert_eq!(points("1 2 3 wall\n4 5 6 roof\n").len(), 2);
    }

    #[test]
    fn values_that_are_missing_are_not_numbers() {
        let read = points("1,2,nan\n,2,3\n1,-inf,3\n");
        assert_eq!(read.len(), 3);
        assert!(read.iter().all(|p| p.iter().any(|v| !v.is_finite())));
    }

    #[test]
    fn bad_lines_are_named_and_quoted() {
        assert_eq!(
            message("1 2 3\n\n4 five 6\n"),
            "a.xyz: line 3: 'five' is not a number, in \"4 five 6\""
        );
        assert!(message("1 2 3\n4 5\n").contains("line 2: 2 columns where 3 are needed"));
        assert!(message("1 2 3\n4 5 \x07\u{1b}[31m\n").contains("'??[31m' is not a number"));
        assert!(message("a,b,c\n1,2,3\n").contains("line 1: the columns are a, b, c"));
        assert!(message(",b,c,d\n0,1,2,3\n").contains("line 1: the columns are , b, c, d"));
        assert!(message("1,5 2,5 3,5\n").contains("line 1: '5 2' is not a number"));
        assert!(message("7\n8\n9\n").contains("line 2: 1 columns where 3"));
        assert!(message("1 2 3\nx y z\n").contains("line 2: 'x' is not a number"));
        assert!(message("\u{0}\u{1}\u{2} b c d\n1 2 3").contains("line 1"));
    }

    #[test]
    fn a_file_without_points_is_an_error() {
        for text in ["", "\n\n", "# x y z\n", "x,y,z\n", "0\n", "\u{feff}"] {
            assert!(message(text).contains("holds no points"), "{text}");
        }
        assert!(
            decode(b"\xff\xfe1\0 \x002\0")
                .unwrap_err()
                .of("a")
                .to_string()
                .contains("UTF-16")
        );
    }

    #[test]
    fn fewer_points_than_announced_are_an_error_and_more_a_warning() {
        assert_eq!(
            message("3\n1 2 3\nnan 5 6\n"),
            "a.xyz: line 1: announces 3 points but the file holds 2; the file is cut short, copy it again"
        );
        assert!(message("# of a scan\n12\n").contains("line 2: announces 12 points but"));
        assert!(message("99999999999999999999\n1 2 3\n").contains("but the file holds 1"));
        assert!(decode(b"1\n1 2 3\n").unwrap().warnings.is_empty());
        assert!(decode(b"2\n1 2 3\nnan 5 6\n").unwrap().warnings.is_empty());
        let raw = decode(b"1\n1 2 3\n4 5 6\n").unwrap();
        assert_eq!((raw.points.len(), raw.warnings.len()), (2, 1));
        // A number that stands alone further down, or beside a sign or a point, is no count.
        for text in ["x\n3\n", "3.0\n1 2 3\n", "+3\n1 2 3\n", "1 2 3\n9\n"] {
            let error = decode(text.as_bytes()).unwrap_err();
            assert!(matches!(error, Fault::Malformed(..)), "{text}: {error:?}");
        }
    }
}
