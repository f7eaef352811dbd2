//! PCD files of any layout of fields, made by a tiny encoder of the tests' own.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::fmt::Write as _;

use proptest::prelude::*;
use winze_io::{Format, NoReturns, ReadOptions, read_cloud_bytes};

#[derive(Debug, Clone)]
struct Field {
    name: String,
    kind: (char, usize),
    count: usize,
}

/// The value of column `column` of point `row`: small and whole, so that every type can hold it.
fn value(row: usize, column: usize) -> i8 {
    ((row * 7 + column * 31 + 5) % 120) as i8
}

fn number((kind, size): (char, usize), value: i8) -> Vec<u8> {
    match (kind, size) {
        ('F', 4) => f32::from(value).to_le_bytes().to_vec(),
        ('F', _) => f64::from(value).to_le_bytes().to_vec(),
        _ => i64::from(value).to_le_bytes()[..size].to_vec(),
    }
}

fn header(fields: &[Field], points: usize, data: &str, newline: &str) -> Vec<u8> {
    let list = |f: &dyn Fn(&Field) -> String| fields.iter().map(f).collect::<Vec<_>>().join(" ");
    let lines = [
        "# .PCD v.7 - Point Cloud Data file format".to_owned(),
        "VERSION .7".to_owned(),
        format!("FIELDS {}", list(&|f| f.name.clone())),
        format!("SIZE {}", list(&|f| f.kind.1.to_string())),
        format!("TYPE {}", list(&|f| f.kind.0.to_string())),
        format!("COUNT {}", list(&|f| f.count.to_string())),
        format!("WIDTH {points}"),
        "HEIGHT 1".to_owned(),
        format!("POINTS {points}"),
        format!("DATA {data}"),
    ];
    lines
        .iter()
        .flat_map(|l| [l.as_bytes(), newline.as_bytes()].concat())
        .collect()
}

/// The columns of each field as (field, first column).
fn starts(fields: &[Field]) -> Vec<(&Field, usize)> {
    let mut column = 0;
    fields
        .iter()
        .map(|f| {
            column += f.count;
            (f, column - f.count)
        })
        .collect()
}

fn field_bytes(field: &Field, row: usize, start: usize) -> Vec<u8> {
    (start..start + field.count)
        .flat_map(|c| number(field.kind, value(row, c)))
        .collect()
}

fn encode(fields: &[Field], points: usize, data: &str, newline: &str) -> Vec<u8> {
    let mut out = header(fields, points, data, newline);
    let columns: usize = fields.iter().map(|f| f.count).sum();
    match data {
        "ascii" => {
            let mut text = String::new();
            for row in 0..points {
                let words: Vec<String> = (0..columns).map(|c| value(row, c).to_string()).collect();
                write!(text, "{}{newline}", words.join(" ")).unwrap();
            }
            out.extend(text.into_bytes());
        }
        "binary" => {
            for row in 0..points {
                for (field, start) in starts(fields) {
                    out.extend(field_bytes(field, row, start));
                }
            }
        }
        _ => {
            let mut bytes = Vec::new();
            for (field, start) in starts(fields) {
                for row in 0..points {
                    bytes.extend(field_bytes(field, row, start));
                }
            }
            // LZF with nothing but literals.
            let packed: Vec<u8> = bytes
                .chunks(32)
                .flat_map(|c| [&[(c.len() - 1) as u8], c].concat())
                .collect();
            out.extend((packed.len() as u32).to_le_bytes());
            out.extend((bytes.len() as u32).to_le_bytes());
            out.extend(packed);
        }
    }
    out
}

fn kind() -> impl Strategy<Value = (char, usize)> {
    prop_oneof![
        (
            prop::sample::select(vec!['I', 'U']),
            prop::sample::select(vec![1usize, 2, 4, 8])
        ),
        (Just('F'), prop::sample::select(vec![4usize, 8])),
    ]
}

/// x, y, z, perhaps an intensity, and up to five others, in any order.
fn layout() -> impl Strategy<Value = Vec<Field>> {
    let extra = (
        prop::sample::select(vec!["_", "ring", "rgb", "t"]),
        kind(),
        1usize..4,
    )
        .prop_map(|(name, kind, count)| Field {
            name: name.to_owned(),
            kind,
            count,
        });
    (
        prop::collection::vec(kind(), 4),
        any::<bool>(),
        prop::collection::vec(extra, 0..5),
    )
        .prop_map(|(kinds, intensity, extras)| {
            let names = ["x", "y", "z", "intensity"];
            let mut fields: Vec<Field> = names
                .iter()
                .zip(kinds)
                .take(if intensity { 4 } else { 3 })
                .map(|(name, kind)| Field {
                    name: (*name).to_owned(),
                    kind,
                    count: 1,
                })
                .collect();
            fields.extend(extras);
            fields
        })
        .prop_shuffle()
}

proptest! {
    #[test]
    fn any_layout_is_read(
        fields in layout(),
        points in 0usize..20,
        data in prop::sample::select(vec!["ascii", "binary", "binary_compressed"]),
        newline in prop::sample::select(vec!["\n", "\r\n"]),
    ) {
        let bytes = encode(&fields, points, data, newline);
        let options = ReadOptions { no_returns: NoReturns::Keep, digest: false };
        let file = read_cloud_bytes(&bytes, Format::Pcd, &options).unwrap();
        prop_assert_eq!(&file.report.encoding, data);
        prop_assert_eq!(file.report.fields.len(), fields.len());
        prop_assert!(file.report.warnings.is_empty(), "{:?}", file.report.warnings);
        prop_assert_eq!(file.cloud.len(), points);
        let column = |name: &str| starts(&fields).into_iter().find(|(f, _)| f.name == name).map(|(_, c)| c);
        let xyz = ["x", "y", "z"].map(|name| column(name).unwrap());
        for row in 0..points {
            prop_assert_eq!(file.cloud.point(row), xyz.map(|c| f64::from(value(row, c))));
        }
        let intensity = column("intensity").map(|c| (0..points).map(|row| f32::from(value(row, c))).collect::<Vec<_>>());
        prop_assert_eq!(file.cloud.intensity(), intensity.as_deref());
    }
}
