//! Places by looking through vertical columns, and which of them are joined.

use rayon::prelude::*;
use winze::vec3::{add, scale};

use super::{NONE, Robot, is_open};
use crate::raycast::Caster;

/// Columns, metres apart; more where there would be too many.
const CELL: f64 = 0.5;
/// The most columns.
const MAX_COLUMNS: f64 = 2e6;
/// The most surfaces above each other that are looked at.
const MAX_SURFACES: usize = 64;
/// The highest step to a neighbouring place, as a share of the distance to it: 39 degrees.
const MAX_STEP: f64 = 0.8;
/// Surfaces nearer to each other than this are one, metres.
const SAME: f64 = 1e-3;

/// A grid of columns.
pub(super) struct Grid {
    pub(super) cell: f64,
    low: [f64; 2],
    top: f64,
    count: [u32; 2],
}

impl Grid {
    /// Over a whole mesh.
    pub(super) fn over(caster: &Caster) -> Self {
        let (low, high) = caster.mesh().bounds().unwrap_or_default();
        let (low, high) = (low.map(f64::from), high.map(f64::from));
        let size = [high[0] - low[0], high[1] - low[1]];
        let cell = CELL
            .max((size[0] * size[1] / MAX_COLUMNS).sqrt())
            .max(size[0].max(size[1]) / MAX_COLUMNS);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most the most columns"
        )]
        let count = size.map(|s| (s / cell).ceil() as u32 + 1);
        Self {
            cell,
            // Meshes like round coordinates, and edges and upright walls are there; columns should not be.
            low: [low[0] - 0.4137 * cell, low[1] - 0.3719 * cell],
            top: high[2] + 1.0,
            count,
        }
    }

    fn x_y(&self, column: [u32; 2]) -> [f64; 2] {
        std::array::from_fn(|a| self.low[a] + self.cell * f64::from(column[a]))
    }
}

/// A place of the sensor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) at: [f64; 3],
    /// There is a surface above it.
    pub(super) roofed: bool,
    column: [u32; 2],
}

/// All places, by column.
pub(super) fn places(caster: &Caster, robot: &Robot, grid: &Grid) -> Vec<Place> {
    let rows: Vec<Vec<Place>> = (0..grid.count[1])
        .into_par_iter()
        .map(|y| {
            (0..grid.count[0])
                .flat_map(|x| column(caster, robot, grid, [x, y]))
                .collect()
        })
        .collect();
    rows.concat()
}

/// The places of one column, from the top.
fn column(caster: &Caster, robot: &Robot, grid: &Grid, column: [u32; 2]) -> Vec<Place> {
    let [x, y] = grid.x_y(column);
    let mut out = Vec::new();
    let mut from = grid.top;
    let mut roof: Option<f64> = None;
    for _ in 0..MAX_SURFACES {
        let Some(hit) = caster.cast([x, y, from], [0.0, 0.0, -1.0], f64::INFINITY) else {
            break;
        };
        let floor = from - hit.range;
        let at = [x, y, floor + robot.height];
        let high_enough = roof.is_none_or(|r| r - at[2] >= robot.clearance());
        if high_enough && caster.nearest(at, robot.clearance()).is_none() {
            out.push(Place {
                at,
                roofed: roof.is_some(),
                column,
            });
        }
        roof = Some(floor);
        from = floor - SAME;
    }
    out
}

/// For each place the eight around it that can be gone to and come back from, [`NONE`] where there is none.
pub(super) fn links(
    caster: &Caster,
    robot: &Robot,
    grid: &Grid,
    places: &[Place],
) -> Vec<[u32; 8]> {
    const AROUND: [[i64; 2]; 8] = [
        [-1, -1],
        [0, -1],
        [1, -1],
        [-1, 0],
        [1, 0],
        [-1, 1],
        [0, 1],
        [1, 1],
    ];
    // Places lie in the order of their columns, row by row.
    let key = |c: [u32; 2]| (c[1], c[0]);
    let candidate = |i: usize, direction: usize| -> u32 {
        let (Some(place), Some(d)) = (places.get(i), AROUND.get(direction)) else {
            return NONE;
        };
        let moved = |a: usize| u32::try_from(i64::from(place.column[a]) + d[a]).ok();
        let (Some(x), Some(y)) = (moved(0), moved(1)) else {
            return NONE;
        };
        let first = places.partition_point(|p| key(p.column) < (y, x));
        #[expect(clippy::cast_precision_loss, reason = "one or two")]
        let flat = grid.cell * ((d[0] * d[0] + d[1] * d[1]) as f64).sqrt();
        let mut best = (MAX_STEP * flat, NONE);
        for (j, other) in places.iter().enumerate().skip(first) {
            if other.column != [x, y] {
                break;
            }
            let step = (other.at[2] - place.at[2]).abs();
            if step < best.0 {
                best = (step, u32::try_from(j).unwrap_or(NONE));
            }
        }
        best.1
    };
    let nearest: Vec<[u32; 8]> = (0..places.len())
        .into_par_iter()
        .map(|i| std::array::from_fn(|d| candidate(i, d)))
        .collect();
    // The first four directions are decided, the others are their opposites.
    let decided: Vec<[bool; 4]> = (0..places.len())
        .into_par_iter()
        .map(|i| {
            std::array::from_fn(|d| {
                let there = nearest.get(i).map_or(NONE, |n| n[d]);
                let back = nearest.get(there as usize).map_or(NONE, |n| n[7 - d]);
                back as usize == i && can_go(caster, robot, places, i, there)
            })
        })
        .collect();
    nearest
        .iter()
        .enumerate()
        .map(|(i, n)| {
            std::array::from_fn(|d| {
                let (owner, direction) = if d < 4 {
                    (i, d)
                } else {
                    (n[d] as usize, 7 - d)
                };
                let to = nearest.get(owner).map_or(NONE, |o| o[direction]);
                let mutual = d < 4 || to as usize == i;
                let open = decided.get(owner).is_some_and(|o| o[direction]);
                if mutual && open { n[d] } else { NONE }
            })
        })
        .collect()
}

/// Whether nothing lies between two places, nor near to the middle of the way.
fn can_go(caster: &Caster, robot: &Robot, places: &[Place], from: usize, to: u32) -> bool {
    let (Some(a), Some(b)) = (places.get(from), places.get(to as usize)) else {
        return false;
    };
    let middle = scale(add(a.at, b.at), 0.5);
    is_open(caster, a.at, b.at) && caster.nearest(middle, 0.8 * robot.clearance()).is_none()
}
