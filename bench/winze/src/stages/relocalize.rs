//! From raw points to a pose, with no initial guess: `auto` with winze's defaults.

use winze::{Cloud, Config, KeptMap, KeptQuery, Outcome, Pose, Request, locate, locate_in};
use winze_map::Map;

use super::Done;
use crate::inputs::Inputs;
use crate::measure::Bench;

/// A pose is right that puts the query's centroid so near, metres, and turns it by no more, degrees.
const RIGHT: (f64, f64) = (1.5, 5.0);

type Points = Vec<[f32; 3]>;

fn queries(inputs: &Inputs) -> anyhow::Result<Vec<Points>> {
    (0..inputs.queries)
        .map(|i| inputs.rows(&format!("query_{i}.f32")))
        .collect()
}

fn cloud(points: &[[f32; 3]]) -> anyhow::Result<Cloud> {
    Ok(Cloud::with_origin([0.0; 3], points.to_vec())?)
}

pub(super) fn prepared(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let queries = queries(inputs)?;
    let config = Config::default();
    let map = Map::open(&inputs.path("map.wmap"))?;
    let mut kept = KeptMap::prepared(&map);
    let request = Request::default();
    let outcomes = bench.run(|| {
        let mut ask = |q: &Points| -> anyhow::Result<Outcome> {
            let cloud = cloud(q)?;
            Ok(locate_in(
                &mut kept,
                &mut KeptQuery::new(&cloud),
                &config,
                &request,
            )?)
        };
        queries
            .iter()
            .map(&mut ask)
            .collect::<anyhow::Result<Vec<Outcome>>>()
    })?;
    judged(inputs, &queries, &outcomes)
}

pub(super) fn raw(inputs: &Inputs, bench: &mut Bench) -> anyhow::Result<Done> {
    let queries = queries(inputs)?;
    let map: Points = inputs.rows("map.f32")?;
    let config = Config::default();
    let outcomes = bench.run(|| {
        let ask = |q: &Points| Ok(locate(&cloud(&map)?, &cloud(q)?, &config)?);
        queries
            .iter()
            .map(ask)
            .collect::<anyhow::Result<Vec<Outcome>>>()
    })?;
    judged(inputs, &queries, &outcomes)
}

/// The poses, and how many of them are right.
fn judged(inputs: &Inputs, queries: &[Points], outcomes: &[Outcome]) -> anyhow::Result<Done> {
    let mut right = 0;
    for (i, (query, outcome)) in queries.iter().zip(outcomes).enumerate() {
        let truth = inputs.pose(&format!("truth_{i}.f64"))?;
        let error = outcome.error(&truth, &cloud(query)?);
        let is_right =
            |e: winze::PoseDistance| e.translation <= RIGHT.0 && e.rotation.to_degrees() <= RIGHT.1;
        right += usize::from(error.is_some_and(is_right));
    }
    let poses: Vec<Pose> = outcomes
        .iter()
        .map(|o| o.map_from_query.unwrap_or_else(Pose::identity))
        .collect();
    Ok(Done::poses(&poses, right))
}
