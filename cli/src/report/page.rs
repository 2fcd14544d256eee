//! The report's page: tables and plots in one file.

use super::{
    Findings, Measured,
    plot::{Place, Series, log_log},
    table,
};
use crate::{
    failure::Failure,
    output,
    page::{STYLE, escaped, html_table},
};
use plotters::style::RGBColor;
use specula_accuracy::{
    error::Errors,
    front::pareto,
    off_axis::{OffAxis, SCALES},
    setting::{Difference, FIXED, KNOBS},
    sort::Sort,
    stability::{PROMISES, Row},
};
use std::path::Path;

const BEATEN: RGBColor = RGBColor(190, 190, 190);
const FRONT: RGBColor = RGBColor(20, 90, 160);
const USUAL: RGBColor = RGBColor(200, 60, 30);
/// Pixels of the plot of all settings, and of that of a knob.
const WHOLE: [u32; 2] = [1040, 560];
const KNOB: [u32; 2] = [510, 340];

const MORE_STYLE: &str = "
.plots { display: flex; flex-wrap: wrap; gap: 1rem; }
svg { max-width: 100%; height: auto; }
table { font-size: .85rem; }
td, th { padding: .2rem .6rem; white-space: nowrap; }
td:last-child, th:last-child { text-align: left; white-space: normal; }
.broken { background: #fbd9d0; font-weight: bold; }
.edge { color: #777; }";

/// Writes `index.html`, which asks for nothing from outside.
pub(super) fn write(path: &Path, findings: &Findings) -> Result<(), Failure> {
    output::write_text(path, &page(findings)?)
}

fn page(findings: &Findings) -> Result<String, Failure> {
    let [width, height] = findings.size;
    let Findings { gaussians, views, repeats, .. } = findings;
    let scene = escaped(&findings.scene);
    let gaussians = crate::fit::thousands(*gaussians);
    let threads = rayon::current_num_threads();
    let table = html_table(&table::rows(findings));
    let front = front_plot(findings)?;
    let knobs = knob_plots(findings)?;
    let front_table = html_table(&front_rows(findings));
    let fixed: String = FIXED.iter().map(|(name, why)| format!("<li>{name}: {why}</li>\n")).collect();
    let off_axis = html_table(&off_axis_rows(&findings.off_axis));
    let sort = sort_section(&findings.sort);
    let stability = stability_section(&findings.stability);
    Ok(format!(
        "<!doctype html>
<html lang=\"en\">
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width\">
<title>specula: error against run time</title>
<style>
{STYLE}{MORE_STYLE}
</style>
<h1>Error against run time</h1>
<p>{scene}: {gaussians} Gaussians, {views} views of {width} × {height} pixels, {threads} threads, least of {repeats}
times. Errors are those of sRGB colours against the same pipeline in <code>f64</code> with nothing cut off and its light
filtered from finer nodes; a step of 8 bits is 4e-3. Where knobs hardly differ in time, the least of the times does so by
chance; <a href=\"report.jsonl\">report.jsonl</a> has medians, spreads, stages, and counts of the work.</p>
<h2>The cheapest setting</h2>
{table}
<h2>All settings</h2>
<p>Blue: what no other setting beats. Red: what is usual. Grey: all others.</p>
{front}
{front_table}
<h2>Knob by knob</h2>
<p>All other knobs are at their most exact. Red: what is usual.</p>
<div class=\"plots\">
{knobs}</div>
<h2>What cannot be turned</h2>
<ul>
{fixed}</ul>
{sort}
<h2>Off the axis</h2>
<p>The largest difference of an alpha from that along rays, affine / on the tangent plane, of opaque Gaussians whose standard
deviation is a share of their distance. It does not depend on the scene.</p>
{off_axis}
{stability}
</html>
"
    ))
}

fn front_plot(findings: &Findings) -> Result<String, Failure> {
    let points: Vec<[f64; 2]> = findings.measured.iter().map(Measured::point).collect();
    let place = |index: usize| (points[index], String::new());
    let is_drawn = |index: &usize| points[*index][0].is_finite();
    let all: Vec<Place> = (0..points.len()).filter(is_drawn).map(place).collect();
    let front: Vec<Place> = pareto(&points).into_iter().filter(is_drawn).map(place).collect();
    let usual = findings.measured.iter().filter(|own| own.setting == findings.usual);
    let usual = usual.map(|own| (own.point(), "the usual".to_owned())).collect();
    let series = [
        Series { places: all, color: BEATEN, is_line: false, radius: 3 },
        Series { places: front, color: FRONT, is_line: true, radius: 4 },
        Series { places: usual, color: USUAL, is_line: false, radius: 5 },
    ];
    log_log("every setting", WHOLE, &series)
}

/// Shapes and angles down, scales across; each affine and on the tangent plane.
fn off_axis_rows(all: &[OffAxis]) -> Vec<[String; 2 + SCALES.len()]> {
    let head = |k: usize| match k {
        0 => "shape".into(),
        1 => "off the axis".into(),
        k => format!("{}", SCALES[k - 2]),
    };
    let row = |own: &[OffAxis]| {
        core::array::from_fn(|k| match k {
            0 => own[0].shape.into(),
            1 => format!("{}°", own[0].degrees),
            k => format!("{:.1e} / {:.1e}", own[k - 2].affine, own[k - 2].tangent),
        })
    };
    core::iter::once(core::array::from_fn(head)).chain(all.chunks(SCALES.len()).map(row)).collect()
}

/// One order for a picture against an order for each pixel.
fn sort_section(sort: &Sort) -> String {
    let row = |(order, errors): &(&str, Errors)| {
        [
            (*order).to_owned(),
            format!("{:.1} dB", errors.psnr),
            format!("{:.1e}", errors.rms),
            format!("{:.1e}", errors.max),
            format!("{:.1e}", errors.flip),
            format!("{:.2}°", errors.normal_mae),
        ]
    };
    let heads = ["sorted by", "PSNR", "rms", "largest", "FLIP", "normals"].map(str::to_owned);
    let table = html_table(&core::iter::once(heads).chain(sort.orders.iter().map(row)).collect::<Vec<_>>());
    let Sort { tiles, size: [width, height], apart, .. } = sort;
    format!(
        "<h2>Sort</h2>
<p>Gaussians are sorted once for a picture. Against an order for each pixel, by the depth at which each Gaussian is strongest
along the pixel's ray, with everything else equal; the middle of each view, {tiles} tiles of {width} × {height} pixels. The
order for each pixel is that of a second renderer, which shares no formula with the first; sorted alike, the two are
{apart:.1e} apart at most.</p>
{table}"
    )
}

/// The front as a table.
fn front_rows(findings: &Findings) -> Vec<[String; 5]> {
    let points: Vec<[f64; 2]> = findings.measured.iter().map(Measured::point).collect();
    let row = |index: usize| {
        let Measured { setting, errors, .. } = &findings.measured[index];
        [
            format!("{:.1e}", errors.rms),
            format!("{:.1} dB", errors.psnr),
            format!("{:.1e}", errors.max),
            format!("{:.2}", points[index][1]),
            Difference(setting, &findings.usual).to_string(),
        ]
    };
    let heads = ["rms", "PSNR", "largest", "ms", "changed from the default"].map(str::to_owned);
    core::iter::once(heads).chain(pareto(&points).into_iter().map(row)).collect()
}

fn knob_plots(findings: &Findings) -> Result<String, Failure> {
    let mut plots = String::new();
    for (index, knob) in KNOBS.iter().enumerate() {
        let own: Vec<&Measured> = findings.measured.iter().filter(|own| own.knob == Some(index)).collect();
        if own.is_empty() {
            continue;
        }
        let place = |own: &&Measured| (own.point(), knob.word(&own.setting));
        let is_usual = |own: &&&Measured| knob.word(&own.setting) == knob.word(&findings.usual);
        let is_drawn = |own: &&&Measured| own.point()[0].is_finite();
        let all = own.iter().filter(is_drawn).map(place).collect();
        let usual = own.iter().filter(is_drawn).filter(is_usual).map(|own| (own.point(), String::new())).collect();
        let series = [
            Series { places: all, color: FRONT, is_line: true, radius: 3 },
            Series { places: usual, color: USUAL, is_line: false, radius: 5 },
        ];
        plots.push_str(&log_log(knob.name, KNOB, &series)?);
        plots.push('\n');
    }
    Ok(plots)
}

fn stability_section(rows: &[Row]) -> String {
    if rows.is_empty() {
        return String::new();
    }
    let heads: String = PROMISES.iter().map(|(name, words)| format!("<th title=\"{words}\">{name}</th>")).collect();
    let body: String = rows.iter().map(stability_row).collect();
    let words: String = PROMISES.iter().map(|(name, words)| format!("<li>{name}: {words}</li>\n")).collect();
    format!(
        "<h2>At the edges of what is valid</h2>
<p>Scenes that are hard, and how close they come to breaking what is promised. All but the distances from <code>f64</code>
are promised to be zero. In grey: scenes of which much hangs on rounding.</p>
<ul>
{words}</ul>
<table>
<tr><th>case</th>{heads}</tr>
{body}</table>"
    )
}

fn stability_row(row: &Row) -> String {
    let cell = |(index, value): (usize, f64)| {
        // The distances from f64 are measured, the rest is promised to be none.
        let is_broken = value != 0.0 && !(1..=2).contains(&index);
        let class = if is_broken { " class=\"broken\"" } else { "" };
        let words = if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") };
        format!("<td{class}>{words}</td>")
    };
    let cells: String = row.values().into_iter().enumerate().map(cell).collect();
    let class = if row.is_on_edge { " class=\"edge\"" } else { "" };
    let form = format!("{:?}", row.form).to_lowercase();
    format!("<tr{class}><td>{} ({form})</td>{cells}</tr>\n", escaped(row.case))
}
