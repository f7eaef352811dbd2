//! What was measured against the raw points, both on logarithmic axes, with fitted powers.

use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

use crate::common::{Result, quantile};
use crate::measure::{Query, Results, Size};

const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const BLUE: RGBColor = RGBColor(0, 114, 178);
const GREY: RGBColor = RGBColor(120, 120, 120);

/// A measured quantity against raw points.
struct Line {
    name: String,
    colour: RGBColor,
    points: Vec<(f64, f64)>,
    /// A bound, not a measurement.
    bound: bool,
}

struct Panel {
    title: &'static str,
    y: &'static str,
    lines: Vec<Line>,
}

pub(crate) fn draw(results: &Path, svg: &Path) -> Result<()> {
    let results: Results = serde_json::from_slice(&std::fs::read(results)?)?;
    table(&results.sizes);
    let panels = panels(&results.sizes);
    for panel in &panels {
        println!("{}, {}", panel.title, panel.y);
        for line in &panel.lines {
            println!("  {}", key(line));
        }
    }
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, (1100, 980)).into_drawing_area();
        root.fill(&WHITE)?;
        for (area, panel) in root.split_evenly((2, 2)).iter().zip(&panels) {
            chart(area, panel)?;
        }
        root.present()?;
    }
    Ok(std::fs::write(svg, text)?)
}

/// The figures behind the picture, as Markdown.
fn table(sizes: &[Size]) {
    println!(
        "raw points | finest level | threads | processor s | at most | µs a raw point | elapsed s | anonymous MB | \
         file MB | bytes a point of the finest level | open ms | cold ms | query s | of the map s | right"
    );
    println!("---{}", "|---".repeat(14));
    for s in sizes {
        let finest = s.levels.first().map_or(0, |l| l.points);
        let right = s.in_map.iter().filter(|q| q.right()).count();
        let middle =
            |of: fn(&Query) -> f64| quantile(&s.in_map.iter().map(of).collect::<Vec<_>>(), 0.5);
        for b in &s.builds {
            println!(
                "{} | {finest} | {} | {:.1} | {:.1} | {:.2} | {:.1} | {:.0} | {:.1} | {:.0} | {:.2} | {:.1} | {:.2} | {:.3} | {right} of {}",
                s.raw_points,
                b.threads,
                b.ran.cpu(),
                b.cpu_bound,
                1e6 * b.ran.cpu() / s.raw_points as f64,
                b.ran.wall,
                b.ran.anonymous_kib as f64 * 1.024e-3,
                s.map_bytes as f64 * 1e-6,
                s.map_bytes as f64 / finest as f64,
                1e3 * s.open.median,
                1e3 * s.open.cold.unwrap_or(f64::NAN),
                middle(|q| q.seconds),
                middle(|q| q.of_map),
                s.in_map.len()
            );
        }
    }
    println!();
}

fn panels(sizes: &[Size]) -> [Panel; 4] {
    let line = |name: &str, colour, of: &dyn Fn(&Size) -> Option<f64>| Line {
        name: name.to_owned(),
        colour,
        points: sizes
            .iter()
            .filter_map(|s| Some((s.raw_points as f64, of(s).filter(|v| *v > 0.0)?)))
            .collect(),
        bound: false,
    };
    let bound = |name: &str, of: &dyn Fn(&Size) -> Option<f64>| Line {
        bound: true,
        ..line(name, GREY, of)
    };
    let first = |s: &Size| {
        s.builds
            .first()
            .map(|b| (b.ran.cpu(), b.ran.wall, b.cpu_bound))
    };
    let finest = |s: &Size| s.levels.first().map(|l| l.points as f64);
    let middle = |v: Vec<f64>| (!v.is_empty()).then(|| quantile(&v, 0.5));
    let threads = sizes
        .iter()
        .find_map(|s| Some(s.builds.first()?.threads))
        .unwrap_or(0);
    [
        Panel {
            title: "Time to build",
            y: "s",
            lines: vec![
                line("time of processors", ORANGE, &|s| Some(first(s)?.0)),
                line(&format!("elapsed, {threads} threads"), SKY, &|s| {
                    Some(first(s)?.1)
                }),
                bound(
                    "bound: 0.3 µs a raw point, 15 µs a prepared point",
                    &|s| Some(first(s)?.2),
                ),
            ],
        },
        Panel {
            title: "Anonymous memory of the build, peak",
            y: "MB",
            lines: vec![
                line("anonymous memory", VERMILION, &|s| {
                    let build = s.builds.first()?;
                    Some(build.ran.anonymous_kib as f64 * 1.024e-3)
                }),
                bound("bound: 1500 MB", &|_| Some(1500.0)),
            ],
        },
        Panel {
            title: "Size of the file",
            y: "MB, millions",
            lines: vec![
                line("map", BLUE, &|s| Some(s.map_bytes as f64 * 1e-6)),
                line("its cloud (12 bytes a point)", SKY, &|s| {
                    Some(s.raw_points as f64 * 12e-6)
                }),
                line(
                    "prepared points of the finest level, millions",
                    ORANGE,
                    &|s| Some(finest(s)? * 1e-6),
                ),
            ],
        },
        Panel {
            title: "Opening, and a query's part that depends on the map",
            y: "s",
            lines: vec![
                line("query in the map", BLUE, &|s| {
                    middle(s.in_map.iter().map(|q| q.of_map).collect())
                }),
                line("query in the cloud itself", ORANGE, &|s| {
                    middle(s.in_cloud.iter().map(|q| q.of_map).collect())
                }),
                line("open the map", VERMILION, &|s| Some(s.open.median)),
                bound("bound on opening: 50 ms", &|_| Some(0.05)),
            ],
        },
    ]
}

/// The least-squares power of `x` that `y` follows.
fn power(points: &[(f64, f64)]) -> Option<f64> {
    let n = points.len() as f64;
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let along: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    let both: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    (points.len() > 1).then(|| both / along)
}

fn key(line: &Line) -> String {
    match power(&line.points).filter(|_| !line.bound) {
        Some(power) => format!("{}: n^{power:.2}", line.name),
        None => line.name.clone(),
    }
}

fn chart(area: &DrawingArea<SVGBackend<'_>, Shift>, panel: &Panel) -> Result<()> {
    let (keys, area) = area.split_vertically(118);
    keys.draw(&Text::new(panel.title, (56, 12), ("sans-serif", 17)))?;
    for (i, line) in (0..).zip(&panel.lines) {
        let y = 45 + 20 * i;
        // As the line itself is drawn.
        let (width, parts) = if line.bound {
            (1, vec![(60, 66), (70, 76), (80, 86)])
        } else {
            (3, vec![(60, 90)])
        };
        for (from, to) in parts {
            let style = line.colour.stroke_width(width);
            keys.draw(&PathElement::new(vec![(from, y), (to, y)], style))?;
        }
        keys.draw(&Text::new(key(line), (98, y - 7), ("sans-serif", 14)))?;
    }
    let all = || panel.lines.iter().flat_map(|l| &l.points);
    // Whole powers of ten, but for a little room at the sides.
    let range = |of: fn(&(f64, f64)) -> f64| {
        let low = all().map(of).fold(f64::INFINITY, f64::min);
        let high = all().map(of).fold(0.0, f64::max);
        (low, high)
    };
    let ((left, right), (low, high)) = (range(|p| p.0), range(|p| p.1));
    let ten = |v: f64| 10f64.powf(v);
    let (low, high) = (
        ten((low / 1.5).log10().floor()),
        ten((high * 1.1).log10().ceil()),
    );
    let mut chart = ChartBuilder::on(&area)
        .margin(8)
        .margin_right(20)
        .x_label_area_size(40)
        .y_label_area_size(64)
        .build_cartesian_2d(
            (left / 1.6..right * 1.6).log_scale(),
            (low..high * 1.001).log_scale(),
        )?;
    chart
        .configure_mesh()
        .x_desc("raw points n")
        .y_desc(panel.y)
        .x_label_formatter(&|v| {
            if *v >= 0.99e6 {
                format!("{} million", (v * 1e-6).round())
            } else {
                format!("{:.1} million", v * 1e-6)
            }
        })
        .y_label_formatter(&|v| {
            let digits = (-v.log10()).round().max(0.0) as usize;
            format!("{v:.digits$}")
        })
        .light_line_style(WHITE)
        .bold_line_style(BLACK.mix(0.08))
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .draw()?;
    for line in &panel.lines {
        let points = || line.points.iter().copied();
        if line.bound {
            let style = line.colour.stroke_width(1);
            chart.draw_series(DashedLineSeries::new(points(), 6, 4, style))?;
            continue;
        }
        chart.draw_series(LineSeries::new(points(), line.colour.stroke_width(2)))?;
        chart.draw_series(points().map(|p| Circle::new(p, 4, line.colour.filled())))?;
    }
    Ok(())
}
