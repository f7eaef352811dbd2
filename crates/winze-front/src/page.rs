//! The page about one answer: what it shows besides the answer itself.

use winze::config::VerifyConfig;
use winze::{Cloud, Config, KeptMap, KeptQuery, Outcome, PoseDistance};
use winze_report::{Document, Judged, Limits, Report, Scene, scene};

/// What a page needs besides the outcome and its document.
#[derive(Debug)]
pub struct Page {
    scene: Scene,
    verify: VerifyConfig,
    with_normal: Option<usize>,
    command: String,
}

impl Page {
    /// Of an `outcome` that was just had from the map and the query; `map` is what is drawn of the former,
    /// `command` a command line that asks the same.
    ///
    /// # Errors
    /// A [`winze::Error`] where a built map's file turns out to be broken.
    pub fn of(
        map: &Cloud,
        (kept_map, kept_query): (&mut KeptMap<'_>, &mut KeptQuery<'_>),
        outcome: &Outcome,
        config: &Config,
        command: String,
    ) -> anyhow::Result<Self> {
        let query = kept_query.cloud();
        // A query that is refused for want of them has no pose, and is counted all the same.
        let with_normal = outcome.voxel.map(|voxel| {
            let normals = &kept_query.surface(voxel, config).normals;
            normals.iter().filter(|n| **n != [0.0; 3]).count()
        });
        let Some(voxel) = outcome.voxel.filter(|_| outcome.map_from_query.is_some()) else {
            return Ok(Self {
                scene: scene(map, query, outcome, None, Limits::PAGE),
                verify: config.verify.clone(),
                with_normal,
                command,
            });
        };
        let verify = kept_map.verification(voxel, config);
        let judged = Judged {
            map: kept_map.surface(voxel, config)?,
            query: kept_query.surface(voxel, config),
            verify: &verify,
        };
        Ok(Self {
            scene: scene(map, query, outcome, Some(judged), Limits::PAGE),
            verify,
            with_normal,
            command,
        })
    }

    /// The page, of the outcome that it was made of; `error` is the distance from a known truth, `png` the picture for
    /// browsers that show nothing else.
    #[must_use]
    pub fn html(
        &self,
        outcome: &Outcome,
        error: Option<&PoseDistance>,
        document: &Document,
        png: &[u8],
    ) -> String {
        winze_report::page(&Report {
            outcome,
            error,
            document,
            verify: &self.verify,
            with_normal: self.with_normal,
            command: &self.command,
            scene: &self.scene,
            png,
        })
    }
}
