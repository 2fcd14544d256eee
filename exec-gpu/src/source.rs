//! Sources of kernels: constants from core, functions from formulas, and the files that schedule them.

use crate::{
    blend_vjp::{GEOMETRY, splats_at_once},
    formula::{Formula, function, type_of},
    formulas::{
        ColorOfPixel, ColorsOf, Exp2Fraction, LevelOf, LitColorsOf, Log2Mantissa, ShadingOf, SplatOf, SurfaceOf,
        SurfaceOfPixel, TexelsAt,
        blend::{BlendEnd, BlendSplat, BlendStart, PixelBlock},
        blend_vjp::{MOMENTS, MomentsVjp, ReplaySplat, ReplayStart},
        densify::{CellAt, GradLength, MeasuresOf, PartOf},
        expose::{Expose, ExposeVjp},
        gaussians_vjp::{AttributeLosses, LookupVjp, PlanesVjp, SplitSumVjp},
        light::{ColorOfPixelVjp, DirectionVjp, RoughnessVjp, SurfaceOfPixelVjp, TexelShares, TexelsMean, TexelsVjp},
        loss::{
            ColorLoss, ComparedColors, CoverageLoss, DepthGrad, MomentsDown, NormalLoss, NormalWeight, Structure,
            StructureGrad, Windows, WithBackground,
        },
        optimise::AdamStep,
    },
    kernel::GROUP,
    light_sums::{MIDDLE_STEPS, NUMBER_MAX, SUM_FAULTS, SUM_WORDS},
    trace::literal,
};
use core::fmt::Write;
use specula_core::{
    bin::TILE_SIZE,
    color::UNKNOWN,
    cubemap::padded_len,
    cutoffs::TRANSMITTANCE_MIN,
    densify::Action,
    loss::{NormalForm, SSIM_WINDOW},
    optimise::GRAD_MAX,
    pack::{FULL_PLANES, Storage, pack2, unpack2},
    real::{EXP2_MAX, EXP2_MIN},
    rules::{Channels, channel},
    scene::{BLOCK, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, OPACITY},
    shade::ShadingForm,
    splat::ROOT_SCALE,
    split_sum,
};

/// Numbers that a workgroup sums up at once.
pub(crate) const SCAN_BLOCK: usize = 4096;
/// Elements that one invocation goes through where each on its own would be too little to do.
pub(crate) const COLUMN: usize = 64;
/// Invocations of a workgroup that sorts: their counters take a quarter of its memory.
pub(crate) const SORT_GROUP: usize = 64;
/// Bits of a key that are sorted by at once.
pub(crate) const DIGIT_BITS: u32 = 4;
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
        number("TRANSMITTANCE_MIN", TRANSMITTANCE_MIN);
        number("ROOT_SCALE", ROOT_SCALE);
        number("LOG2_E", core::f32::consts::LOG2_E);
        number("TILE_SIZE", TILE_SIZE as f32);
        let mut count = |name: &str, value: u32| constant(&mut text, name, "u32", &format!("{value}u"));
        count("FRAC_1_SQRT_2_BITS", core::f32::consts::FRAC_1_SQRT_2.to_bits());
        count("TILE_EDGE", TILE_SIZE);
        count("BLOCK", BLOCK as u32);
        count("GROUP", GROUP);
        count("SCAN_BLOCK", SCAN_BLOCK as u32);
        count("COLUMN", COLUMN as u32);
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
    /// And the pixels of an invocation.
    fn pixels(self, block: PixelBlock) -> Self {
        let source = self.with(&format!("alias Pixels = {};", type_of(block.count())));
        let source = source.count("BLOCK_WIDTH", block.width).count("BLOCK_HEIGHT", block.height);
        source.with(include_str!("shaders/pixels.wgsl"))
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
    /// And the numbers of the ledger.
    pub(crate) fn ledger(self) -> Self {
        self.with(include_str!("shaders/ledger.wgsl"))
    }
    /// And the planes of a Gaussian.
    pub(crate) fn planes(self, layout: Layout) -> Self {
        self.count("PLANES", layout.plane_count()).with(include_str!("shaders/planes.wgsl"))
    }
    /// And the planes of a Gaussian, however they are stored.
    fn stored_planes(self, layout: Layout, storage: Storage) -> Self {
        match storage {
            Storage::F32 => self.planes(layout),
            Storage::F16 => self
                .count("WORDS", storage.words(layout))
                .count("FULL_PLANES", FULL_PLANES)
                .with(include_str!("shaders/half_planes.wgsl")),
        }
    }
    /// And the texels of a filtered light.
    fn texels(self, storage: Storage) -> Self {
        match storage {
            Storage::F32 => self.with(include_str!("shaders/texels.wgsl")),
            Storage::F16 => self.halves().with(include_str!("shaders/half_texels.wgsl")),
        }
    }
    /// And the bits of halves beside those of numbers in full.
    fn halves(self) -> Self {
        const HALF_MIN: f32 = 1.0 / 16_384.0;
        let half = |number: f32| pack2(number, 0.0) as usize;
        self.count("HALF_SIGN", half(-0.0))
            .count("HALF_INFINITY", half(f32::INFINITY))
            .count("HALF_NOT_A_NUMBER", half(f32::NAN))
            .count("F32_SIGN", (-0.0_f32).to_bits() as usize)
            .count("F32_INFINITY", f32::INFINITY.to_bits() as usize)
            .count("F32_OF_HALF_MAX", unpack2(pack2(f32::MAX, 0.0))[0].to_bits() as usize)
            .count("F32_OF_HALF_MIN", HALF_MIN.to_bits() as usize)
            .count("F32_OF_HALF_BIAS", (HALF_MIN / 2.0).to_bits() as usize)
            .count("DROPPED_BITS", 23 - 10)
            .with(&format!("const SMALLEST_HALVES: f32 = {};", literal(1.0 / unpack2(1)[0])))
    }
    /// And what becomes of Gaussians in densification.
    pub(crate) fn actions(self) -> Self {
        self.count("KEEP", Action::Keep as usize)
            .count("CLONE", Action::Clone as usize)
            .count("SPLIT", Action::Split as usize)
            .count("PRUNE", Action::Prune as usize)
    }
    /// And how Gaussians come about in densification.
    pub(crate) fn origins(self) -> Self {
        self.count("KEPT", 0).count("COPIED", 1).count("FIRST_PART", 2).count("ORIGINS", 4)
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
pub(crate) fn project(layout: Layout, storage: Storage) -> String {
    let source = Source::new().real().camera().stored_planes(layout, storage).formula(&SplatOf { layout });
    source.with(include_str!("shaders/project.wgsl")).text()
}

/// [`mod@crate::shade`]'s kernel; without a light, Gaussians look none up.
pub(crate) fn shade(shading: &ShadingOf, storage: Storage, light: Option<&LightLayout>) -> String {
    let source = Source::new().real().camera().stored_planes(shading.layout, storage);
    let source = source.channels(shading.blended().count());
    let source = match light {
        Some(light) => own_light(light.declare(source), shading).formula(&LitColorsOf(*shading)).with(LIT_CHANNELS),
        None => source.formula(&ColorsOf(*shading)).with(UNLIT_CHANNELS),
    };
    let source = source.with(&drawn_splats(if light.is_some() { 6 } else { 4 }));
    source.with(include_str!("shaders/shade.wgsl")).text()
}

/// Light that Gaussians look up themselves.
fn own_light(source: Source, shading: &ShadingOf) -> Source {
    source
        .formula(&SurfaceOf(*shading))
        .count("SPLIT_SUM_SIZE", split_sum::RESOLUTION)
        .flag("IS_OFFICIAL", shading.rules.shading.form == ShadingForm::Official)
        .with(include_str!("shaders/lit.wgsl"))
}

/// What is drawn, from this binding on.
fn drawn_splats(binding: usize) -> String {
    let next = binding + 1;
    format!(
        "@group(0) @binding({binding}) var<storage, read_write> tile_counts: array<u32>;\n\
         @group(0) @binding({next}) var<storage, read_write> splats: array<Splat>;\n"
    )
}

const LIT_CHANNELS: &str = "fn channels_of() -> LitColorsOf {
    let light = own_light(surface_of());
    return lit_colors_of(light.specular, light.ambient, light.split_sum);
}
";
const UNLIT_CHANNELS: &str = "fn channels_of() -> ColorsOf {\n    return colors_of();\n}\n";

/// Sums.
pub(crate) fn scan() -> String {
    Source::new().with(include_str!("shaders/scan.wgsl")).text()
}

/// Sorting.
pub(crate) fn sort() -> String {
    let source = Source::new().count("SORT_GROUP", SORT_GROUP).count("DIGIT_BITS", DIGIT_BITS as usize);
    source.ledger().with(include_str!("shaders/sort.wgsl")).text()
}

/// Measures of splats.
pub(crate) fn measure() -> String {
    Source::new().ledger().with(include_str!("shaders/measure.wgsl")).text()
}

/// Depths as keys.
pub(crate) fn depths() -> String {
    Source::new().ledger().with(include_str!("shaders/depths.wgsl")).text()
}

/// Splats to tiles.
pub(crate) fn bin() -> String {
    Source::new().camera().ledger().with(include_str!("shaders/bin.wgsl")).text()
}

/// Tiles' own parts of the sorted splats.
pub(crate) fn ranges() -> String {
    Source::new().ledger().with(include_str!("shaders/ranges.wgsl")).text()
}

/// Compositing.
pub(crate) fn blend(block: PixelBlock, channels: usize) -> String {
    let source = Source::new().real().camera().channels(channels).pixels(block);
    let source = source.formula(&BlendStart { block }).formula(&BlendSplat { block, channels });
    source.formula(&BlendEnd { block }).with(include_str!("shaders/blend.wgsl")).text()
}

/// The way back through compositing.
pub(crate) fn blend_vjp(block: PixelBlock, channels: usize) -> String {
    let source = Source::new()
        .real()
        .camera()
        .channels(channels)
        .count("SLOT", MOMENTS + channels)
        .count("SPLATS_AT_ONCE", splats_at_once(block, channels))
        .pixels(block)
        .formula(&ReplayStart { block, channels })
        .formula(&ReplaySplat { block, channels });
    source.with(include_str!("shaders/blend_vjp.wgsl")).text()
}

/// Sums of what [`blend_vjp`] leaves.
pub(crate) fn slots(channels: usize) -> String {
    let source = Source::new().real().camera().count("SLOT", MOMENTS + channels).count("MOMENTS", MOMENTS);
    source.formula(&MomentsVjp).with(include_str!("shaders/slots.wgsl")).text()
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
        None => source.texels(Storage::F32).with(UNLIT),
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
        None => source.texels(Storage::F32).with(UNLIT_LOOK),
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

/// Sparse matrices; texels of levels are stored so.
pub(crate) fn prefilter(storage: Storage) -> String {
    let source = Source::new().count("ROW_SUMS", ROW_SUMS).texels(storage);
    source.with(include_str!("shaders/prefilter.wgsl")).text()
}

/// Where the levels of a light lie.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LightLayout {
    /// Which roughness each level has.
    pub(crate) levels: LevelOf,
    /// First texel and resolution of each level, and of the irradiance map if there is one.
    pub(crate) places: Vec<(usize, usize)>,
    /// How their texels are stored.
    pub(crate) storage: Storage,
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
            .texels(self.storage)
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
    pub(crate) fn texel_count(&self) -> usize {
        self.places.last().map_or(0, |(first, resolution)| first + padded_len(*resolution))
    }
}

/// The way back through shading and projection; without a light, Gaussians looked none up.
pub(crate) fn gaussians_vjp(planes: &PlanesVjp, light: Option<&LightLayout>) -> String {
    let shading = &planes.shading;
    let source = Source::new()
        .real()
        .camera()
        .planes(shading.layout)
        .count("SPLAT_PLANES", GEOMETRY + shading.blended().count())
        .formula(planes);
    let source = match light {
        Some(light) => own_light(light.declare_vjp(source), shading)
            .formula(&LookupVjp(*shading))
            .formula(&SplitSumVjp)
            .with(include_str!("shaders/lit_vjp.wgsl")),
        None => source.with(UNLIT_PLANES),
    };
    source.with(include_str!("shaders/gaussians_vjp.wgsl")).text()
}

const UNLIT_PLANES: &str = "fn put_planes() {\n    planes_vjp();\n}\n";

/// Losses on attributes.
pub(crate) fn attribute_losses(losses: &AttributeLosses) -> String {
    let source = Source::new().real().planes(losses.layout);
    source
        .count("OPACITY_PLANE", OPACITY)
        .count("RESIDUAL_PLANE", NORMAL_RESIDUAL_1)
        .formula(losses)
        .with(include_str!("shaders/attributes.wgsl"))
        .text()
}

/// Adam.
pub(crate) fn optimise() -> String {
    let source = Source::new().real().formula(&AdamStep).ledger().count("GRAD_MAX_BITS", GRAD_MAX.to_bits() as usize);
    source.with(include_str!("shaders/optimise.wgsl")).text()
}

/// What a device can do at best.
pub(crate) fn ceilings() -> String {
    Source::new().with(include_str!("shaders/ceilings.wgsl")).text()
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

/// What a picture has, and which losses look at it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LossVariant {
    pub(crate) channels: usize,
    pub(crate) has_structure: bool,
    pub(crate) has_residual: bool,
    pub(crate) normals: Option<NormalForm>,
}

/// Sums over the pixels of a tile: absolute and squared losses of colour, that of coverage, that of normals.
pub(crate) const PIXEL_SUMS: usize = 4;
/// And SSIM, colour by colour.
pub(crate) const LOSS_SUMS: usize = PIXEL_SUMS + 3;

impl LossVariant {
    /// What kernels of the losses share; each invocation of a group has numbers of this type to sum.
    fn source(&self, group: usize, sum: &str) -> Source {
        let blended = Channels::of_count(self.channels);
        let place = |channel: usize| blended.index_of(channel).unwrap_or(self.channels);
        let source = Source::new().real().count("CHANNELS", self.channels).count("LOSS_GROUP", group);
        source
            .count("UNKNOWN", u32::from_le_bytes(UNKNOWN) as usize)
            .count("NORMAL_CHANNEL", place(channel::NORMAL))
            .count("DEPTH_CHANNEL", place(channel::DEPTH))
            .count("RESIDUAL_CHANNEL", place(channel::RESIDUAL_SIZE))
            .with(&format!("alias LossSum = {sum};"))
            .with(include_str!("shaders/loss.wgsl"))
    }
}

/// Invocations of a tile that look at four pixels each.
const FOUR_PIXELS_EACH: usize = (TILE_SIZE * TILE_SIZE / 4) as usize;

/// What windows of SSIM share: the type of a mean, and of those that an invocation finds below one another.
fn windows(source: Source, mean: &str, down: &str) -> Source {
    let types = format!("alias Means = {mean};\nalias MeansDown = {down};");
    let source = source.with(&types).count("SSIM_WINDOW", SSIM_WINDOW);
    source.with(include_str!("shaders/loss_windows.wgsl"))
}

/// Tiles that show something.
pub(crate) fn loss_marks(variant: &LossVariant) -> String {
    variant.source(FOUR_PIXELS_EACH, "u32").with(include_str!("shaders/loss_marks.wgsl")).text()
}

/// SSIM.
pub(crate) fn loss_structure(variant: &LossVariant) -> String {
    let source = windows(variant.source(FOUR_PIXELS_EACH, "f32"), "vec4f", "MomentsDown");
    let source = source.formula(&ComparedColors).formula(&MomentsDown).formula(&Windows::<4> { count: 4 });
    let source = source.formula(&Structure).count("FIRST_STRUCTURE_SUM", PIXEL_SUMS);
    source.with(include_str!("shaders/loss_structure.wgsl")).text()
}

/// What pictures and photographs of them share.
fn exposure(channels: usize) -> Source {
    Source::new().count("CHANNELS", channels).with(include_str!("shaders/exposure.wgsl"))
}

/// [`mod@crate::expose`]'s kernel.
pub(crate) fn expose(channels: usize) -> String {
    exposure(channels).formula(&Expose).with(include_str!("shaders/expose.wgsl")).text()
}

/// The way back through it.
pub(crate) fn expose_vjp(channels: usize) -> String {
    let source = exposure(channels).count("SUM_GROUP", FOUR_PIXELS_EACH).formula(&ExposeVjp);
    source.with(include_str!("shaders/expose_vjp.wgsl")).text()
}

/// Losses pixel by pixel.
pub(crate) fn loss_pixels(variant: &LossVariant) -> String {
    let source = windows(variant.source(FOUR_PIXELS_EACH, "vec3f"), "vec3f", "Windows38");
    source
        .flag("HAS_STRUCTURE", variant.has_structure)
        .flag("HAS_RESIDUAL", variant.has_residual)
        .formula(&ComparedColors)
        .formula(&ColorLoss)
        .formula(&WithBackground)
        .formula(&CoverageLoss)
        .formula(&Windows::<3> { count: MomentsDown::COUNT })
        .formula(&Windows::<3> { count: 4 })
        .formula(&StructureGrad)
        .with(include_str!("shaders/loss_pixels.wgsl"))
        .text()
}

/// The loss of normals.
pub(crate) fn loss_normals(variant: &LossVariant, form: NormalForm) -> String {
    let source = variant.source((TILE_SIZE * TILE_SIZE) as usize, "f32").camera();
    let source = source.formula(&NormalWeight).formula(&NormalLoss { form }).formula(&DepthGrad);
    source.with(include_str!("shaders/loss_normals.wgsl")).text()
}

/// [`mod@crate::densify`]'s look at a view.
pub(crate) fn observe(channels: usize) -> String {
    let source = Source::new().camera().ledger().with(include_str!("shaders/bits.wgsl")).formula(&GradLength);
    source.count("GRAD_PLANES", GEOMETRY + channels).with(include_str!("shaders/observe.wgsl")).text()
}

/// What becomes of each Gaussian.
pub(crate) fn densify(layout: Layout) -> String {
    let source = Source::new().real().planes(layout).with(include_str!("shaders/bits.wgsl")).actions();
    source.formula(&MeasuresOf { layout }).with(include_str!("shaders/densify.wgsl")).text()
}

/// What finds no room to grow.
pub(crate) fn densify_limit() -> String {
    Source::new().actions().with(include_str!("shaders/densify_limit.wgsl")).text()
}

/// Gaussians after densification.
pub(crate) fn densify_heirs(layout: Layout) -> String {
    let source = Source::new().planes(layout).count("MEAN", MEAN).with(include_str!("shaders/bits.wgsl"));
    source.actions().origins().formula(&CellAt).with(include_str!("shaders/densify_heirs.wgsl")).text()
}

/// Their numbers.
pub(crate) fn densify_gather(layout: Layout) -> String {
    let source = Source::new().count("PLANES", layout.plane_count()).origins();
    source.with(include_str!("shaders/densify_gather.wgsl")).text()
}

/// Parts of what was split.
pub(crate) fn densify_parts(layout: Layout) -> String {
    let source = Source::new().real().planes(layout).count("MEAN", MEAN).count("LOG_SCALE", LOG_SCALE).origins();
    source.formula(&PartOf { layout }).with(include_str!("shaders/densify_parts.wgsl")).text()
}

/// The limit of a plane.
pub(crate) fn limit_plane(layout: Layout) -> String {
    let source = Source::new().count("PLANES", layout.plane_count()).count("MEAN", MEAN);
    source.with(include_str!("shaders/limit_plane.wgsl")).text()
}

/// Numbers in a row.
pub(crate) fn numbers() -> String {
    Source::new().with(include_str!("shaders/numbers.wgsl")).text()
}
