//! Curves with their intervals, in panels.

use plotters::prelude::*;

use super::Result;

pub struct Panel {
    pub title: String,
    /// What the horizontal axis is.
    pub x: String,
    /// For each name: `[x, y, lowest y, highest y]`, ys in percent.
    pub lines: Vec<Vec<[f64; 4]>>,
}

/// Colours that the colour-blind tell apart (Okabe & Ito).
const COLOURS: [RGBColor; 6] = [
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(204, 121, 167),
    RGBColor(0, 0, 0),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
];

/// The panels as SVG, so many in a row; the key stands above them.
pub fn draw(panels: &[Panel], columns: usize, names: &[&str], y: &str) -> Result<String> {
    let mut svg = String::new();
    let (width, height) = (
        440 * columns as u32,
        340 * panels.len().div_ceil(columns) as u32 + 60,
    );
    {
        let root = SVGBackend::with_string(&mut svg, (width, height)).into_drawing_area();
        root.fill(&WHITE)?;
        let (key, area) = root.split_vertically(56);
        for (i, name) in names.iter().enumerate() {
            let (x, y) = (60 + 400 * (i as i32 % 3), 16 + 22 * (i as i32 / 3));
            let style = COLOURS[i % COLOURS.len()].stroke_width(3);
            key.draw(&PathElement::new(vec![(x, y), (x + 30, y)], style))?;
            key.draw(&Text::new(*name, (x + 38, y - 7), ("sans-serif", 15)))?;
        }
        for (cell, panel) in area
            .split_evenly((panels.len().div_ceil(columns), columns))
            .iter()
            .zip(panels)
        {
            let last = panel
                .lines
                .iter()
                .flatten()
                .map(|p| p[0])
                .fold(0.0, f64::max);
            let mut chart = ChartBuilder::on(cell)
                .caption(&panel.title, ("sans-serif", 17))
                .margin(8)
                .x_label_area_size(38)
                .y_label_area_size(48)
                .build_cartesian_2d(0.0..last * 1.02, 0.0..102.0)?;
            chart
                .configure_mesh()
                .x_desc(panel.x.as_str())
                .y_desc(y)
                .light_line_style(WHITE)
                .bold_line_style(BLACK.mix(0.08))
                .label_style(("sans-serif", 13))
                .axis_desc_style(("sans-serif", 14))
                .draw()?;
            for (i, line) in panel.lines.iter().enumerate() {
                let colour = COLOURS[i % COLOURS.len()];
                // Side by side, so that intervals do not hide each other.
                let aside = (i as f64 - 2.5) * 0.004 * last;
                for p in line {
                    let x = (p[0] + aside).max(0.0);
                    let whisker = vec![(x, p[2]), (x, p[3])];
                    chart.draw_series([PathElement::new(whisker, colour.mix(0.35))])?;
                    chart.draw_series([Circle::new((x, p[1]), 3, colour.filled())])?;
                }
                let points = line.iter().map(|p| ((p[0] + aside).max(0.0), p[1]));
                chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            }
        }
        root.present()?;
    }
    Ok(svg)
}
