//! Writing PCD, version 0.7.

use std::io::{self, Write};

use winze::Cloud;

use crate::encode::{ascii_rows, binary_rows, needs_double};
use crate::format::Encoding;
use crate::lzf;

/// Writes `cloud` as PCD. Its viewpoint goes into VIEWPOINT.
pub(crate) fn write(w: &mut dyn Write, cloud: &Cloud, encoding: Encoding) -> io::Result<()> {
    let double = needs_double(cloud);
    w.write_all(header(cloud, double, encoding).as_bytes())?;
    match encoding {
        Encoding::Ascii => ascii_rows(w, cloud, ' '),
        Encoding::Binary => binary_rows(w, cloud, double, None),
        Encoding::Compressed => compressed(w, cloud, double),
    }
}

fn header(cloud: &Cloud, double: bool, encoding: Encoding) -> String {
    let size = if double { 8 } else { 4 };
    let (name, four, float, one) = match cloud.intensity() {
        Some(_) => (" intensity", " 4", " F", " 1"),
        None => ("", "", "", ""),
    };
    let [x, y, z] = cloud.viewpoint().unwrap_or_default();
    let points = cloud.len();
    let data = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Binary => "binary",
        Encoding::Compressed => "binary_compressed",
    };
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n\
         VERSION 0.7\n\
         FIELDS x y z{name}\n\
         SIZE {size} {size} {size}{four}\n\
         TYPE F F F{float}\n\
         COUNT 1 1 1{one}\n\
         WIDTH {points}\n\
         HEIGHT 1\n\
         VIEWPOINT {x} {y} {z} 1 0 0 0\n\
         POINTS {points}\n\
         DATA {data}\n"
    )
}

/// All x, then all y, then all z, then all intensities, in one LZF stream.
fn compressed(w: &mut dyn Write, cloud: &Cloud, double: bool) -> io::Result<()> {
    let mut columns = Vec::with_capacity(cloud.len() * if double { 28 } else { 16 });
    let axes: [fn([f64; 3]) -> f64; 3] = [|[x, _, _]| x, |[_, y, _]| y, |[_, _, z]| z];
    for axis in axes {
        for c in cloud.iter().map(axis) {
            if double {
                columns.extend_from_slice(&c.to_le_bytes());
            } else {
                columns.extend_from_slice(&(c as f32).to_le_bytes());
            }
        }
    }
    for i in cloud.intensity().unwrap_or_default() {
        columns.extend_from_slice(&i.to_le_bytes());
    }
    let size = size_word(columns.len())?;
    let packed = lzf::compress(&columns);
    w.write_all(&size_word(packed.len())?.to_le_bytes())?;
    w.write_all(&size.to_le_bytes())?;
    w.write_all(&packed)
}

fn size_word(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_| {
        io::Error::other("more than 4 GiB do not fit a compressed PCD; write it as binary")
    })
}
