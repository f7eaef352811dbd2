//! The prior map as it was given: a cloud, or one that was prepared beforehand.

use std::borrow::Cow;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use winze::outcome::Stage;
use winze::{Cloud, Config, KeptMap, PreparedMap as _};
use winze_io::CloudFile;
use winze_map::Map;
use winze_report::Source;

use crate::reading::read;
use crate::settings::{self, Layers};

/// Points of a map in a picture, at most.
const DRAWN: usize = 2_000_000;

/// A prior map.
#[derive(Debug)]
pub enum Prior {
    /// A cloud, read.
    Cloud(Box<CloudFile>),
    /// A map that was prepared beforehand, opened.
    Built(Box<Map>),
}

impl Prior {
    /// Opens a built map, by its first bytes or its name, or reads a cloud; `tracing` is told of what is odd about it.
    ///
    /// # Errors
    /// A [`winze_io::Error`] or a [`winze_map::Error`] where the file cannot be read or holds neither.
    pub fn open(path: &Path) -> anyhow::Result<Self> {
        if !is_built(path) {
            return Ok(Self::Cloud(Box::new(read(path)?)));
        }
        let map = Map::open(path)?;
        let unknown: Vec<String> = map.unknown_sections().map(|e| e.id.to_string()).collect();
        if !unknown.is_empty() {
            tracing::warn!(
                "{}: made by a newer winze: sections {} are passed over",
                path.display(),
                unknown.join(", ")
            );
        }
        Ok(Self::Built(Box::new(map)))
    }

    /// The built map that it is, if it is one.
    #[must_use]
    pub fn built(&self) -> Option<&Map> {
        match self {
            Self::Cloud(_) => None,
            Self::Built(map) => Some(map),
        }
    }

    /// The settings of a run on this map.
    ///
    /// # Errors
    /// As [`settings::effective_for`].
    pub fn config(&self, layers: &Layers<'_>) -> anyhow::Result<Config> {
        match self {
            Self::Cloud(_) => settings::effective(layers),
            Self::Built(map) => settings::effective_for(map, layers),
        }
    }

    /// To ask.
    #[must_use]
    pub fn kept(&self) -> KeptMap<'_> {
        match self {
            Self::Cloud(file) => KeptMap::new(&file.cloud),
            Self::Built(map) => KeptMap::prepared(map.as_ref()),
        }
    }

    /// Reading it as a stage of a run, which took so many seconds.
    #[must_use]
    pub fn stage(&self, seconds: f64) -> Stage {
        let (count_in, count_out) = match self {
            Self::Cloud(file) => (file.report.points_in_file, file.cloud.len()),
            Self::Built(map) => (map.points(), map.points()),
        };
        Stage {
            name: "read map".into(),
            seconds,
            count_in,
            count_out,
        }
    }

    /// Digest of its file.
    #[must_use]
    pub fn digest(&self) -> String {
        match self {
            Self::Cloud(file) => file.report.digest.clone(),
            Self::Built(map) => map.digest(),
        }
    }

    /// What the outcome says of it; `path` is how it was named.
    #[must_use]
    pub fn source(&self, path: &Path) -> Source {
        Source {
            path: Some(path.display().to_string()),
            digest: Some(self.digest()),
            points: self.points(),
        }
    }

    /// Points of the cloud or clouds that are used.
    #[must_use]
    pub fn points(&self) -> usize {
        match self {
            Self::Cloud(file) => file.cloud.len(),
            Self::Built(map) => map.points(),
        }
    }

    /// Something to draw: the cloud, or points of the built map's finest level.
    ///
    /// # Errors
    /// A [`winze::Error`] where that level of the file is broken.
    pub fn picture(&self) -> anyhow::Result<Cow<'_, Cloud>> {
        match self {
            Self::Cloud(file) => Ok(Cow::Borrowed(&file.cloud)),
            Self::Built(map) => Ok(Cow::Owned(drawn(map)?)),
        }
    }
}

/// Points of a built map's finest level, to draw.
///
/// # Errors
/// A [`winze::Error`] where that level of the file is broken.
pub fn drawn(map: &Map) -> anyhow::Result<Cloud> {
    let surface = map.surface(0)?;
    let step = surface.points.len().div_ceil(DRAWN).max(1);
    let points: Vec<[f64; 3]> = surface.iter().step_by(step).collect();
    Ok(Cloud::from_points(&points)?.0)
}

/// Whether a file is, or says that it is, a built map.
#[must_use]
pub fn is_built(path: &Path) -> bool {
    // A pipe would lose what is read here.
    if !std::fs::metadata(path).is_ok_and(|m| m.is_file()) {
        return false;
    }
    let mut first = [0; 8];
    let magic = File::open(path).and_then(|mut f| f.read_exact(&mut first));
    let named = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("wmap"));
    named || (magic.is_ok() && winze_map::is_map(&first))
}
