//! Exact pictures: the pipeline in `f64`, nothing cut off.

use crate::{setting::Setting, subject::Subject};
use rayon::prelude::*;
use specula_core::{
    camera::Camera,
    double::Double,
    limits::Limits,
    plan::{Channels, channel},
    scene::{Gaussians, Image},
};
use specula_oracle as oracle;

/// Nodes of the light's pyramid are so many times narrower than those of executors.
const FINENESS: usize = 2;

/// What exact pictures are made of.
#[derive(Debug)]
pub struct Reference {
    gaussians: Gaussians<Vec<Double>>,
    light: Option<oracle::Light<Double>>,
    setting: Setting,
}

/// An exact view.
#[derive(Clone, Debug)]
pub struct Exact {
    /// Colours over the background, sRGB, three planes.
    pub colors: Image<Vec<f64>>,
    /// Blended normals.
    pub normals: Vec<[f32; 3]>,
    /// How much of each pixel is covered.
    pub coverage: Vec<f64>,
}

impl Reference {
    /// Filters the light, from finer nodes than executors do.
    pub fn new(subject: &Subject) -> Self {
        let light = subject.light.as_ref().filter(|_| subject.is_lit()).map(|light| {
            let operator = oracle::Operator::finer(light.resolution, FINENESS);
            oracle::prefilter(&oracle::lift_environment(light), &operator)
        });
        let setting = Setting { channels: Channels::Training, ..Setting::exact(subject) };
        Self { gaussians: oracle::lift_gaussians(&subject.gaussians), light, setting }
    }

    /// Exact views from all cameras of the subject, side by side, because each is worked out plainly; `done` is called
    /// for each.
    pub fn views(&self, subject: &Subject, done: impl Fn() + Sync) -> Vec<(Camera, Exact)> {
        let view = |camera: &Camera| {
            let exact = self.view(subject, camera);
            done();
            (*camera, exact)
        };
        subject.cameras.par_iter().map(view).collect()
    }

    /// An exact view.
    pub fn view(&self, subject: &Subject, camera: &Camera) -> Exact {
        let rules = self.setting.rules(subject);
        let frame = oracle::render_within(&self.gaussians, self.light.as_ref(), camera, &rules, &Limits::LEAST);
        let size = frame.pixel_count();
        let colors = oracle::composite(&frame, subject.background).iter().map(|x| x.0).collect();
        let normal = |pixel: usize| [0, 1, 2].map(|k| frame.values[(channel::NORMAL + k) * size + pixel].0 as f32);
        let passed = &frame.values[(frame.channels - 1) * size..];
        Exact {
            colors: Image { width: frame.width, height: frame.height, channels: 3, values: colors },
            normals: (0..size).map(normal).collect(),
            coverage: passed.iter().map(|passed| 1.0 - passed.0).collect(),
        }
    }
}
