//! Deferred shading: the light is looked up once for each pixel, by its blended surface.

use crate::{
    codegen::source::Source,
    device::{
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{self, Buffer, Uniform},
            Dispatch,
        },
    },
    stages::{
        camera::{CameraUniform, camera},
        frame::Frame,
        light::{LightLayout, texels},
        prefilter::Light,
        trace::reflection,
    },
};
use core::iter;
use formulas::{ColorOfPixel, SurfaceOfPixel};
use specula_core::{
    camera::Camera,
    pack::Storage,
    rules::{Channels, channel},
};

pub mod formulas;

const LIT: &str =
    "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return radiance(direction, roughness);\n}\n";
const UNLIT: &str = "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return vec3f(0.0);\n}\n";

/// Kernel for a surface; without a light, its radiance is zero. `is_traced` tells whether pixels of
/// a light have reflections.
pub(crate) fn source(surface: &SurfaceOfPixel, light: Option<&LightLayout>, is_traced: bool) -> String {
    let source = Source::new()
        .real()
        .part(camera)
        .formula(surface)
        .formula(&ColorOfPixel)
        .flag("SHOWS_LIGHT", surface.blended == Channels::Layers)
        .count("TINT_CHANNEL", channel::TINT)
        .count("SPECULAR_CHANNEL", channel::SPECULAR)
        .count("LIGHT_CHANNEL", channel::LIGHT);
    let source = match light {
        Some(light) if is_traced => light.lookup(source).part(reflection).with(include_str!("reflected.wgsl")),
        Some(light) => light.lookup(source).with(LIT),
        None => texels(source, Storage::F32).with(UNLIT),
    };
    source.with(include_str!("shade_pixels.wgsl")).text()
}

/// Shades all pixels of a frame; their light is that of their reflections, if they were traced.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn shade_pixels(
    context: &mut Context,
    mut frame: Frame,
    light: Option<&Light>,
    camera: &Camera,
) -> Result<Frame, GpuError> {
    let view = CameraUniform::new(camera, 0);
    let surface = SurfaceOfPixel { blended: Channels::of_count(frame.channels) };
    let shaded = context.allocate("colours", 3 * frame.pixel_count())?;
    let none = context.allocate("no light", 4)?;
    let texels = light.map_or(&none, |light| &light.texels);
    let reflections = frame.reflections.as_ref().filter(|_| light.is_some());
    let arrays = [&frame.blended, texels, &shaded].into_iter().chain(reflections).map(Buffer);
    let bindings: Vec<Binding<'_>> = iter::once(Uniform(view.bytes())).chain(arrays).collect();
    let layout = light.map(|light| &light.layout);
    let is_traced = reflections.is_some();
    let key = format!("{surface:?} {layout:?}, traced: {is_traced}");
    let source = || source(&surface, layout, is_traced);
    context.dispatch(&key, "shade_pixels", &source, &bindings, Dispatch::Invocations(frame.pixel_count()))?;
    frame.shaded = Some(shaded);
    Ok(frame)
}
