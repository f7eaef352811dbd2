//! Writing PLY: vertices only, ascii or binary little endian.

use std::io::{self, Write};

use winze::Cloud;

use crate::encode::{ascii_rows, binary_rows, needs_double};

/// Writes `cloud` as PLY.
pub(crate) fn write(w: &mut dyn Write, cloud: &Cloud, ascii: bool) -> io::Result<()> {
    let double = needs_double(cloud);
    let format = if ascii {
        "ascii"
    } else {
        "binary_little_endian"
    };
    let points = cloud.len();
    write!(w, "ply\nformat {format} 1.0\nelement vertex {points}\n")?;
    for axis in ["x", "y", "z"] {
        let kind = if double { "double" } else { "float" };
        writeln!(w, "property {kind} {axis}")?;
    }
    if cloud.intensity().is_some() {
        writeln!(w, "property float intensity")?;
    }
    writeln!(w, "end_header")?;
    if ascii {
        ascii_rows(w, cloud, ' ')
    } else {
        binary_rows(w, cloud, double, None)
    }
}
