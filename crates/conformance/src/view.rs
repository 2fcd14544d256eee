//! Scenes with a view, their pictures on an executor, and the same in `f64`.

use crate::{report::said, strategies::under_turned_light};
pub use specula_core::pack::Storage;
use specula_core::{
    camera::Camera,
    cutoffs::Cutoffs,
    double::Double,
    executor::{Feature, Occluder, Renderer},
    lamps::Lamp,
    near_field::NearField,
    pipeline,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, Layout, RadianceActivation},
    vector::vec3,
};
use specula_oracle::{
    Lamps, Light, Operator, lift_environment, lift_gaussians,
    number::Number,
    prefilter, render_occluded,
    scenes::{camera, random_cloud, random_environment},
};
use std::{
    collections::HashMap,
    sync::{Arc, LazyLock, Mutex, PoisonError},
};

/// Texels along an edge of a light's face.
pub const RESOLUTION: usize = 16;
/// The same of the authors' filter, which needs more levels.
const OFFICIAL_RESOLUTION: usize = 64;
/// Shadow rays to each lamp.
const RAYS: usize = 4;

/// Scene with a view of it.
#[derive(Clone, Debug)]
pub struct View {
    /// The Gaussians.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Light, if there is one.
    pub environment: Option<Environment<Vec<f32>>>,
    /// Near field of the light.
    pub near_field: Option<NearField<Vec<f32>>>,
    /// Lamps, whose shadows the near field casts.
    pub lamps: Vec<Lamp>,
    /// Depths of surfaces of another renderer, if there are any.
    pub occlusion: Option<Vec<f32>>,
    /// The camera.
    pub camera: Camera,
    /// The rules.
    pub rules: RenderRules,
}

impl View {
    /// Random scene of a layout, under a random light if the layout is shaded; with every third
    /// seed the light is turned against the world.
    pub fn new(count: usize, layout: Layout, rules: RenderRules, seed: u64) -> Self {
        let (activation, resolution) = match rules.scheme {
            PrefilterScheme::Exact => (RadianceActivation::Exponential, RESOLUTION),
            PrefilterScheme::Official => (RadianceActivation::Identity, OFFICIAL_RESOLUTION),
        };
        let still = camera(70, 45);
        Self {
            gaussians: random_cloud(count, layout, seed),
            environment: layout.is_shaded().then(|| random_environment(resolution, activation, seed)),
            near_field: None,
            lamps: Vec::new(),
            occlusion: None,
            camera: if seed.is_multiple_of(3) { under_turned_light(still) } else { still },
            rules,
        }
    }

    /// Numbers of a picture: its channels, and its transmittance.
    pub fn len(&self) -> usize {
        (self.rules.blended(self.gaussians.layout).count() + 1) * self.pixels()
    }

    /// Returns whether a picture has no pixels.
    pub fn is_empty(&self) -> bool {
        self.pixels() == 0
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> usize {
        (self.camera.width * self.camera.height) as usize
    }

    /// Light on an executor, filtered, with its near field and its lamps.
    ///
    /// # Errors
    ///
    /// The error of the executor.
    pub fn light<E: Renderer>(&self, exec: &mut E) -> Result<Option<E::Light>, E::Error> {
        let Some(environment) = &self.environment else { return Ok(None) };
        let environment = environment.with_values(exec.upload(&environment.values)?);
        let mut light = exec.prefilter(&environment, self.rules.scheme, self.rules.levels)?;
        let near_field = self.near_field.as_ref();
        let near_field = near_field.map(|near_field| near_field.with_values(near_field.values.as_slice()));
        let near_field = near_field.map(|near_field| exec.upload_near_field(&near_field)).transpose()?;
        if let Some(near_field) = &near_field {
            light = exec.surround(light, near_field)?;
        }
        if !self.lamps.is_empty() {
            let occluder = near_field.as_ref().map(|surface| Occluder { surface, reflected: &[] });
            light = exec.add_lamps(light, &self.lamps, RAYS, occluder)?;
        }
        Ok(Some(light))
    }

    /// Frame of an executor.
    ///
    /// # Errors
    ///
    /// The error of the executor.
    pub fn frame<E: Renderer>(&self, exec: &mut E) -> Result<E::Frame, E::Error> {
        let light = self.light(exec)?;
        self.frame_under(exec, light.as_ref())
    }

    fn frame_under<E: Renderer>(&self, exec: &mut E, light: Option<&E::Light>) -> Result<E::Frame, E::Error> {
        let gaussians = exec.upload_gaussians(&self.gaussians)?;
        let Self { camera, rules, .. } = self;
        match &self.occlusion {
            None => pipeline::render(exec, &gaussians, light, camera, rules),
            Some(depths) => {
                let occlusion = exec.upload(depths)?;
                pipeline::render_occluded(exec, &gaussians, light, camera, rules, &occlusion)
            }
        }
    }

    /// Picture of an executor: channels and transmittance, plane by plane.
    ///
    /// # Errors
    ///
    /// The message of the executor's error.
    pub fn picture<E: Renderer>(&self, exec: &mut E) -> Result<Vec<f64>, String> {
        let light = self.light(exec).map_err(said)?;
        self.picture_under(exec, light.as_ref())
    }

    /// [`View::picture`] under a light that was filtered before.
    ///
    /// # Errors
    ///
    /// The message of the executor's error.
    pub fn picture_under<E: Renderer>(&self, exec: &mut E, light: Option<&E::Light>) -> Result<Vec<f64>, String> {
        let frame = self.frame_under(exec, light).map_err(said)?;
        self.read(exec, &frame)
    }

    /// Numbers of a frame of this view.
    ///
    /// # Errors
    ///
    /// The message of the executor's error.
    pub fn read<E: Renderer>(&self, exec: &mut E, frame: &E::Frame) -> Result<Vec<f64>, String> {
        let mut values = vec![f32::NAN; self.len()];
        exec.read_frame(frame, &mut values).map_err(said)?;
        Ok(values.iter().map(|x| f64::from(*x)).collect())
    }

    /// Light of the reference, with texels as an executor stores them.
    fn reference_light<R: Number>(&self, storage: Storage) -> Option<Light<R>> {
        let environment = self.environment.as_ref().filter(|_| self.rules.is_lit)?;
        let mut light = prefilter(&lift_environment(environment), &operator(environment.resolution));
        if storage == Storage::F16 {
            for texel in &mut light.texels {
                let [r, g, b] = texel.to_array().map(|x: R| x.value() as f32);
                let [r, g, b, _] = storage.texel([r, g, b, 0.0]).map(|x| R::of(f64::from(x)));
                *texel = vec3(r, g, b);
            }
        }
        if let Some(near_field) = &self.near_field {
            light = light.around(near_field.clone());
        }
        if !self.lamps.is_empty() {
            let occluder = self.near_field.clone();
            light = light.with_lamps(Lamps { lamps: self.lamps.clone(), rays: RAYS, occluder, reflected: Vec::new() });
        }
        Some(light)
    }

    /// Picture in `f64`, of numbers that are rounded as an executor stores them. The authors' form
    /// of shading has none.
    pub fn exact(&self, storage: Storage) -> Vec<f64> {
        self.reference::<Double>(storage)
    }

    /// [`View::exact`] in another number.
    pub fn reference<R: Number>(&self, storage: Storage) -> Vec<f64> {
        let mut gaussians = self.gaussians.clone();
        storage.round(&mut gaussians);
        let light = self.reference_light::<R>(storage);
        let (gaussians, occlusion) = (lift_gaussians(&gaussians), self.occlusion.as_deref());
        let frame =
            render_occluded(&gaussians, light.as_ref(), &self.camera, &self.rules, occlusion, &Cutoffs::DEFAULT);
        let (blended, size) = (self.rules.blended(self.gaussians.layout), self.pixels());
        let layers = (0..Channels::Layers.count()).filter(|layer| blended.contain(*layer));
        // The reference blends more channels than a picture of colours needs, and without Gaussians
        // it knows none.
        let plane = |layer: usize| match layer < frame.channels - 1 {
            true => frame.values[layer * size..(layer + 1) * size].to_vec(),
            false => vec![R::of(0.0); size],
        };
        let passed = frame.values[(frame.channels - 1) * size..].to_vec();
        layers.map(plane).chain([passed]).flatten().map(R::value).collect()
    }

    /// Features that the view needs.
    pub fn features(&self) -> Vec<Feature> {
        let network = self.environment.as_ref().is_some_and(Environment::is_network);
        let needs = [
            (self.near_field.is_some(), Feature::NearFields),
            (!self.lamps.is_empty(), Feature::Lamps),
            (self.occlusion.is_some(), Feature::Occlusions),
            (network, Feature::LightNetworks),
            (self.environment.is_some() && self.rules.scheme == PrefilterScheme::Official, Feature::OfficialPrefilter),
        ];
        needs.into_iter().filter(|(is_needed, _)| *is_needed).map(|(_, feature)| feature).collect()
    }
}

/// The reference's filter of a resolution, made once.
pub(crate) fn operator(resolution: usize) -> Arc<Operator> {
    static OPERATORS: LazyLock<Mutex<HashMap<usize, Arc<Operator>>>> = LazyLock::new(Mutex::default);
    let mut operators = OPERATORS.lock().unwrap_or_else(PoisonError::into_inner);
    operators.entry(resolution).or_insert_with(|| Arc::new(Operator::new(resolution))).clone()
}
