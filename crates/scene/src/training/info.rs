//! Facts of a training that its model folder records.

use crate::ShadingModel;
use serde_json::{Map, json};
use specula_io::{model_folder::ModelInfo, orientation::Orientation};
use specula_train::trainer::Settings;

/// Settings of a training for `specula.json`, given its numbers of training and test views:
/// version, profile, shading model, background, number of views and orientation. The rest is the
/// caller's, such as the path of the data set.
pub fn model_info(settings: &Settings, [train, test]: [usize; 2], orientation: Option<Orientation>) -> ModelInfo {
    let Settings { profile, iterations, seed, background, .. } = settings;
    let [shading, axis, prefilter, reflections] = ShadingModel::of_profile(profile).names();
    let is_shaded = profile.layout.is_shaded();
    let shading = if profile.is_of_materials() { "physical" } else { shading };
    let mut rest = Map::new();
    if is_shaded {
        rest.insert("axis".into(), axis.into());
        rest.insert("prefilter".into(), prefilter.into());
    }
    if profile.near_field.is_some() {
        rest.insert("reflections".into(), reflections.into());
    }
    if profile.physical.is_some() {
        rest.insert("materials".into(), true.into());
    }
    if profile.views_per_step > 1 {
        rest.insert("views_per_step".into(), profile.views_per_step.into());
    }
    rest.insert("background".into(), json!(background));
    rest.insert("train_views".into(), train.into());
    rest.insert("test_views".into(), test.into());
    ModelInfo {
        version: env!("CARGO_PKG_VERSION").into(),
        profile: profile.name.into(),
        shading: if is_shaded { shading } else { "radiance" }.into(),
        iterations: *iterations,
        white_background: *background == [1.0; 3],
        downscale: 1,
        seed: *seed,
        orientation,
        rest,
        ..ModelInfo::default()
    }
}
