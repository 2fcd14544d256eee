//! Quality against time, from the `timeline.json` of trainings: `cargo run --release -p
//! specula-benches --example plot -- OUT.svg TITLE NAME=MODEL/timeline.json ...`

use core::error::Error;
use plotters::prelude::*;
use serde_json::{Map, Value};
use std::{fs, path::Path};

const SIZE: (u32, u32) = (900, 500);
/// Sizes of letters, in the picture's units.
const TITLE: i32 = 24;
const LABEL: i32 = 20;
const COLORS: [RGBColor; 4] = [BLUE, RED, GREEN, MAGENTA];

/// Training: its name, and PSNR over seconds.
struct Training {
    name: String,
    points: Vec<(f64, f64)>,
}

impl Training {
    /// From `NAME=FILE`.
    fn read(argument: &str) -> Result<Self, Box<dyn Error>> {
        let (name, file) = argument.split_once('=').ok_or_else(|| format!("{argument:?} is not NAME=FILE"))?;
        let moments: Map<String, Value> = serde_json::from_str(&fs::read_to_string(file)?)?;
        let number = |moment: &Value, key: &str| moment[key].as_f64().ok_or_else(|| format!("{file}: no {key}"));
        let mut points = Vec::new();
        for moment in moments.values() {
            points.push((number(moment, "seconds")?, number(moment, "PSNR")?));
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Self { name: name.into(), points })
    }
}

fn draw(out: &Path, title: &str, trainings: &[Training]) -> Result<(), Box<dyn Error>> {
    let all = || trainings.iter().flat_map(|training| &training.points);
    let end = all().fold(0.0, |end: f64, point| end.max(point.0));
    let low = all().fold(f64::INFINITY, |low, point| low.min(point.1)).floor();
    let high = all().fold(0.0, |high: f64, point| high.max(point.1)).ceil();
    let area = SVGBackend::new(out, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", TITLE))
        .margin(15)
        .x_label_area_size(3 * LABEL)
        .y_label_area_size(4 * LABEL)
        .build_cartesian_2d(0.0..end * 1.02, low..high)?;
    chart
        .configure_mesh()
        .label_style(("sans-serif", LABEL))
        .axis_desc_style(("sans-serif", LABEL))
        .x_desc("seconds of training")
        .y_desc("PSNR of the test views, dB")
        .draw()?;
    for (training, color) in trainings.iter().zip(COLORS.iter().cycle()) {
        let line = LineSeries::new(training.points.iter().copied(), color.stroke_width(2)).point_size(3);
        chart
            .draw_series(line)?
            .label(&training.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], color.stroke_width(2)));
    }
    chart
        .configure_series_labels()
        .label_font(("sans-serif", LABEL))
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE)
        .border_style(BLACK)
        .draw()?;
    Ok(area.present()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [out, title, trainings @ ..] = arguments.as_slice() else {
        return Err("give OUT.svg, a title and NAME=timeline.json for each training".into());
    };
    let trainings = trainings.iter().map(|argument| Training::read(argument)).collect::<Result<Vec<_>, _>>()?;
    draw(Path::new(out), title, &trainings)
}
