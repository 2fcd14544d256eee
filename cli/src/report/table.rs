//! The cheapest setting for some errors, as a table.

use super::{Findings, Measured};
use specula_accuracy::{front::cheapest, setting::Difference, trial::STAGES};

/// Errors that one asks for, in dB.
pub(super) const ASKED: [f64; 4] = [30.0, 40.0, 50.0, 60.0];
const HEADS: [&str; 8] =
    ["at least", "PSNR", "largest", "FLIP", "ms", "of the usual", "pairs", "changed from the default"];

/// Rows of the table: heads first.
pub(super) fn rows(findings: &Findings) -> Vec<[String; 8]> {
    let points: Vec<[f64; 2]> =
        findings.measured.iter().map(|own| [-limited(own.errors.psnr, own.errors.nonfinite), own.point()[1]]).collect();
    let of_asked = |asked: &f64| {
        let first = format!("{asked:.0} dB");
        cheapest(&points, -asked).map(|index| row(first, &findings.measured[index], findings))
    };
    let usual = findings.measured.iter().find(|own| own.setting == findings.usual);
    let usual = usual.map(|own| row("the usual".into(), own, findings));
    let most =
        findings.measured.iter().find(|own| own.knob.is_some()).map(|own| row("most exact".into(), own, findings));
    let asked = ASKED.iter().filter_map(of_asked);
    core::iter::once(HEADS.map(str::to_owned)).chain(asked).chain(usual).chain(most).collect()
}

/// What is not finite is as far off as can be.
fn limited(psnr: f64, nonfinite: usize) -> f64 {
    if nonfinite == 0 { psnr } else { f64::NEG_INFINITY }
}

fn row(first: String, own: &Measured, findings: &Findings) -> [String; 8] {
    let whole = STAGES.len() - 1;
    let usual = findings.measured.iter().find(|own| own.setting == findings.usual);
    let of_usual = usual.map_or(f64::NAN, |usual| own.times[whole].min / usual.times[whole].min);
    [
        first,
        format!("{:.1} dB", own.errors.psnr),
        format!("{:.1e}", own.errors.max),
        format!("{:.1e}", own.errors.flip),
        format!("{:.2}", own.times[whole].min),
        format!("{of_usual:.2}"),
        crate::fit::thousands(own.work.pairs / findings.views.max(1)),
        Difference(&own.setting, &findings.usual).to_string(),
    ]
}

/// The table in Markdown.
pub(super) fn markdown(findings: &Findings) -> String {
    let rows = rows(findings);
    let line = |cells: &[String; 8]| format!("| {} |", cells.join(" | "));
    let rule = format!("|{}", "---|".repeat(HEADS.len()));
    let body = rows.iter().skip(1).map(line);
    rows.first().map(line).into_iter().chain([rule]).chain(body).collect::<Vec<_>>().join("\n")
}
