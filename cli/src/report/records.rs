//! Everything that was measured, a line of JSON each.

use super::{Findings, Measured};
use crate::{failure::Failure, output};
use serde_json::{Map, Value, json};
use specula_accuracy::{
    error::Errors,
    off_axis::OffAxis,
    setting::KNOBS,
    sort::Sort,
    stability::{PROMISES, Row},
    trial::{STAGES, Spread},
};
use std::path::Path;

/// Writes `report.jsonl`.
pub(super) fn write(path: &Path, findings: &Findings) -> Result<(), Failure> {
    let settings = findings.measured.iter().map(|own| of_setting(own, findings));
    let lines = core::iter::once(of_scene(findings)).chain(settings).chain(findings.stability.iter().map(of_row));
    let lines = lines.chain(findings.off_axis.iter().map(of_angle)).chain(of_orders(&findings.sort));
    output::write_text(path, &lines.map(|line| format!("{line}\n")).collect::<String>())
}

fn of_scene(findings: &Findings) -> Value {
    json!({
        "kind": "scene",
        "scene": findings.scene,
        "gaussians": findings.gaussians,
        "views": findings.views,
        "size": findings.size,
        "repeats": findings.repeats,
        "threads": rayon::current_num_threads(),
        "vectors": specula_cpu::CpuExecutor::new().vectors(),
        "version": env!("CARGO_PKG_VERSION"),
    })
}

fn of_setting(own: &Measured, findings: &Findings) -> Value {
    let knobs: Map<String, Value> =
        own.setting.words().into_iter().map(|(name, word)| (name.into(), word.into())).collect();
    let times: Map<String, Value> =
        STAGES.iter().zip(own.times).map(|(stage, times)| ((*stage).to_owned(), of_spread(times))).collect();
    let work = own.work;
    json!({
        "kind": "setting",
        "knobs": knobs,
        "turned": own.knob.map(|knob| KNOBS[knob].name),
        "is_usual": own.setting == findings.usual,
        "error": of_errors(&own.errors),
        "milliseconds": times,
        "filter_milliseconds": own.filter,
        "work": {
            "intersections": work.intersections, "pairs": work.pairs,
            "pairs_in_perspective": work.pairs_in_perspective, "perspectives": work.perspectives, "texel_reads": work.texel_reads,
            "weights": work.weights, "numbers": work.numbers, "channels": work.channels,
        },
        "bytes": work.bytes,
    })
}

fn of_errors(errors: &Errors) -> Value {
    json!({
        "max": errors.max, "rms": errors.rms, "relative_l2": errors.relative,
        "psnr": if errors.psnr.is_finite() { json!(errors.psnr) } else { Value::Null },
        "ssim": errors.ssim, "flip": errors.flip, "p999": errors.p999,
        "normal_mae": errors.normal_mae, "nonfinite": errors.nonfinite,
    })
}

fn of_spread(times: Spread) -> Value {
    json!({"min": times.min, "median": times.median, "iqr": times.iqr})
}

/// Against an order for each pixel.
fn of_orders(sort: &Sort) -> impl Iterator<Item = Value> {
    sort.orders.iter().map(|(order, errors)| {
        json!({
            "kind": "sort",
            "by": order,
            "tiles": sort.tiles,
            "size": sort.size,
            "error": of_errors(errors),
            "renderers_apart": sort.apart,
        })
    })
}

fn of_angle(own: &OffAxis) -> Value {
    json!({
        "kind": "off axis",
        "shape": own.shape,
        "degrees": own.degrees,
        "scale": own.scale,
        "affine": own.affine,
        "tangent": own.tangent,
    })
}

fn of_row(row: &Row) -> Value {
    let number = |value: f64| if value.is_finite() { json!(value) } else { json!("infinite") };
    let values: Map<String, Value> =
        PROMISES.iter().zip(row.values()).map(|((name, _), value)| ((*name).to_owned(), number(value))).collect();
    json!({
        "kind": "stability",
        "case": row.case,
        "form": format!("{:?}", row.form).to_lowercase(),
        "hangs_on_rounding": row.is_on_edge,
        "worst": values,
    })
}
