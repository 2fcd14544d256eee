//! Losses of an image: colour, structure, coverage, normals and their smoothness; and their
//! gradients.

use crate::{
    codegen::{source::Source, uniform::uniform},
    device::{
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
        frame::{Frame, FrameGrad},
    },
};
use core::ops::Range;
use formulas::{
    Bending, BendingVjp, BlurredNormal, ColorLoss, ComparedColors, CoverageLoss, DepthGrad, Evenness, Gloss,
    MomentsDown, NormalLoss, NormalWeight, Structure, StructureGrad, UnclippedScale, UnitNormal, UnitNormalVjp,
    Windows, WithBackground,
};
use specula_core::{
    bin::{TILE_SIZE, tile_count},
    camera::Camera,
    color::{Picture, UNKNOWN, has_alpha},
    loss::{LossReport, LossWeights, NormalForm, SSIM_WINDOW, White},
    rules::{Channels, channel},
    smoothness::{BLUR_REACH, CREASE_REACH, REACHES},
};

pub mod formulas;

/// A picture to compare with.
#[derive(Debug)]
pub struct Target {
    size: [usize; 2],
    /// Red, green, blue and alpha of each pixel, a byte each, red the lowest; each followed by the
    /// unclipped colour in halves, if there is one.
    texels: Array,
    /// Whether any pixel is not opaque.
    has_alpha: bool,
    /// Whether no number of the picture is above white.
    is_clipped: bool,
}

/// Words of a pixel with an unclipped colour.
const UNCLIPPED_WORDS: usize = 3;

impl Target {
    /// Uploads a target.
    ///
    /// # Errors
    ///
    /// [`GpuError::TargetSize`] if the pixels do not fit the size; see [`Context::allocate`].
    pub(crate) fn new(context: &mut Context, picture: &Picture<'_>) -> Result<Self, GpuError> {
        let Picture { width, height, rgba, unclipped } = *picture;
        if let Some([expected, found]) = picture.wrong_len() {
            return Err(GpuError::TargetSize { width, height, expected, found });
        }
        let what = "pixels of a picture";
        let texels = match unclipped {
            None => context.upload(what, rgba)?,
            Some(colors) => {
                let pixels = rgba.as_chunks::<4>().0.iter().zip(colors);
                let words = pixels.flat_map(|(bytes, color)| {
                    let [red, green, blue] = color.map(|number| u32::from(number.to_bits()));
                    [u32::from_le_bytes(*bytes), red | green << 16, blue]
                });
                let words: Vec<u32> = words.collect();
                context.upload(what, &words)?
            }
        };
        Ok(Self { size: [width, height], texels, has_alpha: has_alpha(rgba), is_clipped: unclipped.is_none() })
    }
}

/// Variant of the kernels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LossVariant {
    pub(crate) channels: usize,
    pub(crate) has_structure: bool,
    pub(crate) has_residual: bool,
    pub(crate) normals: Option<NormalForm>,
    pub(crate) has_smoothness: bool,
    /// Meaning of white in true pictures.
    pub(crate) white: White,
}

/// Sums over the pixels of a tile: L1 and L2 losses of colour, coverage loss, normal loss,
/// smoothness.
const PIXEL_SUMS: usize = 5;
/// Index of the smoothness among them.
const SMOOTHNESS_SUM: usize = 4;
/// Planes of numbers of the smoothness: unit normals, blurred normals, weights.
const SMOOTHNESS_PLANES: usize = 7;
/// Sums over the pixels of a tile, with SSIM of each colour.
const LOSS_SUMS: usize = PIXEL_SUMS + 3;
/// Invocations of a tile that process four pixels each.
const FOUR_PIXELS_EACH: usize = (TILE_SIZE * TILE_SIZE / 4) as usize;

impl LossVariant {
    fn is_unclipped(&self) -> bool {
        self.white == White::Unclipped
    }

    /// Declarations of all kernels; `sum` is the type that the `group` invocations of a tile sum.
    fn source(&self, group: usize, sum: &str) -> Source {
        let blended = Channels::of_count(self.channels);
        let index = |channel: usize| blended.index_of(channel).unwrap_or(self.channels);
        Source::new()
            .real()
            .count("CHANNELS", self.channels)
            .count("LOSS_GROUP", group)
            .flag("IS_UNCLIPPED", self.is_unclipped())
            .count("TEXEL_WORDS", if self.is_unclipped() { UNCLIPPED_WORDS } else { 1 })
            .count("UNKNOWN", u32::from_le_bytes(UNKNOWN) as usize)
            .count("COLOR_CHANNEL", channel::COLOR)
            .count("NORMAL_CHANNEL", index(channel::NORMAL))
            .count("DEPTH_CHANNEL", index(channel::DEPTH))
            .count("RESIDUAL_CHANNEL", index(channel::RESIDUAL_SIZE))
            .count("ROUGHNESS_CHANNEL", index(channel::ROUGHNESS))
            .with(&format!("alias LossSum = {sum};"))
            .uniform::<LossSettings>()
            .with(include_str!("loss.wgsl"))
    }
}

/// Appends the windows of SSIM over means of type `mean`; the kernel must have the formulas
/// `means_down` and [`means_across`], and the function `tap_at`.
fn windows(source: Source, mean: &str) -> Source {
    source.with(&format!("alias Means = {mean};")).count("SSIM_WINDOW", SSIM_WINDOW).with(include_str!("windows.wgsl"))
}

/// Means of the windows of an invocation's four pixels.
const fn means_across<const N: usize>() -> Windows<N> {
    Windows { name: "means_across", count: 4 }
}

pub(crate) fn mark_source(variant: &LossVariant) -> String {
    variant.source(FOUR_PIXELS_EACH, "u32").with(include_str!("marks.wgsl")).text()
}

pub(crate) fn structure_source(variant: &LossVariant) -> String {
    windows(variant.source(FOUR_PIXELS_EACH, "f32"), "vec4f")
        .formula(&ComparedColors { white: variant.white })
        .formula(&MomentsDown)
        .formula(&means_across::<4>())
        .formula(&Structure)
        .count("FIRST_STRUCTURE_SUM", PIXEL_SUMS)
        .with(include_str!("structure.wgsl"))
        .text()
}

pub(crate) fn pixel_source(variant: &LossVariant) -> String {
    windows(variant.source(FOUR_PIXELS_EACH, "vec3f"), "vec3f")
        .flag("HAS_STRUCTURE", variant.has_structure)
        .flag("HAS_RESIDUAL", variant.has_residual)
        .formula(&ComparedColors { white: variant.white })
        .formula(&UnclippedScale)
        .formula(&ColorLoss)
        .formula(&WithBackground)
        .formula(&CoverageLoss)
        .formula(&Windows::<3> { name: "means_down", count: MomentsDown::COUNT })
        .formula(&means_across::<3>())
        .formula(&StructureGrad { white: variant.white })
        .with(include_str!("pixels.wgsl"))
        .text()
}

pub(crate) fn normal_source(variant: &LossVariant, form: NormalForm) -> String {
    variant
        .source((TILE_SIZE * TILE_SIZE) as usize, "f32")
        .part(camera)
        .formula(&NormalWeight)
        .formula(&NormalLoss { form })
        .formula(&DepthGrad)
        .with(include_str!("normals.wgsl"))
        .text()
}

/// Kernels of the smoothness of normals; pixels have gloss if light was added per pixel.
pub(crate) fn smoothness_source(variant: &LossVariant, has_gloss: bool) -> String {
    let [near, far] = REACHES;
    variant
        .source((TILE_SIZE * TILE_SIZE) as usize, "f32")
        .part(camera)
        .count("NEAR_REACH", near)
        .count("FAR_REACH", far)
        .count("CREASE_REACH", CREASE_REACH)
        .count("BLUR_REACH", BLUR_REACH)
        .count("SMOOTHNESS_SUM", SMOOTHNESS_SUM)
        .flag("HAS_GLOSS", has_gloss)
        .formula(&Gloss)
        .formula(&UnitNormal)
        .formula(&UnitNormalVjp)
        .formula(&BlurredNormal)
        .formula(&Evenness)
        .formula(&Bending)
        .formula(&BendingVjp)
        .with(include_str!("smoothness.wgsl"))
        .text()
}

uniform! {
    /// Weights of the losses over the numbers of values that they are means of.
    struct LossSettings {
        background: [f32; 3],
        absolute: f32,
        squared: f32,
        structure: f32,
        coverage: f32,
        sparse_coverage: f32,
        residual_image: f32,
        normal: f32,
        size: [u32; 2],
        tiles: [u32; 2],
        smoothness: f32,
        padding: u32,
    }
}

impl LossSettings {
    fn new([width, height]: [usize; 2], weights: &LossWeights, background: [f32; 3]) -> Self {
        let share = |weight: f32, values: usize| weight / (values * width * height) as f32;
        let size = [width as u32, height as u32];
        Self {
            background,
            absolute: share(weights.absolute, 3),
            squared: share(weights.squared, 3),
            structure: share(-weights.dssim, 3),
            coverage: share(weights.coverage, 1),
            sparse_coverage: share(weights.sparse_coverage, 1),
            residual_image: share(weights.residual_image, 1),
            normal: share(weights.normal, 1),
            size,
            tiles: size.map(tile_count),
            smoothness: share(weights.smoothness, REACHES.len()),
            padding: 0,
        }
    }
    fn tile_count(&self) -> usize {
        self.tiles[0] as usize * self.tiles[1] as usize
    }
}

/// Losses of an image on the device.
#[derive(Debug)]
pub(crate) struct Losses {
    /// Sums over each tile: one row of tiles for each kind of loss.
    sums: Array,
    pixel_count: usize,
    weights: LossWeights,
    variant: LossVariant,
}

impl Losses {
    /// The sums on the device.
    pub(crate) fn sums(&self) -> &Array {
        &self.sums
    }

    /// Losses from the downloaded sums, added over the tiles in their order.
    pub(crate) fn report(&self, sums: &[f32]) -> LossReport {
        let tiles = sums.len() / LOSS_SUMS;
        let mean = |kinds: Range<usize>, is_known: bool| {
            let sum: f64 = sums[kinds.start * tiles..kinds.end * tiles].iter().map(|sum| f64::from(*sum)).sum();
            if is_known { sum / self.pixel_count as f64 } else { 0.0 }
        };
        let report = LossReport {
            absolute: mean(0..1, true) / 3.0,
            squared: mean(1..2, true) / 3.0,
            coverage: mean(2..3, self.weights.coverage != 0.0),
            normal: mean(3..SMOOTHNESS_SUM, self.variant.normals.is_some()),
            smoothness: mean(SMOOTHNESS_SUM..PIXEL_SUMS, self.variant.has_smoothness),
            ssim: mean(PIXEL_SUMS..LOSS_SUMS, self.variant.has_structure) / 3.0,
            ..LossReport::default()
        };
        report.with_total(&self.weights)
    }
}

/// Inputs and outputs of the kernels.
struct Comparison<'a> {
    frame: &'a Frame,
    target: &'a Target,
    camera: &'a Camera,
    settings: LossSettings,
    variant: LossVariant,
    /// Marks of each tile: whether anything but the background is visible.
    marks: Array,
    /// Gradients of the means of SSIM's windows, three planes for each colour.
    partials: Array,
    /// Gradient of the image.
    grads: Array,
    /// Sums over each tile: one row of tiles for each kind of loss.
    sums: Array,
}

/// Losses of a frame, and their gradient.
///
/// # Errors
///
/// [`GpuError::FrameSize`] if frame and target differ in size; see [`Context::allocate`] and
/// [`Context::dispatch`].
pub(crate) fn loss(
    context: &mut Context,
    frame: &Frame,
    target: &Target,
    camera: &Camera,
    weights: &LossWeights,
    background: [f32; 3],
) -> Result<(FrameGrad, Losses), GpuError> {
    if target.size != frame.size {
        return Err(GpuError::FrameSize { expected: target.size, found: frame.size });
    }
    let has_geometry = Channels::of_count(frame.channels).contain(channel::DEPTH);
    let weights = weights.where_possible(target.has_alpha, has_geometry);
    let comparison = Comparison::new(context, frame, target, camera, &weights, background)?;
    comparison.dispatch(context)?;
    let Comparison { grads, sums, variant, .. } = comparison;
    let losses = Losses { sums, pixel_count: frame.pixel_count(), weights, variant };
    Ok((FrameGrad { size: frame.size, channels: frame.channels, values: grads }, losses))
}

impl<'a> Comparison<'a> {
    fn new(
        context: &mut Context,
        frame: &'a Frame,
        target: &'a Target,
        camera: &'a Camera,
        weights: &LossWeights,
        background: [f32; 3],
    ) -> Result<Self, GpuError> {
        let settings = LossSettings::new(frame.size, weights, background);
        let variant = LossVariant {
            channels: frame.channels,
            has_structure: weights.dssim != 0.0,
            has_residual: weights.residual_image != 0.0,
            normals: (weights.normal != 0.0).then_some(weights.normal_form),
            has_smoothness: weights.smoothness != 0.0,
            white: weights.white(target.is_clipped),
        };
        let partial_planes = if variant.has_structure { 9 } else { 0 };
        Ok(Self {
            frame,
            target,
            camera,
            settings,
            variant,
            marks: context.allocate("marks of tiles", settings.tile_count())?,
            partials: context.allocate("gradients of windows", partial_planes * frame.pixel_count())?,
            grads: context.zeros("the gradient of a picture", (frame.channels + 1) * frame.pixel_count())?,
            sums: context.allocate("sums of tiles", LOSS_SUMS * settings.tile_count())?,
        })
    }

    fn dispatch(&self, context: &mut Context) -> Result<(), GpuError> {
        let Self { variant, settings, .. } = self;
        let settings = Uniform(settings.bytes());
        let [blended, colors, texels] = [&self.frame.blended, self.frame.color(), &self.target.texels].map(Buffer);
        let [marks, partials, grads, sums] = [&self.marks, &self.partials, &self.grads, &self.sums].map(Buffer);
        let key = format!("{variant:?}");
        let [columns, rows] = self.settings.tiles;
        let tiles = Dispatch::Grid([columns, rows]);

        let source = || mark_source(variant);
        context.dispatch(&key, "mark_tiles", &source, &[settings, blended, colors, texels, marks], tiles)?;
        if variant.has_structure {
            let source = || structure_source(variant);
            let bindings = [settings, blended, colors, texels, marks, partials, sums];
            context.dispatch(&key, "compare_structure", &source, &bindings, Dispatch::Grid([3 * columns, rows]))?;
        }
        let source = || pixel_source(variant);
        let bindings = [settings, blended, colors, texels, marks, partials, grads, sums];
        context.dispatch(&key, "compare_pixels", &source, &bindings, tiles)?;
        if let Some(form) = variant.normals {
            let view = CameraUniform::new(self.camera, 0);
            let source = || normal_source(variant, form);
            let bindings = [settings, blended, colors, texels, marks, grads, sums, Uniform(view.bytes())];
            context.dispatch(&key, "compare_normals", &source, &bindings, tiles)?;
        }
        if variant.has_smoothness {
            let view = CameraUniform::new(self.camera, 0);
            let has_roughness = Channels::of_count(self.frame.channels).contain(channel::ROUGHNESS);
            let has_gloss = self.frame.shaded.is_some() && has_roughness;
            let key = format!("{key}, {has_gloss}");
            let source = || smoothness_source(variant, has_gloss);
            let planes = context.allocate("normals of a picture", SMOOTHNESS_PLANES * self.frame.pixel_count())?;
            let shaded = Buffer(self.frame.color_before_exposure());
            let bindings =
                [settings, blended, shaded, texels, marks, Buffer(&planes), grads, sums, Uniform(view.bytes())];
            for entry in ["blur_normals", "weigh_normals", "smooth_normals"] {
                context.dispatch(&key, entry, &source, &bindings, tiles)?;
            }
        }
        Ok(())
    }
}
