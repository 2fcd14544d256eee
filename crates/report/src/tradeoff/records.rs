//! Every measurement as a line of JSON.

use crate::tradeoff::{
    findings::{Findings, MeasuredSetting},
    lamps::LampSetting,
};
use serde::Serialize;
use serde_json::json;
use specula_accuracy::{
    error::Errors,
    off_axis::OffAxis,
    setting::PARAMETERS,
    sort::Sort,
    stability::{PROMISES, Row},
    trial::{STAGES, Spread},
};
use std::collections::BTreeMap;

/// Text of `report.jsonl`.
pub fn records(findings: &Findings) -> String {
    let settings = findings.measured.iter().map(|measured| Record::setting(measured, findings));
    let lines =
        core::iter::once(Record::scene(findings)).chain(settings).chain(findings.stability.iter().map(Record::from));
    let lines = lines.chain(findings.lamps.iter().map(Record::from));
    let lines = lines.chain(findings.off_axis.iter().map(Record::from)).chain(Record::orders(&findings.sort));
    // Conversion through a value sorts the keys.
    lines.map(|line| format!("{}\n", json!(line))).collect()
}

/// Line of `report.jsonl`.
#[derive(Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum Record<'a> {
    Scene {
        scene: &'a str,
        gaussians: usize,
        views: usize,
        size: [u32; 2],
        repeats: u32,
        threads: usize,
        vectors: String,
        version: &'static str,
    },
    Setting {
        #[serde(rename = "knobs")]
        parameters: BTreeMap<&'static str, String>,
        /// The one parameter that is varied.
        #[serde(rename = "turned")]
        varied: Option<&'static str>,
        #[serde(rename = "is_usual")]
        is_default: bool,
        error: ErrorRecord,
        milliseconds: BTreeMap<&'static str, SpreadRecord>,
        filter_milliseconds: f64,
        work: WorkRecord,
        bytes: usize,
    },
    /// Errors against an order per pixel.
    Sort {
        by: &'a str,
        tiles: usize,
        size: [u32; 2],
        error: ErrorRecord,
        milliseconds: Option<f64>,
        renderers_apart: f64,
    },
    #[serde(rename = "off axis")]
    OffAxis {
        shape: &'static str,
        degrees: f64,
        scale: f64,
        affine: f64,
        tangent: f64,
    },
    /// A sun's shadows.
    Sun {
        rays: Option<usize>,
        is_reflected: bool,
        error: ErrorRecord,
        placing_milliseconds: f64,
        milliseconds: SpreadRecord,
    },
    Stability {
        case: &'static str,
        form: String,
        hangs_on_rounding: bool,
        worst: BTreeMap<&'static str, NumberRecord>,
    },
}

#[derive(Serialize)]
struct ErrorRecord {
    max: f64,
    rms: f64,
    relative_l2: f64,
    /// `None` if infinite.
    psnr: Option<f64>,
    ssim: f64,
    flip: f64,
    p999: f64,
    normal_mae: f64,
    nonfinite: usize,
}

#[derive(Serialize)]
struct SpreadRecord {
    min: f64,
    median: f64,
    iqr: f64,
}

#[derive(Serialize)]
struct WorkRecord {
    intersections: usize,
    pairs: usize,
    pairs_in_perspective: usize,
    perspectives: usize,
    texel_reads: usize,
    weights: usize,
    numbers: usize,
    channels: usize,
}

/// Number, or a word for numbers that JSON does not support.
#[derive(Serialize)]
#[serde(untagged)]
enum NumberRecord {
    Finite(f64),
    Infinite(&'static str),
}

impl<'a> Record<'a> {
    fn scene(findings: &'a Findings) -> Self {
        Self::Scene {
            scene: &findings.scene,
            gaussians: findings.gaussians,
            views: findings.views,
            size: findings.size,
            repeats: findings.repeats,
            threads: rayon::current_num_threads(),
            vectors: specula_cpu::CpuExecutor::new().vectors(),
            version: env!("CARGO_PKG_VERSION"),
        }
    }

    fn setting(measured: &MeasuredSetting, findings: &Findings) -> Self {
        let work = measured.work;
        Self::Setting {
            parameters: measured.setting.words().into_iter().collect(),
            varied: measured.parameter.map(|parameter| PARAMETERS[parameter].name),
            is_default: measured.setting == findings.default,
            error: ErrorRecord::from(&measured.errors),
            milliseconds: STAGES.into_iter().zip(measured.times.map(SpreadRecord::from)).collect(),
            filter_milliseconds: measured.filter,
            work: WorkRecord {
                intersections: work.intersections,
                pairs: work.pairs,
                pairs_in_perspective: work.pairs_in_perspective,
                perspectives: work.perspectives,
                texel_reads: work.texel_reads,
                weights: work.weights,
                numbers: work.numbers,
                channels: work.channels,
            },
            bytes: work.bytes,
        }
    }

    fn orders(sort: &'a Sort) -> impl Iterator<Item = Self> {
        sort.orders.iter().map(|sorted| Self::Sort {
            by: &sorted.by,
            tiles: sort.tiles,
            size: sort.size,
            error: ErrorRecord::from(&sorted.errors),
            milliseconds: sorted.milliseconds,
            renderers_apart: sort.apart,
        })
    }
}

impl From<&OffAxis> for Record<'_> {
    fn from(errors: &OffAxis) -> Self {
        let OffAxis { shape, degrees, scale, affine, tangent } = *errors;
        Self::OffAxis { shape, degrees, scale, affine, tangent }
    }
}

impl From<&LampSetting> for Record<'_> {
    fn from(lamp: &LampSetting) -> Self {
        let LampSetting { rays, is_reflected, errors, placing, times } = lamp;
        Self::Sun {
            rays: *rays,
            is_reflected: *is_reflected,
            error: ErrorRecord::from(errors),
            placing_milliseconds: *placing,
            milliseconds: SpreadRecord::from(*times),
        }
    }
}

impl From<&Row> for Record<'_> {
    fn from(row: &Row) -> Self {
        let number = |value: f64| {
            if value.is_finite() { NumberRecord::Finite(value) } else { NumberRecord::Infinite("infinite") }
        };
        Self::Stability {
            case: row.case,
            form: format!("{:?}", row.form).to_lowercase(),
            hangs_on_rounding: row.is_on_edge,
            worst: PROMISES.into_iter().map(|(name, _)| name).zip(row.values().map(number)).collect(),
        }
    }
}

impl From<&Errors> for ErrorRecord {
    fn from(errors: &Errors) -> Self {
        Self {
            max: errors.max,
            rms: errors.rms,
            relative_l2: errors.relative,
            psnr: Some(errors.psnr).filter(|psnr| psnr.is_finite()),
            ssim: errors.ssim,
            flip: errors.flip,
            p999: errors.p999,
            normal_mae: errors.normal_mae,
            nonfinite: errors.nonfinite,
        }
    }
}

impl From<Spread> for SpreadRecord {
    fn from(times: Spread) -> Self {
        let Spread { min, median, iqr } = times;
        Self { min, median, iqr }
    }
}
