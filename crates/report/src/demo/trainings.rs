//! Trainings of the demo, measured.

use crate::measure::{self, MAE, MEASURES, PSNR, SSIM, Values};
use glam::Vec3;
use serde_json::Value;
use specula_core::camera::Camera;
use specula_io::cameras::NamedCamera;
use specula_scene::{Scene, number::group_digits, orbit::turntable, orientation};
use specula_train::view::View;

/// Frames of the animation.
const FRAMES: u32 = 24;
/// Width and height of a frame in pixels.
const FRAME_SIZE: [u32; 2] = [400, 400];

/// One of the two trainings of the demo.
#[derive(Clone, Debug)]
pub struct TrainedScene {
    /// Name of the profile.
    pub name: &'static str,
    /// Measures of the held-out views.
    pub measures: Values,
    /// Time of all steps in seconds.
    pub seconds: f64,
    /// Result.
    pub scene: Scene,
}

impl TrainedScene {
    fn row(&self) -> [String; 6] {
        let value =
            |measure: usize| self.measures[measure].map_or(String::new(), |value| MEASURES[measure].format(value));
        [
            self.name.to_owned(),
            value(PSNR),
            value(SSIM),
            value(MAE),
            format!("{:.0}", self.seconds),
            group_digits(self.scene.gaussians.count),
        ]
    }
}

/// Trainings as rows of a table, heads first.
pub fn table([plain, shaded]: [&TrainedScene; 2]) -> [[String; 6]; 3] {
    let heads = ["profile", "PSNR dB", "SSIM", "normals °", "seconds", "Gaussians"].map(str::to_owned);
    [heads, plain.row(), shaded.row()]
}

/// Trainings as a JSON object, by name.
pub fn results(trained: [&TrainedScene; 2]) -> Value {
    let entry = |trained: &TrainedScene| {
        let mut measures = measure::json_of_values(&trained.measures);
        measures["seconds"] = ((trained.seconds * 10.0).round() / 10.0).into();
        measures["gaussians"] = trained.scene.gaussians.count.into();
        (trained.name.to_owned(), measures)
    };
    Value::Object(trained.into_iter().map(entry).collect())
}

/// Cameras of the animation, which go around a scene once.
#[derive(Clone, Debug)]
pub struct Orbit {
    /// Unit vector up.
    pub(super) up: Vec3,
    pub(super) cameras: Vec<Camera>,
}

impl Orbit {
    /// Turntable of a scene with these test views.
    pub fn new(test: &[View], scene: &Scene) -> Self {
        let [width, height] = FRAME_SIZE;
        let known = test.iter().map(|view| (view.name.clone(), view.camera.resized(width, height)));
        let known: Vec<NamedCamera> = known.collect();
        let found = orientation::estimate(known.iter().map(|(_, camera)| camera), &[]);
        let orientation = found.unwrap_or_else(|| orientation::of_gaussians(&scene.gaussians));
        let cameras =
            turntable(&orientation, &known, FRAMES, None, None).into_iter().map(|(_, camera)| camera).collect();
        Self { up: orientation::up(&orientation), cameras }
    }
}
