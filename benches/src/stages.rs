//! The stages of a picture and of a step of training, one by one, on any executor.

use crate::scene::{LIGHT, Scene, View};
use core::{cell::RefCell, fmt};
use specula_core::{
    cubemap::FACE_COUNT,
    executor::{Executor, Renderer},
    pack::{FULL_PLANES, Storage},
    pipeline::render,
    prefilter::LevelRange,
    rules::{Channels, RenderRules},
    scene::{DIFFUSE, Layout},
    state::SceneState,
};

/// A stage, or all stages of a picture or of a step. [`measure_picture`] measures those up to
/// `Frame`, [`measure_step`] the others but `TrainStep`, which is
/// [`Scene::train`](crate::scene::Scene::train); `Trace` needs a near field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "they are named as core's methods are")]
pub enum Stage {
    Prefilter,
    Project,
    Shade,
    Bin,
    Blend,
    Trace,
    ShadePixels,
    Frame,
    Loss,
    ShadePixelsVjp,
    BlendVjp,
    GaussiansVjp,
    PrefilterVjp,
    Optimise,
    TrainStep,
}

impl Stage {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Prefilter => "prefilter",
            Self::Project => "project",
            Self::Shade => "shade",
            Self::Bin => "bin",
            Self::Blend => "blend",
            Self::Trace => "trace",
            Self::ShadePixels => "shade_pixels",
            Self::Frame => "frame",
            Self::Loss => "loss",
            Self::ShadePixelsVjp => "shade_pixels_vjp",
            Self::BlendVjp => "blend_vjp",
            Self::GaussiansVjp => "gaussians_vjp",
            Self::PrefilterVjp => "prefilter_vjp",
            Self::Optimise => "optimise",
            Self::TrainStep => "train_step",
        }
    }
}

/// Amount of blending in a picture: for the throughput of blending, which is 0 for zeros.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Splats in tiles.
    pub intersections: usize,
    /// Pixels of quads that a splat may touch, for all splats before their tile has ended: what
    /// kernels evaluate.
    pub processed: usize,
    /// Pixels that a splat is seen in.
    pub significant: usize,
}

impl fmt::Display for Work {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { intersections, processed, significant } = self;
        write!(out, "{intersections} splats in tiles, {processed} pairs of pixel and splat, {significant} seen")
    }
}

/// Sizes of a scene, which determine the work of its stages.
#[derive(Clone, Copy, Debug)]
pub struct Amounts {
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Planes of the Gaussians.
    pub layout: Layout,
    /// Storage of the Gaussians.
    pub storage: Storage,
    /// Pixels of the picture.
    pub pixels: usize,
    /// Rendering rules.
    pub rules: RenderRules,
    /// Work of blending.
    pub work: Work,
}

/// Bytes of a number.
const NUMBER: usize = size_of::<f32>();
/// Numbers of a splat on a device: its geometry, its depth and how many tiles it touches.
const SPLAT: usize = 14;
/// Numbers of a splat's gradient beside those of its channels.
const GEOMETRY: usize = 6;

impl Amounts {
    /// Unit of throughput: Gaussians, pixels, texels, pairs of a pixel and a splat, or steps.
    pub fn elements(&self, stage: Stage) -> usize {
        match stage {
            Stage::Prefilter | Stage::PrefilterVjp => FACE_COUNT * LIGHT * LIGHT,
            Stage::Project | Stage::Shade | Stage::Bin | Stage::GaussiansVjp | Stage::Optimise => self.gaussians,
            Stage::Blend | Stage::BlendVjp => self.work.processed,
            Stage::Trace | Stage::ShadePixels | Stage::Frame | Stage::Loss | Stage::ShadePixelsVjp => self.pixels,
            Stage::TrainStep => 1,
        }
    }

    /// Bytes that a stage has to read and write once, on a device: an estimate, without the light,
    /// which stays in caches. `None` where several kernels pass over the same memory repeatedly, so
    /// that the count would mean little.
    pub fn bytes(&self, stage: Stage) -> Option<usize> {
        let Self { gaussians, layout, pixels, work: Work { intersections, .. }, .. } = *self;
        let channels = self.rules.blended(layout).count();
        // Of a pixel: its channels and the transmittance; of a splat in a tile: its number, itself
        // and its channels.
        let (pixel, splat) = (channels + 1, 1 + SPLAT - 2 + channels.next_multiple_of(4));
        let grad = GEOMETRY + channels;
        let numbers = match stage {
            Stage::Project => gaussians * (self.words_of(DIFFUSE) + SPLAT),
            Stage::Shade => {
                gaussians * (self.words_of(self.rules.numbers_read(layout)) + 1 + channels.next_multiple_of(4))
            }
            Stage::Blend => intersections * splat + pixels * pixel,
            Stage::ShadePixels => pixels * (pixel + 3),
            Stage::ShadePixelsVjp => pixels * 3 * pixel,
            Stage::BlendVjp => intersections * (splat + 2 * grad) + pixels * 2 * pixel + gaussians * grad,
            Stage::GaussiansVjp => gaussians * (self.rules.numbers_read(layout) + grad + layout.plane_count()),
            // A gradient is read; numbers and two means are read and written.
            Stage::Optimise => gaussians * 7 * layout.plane_count(),
            _ => return None,
        };
        Some(NUMBER * numbers)
    }

    /// Words that this many numbers of a Gaussian take, its means among them.
    fn words_of(&self, numbers: usize) -> usize {
        match self.storage {
            Storage::F32 => numbers,
            Storage::F16 => FULL_PLANES + (numbers - FULL_PLANES).div_ceil(2),
        }
    }

    /// Operations of a stage, counted from core's formulas: for each pair the offset (2), the
    /// exponent (4), 2ˣ (16), α (2), the step (5) and a multiply-add for each channel; 49 and two
    /// for each channel in the backward pass; for each pixel and colour of SSIM 520.
    pub fn operations(&self, stage: Stage) -> Option<usize> {
        let channels = self.rules.blended(self.layout).count();
        match stage {
            Stage::Blend => Some(self.work.processed * (29 + 2 * channels)),
            Stage::BlendVjp => Some(self.work.processed * (49 + 4 * channels)),
            Stage::Loss => Some(self.pixels * 3 * 520),
            _ => None,
        }
    }
}

/// Measures stages.
pub trait Meter<E: Renderer> {
    /// Measures a stage any number of times, without its preparation `prepare`.
    ///
    /// # Errors
    ///
    /// Any error of the executor.
    fn measure<I, O>(
        &mut self,
        exec: &mut E,
        stage: Stage,
        prepare: impl FnMut(&mut E) -> Result<I, E::Error>,
        run: impl FnMut(&mut E, I) -> Result<O, E::Error>,
    ) -> Result<(), E::Error>;
}

fn nothing<E: Renderer>(_: &mut E) -> Result<(), E::Error> {
    Ok(())
}

/// Measures the stages of a picture, then all of them together for only its colours.
///
/// # Errors
///
/// Any error of the executor.
pub fn measure_picture<E: Renderer>(
    exec: &mut E,
    view: &View<'_, E>,
    meter: &mut impl Meter<E>,
) -> Result<(), E::Error> {
    let View { cloud, light, camera, rules } = *view;
    let mut splats = exec.project(cloud, camera)?;
    let colors = exec.shade(cloud, camera, &mut splats, light, rules)?;
    let tiles = exec.bin(&splats, camera)?;

    meter.measure(exec, Stage::Project, nothing, |exec, ()| exec.project(cloud, camera))?;
    meter.measure(exec, Stage::Shade, nothing, |exec, ()| exec.shade(cloud, camera, &mut splats, light, rules))?;
    let blend = |exec: &mut E| exec.blend(&splats, &colors, &tiles, camera);
    meter.measure(exec, Stage::Bin, nothing, |exec, ()| exec.bin(&splats, camera))?;
    meter.measure(exec, Stage::Blend, nothing, |exec, ()| blend(exec))?;
    if rules.is_deferred(cloud.layout) {
        meter.measure(exec, Stage::ShadePixels, blend, |exec, frame| exec.shade_pixels(frame, light, camera, rules))?;
    }
    let rules = RenderRules { channels: Channels::Color, ..*rules };
    meter.measure(exec, Stage::Frame, nothing, |exec, ()| render(exec, cloud, light, camera, &rules))
}

/// Measures the other stages of a step: the light, the loss, and the backward pass to an update
/// that changes nothing.
///
/// # Errors
///
/// Any error of the executor.
pub fn measure_step<E: Executor>(
    exec: &mut E,
    scene: &mut Scene<E>,
    meter: &mut impl Meter<E>,
) -> Result<(), E::Error> {
    let light = scene.filtered(exec)?;
    let light = light.as_ref();
    let around = scene.surrounded(exec)?;
    let Scene { rules, weights, camera, state, target, rates, .. } = scene;
    let SceneState { gaussians: cloud, moments, light: sky, .. } = state;
    let (camera, rules, weights) = (&*camera, &*rules, &*weights);
    let mut splats = exec.project(cloud, camera)?;
    let colors = exec.shade(cloud, camera, &mut splats, light, rules)?;
    let tiles = exec.bin(&splats, camera)?;
    let mut frame = exec.blend(&splats, &colors, &tiles, camera)?;
    let is_deferred = rules.is_deferred(cloud.layout);
    if is_deferred {
        if let Some(around) = &around {
            let blend = |exec: &mut E| exec.blend(&splats, &colors, &tiles, camera);
            meter.measure(exec, Stage::Trace, blend, |exec, frame| exec.trace(frame, around, camera))?;
        }
        frame = exec.shade_pixels(frame, light, camera, rules)?;
    }
    let loss = |exec: &mut E| exec.loss(&frame, target, camera, weights, [1.0; 3]);
    meter.measure(exec, Stage::Loss, nothing, |exec, ()| loss(exec))?;

    let (mut frame_grad, mut light_grad) = (loss(exec)?, None);
    if is_deferred {
        let back = |exec: &mut E, grad| exec.shade_pixels_vjp(&frame, light, camera, rules, grad);
        meter.measure(exec, Stage::ShadePixelsVjp, loss, back)?;
        (frame_grad, light_grad) = back(exec, frame_grad)?;
    }
    let blend_vjp = |exec: &mut E| exec.blend_vjp(&splats, &colors, &tiles, &frame, &frame_grad, camera);
    meter.measure(exec, Stage::BlendVjp, nothing, |exec, ()| blend_vjp(exec))?;

    let grads = blend_vjp(exec)?;
    // Gradients are made of the very Gaussians that are updated.
    let cloud = RefCell::new(cloud);
    let back = |exec: &mut E| exec.gaussians_vjp(&**cloud.borrow(), camera, &splats, light, rules, weights, &grads);
    meter.measure(exec, Stage::GaussiansVjp, nothing, |exec, ()| back(exec))?;
    meter.measure(
        exec,
        Stage::Optimise,
        |exec| back(exec).map(|(grad, _)| grad),
        |exec, grad| exec.optimise(&mut **cloud.borrow_mut(), moments, grad, rates, 1),
    )?;

    light_grad = light_grad.or(back(exec)?.1);
    if let (Some((environment, _)), Some(light), Some(grad)) = (sky, light, &light_grad) {
        let (scheme, levels) = (rules.scheme, LevelRange::ALL);
        meter.measure(exec, Stage::Prefilter, nothing, |exec, ()| exec.prefilter(environment, scheme, levels))?;
        meter.measure(exec, Stage::PrefilterVjp, nothing, |exec, ()| exec.prefilter_vjp(environment, light, grad))?;
    }
    Ok(())
}
