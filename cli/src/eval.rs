//! `specula eval`: how good a model is on views that it was not fitted to.

mod lpips;
mod page;
mod relit;
mod seen;
pub(crate) mod trial;

use crate::{
    args::{Eval, Split},
    background::{Backdrop, Background},
    dataset,
    failure::Failure,
    output,
    place::differences,
    progress,
    quality::{self, FITTED, LPIPS, Measured},
    scene::{self, Renderer, background_of, note_oddities},
};
use relit::Relit;
use seen::Seen;
use serde_json::{Map, Value};
use specula_core::rules::Channels;
use specula_io::{dataset::LoadOptions, model_folder};
use specula_scene::OpenedModel;
use specula_train::{evaluate::fitted_psnr, view::View};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Measures, prints, and writes down what belongs into the model's folder.
pub(crate) fn run(args: &Eval) -> Result<(), Failure> {
    let opened = scene::open(&args.scene, args.profile)?;
    note_oddities(&opened);
    let source = source_of(args, &opened)?;
    let views = views_of(args, &opened, &source)?;
    let background = background_of(&opened, args.background);
    let method = method_of(args, &opened);
    let place = opened.folder.clone().zip(method.clone());
    let sizes = views.iter().map(|view| [view.camera.width, view.camera.height]);
    let largest = sizes.max_by_key(|[width, height]| u64::from(*width) * u64::from(*height)).unwrap_or_default();
    let network = args.lpips.as_deref().map(|path| lpips::Judge::read(path, largest)).transpose()?;
    let folder = page_of(args, place.as_ref());
    if let Some(folder) = &folder {
        output::make_folder(folder)?;
    }

    let mut findings = Findings {
        scene: args.scene.clone(),
        method,
        split: args.split,
        background,
        gaussians: opened.scene.gaussians.count,
        network: network.as_ref().map(|network| network.name.clone()),
        views: Vec::new(),
        relit: Vec::new(),
    };
    let is_relit = args.split == Split::Test && opened.scene.gaussians.layout.is_shaded();
    findings.relit = if is_relit { relit::measure(args, &opened, &source, &views)? } else { Vec::new() };

    let is_exposed = args.exposure || opened.exposures()?.is_some();
    let mut renderer = Renderer::new(opened.scene, Channels::Training, &args.machine)?;
    let work = progress::work("measuring", views.len() as u64);
    let with_pictures = folder.is_some();
    findings.views = renderer.for_each_view(&views, &work, |view, image| {
        let mut seen = Seen::new(view, image, background, with_pictures);
        seen.measured.values[FITTED] = is_exposed.then(|| fitted_psnr(image, view, background.0));
        Ok(seen)
    })?;
    work.finish();
    if let Some(network) = &network {
        let distances = network.measure(&mut renderer, &views, background)?;
        findings.views.iter_mut().zip(distances).for_each(|(view, own)| view.measured.values[LPIPS] = Some(own));
    }
    if let (Some((folder, method)), Split::Test) = (place, args.split) {
        model_folder::add_quality(&folder, &method, &quality::for_files(&findings.measured()), findings.facts())?;
    }
    if let Some(folder) = &folder {
        page::write(folder, &findings)?;
    }
    findings.say(args.json, folder.as_deref())
}

/// Everything that was found.
#[derive(Debug)]
struct Findings {
    scene: PathBuf,
    /// What the results are filed under; none for a PLY file on its own.
    method: Option<String>,
    split: Split,
    background: Background,
    gaussians: usize,
    /// What measured LPIPS.
    network: Option<String>,
    views: Vec<Seen>,
    relit: Vec<Relit>,
}

impl Findings {
    fn measured(&self) -> Vec<Measured> {
        self.views.iter().map(|view| view.measured.clone()).collect()
    }

    /// What else `results.json` says.
    fn facts(&self) -> Map<String, Value> {
        let mut facts = relit::facts(&self.relit);
        facts.extend(self.network.iter().map(|network| ("LPIPS_network".to_owned(), network.as_str().into())));
        facts
    }

    fn say(&self, as_json: bool, page: Option<&Path>) -> Result<(), Failure> {
        let measured = self.measured();
        if as_json {
            let mut report = quality::report(&measured);
            if let Some(network) = &self.network {
                report["LPIPS_network"] = network.as_str().into();
            }
            if !self.relit.is_empty() {
                report["relit"] = self.relit.iter().map(Relit::for_programs).collect::<Vec<Value>>().into();
            }
            return output::say_json(&report);
        }
        let line = quality::line(&quality::means(&measured));
        output::say(&format!("{line}  ({} {} views)", measured.len(), self.split.name()))?;
        self.relit.iter().try_for_each(|relit| output::say(&relit.line()))?;
        page.map_or(Ok(()), |folder| output::say(&format!("Page: {}", page::at(folder).display())))
    }
}

/// What the results are filed under: `ours_N`, and everything in which they are not those of `specula eval MODEL`.
fn method_of(args: &Eval, opened: &OpenedModel) -> Option<String> {
    let mut words = vec![model_folder::method_of(opened.iteration?)];
    let usual = opened.info.as_ref().map_or(1, |info| info.downscale.max(1));
    words.extend(args.resolution.filter(|resolution| *resolution != usual).map(|resolution| format!("r{resolution}")));
    words.extend(differences(opened, &args.machine, args.background.map(Backdrop::Color), args.profile));
    words.extend(args.source_path.as_deref().filter(|source| is_other_source(source, opened)).map(|source| {
        let name = fs::canonicalize(source).unwrap_or_else(|_| source.to_owned());
        format!("of-{}", name.file_name().unwrap_or_default().to_string_lossy())
    }));
    Some(words.join("_"))
}

/// Whether a data set is another than that of the training; one that was moved is the same.
fn is_other_source(source: &Path, opened: &OpenedModel) -> bool {
    let trained_on = opened.info.as_ref().and_then(|info| fs::canonicalize(&info.source_path).ok());
    trained_on.is_some_and(|trained_on| fs::canonicalize(source).is_ok_and(|source| source != trained_on))
}

/// Where the page goes: where it was asked for, else beside the pictures of `specula render`.
fn page_of(args: &Eval, place: Option<&(PathBuf, String)>) -> Option<PathBuf> {
    let usual = || place.map(|(folder, method)| folder.join(args.split.name()).join(method));
    args.output.clone().or_else(usual)
}

fn source_of(args: &Eval, opened: &OpenedModel) -> Result<PathBuf, Failure> {
    let info = opened.info.as_ref();
    let recorded = info.map(|info| PathBuf::from(&info.source_path)).filter(|path| !path.as_os_str().is_empty());
    args.source_path.clone().or(recorded).ok_or_else(|| {
        Failure::Input(format!("{:?} does not say which data set it was trained on; name it with -s", args.scene))
    })
}

fn views_of(args: &Eval, opened: &OpenedModel, source: &Path) -> Result<Vec<View>, Failure> {
    let info = opened.info.as_ref();
    let options = LoadOptions { with_test: true, ..info.map(dataset::options_of).unwrap_or_default() };
    let downscale = args.resolution.unwrap_or(options.downscale);
    let data = dataset::load(source, &LoadOptions { downscale, ..options })?;
    let views: Vec<View> = match args.split {
        Split::Test => data.test,
        Split::Train => data.train,
        Split::All => data.test.into_iter().chain(data.train).collect(),
    };
    if views.is_empty() {
        return Err(Failure::Input(format!("no {} views in {source:?}; use --split train", args.split.name())));
    }
    Ok(views)
}
