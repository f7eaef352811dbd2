//! Arrays as files: raw little-endian numbers, row after row.

use std::fs;
use std::path::Path;

use anyhow::{Context as _, bail};

/// A number of four or eight bytes.
pub(crate) trait Number: Copy {
    /// Its size.
    const BYTES: usize;
    /// Adds its bytes.
    fn put(self, to: &mut Vec<u8>);
    /// From as many bytes.
    fn of(bytes: &[u8]) -> Self;
}

macro_rules! number {
    ($($ty:ty)*) => { $(
        impl Number for $ty {
            const BYTES: usize = size_of::<$ty>();

            fn put(self, to: &mut Vec<u8>) {
                to.extend_from_slice(&self.to_le_bytes());
            }

            fn of(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<$ty>()];
                own.copy_from_slice(bytes);
                Self::from_le_bytes(own)
            }
        }
    )* };
}
number!(f32 f64 u32);

/// The bytes of rows.
pub(crate) fn bytes<T: Number, const N: usize>(rows: &[[T; N]]) -> Vec<u8> {
    let mut out = Vec::with_capacity(rows.len() * N * T::BYTES);
    rows.iter().flatten().for_each(|v| v.put(&mut out));
    out
}

/// The bytes of single numbers.
pub(crate) fn flat<T: Number>(numbers: &[T]) -> Vec<u8> {
    let mut out = Vec::with_capacity(numbers.len() * T::BYTES);
    numbers.iter().for_each(|v| v.put(&mut out));
    out
}

/// Rows from bytes; `None` where they are no whole number of rows.
pub(crate) fn rows<T: Number, const N: usize>(bytes: &[u8]) -> Option<Vec<[T; N]>> {
    let row = N * T::BYTES;
    bytes.len().is_multiple_of(row).then(|| {
        let at = |row: &[u8], i: usize| T::of(&row[i * T::BYTES..(i + 1) * T::BYTES]);
        let rows = bytes.chunks_exact(row);
        rows.map(|r| std::array::from_fn(|i| at(r, i))).collect()
    })
}

/// Reads rows.
pub(crate) fn read<T: Number, const N: usize>(path: &Path) -> anyhow::Result<Vec<[T; N]>> {
    let bytes = fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let Some(rows) = rows(&bytes) else {
        bail!(
            "{}: {} bytes are no whole number of rows of {N}",
            path.display(),
            bytes.len()
        );
    };
    Ok(rows)
}

/// Reads single numbers.
pub(crate) fn read_flat<T: Number>(path: &Path) -> anyhow::Result<Vec<T>> {
    Ok(read::<T, 1>(path)?.into_iter().map(|[v]| v).collect())
}

/// Writes bytes.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    fs::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_little_endian_and_come_back() {
        assert_eq!(bytes(&[[1u32, 2]]), [1, 0, 0, 0, 2, 0, 0, 0]);
        assert_eq!(flat(&[1.0f32]), [0, 0, 0x80, 0x3F]);
        let values = [[1.5f64, -0.25, f64::MAX], [0.0, 3.0, 1e-300]];
        assert_eq!(rows::<f64, 3>(&bytes(&values)).unwrap(), values);
        assert_eq!(rows::<f64, 3>(&bytes(&values)[1..]), None);
        assert_eq!(rows::<u32, 2>(&[]).unwrap(), Vec::<[u32; 2]>::new());
    }

    #[test]
    fn files_come_back_and_broken_ones_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.u32");
        write(&path, &flat(&[7u32, 8, 9])).unwrap();
        assert_eq!(read_flat::<u32>(&path).unwrap(), [7, 8, 9]);
        let error = read::<u32, 2>(&path).unwrap_err().to_string();
        assert!(
            error.ends_with("a.u32: 12 bytes are no whole number of rows of 2"),
            "{error}"
        );
    }
}
