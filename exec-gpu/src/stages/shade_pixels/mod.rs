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
        illuminate::formulas::IlluminatedColorOfPixel,
        light::{LightLayout, split_sums, texels},
        prefilter::Light,
        trace::reflection,
    },
};
use core::iter;
use formulas::{ColorOfPixel, FacingOfPixel, PhysicalColorOfPixel, SurfaceOfPixel};
use specula_core::{
    camera::Camera,
    pack::Storage,
    rules::{Channels, LightLayer, RenderRules, channel},
    shade::ShadingForm,
};

pub mod formulas;

const LIT: &str =
    "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return radiance(direction, roughness);\n}\n";
const UNLIT: &str = "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return vec3f(0.0);\n}\n";

/// Variant of the kernels of a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variant {
    /// Whether pixels of a light have reflections.
    pub(crate) is_traced: bool,
    /// Whether materials are physical.
    pub(crate) is_physical: bool,
    /// Whether lamps light physical materials.
    pub(crate) is_illuminated: bool,
}

impl Variant {
    /// Binding of the split-sum table, behind the reflections, whose binding is `reflections`.
    pub(crate) fn split_sum_binding(self, reflections: usize) -> usize {
        reflections + usize::from(self.is_traced)
    }
}

/// Binding of the reflections.
const REFLECTIONS: usize = 4;

/// Kernel for a surface; without a light, its radiance is zero.
pub(crate) fn source(
    surface: &SurfaceOfPixel,
    light: Option<&LightLayout>,
    variant: Variant,
    light_layer: LightLayer,
) -> String {
    let source = Source::new()
        .real()
        .part(camera)
        .formula(surface)
        .flag("SHOWS_LIGHT", surface.blended == Channels::Layers)
        .count("TINT_CHANNEL", channel::TINT)
        .count("SPECULAR_CHANNEL", channel::SPECULAR)
        .count("LIGHT_CHANNEL", channel::LIGHT)
        .count("AMBIENT_CHANNEL", channel::AMBIENT)
        .count("INDIRECT", LightLayer::Indirect as usize)
        .count("VISIBILITY", LightLayer::Visibility as usize)
        .count("IRRADIANCE", LightLayer::Irradiance as usize)
        .count("LIGHT_LAYER", light_layer as usize);
    let source = match light {
        Some(light) if variant.is_traced => light.lookup(source).part(reflection).with(include_str!("reflected.wgsl")),
        Some(light) => light.lookup(source).with(LIT).with(include_str!("open.wgsl")),
        None => texels(source, Storage::F32).with(UNLIT).with(include_str!("open.wgsl")),
    };
    let source = match (variant.is_physical, light) {
        (false, _) => source.formula(&ColorOfPixel).with(include_str!("deferred.wgsl")),
        (true, None) => source.with(include_str!("black.wgsl")),
        (true, Some(_)) => source
            .part(|source| split_sums(source, variant.split_sum_binding(REFLECTIONS)))
            .formula(&FacingOfPixel(*surface))
            .part(|source| match variant.is_illuminated {
                false => source.formula(&PhysicalColorOfPixel).with(include_str!("physical.wgsl")),
                true => {
                    let binding = variant.split_sum_binding(REFLECTIONS) + 1;
                    source
                        .count("ALBEDO_CHANNEL", channel::DIFFUSE)
                        .count("METALNESS_CHANNEL", channel::METALNESS)
                        .with(&format!("@group(0) @binding({binding}) var<storage, read> direct: array<f32>;\n"))
                        .formula(&IlluminatedColorOfPixel)
                        .with(include_str!("illuminated.wgsl"))
                }
            }),
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
    rules: &RenderRules,
) -> Result<Frame, GpuError> {
    let view = CameraUniform::new(camera, 0);
    let surface = SurfaceOfPixel { blended: Channels::of_count(frame.channels) };
    let shaded = context.allocate("colours", 3 * frame.pixel_count())?;
    let none = context.allocate("no light", 4)?;
    let texels = light.map_or(&none, |light| &light.texels);
    let reflections = frame.reflections.as_ref().filter(|_| light.is_some());
    let is_physical = rules.shading.form == ShadingForm::Physical;
    let direct = frame.direct.as_ref().filter(|_| light.is_some() && is_physical);
    let variant = Variant { is_traced: reflections.is_some(), is_physical, is_illuminated: direct.is_some() };
    let split_sum = light.filter(|_| variant.is_physical).map(|light| light.source.split_sum(context)).transpose()?;
    let arrays =
        [&frame.blended, texels, &shaded].into_iter().chain(reflections).chain(split_sum).chain(direct).map(Buffer);
    let bindings: Vec<Binding<'_>> = iter::once(Uniform(view.bytes())).chain(arrays).collect();
    let layout = light.map(|light| &light.layout);
    let key = format!("{surface:?} {layout:?} {variant:?} {:?}", rules.light_layer);
    let source = || source(&surface, layout, variant, rules.light_layer);
    context.dispatch(&key, "shade_pixels", &source, &bindings, Dispatch::Invocations(frame.pixel_count()))?;
    frame.shaded = Some(shaded);
    Ok(frame)
}
