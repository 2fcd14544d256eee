//! Scenes of glTF files, the inverse of [`crate::export`].
//!
//! A file with `SPECULA_shading` becomes a shaded scene whose normals are those of the file,
//! whatever the axes of its Gaussians; others become plain Gaussian splatting.

use crate::{Scene, SceneError, Shading as Shown, ShadingModel, orientation};
use specula_core::{
    activation::logit,
    normal::AxisRule,
    scene::{
        ALBEDO, AMBIENT, DIFFUSE, Environment, Gaussians, Layout, METALNESS, NORMAL_RESIDUAL_1, ROUGHNESS,
        RadianceActivation, TINT, len_of_values,
    },
};
use specula_io::{
    Error, Input,
    budget::RADIANCE_MAX,
    glb::{self, GlbScene, Shading},
    orientation::{Orientation, UpSource},
};

/// Scene of a glTF file.
#[derive(Debug)]
pub struct Imported {
    /// The scene.
    pub scene: Scene,
    /// Up direction of the file.
    pub orientation: Orientation,
    /// Origin of the Gaussians in the world of their data set ([`specula_io::origin`]).
    pub origin: [f64; 3],
    /// Notes on parts of the file that are ignored or changed, one sentence each.
    pub notes: Vec<String>,
}

/// Reads a scene from glTF with Gaussians.
///
/// # Errors
///
/// [`Error::Glb`] for a file without Gaussians or with faults.
pub fn scene_of_glb(input: Input<'_>) -> Result<Imported, SceneError> {
    let GlbScene { gaussians, shading, up, origin, notes } = glb::read(input)?;
    let refuse = |cause: String| Error::Glb { path: input.path().to_owned(), cause };
    if gaussians.count == 0 || !gaussians.values.iter().all(|number| number.is_finite()) {
        return Err(refuse("it has no Gaussians, or some that are not finite".to_owned()).into());
    }
    let orientation = Orientation { up, up_source: UpSource::File, ..orientation::of_gaussians(&gaussians) };
    let plain = Scene::unlit(gaussians, ShadingModel::DEFERRED);
    let scene = match shading {
        None => plain,
        Some(shading) => shaded(plain, shading).map_err(refuse)?,
    };
    Ok(Imported { scene, orientation, origin, notes })
}

/// Scene with the shading attributes of a file instead of its colours.
fn shaded(plain: Scene, shading: Shading) -> Result<Scene, String> {
    let Shading { properties, attributes, light } = shading;
    let count = plain.gaussians.count;
    let word = |key: &str| properties.get(key).and_then(|word| word.as_str());
    let form = word("form").unwrap_or_default();
    let comment = format!("specula shading={form} prefilter={}", word("prefilter").unwrap_or_default());
    let mut shading_model =
        ShadingModel::from_comment(&comment).ok_or_else(|| format!("its shading has the unknown form {form:?}"))?;
    // Normals without residuals.
    shading_model.shading.axis = AxisRule::None;
    let find = |name: &str| attributes.iter().find(|attribute| attribute.name == name);
    let residuals = attributes.iter().filter(|attribute| attribute.name.starts_with("RESIDUAL")).count();
    let sh_degree = match residuals {
        0 => None,
        count => {
            let degree = glb::degree(count);
            Some(degree.ok_or_else(|| format!("it has {count} residual harmonics, of no degree"))?)
        }
    };
    let is_physical = find("ALBEDO").is_some() && find("METALLIC").is_some();
    let layout = Layout { is_physical, ..Layout::shaded(sh_degree) };
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for index in 0..count {
        // Means, log scales, quats and opacities have the same planes in every layout.
        gaussians.set(index, 0, plain.gaussians.get::<DIFFUSE>(index, 0));
    }
    let shift = shading_model.shading.diffuse_shift();
    let physical = layout.physical_planes();
    let mut planes =
        vec![("NORMAL", NORMAL_RESIDUAL_1), ("DIFFUSE", DIFFUSE), ("TINT", TINT), ("ROUGHNESS", ROUGHNESS)];
    planes.extend(physical.into_iter().flat_map(|first| [("ALBEDO", first + ALBEDO), ("METALLIC", first + METALNESS)]));
    for (name, plane) in planes {
        let attribute = find(name).ok_or_else(|| format!("its shading has no {name}"))?;
        let number = |number: f32| match name {
            "NORMAL" => number,
            "DIFFUSE" => logit(number) - shift,
            _ => logit(number),
        };
        set(&mut gaussians, plane, attribute.width, attribute.values.iter().copied().map(number));
    }
    for k in 0..layout.sh_count() {
        let name = glb::harmonic("RESIDUAL", k);
        let attribute = find(&name).ok_or_else(|| format!("its shading has no {name}"))?;
        set(&mut gaussians, layout.sh_start() + 3 * k, 3, attribute.values.iter().copied());
    }
    if let Some(first) = physical {
        // Files have no shadows.
        (0..count).for_each(|index| gaussians.set(index, first + AMBIENT, [1.0; 3]));
    }
    if !gaussians.values.iter().all(|number| number.is_finite()) {
        return Err("some of its shading attributes are not finite".to_owned());
    }
    let light = match light {
        Some((values, resolution)) => {
            let is_light = resolution.is_power_of_two() && values.iter().all(|x| (0.0..=RADIANCE_MAX).contains(x));
            let cube = Environment { resolution, activation: RadianceActivation::Identity, values };
            Some(cube)
                .filter(|_| is_light)
                .ok_or("its light is not finite and positive, or its resolution is not a power of two")?
        }
        None => return Err("its shading has no light".to_owned()),
    };
    if is_physical && word("shown") == Some(Shown::Physical.name()) {
        shading_model = shading_model.shaded(Shown::Physical);
    }
    Ok(Scene { gaussians, light: Some(light), shading_model, ..plain })
}

/// Sets planes from values, Gaussian by Gaussian.
fn set(gaussians: &mut Gaussians<Vec<f32>>, plane: usize, width: usize, values: impl Iterator<Item = f32>) {
    values.enumerate().for_each(|(at, number)| gaussians.set(at / width, plane + at % width, [number]));
}
