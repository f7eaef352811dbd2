//! Contact sheets: every query on its map.

use std::collections::BTreeMap;
use std::path::Path;

use winze_io::atomic;
use winze_report::{Thumb, contact_sheet};

/// Queries a sheet.
const A_SHEET: usize = 60;

/// A thumb before its map is known to be there.
pub(super) struct Sketch {
    pub(super) map: String,
    pub(super) query: Vec<[f64; 3]>,
    pub(super) in_map: bool,
    pub(super) title: String,
    pub(super) note: String,
}

/// Writes the sheets of a scenario into `out`, on the dots of each map; their names.
pub(super) fn write(
    out: &Path,
    scenario: &str,
    maps: &BTreeMap<String, Vec<[f64; 3]>>,
    sketches: &[Sketch],
) -> anyhow::Result<Vec<String>> {
    let nothing = Vec::new();
    let several = sketches.len() > A_SHEET;
    let mut names = Vec::new();
    for (i, part) in sketches.chunks(A_SHEET).enumerate() {
        let thumbs: Vec<Thumb<'_>> = part
            .iter()
            .map(|s| Thumb {
                map: maps.get(&s.map).unwrap_or(&nothing),
                query: s.query.clone(),
                in_map: s.in_map,
                title: s.title.clone(),
                note: s.note.clone(),
            })
            .collect();
        let name = if several {
            format!("contact_sheet_{}.png", i + 1)
        } else {
            "contact_sheet.png".to_owned()
        };
        let png = contact_sheet(&format!("scenario {scenario}"), &thumbs)?;
        atomic::write_bytes(&out.join(&name), &png)?;
        names.push(name);
    }
    Ok(names)
}
