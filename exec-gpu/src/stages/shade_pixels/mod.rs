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
    },
};
use core::iter;
use pixel::PixelKernel;
use specula_core::{camera::Camera, pack::Storage, rules::RenderRules};

pub(crate) mod pixel;

/// Kernel of a variant, under a light of this layout.
pub(crate) fn source(kernel: &PixelKernel, light: Option<&LightLayout>) -> String {
    let source = Source::new().real().part(camera);
    match light {
        Some(light) => light.lookup(source),
        None => texels(source, Storage::F32),
    }
    .part(|source| kernel.bindings(source, 4))
    .with(&kernel.forward())
    .with(include_str!("shade_pixels.wgsl"))
    .text()
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
    rules: &RenderRules,
) -> Result<Frame, GpuError> {
    let view = CameraUniform::new(camera, 0);
    let kernel = PixelKernel::new(&frame, light, camera, rules);
    let shaded = context.allocate("colours", 3 * frame.pixel_count())?;
    let none = context.allocate("no light", 4)?;
    let texels = light.map_or(&none, |light| &light.texels);
    let arrays = [&frame.blended, texels, &shaded].into_iter().chain(kernel.arrays(context, &frame, light)?);
    let bindings: Vec<Binding<'_>> = iter::once(Uniform(view.bytes())).chain(arrays.map(Buffer)).collect();
    let layout = light.map(|light| &light.layout);
    let key = format!("{kernel:?} {layout:?}");
    let source = || source(&kernel, layout);
    context.dispatch(&key, "shade_pixels", &source, &bindings, Dispatch::Invocations(frame.pixel_count()))?;
    frame.shaded = Some(shaded);
    Ok(frame)
}
