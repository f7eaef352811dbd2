//! Columns of binary numbers.

use rayon::prelude::*;

/// The number types of PCD and PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Little,
    Big,
}

impl Scalar {
    /// Bytes one number takes.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    pub(crate) fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Calls `put` with the number at the start of each `stride` bytes of `bytes`, as `f64`
    /// (integers beyond 2⁵³ lose their last digits). Stops where a number is cut.
    pub(crate) fn each(self, order: Order, bytes: &[u8], stride: usize, mut put: impl FnMut(f64)) {
        // The type is settled here, once a column, and not once a point.
        macro_rules! column {
            ($number:ty) => {
                for record in bytes.chunks(stride.max(1)) {
                    let Some(raw) = record.first_chunk() else {
                        break;
                    };
                    let value = match order {
                        Order::Little => <$number>::from_le_bytes(*raw),
                        Order::Big => <$number>::from_be_bytes(*raw),
                    };
                    #[allow(clippy::cast_lossless, reason = "one line for all ten types")]
                    put(value as f64);
                }
            };
        }
        match self {
            Self::I8 => column!(i8),
            Self::U8 => column!(u8),
            Self::I16 => column!(i16),
            Self::U16 => column!(u16),
            Self::I32 => column!(i32),
            Self::U32 => column!(u32),
            Self::I64 => column!(i64),
            Self::U64 => column!(u64),
            Self::F32 => column!(f32),
            Self::F64 => column!(f64),
        }
    }

    /// The number at the start of `bytes`.
    pub(crate) fn first(self, order: Order, bytes: &[u8]) -> Option<f64> {
        let mut value = None;
        self.each(order, bytes.get(..self.size())?, self.size(), |v| {
            value = Some(v);
        });
        value
    }
}

/// One number a point: at the start of each `stride` bytes of `bytes`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Column<'a> {
    pub(crate) scalar: Scalar,
    pub(crate) order: Order,
    pub(crate) bytes: &'a [u8],
    pub(crate) stride: usize,
}

/// Points are put together this many at a time, few enough to stay in a processor's cache from one
/// axis to the next.
const BLOCK: usize = 4096;

impl Column<'_> {
    /// The first `count` numbers as 32-bit floats.
    pub(crate) fn floats(self, count: usize) -> Vec<f32> {
        let mut out = Vec::with_capacity(count);
        self.scalar.each(self.order, self.bytes, self.stride, |v| {
            if out.len() < count {
                out.push(v as f32);
            }
        });
        out
    }

    /// The first `count` points of three columns.
    pub(crate) fn points(xyz: [Column<'_>; 3], count: usize) -> Vec<[f64; 3]> {
        let mut points = vec![[0.0; 3]; count];
        Self::fill_all(xyz, &mut points);
        points
    }

    /// Writes the first points of three columns into `points`.
    pub(crate) fn fill_all(xyz: [Column<'_>; 3], points: &mut [[f64; 3]]) {
        points
            .par_chunks_mut(BLOCK)
            .enumerate()
            .for_each(|(i, block)| {
                winze::cancel::check();
                for (axis, column) in xyz.into_iter().enumerate() {
                    column.fill(block, axis, i * BLOCK);
                }
            });
    }

    /// Writes the numbers from `first` on into one axis of `points`.
    pub(crate) fn fill(self, points: &mut [[f64; 3]], axis: usize, first: usize) {
        let start = first.saturating_mul(self.stride);
        let end = points
            .len()
            .saturating_mul(self.stride)
            .saturating_add(start);
        let bytes = self
            .bytes
            .get(start..end.min(self.bytes.len()))
            .unwrap_or_default();
        let mut slots = points.iter_mut().filter_map(|p| p.get_mut(axis));
        self.scalar.each(self.order, bytes, self.stride, |v| {
            if let Some(slot) = slots.next() {
                *slot = v;
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_every_type_and_order() {
        let record = |number: &[u8]| [number, &[0xAA]].concat();
        let check = |scalar: Scalar, little: &[u8], expected: f64| {
            let big: Vec<u8> = little.iter().rev().copied().collect();
            for (order, number) in [(Order::Little, little), (Order::Big, &big[..])] {
                let bytes = record(number).repeat(3);
                let mut out = Vec::new();
                scalar.each(order, &bytes, scalar.size() + 1, |v| out.push(v));
                assert_eq!(out, [expected; 3], "{scalar:?} {order:?}");
                assert_eq!(scalar.first(order, number), Some(expected));
            }
        };
        check(Scalar::I8, &(-3i8).to_le_bytes(), -3.0);
        check(Scalar::U8, &[200], 200.0);
        check(Scalar::I16, &(-300i16).to_le_bytes(), -300.0);
        check(Scalar::U16, &60_000u16.to_le_bytes(), 60_000.0);
        check(Scalar::I32, &(-70_000i32).to_le_bytes(), -70_000.0);
        check(Scalar::U32, &4_000_000_000u32.to_le_bytes(), 4e9);
        check(
            Scalar::I64,
            &(-(1i64 << 40)).to_le_bytes(),
            -(2f64.powi(40)),
        );
        check(Scalar::U64, &(1u64 << 63).to_le_bytes(), 2f64.powi(63));
        check(Scalar::F32, &1.5f32.to_le_bytes(), 1.5);
        check(Scalar::F64, &431_234.567f64.to_le_bytes(), 431_234.567);
    }

    #[test]
    fn a_cut_number_is_not_read() {
        assert_eq!(Scalar::F32.first(Order::Little, &[0; 3]), None);
    }

    #[test]
    fn points_of_several_blocks_and_types() {
        let count = 2 * BLOCK + 77;
        let record = |i: u32| {
            [
                &i.to_be_bytes()[..],
                &[9, (i % 251) as u8],
                &f64::from(i).to_be_bytes(),
            ]
            .concat()
        };
        let bytes: Vec<u8> = (0..count as u32).flat_map(record).collect();
        let column = |scalar, offset: usize| Column {
            scalar,
            order: Order::Big,
            bytes: &bytes[offset..],
            stride: 14,
        };
        let xyz = [
            column(Scalar::U32, 0),
            column(Scalar::F64, 6),
            column(Scalar::U8, 5),
        ];
        let points = Column::points(xyz, count);
        for (i, p) in points.iter().enumerate() {
            assert_eq!(*p, [i as f64, i as f64, (i % 251) as f64]);
        }
        assert_eq!(column(Scalar::U8, 5).floats(3), [0.0, 1.0, 2.0]);
    }
}
