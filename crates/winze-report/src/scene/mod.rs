//! What a page shows in three dimensions: the clouds, thinned and packed, and everything that is drawn about them.
//!
//! The scene's axes are the map's, its zero lies at the query's centroid where the answer puts it, so that what is near it
//! keeps its precision on a graphics card, whatever the map's coordinates.

mod doubt;
mod places;
mod thinned;
mod tiles;

use serde::Serialize;
use winze::config::VerifyConfig;
use winze::outcome::RankedHypothesis;
use winze::prepare::Surface;
use winze::{Cloud, Outcome, Pose, Verdict};

use doubt::{Ellipsoid, Open};
use places::{Colours, Patches, Place};
use tiles::Packed;

pub(crate) use doubt::ellipsoid;
use thinned::Thinned;

/// Places that can be chosen, at most; rivals further down come besides.
const PLACES: usize = 10;

/// The hypotheses that are shown, with their numbers.
pub(crate) fn shown(outcome: &Outcome) -> Vec<(usize, &RankedHypothesis)> {
    let all = outcome.hypotheses.iter().enumerate();
    all.filter(|(i, h)| *i < PLACES || h.rival)
        .take(2 * PLACES)
        .collect()
}

/// How many points are drawn at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Of the map.
    pub map: usize,
    /// Of the query.
    pub query: usize,
}

impl Limits {
    /// For one of several runs on a page.
    pub const RUN: Self = Self {
        map: 60_000,
        query: 20_000,
    };

    /// For a page about one answer: some ten megabytes.
    pub const PAGE: Self = Self {
        map: 1_200_000,
        query: 200_000,
    };
}

/// What the verdict was taken on.
#[derive(Debug, Clone, Copy)]
pub struct Judged<'a> {
    /// The map's surface.
    pub map: &'a Surface<'a>,
    /// The query's.
    pub query: &'a Surface<'a>,
    /// With lengths for this map.
    pub verify: &'a VerifyConfig,
}

/// All of it, as the page's viewer reads it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scene {
    /// Other places of note are drawn beside the chosen one.
    ghosts: bool,
    /// The first place is a guess, not an answer.
    guess: bool,
    /// The scene's zero, in the map's frame, metres.
    origin: [f64; 3],
    map: Packed,
    /// About its centroid, in its own axes.
    query: Packed,
    before: Before,
    places: Vec<Place>,
    colours: Option<Colours>,
    patches: Option<Patches>,
    open: Vec<Open>,
    ellipsoid: Option<Ellipsoid>,
}

/// Where the query lies as it came.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Before {
    /// Its centroid in the scene, metres.
    at: [f64; 3],
    /// How far it was moved to lie beside the map, metres; 0 where its own frame puts it near enough.
    moved: f64,
}

impl Scene {
    pub(crate) fn has_places(&self) -> bool {
        !self.places.is_empty()
    }

    pub(crate) fn has_patches(&self) -> bool {
        self.patches.is_some()
    }

    /// The first place is a guess.
    pub(crate) fn is_guess(&self) -> bool {
        self.guess
    }

    /// The query is drawn faintly where else it could be.
    pub(crate) fn has_ghosts(&self) -> bool {
        self.ghosts && self.places.iter().any(Place::is_rival)
    }

    /// How far the query was moved to be shown before, metres.
    pub(crate) fn moved(&self) -> f64 {
        self.before.moved
    }

    pub(crate) fn ellipsoid(&self) -> Option<&Ellipsoid> {
        self.ellipsoid.as_ref()
    }

    /// What residuals are coloured by, metres: what lies finely, the worst that is told apart, and where the map is out of reach.
    pub(crate) fn reach(&self) -> Option<[f64; 3]> {
        self.colours.as_ref().map(Colours::reach)
    }
}

/// The scene of an answer. Without what it was `judged` by, nothing is coloured by residuals.
#[must_use]
pub fn scene(
    map: &Cloud,
    query: &Cloud,
    outcome: &Outcome,
    judged: Option<Judged<'_>>,
    limits: Limits,
) -> Scene {
    let middle = query.centroid().unwrap_or_default();
    let map_middle = map.centroid().unwrap_or_default();
    let origin = outcome
        .map_from_query
        .map_or(map_middle, |p| p.transform(middle));
    let drawn_map = Thinned::of(map, limits.map);
    let drawn = Thinned::of(query, limits.query);
    let (map, _) = Packed::of(&drawn_map, origin);
    let (packed, order) = Packed::of(&drawn, middle);
    let shown = shown(outcome);
    let in_order: Vec<[f64; 3]> = order.iter().map(|i| drawn.points[*i]).collect();
    Scene {
        ghosts: outcome.verdict == Verdict::Ambiguous,
        guess: !matches!(outcome.verdict, Verdict::Located | Verdict::Degenerate),
        origin,
        before: before(&drawn_map.points, &drawn.points, middle, origin),
        map,
        query: packed,
        colours: judged.map(|j| Colours::of(&in_order, &shown, &j)),
        patches: judged.and_then(|j| Patches::of(&shown, &j, middle)),
        places: places::places(outcome, &shown, middle, origin),
        open: doubt::open(outcome),
        ellipsoid: doubt::ellipsoid(outcome),
    }
}

/// The scene of an evaluated run: where the query was put, if anywhere, and where it is, if known, with the map around.
#[must_use]
pub fn scene_of_run(
    map: &Cloud,
    query: &Cloud,
    found: Option<&Pose>,
    truth: Option<&Pose>,
    limits: Limits,
) -> Scene {
    let middle = query.centroid().unwrap_or_default();
    let poses: Vec<&Pose> = found.into_iter().chain(truth).collect();
    let near = around(map, query, middle, &poses);
    let map_middle = near.centroid().unwrap_or_default();
    let origin = poses.first().map_or(map_middle, |p| p.transform(middle));
    let drawn_map = Thinned::of(&near, limits.map);
    let drawn = Thinned::of(query, limits.query);
    let before = before(&drawn_map.points, &drawn.points, middle, origin);
    Scene {
        ghosts: true,
        guess: false,
        origin,
        before,
        map: Packed::of(&drawn_map, origin).0,
        query: Packed::of(&drawn, middle).0,
        places: places::of_poses(&poses, middle, origin),
        colours: None,
        patches: None,
        open: Vec::new(),
        ellipsoid: None,
    }
}

/// What of a map is shown around the places that a query is put at, in lengths of the query.
const AROUND: f64 = 2.5;

/// The map's points near any of the poses; all of them where there is none.
fn around(map: &Cloud, query: &Cloud, middle: [f64; 3], poses: &[&Pose]) -> Cloud {
    let far = |p: [f64; 3], c: [f64; 3]| winze::vec3::distance(p, c);
    let size = query.iter().map(|p| far(p, middle)).fold(1.0, f64::max);
    let centres: Vec<[f64; 3]> = poses.iter().map(|p| p.transform(middle)).collect();
    if centres.is_empty() {
        return map.clone();
    }
    let near = |p: [f64; 3]| centres.iter().any(|c| far(p, *c) < AROUND * size);
    let chosen: Vec<u32> = (0u32..)
        .zip(map.iter())
        .filter_map(|(i, p)| near(p).then_some(i))
        .collect();
    map.select(&chosen)
}

/// In its own frame, or beside the map where that frame lies so far off that both would be specks.
fn before(map: &[[f64; 3]], query: &[[f64; 3]], middle: [f64; 3], origin: [f64; 3]) -> Before {
    let apart = crate::picture::Apart::of(map, query);
    let at = apart.beside(middle);
    Before {
        at: std::array::from_fn(|a| at[a] - origin[a]),
        moved: apart.metres(),
    }
}

/// Bytes for a page.
fn base64<S: serde::Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    use ::base64::Engine as _;
    serializer.serialize_str(&::base64::engine::general_purpose::STANDARD.encode(bytes))
}
