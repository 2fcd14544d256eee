//! Exact pictures: the pipeline in `f64` without cutoffs, also with Gaussians in another order.

use crate::{setting::Setting, subject::Subject};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    double::Double,
    rules::{Channels, channel},
    scene::{Gaussians, Image},
    vector::Vec3,
};
use specula_oracle::{
    self as oracle,
    independent::{
        rays::{Gaussian, Order, View, blend},
        surface,
    },
    number::Number,
};

/// Ratio of the executors' node size in the light's pyramid to this one's.
const FINENESS: usize = 2;

/// Scene and light for exact pictures.
#[derive(Debug)]
pub struct Reference {
    gaussians: Gaussians<Vec<Double>>,
    /// Gaussians for the independent renderer.
    independent: Vec<Gaussian>,
    light: Option<oracle::Light<Double>>,
    setting: Setting,
}

/// An exact view.
#[derive(Clone, Debug)]
pub struct Exact {
    /// Colours over the background in sRGB, three planes.
    pub colors: Image<Vec<f64>>,
    /// Blended normals.
    pub normals: Vec<[f32; 3]>,
    /// Coverage of each pixel.
    pub coverage: Vec<f64>,
}

impl Reference {
    /// Filters the light from finer nodes than the executors do.
    pub fn new(subject: &Subject) -> Self {
        let light = subject.light.as_ref().filter(|_| subject.is_lit()).map(|light| {
            let operator = oracle::Operator::finer(light.resolution, FINENESS);
            let light = oracle::prefilter(&oracle::lift_environment(light), &operator);
            oracle::Light { near_field: subject.near_field.clone(), ..light }
        });
        let setting = Setting { channels: Channels::Training, ..Setting::exact(subject) };
        let independent = surface::gaussians(&subject.gaussians).into_iter().map(|(gaussian, _)| gaussian).collect();
        Self { gaussians: oracle::lift_gaussians(&subject.gaussians), independent, light, setting }
    }

    /// Rounded texels of each level of the light with their aprons; `None` for unlit scenes.
    pub(crate) fn filtered(&self) -> Option<impl Iterator<Item = Vec<[f32; 3]>> + '_> {
        let rounded = |map: &[Vec3<Double>]| map.iter().map(|texel| texel.to_array().map(|x| x.0 as f32)).collect();
        self.light.as_ref().map(|light| light.level_texels().map(rounded))
    }

    /// Renders exact views of all cameras of the subject in parallel; `done` is called for each.
    pub fn views(&self, subject: &Subject, done: impl Fn() + Sync) -> Vec<(Camera, Exact)> {
        let view = |camera: &Camera| {
            let exact = self.view(subject, camera);
            done();
            (*camera, exact)
        };
        subject.cameras.par_iter().map(view).collect()
    }

    /// Renders an exact view.
    pub fn view(&self, subject: &Subject, camera: &Camera) -> Exact {
        Exact::of(&self.frame(subject, camera), subject.background)
    }

    /// Renders an exact view by the independent renderer, which shares only the colour formulas
    /// with core, in the order of the subject; it sorts all splats of a pixel where that is within
    /// a window.
    pub fn independent_view(&self, subject: &Subject, camera: &Camera) -> Exact {
        let order = if subject.order.window() == Some(1) { Order::Mean } else { Order::Response };
        Exact::of(&self.frame_in_order(subject, camera, order), subject.background)
    }

    /// Channels to blend and shade of an exact view.
    pub(crate) fn frame(&self, subject: &Subject, camera: &Camera) -> oracle::Frame<Double> {
        if self.gaussians.count == 0 {
            return nothing(camera);
        }
        let rules = self.setting.rules(subject);
        oracle::render_within(&self.gaussians, self.light.as_ref(), camera, &rules, &self.setting.cutoffs)
    }

    /// Blends the same channels in a given order by the independent renderer.
    pub(crate) fn frame_in_order(&self, subject: &Subject, camera: &Camera, order: Order) -> oracle::Frame<Double> {
        if self.gaussians.count == 0 {
            return nothing(camera);
        }
        let rules = self.setting.rules(subject);
        let light = self.light.as_ref();
        let narrow = |channels: Vec<Double>| channels.into_iter().map(Number::value).collect();
        let channels: Vec<Vec<f64>> =
            oracle::shade(&self.gaussians, camera, light, &rules).into_iter().map(narrow).collect();
        let blended = blend(&self.independent, &channels, &View::of(camera), order);
        let Image { width, height, channels, values } = blended;
        let frame = Image { width, height, channels, values: values.into_iter().map(Double).collect() };
        let is_deferred = rules.is_deferred(self.gaussians.layout);
        if is_deferred { oracle::shade_pixels(&frame, light, camera, &rules) } else { frame }
    }
}

/// A view without Gaussians: channels are zero, transmittance is one.
fn nothing(camera: &Camera) -> oracle::Frame<Double> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let channels = Channels::Training.count() + 1;
    let mut values = vec![Double(0.0); channels * width * height];
    values[(channels - 1) * width * height..].fill(Double(1.0));
    Image { width, height, channels, values }
}

impl Exact {
    /// Exact view of a picture with the channels of training.
    pub(crate) fn of(frame: &oracle::Frame<Double>, background: [f32; 3]) -> Self {
        let size = frame.pixel_count();
        let colors = oracle::composite(frame, background).iter().map(|x| x.0).collect();
        let normal = |pixel: usize| [0, 1, 2].map(|k| frame.values[(channel::NORMAL + k) * size + pixel].0 as f32);
        let passed = &frame.values[(frame.channels - 1) * size..];
        Self {
            colors: Image { width: frame.width, height: frame.height, channels: 3, values: colors },
            normals: (0..size).map(normal).collect(),
            coverage: passed.iter().map(|passed| 1.0 - passed.0).collect(),
        }
    }
}
