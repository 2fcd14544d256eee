//! Measures of picture quality, and the files in which the field's scripts expect them.
//!
//! One list holds all measures, with names, digits and direction; lines, files, pages and tables
//! follow it. `train` computes the measures that need only pictures, `eval` adds slower ones.
//! `results.json` keeps INRIA's form, a method with its values, and the name of a method records
//! each setting that differs from the training, so that evaluations do not overwrite each other.

use serde_json::{Map, Value, json};
use specula_io::model_folder;
use specula_scene::{SceneError, SceneRenderer, picture_folder::picture_name};
use specula_train::{
    evaluate::{ViewQuality, fitted_psnr, linear_psnr, measure_view},
    view::View,
};
use std::path::Path;

/// Measure of a view's quality.
#[derive(Clone, Copy, Debug)]
pub struct Measure {
    /// Key in files.
    pub name: &'static str,
    /// Name in text and tables.
    pub label: &'static str,
    /// Unit after a number, including the space.
    pub unit: &'static str,
    /// Significant decimal places.
    pub decimals: usize,
    /// Whether larger values are better.
    pub higher_is_better: bool,
}

/// Every measure, in the order of tables.
pub const MEASURES: [Measure; 11] = [
    Measure { name: "PSNR", label: "PSNR", unit: " dB", decimals: 2, higher_is_better: true },
    Measure { name: "SSIM", label: "SSIM", unit: "", decimals: 4, higher_is_better: true },
    Measure { name: "LPIPS", label: "LPIPS", unit: "", decimals: 4, higher_is_better: false },
    Measure { name: "FLIP", label: "FLIP", unit: "", decimals: 4, higher_is_better: false },
    Measure {
        name: "PSNR_fitted",
        label: "PSNR fitted to the truth",
        unit: " dB",
        decimals: 2,
        higher_is_better: true,
    },
    Measure { name: "PSNR_linear", label: "PSNR of linear radiance", unit: " dB", decimals: 2, higher_is_better: true },
    Measure { name: "MAE", label: "normal MAE", unit: "°", decimals: 2, higher_is_better: false },
    Measure { name: "MAE_weighted", label: "weighted MAE", unit: "°", decimals: 2, higher_is_better: false },
    Measure { name: "albedo_PSNR", label: "albedo PSNR", unit: " dB", decimals: 2, higher_is_better: true },
    Measure { name: "roughness_error", label: "roughness error", unit: "", decimals: 3, higher_is_better: false },
    Measure { name: "metalness_error", label: "metalness error", unit: "", decimals: 3, higher_is_better: false },
];
/// Index of the peak signal-to-noise ratio in [`MEASURES`].
pub const PSNR: usize = 0;
/// Index of the structural similarity in [`MEASURES`].
pub const SSIM: usize = 1;
/// Index of the learned perceptual distance in [`MEASURES`].
pub const LPIPS: usize = 2;
/// Index of ꟻLIP in [`MEASURES`].
pub const FLIP: usize = 3;
/// Index of PSNR after the exposure that fits the ground truth best in [`MEASURES`].
pub const PSNR_FITTED: usize = 4;
/// Index of the peak signal-to-noise ratio of linear radiance in [`MEASURES`].
pub const PSNR_LINEAR: usize = 5;
/// Index of the mean angle between normals in [`MEASURES`].
pub const MAE: usize = 6;
/// Index of the mean angle between normals, weighted by opacity, in [`MEASURES`].
pub const MAE_WEIGHTED: usize = 7;
/// Index of PSNR of the albedo after scaling ([`mod@crate::materials`]) in [`MEASURES`].
pub const ALBEDO_PSNR: usize = 8;
/// Index of the mean absolute error of perceptual roughness in [`MEASURES`].
pub const ROUGHNESS_ERROR: usize = 9;
/// Index of the mean absolute error of metalness in [`MEASURES`].
pub const METALNESS_ERROR: usize = 10;

impl Measure {
    /// Value with its significant decimal places.
    pub fn format(&self, value: f64) -> String {
        format!("{value:.0$}", self.decimals)
    }

    /// Value with its sign chosen so that larger is better.
    pub fn goodness(&self, value: f64) -> f64 {
        if self.higher_is_better { value } else { -value }
    }
}

/// Value of each of [`MEASURES`]; `None` if it was not computed.
pub type Values = [Option<f64>; MEASURES.len()];

/// Measures of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewMeasures {
    /// Name of the view in its data set.
    pub name: String,
    /// Value of each measure.
    pub values: Values,
}

impl From<ViewQuality> for ViewMeasures {
    fn from(quality: ViewQuality) -> Self {
        let ViewQuality { name, psnr, ssim, normal_mae } = quality;
        let mut values = [None; MEASURES.len()];
        (values[PSNR], values[SSIM], values[MAE]) = (Some(psnr), Some(ssim), normal_mae);
        Self { name, values }
    }
}

impl ViewMeasures {
    /// Measures of a view; `None` if no pixel of it is known.
    #[must_use]
    pub fn of_known(self, view: &View) -> Self {
        if view.is_unknown() { Self { values: [None; MEASURES.len()], ..self } } else { self }
    }
}

/// Measures every view over a background in sRGB, and again after the best-fitting exposure if
/// `is_exposed`. Views without a known pixel have no measures. `progress` receives the number of
/// measured views.
///
/// # Errors
///
/// Those of [`SceneRenderer::render`].
pub fn measure_views(
    renderer: &mut SceneRenderer,
    views: &[View],
    background: [f32; 3],
    is_exposed: bool,
    progress: impl FnMut(usize) + Send,
) -> Result<Vec<ViewMeasures>, SceneError> {
    renderer.render_views(views, progress, |view, image| {
        let mut measured: ViewMeasures = measure_view(image, view, background).into();
        measured.values[PSNR_FITTED] = is_exposed.then(|| fitted_psnr(image, view, background));
        measured.values[PSNR_LINEAR] = linear_psnr(image, view, background);
        Ok(measured.of_known(view))
    })
}

/// Writes the measures of an iteration and further `facts` of them, and its progress, to the folder
/// of a model: seconds of training, number of Gaussians.
///
/// # Errors
///
/// Files that cannot be read, parsed or written.
pub fn save(
    folder: &Path,
    iteration: u32,
    seconds: f64,
    gaussians: usize,
    measured: &[ViewMeasures],
    facts: Map<String, Value>,
) -> specula_io::Result<()> {
    let quality = quality(measured);
    let method = model_folder::method_of(iteration);
    model_folder::save_quality(folder, &method, &quality)?;
    model_folder::add_quality(folder, &method, &quality, facts)?;
    model_folder::save_progress(folder, iteration, seconds, gaussians, &quality)
}

/// Mean of each measure over the views that have it.
pub fn means(views: &[ViewMeasures]) -> Values {
    core::array::from_fn(|measure| {
        let values: Vec<f64> = views.iter().filter_map(|view| view.values[measure]).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    })
}

/// Values on one line of text: `PSNR 25.00 dB  SSIM 0.5000`.
pub fn summary(values: &Values) -> String {
    let entry = |(measure, value): (&Measure, &Option<f64>)| {
        value.map(|value| format!("{} {}{}", measure.label, measure.format(value), measure.unit))
    };
    MEASURES.iter().zip(values).filter_map(entry).collect::<Vec<_>>().join("  ")
}

/// Entries of `results.json` and `per_view.json`. Measures that no view has are absent.
pub fn quality(views: &[ViewMeasures]) -> model_folder::Quality {
    let per_view = |measure: usize| {
        let numbered = views.iter().enumerate();
        numbered.filter_map(move |(index, view)| Some((picture_name(index), view.values[measure]?))).collect()
    };
    let measured = means(views).into_iter().enumerate();
    measured.filter_map(|(measure, mean)| Some((MEASURES[measure].name.to_owned(), mean?, per_view(measure)))).collect()
}

/// Means and the measures of each view as JSON.
pub fn json_of_views(views: &[ViewMeasures]) -> Value {
    let json_of_view = |view: &ViewMeasures| {
        let mut values = object(&view.values);
        values.insert("name".into(), view.name.as_str().into());
        Value::from(values)
    };
    let mut report = json_of_values(&means(views));
    report["views"] = views.iter().map(json_of_view).collect::<Vec<_>>().into();
    report
}

/// Values by key as a JSON object.
pub fn json_of_values(values: &Values) -> Value {
    json!(object(values))
}

fn object(values: &Values) -> Map<String, Value> {
    let named = MEASURES.iter().zip(values);
    named.filter_map(|(measure, value)| Some((measure.name.to_owned(), (*value)?.into()))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use specula_core::{camera::Camera, color::UNKNOWN};

    fn view(psnr: f64, mae: Option<f64>) -> ViewMeasures {
        ViewQuality { name: "one".into(), psnr, ssim: 0.5, normal_mae: mae }.into()
    }

    #[test]
    fn a_view_without_a_known_pixel_has_no_measures() {
        let camera = Camera::look_at(glam::Vec3::X, glam::Vec3::ZERO, glam::Vec3::Z, 0.7, 2, 1);
        let of = |rgba: [u8; 8]| {
            let seen = View { name: "one".into(), camera, rgba: rgba.to_vec(), unclipped: None, normals: None };
            view(f64::INFINITY, None).of_known(&seen).values
        };
        let [r, g, b, a] = UNKNOWN;
        assert_eq!(of([r, g, b, a, r, g, b, a]), [None; MEASURES.len()]);
        assert_eq!(of([r, g, b, a, 0, 0, 0, 0])[PSNR], Some(f64::INFINITY), "a transparent pixel is known");
    }

    #[test]
    fn a_mean_is_that_of_the_views_that_have_the_measure() {
        let views = [view(30.0, None), view(20.0, Some(4.0))];
        assert_eq!(means(&views), [Some(25.0), Some(0.5), None, None, None, None, Some(4.0), None, None, None, None]);
        assert_eq!(summary(&means(&views)), "PSNR 25.00 dB  SSIM 0.5000  normal MAE 4.00°");
        let files = quality(&views);
        assert_eq!(files[2], ("MAE".into(), 4.0, vec![("00001.png".into(), 4.0)]));
        assert_eq!(files.len(), 3, "measures that no view has are absent");
    }
}
