//! Error against time, both on logarithmic axes, as SVG that asks for nothing.

use crate::failure::Failure;
use plotters::{
    coord::Shift,
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

/// Sizes of letters, in the picture's units.
const TITLE: i32 = 18;
const LABEL: i32 = 14;
/// Axes begin and end at powers of these, so that each has numbers beside it.
const POWERS: [f64; 2] = [10.0, 2.0];
/// Errors of nothing are drawn here.
const LEAST: f64 = 1e-9;

/// A place, and what is written beside it.
pub(super) type Place = ([f64; 2], String);

/// Places of one kind.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) places: Vec<Place>,
    pub(super) color: RGBColor,
    /// Whether neighbours are joined.
    pub(super) is_line: bool,
    /// Of a point, in the picture's units.
    pub(super) radius: i32,
}

/// A picture of all series.
pub(super) fn log_log(title: &str, size: [u32; 2], series: &[Series]) -> Result<String, Failure> {
    let mut svg = String::new();
    let area = SVGBackend::with_string(&mut svg, (size[0], size[1])).into_drawing_area();
    draw(&area, title, series).map_err(|error| Failure::Internal(format!("a plot cannot be drawn: {error}")))?;
    drop(area);
    Ok(svg)
}

fn draw(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    title: &str,
    series: &[Series],
) -> Result<(), Box<dyn core::error::Error>> {
    area.fill(&WHITE)?;
    let [x, y] = [0, 1].map(|axis| bounds(series, axis));
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", TITLE))
        .margin(8)
        .margin_right(24)
        .x_label_area_size(3 * LABEL)
        .y_label_area_size(4 * LABEL)
        .build_cartesian_2d((x[0]..x[1]).log_scale(), (y[0]..y[1]).log_scale().base(POWERS[1]))?;
    chart
        .configure_mesh()
        .light_line_style(RGBColor(245, 245, 245))
        .bold_line_style(RGBColor(225, 225, 225))
        .label_style(("sans-serif", LABEL))
        .axis_desc_style(("sans-serif", LABEL))
        .x_labels(6)
        .y_labels(6)
        .x_label_formatter(&|x| power(*x))
        .y_label_formatter(&|y| short(*y))
        .x_desc("error (rms)")
        .y_desc("ms a picture")
        .draw()?;
    for Series { places, color, is_line, radius } in series {
        let points = || places.iter().map(|(place, _)| (place[0].max(LEAST), place[1]));
        if *is_line {
            chart.draw_series(LineSeries::new(points(), color.stroke_width(2)))?;
        }
        chart.draw_series(points().map(|point| Circle::new(point, *radius, color.filled())))?;
        let style = TextStyle::from(("sans-serif", LABEL)).pos(Pos::new(HPos::Left, VPos::Bottom)).color(color);
        chart.draw_series(places.iter().map(|(place, words)| {
            EmptyElement::at((place[0].max(LEAST), place[1])) + Text::new(words.clone(), (4, -3), style.clone())
        }))?;
    }
    Ok(area.present()?)
}

fn bounds(series: &[Series], axis: usize) -> [f64; 2] {
    let numbers = || series.iter().flat_map(|own| &own.places).map(|(place, _)| place[axis].max(LEAST));
    let [low, high] = [numbers().fold(f64::INFINITY, f64::min), numbers().fold(0.0, f64::max)];
    if low > high {
        return [1.0, POWERS[axis]];
    }
    let exponent = |number: f64| number.ln() / POWERS[axis].ln();
    [exponent(low).floor(), exponent(high).floor() + 1.0].map(|exponent| POWERS[axis].powf(exponent))
}

fn power(x: f64) -> String {
    format!("{x:.0e}")
}

fn short(x: f64) -> String {
    if x < 0.1 {
        format!("{x:.3}")
    } else if x < 10.0 {
        format!("{x:.1}")
    } else {
        format!("{x:.0}")
    }
}
