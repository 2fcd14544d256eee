//! The page of an evaluation: every view beside its truth and its error, the worst first.

use super::{
    Findings,
    relit::Relit,
    seen::{EDGE, ERROR_SHOWN, Seen},
};
use crate::{
    failure::Failure,
    fit::thousands,
    output,
    page::{STYLE, escaped, html_table},
    quality::{MEASURES, PSNR, Values, means},
};
use core::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Most views whose pictures are kept: those with the least PSNR.
const SHOWN: usize = 200;
/// The folder of the pictures, beside the page.
const PICTURES: &str = "views";
/// Names of a view's pictures.
const KINDS: [&str; 3] = ["truth", "picture", "error"];

const MORE_STYLE: &str = "
article { display: grid; grid-template-columns: repeat(3, 1fr) 15rem; gap: .5rem; margin: 1rem 0; }
article h3 { margin: 0 0 .4rem; font-size: 1rem; overflow-wrap: anywhere; }
article img { width: 100%; background: #eee; image-rendering: auto; }
figure { margin: 0; }
figcaption { font-size: .75rem; color: #666; }
dl { margin: 0; display: grid; grid-template-columns: auto 1fr auto; gap: .15rem .5rem; font-size: .8rem; align-items: center; }
dt, dd { margin: 0; font-variant-numeric: tabular-nums; }
.bar { position: relative; height: .6rem; background: #eee; }
.bar b { position: absolute; inset: 0 auto 0 0; background: #145aa0; }
.bar i { position: absolute; top: -.1rem; bottom: -.1rem; width: 2px; background: #c83c1e; }
button { font: inherit; padding: .1rem .6rem; }
@media (max-width: 50rem) { article { grid-template-columns: repeat(3, 1fr); } article > div { grid-column: 1 / -1; } }";

/// Puts the views in the order of a measure, its worst first.
const SCRIPT: &str = "\
for (const button of document.querySelectorAll('button')) button.onclick = () => {
  const worst = view => view.dataset[button.dataset.by] === undefined ? Infinity : +view.dataset[button.dataset.by];
  const views = [...document.querySelectorAll('article')];
  views.sort((one, other) => worst(one) - worst(other)).forEach(view => view.parentNode.append(view));
};";

/// The page in a folder.
pub(super) fn at(folder: &Path) -> PathBuf {
    folder.join("index.html")
}

/// Writes the page, which asks for nothing from outside its folder, and the pictures of the worst views.
pub(super) fn write(folder: &Path, findings: &Findings) -> Result<(), Failure> {
    let order = worst_first(&findings.views);
    for index in order.iter().take(SHOWN) {
        let pictures = findings.views[*index].pictures.iter().flatten();
        for (kind, bytes) in KINDS.iter().zip(pictures) {
            output::write_bytes(&folder.join(picture_at(*index, kind)), bytes)?;
        }
    }
    output::write_text(&at(folder), &page(findings, &order))
}

/// Where a picture lies, from the page.
fn picture_at(index: usize, kind: &str) -> String {
    format!("{PICTURES}/{index:05}-{kind}.jpg")
}

/// Views in the order of their PSNR.
fn worst_first(views: &[Seen]) -> Vec<usize> {
    let psnr = |index: &usize| views[*index].measured.values[PSNR].unwrap_or(f64::NEG_INFINITY);
    let mut order: Vec<usize> = (0..views.len()).collect();
    order.sort_by(|one, other| psnr(one).total_cmp(&psnr(other)).then(one.cmp(other)));
    order
}

fn page(findings: &Findings, order: &[usize]) -> String {
    let scene = escaped(&findings.scene.display().to_string());
    let facts = facts(findings);
    let ranges = Ranges::of(&findings.views);
    let means = html_table(&ranges.rows());
    let relit = relit_section(&findings.relit);
    let buttons: String = ranges.measures().map(button).collect();
    let shown = order.iter().take(SHOWN);
    let views: String = shown.map(|index| article(*index, &findings.views[*index], &ranges)).collect();
    let left_out = match order.len().saturating_sub(SHOWN) {
        0 => String::new(),
        count => format!("<p>{count} better views are not shown here.</p>\n"),
    };
    format!(
        "<!doctype html>
<html lang=\"en\">
<meta charset=\"utf-8\">
<meta name=\"viewport\" content=\"width=device-width\">
<title>specula: {scene}, view by view</title>
<style>
{STYLE}{MORE_STYLE}
</style>
<h1>View by view</h1>
<p>{scene}: {facts}</p>
{means}
{relit}<h2>The worst first</h2>
<p>Truth, picture, error. Errors are means over red, green and blue: black is none, pale yellow {ERROR_SHOWN} of the range
or more. Pictures are shown with {EDGE} pixels along the longer edge at most; what is not known of a view is black. Bars
run from the worst view to the best, the red line is the mean.</p>
<p>Worst in {buttons}</p>
<main>
{views}</main>
{left_out}<script>
{SCRIPT}
</script>
</html>
"
    )
}

/// What was measured, in a few words.
fn facts(findings: &Findings) -> String {
    let network =
        findings.network.as_deref().map_or(String::new(), |network| format!(" LPIPS by {}.", escaped(network)));
    let method = findings.method.as_deref().map_or(String::new(), |method| format!("{} of ", escaped(method)));
    let [least, most] = [Iterator::min, Iterator::max].map(|pick: fn(_) -> _| pick(findings.views.iter().map(area)));
    let size = |found: Option<(u64, [u32; 2])>| found.map_or([0; 2], |(_, size)| size);
    let [[width, height], [wide, high]] = [size(least), size(most)];
    let sizes = match (width, height) == (wide, high) {
        true => format!("{width} × {height}"),
        false => format!("{width} × {height} to {wide} × {high}"),
    };
    format!(
        "{method}{} Gaussians on {} {} views of {sizes} pixels, over a background of {}.{network}",
        thousands(findings.gaussians),
        findings.views.len(),
        findings.split.name(),
        findings.background
    )
}

fn area(view: &Seen) -> (u64, [u32; 2]) {
    let [width, height] = view.size;
    (u64::from(width) * u64::from(height), view.size)
}

fn relit_section(relit: &[Relit]) -> String {
    if relit.is_empty() {
        return String::new();
    }
    let heads = ["light", "PSNR dB", "scaled", "factors of red, green, blue", "views"].map(str::to_owned);
    let table = html_table(&core::iter::once(heads).chain(relit.iter().map(Relit::cells)).collect::<Vec<_>>());
    format!(
        "<h2>Under other lights</h2>
<p>Against true pictures under them, as they are and with the best factor for each of red, green and blue: how bright the
light was and how much a surface reflects cannot be told apart.</p>
{table}
"
    )
}

fn button(measure: usize) -> String {
    let words = MEASURES[measure].words;
    format!("<button data-by=\"m{measure}\">{words}</button>\n")
}

/// Worst, mean and best of each measure that was taken.
struct Ranges([Option<[f64; 3]>; MEASURES.len()]);

impl Ranges {
    fn of(views: &[Seen]) -> Self {
        let all: Vec<_> = views.iter().map(|view| view.measured.clone()).collect();
        let mean = means(&all);
        let of_measure = |index: usize| {
            let better = |one: &f64, other: &f64| {
                let measure = MEASURES[index];
                measure.goodness(*one).partial_cmp(&measure.goodness(*other)).unwrap_or(Ordering::Equal)
            };
            let values = || all.iter().filter_map(move |view| view.values[index]);
            Some([values().min_by(better)?, mean[index]?, values().max_by(better)?])
        };
        Self(core::array::from_fn(of_measure))
    }

    /// Places of the measures that were taken.
    fn measures(&self) -> impl Iterator<Item = usize> {
        (0..MEASURES.len()).filter(|index| self.0[*index].is_some())
    }

    /// A table of them, heads first.
    fn rows(&self) -> Vec<[String; 4]> {
        let heads = ["", "mean", "worst view", "best view"].map(str::to_owned);
        let row = |index: usize| {
            let measure = MEASURES[index];
            let [worst, mean, best] = self.0[index].expect("it was taken").map(|value| measure.number(value));
            [format!("{} {}", measure.words, measure.unit.trim()), mean, worst, best]
        };
        core::iter::once(heads).chain(self.measures().map(row)).collect()
    }

    /// Where a value lies from the worst, 0, to the best, 100.
    fn percent(&self, index: usize, value: f64) -> f64 {
        let Some([worst, _, best]) = self.0[index].filter(|[worst, _, best]| worst != best) else { return 100.0 };
        (100.0 * (value - worst) / (best - worst)).clamp(0.0, 100.0)
    }
}

fn article(index: usize, view: &Seen, ranges: &Ranges) -> String {
    let name = escaped(&view.measured.name);
    let keys: String = ranges.measures().filter_map(|measure| key(measure, &view.measured.values)).collect();
    let figures: String = KINDS
        .iter()
        .map(|kind| {
            let place = picture_at(index, kind);
            format!("<figure><img loading=\"lazy\" src=\"{place}\" alt=\"{kind} of {name}\"></figure>\n")
        })
        .collect();
    let bars: String = ranges.measures().filter_map(|measure| bar(measure, &view.measured.values, ranges)).collect();
    format!("<article{keys}>\n{figures}<div><h3>{name}</h3>\n<dl>\n{bars}</dl></div>\n</article>\n")
}

/// By what the page's script sorts.
fn key(measure: usize, values: &Values) -> Option<String> {
    Some(format!(" data-m{measure}=\"{}\"", MEASURES[measure].goodness(values[measure]?)))
}

fn bar(index: usize, values: &Values, ranges: &Ranges) -> Option<String> {
    let (measure, value) = (MEASURES[index], values[index]?);
    let [_, mean, _] = ranges.0[index]?;
    let [here, middle] = [value, mean].map(|value| ranges.percent(index, value));
    Some(format!(
        "<dt>{}</dt><dd class=\"bar\"><b style=\"width: {here:.1}%\"></b><i style=\"left: {middle:.1}%\"></i></dd><dd>{}</dd>\n",
        measure.words,
        measure.number(value)
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{args::Split, background::Background};
    use specula_train::evaluate::ViewQuality;

    fn findings(psnrs: &[f64]) -> Findings {
        let seen = |(index, psnr): (usize, &f64)| {
            let quality = ViewQuality { name: format!("<{index}>"), psnr: *psnr, ssim: 0.9, normal_mae: None };
            Seen { measured: quality.into(), size: [4, 3], pictures: Some([vec![1], vec![2], vec![3]]) }
        };
        Findings {
            scene: "scene".into(),
            method: Some("ours_7".into()),
            split: Split::Test,
            background: Background::WHITE,
            gaussians: 1000,
            network: None,
            views: psnrs.iter().enumerate().map(seen).collect(),
            relit: Vec::new(),
        }
    }

    #[test]
    fn the_worst_view_comes_first_and_bars_grow_with_quality() {
        let findings = findings(&[30.0, 20.0, 25.0, f64::NAN]);
        assert_eq!(worst_first(&findings.views)[..3], [1, 2, 0], "what is no number is best or worst, not lost");
        let findings = self::findings(&[30.0, 20.0, 25.0]);
        let text = page(&findings, &worst_first(&findings.views));
        let places =
            ["&lt;1&gt;</h3>", "&lt;2&gt;</h3>", "&lt;0&gt;</h3>"].map(|name| text.find(name).expect("it is shown"));
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
    fn no_more_pictures_are_kept_than_a_page_shows() {
        let folder = tempfile::tempdir().expect("there is room");
        let psnrs: Vec<f64> = (0..SHOWN + 5).map(|index| 20.0 + index as f64).collect();
        write(folder.path(), &findings(&psnrs)).expect("there is room");
        let kept = std::fs::read_dir(folder.path().join(PICTURES)).expect("it was made").count();
        assert_eq!(kept, 3 * SHOWN);
        let text = std::fs::read_to_string(at(folder.path())).expect("it was written");
        assert!(text.contains("5 better views are not shown") && text.matches("<article").count() == SHOWN);
    }
}
