//! The reliability diagram: confidence against what came true, as a picture.

use plotters::prelude::*;

use super::calibration::Calibration;

const BLUE_DOT: RGBColor = RGBColor(0, 114, 178);

/// The diagram of one calibration as SVG: the share right against mean confidence, with Wilson intervals, over all of it and above 0.9. On
/// the diagonal a confidence means what it says.
///
/// # Errors
/// Where the drawing library refuses.
pub fn reliability(calibration: &Calibration) -> Result<String, crate::Error> {
    let mut svg = String::new();
    drawn(calibration, &mut svg).map_err(|e| crate::Error::Plot(e.to_string()))?;
    Ok(svg)
}

type Drawn = Result<(), Box<dyn std::error::Error>>;

fn drawn(calibration: &Calibration, svg: &mut String) -> Drawn {
    let root = SVGBackend::with_string(svg, (960, 440)).into_drawing_area();
    root.fill(&WHITE)?;
    let (left, right) = root.split_horizontally(480);
    for (area, from, title) in [
        (&left, 0.0, "All answers with a pose"),
        (&right, 0.9, "Confidence above 0.9"),
    ] {
        let mut chart = ChartBuilder::on(area)
            .caption(title, ("sans-serif", 17))
            .margin(12)
            .x_label_area_size(40)
            .y_label_area_size(56)
            .build_cartesian_2d(from..1.002, from..1.002)?;
        chart
            .configure_mesh()
            .x_desc("mean confidence said")
            .y_desc("share right, 95 % interval")
            .x_label_formatter(&|v| format!("{v:.2}"))
            .y_label_formatter(&|v| format!("{v:.2}"))
            .light_line_style(WHITE)
            .bold_line_style(BLACK.mix(0.08))
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .draw()?;
        chart.draw_series(LineSeries::new(
            [(from, from), (1.0, 1.0)],
            BLACK.mix(0.4).stroke_width(1),
        ))?;
        for (i, bin) in calibration.bins.iter().enumerate() {
            let (Some(share), Some(low), Some(high)) =
                (bin.right.share, bin.right.low, bin.right.high)
            else {
                continue;
            };
            if bin.confidence < from || high < from {
                continue;
            }
            let x = bin.confidence;
            let style = BLUE_DOT.stroke_width(2);
            chart.draw_series([PathElement::new(vec![(x, low.max(from)), (x, high)], style)])?;
            if share >= from {
                chart.draw_series([Circle::new((x, share), 5, BLUE_DOT.filled())])?;
            }
            // Upright beside the whisker, every other one higher, since the surest lie close together.
            if x < from + 0.9 * (1.0 - from) || from > 0.0 {
                let count = format!("{} of {}", bin.right.count, bin.right.of);
                let range = 1.0 - from;
                let height = if i % 2 == 0 { 0.24 } else { 0.5 };
                let font = ("sans-serif", 12).into_font().color(&BLACK);
                let upright = font.transform(FontTransform::Rotate270);
                let at = (x - 0.032 * range, from + height * range);
                chart.draw_series([Text::new(count, at, upright)])?;
            }
        }
    }
    root.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::calibration::Bin;
    use crate::evaluation::rates::Rate;

    #[test]
    fn every_bin_is_drawn() {
        let bin = |confidence, count, of| Bin {
            from: 0.0,
            to: 1.0,
            confidence,
            right: Rate::new(count, of),
        };
        let svg = reliability(&Calibration {
            method: "auto".into(),
            family: None,
            answers: 320,
            brier: 0.0,
            calibration_error: 0.0,
            overconfidence: 0.0,
            bins: vec![bin(0.04, 4, 120), bin(0.995, 200, 200)],
        })
        .unwrap();
        // The sure one in both panels, told in the one that has room.
        assert_eq!(svg.matches("<circle").count(), 3);
        assert_eq!(svg.matches("200 of 200").count(), 1);
        assert!(svg.contains("4 of 120"));
    }
}
