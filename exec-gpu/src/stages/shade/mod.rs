//! Shading of Gaussians: their channels, under looked-up light.

use crate::{
    codegen::{formula::type_of, source::Source},
    device::{
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        kernels::{
            Binding::{Buffer, Uniform},
            Dispatch,
        },
        memory::Array,
    },
    stages::{
        camera::{CameraUniform, camera},
        gaussians::stored_planes,
        light::{LightLayout, split_sums},
        prefilter::Light,
        project::{Splats, splat},
    },
};
use formulas::{ColorsOf, LitColorsOf, SurfaceOf};
use specula_core::{
    attributes::GaussianShading, camera::Camera, pack::Storage, rules::RenderRules, scene::Gaussians,
    shade::ShadingForm,
};

pub mod formulas;

/// Appends the type `Channels` and the number of channels of a Gaussian.
pub(crate) fn channels(source: Source, channels: usize) -> Source {
    source
        .with(&format!("alias Channels = {};", type_of(channels)))
        .count("CHANNELS", channels)
        .count("CHANNEL_VECTORS", channels.div_ceil(4))
}

/// Appends the lookup of a light by a Gaussian.
pub(crate) fn gaussian_light(source: Source, surface: &SurfaceOf) -> Source {
    let shading = surface.shading;
    source
        .formula(surface)
        .part(|source| split_sums(source, 5))
        .flag("IS_OFFICIAL", shading.rules.shading.form == ShadingForm::Official)
        .with(include_str!("gaussian_light.wgsl"))
}

/// Declares the splats, from this binding on.
fn splat_bindings(binding: usize) -> String {
    let next = binding + 1;
    format!(
        "@group(0) @binding({binding}) var<storage, read_write> tile_counts: array<u32>;\n\
         @group(0) @binding({next}) var<storage, read_write> splats: array<Splat>;\n"
    )
}

const LIT_CHANNELS: &str = "fn channels_of() -> LitColorsOf {
    let light = gaussian_light(surface_of());
    return lit_colors_of(light.specular, light.ambient, light.split_sum);
}
";
const UNLIT_CHANNELS: &str = "fn channels_of() -> ColorsOf {\n    return colors_of();\n}\n";

/// Kernel of a shading; without a light, Gaussians look up none.
pub(crate) fn source(surface: &SurfaceOf, storage: Storage, light: Option<&LightLayout>) -> String {
    let shading = &surface.shading;
    let source = Source::new()
        .real()
        .part(camera)
        .part(splat)
        .part(|source| stored_planes(source, shading.layout, storage))
        .part(|source| channels(source, shading.channels().count()));
    let source = match light {
        Some(light) => gaussian_light(light.lookup(source), surface).formula(&LitColorsOf(*shading)).with(LIT_CHANNELS),
        None => source.formula(&ColorsOf(*shading)).with(UNLIT_CHANNELS),
    };
    let source = source.with(&splat_bindings(if light.is_some() { 6 } else { 4 }));
    source.with(include_str!("shade.wgsl")).text()
}

/// Channels of each Gaussian, side by side, padded to whole vectors of four.
#[derive(Debug)]
pub struct Colors {
    pub(crate) channels: usize,
    pub(crate) values: Array,
}

/// Shades all drawn Gaussians; marks those with a non-finite attribute as not drawn.
///
/// # Errors
///
/// See [`Context::allocate`] and [`Context::dispatch`].
pub(crate) fn shade(
    context: &mut Context,
    gaussians: &Gaussians<ChunkedArray>,
    camera: &Camera,
    splats: &mut Splats,
    light: Option<&Light>,
    rules: &RenderRules,
) -> Result<Colors, GpuError> {
    let storage = gaussians.values.storage();
    let shading = GaussianShading { layout: gaussians.layout, rules: *rules };
    let channels = shading.channels().count();
    let colors =
        Colors { channels, values: context.allocate("channels", channels.next_multiple_of(4) * gaussians.count)? };
    let light = light.filter(|_| shading.looks_light_up());
    let layout = light.map(|light| &light.layout);
    let surface = SurfaceOf { shading, is_turned: light.is_some() && camera.light_from_world.is_some() };
    let key = format!("{surface:?} {storage:?} {layout:?}");
    let source = || source(&surface, storage, layout);
    for chunk in gaussians.values.chunks(gaussians.count) {
        let view = CameraUniform::with_range(camera, chunk.gaussians.clone());
        let mut bindings =
            vec![Uniform(view.bytes()), Buffer(chunk.array), Buffer(&splats.depth_keys), Buffer(&colors.values)];
        if let Some(light) = light {
            bindings.extend([Buffer(&light.texels), Buffer(&light.split_sum)]);
        }
        bindings.extend([Buffer(&splats.tile_counts), Buffer(&splats.splats)]);
        context.dispatch(&key, "shade", &source, &bindings, Dispatch::Invocations(chunk.gaussians.len()))?;
    }
    Ok(colors)
}
