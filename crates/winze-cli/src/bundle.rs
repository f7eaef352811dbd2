//! `winze locate --bundle`: one question kept so that it can be asked again without the map.

use std::path::Path;

use anyhow::bail;
use winze::part::Trail;
use winze::{Config, KeptMap, KeptQuery, MapPart, Outcome};
use winze_bundle::{Beforehand, Bundle, MapFile, QueryFile};
use winze_io::atomic;
use winze_report::Document;

use crate::args::Global;
use crate::progress::Progress;
use crate::replay;

/// How far around the poses the map is kept, in blocks: at first, and where that is not enough. At last all of it is.
const REACHES: [Option<u32>; 5] = [Some(2), Some(4), Some(8), Some(16), None];

/// What a run has worked on, and where it looked.
pub(crate) struct Seen<'r, 'a> {
    pub(crate) map: &'r mut KeptMap<'a>,
    pub(crate) query: &'r mut KeptQuery<'a>,
    pub(crate) config: &'r Config,
    pub(crate) traced: (&'r Trail, &'r Outcome),
}

/// Writes the bundle, once it has answered as the map did.
pub(crate) fn write(
    path: &Path,
    seen: Seen<'_, '_>,
    asked: Beforehand,
    map: MapFile,
    query: QueryFile,
    document: &Document,
    global: &Global,
) -> anyhow::Result<()> {
    let progress = Progress::new(global.quiet, 1);
    let mut bundle = Bundle {
        winze: env!("CARGO_PKG_VERSION").into(),
        query,
        config: seen.config.clone(),
        asked,
        map,
        part: MapPart::default(),
        outcome: document.to_json(),
    };
    let mut differ = Vec::new();
    for reach in REACHES {
        progress.say("write bundle");
        bundle.part = MapPart::cut(seen.map, seen.query, seen.config, seen.traced, reach)?;
        let bytes = bundle.to_bytes()?;
        // It can be large, and is read again from the bytes.
        bundle.part = MapPart::default();
        // As whoever gets it will read it.
        progress.say("replay bundle");
        let read = Bundle::from_bytes(&path.display().to_string(), &bytes)?;
        match replay::answer(&read, None, &|_, _| ()) {
            Ok(again) => {
                differ = replay::differences(&read.outcome, &again.document.to_json())?;
                if differ.is_empty() {
                    atomic::write_bytes(path, &bytes)?;
                    return Ok(());
                }
            }
            // Poses may have led elsewhere, where nothing was looked at.
            Err(e) => differ = vec![format!("{e:#}")],
        }
        tracing::info!("{}: asked again, {}", path.display(), differ.join(", "));
    }
    bail!(
        "{}: not written: the part of the map that was looked at does not give the same answer ({}); keep the map and the query instead, and tell us of it",
        path.display(),
        replay::few(&differ)
    )
}
