//! Page of an evaluation: each view next to its ground truth and its error, the worst first.

use crate::{
    error::Result,
    evaluation::{
        relit::RelitScene,
        results::{EvaluatedLight, Evaluation},
        view::{EDGE_MAX, ERROR_MAX, EvaluatedView},
    },
    html::HtmlTable,
    light::COMMON_SIZE,
    measure::{MEASURES, PSNR, means},
};
use askama::Template;
use core::cmp::Ordering;
use specula_scene::{number::group_digits, text};

/// Maximum number of views on the page: those with the lowest PSNR.
const VIEWS_MAX: usize = 200;
/// Folder of the pictures, relative to the page.
const PICTURES: &str = "views";
/// Picture of the learned light next to the true one, relative to the page.
const LIGHT_PICTURE: &str = "light.png";
/// Pictures of a view: name of the file, and caption.
const KINDS: [[&str; 2]; 3] = [["truth", "ground truth"], ["picture", "rendering"], ["error", "error"]];

/// Page and its pictures.
#[derive(Debug)]
pub struct EvaluationPage<'a> {
    /// HTML, which requests nothing from outside its folder.
    pub html: String,
    /// JPEGs of views and a PNG of the light, each with its path relative to the page.
    pub pictures: Vec<(String, &'a [u8])>,
}

/// Page of an evaluation with pictures of its worst views.
///
/// # Errors
///
/// A template that cannot be rendered.
pub fn page(evaluation: &Evaluation) -> Result<EvaluationPage<'_>> {
    let order = worst_first(&evaluation.views);
    let pictures_of_view = |index: usize| {
        let pictures = evaluation.views[index].pictures.iter().flatten();
        KINDS.iter().zip(pictures).map(move |([kind, _], bytes)| (picture_path(index, kind), bytes.as_slice()))
    };
    let light = evaluation.light.as_ref().and_then(|light| light.picture.as_deref());
    let pictures = order.iter().take(VIEWS_MAX).flat_map(|index| pictures_of_view(*index));
    let pictures = pictures.chain(light.map(|bytes| (LIGHT_PICTURE.to_owned(), bytes))).collect();
    Ok(EvaluationPage { html: Page::new(evaluation, &order).render()?, pictures })
}

/// Path of a picture relative to the page.
fn picture_path(index: usize, kind: &str) -> String {
    format!("{PICTURES}/{index:05}-{kind}.jpg")
}

/// Indices of views by increasing PSNR, those without one last.
fn worst_first(views: &[EvaluatedView]) -> Vec<usize> {
    let psnr = |index: &usize| views[*index].measures.values[PSNR].unwrap_or(f64::INFINITY);
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by(|one, other| psnr(one).total_cmp(&psnr(other)).then(one.cmp(other)));
    order
}

#[derive(Template)]
#[template(path = "evaluation.html")]
struct Page {
    scene: String,
    facts: String,
    means: HtmlTable,
    /// Factors of the albedo as text.
    albedo_scale: Option<String>,
    light: Option<LightSection>,
    relit: Option<HtmlTable>,
    error_max: f32,
    edge_max: u32,
    /// Index and label of each computed measure.
    measures: Vec<(usize, &'static str)>,
    views: Vec<ViewSection>,
    /// Number of views that are not shown.
    hidden: usize,
}

impl Page {
    fn new(evaluation: &Evaluation, order: &[usize]) -> Self {
        let ranges = Ranges::of(&evaluation.views);
        let heads = [
            "light",
            "PSNR dB",
            "PSNR dB, scaled",
            "factors of red, green, blue",
            "PSNR dB, albedo scaled",
            "PSNR dB, views scaled",
            "views",
        ];
        let relit = || HtmlTable::new(heads, evaluation.relit.iter().map(RelitScene::cells));
        let shown = order.iter().take(VIEWS_MAX);
        Self {
            scene: text::shown(&evaluation.scene),
            facts: facts(evaluation),
            means: ranges.table(),
            albedo_scale: evaluation.albedo_scale.map(|scale| scale.map(|factor| format!("{factor:.3}")).join(", ")),
            light: evaluation.light.as_ref().map(LightSection::new),
            relit: (!evaluation.relit.is_empty()).then(relit),
            error_max: ERROR_MAX,
            edge_max: EDGE_MAX,
            measures: ranges.measures().map(|index| (index, MEASURES[index].label)).collect(),
            views: shown.map(|index| ViewSection::new(*index, &evaluation.views[*index], &ranges)).collect(),
            hidden: order.len().saturating_sub(VIEWS_MAX),
        }
    }
}

/// Learned light on the page.
struct LightSection {
    measures: HtmlTable,
    /// Path of the picture of both lights, if there is one.
    picture: Option<&'static str>,
}

impl LightSection {
    fn new(light: &EvaluatedLight) -> Self {
        let [width, height] = COMMON_SIZE;
        let common = format!("correlation at {width} × {height}");
        let heads = [common.as_str(), "texel by texel", "scale", "scale of red, green, blue"];
        Self {
            measures: HtmlTable::new(heads, [light.quality.cells()]),
            picture: light.picture.as_ref().map(|_| LIGHT_PICTURE),
        }
    }
}

/// Conditions of an evaluation as text.
fn facts(evaluation: &Evaluation) -> String {
    let network = evaluation.lpips_network.as_deref().map_or(String::new(), |network| format!(" LPIPS by {network}."));
    let method = evaluation.method.as_deref().map_or(String::new(), settings);
    let sizes = || evaluation.views.iter().map(|view| view.size);
    let area = |size: &[u32; 2]| u64::from(size[0]) * u64::from(size[1]);
    let key = |size: &[u32; 2]| (area(size), *size);
    let [width, height] = sizes().min_by_key(key).unwrap_or_default();
    let [width_max, height_max] = sizes().max_by_key(key).unwrap_or_default();
    let sizes = match (width, height) == (width_max, height_max) {
        true => format!("{width} × {height}"),
        false => format!("{width} × {height} to {width_max} × {height_max}"),
    };
    let background = match evaluation.background {
        [0.0, 0.0, 0.0] => "black".to_owned(),
        [1.0, 1.0, 1.0] => "white".to_owned(),
        [r, g, b] => format!("{r},{g},{b}"),
    };
    format!(
        "{method}{} Gaussians, {} {} views of {sizes} pixels, background {background}.{network}",
        group_digits(evaluation.gaussians),
        evaluation.views.len(),
        evaluation.split,
    )
}

/// Key of the results, such as `ours_7000_f16`, as text.
fn settings(method: &str) -> String {
    let mut parts = method.strip_prefix("ours_").unwrap_or(method).split('_');
    let iterations = parts.next().unwrap_or_default();
    let others: String = parts.map(|part| format!("{part}, ")).collect();
    format!("{iterations} iterations, {others}")
}

/// Worst value, mean and best value of each computed measure.
struct Ranges([Option<[f64; 3]>; MEASURES.len()]);

impl Ranges {
    fn of(views: &[EvaluatedView]) -> Self {
        let views: Vec<_> = views.iter().map(|view| view.measures.clone()).collect();
        let mean = means(&views);
        let range_of_measure = |index: usize| {
            let measure = MEASURES[index];
            let better = |one: &f64, other: &f64| {
                measure.goodness(*one).partial_cmp(&measure.goodness(*other)).unwrap_or(Ordering::Equal)
            };
            let values = || views.iter().filter_map(move |view| view.values[index]);
            Some([values().min_by(better)?, mean[index]?, values().max_by(better)?])
        };
        Self(core::array::from_fn(range_of_measure))
    }

    /// Indices of the computed measures.
    fn measures(&self) -> impl Iterator<Item = usize> {
        (0..MEASURES.len()).filter(|index| self.0[*index].is_some())
    }

    fn table(&self) -> HtmlTable {
        let row = |index: usize| {
            let measure = MEASURES[index];
            let [worst, mean, best] = self.0[index]?.map(|value| measure.format(value));
            Some([format!("{} {}", measure.label, measure.unit.trim()), mean, worst, best])
        };
        HtmlTable::new(["", "mean", "worst view", "best view"], (0..MEASURES.len()).filter_map(row))
    }

    /// Position of a value between the worst, 0, and the best, 100.
    fn percent(&self, index: usize, value: f64) -> f64 {
        let Some([worst, _, best]) = self.0[index].filter(|[worst, _, best]| worst != best) else { return 100.0 };
        (100.0 * (value - worst) / (best - worst)).clamp(0.0, 100.0)
    }
}

/// View on the page.
struct ViewSection {
    name: String,
    /// Index of each measure, and the value by which the page's script sorts.
    keys: Vec<(usize, f64)>,
    /// Caption and path of each picture.
    pictures: Vec<(&'static str, String)>,
    bars: Vec<Bar>,
}

/// Value of a measure as a bar.
struct Bar {
    label: &'static str,
    value: String,
    /// Length, and position of the mean, from 0 to 100 with one decimal place.
    percent: String,
    mean_percent: String,
}

impl ViewSection {
    fn new(index: usize, view: &EvaluatedView, ranges: &Ranges) -> Self {
        let values = || ranges.measures().filter_map(|measure| Some((measure, view.measures.values[measure]?)));
        Self {
            name: view.measures.name.clone(),
            keys: values().map(|(measure, value)| (measure, MEASURES[measure].goodness(value))).collect(),
            pictures: KINDS.iter().map(|[kind, caption]| (*caption, picture_path(index, kind))).collect(),
            bars: values().filter_map(|(measure, value)| Bar::new(measure, value, ranges)).collect(),
        }
    }
}

impl Bar {
    fn new(index: usize, value: f64, ranges: &Ranges) -> Option<Self> {
        let [_, mean, _] = ranges.0[index]?;
        let [percent, mean_percent] = [value, mean].map(|value| format!("{:.1}", ranges.percent(index, value)));
        let measure = MEASURES[index];
        Some(Self { label: measure.label, value: measure.format(value), percent, mean_percent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::LightQuality;
    use specula_train::evaluate::ViewQuality;

    fn evaluation(psnrs: &[f64]) -> Evaluation {
        let view = |(index, psnr): (usize, &f64)| {
            let quality = ViewQuality { name: format!("<{index}>"), psnr: *psnr, ssim: 0.9, normal_mae: None };
            EvaluatedView { measures: quality.into(), size: [4, 3], pictures: Some([vec![1], vec![2], vec![3]]) }
        };
        Evaluation {
            scene: "scene".into(),
            method: Some("ours_7".into()),
            split: "test",
            background: [1.0; 3],
            gaussians: 1000,
            lpips_network: None,
            views: psnrs.iter().enumerate().map(view).collect(),
            relit: Vec::new(),
            albedo_scale: None,
            light: None,
        }
    }

    #[test]
    fn a_true_light_has_a_section_with_its_picture_and_others_none() {
        let mut evaluation = evaluation(&[30.0]);
        let text = page(&evaluation).expect("the template is valid").html;
        assert!(!text.contains("light.png") && !text.contains("albedo"), "unknown facts are omitted");
        let quality =
            LightQuality { correlation: Some(0.75), correlation_texels: None, scale: 1.5, scale_rgb: [1.0, 1.5, 2.25] };
        evaluation.light = Some(EvaluatedLight { quality, picture: Some(vec![7]) });
        evaluation.albedo_scale = Some([0.5, 1.0, 2.0]);
        let page = page(&evaluation).expect("the template is valid");
        assert!(page.pictures.contains(&("light.png".to_owned(), &[7][..])));
        for expected in ["src=\"light.png\"", "0.750", "1.000, 1.500, 2.250", "0.500, 1.000, 2.000"] {
            assert!(page.html.contains(expected), "{expected}");
        }
    }

    #[test]
    fn the_worst_view_comes_first_and_bars_grow_with_quality() {
        let views = evaluation(&[30.0, 20.0, 25.0, f64::NAN]).views;
        assert_eq!(worst_first(&views)[..3], [1, 2, 0], "values that are not finite are best or worst, not lost");
        let text = page(&evaluation(&[30.0, 20.0, 25.0])).expect("the template is valid").html;
        let places = ["&#60;1&#62;</h3>", "&#60;2&#62;</h3>", "&#60;0&#62;</h3>"]
            .map(|name| text.find(name).expect("it is shown"));
        assert!(places.is_sorted(), "{places:?}");
        let bars = text.split("<dt>PSNR</dt><dd class=\"bar\"><b style=\"width: ").skip(1);
        let widths: Vec<&str> = bars.map(|rest| rest.split('"').next().unwrap_or_default()).collect();
        assert_eq!(widths, ["0.0%", "50.0%", "100.0%"]);
        assert!(
            !text.contains("http") && !text.contains("FLIP"),
            "nothing from outside, nothing that was not measured"
        );
    }

    #[test]
    fn only_pictures_of_the_page_are_kept() {
        let psnrs: Vec<f64> = (0..VIEWS_MAX + 5).map(|index| 20.0 + index as f64).collect();
        let evaluation = evaluation(&psnrs);
        let page = page(&evaluation).expect("the template is valid");
        let kept: std::collections::BTreeSet<&String> = page.pictures.iter().map(|(path, _)| path).collect();
        assert_eq!(kept.len(), 3 * VIEWS_MAX);
        let text = page.html;
        assert!(text.contains("5 better views are not shown") && text.matches("<article").count() == VIEWS_MAX);
    }
}
