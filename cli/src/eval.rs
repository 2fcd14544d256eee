//! `specula eval`: how good a model is on views that it was not fitted to.

use crate::{
    args::{Eval, Split},
    dataset,
    failure::Failure,
    output,
    progress::Talk,
    quality,
    scene::{Opened, Renderer},
};
use specula_core::plan::Channels;
use specula_io::{dataset::LoadOptions, model_folder};
use specula_train::{evaluate::mean_quality, view::View};
use std::path::PathBuf;

/// Measures, prints, and writes down what belongs into the model's folder.
pub(crate) fn run(args: &Eval, talk: Talk) -> Result<(), Failure> {
    let opened = Opened::open(&args.scene, args.profile)?;
    let views = views_of(args, &opened, talk)?;
    let background = opened.background(args.background);
    let place = opened.folder.clone().zip(opened.iteration);

    let mut renderer = Renderer::new(opened.scene, Channels::Training, &args.machine, talk)?;
    let work = talk.work("measuring", views.len() as u64);
    let measured = renderer.measure(&views, background, &work)?;
    work.finish();
    if let (Some((folder, iteration)), Split::Test) = (place, args.split) {
        model_folder::save_quality(&folder, iteration, &quality::for_files(&measured))?;
    }
    if args.json {
        return output::say_json(&quality::report(&measured));
    }
    output::say(&format!("{}  ({} {} views)", quality::line(&mean_quality(&measured)), views.len(), args.split.name()))
}

fn views_of(args: &Eval, opened: &Opened, talk: Talk) -> Result<Vec<View>, Failure> {
    let info = opened.info.as_ref();
    let recorded = info.map(|info| PathBuf::from(&info.source_path)).filter(|path| !path.as_os_str().is_empty());
    let source = args.source_path.clone().or(recorded).ok_or_else(|| {
        Failure::Input(format!("{:?} does not say which data set it was trained on; name it with -s", args.scene))
    })?;
    let options = LoadOptions { with_test: true, ..info.map(dataset::options_of).unwrap_or_default() };
    let downscale = args.resolution.unwrap_or(options.downscale);
    let data = dataset::load(&source, &LoadOptions { downscale, ..options }, talk)?;
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
