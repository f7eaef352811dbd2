//! Points in two bytes an axis. A tile is a cube with a corner of its own, so that millimetres are kept in maps of any extent, and
//! a viewer can pass over those that are out of sight.

use serde::Serialize;

use super::Thinned;

/// Edge of a tile, metres: 1 mm a step.
const EDGE: f64 = 64.0;

/// Points for the viewer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Packed {
    /// Edge of a tile, metres: what 65535 means.
    edge: f64,
    /// How far apart neighbours lie, metres.
    spacing: f64,
    tiles: Vec<Tile>,
    /// `u16`, little-endian, x y z, tile by tile.
    #[serde(serialize_with = "super::base64")]
    points: Vec<u8>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct Tile {
    /// Its corner from where the points are counted, metres.
    low: [f64; 3],
    count: usize,
}

impl Packed {
    /// Points counted from `origin`, and the order in which they are packed.
    pub(crate) fn of(drawn: &Thinned, origin: [f64; 3]) -> (Self, Vec<usize>) {
        let offset = |i: usize| -> [f64; 3] {
            let p = drawn.points[i];
            std::array::from_fn(|a| p[a] - origin[a])
        };
        let mut order: Vec<usize> = (0..drawn.points.len()).collect();
        order.sort_by_key(|i| (cell(offset(*i)), *i));
        let mut points = Vec::with_capacity(6 * order.len());
        let mut tiles = Vec::new();
        for group in order.chunk_by(|a, b| cell(offset(*a)) == cell(offset(*b))) {
            let Some(first) = group.first() else { continue };
            #[expect(clippy::cast_precision_loss, reason = "cells of a map on earth")]
            let low = cell(offset(*first)).map(|c| c as f64 * EDGE);
            tiles.push(Tile {
                low,
                count: group.len(),
            });
            for i in group {
                let p = offset(*i);
                for a in 0..3 {
                    let share = ((p[a] - low[a]) / EDGE).clamp(0.0, 1.0);
                    #[expect(
                        clippy::cast_possible_truncation,
                        clippy::cast_sign_loss,
                        reason = "0 to 65535"
                    )]
                    let step = (share * f64::from(u16::MAX)).round() as u16;
                    points.extend(step.to_le_bytes());
                }
            }
        }
        let packed = Self {
            edge: EDGE,
            spacing: drawn.spacing,
            tiles,
            points,
        };
        (packed, order)
    }
}

/// Which tile a point lies in.
fn cell(p: [f64; 3]) -> [i64; 3] {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a map on earth is not that wide"
    )]
    p.map(|v| (v / EDGE).floor() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_far_away_come_back_to_a_millimetre() {
        let origin = [455_000.0, 4_412_000.0, 1_200.0];
        let points: Vec<[f64; 3]> = (0..500)
            .map(|i| {
                let t = f64::from(i);
                [
                    origin[0] + 0.731 * t,
                    origin[1] - 1.3 * t,
                    origin[2] + 0.01 * t,
                ]
            })
            .collect();
        let drawn = Thinned {
            points: points.clone(),
            spacing: 1.0,
        };
        let (packed, order) = Packed::of(&drawn, origin);
        assert_eq!(packed.tiles.iter().map(|t| t.count).sum::<usize>(), 500);
        assert!(packed.tiles.len() > 5);
        let tile_of = packed.tiles.iter().flat_map(|t| vec![t; t.count]);
        for ((six, tile), i) in packed.points.chunks_exact(6).zip(tile_of).zip(order) {
            for a in 0..3 {
                let step = u16::from_le_bytes([six[2 * a], six[2 * a + 1]]);
                let back = origin[a] + tile.low[a] + f64::from(step) / 65535.0 * packed.edge;
                assert!((back - points[i][a]).abs() < 0.001);
            }
        }
    }
}
