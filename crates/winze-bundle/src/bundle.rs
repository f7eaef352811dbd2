//! What a bundle holds, and how it gets into a file and out of it.

use std::path::Path;

use winze::locate::{Near, Progress};
use winze::{Config, KeptMap, KeptQuery, MapPart, Method, Outcome, Pose, Request, locate_in};
use winze_io::{CloudFile, ReadOptions, atomic, digest, read_bytes, read_cloud_as};

use crate::archive::{Entries, MOST_BYTES, Packed, pack};
use crate::error::{Error, Fault, Result, shown};
use crate::manifest::{self, EntryRow, FORMAT, Manifest, QueryRow, Version, printable};
use crate::part;

/// One question, its answer, and as much of the map as it takes to ask again.
#[derive(Debug, Clone, PartialEq)]
pub struct Bundle {
    /// The version of winze that gave the answer.
    pub winze: String,
    /// The query.
    pub query: QueryFile,
    /// The settings.
    pub config: Config,
    /// What was asked besides.
    pub asked: Beforehand,
    /// The map that it was asked of.
    pub map: MapFile,
    /// What of it was looked at.
    pub part: MapPart,
    /// The answer: the JSON document of `winze locate`.
    pub outcome: String,
}

/// A query's file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QueryFile {
    /// Its path as given.
    pub path: String,
    /// All its bytes.
    pub bytes: Vec<u8>,
}

/// A map's file, which is not in the bundle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapFile {
    /// Its path as given.
    pub path: String,
    /// Digest of the file.
    pub digest: String,
    /// Points that it holds, those that cannot be used included.
    pub points_in_file: usize,
}

/// What was said beforehand, see [`Request`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Beforehand {
    /// How to look.
    pub method: Method,
    /// Both clouds have z up.
    pub gravity_aligned: bool,
    /// Where the query's centroid lies.
    pub near: Option<Near>,
    /// Where `ndt+icp` starts.
    pub initial: Option<Pose>,
    /// The true pose, where it is known. It has no part in the answer.
    pub truth: Option<Pose>,
}

const CONFIG: &str = "config.toml";
const OUTCOME: &str = "outcome.json";
const README: &str = "README.txt";
/// Times its own size that a bundle may unpack to: a text cloud of round numbers packs to a twentieth.
const MOST_PACKED: u64 = 100;

/// For whoever opens the archive by hand.
const READ_ME: &str = "An incident bundle of winze: a query, where it was found in a map or not, and the part of the map that was looked at.

    winze replay THIS.zip                     answers again as it was answered, and says whether it is the same
    winze replay THIS.zip --report page.html  the same as a page to look at

manifest.json  what was asked, and a digest of every file
query.*        the query as it was given
config.toml    all settings
outcome.json   the answer
map/           the part of the map: part.json, and points and normals for numpy.load
";

impl Beforehand {
    /// As a request that tells `progress`.
    #[must_use]
    pub fn request<'a>(&self, progress: Option<&'a Progress<'a>>) -> Request<'a> {
        Request {
            method: self.method,
            initial: self.initial,
            gravity_aligned: self.gravity_aligned,
            near: self.near,
            progress,
        }
    }
}

impl Bundle {
    /// The query, read as it was read then.
    ///
    /// # Errors
    /// As [`winze_io::read_cloud`].
    pub fn read_query(&self) -> Result<CloudFile> {
        let name = query_entry(Path::new(&self.query.path));
        let options = ReadOptions::default();
        Ok(read_cloud_as(
            Path::new(&name),
            &self.query.bytes,
            &options,
        )?)
    }

    /// Asks again, of the part of the map in the bundle. The answer is the one given then, to the bit, where the same version of winze is asked.
    ///
    /// # Errors
    /// Where the query cannot be read, or where another version of winze looks where that one did not.
    pub fn ask(&self) -> Result<Outcome> {
        let query = self.read_query()?;
        let (mut map, mut query) = (KeptMap::part(&self.part), KeptQuery::new(&query.cloud));
        let request = self.asked.request(None);
        Ok(locate_in(&mut map, &mut query, &self.config, &request)?)
    }

    /// Reads a bundle.
    ///
    /// # Errors
    /// Where the file cannot be read or is no sound bundle.
    pub fn open(path: &Path) -> Result<Self> {
        Self::from_bytes(&path.display().to_string(), &read_bytes(path)?)
    }

    /// Writes it, whole or not at all.
    ///
    /// # Errors
    /// As [`Bundle::to_bytes`], and where the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        Ok(atomic::write_bytes(path, &self.to_bytes()?)?)
    }

    /// The bytes of its file: the same for the same bundle.
    ///
    /// # Errors
    /// [`Error::Unwritable`] where the settings cannot be written down, or the archive would be too large.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let unwritable = |e: &dyn std::fmt::Display| Error::Unwritable(e.to_string());
        let entry = query_entry(Path::new(&self.query.path));
        let config = toml::to_string(&self.config).map_err(|e| unwritable(&e))?;
        let mut entries: Entries = [
            (entry.clone(), self.query.bytes.clone()),
            (CONFIG.into(), config.into_bytes()),
            (OUTCOME.into(), self.outcome.clone().into_bytes()),
            (README.into(), READ_ME.into()),
        ]
        .into();
        part::put(&self.part, &mut entries).map_err(|e| unwritable(&e))?;
        let total: u64 = entries.values().map(|content| content.len() as u64).sum();
        if total > MOST_BYTES {
            let problem = format!("it would hold {total} bytes, more than {MOST_BYTES}");
            return Err(Error::Unwritable(problem));
        }
        let row = |content: &Vec<u8>| EntryRow {
            bytes: content.len() as u64,
            digest: digest(content),
        };
        let manifest = Manifest {
            format: FORMAT,
            winze: self.winze.clone(),
            query: QueryRow {
                path: self.query.path.clone(),
                entry,
            },
            map: (&self.map).into(),
            request: (&self.asked).into(),
            entries: entries.iter().map(|(n, c)| (n.clone(), row(c))).collect(),
        };
        let manifest = serde_json::to_vec_pretty(&manifest).map_err(|e| unwritable(&e))?;
        entries.insert(manifest::NAME.into(), manifest);
        pack(&entries, manifest::NAME).map_err(|e| unwritable(&e))
    }

    /// Reads a bundle from its bytes; `file` is what messages call it.
    ///
    /// # Errors
    /// Where they are no sound bundle.
    pub fn from_bytes(file: &str, bytes: &[u8]) -> Result<Self> {
        let not = |problem: String| Error::NotABundle {
            file: file.into(),
            problem: shown(&problem),
        };
        let mut packed = Packed::open(bytes).map_err(not)?;
        if !packed.has(manifest::NAME) {
            return Err(not(format!("it has no {}", manifest::NAME)));
        }
        let of = |fault: Fault| fault.of(file);
        let text = packed.entry(manifest::NAME, 1 << 20).map_err(of)?;
        let json = |e: serde_json::Error| Fault::new(manifest::NAME, e).of(file);
        let version: Version = serde_json::from_slice(&text).map_err(json)?;
        if version.format != FORMAT {
            let made_by = printable(manifest::NAME, version.winze);
            return Err(Error::Newer {
                file: file.into(),
                version: version.format,
                known: FORMAT,
                winze: made_by.map_err(of)?,
            });
        }
        let manifest: Manifest = serde_json::from_slice(&text).map_err(json)?;
        let mut entries = unpack(&mut packed, &manifest).map_err(of)?;
        Self::from_entries(manifest, &mut entries).map_err(of)
    }

    fn from_entries(manifest: Manifest, entries: &mut Entries) -> std::result::Result<Self, Fault> {
        let mut take = |name: &str| {
            let content = entries.remove(name);
            content.ok_or_else(|| Fault::new(name, "is missing"))
        };
        let text = |name: &str, bytes: Vec<u8>| {
            String::from_utf8(bytes).map_err(|_| Fault::new(name, "is no text"))
        };
        if manifest.query.entry != query_entry(Path::new(&manifest.query.path)) {
            let problem = "query.entry is not named after query.path";
            return Err(Fault::new(manifest::NAME, problem));
        }
        let query = QueryFile {
            path: manifest.query.path,
            bytes: take(&manifest.query.entry)?,
        };
        let config: Config = toml::from_str(&text(CONFIG, take(CONFIG)?)?)
            .map_err(|e| Fault::new(CONFIG, e.message()))?;
        config.validate().map_err(|e| Fault::new(CONFIG, e))?;
        let outcome = text(OUTCOME, take(OUTCOME)?)?;
        serde_json::from_str::<serde::de::IgnoredAny>(&outcome)
            .map_err(|e| Fault::new(OUTCOME, e))?;
        take(README)?;
        let part = part::take(entries)?;
        if let Some(name) = entries.keys().next() {
            return Err(Fault::new(name, "does not belong in a bundle"));
        }
        Ok(Self {
            winze: printable(manifest::NAME, manifest.winze)?,
            query,
            config,
            asked: manifest.request.read()?,
            map: manifest.map.read()?,
            part,
            outcome,
        })
    }
}

/// The entries that the manifest tells of, which must be all there are.
fn unpack(packed: &mut Packed<'_>, manifest: &Manifest) -> std::result::Result<Entries, Fault> {
    let rows = &manifest.entries;
    let total = rows.values().map(|row| row.bytes);
    let total = total.fold(0u64, u64::saturating_add);
    // Coordinates hardly pack: what unpacks to many times its size holds something else.
    let most = MOST_BYTES.min(MOST_PACKED * packed.size());
    if total > most {
        let problem = format!(
            "tells of {total} bytes, more than the {most} that a file of this size may hold"
        );
        return Err(Fault::new(manifest::NAME, problem));
    }
    if packed.len() != rows.len() + 1 {
        let problem = format!(
            "tells of {} files, the archive has {}",
            rows.len() + 1,
            packed.len()
        );
        return Err(Fault::new(manifest::NAME, problem));
    }
    let mut entries = Entries::new();
    for (name, row) in rows {
        printable(manifest::NAME, name.clone())?;
        let content = packed.entry(name, row.bytes)?;
        if content.len() as u64 != row.bytes || digest(&content) != row.digest {
            return Err(Fault::new(
                name,
                "is not as it was written: its digest is another",
            ));
        }
        entries.insert(name.clone(), content);
    }
    Ok(entries)
}

/// What a query's file is called in the archive: its extension stays, for whoever unpacks it.
fn query_entry(path: &Path) -> String {
    let extension = path
        .extension()
        .and_then(|e| e.to_str())
        .unwrap_or_default();
    let extension = extension.to_ascii_lowercase();
    let plain = extension.chars().all(|c| c.is_ascii_alphanumeric());
    // As long as it cannot be taken for another one.
    if plain && (1..=8).contains(&extension.len()) {
        format!("query.{extension}")
    } else {
        "query".into()
    }
}
