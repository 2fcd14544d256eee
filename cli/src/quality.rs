//! Measures in words, and in the files that the field's scripts read.

use serde_json::{Map, Value, json};
use specula_io::model_folder;
use specula_train::evaluate::ViewQuality;

/// Something that can be measured of a view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measure {
    /// What files call it.
    pub(crate) name: &'static str,
    /// What people read.
    pub(crate) words: &'static str,
    /// Behind the number.
    pub(crate) unit: &'static str,
    /// Digits behind the point that mean something.
    pub(crate) decimals: usize,
    /// Whether more is better.
    pub(crate) more_is_better: bool,
}

/// Every measure, as tables order them.
pub(crate) const MEASURES: [Measure; 6] = [
    Measure { name: "PSNR", words: "PSNR", unit: " dB", decimals: 2, more_is_better: true },
    Measure { name: "SSIM", words: "SSIM", unit: "", decimals: 4, more_is_better: true },
    Measure { name: "LPIPS", words: "LPIPS", unit: "", decimals: 4, more_is_better: false },
    Measure { name: "FLIP", words: "FLIP", unit: "", decimals: 4, more_is_better: false },
    Measure { name: "PSNR_fitted", words: "PSNR fitted to the truth", unit: " dB", decimals: 2, more_is_better: true },
    Measure { name: "MAE", words: "normal MAE", unit: "°", decimals: 2, more_is_better: false },
];
/// Places in [`MEASURES`].
pub(crate) const PSNR: usize = 0;
pub(crate) const SSIM: usize = 1;
pub(crate) const LPIPS: usize = 2;
pub(crate) const FLIP: usize = 3;
/// After the exposure that comes closest to the truth.
pub(crate) const FITTED: usize = 4;
pub(crate) const MAE: usize = 5;

impl Measure {
    /// A value with as many digits as mean something.
    pub(crate) fn number(&self, value: f64) -> String {
        format!("{value:.0$}", self.decimals)
    }

    /// Larger for better values.
    pub(crate) fn goodness(&self, value: f64) -> f64 {
        if self.more_is_better { value } else { -value }
    }
}

/// A value for each of [`MEASURES`]; none where it was not measured.
pub(crate) type Values = [Option<f64>; MEASURES.len()];

/// Measures of one view.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Measured {
    /// What the data set calls the view.
    pub(crate) name: String,
    pub(crate) values: Values,
}

impl From<ViewQuality> for Measured {
    fn from(quality: ViewQuality) -> Self {
        let ViewQuality { name, psnr, ssim, normal_mae } = quality;
        let mut values = [None; MEASURES.len()];
        (values[PSNR], values[SSIM], values[MAE]) = (Some(psnr), Some(ssim), normal_mae);
        Self { name, values }
    }
}

/// Means over the views that have a measure.
pub(crate) fn means(views: &[Measured]) -> Values {
    core::array::from_fn(|measure| {
        let values: Vec<f64> = views.iter().filter_map(|view| view.values[measure]).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    })
}

/// One line for people.
pub(crate) fn line(means: &Values) -> String {
    let word = |(measure, value): (&Measure, &Option<f64>)| {
        value.map(|value| format!("{} {}{}", measure.words, measure.number(value), measure.unit))
    };
    MEASURES.iter().zip(means).filter_map(word).collect::<Vec<_>>().join("  ")
}

/// For `results.json` and `per_view.json`; measures that no view has are left out.
pub(crate) fn for_files(views: &[Measured]) -> model_folder::Quality {
    let of_views = |measure: usize| {
        let numbered = views.iter().enumerate();
        numbered.filter_map(move |(index, view)| Some((picture_name(index), view.values[measure]?))).collect()
    };
    let measured = means(views).into_iter().enumerate();
    measured.filter_map(|(measure, mean)| Some((MEASURES[measure].name.to_owned(), mean?, of_views(measure)))).collect()
}

/// How the picture of a view is called.
pub(crate) fn picture_name(index: usize) -> String {
    format!("{index:05}.png")
}

/// Everything, for other programs.
pub(crate) fn report(views: &[Measured]) -> Value {
    let of_view = |view: &Measured| {
        let mut all = object(&view.values);
        all.insert("name".into(), view.name.as_str().into());
        Value::from(all)
    };
    let mut report = for_programs(&means(views));
    report["views"] = views.iter().map(of_view).collect::<Vec<_>>().into();
    report
}

/// Values by name, for other programs.
pub(crate) fn for_programs(values: &Values) -> Value {
    json!(object(values))
}

fn object(values: &Values) -> Map<String, Value> {
    let named = MEASURES.iter().zip(values);
    named.filter_map(|(measure, value)| Some((measure.name.to_owned(), (*value)?.into()))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(psnr: f64, mae: Option<f64>) -> Measured {
        ViewQuality { name: "one".into(), psnr, ssim: 0.5, normal_mae: mae }.into()
    }

    #[test]
    fn a_mean_is_that_of_the_views_that_have_the_measure() {
        let views = [view(30.0, None), view(20.0, Some(4.0))];
        assert_eq!(means(&views), [Some(25.0), Some(0.5), None, None, None, Some(4.0)]);
        assert_eq!(line(&means(&views)), "PSNR 25.00 dB  SSIM 0.5000  normal MAE 4.00°");
        let files = for_files(&views);
        assert_eq!(files[2], ("MAE".into(), 4.0, vec![("00001.png".into(), 4.0)]));
        assert_eq!(files.len(), 3, "what no view has is left out");
    }
}
