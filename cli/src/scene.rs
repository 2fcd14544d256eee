//! A scene as it is looked at: opened, ready to be rendered, measured and saved.

use crate::{
    args::{EnvOptions, MachineOptions, ProfileName},
    background::Background,
    convention::{self, Reading},
    failure::Failure,
    machine::{self, Machine, OWN_LIGHT},
    progress::{Talk, Work},
    quality::{FITTED, Measured},
    relay::relay,
};
use glam::Vec3;
use specula_accuracy::{setting::Setting, subject::Subject};
use specula_core::{
    camera::Camera,
    census::{Census, Fate},
    executor::RenderRules,
    pack::Storage,
    plan::{Channels, Needs, Plan},
    prefilter::{Levels, PrefilterScheme},
    scene::{Environment, Gaussians, Image, RadianceActivation},
};
use specula_cpu::order::sort_in_space;
use specula_io::{
    exposure::{self, Exposures},
    latlong,
    model_folder::{self, Model, ModelInfo, Snapshot},
};
use specula_train::{
    evaluate::{fitted_psnr, measure_view, rules_to_measure},
    trainer::HostScene,
    view::View,
};
use std::path::{Path, PathBuf};

/// Least and usual resolution of a light that is put into a scene.
const LIGHT_RESOLUTION: [usize; 2] = [64, 128];
/// From this resolution on one has to wait for the prefilter.
pub(crate) const SLOW_RESOLUTION: usize = 256;

/// Gaussians, their light, and how both are read.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) gaussians: Gaussians<Vec<f32>>,
    pub(crate) light: Option<Environment<Vec<f32>>>,
    pub(crate) reading: Reading,
}

/// A scene from a file, and what is known about it.
#[derive(Debug)]
pub(crate) struct Opened {
    pub(crate) scene: Scene,
    /// The model's folder; none for a PLY file on its own.
    pub(crate) folder: Option<PathBuf>,
    pub(crate) iteration: Option<u32>,
    pub(crate) info: Option<ModelInfo>,
    /// Whether its light was replaced in the authors' way.
    is_relit: bool,
    /// Whether its attributes are read as the model itself says.
    pub(crate) is_read_as_it_says: bool,
}

impl Opened {
    /// Opens the folder of a model, or a PLY file.
    pub(crate) fn open(path: &Path, profile: Option<ProfileName>) -> Result<Self, Failure> {
        let model = model_folder::open(path)?;
        let folder = folder_of(path, &model);
        let reading = Reading::chosen(&model, profile)?;
        let is_read_as_it_says = reading == Reading::of_model(&model);
        let mut gaussians = model.gaussians;
        convention::from_file(&mut gaussians, reading.shading);
        sort_in_space(&mut gaussians);
        let scene = Scene { gaussians, light: model.light, reading };
        Ok(Self {
            scene,
            folder,
            iteration: model.iteration,
            info: model.info,
            is_relit: model.is_relit,
            is_read_as_it_says,
        })
    }

    /// Says what pictures of it have or lack that nobody may expect.
    pub(crate) fn note_oddities(&self, talk: Talk) {
        if self.is_relit {
            talk.note("brdf_mlp.hdr is not the light that was saved with the model, so the scene is shown under it");
        }
        self.scene.note_left_out(talk);
    }

    /// How many views of the model were held out, if it says so; they are the first of its cameras.
    pub(crate) fn test_views(&self) -> Option<usize> {
        let count = self.info.as_ref()?.rest.get("test_views")?.as_u64()?;
        Some(count as usize)
    }

    /// How the photographs of its training were exposed, if that was learned.
    pub(crate) fn exposures(&self) -> Result<Option<Exposures>, Failure> {
        Ok(self.folder.as_deref().map_or(Ok(None), exposure::read)?)
    }

    /// Behind the scene: what was asked for, else that of the training, else black.
    pub(crate) fn background(&self, asked: Option<Background>) -> Background {
        asked.or(self.info.as_ref().map(Background::of_model)).unwrap_or(Background::BLACK)
    }
}

/// How many Gaussians are not finite, and in what; none if there are none.
pub(crate) fn nonfinite_words(census: &Census) -> Option<String> {
    let reasons = Fate::ALL.into_iter().filter(|fate| fate.is_nonfinite() && census.count(*fate) > 0);
    let reasons: Vec<String> = reasons.map(|fate| format!("{} by {}", census.count(fate), fate.words())).collect();
    (!reasons.is_empty()).then(|| reasons.join(", "))
}

/// The folder of the model that a PLY file belongs to, if `io` found one around it.
fn folder_of(path: &Path, model: &Model) -> Option<PathBuf> {
    if path.is_dir() {
        return Some(path.to_owned());
    }
    model.iteration.and_then(|_| Some(path.canonicalize().ok()?.ancestors().nth(3)?.to_owned()))
}

impl Scene {
    /// What a training came to.
    pub(crate) fn of_training(host: HostScene, reading: Reading) -> Self {
        Self { gaussians: host.gaussians, light: host.environment, reading }
    }

    /// Says how many Gaussians are left out of every picture because a number of theirs is not finite, if any are.
    fn note_left_out(&self, talk: Talk) {
        if let Some(words) = nonfinite_words(&Census::of(&self.gaussians, None)) {
            talk.note(&format!("Gaussians with numbers that are not finite are not drawn: {words}"));
        }
    }

    /// How pictures with these channels are rendered.
    pub(crate) fn plan(&self, channels: Channels) -> Plan {
        let needs = Needs::of(&self.gaussians).under(self.light.as_ref());
        self.reading.plan(self.gaussians.layout, &needs, self.levels().as_ref(), channels)
    }

    /// The same with the numbers of its Gaussians as they are stored, so that the plan looks at what is rendered.
    pub(crate) fn rounded(mut self, storage: Storage) -> Self {
        storage.round(&mut self.gaussians);
        self
    }

    /// The levels that the light is filtered into, if there is one and it can be looked up.
    pub(crate) fn levels(&self) -> Option<Levels> {
        let light = self.light.as_ref().filter(|_| self.gaussians.layout.is_shaded())?;
        Some(levels_of(light, self.reading.scheme))
    }

    /// The scene as it is looked at from some cameras, over a background.
    pub(crate) fn into_subject(self, cameras: Vec<Camera>, background: [f32; 3]) -> Subject {
        let Self { gaussians, light, reading: Reading { shading, scheme } } = self;
        let light = light.filter(|_| gaussians.layout.is_shaded()).map(|light| fitting(&light, scheme));
        Subject { gaussians, light, shading, scheme, cameras, background }
    }

    /// Puts in another light. `above` is what the scene has above.
    pub(crate) fn relight(
        &mut self,
        path: &Path,
        options: &EnvOptions,
        above: Vec3,
        talk: Talk,
    ) -> Result<latlong::LatLong, Failure> {
        self.refuse_plain()?;
        let map = read_env(path, options.exposure, talk)?;
        let resolution = self.resolution_of_others();
        let values = latlong::to_cube(&map, resolution, options.env_up.stand(above));
        self.light = Some(Environment { resolution, activation: RadianceActivation::Identity, values });
        Ok(map)
    }

    /// A scene that has nothing to do with light cannot be put under another.
    pub(crate) fn refuse_plain(&self) -> Result<(), Failure> {
        if self.gaussians.layout.is_shaded() {
            return Ok(());
        }
        Err(Failure::Input(
            "the scene is plain Gaussian splatting, whose colours hold their light for ever; train it with --profile \
             specula to put it under another light"
                .into(),
        ))
    }

    /// The resolution of lights that are put into the scene.
    pub(crate) fn resolution_of_others(&self) -> usize {
        let [least, usual] = LIGHT_RESOLUTION;
        self.light.as_ref().map_or(usual, |light| light.resolution.max(least))
    }

    /// Writes the scene into the folder of a model.
    pub(crate) fn save(&self, folder: &Path, iteration: u32, info: &ModelInfo) -> Result<(), Failure> {
        let mut gaussians = self.gaussians.clone();
        convention::to_file(&mut gaussians, self.reading.shading);
        let comments = if gaussians.layout.is_shaded() { vec![self.reading.comment()] } else { Vec::new() };
        let snapshot = Snapshot { gaussians: &gaussians, comments: &comments, light: self.light.as_ref(), info };
        Ok(model_folder::save(folder, iteration, &snapshot)?)
    }
}

/// A scene where it is rendered, and how.
#[derive(Debug)]
pub(crate) struct Renderer {
    machine: Box<dyn Machine>,
    rules: RenderRules,
}

impl Renderer {
    /// Renders with nothing but what these channels need.
    pub(crate) fn new(scene: Scene, channels: Channels, options: &MachineOptions, talk: Talk) -> Result<Self, Failure> {
        let scene = scene.rounded(options.storage());
        let Plan { rules, .. } = scene.plan(channels);
        Self::with_rules(scene, rules, options, talk)
    }

    /// Renders the same with nothing left out.
    pub(crate) fn in_full(
        scene: Scene,
        channels: Channels,
        options: &MachineOptions,
        talk: Talk,
    ) -> Result<Self, Failure> {
        let scene = scene.rounded(options.storage());
        let Plan { full, .. } = scene.plan(channels);
        Self::with_rules(scene, full, options, talk)
    }

    /// Renders on the processor as a setting says; the scene's light and reading are those of the setting already.
    pub(crate) fn within(scene: Scene, setting: &Setting, channels: Channels) -> Result<Self, Failure> {
        let scene = scene.rounded(setting.storage);
        let Plan { rules, .. } = scene.plan(channels);
        let rules = RenderRules { sh_degree: rules.sh_degree.min(setting.sh_degree), ..rules };
        let light = scene.light.clone().filter(|_| rules.is_lit && scene.gaussians.layout.is_shaded());
        Ok(Self { machine: machine::load_within(scene, light, &rules, setting.limits, setting.storage)?, rules })
    }

    /// Filters the light, if it is looked up.
    fn with_rules(scene: Scene, rules: RenderRules, options: &MachineOptions, talk: Talk) -> Result<Self, Failure> {
        let light = scene.light.as_ref().filter(|_| rules.is_lit && scene.gaussians.layout.is_shaded());
        let light = light.map(|light| fitting(light, rules.scheme));
        if let Some(Environment { resolution: resolution @ SLOW_RESOLUTION.., .. }) = light {
            talk.note(&format!(
                "filtering a light of six times {resolution} × {resolution} texels; this takes a while"
            ));
        }
        Ok(Self { machine: machine::load(options, scene, light, &rules, talk)?, rules })
    }

    /// A view: the channels, then transmittance.
    pub(crate) fn view(&mut self, camera: &Camera) -> Result<Image<Vec<f32>>, Failure> {
        self.machine.view(OWN_LIGHT, camera, &self.rules)
    }

    /// Measures every view, and once more after the exposure that fits it best, where `is_exposed`.
    pub(crate) fn measure(
        &mut self,
        views: &[View],
        background: Background,
        is_exposed: bool,
        work: &Work,
    ) -> Result<Vec<Measured>, Failure> {
        self.for_each_view(views, work, |view, image| {
            let mut measured: Measured = measure_view(image, view, background.0).into();
            measured.values[FITTED] = is_exposed.then(|| fitted_psnr(image, view, background.0));
            Ok(measured)
        })
    }

    /// What is made of every view and its picture, which has normals where the view has true ones.
    pub(crate) fn for_each_view<T: Send>(
        &mut self,
        views: &[View],
        work: &Work,
        make: impl Fn(&View, &Image<Vec<f32>>) -> Result<T, Failure> + Sync,
    ) -> Result<Vec<T>, Failure> {
        let rules = self.rules;
        relay(
            views.len(),
            work,
            |index| self.machine.view(OWN_LIGHT, &views[index].camera, &rules_to_measure(&views[index], &rules)),
            |index, image| make(&views[index], &image),
        )
    }
}

/// A lat-long map from a file, times two to the power of the exposure. What is no radiance in it is replaced, and told.
pub(crate) fn read_env(path: &Path, exposure: f32, talk: Talk) -> Result<latlong::LatLong, Failure> {
    let (mut map, cleaned) = latlong::read(path)?;
    if cleaned.total() > 0 {
        talk.note(&format!(
            "{} numbers in {path:?} are no radiance and were replaced: {} NaN, {} infinite, {} negative",
            cleaned.total(),
            cleaned.nan,
            cleaned.infinite,
            cleaned.negative
        ));
    }
    note_doubts(path, &map, talk)?;
    map.rgb.iter_mut().for_each(|radiance| *radiance *= exposure.exp2());
    Ok(map)
}

/// Says why a picture may be no light, where it is read as one.
fn note_doubts(path: &Path, map: &latlong::LatLong, talk: Talk) -> Result<(), Failure> {
    if !latlong::holds_radiance(path)? {
        talk.note(&format!(
            "{path:?} holds no radiance above 1, so no lamp or sun in it is brighter than white; .hdr and .exr do"
        ));
    }
    if map.width != 2 * map.height {
        talk.note(&format!(
            "{path:?} has {} × {} pixels, and is stretched to 2:1, as a lat-long map is; is it one?",
            map.width, map.height
        ));
    }
    Ok(())
}

/// Radiance of a light, whatever its numbers are.
pub(crate) fn radiance(activation: RadianceActivation, values: &[f32]) -> Vec<f32> {
    match activation {
        RadianceActivation::Identity => values.to_vec(),
        RadianceActivation::Exponential => values.iter().map(|number| number.exp()).collect(),
    }
}

/// The levels that a light is filtered into.
pub(crate) fn levels_of(light: &Environment<Vec<f32>>, scheme: PrefilterScheme) -> Levels {
    Levels::new(scheme, fitting_resolution(light.resolution, scheme))
}

/// The least resolution that the prefilter takes and that holds a light of this one.
fn fitting_resolution(resolution: usize, scheme: PrefilterScheme) -> usize {
    resolution.next_power_of_two().max(scheme.resolution_min())
}

/// A light whose resolution the prefilter takes: other tools also write resolutions that are no power of two.
pub(crate) fn fitting(light: &Environment<Vec<f32>>, scheme: PrefilterScheme) -> Environment<Vec<f32>> {
    resampled(light, fitting_resolution(light.resolution, scheme))
}

/// The same light with another resolution.
pub(crate) fn resampled(light: &Environment<Vec<f32>>, resolution: usize) -> Environment<Vec<f32>> {
    if resolution == light.resolution {
        return light.clone();
    }
    let (width, height) = (4 * resolution, 2 * resolution);
    let map = latlong::from_cube(&light.values, light.resolution, width, height, latlong::UpAxis::Z);
    Environment { resolution, values: latlong::to_cube(&map, resolution, latlong::UpAxis::Z), ..*light }
}
