//! How close a model comes to the truth under other lights, where a data set has pictures under them.

use crate::{
    args::{EnvOptions, EnvUp, Eval},
    failure::Failure,
    orientation,
    output::stem,
    progress,
    scene::{Renderer, background_of, relight},
    truth::{Relighting, Truths, fit_and_measure},
};
use glam::Vec3;
use serde_json::{Map, Value};
use specula_core::rules::Channels;
use specula_io::cameras::NamedCamera;
use specula_scene::OpenedModel;
use specula_train::view::View;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Where lights and, in a folder with the name of each, true pictures under them may lie within a data set.
const PLACES: [[&str; 2]; 2] = [["relight", "relight"], ["light", "relit"]];

/// A scene under another light.
#[derive(Debug)]
pub(super) struct Relit {
    light: String,
    views: usize,
    measured: Relighting,
}

impl Relit {
    /// One line for people.
    pub(super) fn line(&self) -> String {
        let Self { light, views, measured } = self;
        format!("under {light}: {measured}  ({views} views)")
    }

    /// What a table shows: the light, PSNR as it is and scaled, factors, views.
    pub(super) fn cells(&self) -> [String; 5] {
        let Self { light, views, measured: Relighting { psnr, psnr_scaled, scale } } = self;
        let factors = scale.map(|factor| format!("{factor:.3}")).join(", ");
        [light.clone(), format!("{psnr:.2}"), format!("{psnr_scaled:.2}"), factors, views.to_string()]
    }

    /// The same for other programs.
    pub(super) fn for_programs(&self) -> Value {
        let mut facts = self.measured.for_programs(self.views);
        facts["light"] = self.light.as_str().into();
        facts
    }
}

/// Means over all lights, for `results.json`.
pub(super) fn facts(relit: &[Relit]) -> Map<String, Value> {
    let mean = |of: fn(&Relighting) -> f64| {
        relit.iter().map(|relit| of(&relit.measured)).sum::<f64>() / relit.len().max(1) as f64
    };
    let means = [("relit_PSNR", mean(|own| own.psnr)), ("relit_PSNR_scaled", mean(|own| own.psnr_scaled))];
    let named = means.into_iter().filter(|_| !relit.is_empty());
    named.map(|(name, mean)| (name.to_owned(), mean.into())).collect()
}

/// Measures a scene under every light of its data set under which true pictures of these views are known.
pub(super) fn measure(args: &Eval, opened: &OpenedModel, source: &Path, views: &[View]) -> Result<Vec<Relit>, Failure> {
    let cameras: Vec<NamedCamera> = views.iter().map(|view| (view.name.clone(), view.camera)).collect();
    let background = background_of(opened, args.background);
    let found = orientation::found(opened.info.as_ref(), cameras.iter().map(|(_, camera)| camera));
    let above = found.map_or(Vec3::Z, |found| orientation::up(&found));
    let measured = |(light, folder): (PathBuf, PathBuf)| {
        let truths = Truths::read(&folder, &cameras)?;
        let mut scene = opened.scene.clone();
        relight(&mut scene, &light, &EnvOptions { env_up: EnvUp::Scene, exposure: 0.0 }, above)?;
        let mut renderer = Renderer::new(scene, Channels::Color, &args.machine)?;
        let work = progress::work("relighting", views.len() as u64);
        let mut pairs = Vec::new();
        for (index, (_, camera)) in cameras.iter().enumerate().filter(|(index, _)| truths.has(*index)) {
            pairs.extend(truths.pair(index, &renderer.view(camera)?));
            work.done(index as u64 + 1, String::new);
        }
        work.finish();
        let light = stem(&light);
        Ok(Relit { light, views: pairs.len(), measured: fit_and_measure(&pairs, background) })
    };
    lights_of(source).into_iter().map(measured).collect()
}

/// Lights of a data set, by name, each with the folder of its pictures.
fn lights_of(source: &Path) -> Vec<(PathBuf, PathBuf)> {
    let of_place = |[lights, pictures]: [&str; 2]| {
        let entries = fs::read_dir(source.join(lights)).into_iter().flatten().flatten();
        let files = entries.map(|entry| entry.path());
        let is_light = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "hdr" || ending == "exr");
        let with_folder = move |path: PathBuf| {
            let folder = source.join(pictures).join(path.file_stem()?);
            folder.is_dir().then_some((path, folder))
        };
        files.filter(is_light).filter_map(with_folder).collect::<Vec<_>>()
    };
    let mut all: Vec<(PathBuf, PathBuf)> = PLACES.into_iter().flat_map(of_place).collect();
    all.sort();
    all
}
