//! Table of the cheapest settings for given errors.

use crate::tradeoff::{
    findings::{Findings, MeasuredSetting},
    lamps::{self, LampSetting},
};
use specula_accuracy::{front::cheapest, setting::Difference};
use specula_scene::number::group_digits;

/// Required PSNR in dB.
const REQUIRED: [f64; 4] = [30.0, 40.0, 50.0, 60.0];
pub(super) const HEADS: [&str; 8] =
    ["at least", "PSNR", "max error", "FLIP", "ms", "relative time", "pairs", "changes from the default"];

/// Rows of the table: the cheapest setting for each required PSNR, the default, the most exact.
pub(super) fn rows(findings: &Findings) -> Vec<[String; 8]> {
    let psnr = |measured: &MeasuredSetting| match measured.errors.nonfinite {
        0 => measured.errors.psnr,
        _ => f64::NEG_INFINITY,
    };
    let points: Vec<[f64; 2]> =
        findings.measured.iter().map(|measured| [-psnr(measured), measured.milliseconds()]).collect();
    let row_of_psnr = |psnr: &f64| {
        let label = format!("{psnr:.0} dB");
        cheapest(&points, -psnr).map(|index| row(label, &findings.measured[index], findings))
    };
    let default = findings.measured_default().map(|measured| row("default".into(), measured, findings));
    let most_exact = findings.measured.iter().find(|measured| measured.parameter.is_some());
    let most_exact = most_exact.map(|measured| row("most exact".into(), measured, findings));
    REQUIRED.iter().filter_map(row_of_psnr).chain(default).chain(most_exact).collect()
}

fn row(label: String, measured: &MeasuredSetting, findings: &Findings) -> [String; 8] {
    let default = findings.measured_default().map_or(f64::NAN, MeasuredSetting::milliseconds);
    [
        label,
        format!("{:.1} dB", measured.errors.psnr),
        format!("{:.1e}", measured.errors.max),
        format!("{:.1e}", measured.errors.flip),
        format!("{:.2}", measured.milliseconds()),
        format!("{:.2}", measured.milliseconds() / default),
        group_digits(measured.work.pairs / findings.views.max(1)),
        Difference(&measured.setting, &findings.default).to_string(),
    ]
}

/// Tables in Markdown: the cheapest settings, and suns if they were measured.
pub fn markdown(findings: &Findings) -> String {
    let cheapest = in_markdown(HEADS, rows(findings));
    if findings.lamps.is_empty() {
        return cheapest;
    }
    let suns = in_markdown(lamps::HEADS, findings.lamps.iter().map(LampSetting::row));
    format!("{cheapest}\n\n{suns}")
}

fn in_markdown<const N: usize>(heads: [&str; N], rows: impl IntoIterator<Item = [String; N]>) -> String {
    let line = |cells: [String; N]| format!("| {} |", cells.join(" | "));
    let rule = format!("|{}", "---|".repeat(N));
    let heads = line(heads.map(str::to_owned));
    [heads, rule].into_iter().chain(rows.into_iter().map(line)).collect::<Vec<_>>().join("\n")
}
