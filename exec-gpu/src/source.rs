//! Sources of kernels: constants from core, functions from formulas, and the files that schedule them.

use crate::{
    blend_vjp::GEOMETRY,
    formula::{Formula, function, type_of},
    formulas::{
        BlendStep, ColorOfPixel, ColorsOf, Exp2Fraction, LevelOf, LitColorsOf, Log2Mantissa, ShadingOf, SplatOf,
        StrengthAt, SurfaceOf, SurfaceOfPixel, TexelsAt,
        densify::{CellAt, GradLength, MeasuresOf, PartOf},
    },
    kernel::GROUP,
    trace::literal,
};
use core::fmt::Write;
use specula_core::{
    bin::{ALPHA_MIN, TILE_SIZE},
    blend::ROOT_SCALE,
    densify::Action,
    plan::{Channels, channel},
    real::{EXP2_MAX, EXP2_MIN},
    scene::{BLOCK, LOG_SCALE, Layout, MEAN},
    shade::ShadingForm,
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
    let source = Source::new().count("SORT_GROUP", SORT_GROUP).count("DIGIT_BITS", DIGIT_BITS as usize);
    source.with(include_str!("shaders/sort.wgsl")).text()
}

/// Depths as keys.
pub(crate) fn depths() -> String {
    Source::new().with(include_str!("shaders/depths.wgsl")).text()
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

const LIT: &str =
    "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return radiance(direction, roughness);\n}\n";
const UNLIT: &str = "fn light_of(direction: vec3f, roughness: f32) -> vec3f {\n    return vec3f(0.0);\n}\n";

/// A light's numbers to radiance.
pub(crate) fn activate() -> String {
    Source::new().real().with(include_str!("shaders/activate.wgsl")).text()
}

/// Sparse matrices.
pub(crate) fn prefilter() -> String {
    Source::new().with(include_str!("shaders/prefilter.wgsl")).text()
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
}

/// Statements for every row of `inputs`, which write a row of `outputs`.
pub(crate) fn probe(statements: &str) -> String {
    let source = Source::new().real();
    source.with(&include_str!("shaders/probe.wgsl").replace("    // STATEMENTS\n", statements)).text()
}

/// [`mod@crate::densify`]'s look at a view.
pub(crate) fn observe(channels: usize) -> String {
    let source = Source::new().camera().with(include_str!("shaders/bits.wgsl")).formula(&GradLength);
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
    let source = Source::new().count("PLANES", layout.plane_count());
    source.with(include_str!("shaders/limit_plane.wgsl")).text()
}

/// Numbers in a row.
pub(crate) fn numbers() -> String {
    Source::new().with(include_str!("shaders/numbers.wgsl")).text()
}
