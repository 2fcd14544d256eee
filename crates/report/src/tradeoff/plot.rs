//! Plots of error against time on logarithmic axes, as SVG without external references.

use crate::error::{Error, Result};
use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

/// Font size of the title in pixels.
const TITLE: i32 = 18;
/// Font size of labels in pixels.
const LABEL: i32 = 14;
/// Bases of the powers at the ends of the axes, so that each axis has labels.
const BASES: [f64; 2] = [10.0, 2.0];
/// Smallest error of the axis, where equal pictures are drawn.
const ERROR_MIN: f64 = 1e-9;

/// Position, error and milliseconds, and its label.
pub(super) type Point = ([f64; 2], String);

/// Points of one kind.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) points: Vec<Point>,
    pub(super) color: RGBColor,
    /// Whether consecutive points are joined.
    pub(super) is_line: bool,
    /// Radius of a point in pixels.
    pub(super) radius: i32,
}

/// Plot of several series.
///
/// # Errors
///
/// Those of the drawing backend.
pub(super) fn log_log(title: &str, size: [u32; 2], series: &[Series]) -> Result<String> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (size[0], size[1])).into_drawing_area();
    draw(&area, title, series).map_err(|error| Error::Plot(error.to_string()))?;
    drop(area);
    Ok(svg)
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    series: &[Series],
) -> core::result::Result<(), Box<dyn core::error::Error>> {
    area.fill(&WHITE)?;
    let [x, y] = [0, 1].map(|axis| bounds(series, axis));
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", TITLE))
        .margin(8)
        .margin_right(24)
        .x_label_area_size(3 * LABEL)
        .y_label_area_size(4 * LABEL)
        .build_cartesian_2d((x[0]..x[1]).log_scale(), (y[0]..y[1]).log_scale().base(BASES[1]))?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(245, 245, 245))
        .bold_line_style(RGBColor(225, 225, 225))
        .label_style(("sans-serif", LABEL))
        .axis_desc_style(("sans-serif", LABEL))
        .x_labels(6)
        .y_labels(6)
        .x_label_formatter(&|x| error_label(*x))
        .y_label_formatter(&|y| time_label(*y))
        .x_desc("error (rms)")
        .y_desc("ms per picture")
        .draw()?;
    for Series { points, color, is_line, radius } in series {
        let positions = || points.iter().map(|(position, _)| (position[0].max(ERROR_MIN), position[1]));
        if *is_line {
            chart.draw_series(LineSeries::new(positions(), color.stroke_width(2)))?;
        }
        chart.draw_series(positions().map(|position| Circle::new(position, *radius, color.filled())))?;
        let style = TextStyle::from(("sans-serif", LABEL)).pos(Pos::new(HPos::Left, VPos::Bottom)).color(color);
        chart.draw_series(points.iter().map(|(position, label)| {
            EmptyElement::at((position[0].max(ERROR_MIN), position[1]))
                + Text::new(label.clone(), (4, -3), style.clone())
        }))?;
    }
    Ok(area.present()?)
}

fn bounds(series: &[Series], axis: usize) -> [f64; 2] {
    let numbers = || series.iter().flat_map(|series| &series.points).map(|(position, _)| position[axis].max(ERROR_MIN));
    let [low, high] = [numbers().fold(f64::INFINITY, f64::min), numbers().fold(0.0, f64::max)];
    if low > high {
        return [1.0, BASES[axis]];
    }
    let exponent = |number: f64| number.ln() / BASES[axis].ln();
    [exponent(low).floor(), exponent(high).floor() + 1.0].map(|exponent| BASES[axis].powf(exponent))
}

fn error_label(x: f64) -> String {
    format!("{x:.0e}")
}

fn time_label(x: f64) -> String {
    if x < 0.1 {
        format!("{x:.3}")
    } else if x < 10.0 {
        format!("{x:.1}")
    } else {
        format!("{x:.0}")
    }
}
