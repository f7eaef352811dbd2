//! A small picture of one answer, for a sheet of many: as the clouds came, then, from nearer, where the query was
//! found and where it belongs; from above.

use winze::{Cloud, Pose};

use crate::Error;
use crate::canvas::{Area, Canvas};
use crate::picture::{
    Apart, BACKGROUND, Frame, GREEN, INK, MAGENTA, PANEL, Scale, View, frame, join, thin,
};

const PANEL_SIZE: usize = 300;
const GAP: usize = 8;
const TITLE: usize = 24;
/// Points of each cloud drawn at most, and points of a map that are looked through for them.
const DRAWN: usize = 60_000;
const LOOKED_AT: usize = 3_000_000;
/// What is shown around a query, as a share of its size, and at least, metres.
const AROUND: (f64, f64) = (0.25, 4.0);

/// The picture as PNG bytes: before, found, true. A panel without a pose says so.
///
/// # Errors
/// Where the PNG encoder refuses.
pub fn thumbnail(
    map: &Cloud,
    query: &Cloud,
    found: Option<&Pose>,
    truth: Option<&Pose>,
) -> Result<Vec<u8>, Error> {
    let (map_points, raw) = (thin(map, LOOKED_AT), thin(query, DRAWN));
    let placed =
        |pose: &Pose| -> Vec<[f64; 3]> { raw.iter().map(|p| pose.transform(*p)).collect() };
    let apart = Apart::of(&map_points, &raw);
    let before: Vec<[f64; 3]> = raw.iter().map(|p| apart.beside(*p)).collect();
    let panels = [
        ("before", Some(before), "nothing to show"),
        ("found", found.map(placed), "no pose found"),
        ("true", truth.map(placed), "not in this map"),
    ];
    let map_frame = frame(&map_points);
    let width = 3 * PANEL_SIZE + 2 * GAP;
    let mut canvas = Canvas::new(width, TITLE + PANEL_SIZE, BACKGROUND);
    let view = View { right: 0, up: 1 };
    for (i, (title, query, without)) in panels.iter().enumerate() {
        let area = Area {
            x: i * (PANEL_SIZE + GAP),
            y: TITLE,
            width: PANEL_SIZE,
            height: PANEL_SIZE,
        };
        canvas.fill(area, PANEL);
        #[expect(clippy::cast_precision_loss, reason = "pixels")]
        let x = area.x as f32 + 4.0;
        canvas.text(x, 17.0, 16.0, INK, title);
        let own = query.as_deref().and_then(frame);
        let shown = if i == 0 {
            join(map_frame, own)
        } else {
            own.map(around)
        };
        match (shown, query) {
            (Some(shown), Some(query)) => {
                let scale = Scale::new(area, view, shown);
                scale.draw(&mut canvas, &inside(&map_points, &shown, view), MAGENTA);
                scale.draw(&mut canvas, query, GREEN);
            }
            #[expect(clippy::cast_precision_loss, reason = "pixels")]
            _ => {
                canvas.text(x + 8.0, (TITLE + 28) as f32, 16.0, INK, without);
            }
        }
    }
    canvas.to_png()
}

/// A frame with what lies around it.
fn around(f: Frame) -> Frame {
    let pad = (0..2).map(|a| AROUND.0 * (f.high[a] - f.low[a]));
    let pad = pad.fold(AROUND.1, f64::max);
    Frame {
        low: f.low.map(|v| v - pad),
        high: f.high.map(|v| v + pad),
    }
}

/// The points that a view of a frame shows, and no more than are drawn.
fn inside(points: &[[f64; 3]], shown: &Frame, view: View) -> Vec<[f64; 3]> {
    let within = |p: &&[f64; 3]| {
        [view.right, view.up]
            .iter()
            .all(|&a| p[a] >= shown.low[a] && p[a] <= shown.high[a])
    };
    let all: Vec<[f64; 3]> = points.iter().filter(within).copied().collect();
    let step = all.len().div_ceil(DRAWN).max(1);
    all.into_iter().step_by(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_and_there_with_and_without_poses() {
        let points: Vec<[f64; 3]> = (0..2000)
            .map(|i| [f64::from(i) * 0.01, f64::from(i % 7), 0.0])
            .collect();
        let (cloud, _) = Cloud::from_points(&points).unwrap();
        let (empty, _) = Cloud::from_points(&[]).unwrap();
        let pose = Pose::from_translation([3.0, 1.0, 0.0]);
        for png in [
            thumbnail(&cloud, &cloud, Some(&pose), Some(&pose)).unwrap(),
            thumbnail(&cloud, &empty, None, None).unwrap(),
        ] {
            assert!(png.starts_with(b"\x89PNG") && png.len() < 60_000);
        }
    }
}
