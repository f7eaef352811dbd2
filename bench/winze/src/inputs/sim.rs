//! A simulated mine with six submaps of LiDARs.

use winze::{Cloud, Pose};
use winze_sim::scenario::{Made, Scenario, simulate};

use super::make::Question;

const SCENARIO: &str = include_str!("sim.toml");
const VOXEL: f64 = 0.2;
const SEED: u64 = 5;

/// Plays the scenario.
pub(crate) fn question() -> anyhow::Result<Question> {
    let scenario = Scenario::parse(SCENARIO, "sim.toml")?;
    let mut map = None;
    let mut queries: Vec<(Cloud, Pose)> = Vec::new();
    simulate(&scenario, SEED, &|_| {}, |made| {
        match made {
            Made::Map(m) => map = Some(m.cloud.clone()),
            Made::Query(q) => {
                if let Some(truth) = q.case.truth {
                    queries.push((q.cloud, Pose::from_matrix(truth)?));
                }
            }
            Made::Mesh { .. } => {}
        }
        anyhow::Ok(())
    })?;
    let map = map.ok_or_else(|| anyhow::anyhow!("sim.toml makes no map"))?;
    for cloud in queries.iter().map(|q| &q.0).chain([&map]) {
        anyhow::ensure!(cloud.origin() == [0.0; 3], "sim.toml: an origin is not 0");
    }
    Ok(Question {
        map,
        queries,
        voxel: VOXEL,
        seed: 0,
    })
}
