//! A small picture of one answer, for a sheet of many: as the clouds came, where the query was
//! found, and where it belongs; from above.

use winze::{Cloud, Pose};

use crate::Error;
use crate::canvas::{Area, Canvas};
use crate::picture::{
    Apart, BACKGROUND, Frame, GREEN, INK, MAGENTA, PANEL, Scale, View, frame, join, thin,
};

const PANEL_SIZE: usize = 300;
const GAP: usize = 8;
const TITLE: usize = 24;
/// Points of each cloud drawn at most.
const DRAWN: usize = 60_000;

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
    let (map_points, raw) = (thin(map, DRAWN), thin(query, DRAWN));
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
        let whole: Option<Frame> = join(map_frame, query.as_deref().and_then(frame));
        match (whole, query) {
            (Some(whole), Some(query)) => {
                let scale = Scale::new(area, view, whole);
                scale.draw(&mut canvas, &map_points, MAGENTA);
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
