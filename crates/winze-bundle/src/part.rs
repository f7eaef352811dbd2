//! The part of the map in a bundle: numbers in JSON, points and normals in arrays beside it.

use serde::{Deserialize, Serialize};
use winze::cloud::MAX_OFFSET;
use winze::part::{Count, Look, MapPart, PartLevel, Reference};
use winze::scale::Measure;

use crate::archive::Entries;
use crate::arrays::{from_npy, to_npy};
use crate::error::Fault;
use crate::manifest::{FAR, Matrix, pose, printable};

/// The numbers.
pub(crate) const NAME: &str = "map/part.json";
const REFERENCE: &str = "map/reference.npy";

fn points_of(level: usize) -> String {
    format!("map/{level}/points.npy")
}

fn normals_of(level: usize) -> String {
    format!("map/{level}/normals.npy")
}

#[derive(Debug, Serialize, Deserialize)]
struct PartRow {
    points: usize,
    built: bool,
    measure: Option<MeasureRow>,
    voxels: Vec<f64>,
    levels: Vec<LevelRow>,
    reference: ReferenceRow,
    looks: Vec<LookRow>,
}

#[derive(Debug, Serialize, Deserialize)]
struct MeasureRow {
    spacing: f64,
    width: Option<f64>,
    width_range: Option<[f64; 2]>,
    budget: f64,
}

#[derive(Debug, Serialize, Deserialize)]
struct LookRow {
    voxel: f64,
    gaussians: usize,
    stages: Vec<StageRow>,
    starts: Vec<Matrix>,
}

#[derive(Debug, Serialize, Deserialize)]
struct StageRow {
    name: String,
    #[serde(rename = "in")]
    count_in: usize,
    #[serde(rename = "out")]
    count_out: usize,
}

#[derive(Debug, Serialize, Deserialize)]
struct LevelRow {
    voxel: f64,
    origin: [f64; 3],
    of: usize,
}

#[derive(Debug, Serialize, Deserialize)]
struct ReferenceRow {
    origin: [f64; 3],
    of: usize,
}

/// Adds the entries of a part.
pub(crate) fn put(part: &MapPart, entries: &mut Entries) -> Result<(), serde_json::Error> {
    let look = |look: &Look| LookRow {
        voxel: look.voxel,
        gaussians: look.gaussians,
        stages: look.stages.iter().map(stage).collect(),
        starts: look.starts.iter().map(winze::Pose::to_matrix).collect(),
    };
    let level = |level: &PartLevel| LevelRow {
        voxel: level.voxel,
        origin: level.origin,
        of: level.of,
    };
    let row = PartRow {
        points: part.points,
        built: part.built,
        measure: part.measure.map(|m| MeasureRow {
            spacing: m.spacing,
            width: m.width,
            width_range: m.width_range,
            budget: m.budget,
        }),
        voxels: part.voxels.clone(),
        levels: part.levels.iter().map(level).collect(),
        reference: ReferenceRow {
            origin: part.reference.origin,
            of: part.reference.of,
        },
        looks: part.looks.iter().map(look).collect(),
    };
    entries.insert(NAME.into(), serde_json::to_vec_pretty(&row)?);
    entries.insert(REFERENCE.into(), to_npy(&part.reference.points));
    for (i, level) in part.levels.iter().enumerate() {
        entries.insert(points_of(i), to_npy(&level.points));
        entries.insert(normals_of(i), to_npy(&level.normals));
    }
    Ok(())
}

fn stage(count: &Count) -> StageRow {
    StageRow {
        name: count.name.clone(),
        count_in: count.count_in,
        count_out: count.count_out,
    }
}

/// Longer lists are none that a run made.
const MOST: usize = 10_000;

/// Takes a part out of the entries of a bundle.
pub(crate) fn take(entries: &mut Entries) -> Result<MapPart, Fault> {
    let fault = |problem: &dyn std::fmt::Display| Fault::new(NAME, problem);
    let text = taken(entries, NAME)?;
    let row: PartRow = serde_json::from_slice(&text).map_err(|e| fault(&e))?;
    let mut lengths = row.levels.iter().map(|l| l.voxel);
    let mut sizes = row.voxels.iter().chain(row.looks.iter().map(|l| &l.voxel));
    if !(lengths.all(is_length) && sizes.all(|v| is_length(*v))) {
        return Err(fault(&"a voxel size is no length"));
    }
    if row.voxels.len().max(row.looks.len()).max(row.levels.len()) > 100 {
        return Err(fault(&"holds more voxel sizes than any run tries"));
    }
    let mut origins = row.levels.iter().map(|l| l.origin);
    if !(origins.all(is_origin) && is_origin(row.reference.origin)) {
        return Err(fault(&"an origin lies too far out"));
    }
    let measure = row.measure.map(measure).transpose()?;
    let looks = row.looks.into_iter().map(look);
    let looks: Vec<Look> = looks.collect::<Result<_, _>>()?;
    let mut levels = Vec::with_capacity(row.levels.len());
    for (i, level) in row.levels.into_iter().enumerate() {
        let points = array(entries, &points_of(i), OUTERMOST)?;
        let normals = array(entries, &normals_of(i), 1.001)?;
        if points.len() != normals.len() || points.len() > level.of {
            return Err(fault(&format_args!(
                "level {i} has {} points and {} normals of {}",
                points.len(),
                normals.len(),
                level.of
            )));
        }
        levels.push(PartLevel {
            voxel: level.voxel,
            origin: level.origin,
            of: level.of,
            points,
            normals,
        });
    }
    Ok(MapPart {
        points: row.points,
        built: row.built,
        measure,
        voxels: row.voxels,
        looks,
        levels,
        reference: Reference {
            origin: row.reference.origin,
            of: row.reference.of,
            points: array(entries, REFERENCE, OUTERMOST)?,
        },
    })
}

/// No offset of a cloud is larger, metres.
#[expect(clippy::cast_possible_truncation, reason = "a power of two and one")]
const OUTERMOST: f32 = (MAX_OFFSET + 1.0) as f32;

fn is_length(v: f64) -> bool {
    (1e-12..=1e9).contains(&v)
}

fn is_origin(origin: [f64; 3]) -> bool {
    origin.iter().all(|v| v.abs() <= FAR)
}

fn taken(entries: &mut Entries, name: &str) -> Result<Vec<u8>, Fault> {
    let content = entries.remove(name);
    content.ok_or_else(|| Fault::new(name, "is missing"))
}

fn array(entries: &mut Entries, name: &str, most: f32) -> Result<Vec<[f32; 3]>, Fault> {
    from_npy(&taken(entries, name)?, most).map_err(|problem| Fault::new(name, problem))
}

fn measure(row: MeasureRow) -> Result<Measure, Fault> {
    let widths = row
        .width
        .into_iter()
        .chain(row.width_range.into_iter().flatten());
    let mut lengths = [row.spacing, row.budget].into_iter().chain(widths);
    if !lengths.all(is_length) {
        return Err(Fault::new(NAME, "measure holds what is no length"));
    }
    Ok(Measure {
        spacing: row.spacing,
        width: row.width,
        width_range: row.width_range,
        budget: row.budget,
    })
}

fn look(row: LookRow) -> Result<Look, Fault> {
    if row.starts.len().max(row.stages.len()) > MOST {
        return Err(Fault::new(NAME, "holds more poses than any run refines"));
    }
    let stages = row.stages.into_iter().map(|s| {
        Ok(Count {
            name: printable(NAME, s.name)?,
            count_in: s.count_in,
            count_out: s.count_out,
        })
    });
    let starts = row.starts.into_iter().map(|m| pose(NAME, m));
    Ok(Look {
        voxel: row.voxel,
        stages: stages.collect::<Result<_, _>>()?,
        starts: starts.collect::<Result<_, _>>()?,
        gaussians: row.gaussians,
    })
}
