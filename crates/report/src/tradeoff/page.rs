//! Page of a measurement: tables and plots in one file.

use crate::{
    error::Result,
    html::HtmlTable,
    tradeoff::{
        findings::{Findings, MeasuredSetting},
        lamps::{self, LampSetting},
        plot::{Point, Series, log_log},
        table::{self, HEADS},
    },
};
use askama::Template;
use plotters::style::RGBColor;
use specula_accuracy::{
    front::pareto,
    off_axis::{OffAxis, SCALES},
    setting::{Difference, FIXED, PARAMETERS},
    sort::{Sort, Sorted},
    stability::{PROMISES, Row},
};
use specula_core::lamps::RAYS_MAX;
use specula_scene::number::group_digits;

/// Colour of settings beaten by others.
const BEATEN: RGBColor = RGBColor(190, 190, 190);
/// Colour of the Pareto front.
const FRONT: RGBColor = RGBColor(20, 90, 160);
/// Colour of the default setting.
const DEFAULT: RGBColor = RGBColor(200, 60, 30);
/// Width and height in pixels of the plot of all settings.
const FRONT_SIZE: [u32; 2] = [1040, 560];
/// Width and height in pixels of the plot of a parameter.
const PARAMETER_SIZE: [u32; 2] = [510, 340];
/// Indices in [`PROMISES`] of differences from `f64`, which are measured but not guaranteed to be
/// zero.
const MEASURED: core::ops::RangeInclusive<usize> = 1..=2;

/// HTML of the page, which requests nothing from outside.
///
/// # Errors
///
/// A plot that cannot be drawn, or a template that cannot be rendered.
pub fn page(findings: &Findings) -> Result<String> {
    Ok(Page::new(findings)?.render()?)
}

#[derive(Template)]
#[template(path = "tradeoff.html")]
struct Page<'a> {
    findings: &'a Findings,
    gaussians: String,
    threads: usize,
    cheapest: HtmlTable,
    /// SVG of all settings.
    front_plot: String,
    front: HtmlTable,
    /// SVG of each parameter.
    plots: Vec<String>,
    /// Name of each property with a single value, and its description.
    fixed: &'a [(&'a str, &'a str)],
    sort: &'a Sort,
    /// Largest difference of the two renderers.
    renderer_difference: String,
    orders: HtmlTable,
    off_axis: HtmlTable,
    lamps: HtmlTable,
    most_rays: usize,
    /// Name of each invariant, and its description.
    invariants: &'a [(&'a str, &'a str)],
    stability: Vec<StabilityRow>,
}

/// Case of the table of invariants.
struct StabilityRow {
    case: String,
    /// Whether much of the picture depends on rounding.
    is_on_edge: bool,
    /// Text of each cell, and whether its invariant is broken.
    cells: Vec<(String, bool)>,
}

impl<'a> Page<'a> {
    fn new(findings: &'a Findings) -> Result<Self> {
        Ok(Self {
            findings,
            gaussians: group_digits(findings.gaussians),
            threads: rayon::current_num_threads(),
            cheapest: HtmlTable::new(HEADS, table::rows(findings)),
            front_plot: front_plot(findings)?,
            front: front_table(findings),
            plots: parameter_plots(findings)?,
            fixed: &FIXED,
            sort: &findings.sort,
            renderer_difference: format!("{:.1e}", findings.sort.apart),
            orders: order_table(&findings.sort),
            off_axis: off_axis_table(&findings.off_axis),
            lamps: HtmlTable::new(lamps::HEADS, findings.lamps.iter().map(LampSetting::row)),
            most_rays: RAYS_MAX,
            invariants: &PROMISES,
            stability: findings.stability.iter().map(StabilityRow::new).collect(),
        })
    }
}

impl StabilityRow {
    fn new(row: &Row) -> Self {
        let cell = |(index, value): (usize, f64)| {
            let text = if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") };
            (text, value != 0.0 && !MEASURED.contains(&index))
        };
        Self {
            case: format!("{} ({})", row.case, format!("{:?}", row.form).to_lowercase()),
            is_on_edge: row.is_on_edge,
            cells: row.values().into_iter().enumerate().map(cell).collect(),
        }
    }
}

fn front_plot(findings: &Findings) -> Result<String> {
    let points: Vec<[f64; 2]> = findings.measured.iter().map(MeasuredSetting::point).collect();
    let is_drawn = |index: &usize| points[*index][0].is_finite();
    let drawn = |indices: Vec<usize>| -> Vec<Point> {
        indices.into_iter().filter(is_drawn).map(|index| (points[index], String::new())).collect()
    };
    let default = findings.measured_default().map(|measured| (measured.point(), "default".to_owned()));
    let series = [
        Series { points: drawn((0..points.len()).collect()), color: BEATEN, is_line: false, radius: 3 },
        Series { points: drawn(pareto(&points)), color: FRONT, is_line: true, radius: 4 },
        Series { points: default.into_iter().collect(), color: DEFAULT, is_line: false, radius: 5 },
    ];
    log_log("all settings", FRONT_SIZE, &series)
}

/// Settings of the Pareto front.
fn front_table(findings: &Findings) -> HtmlTable {
    let points: Vec<[f64; 2]> = findings.measured.iter().map(MeasuredSetting::point).collect();
    let row = |index: usize| {
        let MeasuredSetting { setting, errors, .. } = &findings.measured[index];
        [
            format!("{:.1e}", errors.rms),
            format!("{:.1} dB", errors.psnr),
            format!("{:.1e}", errors.max),
            format!("{:.2}", points[index][1]),
            Difference(setting, &findings.default).to_string(),
        ]
    };
    HtmlTable::new(["RMS", "PSNR", "max error", "ms", "changes from the default"], pareto(&points).into_iter().map(row))
}

/// Plot of each parameter that has several values.
fn parameter_plots(findings: &Findings) -> Result<Vec<String>> {
    let mut plots = Vec::new();
    for (index, parameter) in PARAMETERS.iter().enumerate() {
        let varied = || findings.measured.iter().filter(|measured| measured.parameter == Some(index));
        if varied().next().is_none() {
            continue;
        }
        let drawn = || varied().filter(|measured| measured.point()[0].is_finite());
        let value = |measured: &MeasuredSetting| parameter.value(&measured.setting);
        let is_default = |measured: &&MeasuredSetting| value(measured) == parameter.value(&findings.default);
        let all = drawn().map(|measured| (measured.point(), value(measured))).collect();
        let default = drawn().filter(is_default).map(|measured| (measured.point(), String::new())).collect();
        let series = [
            Series { points: all, color: FRONT, is_line: true, radius: 3 },
            Series { points: default, color: DEFAULT, is_line: false, radius: 5 },
        ];
        plots.push(log_log(parameter.name, PARAMETER_SIZE, &series)?);
    }
    Ok(plots)
}

/// Errors of orders against an exact order per pixel, and their run times.
fn order_table(sort: &Sort) -> HtmlTable {
    let row = |Sorted { by, errors, milliseconds }: &Sorted| {
        [
            by.clone(),
            format!("{:.1} dB", errors.psnr),
            format!("{:.1e}", errors.rms),
            format!("{:.1e}", errors.max),
            format!("{:.1e}", errors.flip),
            format!("{:.2}°", errors.normal_mae),
            milliseconds.map_or_else(|| "–".to_owned(), |milliseconds| format!("{milliseconds:.2}")),
        ]
    };
    HtmlTable::new(["sorted by", "PSNR", "RMS", "max error", "FLIP", "normal MAE", "ms"], sort.orders.iter().map(row))
}

/// Shapes and angles in rows, scales in columns; each affine and on the tangent plane.
fn off_axis_table(all: &[OffAxis]) -> HtmlTable {
    let heads = ["shape".to_owned(), "angle off the axis".to_owned()].into_iter();
    let row = |errors: &[OffAxis]| {
        let first = [errors[0].shape.to_owned(), format!("{}°", errors[0].degrees)].into_iter();
        first.chain(errors.iter().map(|errors| format!("{:.1e} / {:.1e}", errors.affine, errors.tangent))).collect()
    };
    HtmlTable {
        heads: heads.chain(SCALES.iter().map(f64::to_string)).collect(),
        rows: all.chunks(SCALES.len()).map(row).collect(),
    }
}
