//! Channels of a Gaussian.

use crate::{
    codegen::formula::{Field, Inputs, fields, formula},
    stages::{
        camera::{camera_fields, light_frame_fields, take_camera, take_light_frame},
        gaussians::{Planes, planes_field},
    },
};
use specula_core::{
    attributes::{GaussianShading, LayerChannels, LightSample},
    camera::CameraOf,
    real::Real,
};

/// Blended channels, then 1 if all attributes that they depend on are finite, else 0.
fn blended<R: Real>(shading: &GaussianShading, channels: &LayerChannels<R>, is_finite: R::Mask) -> (Vec<R>, [R; 1]) {
    let blended = shading.channels();
    let layers = (0..channels.0.len()).filter(|channel| blended.index_of(*channel).is_some());
    let one = channels.0[0].constant(1.0);
    (layers.map(|channel| channels.0[channel]).collect(), [one.keep(is_finite)])
}

/// Blended channels of a shaded Gaussian under its light.
fn surface_channels<R: Real>(
    shading: &GaussianShading,
    planes: &Planes<'_, R>,
    camera: &CameraOf<R>,
    light: &LightSample<R>,
) -> (Vec<R>, [R; 1]) {
    let shaded = shading.shaded(planes, camera.position);
    let channels = shading.surface_channels(&shaded, &shaded.terms(light), camera);
    blended(shading, &channels, shaded.is_finite())
}

/// Channels of a Gaussian without a light lookup ([`specula_core::attributes`]): plain, unlit, or
/// with deferred shading.
#[derive(Clone, Copy, Debug)]
pub struct ColorsOf(pub GaussianShading);

formula!(ColorsOf, |this, inputs| colors_of(..planes_field(this.0.layout), ..camera_fields()) -> (
    channels: this.0.channels().count(), is_finite: 1
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let camera = take_camera(inputs);
    if this.0.reads_surface() {
        surface_channels(&this.0, &planes, &camera, &LightSample::none(camera.near))
    } else {
        let (channels, is_finite) = this.0.color_channels(&planes, &camera);
        blended(&this.0, &channels, is_finite)
    }
});

/// Directions, in the frame of the light, and roughness with which a Gaussian looks up the light
/// ([`specula_core::shade::surface`]).
#[derive(Clone, Copy, Debug)]
pub struct SurfaceOf {
    /// Shading of the Gaussian.
    pub shading: GaussianShading,
    /// Whether the light is turned against the world.
    pub is_turned: bool,
}

formula!(SurfaceOf, |this, inputs| surface_of(
    ..ColorsOf(this.shading).parameters(), ..light_frame_fields(this.is_turned)
) -> (reflection_dir: 3, normal: 3, roughness: 1, n_dot_v: 1) {
    let planes = Planes(inputs.slice(this.shading.layout.plane_count()));
    let surface = this.shading.shaded(&planes, take_camera(inputs).position).surface;
    let frame = take_light_frame(inputs, this.is_turned);
    let [reflection_dir, normal] = [surface.reflection_dir, surface.facing.normal].map(|d| frame.to_light(d));
    (reflection_dir, normal, [surface.roughness, surface.n_dot_v])
});

/// Light that a Gaussian looked up, as parameters.
pub(crate) fn light_fields() -> Vec<Field> {
    fields!(specular_light: 3, ambient_light: 3, split_sum: 2)
}

/// Reads the light that a Gaussian looked up from a formula's inputs.
pub(crate) fn take_light<R: Real>(inputs: &mut Inputs<'_, R>) -> LightSample<R> {
    LightSample { specular: inputs.vec3(), ambient: inputs.vec3(), split_sum: inputs.array() }
}

/// Channels of a Gaussian under the light that it looked up ([`specula_core::attributes`]).
#[derive(Clone, Copy, Debug)]
pub struct LitColorsOf(pub GaussianShading);

formula!(LitColorsOf, |this, inputs| lit_colors_of(..ColorsOf(this.0).parameters(), ..light_fields()) -> (
    ..ColorsOf(this.0).results()
) {
    let planes = Planes(inputs.slice(this.0.layout.plane_count()));
    let camera = take_camera(inputs);
    let light = take_light(inputs);
    surface_channels(&this.0, &planes, &camera, &light)
});
