//! Rows of numbers as all writers put them.

use std::io::{self, Write};

use winze::Cloud;

/// A coordinate may move by this much, metres, on its way into a 32-bit float. The offsets of a
/// cloud are themselves this coarse 2 km from its origin.
const LOSS: f64 = 1e-4;

/// Whether 32-bit floats would lose more than [`LOSS`] of some coordinate.
pub(crate) fn needs_double(cloud: &Cloud) -> bool {
    cloud.origin() != [0.0; 3]
        && !cloud
            .iter()
            .flatten()
            .all(|c| (f64::from(c as f32) - c).abs() <= LOSS)
}

/// A line a point: exact where the cloud's origin is zero, else to a tenth of a millimetre, which
/// is what its offsets are good for.
pub(crate) fn ascii_rows(w: &mut dyn Write, cloud: &Cloud, delimiter: char) -> io::Result<()> {
    let exact = cloud.origin() == [0.0; 3];
    let mut intensity = cloud.intensity().unwrap_or_default().iter();
    let mut line = Vec::with_capacity(64);
    for (offset, [x, y, z]) in cloud.points().iter().zip(cloud.iter()) {
        winze::cancel::check();
        line.clear();
        let d = delimiter;
        if exact {
            let [x, y, z] = offset;
            write!(line, "{x}{d}{y}{d}{z}")?;
        } else {
            write!(line, "{x:.4}{d}{y:.4}{d}{z:.4}")?;
        }
        if let Some(i) = intensity.next() {
            write!(line, "{d}{i}")?;
        }
        line.push(b'\n');
        w.write_all(&line)?;
    }
    Ok(())
}

/// Little endian records: x, y, z as 32-bit or 64-bit floats, then the intensity in 32 bits, or what stands for it where the cloud
/// has none.
pub(crate) fn binary_rows(
    w: &mut dyn Write,
    cloud: &Cloud,
    double: bool,
    no_intensity: Option<f32>,
) -> io::Result<()> {
    let mut intensity = cloud.intensity().unwrap_or_default().iter();
    let mut record = Vec::with_capacity(28);
    for (i, point) in cloud.iter().enumerate() {
        if i.is_multiple_of(4096) {
            winze::cancel::check();
        }
        record.clear();
        for c in point {
            if double {
                record.extend_from_slice(&c.to_le_bytes());
            } else {
                record.extend_from_slice(&(c as f32).to_le_bytes());
            }
        }
        if let Some(i) = intensity.next().copied().or(no_intensity) {
            record.extend_from_slice(&i.to_le_bytes());
        }
        w.write_all(&record)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(points: &[[f64; 3]]) -> Cloud {
        Cloud::from_points(points).unwrap().0
    }

    #[test]
    fn doubles_are_used_only_where_floats_lose() {
        assert!(!needs_double(&cloud(&[[0.1, 1000.3, -7.7]])));
        assert!(
            !needs_double(&cloud(&[[2048.25, 5000.5, -7.5]])),
            "exact in 32 bits"
        );
        assert!(needs_double(&cloud(&[[431_234.567, 4_499_980.459, 312.0]])));
        assert!(needs_double(&cloud(&[[1e300, 0.0, 0.0]])));
    }

    #[test]
    fn digits_are_as_many_as_needed() {
        let text = |cloud: &Cloud| {
            let mut out = Vec::new();
            ascii_rows(&mut out, cloud, ' ').unwrap();
            String::from_utf8(out).unwrap()
        };
        assert_eq!(
            text(&cloud(&[[0.1f32.into(), -1000.25, 3.0]])),
            "0.1 -1000.25 3\n"
        );
        assert_eq!(
            text(&cloud(&[[431_234.567, 4_499_980.459, 312.0]])),
            "431234.5670 4499980.4590 312.0000\n"
        );
    }
}
