//! Refusals that can be made before anything is simulated.

use std::collections::BTreeSet;

use winze::vec3::line_length;

use super::{MapSpec, Mine, Place, QuerySpec, Scenario, mapped_share};
use crate::error::{Error, Result, within};

/// As far from the origin as a mesh can lie, metres.
const FAR: f64 = 60_000.0;
/// More cases than anybody waits for, and longer lines, metres.
const MOST: usize = 100_000;
const LONGEST: f64 = 100_000.0;

impl Scenario {
    /// Checks every setting that can be checked beforehand.
    ///
    /// # Errors
    /// [`Error::Setting`] with its key.
    pub fn validate(&self) -> Result<()> {
        named("name", &self.name)?;
        if self.mines.is_empty() {
            return Err(refused("mine", "there is none; add a [[mine]]"));
        }
        if self.cases() > MOST {
            return Err(refused("count", &format!("more than {MOST} cases")));
        }
        let mut families = BTreeSet::new();
        let mut mines = BTreeSet::new();
        for mine in &self.mines {
            let key = format!("mine \"{}\"", mine.name);
            named(&key, &mine.name)?;
            if !mines.insert(&mine.name) {
                return Err(refused(&key, "there are two of this name"));
            }
            check_mine(&key, mine)?;
            for query in &mine.queries {
                let key = format!("{key}, query \"{}\"", query.name);
                named(&key, &query.name)?;
                if !families.insert(&query.name) {
                    return Err(refused(&key, "there are two of this name"));
                }
                check_query(&key, query)?;
                self.check_map_of(&key, mine, query)?;
            }
        }
        Ok(())
    }

    /// The map that a query asks in must exist, and have a border where one is asked for.
    fn check_map_of(&self, key: &str, mine: &Mine, query: &QuerySpec) -> Result<()> {
        let name = query.asks_in.as_ref().unwrap_or(&mine.name);
        let map = self
            .mines
            .iter()
            .find(|m| m.name == *name)
            .and_then(|m| m.map.as_ref());
        if map.is_none() {
            return Err(refused(
                &format!("{key}.asks_in"),
                &format!("no mine \"{name}\" has a [mine.map]"),
            ));
        }
        if (query.through.is_some() || query.via.is_some()) && query.place != Place::Mapped {
            return Err(refused(
                &format!("{key}.place"),
                "the way is given by through or via; leave one of them out",
            ));
        }
        if mine.mesh.is_some() && query.change.is_some() {
            return Err(refused(
                &format!("{key}.change"),
                "a mine from a mesh is changed by another mesh; give it as the query's later_mesh",
            ));
        }
        if mine.mesh.is_none() && query.later_mesh.is_some() {
            return Err(refused(
                &format!("{key}.later_mesh"),
                "the mine is made, not read; give a change instead",
            ));
        }
        let whole = mine.map.as_ref().is_none_or(|m| m.leave_out == 0.0);
        if whole && query.place != Place::Mapped {
            return Err(refused(
                &format!("{key}.place"),
                "the whole mine is mapped; set the map's leave_out",
            ));
        }
        Ok(())
    }
}

fn check_mine(key: &str, mine: &Mine) -> Result<()> {
    match (&mine.world, &mine.mesh) {
        (Some(world), None) => world.validate().map_err(|e| e.at(key))?,
        (None, Some(_)) => {}
        _ => return Err(refused(key, "give world or mesh, one of them")),
    }
    let robot = &mine.robot;
    within(&format!("{key}.robot.radius"), robot.radius, 0.05, 20.0)?;
    within(&format!("{key}.robot.height"), robot.height, 0.05, 50.0)?;
    mine.map
        .as_ref()
        .map_or(Ok(()), |m| check_map(&format!("{key}.map"), m))
}

fn check_map(key: &str, map: &MapSpec) -> Result<()> {
    map.sensor.0.validate().map_err(|e| e.at(key))?;
    map.motion.validate(&format!("{key}.motion"))?;
    map.dust.validate().map_err(|e| e.at(key))?;
    within(&format!("{key}.spacing"), map.spacing, 1.0, 1000.0)?;
    within(&format!("{key}.voxel"), map.voxel, 0.005, 5.0)?;
    within(&format!("{key}.leave_out"), map.leave_out, 0.0, 0.9)?;
    within(&format!("{key}.warp"), map.warp, 0.0, 0.1)?;
    if (map.through.is_some() || map.via.is_some()) && map.leave_out > 0.0 {
        return Err(refused(
            &format!("{key}.leave_out"),
            "the way is given by through or via, and what it does not see is not mapped",
        ));
    }
    one_way(key, map.through.is_some(), map.via.as_ref())?;
    for v in map.origin {
        within(&format!("{key}.origin"), v, -1e8, 1e8)?;
    }
    lines(&format!("{key}.through"), map.through.iter().flatten())
}

fn check_query(key: &str, query: &QuerySpec) -> Result<()> {
    if query.sensors.is_empty() {
        return Err(refused(&format!("{key}.sensors"), "there is none"));
    }
    for sensor in &query.sensors {
        sensor.0.validate().map_err(|e| e.at(key))?;
    }
    query.motion.validate(&format!("{key}.motion"))?;
    query.dust.validate().map_err(|e| e.at(key))?;
    if let Some(change) = &query.change {
        change.validate().map_err(|e| e.at(key))?;
    }
    let drift = &query.drift;
    for (name, value) in [
        ("translation_percent", drift.translation_percent),
        ("heading_per_metre", drift.heading_per_metre),
        ("walk", drift.walk),
        ("heading_walk", drift.heading_walk),
    ] {
        within(&format!("{key}.drift.{name}"), value, 0.0, 50.0)?;
    }
    let [shortest, longest] = query.length;
    within(&format!("{key}.length"), longest, 1.0, 1e4)?;
    within(&format!("{key}.length"), shortest, 1.0, longest)?;
    let [least, most] = query.mapped_share;
    within(&format!("{key}.mapped_share"), most, 0.0, 1.0)?;
    within(&format!("{key}.mapped_share"), least, 0.0, most)?;
    if query.place != Place::Border && query.mapped_share != mapped_share() {
        return Err(refused(
            &format!("{key}.mapped_share"),
            "only drives on the border have one; set place = \"border\"",
        ));
    }
    one_way(key, query.through.is_some(), query.via.as_ref())?;
    within(&format!("{key}.voxel"), query.voxel, 0.005, 5.0)?;
    within(&format!("{key}.away"), query.away, 0.0, 1e7)?;
    for v in query.tolerance {
        within(&format!("{key}.tolerance"), v, 1e-6, 1e3)?;
    }
    for v in query.map_from_query.iter().flatten() {
        within(&format!("{key}.map_from_query"), *v, -1e8, 1e8)?;
    }
    lines(&format!("{key}.through"), query.through.iter())
}

/// A way is given once; ways through free space take two places or more.
fn one_way(key: &str, through: bool, via: Option<&Vec<[f64; 3]>>) -> Result<()> {
    let Some(via) = via else { return Ok(()) };
    let key = format!("{key}.via");
    if through {
        return Err(refused(
            &key,
            "the way is given by through too; leave one of them out",
        ));
    }
    if via.len() < 2 {
        return Err(refused(
            &key,
            "a way goes from one place to another: name two or more",
        ));
    }
    lines(&key, std::iter::once(via))
}

fn lines<'a>(key: &str, lines: impl Iterator<Item = &'a Vec<[f64; 3]>>) -> Result<()> {
    let all: Vec<&Vec<[f64; 3]>> = lines.collect();
    let bad =
        |line: &&Vec<[f64; 3]>| line.is_empty() || line.iter().flatten().any(|v| !(v.abs() < FAR));
    if all.iter().any(bad) {
        return Err(refused(
            key,
            "a line without points, or with one that is not finite or 60 km away",
        ));
    }
    let too_long = |line: &&Vec<[f64; 3]>| line_length(line) > LONGEST;
    if all.iter().any(too_long) {
        return Err(refused(key, "a line of more than 100 km"));
    }
    Ok(())
}

/// Names become file names.
fn named(key: &str, name: &str) -> Result<()> {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(plain) || name.len() > 60 {
        return Err(refused(
            key,
            "a name is made of up to 60 letters, digits, '-', '_' and '.', for it becomes a file's",
        ));
    }
    Ok(())
}

fn refused(key: &str, why: &str) -> Error {
    Error::Setting {
        key: key.into(),
        why: why.into(),
    }
}
