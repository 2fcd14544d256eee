//! Measures in words, and in the files that the field's scripts read.

use serde_json::{Map, Value, json};
use specula_io::model_folder;
use specula_train::evaluate::{Quality, ViewQuality, mean_quality};

/// A measure of one view, if it has it.
type Measure = fn(&ViewQuality) -> Option<f64>;

/// Name and value of each measure.
const MEASURES: [(&str, Measure); 3] =
    [("SSIM", |view| Some(view.ssim)), ("PSNR", |view| Some(view.psnr)), ("MAE", |view| view.normal_mae)];

/// One line for people.
pub(crate) fn line(quality: &Quality) -> String {
    let normals = quality.normal_mae.map_or(String::new(), |mae| format!("  normal MAE {mae:.2}°"));
    format!("PSNR {:.2} dB  SSIM {:.4}{normals}", quality.psnr, quality.ssim)
}

/// For `results.json` and `per_view.json`; measures that no view has are left out.
pub(crate) fn for_files(views: &[ViewQuality]) -> model_folder::Quality {
    let measured = MEASURES.iter().filter_map(|(name, measure)| {
        let values: Vec<(String, f64)> =
            views.iter().enumerate().filter_map(|(index, view)| Some((picture_name(index), measure(view)?))).collect();
        let mean = values.iter().map(|(_, value)| value).sum::<f64>() / values.len() as f64;
        (!values.is_empty()).then(|| ((*name).to_owned(), mean, values))
    });
    measured.collect()
}

/// How the picture of a view is called.
pub(crate) fn picture_name(index: usize) -> String {
    format!("{index:05}.png")
}

/// Everything, for other programs.
pub(crate) fn report(views: &[ViewQuality]) -> Value {
    let mean = mean_quality(views);
    let per_view: Vec<Value> = views
        .iter()
        .map(|view| with_normals(json!({"name": view.name, "PSNR": view.psnr, "SSIM": view.ssim}), view.normal_mae))
        .collect();
    let mut report = means(&mean);
    report["views"] = per_view.into();
    report
}

/// The means, for other programs.
pub(crate) fn means(quality: &Quality) -> Value {
    with_normals(json!({"PSNR": quality.psnr, "SSIM": quality.ssim}), quality.normal_mae)
}

fn with_normals(mut measures: Value, normal_mae: Option<f64>) -> Value {
    if let (Some(mae), Some(measures)) = (normal_mae, measures.as_object_mut()) {
        Map::insert(measures, "MAE".into(), mae.into());
    }
    measures
}
