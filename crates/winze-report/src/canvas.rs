//! A picture to draw on: lines, text, and points whose colours add up.

use ab_glyph::{Font, FontRef, PxScale, ScaleFont, point};

use crate::Error;

/// Red, green and blue, 0 to 1.
pub type Colour = [f32; 3];

const FONT: &[u8] = include_bytes!("../assets/DejaVuSans-subset.ttf");

/// An RGB picture, origin at the top left.
#[derive(Debug, Clone)]
pub struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<Colour>,
}

/// A rectangle of a canvas, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Area {
    /// Left edge.
    pub x: usize,
    /// Top edge.
    pub y: usize,
    /// Width.
    pub width: usize,
    /// Height.
    pub height: usize,
}

impl Canvas {
    /// A canvas of one colour.
    #[must_use]
    pub fn new(width: usize, height: usize, background: Colour) -> Self {
        Self {
            width,
            height,
            pixels: vec![background; width * height],
        }
    }

    /// The colour of a pixel, `None` outside.
    #[must_use]
    pub fn pixel(&self, x: usize, y: usize) -> Option<Colour> {
        (x < self.width)
            .then(|| self.pixels.get(y * self.width + x).copied())
            .flatten()
    }

    fn pixel_mut(&mut self, x: i64, y: i64) -> Option<&mut Colour> {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        if x >= self.width {
            return None;
        }
        self.pixels.get_mut(y * self.width + x)
    }

    /// Mixes `colour` in by `share` (0 leaves the pixel, 1 replaces it). Outside nothing happens.
    pub fn blend(&mut self, x: i64, y: i64, colour: Colour, share: f32) {
        if let Some(p) = self.pixel_mut(x, y) {
            for (c, new) in p.iter_mut().zip(colour) {
                *c += (new - *c) * share;
            }
        }
    }

    /// Adds light to a pixel.
    pub fn add(&mut self, x: i64, y: i64, light: Colour) {
        if let Some(p) = self.pixel_mut(x, y) {
            for (c, new) in p.iter_mut().zip(light) {
                *c = (*c + new).min(1.0);
            }
        }
    }

    /// A filled rectangle.
    pub fn fill(&mut self, area: Area, colour: Colour) {
        for y in area.y..(area.y + area.height).min(self.height) {
            for x in area.x..(area.x + area.width).min(self.width) {
                self.pixels[y * self.width + x] = colour;
            }
        }
    }

    /// Text whose first letter starts at `x` and whose baseline lies at `y`; answers where it ends.
    pub fn text(&mut self, x: f32, y: f32, size: f32, colour: Colour, text: &str) -> f32 {
        let Some(font) = font() else { return x };
        let font = font.as_scaled(PxScale::from(size));
        let mut at = x;
        let mut last = None;
        for c in text.chars() {
            let id = font.glyph_id(c);
            if let Some(previous) = last {
                at += font.kern(previous, id);
            }
            let glyph = id.with_scale_and_position(PxScale::from(size), point(at, y));
            if let Some(outline) = font.outline_glyph(glyph) {
                let bounds = outline.px_bounds();
                #[expect(clippy::cast_possible_truncation, reason = "pixels")]
                let (left, top) = (bounds.min.x as i64, bounds.min.y as i64);
                outline.draw(|gx, gy, share| {
                    self.blend(left + i64::from(gx), top + i64::from(gy), colour, share);
                });
            }
            at += font.h_advance(id);
            last = Some(id);
        }
        at
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// Where the encoder refuses (a picture without pixels).
    pub fn to_png(&self) -> Result<Vec<u8>, Error> {
        let mut out = Vec::new();
        let (width, height) = (
            u32::try_from(self.width).unwrap_or(0),
            u32::try_from(self.height).unwrap_or(0),
        );
        let mut encoder = png::Encoder::new(&mut out, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped"
        )]
        let bytes: Vec<u8> = self
            .pixels
            .iter()
            .flatten()
            .map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
            .collect();
        writer.write_image_data(&bytes)?;
        writer.finish()?;
        Ok(out)
    }
}

/// How wide `text` comes out, pixels.
#[must_use]
pub fn text_width(size: f32, text: &str) -> f32 {
    let Some(font) = font() else { return 0.0 };
    let font = font.as_scaled(PxScale::from(size));
    text.chars().map(|c| font.h_advance(font.glyph_id(c))).sum()
}

fn font() -> Option<FontRef<'static>> {
    FontRef::try_from_slice(FONT).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_leaves_ink_and_ends_where_its_width_says() {
        let mut canvas = Canvas::new(200, 40, [0.0; 3]);
        let end = canvas.text(10.0, 30.0, 20.0, [1.0; 3], "winze 42°");
        assert!((end - 10.0 - text_width(20.0, "winze 42°")).abs() < 3.0);
        let lit = canvas.pixels.iter().filter(|p| p[0] > 0.5).count();
        assert!((100..1500).contains(&lit), "{lit}");
        assert!(canvas.pixels.iter().skip(200 * 36).all(|p| p[0] == 0.0));
    }

    #[test]
    fn drawing_outside_is_no_trouble_and_light_adds_up() {
        let mut canvas = Canvas::new(4, 4, [0.0; 3]);
        canvas.add(-1, 0, [1.0; 3]);
        canvas.add(4, 0, [1.0; 3]);
        canvas.add(0, 9, [1.0; 3]);
        canvas.fill(
            Area {
                x: 3,
                y: 3,
                width: 9,
                height: 9,
            },
            [0.5; 3],
        );
        canvas.add(1, 1, [0.5, 0.0, 0.0]);
        canvas.add(1, 1, [0.75, 0.25, 0.0]);
        assert_eq!(canvas.pixel(1, 1), Some([1.0, 0.25, 0.0]));
        assert_eq!(canvas.pixel(3, 3), Some([0.5; 3]));
        assert_eq!(canvas.pixel(4, 0), None);
        assert_eq!(canvas.pixel(0, 0), Some([0.0; 3]));
        let png = canvas.to_png().unwrap();
        assert_eq!(&png[1..4], b"PNG");
    }
}
