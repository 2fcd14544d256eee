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
        light::{LightGrad, LightLayout, split_sums, split_sums_vjp, sums::LightSums, texels},
        prefilter::Light,
        shade_pixels::{
            Variant,
            formulas::{FacingOfPixel, SurfaceOfPixel},
        },
        trace::{formulas::LightOfReflectionVjp, reflection},
    },
};
use core::iter;
use formulas::{ColorOfPixelVjp, FacingOfPixelVjp, PhysicalColorOfPixelVjp, SurfaceOfPixelVjp};
use specula_core::{
    camera::Camera,
    pack::Storage,
    rules::{Channels, channel},
    shade::ShadingForm,
};

pub mod formulas;

/// Lookup of no light.
const UNLIT_LOOKUP: &str = "
struct LightLookup {
    radiance: vec3f,
}

fn look_up(direction: vec3f, roughness: f32) -> LightLookup {
    return LightLookup(vec3f(0.0));
}

fn look_up_vjp(lookup: LightLookup, direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    return vec4f(0.0);
}
";

/// Calls in the kernel of the lookup of a light and its gradient.
const LOOKUP: &str = "= look_up";
/// Calls in their place of the lookup of a reflection and its gradient.
const REFLECTED: &str = "= look_up_reflected";

/// Binding of the reflections.
const REFLECTIONS: usize = 5;

/// Kernel for a surface; without a light, no gradient flows to one.
pub(crate) fn source(surface: &SurfaceOfPixel, light: Option<&LightLayout>, variant: Variant) -> String {
    let index_of = |channel: usize| surface.blended.index_of(channel);
    let source = Source::new()
        .real()
        .part(camera)
        .formula(surface)
        .formula(&SurfaceOfPixelVjp(*surface))
        .count("TRANSMITTANCE", surface.blended.count())
        .count("COLOR_CHANNEL", channel::COLOR)
        .part(|source| optional_channel(source, "NORMAL", index_of(channel::NORMAL)))
        .part(|source| optional_channel(source, "TINT", index_of(channel::TINT)))
        .part(|source| optional_channel(source, "ROUGHNESS", index_of(channel::ROUGHNESS)));
    let kernel = include_str!("shade_pixels_vjp.wgsl");
    let source = match light {
        Some(light) => light.lookup_vjp(source),
        None => texels(source, Storage::F32).with(UNLIT_LOOKUP),
    };
    let source = match (variant.is_physical, light) {
        (false, _) => source.formula(&ColorOfPixelVjp).with(include_str!("deferred_vjp.wgsl")),
        (true, None) => source.with(include_str!("black_vjp.wgsl")),
        (true, Some(_)) => source
            .part(|source| split_sums(source, variant.split_sum_binding(REFLECTIONS)))
            .part(split_sums_vjp)
            .formula(&FacingOfPixel(*surface))
            .formula(&FacingOfPixelVjp(*surface))
            .formula(&PhysicalColorOfPixelVjp)
            .with(include_str!("physical_vjp.wgsl")),
    };
    match light {
        Some(_) if variant.is_traced => source.part(reflected).with(&kernel.replace(LOOKUP, REFLECTED)),
        _ => source.with(kernel),
    }
    .text()
}

/// Appends the lookup of the light of a pixel's reflection, and its gradient.
fn reflected(source: Source) -> Source {
    source.part(reflection).formula(&LightOfReflectionVjp).with(include_str!("reflected_vjp.wgsl"))
}

/// Appends whether a layer is blended, and its first channel.
fn optional_channel(source: Source, layer: &str, index: Option<usize>) -> Source {
    source.flag(&format!("HAS_{layer}"), index.is_some()).count(&format!("{layer}_CHANNEL"), index.unwrap_or_default())
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
    form: ShadingForm,
    grad: FrameGrad,
) -> Result<(FrameGrad, Option<LightGrad>), GpuError> {
    let view = CameraUniform::new(camera, 0);
    let surface_of_pixel = SurfaceOfPixel { blended: Channels::of_count(surface.channels) };
    let sums = light.map(|light| LightSums::new(context, &light.layout)).transpose()?;
    let none = [context.allocate("no light", 4)?, context.allocate("no sums", 4)?];
    let reflections = surface.reflections.as_ref().filter(|_| light.is_some());
    let arrays = [
        &surface.blended,
        light.map_or(&none[0], |light| &light.texels),
        &grad.values,
        sums.as_ref().map_or(&none[1], LightSums::array),
    ];
    let variant =
        Variant { is_traced: reflections.is_some(), is_physical: form == ShadingForm::Physical, is_illuminated: false };
    let split_sum = light.filter(|_| variant.is_physical).map(|light| light.source.split_sum(context)).transpose()?;
    let arrays = arrays.into_iter().chain(reflections).chain(split_sum).map(Buffer);
    let bindings: Vec<Binding<'_>> = iter::once(Uniform(view.bytes())).chain(arrays).collect();
    let layout = light.map(|light| &light.layout);
    let key = format!("{surface_of_pixel:?} {layout:?} {variant:?}");
    let source = || source(&surface_of_pixel, layout, variant);
    context.dispatch(&key, "shade_pixels_vjp", &source, &bindings, Dispatch::Invocations(surface.pixel_count()))?;
    let light_grad = sums.map(|sums| sums.finish(context)).transpose()?;
    Ok((grad, light_grad))
}
