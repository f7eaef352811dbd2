//! Arrays of points as NumPy keeps them (`.npy`, version 1.0), so that `numpy.load` opens a bundle as it is.

/// What begins the file: magic, version, length of the header.
const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

/// `points` as a little-endian `f32` array of shape (n, 3).
pub(crate) fn to_npy(points: &[[f32; 3]]) -> Vec<u8> {
    let mut out = header(points.len());
    out.reserve(12 * points.len());
    for v in points.iter().flatten() {
        out.extend_from_slice(&v.to_le_bytes());
    }
    out
}

/// The points of such an array, no coordinate of which may be larger than `most`.
pub(crate) fn from_npy(bytes: &[u8], most: f32) -> Result<Vec<[f32; 3]>, String> {
    // Only what `to_npy` writes is read: the header follows from the length.
    let body = |n: usize| bytes.strip_prefix(&*header(n));
    let (_, in_body) = bytes
        .iter()
        .position(|b| *b == b'\n')
        .and_then(|end| bytes.split_at_checked(end + 1))
        .ok_or("is no NumPy array")?;
    let count = in_body.len() / 12;
    let body = body(count).ok_or_else(|| {
        format!("is no NumPy array of {count} little-endian f32 points, which its length asks for")
    })?;
    let (numbers, []) = body.as_chunks::<4>() else {
        return Err("ends within a number".into());
    };
    let (points, []) = numbers.as_chunks::<3>() else {
        return Err("ends within a point".into());
    };
    let points: Vec<[f32; 3]> = points.iter().map(|p| p.map(f32::from_le_bytes)).collect();
    let sound = |p: &[f32; 3]| p.iter().all(|v| v.abs() <= most);
    match points.iter().position(|p| !sound(p)) {
        None => Ok(points),
        Some(i) => Err(format!("point {i} is not finite or too far out")),
    }
}

fn header(points: usize) -> Vec<u8> {
    let mut text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({points}, 3), }}")
        .into_bytes();
    // The data begins at a multiple of 64 bytes; a line break ends the header.
    let before = MAGIC.len() + 2;
    let whole = (before + text.len() + 1).next_multiple_of(64);
    text.resize(whole - before - 1, b' ');
    text.push(b'\n');
    #[expect(clippy::cast_possible_truncation, reason = "at most 128")]
    let length = text.len() as u16;
    [MAGIC, &length.to_le_bytes(), &text].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: [[f32; 3]; 3] = [[1.0, -0.0, 3.5], [f32::MIN_POSITIVE, 2.0, 3.0], [0.1; 3]];

    #[test]
    fn points_come_back_to_the_bit() {
        for points in [&POINTS[..], &POINTS[..1], &[]] {
            let bytes = to_npy(points);
            assert_eq!((bytes.len() - 12 * points.len()) % 64, 0);
            let back = from_npy(&bytes, 10.0).unwrap();
            let bits =
                |p: &[[f32; 3]]| -> Vec<u32> { p.iter().flatten().map(|v| v.to_bits()).collect() };
            assert_eq!(bits(points), bits(&back));
        }
    }

    #[test]
    fn the_header_is_numpy_s() {
        let bytes = to_npy(&POINTS);
        assert_eq!(bytes[..10], *b"\x93NUMPY\x01\x00\x76\x00");
        let text = std::str::from_utf8(&bytes[10..128]).unwrap();
        assert_eq!(
            text.trim_end(),
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 3), }"
        );
    }

    #[test]
    fn what_is_cut_or_wrong_is_refused() {
        let bytes = to_npy(&POINTS);
        for end in 0..bytes.len() {
            assert!(from_npy(&bytes[..end], 10.0).is_err(), "{end}");
        }
        let longer = [&bytes[..], &[0; 12]].concat();
        assert!(from_npy(&longer, 10.0).is_err());
        for bad in [f32::NAN, f32::INFINITY, 11.0] {
            let bytes = to_npy(&[[1.0; 3], [0.0, bad, 0.0]]);
            let error = from_npy(&bytes, 10.0).unwrap_err();
            assert!(error.contains("point 1"), "{error}");
        }
        assert!(from_npy(b"\n", 1.0).is_err() && from_npy(b"", 1.0).is_err());
    }
}
