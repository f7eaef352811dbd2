//! The Velodyne files of KITTI (`.bin`): four 32-bit floats a point, x, y, z and reflectance, little endian, and nothing else.

use std::fs::File;
use std::io::{self, Write};

use winze::Cloud;

use crate::encode::binary_rows;
use crate::error::{Fault, Place};
use crate::narrow::{self, Narrow, Records};
use crate::raw::{Raw, point_count};
use crate::scalar::{Column, Order, Scalar};
use crate::stream::{Axis, Sink, Table, Told};

/// Bytes a point takes.
const RECORD: u64 = 16;
/// Of its x, y, z and reflectance.
const OFFSETS: [usize; 4] = [0, 4, 8, 12];

pub(crate) const ENCODING: &str = "binary";

pub(crate) fn fields() -> Vec<String> {
    ["x", "y", "z", "intensity"].map(String::from).into()
}

/// How many points there are in so many bytes.
fn count(length: u64) -> Result<u64, Fault> {
    if length.is_multiple_of(RECORD) {
        return Ok(length / RECORD);
    }
    Err(Fault::truncated(
        Place::Byte(usize::try_from(length - length % RECORD).unwrap_or(usize::MAX)),
        format!(
            "a point of a KITTI file takes {RECORD} bytes, the last one has {}",
            length % RECORD
        ),
    ))
}

fn about() -> Raw {
    Raw {
        encoding: ENCODING.to_owned(),
        fields: fields(),
        ..Raw::default()
    }
}

/// Decodes a whole file.
pub(crate) fn decode(bytes: &[u8]) -> Result<Raw, Fault> {
    let count = point_count(count(bytes.len() as u64)?)?;
    let [x, y, z, reflectance] = OFFSETS.map(|offset| Column {
        scalar: Scalar::F32,
        order: Order::Little,
        bytes: bytes.get(offset..).unwrap_or_default(),
        stride: RECORD as usize,
    });
    Ok(Raw {
        points: Column::points([x, y, z], count),
        intensity: Some(reflectance.floats(count)),
        ..about()
    })
}

/// Like [`decode`], straight into a cloud's offsets where nothing is odd.
pub(crate) fn decode_narrow(source: &dyn narrow::Source) -> Option<(Raw, Narrow)> {
    let count = point_count(count(source.length()).ok()?).ok()?;
    let [x, y, z, reflectance] = OFFSETS.map(|offset| narrow::Place {
        scalar: Scalar::F32,
        offset,
    });
    let records = Records {
        start: 0,
        stride: RECORD as usize,
        order: Order::Little,
        xyz: [x, y, z],
        intensity: Some(reflectance),
    };
    Some((about(), records.read(source, count)?))
}

/// A file of which only the length is known yet.
#[derive(Debug)]
pub(crate) struct Stream {
    points: u64,
}

impl Stream {
    pub(crate) fn open(length: u64) -> Result<Self, Fault> {
        count(length).map(|points| Self { points })
    }

    pub(crate) fn count(&self) -> u64 {
        self.points
    }

    /// Reads all points.
    pub(crate) fn scan(&self, file: &mut File, sink: &mut Sink<'_>) -> Result<Told, Fault> {
        let [x, y, z, _] = OFFSETS.map(|offset| Axis {
            scalar: Scalar::F32,
            start: offset as u64,
            step: RECORD,
        });
        let table = Table {
            xyz: [x, y, z],
            order: Order::Little,
            rows: self.points,
        };
        table.read(file, |rows| rows * RECORD, sink)?;
        Ok(Told {
            points: self.points,
            warnings: Vec::new(),
        })
    }
}

/// Writes a cloud whose coordinates 32-bit floats can hold, with a reflectance of 0 where it has no intensities.
pub(crate) fn write(w: &mut dyn Write, cloud: &Cloud) -> io::Result<()> {
    binary_rows(w, cloud, false, Some(0.0))
}
