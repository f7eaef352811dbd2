//! Before and after, side by side: the map in magenta, the query in green, white where both are.
//!
//! Three rows: from above, from the side, and close up around the query. The left column shows the two
//! clouds as they came, each in its own frame; the right one with the query where it was found.

use winze::{Cloud, Outcome, Pose};

use crate::Error;
use crate::canvas::{Area, Canvas, Colour, text_width};

const WIDTH: usize = 1640;
const MARGIN: usize = 20;
const HEAD: usize = 96;
const TITLE: usize = 30;
pub(crate) const BACKGROUND: Colour = [0.055, 0.060, 0.075];
pub(crate) const PANEL: Colour = [0.0, 0.0, 0.0];
pub(crate) const INK: Colour = [0.93, 0.93, 0.95];
pub(crate) const FAINT: Colour = [0.60, 0.61, 0.66];
pub(crate) const MAGENTA: Colour = [1.0, 0.0, 1.0];
pub(crate) const GREEN: Colour = [0.0, 1.0, 0.0];
/// Points of each cloud drawn at most; more would only cost time.
const DRAWN: usize = 1_500_000;

/// Which two axes a view shows, right and up.
#[derive(Clone, Copy)]
pub(crate) struct View {
    pub(crate) right: usize,
    pub(crate) up: usize,
}

/// What part of space a panel shows, metres.
#[derive(Clone, Copy)]
pub(crate) struct Frame {
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
}

/// The picture as PNG bytes. With no pose the right column says so.
///
/// # Errors
/// Where the PNG encoder refuses.
pub fn before_and_after(map: &Cloud, query: &Cloud, outcome: &Outcome) -> Result<Vec<u8>, Error> {
    let map_points = thin(map, DRAWN);
    let raw = thin(query, DRAWN);
    let apart = Apart::of(&map_points, &raw);
    let shown: Vec<[f64; 3]> = raw.iter().map(|p| apart.beside(*p)).collect();
    let found: Option<Vec<[f64; 3]>> = outcome
        .map_from_query
        .map(|pose: Pose| raw.iter().map(|p| pose.transform(*p)).collect());
    let map_frame = frame(&map_points);
    let before = join(map_frame, frame(&shown));
    let after = join(map_frame, found.as_deref().and_then(frame));
    let plan = View { right: 0, up: 1 };
    let long = |f: Option<Frame>| f.is_some_and(|f| f.high[1] - f.low[1] > f.high[0] - f.low[0]);
    let side = View {
        right: usize::from(long(after)),
        up: 2,
    };
    let close = found.as_deref().and_then(frame);
    let column = (WIDTH - 3 * MARGIN) / 2;
    let rows = [
        Row {
            view: plan,
            frames: [before, after],
            titles: [
                apart.title("before, from above"),
                "after, from above".into(),
            ],
            after: [false, true],
        },
        Row {
            view: side,
            frames: [before, after],
            titles: [
                apart.title("before, from the side"),
                "after, from the side".into(),
            ],
            after: [false, true],
        },
        Row {
            view: plan,
            frames: [close, close],
            titles: [
                "after, close up, from above".into(),
                "after, close up, from the side".into(),
            ],
            after: [true, true],
        },
    ];
    let heights: Vec<usize> = rows.iter().map(|r| r.height(column, side)).collect();
    let total = HEAD + heights.iter().map(|h| h + TITLE + MARGIN).sum::<usize>();
    let mut canvas = Canvas::new(WIDTH, total, BACKGROUND);
    head(&mut canvas, outcome);
    let mut y = HEAD;
    for (i, (row, height)) in rows.iter().zip(heights).enumerate() {
        for c in 0..2 {
            let x = MARGIN + c * (column + MARGIN);
            #[expect(clippy::cast_precision_loss, reason = "pixels")]
            canvas.text(x as f32, (y + 20) as f32, 18.0, INK, &row.titles[c]);
            let area = Area {
                x,
                y: y + TITLE,
                width: column,
                height,
            };
            canvas.fill(area, PANEL);
            let view = if i == 2 && c == 1 { side } else { row.view };
            let placed: Option<&[[f64; 3]]> = if row.after[c] {
                found.as_deref()
            } else {
                Some(&shown)
            };
            match (row.frames[c], placed) {
                (Some(frame), Some(query)) => {
                    let scale = Scale::new(area, view, frame);
                    scale.draw(&mut canvas, &map_points, MAGENTA);
                    scale.draw(&mut canvas, query, GREEN);
                    scale.bar(&mut canvas);
                }
                _ => {
                    #[expect(clippy::cast_precision_loss, reason = "pixels")]
                    canvas.text(
                        (x + 16) as f32,
                        (y + TITLE + 30) as f32,
                        18.0,
                        FAINT,
                        "no pose to show",
                    );
                }
            }
        }
        y += height + TITLE + MARGIN;
    }
    canvas.to_png()
}

struct Row {
    view: View,
    frames: [Option<Frame>; 2],
    titles: [String; 2],
    after: [bool; 2],
}

impl Row {
    /// Panel height that suits the flatter of the two frames, within reason.
    fn height(&self, width: usize, side: View) -> usize {
        let aspect = |f: Option<Frame>, v: View| {
            f.map_or(0.25, |f| {
                (f.high[v.up] - f.low[v.up]) / (f.high[v.right] - f.low[v.right]).max(1e-6)
            })
        };
        let second = if self.titles[1].contains("close") {
            side
        } else {
            self.view
        };
        let aspect = aspect(self.frames[0], self.view).max(aspect(self.frames[1], second));
        #[expect(
            clippy::cast_precision_loss,
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "pixels"
        )]
        let height = (aspect.clamp(0.0, 2.0) * width as f64) as usize + 60;
        height.clamp(220, 560)
    }
}

fn head(canvas: &mut Canvas, outcome: &Outcome) {
    let colour = match outcome.verdict {
        winze::Verdict::Located => [0.35, 0.90, 0.45],
        winze::Verdict::Ambiguous | winze::Verdict::Degenerate => [1.0, 0.78, 0.25],
        winze::Verdict::NotFound | winze::Verdict::Insufficient => [1.0, 0.45, 0.40],
    };
    let x = canvas.text(20.0, 40.0, 30.0, colour, outcome.verdict.name());
    let mut line = format!("   method {}", outcome.method);
    if let Some(fraction) = outcome.inlier_fraction {
        line += &format!(
            " · {:.2} % of the query within {} m of the map",
            100.0 * fraction,
            outcome.inlier_distance
        );
    }
    if let Some(rmse) = outcome.inlier_rmse {
        line += &format!(", RMSE {rmse:.4} m");
    }
    canvas.text(x, 40.0, 18.0, INK, &line);
    canvas.text(20.0, 70.0, 17.0, FAINT, &outcome.reason);
    let words = [
        ("map", MAGENTA),
        ("query", GREEN),
        ("both", [1.0, 1.0, 1.0]),
    ];
    let mut x = 1620.0
        - words
            .iter()
            .map(|(w, _)| text_width(20.0, w) + 22.0)
            .sum::<f32>();
    for (word, colour) in words {
        x = canvas.text(x, 40.0, 20.0, colour, word) + 22.0;
    }
}

/// How the clouds are shown before: where their frames lie so far apart that both would be specks (a
/// map in UTM coordinates, a query in the robot's own), the query is drawn beside the map.
pub(crate) struct Apart {
    shift: [f64; 3],
    metres: f64,
}

impl Apart {
    pub(crate) fn of(map: &[[f64; 3]], query: &[[f64; 3]]) -> Self {
        let together = Self {
            shift: [0.0; 3],
            metres: 0.0,
        };
        let (Some(m), Some(q)) = (frame(map), frame(query)) else {
            return together;
        };
        let size = (0..3)
            .map(|a| (m.high[a] - m.low[a]).max(q.high[a] - q.low[a]))
            .fold(0.0, f64::max);
        let middle = |f: &Frame, a: usize| 0.5 * (f.low[a] + f.high[a]);
        let d: [f64; 3] = std::array::from_fn(|a| middle(&q, a) - middle(&m, a));
        let metres = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        if metres < 4.0 * size {
            return together;
        }
        let beside = m.high[0] + 0.1 * size - q.low[0];
        Self {
            shift: [beside, -d[1], -d[2]],
            metres,
        }
    }

    pub(crate) fn beside(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| p[a] + self.shift[a])
    }

    /// How far the query was moved for that; 0 where it was not.
    pub(crate) fn metres(&self) -> f64 {
        self.metres
    }

    fn title(&self, text: &str) -> String {
        if self.metres > 0.0 {
            let km = self.metres / 1000.0;
            format!("{text}; the frames lie {km:.1} km apart, the query is drawn beside the map")
        } else {
            text.into()
        }
    }
}

/// Maps metres to a panel's pixels, one scale for both axes.
pub(crate) struct Scale {
    area: Area,
    view: View,
    centre: [f64; 2],
    pixels_per_metre: f64,
}

#[expect(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "pixels"
)]
impl Scale {
    pub(crate) fn new(area: Area, view: View, frame: Frame) -> Self {
        let size = |a: usize| (frame.high[a] - frame.low[a]).max(0.1);
        let fit = |pixels: usize, metres: f64| (pixels as f64 - 30.0) / metres;
        Self {
            area,
            view,
            centre: [view.right, view.up].map(|a| 0.5 * (frame.low[a] + frame.high[a])),
            pixels_per_metre: fit(area.width, size(view.right))
                .min(fit(area.height, size(view.up))),
        }
    }

    fn pixel(&self, p: [f64; 3]) -> Option<(usize, usize)> {
        let x = 0.5 * self.area.width as f64
            + (p[self.view.right] - self.centre[0]) * self.pixels_per_metre;
        let y = 0.5 * self.area.height as f64
            - (p[self.view.up] - self.centre[1]) * self.pixels_per_metre;
        let inside =
            x >= 0.0 && y >= 0.0 && x < self.area.width as f64 && y < self.area.height as f64;
        inside.then_some((x as usize, y as usize))
    }

    /// Adds a cloud's light: a lone point is well seen, a crowd does not drown the rest.
    pub(crate) fn draw(&self, canvas: &mut Canvas, points: &[[f64; 3]], colour: Colour) {
        let mut count = vec![0u32; self.area.width * self.area.height];
        for p in points {
            if let Some((x, y)) = self.pixel(*p) {
                count[y * self.area.width + x] += 1;
            }
        }
        let hit = count.iter().filter(|c| **c > 0).count().max(1);
        let mean = count.iter().map(|c| f64::from(*c)).sum::<f64>() / hit as f64;
        for (i, c) in count.iter().enumerate().filter(|(_, c)| **c > 0) {
            let light = 0.45 + 0.55 * (1.0 - (-0.7 * f64::from(*c) / mean).exp());
            let (x, y) = (
                self.area.x + i % self.area.width,
                self.area.y + i / self.area.width,
            );
            canvas.add(x as i64, y as i64, colour.map(|v| v * light as f32));
        }
    }

    /// A bar of a round length, with the names of the axes.
    pub(crate) fn bar(&self, canvas: &mut Canvas) {
        let wanted = 0.2 * self.area.width as f64 / self.pixels_per_metre;
        let magnitude = 10f64.powf(wanted.log10().floor());
        let metres = [5.0, 2.0, 1.0]
            .map(|k| k * magnitude)
            .into_iter()
            .find(|m| *m <= wanted)
            .unwrap_or(magnitude);
        let length = (metres * self.pixels_per_metre) as usize;
        let (x, y) = (self.area.x + 14, self.area.y + self.area.height - 16);
        canvas.fill(
            Area {
                x,
                y,
                width: length,
                height: 3,
            },
            INK,
        );
        canvas.fill(
            Area {
                x,
                y: y - 4,
                width: 2,
                height: 11,
            },
            INK,
        );
        canvas.fill(
            Area {
                x: x + length - 2,
                y: y - 4,
                width: 2,
                height: 11,
            },
            INK,
        );
        let axes = ["x", "y", "z"];
        let label = format!(
            "{metres} m    {} right, {} up",
            axes[self.view.right], axes[self.view.up]
        );
        canvas.text(
            (x + length + 10) as f32,
            (y + 7) as f32,
            16.0,
            FAINT,
            &label,
        );
    }
}

/// Evenly drawn points of a cloud, at most so many.
#[must_use]
pub fn thin(cloud: &Cloud, most: usize) -> Vec<[f64; 3]> {
    cloud
        .iter()
        .step_by(cloud.len().div_ceil(most.max(1)).max(1))
        .collect()
}

/// Bounds of all but the outermost thousandth at each end, a little widened.
pub(crate) fn frame(points: &[[f64; 3]]) -> Option<Frame> {
    let last = points.len().checked_sub(1)?;
    let skip = points.len() / 1000;
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    for a in 0..3 {
        let mut v: Vec<f64> = points.iter().map(|p| p[a]).collect();
        low[a] = *v.select_nth_unstable_by(skip, f64::total_cmp).1;
        high[a] = *v.select_nth_unstable_by(last - skip, f64::total_cmp).1;
        let pad = 0.5 + 0.02 * (high[a] - low[a]);
        low[a] -= pad;
        high[a] += pad;
    }
    Some(Frame { low, high })
}

pub(crate) fn join(a: Option<Frame>, b: Option<Frame>) -> Option<Frame> {
    let (Some(a), Some(b)) = (a, b) else {
        return a.or(b);
    };
    Some(Frame {
        low: std::array::from_fn(|i| a.low[i].min(b.low[i])),
        high: std::array::from_fn(|i| a.high[i].max(b.high[i])),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_far_apart_are_drawn_side_by_side() {
        let here: Vec<[f64; 3]> = (0..3000).map(|i| [f64::from(i) * 0.01, 1.0, 2.0]).collect();
        let utm: Vec<[f64; 3]> = here
            .iter()
            .map(|p| [p[0] + 450_000.0, p[1] + 4_400_000.0, p[2]])
            .collect();
        let apart = Apart::of(&utm, &here);
        let shown: Vec<[f64; 3]> = here.iter().map(|p| apart.beside(*p)).collect();
        let both = join(frame(&utm), frame(&shown)).unwrap();
        assert!(both.high[0] - both.low[0] < 80.0 && both.high[1] - both.low[1] < 5.0);
        assert!(
            apart.title("before").contains("4423.0 km"),
            "{}",
            apart.title("before")
        );
        let near = Apart::of(&here, &here);
        assert_eq!(
            (near.shift, near.title("before")),
            ([0.0; 3], "before".into())
        );
    }
}
