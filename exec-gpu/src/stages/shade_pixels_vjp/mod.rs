//! Gradient of deferred shading.

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
        frame::{Frame, FrameGrad},
        light::{LightGrad, LightLayout, split_sums_vjp, sums::LightSums, texels},
        prefilter::Light,
        shade_pixels::pixel::PixelKernel,
    },
};
use core::iter;
use specula_core::{
    camera::Camera,
    pack::Storage,
    rules::{LightLayer, RenderRules},
};

/// Kernel of a variant; without a light, no gradient flows to one.
pub(crate) fn source(kernel: &PixelKernel, light: Option<&LightLayout>) -> String {
    let source = Source::new().real().part(camera).count("TRANSMITTANCE", kernel.shading.channels.count());
    match light {
        Some(light) => light.lookup_vjp(source),
        None => texels(source, Storage::F32),
    }
    .part(|source| kernel.bindings(source, 5))
    .part(|source| if kernel.reads_split_sum() { split_sums_vjp(source) } else { source })
    .with(&kernel.backward())
    .with(include_str!("shade_pixels_vjp.wgsl"))
    .text()
}

/// Gradients of the blended channels and of the light from that of the shaded frame.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn shade_pixels_vjp(
    context: &mut Context,
    surface: &Frame,
    light: Option<&Light>,
    camera: &Camera,
    rules: &RenderRules,
    grad: FrameGrad,
) -> Result<(FrameGrad, Option<LightGrad>), GpuError> {
    let view = CameraUniform::new(camera, 0);
    // Lamps have no gradient, and the layer of light has none.
    let rules = RenderRules { light_layer: LightLayer::Reflected, ..*rules };
    let kernel = PixelKernel { is_illuminated: false, ..PixelKernel::new(surface, light, camera, &rules) };
    let sums = light.map(|light| LightSums::new(context, &light.layout)).transpose()?;
    let none = [context.allocate("no light", 4)?, context.allocate("no sums", 4)?];
    let arrays = [
        &surface.blended,
        light.map_or(&none[0], |light| &light.texels),
        &grad.values,
        sums.as_ref().map_or(&none[1], LightSums::array),
    ];
    let arrays = arrays.into_iter().chain(kernel.arrays(context, surface, light)?);
    let bindings: Vec<Binding<'_>> = iter::once(Uniform(view.bytes())).chain(arrays.map(Buffer)).collect();
    let layout = light.map(|light| &light.layout);
    let key = format!("{kernel:?} {layout:?}");
    let source = || source(&kernel, layout);
    context.dispatch(&key, "shade_pixels_vjp", &source, &bindings, Dispatch::Invocations(surface.pixel_count()))?;
    let light_grad = sums.map(|sums| sums.finish(context)).transpose()?;
    Ok((grad, light_grad))
}
