//! Every measurement as a line of JSON.

use crate::tradeoff::findings::{Findings, MeasuredSetting};
use serde_json::{Map, Value, json};
use specula_accuracy::{
    error::Errors,
    off_axis::OffAxis,
    setting::PARAMETERS,
    sort::Sort,
    stability::{PROMISES, Row},
    trial::{STAGES, Spread},
};

/// Text of `report.jsonl`.
pub fn records(findings: &Findings) -> String {
    let settings = findings.measured.iter().map(|measured| setting(measured, findings));
    let lines = core::iter::once(scene(findings)).chain(settings).chain(findings.stability.iter().map(stability));
    let lines = lines.chain(findings.off_axis.iter().map(off_axis)).chain(orders(&findings.sort));
    lines.map(|line| format!("{line}\n")).collect()
}

fn scene(findings: &Findings) -> Value {
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

fn setting(measured: &MeasuredSetting, findings: &Findings) -> Value {
    let parameters: Map<String, Value> =
        measured.setting.words().into_iter().map(|(name, value)| (name.into(), value.into())).collect();
    let times: Map<String, Value> =
        STAGES.iter().zip(measured.times).map(|(stage, times)| ((*stage).to_owned(), spread(times))).collect();
    let work = measured.work;
    json!({
        "kind": "setting",
        "knobs": parameters,
        "turned": measured.parameter.map(|parameter| PARAMETERS[parameter].name),
        "is_usual": measured.setting == findings.default,
        "error": errors_to_json(&measured.errors),
        "milliseconds": times,
        "filter_milliseconds": measured.filter,
        "work": {
            "intersections": work.intersections, "pairs": work.pairs,
            "pairs_in_perspective": work.pairs_in_perspective, "perspectives": work.perspectives, "texel_reads": work.texel_reads,
            "weights": work.weights, "numbers": work.numbers, "channels": work.channels,
        },
        "bytes": work.bytes,
    })
}

fn errors_to_json(errors: &Errors) -> Value {
    json!({
        "max": errors.max, "rms": errors.rms, "relative_l2": errors.relative,
        "psnr": if errors.psnr.is_finite() { json!(errors.psnr) } else { Value::Null },
        "ssim": errors.ssim, "flip": errors.flip, "p999": errors.p999,
        "normal_mae": errors.normal_mae, "nonfinite": errors.nonfinite,
    })
}

fn spread(times: Spread) -> Value {
    json!({"min": times.min, "median": times.median, "iqr": times.iqr})
}

/// Errors against an order per pixel.
fn orders(sort: &Sort) -> impl Iterator<Item = Value> {
    sort.orders.iter().map(|(order, errors)| {
        json!({
            "kind": "sort",
            "by": order,
            "tiles": sort.tiles,
            "size": sort.size,
            "error": errors_to_json(errors),
            "renderers_apart": sort.apart,
        })
    })
}

fn off_axis(errors: &OffAxis) -> Value {
    json!({
        "kind": "off axis",
        "shape": errors.shape,
        "degrees": errors.degrees,
        "scale": errors.scale,
        "affine": errors.affine,
        "tangent": errors.tangent,
    })
}

fn stability(row: &Row) -> Value {
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
