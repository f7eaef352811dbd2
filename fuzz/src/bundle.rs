//! What must hold for any bytes that are opened as an incident bundle.

use std::collections::BTreeMap;
use std::io::{Cursor, Read as _, Write as _};
use std::sync::OnceLock;

use winze::{Config, KeptMap, KeptQuery, MapPart, locate_traced};
use winze_bundle::{Beforehand, Bundle, MapFile, QueryFile};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::check_message;

/// Opens `bytes` as a bundle; where they are one, it comes back from its own file as it was.
pub fn check(bytes: &[u8]) {
    match Bundle::from_bytes("fuzzed.zip", bytes) {
        Ok(bundle) => {
            let written = bundle.to_bytes().expect("it was in a file before");
            let again = Bundle::from_bytes("again.zip", &written).expect("what was written can be read");
            assert_eq!(format!("{bundle:?}"), format!("{again:?}"));
        }
        Err(error) => check_message(&error.to_string()),
    }
}

/// The same for a sound bundle to which `patches` were made, with digests that match; where it is still one, its question is
/// asked again.
///
/// A patch has eight bytes: an entry, what to do, where (two), and a value (four).
pub fn check_patched(patches: &[u8]) {
    let mut entries = sound().clone();
    for patch in patches.as_chunks::<8>().0 {
        let &[entry, what, at0, at1, ..] = patch;
        let value = [patch[4], patch[5], patch[6], patch[7]];
        // Settings that ask for a lot of work are no finding.
        let names: Vec<String> = entries
            .keys()
            .filter(|name| *name != "config.toml")
            .cloned()
            .collect();
        let content = entries
            .get_mut(&names[usize::from(entry) % names.len()])
            .expect("a name of its own");
        if content.len() < 4 {
            continue;
        }
        let at = usize::from(u16::from_le_bytes([at0, at1]));
        match what % 3 {
            0 => {
                let at = at % (content.len() - 3);
                content[at..at + 4].copy_from_slice(&value);
            }
            // Numbers from the end.
            1 => {
                let at = content.len() - 4 - at % (content.len() / 4) * 4;
                content[at..at + 4].copy_from_slice(&value);
            }
            _ => content.truncate(content.len() - at % content.len()),
        }
    }
    let bytes = signed(entries);
    check(&bytes);
    if let Ok(bundle) = Bundle::from_bytes("fuzzed.zip", &bytes)
        && let Err(error) = bundle.ask()
    {
        check_message(&error.to_string());
    }
}

type Entries = BTreeMap<String, Vec<u8>>;

/// The entries of a small bundle, made once.
fn sound() -> &'static Entries {
    static SOUND: OnceLock<Entries> = OnceLock::new();
    SOUND.get_or_init(|| {
        let bytes = made().to_bytes().expect("a bundle");
        let mut archive = ZipArchive::new(Cursor::new(&bytes)).expect("an archive");
        let mut entries = Entries::new();
        for i in 0..archive.len() {
            let mut entry = archive.by_index(i).expect("an entry");
            let mut content = Vec::new();
            entry.read_to_end(&mut content).expect("its content");
            let name = entry.name().expect("its name").into_owned();
            entries.insert(name, content);
        }
        entries
    })
}

/// A small drift, of which a part is the query.
fn made() -> Bundle {
    let text: String = (0..1500)
        .map(|i| {
            let (x, a) = (0.004 * f64::from(i), 2.399_963 * f64::from(i));
            let r = 1.5 + 0.2 * (3.0 * x + a.sin()).sin();
            format!("{x:.4} {:.4} {:.4}\n", r * a.cos(), r * a.sin())
        })
        .collect();
    let mut bundle = Bundle {
        winze: "0.1.0".into(),
        query: QueryFile {
            path: "query.xyz".into(),
            bytes: text.into_bytes(),
        },
        config: Config::default(),
        asked: Beforehand::default(),
        map: MapFile {
            path: "map.xyz".into(),
            digest: "sha256:0".into(),
            points_in_file: 1500,
        },
        part: MapPart::default(),
        outcome: "{}\n".into(),
    };
    bundle.config.verify.patches = 20;
    bundle.config.verify.refined = 2;
    let cloud = bundle.read_query().expect("a cloud").cloud;
    let (mut map, mut query) = (KeptMap::new(&cloud), KeptQuery::new(&cloud));
    let request = bundle.asked.request(None);
    let (outcome, trail) =
        locate_traced(&mut map, &mut query, &bundle.config, &request).expect("an answer");
    let traced = (&trail, &outcome);
    bundle.part =
        MapPart::cut(&mut map, &mut query, &bundle.config, traced, Some(2)).expect("a part");
    bundle
}

/// The archive of `entries`, whose manifest tells of them as they are.
fn signed(mut entries: Entries) -> Vec<u8> {
    let manifest = entries.get("manifest.json").expect("it is there");
    // A manifest that was broken stays so.
    if let Ok(mut json) = serde_json::from_slice::<serde_json::Value>(manifest)
        && let Some(rows) = json.get_mut("entries").and_then(|rows| rows.as_object_mut())
    {
        for (name, row) in rows {
            if let Some(content) = entries.get(name) {
                *row = serde_json::json!({
                    "bytes": content.len(), "digest": winze_io::digest(content),
                });
            }
        }
        entries.insert("manifest.json".into(), json.to_string().into_bytes());
    }
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::DEFAULT.compression_method(CompressionMethod::Stored);
    for (name, content) in &entries {
        writer.start_file(name, options).expect("in memory");
        writer.write_all(content).expect("in memory");
    }
    writer.finish().expect("in memory").into_inner()
}
