//! Many queries at a glance: each on its map, from above, with its name and what is known of it.

use crate::Error;
use crate::canvas::{Area, Canvas, Colour, text_width};
use crate::picture::{BACKGROUND, FAINT, GREEN, INK, MAGENTA, PANEL, Scale, View, frame, join};

const COLUMNS: usize = 6;
const WIDTH: usize = 300;
const HEIGHT: usize = 200;
const CAPTION: usize = 44;
const GAP: usize = 12;
const HEAD: usize = 56;
/// A query that is not in the map is drawn in this.
const STRANGER: Colour = [1.0, 0.45, 0.10];

/// One query on its map.
#[derive(Debug, Clone)]
pub struct Thumb<'a> {
    /// Points of the map, map frame; some ten thousand will do.
    pub map: &'a [[f64; 3]],
    /// Points of the query as they lie in the map; for one that is not in it, its points somewhere else.
    pub query: Vec<[f64; 3]>,
    /// It lies in the map.
    pub in_map: bool,
    /// Its name.
    pub title: String,
    /// What is known of it.
    pub note: String,
}

/// The sheet as PNG bytes: the map in magenta, the query in green, orange where it is not in the map.
///
/// # Errors
/// Where the PNG encoder refuses.
pub fn contact_sheet(title: &str, thumbs: &[Thumb<'_>]) -> Result<Vec<u8>, Error> {
    let rows = thumbs.len().div_ceil(COLUMNS).max(1);
    let columns = thumbs.len().clamp(1, COLUMNS);
    let width = (GAP + columns * (WIDTH + GAP)).max(640);
    let mut canvas = Canvas::new(width, HEAD + rows * (HEIGHT + CAPTION + GAP), BACKGROUND);
    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    let at = |v: usize| v as f32;
    canvas.text(at(GAP), 36.0, 24.0, INK, title);
    let plan = View { right: 0, up: 1 };
    for (i, thumb) in thumbs.iter().enumerate() {
        let area = Area {
            x: GAP + i % COLUMNS * (WIDTH + GAP),
            y: HEAD + i / COLUMNS * (HEIGHT + CAPTION + GAP),
            width: WIDTH,
            height: HEIGHT,
        };
        canvas.fill(area, PANEL);
        if let Some(seen) = join(frame(thumb.map), frame(&thumb.query)) {
            let scale = Scale::new(area, plan, seen);
            // The map is the backdrop.
            scale.draw(&mut canvas, thumb.map, MAGENTA.map(|v| 0.6 * v));
            let colour = if thumb.in_map { GREEN } else { STRANGER };
            scale.draw(&mut canvas, &thumb.query, colour);
        }
        let below = at(area.y + HEIGHT);
        canvas.text(
            at(area.x),
            below + 17.0,
            14.0,
            INK,
            &fitting(14.0, &thumb.title),
        );
        canvas.text(
            at(area.x),
            below + 35.0,
            13.0,
            FAINT,
            &fitting(13.0, &thumb.note),
        );
    }
    canvas.to_png()
}

/// As much of the text as fits under a picture.
fn fitting(size: f32, text: &str) -> String {
    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    let room = WIDTH as f32;
    let mut kept = text.to_owned();
    while text_width(size, &kept) > room && kept.pop().is_some() {}
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_query_is_drawn_and_strangers_stand_out() {
        let map: Vec<[f64; 3]> = (0..4000)
            .map(|i| [f64::from(i % 200) * 0.5, f64::from(i / 200) * 0.5, 0.0])
            .collect();
        let thumb = |in_map| Thumb {
            map: &map,
            query: vec![[20.0, 5.0, 0.0]; 30],
            in_map,
            title: "a very long name that cannot fit under a small picture at all".into(),
            note: "overlap 93 %".into(),
        };
        let thumbs: Vec<Thumb<'_>> = (0..8).map(|i| thumb(i != 3)).collect();
        let png = contact_sheet("eight", &thumbs).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&png))
            .read_info()
            .unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (1884, 568));
        let count = |want: fn(&[u8]) -> bool| pixels.chunks(3).filter(|p| want(p)).count();
        assert!(count(|p| p[1] > 150 && p[0] < 200 && p[2] < 200) >= 7);
        assert!(count(|p| p[0] > 200 && p[1] > 60 && p[1] < 180 && p[2] < 140) >= 1);
        assert!(contact_sheet("none", &[]).is_ok());
    }

    #[test]
    fn captions_are_cut_to_their_picture() {
        assert!(text_width(14.0, &fitting(14.0, &"w".repeat(200))) <= 300.0);
        assert_eq!(fitting(14.0, "short"), "short");
    }
}
