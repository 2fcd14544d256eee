//! A picture against what it should be: colour, structure, normals, coverage, and their gradients.

use crate::{
    blend::Frame,
    blend_vjp::FrameGrad,
    device::GpuError,
    executor::GpuExecutor,
    kernel::{
        Bound::{Array as Of, Uniform},
        Groups,
    },
    machine::Machine,
    memory::Array,
    source::{self, LOSS_SUMS, LossVariant, PIXEL_SUMS},
    view::View,
};
use bytemuck::{Pod, Zeroable};
use core::ops::Range;
use specula_core::{
    bin::tile_count,
    camera::Camera,
    color::has_alpha,
    loss::{LossReport, LossWeights},
    rules::{Channels, channel},
};

/// A picture to compare with: 8-bit sRGB with straight alpha.
#[derive(Debug)]
pub struct Target {
    size: [usize; 2],
    /// Red, green, blue and alpha of each pixel, a byte each, red the lowest.
    texels: Array,
    /// Whether any pixel is not opaque.
    has_alpha: bool,
}

impl Target {
    pub(crate) fn new(machine: &mut Machine, size: [usize; 2], rgba: &[u8]) -> Result<Self, GpuError> {
        let [width, height] = size;
        let expected = 4 * width * height;
        if rgba.len() != expected {
            return Err(GpuError::TargetSize { width, height, expected, found: rgba.len() });
        }
        Ok(Self { size, texels: machine.upload("pixels of a picture", rgba)?, has_alpha: has_alpha(rgba) })
    }
}

/// `LossSettings` of `loss.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
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
    padding: [u32; 2],
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
            padding: [0; 2],
        }
    }
    fn tile_count(&self) -> usize {
        self.tiles[0] as usize * self.tiles[1] as usize
    }
}

/// Losses of a picture where they are, on the device.
#[derive(Debug)]
pub(crate) struct Losses {
    /// What the pixels of each tile came to: a row of tiles' sums for each kind.
    sums: Array,
    pixel_count: usize,
    weights: LossWeights,
    variant: LossVariant,
}

impl Losses {
    /// What has to be read.
    pub(crate) fn sums(&self) -> &Array {
        &self.sums
    }

    /// Sums over the tiles, in their order.
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
            normal: mean(3..PIXEL_SUMS, self.variant.normals.is_some()),
            ssim: mean(PIXEL_SUMS..LOSS_SUMS, self.variant.has_structure) / 3.0,
            ..LossReport::default()
        };
        report.with_total(&self.weights)
    }
}

/// What is compared, and how.
struct Comparison<'a> {
    frame: &'a Frame,
    target: &'a Target,
    camera: &'a Camera,
    settings: LossSettings,
    variant: LossVariant,
    /// For each tile whether it shows anything but the background.
    marks: Array,
    /// Gradients of the windows' means, three planes for each colour.
    partials: Array,
    /// The gradient of the picture.
    grads: Array,
    /// What the pixels of each tile came to: a row of tiles' sums for each kind.
    sums: Array,
}

pub(crate) fn loss(
    machine: &mut Machine,
    frame: &Frame,
    target: &Target,
    camera: &Camera,
    weights: &LossWeights,
    background: [f32; 3],
) -> Result<FrameGrad, GpuError> {
    if target.size != frame.size {
        return Err(GpuError::FrameSize { expected: target.size, found: frame.size });
    }
    let has_geometry = Channels::of_count(frame.channels).index_of(channel::DEPTH).is_some();
    let weights = weights.where_possible(target.has_alpha, has_geometry);
    let comparison = Comparison::new(machine, frame, target, camera, &weights, background)?;
    comparison.run(machine)?;
    let Comparison { grads, sums, variant, .. } = comparison;
    machine.losses = Some(Losses { sums, pixel_count: frame.pixel_count(), weights, variant });
    Ok(FrameGrad { size: frame.size, channels: frame.channels, values: grads })
}

impl<'a> Comparison<'a> {
    fn new(
        machine: &mut Machine,
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
        };
        let partial_planes = if variant.has_structure { 9 } else { 0 };
        Ok(Self {
            frame,
            target,
            camera,
            settings,
            variant,
            marks: machine.take("marks of tiles", settings.tile_count())?,
            partials: machine.take("gradients of windows", partial_planes * frame.pixel_count())?,
            grads: machine.zeros("the gradient of a picture", (frame.channels + 1) * frame.pixel_count())?,
            sums: machine.take("sums of tiles", LOSS_SUMS * settings.tile_count())?,
        })
    }

    fn run(&self, machine: &mut Machine) -> Result<(), GpuError> {
        let Self { variant, settings, .. } = self;
        let settings = Uniform(bytemuck::bytes_of(settings));
        let [blended, colors, texels] = [&self.frame.blended, self.frame.color(), &self.target.texels].map(Of);
        let [marks, partials, grads, sums] = [&self.marks, &self.partials, &self.grads, &self.sums].map(Of);
        let key = format!("{variant:?}");
        let [columns, rows] = self.settings.tiles;
        let tiles = Groups::Grid([columns, rows]);

        let source = || source::loss_marks(variant);
        machine.run(&key, "mark_tiles", &source, &[settings, blended, colors, texels, marks], tiles)?;
        if variant.has_structure {
            let source = || source::loss_structure(variant);
            let bound = [settings, blended, colors, texels, marks, partials, sums];
            machine.run(&key, "compare_structure", &source, &bound, Groups::Grid([3 * columns, rows]))?;
        }
        let source = || source::loss_pixels(variant);
        let bound = [settings, blended, colors, texels, marks, partials, grads, sums];
        machine.run(&key, "compare_pixels", &source, &bound, tiles)?;
        if let Some(form) = variant.normals {
            let view = View::new(self.camera, 0);
            let source = || source::loss_normals(variant, form);
            let bound = [settings, blended, colors, texels, marks, grads, sums, Uniform(view.bytes())];
            machine.run(&key, "compare_normals", &source, &bound, tiles)?;
        }
        Ok(())
    }
}

impl GpuExecutor {
    /// A gradient back to the host, plane by plane, as [`specula_core::executor::Renderer::read_frame`] gives the frame
    /// that it belongs to.
    pub fn read_frame_grad(&mut self, grad: &FrameGrad, values: &mut [f32]) -> Result<(), GpuError> {
        self.machine.download(&grad.values, 0, values)
    }
}
