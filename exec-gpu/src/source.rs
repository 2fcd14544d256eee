//! Sources of kernels: constants from core, functions from formulas, and the files that schedule them.

use crate::{
    formula::{Formula, function, type_of},
    formulas::{
        BlendStep, ColorOfPixel, ColorsOf, Exp2Fraction, LevelOf, LitColorsOf, Log2Mantissa, ShadingOf, SplatOf,
        StrengthAt, SurfaceOf, SurfaceOfPixel, TexelsAt,
        light::{ColorOfPixelVjp, DirectionVjp, RoughnessVjp, SurfaceOfPixelVjp, TexelShares, TexelsMean, TexelsVjp},
    },
    kernel::GROUP,
    light_sums::{MIDDLE_STEPS, NUMBER_MAX, SUM_FAULTS, SUM_WORDS},
    trace::literal,
};
use core::fmt::Write;
use specula_core::{
    bin::{ALPHA_MIN, TILE_SIZE},
    blend::ROOT_SCALE,
    cubemap::padded_len,
    plan::{Channels, channel},
    real::{EXP2_MAX, EXP2_MIN},
    scene::{BLOCK, Layout},
    shade::ShadingForm,
    split_sum,
};

/// Numbers that a workgroup sums up at once.
pub(crate) const SCAN_BLOCK: usize = 1024;
/// Elements that a workgroup sorts at once.
pub(crate) const SORT_BLOCK: usize = 2048;
/// Sums that a row of a sparse matrix is divided into.
pub(crate) const ROW_SUMS: usize = 4;
/// Numbers that a word tells apart.
const WORD: f32 = 4_294_967_296.0;
/// The key of a Gaussian that is not drawn: behind every depth.
pub(crate) const NOT_DRAWN: u32 = u32::MAX;

/// The source of a kernel, piece by piece.
#[derive(Debug)]
pub(crate) struct Source(String);

impl Source {
    /// The constants and functions that every kernel may use.
    pub(crate) fn new() -> Self {
        let mut text = String::new();
        let mut number = |name: &str, value: f32| constant(&mut text, name, "f32", &literal(value));
        number("EXP2_MIN", EXP2_MIN);
        number("EXP2_MAX", EXP2_MAX);
        number("F32_MAX", f32::MAX);
        number("ALPHA_MIN", ALPHA_MIN);
        number("ROOT_SCALE", ROOT_SCALE);
        number("LOG2_E", core::f32::consts::LOG2_E);
        number("TILE_SIZE", TILE_SIZE as f32);
        let mut count = |name: &str, value: u32| constant(&mut text, name, "u32", &format!("{value}u"));
        count("FRAC_1_SQRT_2_BITS", core::f32::consts::FRAC_1_SQRT_2.to_bits());
        count("TILE_EDGE", TILE_SIZE);
        count("BLOCK", BLOCK as u32);
        count("GROUP", GROUP);
        count("SCAN_BLOCK", SCAN_BLOCK as u32);
        count("SORT_BLOCK", SORT_BLOCK as u32);
        count("NOT_DRAWN", NOT_DRAWN);
        Self(text).with(include_str!("shaders/index.wgsl"))
    }
    /// And this text.
    pub(crate) fn with(mut self, text: &str) -> Self {
        self.0.push('\n');
        self.0.push_str(text);
        self
    }
    /// And a number that depends on the variant.
    pub(crate) fn count(mut self, name: &str, value: usize) -> Self {
        constant(&mut self.0, name, "u32", &format!("{value}u"));
        self
    }
    /// And a choice that depends on the variant.
    pub(crate) fn flag(mut self, name: &str, value: bool) -> Self {
        constant(&mut self.0, name, "bool", &value.to_string());
        self
    }
    /// And how the sums of a light's gradient are kept.
    pub(crate) fn light_sums(self, texel_count: usize) -> Self {
        self.with(&format!("const MIDDLE_STEPS: f32 = {};", literal(MIDDLE_STEPS)))
            .with(&format!("const NUMBER_MAX: f32 = {};", literal(NUMBER_MAX)))
            .with(&format!("const MIDDLE_STEP: f32 = {};", literal(1.0 / MIDDLE_STEPS)))
            .with(&format!("const WORD: f32 = {};", literal(WORD)))
            .with(&format!("const PER_WORD: f32 = {};", literal(1.0 / WORD)))
            .count("EXPONENT_BITS", f32::INFINITY.to_bits() as usize)
            .count("NOT_A_NUMBER", f32::NAN.to_bits() as usize)
            .count("SIGN_BIT", 1 << 31)
            .count("SUM_WORDS", SUM_WORDS)
            .count("SUM_FAULTS", SUM_FAULTS)
            .count("LIGHT_TEXELS", texel_count)
    }
    /// And whether there is a layer, and where its channels begin.
    fn channel(self, layer: &str, index: Option<usize>) -> Self {
        self.flag(&format!("HAS_{layer}"), index.is_some())
            .count(&format!("{layer}_CHANNEL"), index.unwrap_or_default())
    }
    /// And how many channels there are.
    pub(crate) fn channels(self, channels: usize) -> Self {
        self.with(&format!("alias Channels = {};", type_of(channels)))
            .count("CHANNELS", channels)
            .count("CHANNEL_VECTORS", channels.div_ceil(4))
    }
    /// And a formula.
    pub(crate) fn formula(self, formula: &impl Formula) -> Self {
        self.with(&function(formula))
    }
    /// And powers and logarithms, which formulas call.
    pub(crate) fn real(self) -> Self {
        self.formula(&Exp2Fraction).formula(&Log2Mantissa).with(include_str!("shaders/real.wgsl"))
    }
    /// And the camera, with what follows from it.
    pub(crate) fn camera(self) -> Self {
        self.with(include_str!("shaders/camera.wgsl")).with(include_str!("shaders/outline.wgsl"))
    }
    /// And the planes of a Gaussian.
    pub(crate) fn planes(self, layout: Layout) -> Self {
        self.count("PLANES", layout.plane_count()).with(include_str!("shaders/planes.wgsl"))
    }
    /// The whole text.
    pub(crate) fn text(self) -> String {
        self.0
    }
}

fn constant(text: &mut String, name: &str, kind: &str, value: &str) {
    writeln!(text, "const {name}: {kind} = {value};").expect("strings take everything");
}

/// [`mod@crate::project`]'s kernel.
pub(crate) fn project(layout: Layout) -> String {
    let source = Source::new().real().camera().planes(layout).formula(&SplatOf { layout });
    source.with(include_str!("shaders/project.wgsl")).text()
}

/// [`mod@crate::shade`]'s kernel; without a light, Gaussians look none up.
pub(crate) fn shade(shading: &ShadingOf, light: Option<&LightLayout>) -> String {
    let source = Source::new().real().camera().planes(shading.layout).channels(shading.blended().count());
    let source = match light {
        Some(light) => light
            .declare(source)
            .formula(&SurfaceOf(*shading))
            .formula(&LitColorsOf(*shading))
            .count("SPLIT_SUM_SIZE", split_sum::RESOLUTION)
            .flag("IS_OFFICIAL", shading.rules.shading.form == ShadingForm::Official)
            .with(include_str!("shaders/lit.wgsl")),
        None => source.formula(&ColorsOf(*shading)).with(UNLIT_CHANNELS),
    };
    source.with(include_str!("shaders/shade.wgsl")).text()
}

const UNLIT_CHANNELS: &str = "fn channels_of() -> Channels {\n    return colors_of();\n}\n";

/// Sums.
pub(crate) fn scan() -> String {
    Source::new().with(include_str!("shaders/scan.wgsl")).text()
}

/// Sorting.
pub(crate) fn sort() -> String {
    Source::new().with(include_str!("shaders/sort.wgsl")).text()
}

/// Splats to tiles.
pub(crate) fn bin() -> String {
    Source::new().camera().with(include_str!("shaders/bin.wgsl")).text()
}

/// Tiles' own parts of the sorted splats.
pub(crate) fn ranges() -> String {
    Source::new().with(include_str!("shaders/ranges.wgsl")).text()
}

/// Compositing.
pub(crate) fn blend(channels: usize) -> String {
    let source = Source::new().real().camera().formula(&StrengthAt).formula(&BlendStep);
    source.channels(channels).with(include_str!("shaders/blend.wgsl")).text()
}

/// Light, pixel by pixel; without a light there is none.
pub(crate) fn shade_pixels(surface: &SurfaceOfPixel, light: Option<&LightLayout>) -> String {
    let source = Source::new()
        .real()
        .camera()
        .formula(surface)
        .formula(&ColorOfPixel)
        .flag("SHOWS_LIGHT", surface.blended == Channels::Layers)
        .count("TINT_CHANNEL", channel::TINT)
        .count("SPECULAR_CHANNEL", channel::SPECULAR)
        .count("LIGHT_CHANNEL", channel::LIGHT);
    let source = match light {
        Some(light) => light.declare(source).with(LIT),
        None => source.with(UNLIT),
    };
    source.with(include_str!("shaders/pixel.wgsl")).text()
}

/// The gradient of light, pixel by pixel; without a light there is none of it.
pub(crate) fn shade_pixels_vjp(surface: &SurfaceOfPixel, light: Option<&LightLayout>) -> String {
    let index_of = |channel: usize| surface.blended.index_of(channel);
    let source = Source::new()
        .real()
        .camera()
        .formula(surface)
        .formula(&ColorOfPixelVjp)
        .formula(&SurfaceOfPixelVjp(*surface))
        .count("TRANSMITTANCE", surface.blended.count())
        .count("COLOR_CHANNEL", channel::COLOR)
        .channel("NORMAL", index_of(channel::NORMAL))
        .channel("TINT", index_of(channel::TINT))
        .channel("ROUGHNESS", index_of(channel::ROUGHNESS));
    let source = match light {
        Some(light) => light.declare_vjp(source),
        None => source.with(UNLIT_LOOK),
    };
    source.with(include_str!("shaders/pixel_vjp.wgsl")).text()
}

const LIT: &str =
    "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return radiance(direction, roughness);\n}\n";
const UNLIT: &str = "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return vec3f(0.0);\n}\n";

/// Without a light there is nothing to look up.
const UNLIT_LOOK: &str = "
struct Look {
    radiance: vec3f,
}

fn look_up(direction: vec3f, roughness: f32) -> Look {
    return Look(vec3f(0.0));
}

fn look_up_vjp(look: Look, direction: vec3f, roughness: f32, grad: vec3f) -> vec4f {
    return vec4f(0.0);
}
";

/// Sums of a light's gradient to numbers.
pub(crate) fn light_grad(texel_count: usize) -> String {
    Source::new().light_sums(texel_count).with(include_str!("shaders/light_grad.wgsl")).text()
}

/// Colours to sums of a light's gradient.
pub(crate) fn add_colors(texel_count: usize) -> String {
    let source = Source::new().light_sums(texel_count).with(include_str!("shaders/light_sums.wgsl"));
    source.with(include_str!("shaders/add_colors.wgsl")).text()
}

/// A light's numbers to radiance.
pub(crate) fn activate() -> String {
    Source::new().real().with(include_str!("shaders/radiance.wgsl")).with(include_str!("shaders/activate.wgsl")).text()
}

/// Gradients of radiance to those of a light's numbers.
pub(crate) fn activate_vjp() -> String {
    let source = Source::new().real().with(include_str!("shaders/radiance.wgsl"));
    source.with(include_str!("shaders/activate_vjp.wgsl")).text()
}

/// Sparse matrices.
pub(crate) fn prefilter() -> String {
    Source::new().count("ROW_SUMS", ROW_SUMS).with(include_str!("shaders/prefilter.wgsl")).text()
}

/// Where the levels of a light lie.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LightLayout {
    /// Which roughness each level has.
    pub(crate) levels: LevelOf,
    /// First texel and resolution of each level, and of the irradiance map if there is one.
    pub(crate) places: Vec<(usize, usize)>,
}

impl LightLayout {
    fn declare(&self, source: Source) -> Source {
        let table = |name: &str, numbers: &mut dyn Iterator<Item = usize>| {
            let numbers: Vec<String> = numbers.map(|number| format!("{number}u")).collect();
            format!(
                "fn {name}(level: u32) -> u32 {{\n    var table = array({});\n    return table[level];\n}}\n",
                numbers.join(", ")
            )
        };
        source
            .count("LEVELS", self.levels.levels.len())
            .formula(&self.levels)
            .formula(&TexelsAt)
            .with(&table("level_start", &mut self.places.iter().map(|place| place.0)))
            .with(&table("level_resolution", &mut self.places.iter().map(|place| place.1)))
            .with(include_str!("shaders/light.wgsl"))
    }

    /// And the gradient of looking it up.
    fn declare_vjp(&self, source: Source) -> Source {
        self.declare(source)
            .formula(&TexelShares)
            .formula(&TexelsMean)
            .formula(&TexelsVjp)
            .formula(&DirectionVjp)
            .formula(&RoughnessVjp { levels: self.levels.levels.clone() })
            .light_sums(self.texel_count())
            .with(include_str!("shaders/light_sums.wgsl"))
            .with(include_str!("shaders/light_vjp.wgsl"))
    }

    /// Texels of all levels and the irradiance map.
    fn texel_count(&self) -> usize {
        self.places.last().map_or(0, |(first, resolution)| first + padded_len(*resolution))
    }
}

/// Statements for every row of `inputs`, which write a row of `outputs`.
pub(crate) fn probe(statements: &str) -> String {
    let source = Source::new().real();
    source.with(&include_str!("shaders/probe.wgsl").replace("    // STATEMENTS\n", statements)).text()
}

/// The gradient of looking light up, for every row.
pub(crate) fn probe_light(light: &LightLayout) -> String {
    light.declare_vjp(Source::new().real()).with(include_str!("shaders/probe_light.wgsl")).text()
}
