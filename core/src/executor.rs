//! The contract between the pipeline and a machine that runs it: one method for each stage.

use crate::{
    camera::Camera,
    densify::DensifyRules,
    expose::Exposure,
    loss::{LossReport, LossWeights},
    prefilter::{LevelRange, PrefilterScheme},
    region::Ball,
    rules::RenderRules,
    scene::{Environment, Gaussians},
    state::{AdamMoments, Statistics},
};

/// Length of a host buffer that does not fit the array or the frame that is read into it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferLength {
    /// Numbers that are read.
    pub expected: usize,
    /// Numbers that the buffer holds.
    pub found: usize,
}

impl BufferLength {
    /// Compares a buffer with what is read into it.
    ///
    /// # Errors
    ///
    /// Both lengths, where they differ.
    pub const fn check(expected: usize, buffer: &[f32]) -> Result<(), Self> {
        if buffer.len() == expected { Ok(()) } else { Err(Self { expected, found: buffer.len() }) }
    }
}

impl core::fmt::Display for BufferLength {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { expected, found } = self;
        write!(
            out,
            "a buffer of {found} numbers was given for {expected}; a frame has width × height numbers for each channel \
             that was blended (RenderRules::blended) and for transmittance"
        )
    }
}

impl core::error::Error for BufferLength {}

/// Counts of one densification.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensifyReport {
    /// Gaussians that were copied.
    pub cloned: usize,
    /// Gaussians that became two.
    pub split: usize,
    /// Gaussians that were removed.
    pub pruned: usize,
}

/// A number of randomness: equal keys give equal draws on every machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RandomKey {
    /// The run's seed.
    pub seed: u64,
    /// Stream of draws, such as an iteration.
    pub stream: u64,
}

/// A picture to fit, and how.
#[derive(Debug)]
pub struct TrainingStep<'a, E: Executor> {
    /// From where.
    pub camera: &'a Camera,
    /// The picture that was taken there.
    pub target: &'a E::Target,
    /// Behind the Gaussians, sRGB.
    pub background: [f32; 3],
    /// Exposure of the photograph; none where colours are compared unchanged.
    pub exposure: Option<&'a Exposure<f32>>,
    /// Rendering rules.
    pub rules: &'a RenderRules,
    /// Weights of the losses.
    pub weights: &'a LossWeights,
    /// Learning rate of every plane.
    pub rates: &'a [f32],
    /// Learning rate of the light.
    pub environment_rate: f32,
    /// Largest radiance that the light keeps.
    pub radiance_max: f32,
    /// Number of this step, from 1.
    pub number: u32,
}

/// Results of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// The losses before the step.
    pub loss: LossReport,
    /// Gradients that were not finite, and left out.
    pub nonfinite: usize,
    /// The gradient of the exposure, if there was one.
    pub exposure: Option<Exposure<f64>>,
}

/// A machine that can run the stages that make a picture. Arrays and the results of stages are its
/// own types.
///
/// Stages compute the same thing on every executor, up to rounding; each is deterministic. The
/// results of a stage go to later stages of the same executor, together with the very Gaussians and
/// camera that they came from.
pub trait Renderer {
    /// `f32` numbers where this executor keeps them.
    type Array;
    /// A light filtered into levels.
    type Light;
    /// Gaussians on the screen.
    type Splats;
    /// Their channels.
    type Colors;
    /// Splats of each tile, front to back.
    type Tiles;
    /// A blended picture: premultiplied channels and transmittance.
    type Frame;
    /// Why a stage could not run.
    type Error;

    /// Numbers to the executor.
    fn upload(&mut self, values: &[f32]) -> Result<Self::Array, Self::Error>;
    /// Gaussians to the executor, and whatever else has the same planes, such as their moments. It
    /// may keep so many as a single array of its own does not hold.
    fn upload_gaussians<A: AsRef<[f32]>>(
        &mut self,
        gaussians: &Gaussians<A>,
    ) -> Result<Gaussians<Self::Array>, Self::Error> {
        Ok(gaussians.with_values(self.upload(gaussians.values.as_ref())?))
    }
    /// Numbers back to the host.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where `values` has not the array's length.
    fn download(&mut self, array: &Self::Array, values: &mut [f32]) -> Result<(), Self::Error>;
    /// A frame back to the host: its channels, then its transmittance, plane by plane. Its channels
    /// are those of [`RenderRules::blended`], which are more than was asked for where light is
    /// looked up per pixel.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where `values` has another length.
    fn read_frame(&mut self, frame: &Self::Frame, values: &mut [f32]) -> Result<(), Self::Error>;

    /// Light into those roughness levels that are looked up; others are zero, or filtered as well.
    fn prefilter(
        &mut self,
        environment: &Environment<Self::Array>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Self::Light, Self::Error>;
    /// Gaussians to splats. What is not finite in place, shape or opacity is not drawn.
    fn project(&mut self, gaussians: &Gaussians<Self::Array>, camera: &Camera) -> Result<Self::Splats, Self::Error>;
    /// Splats to channels. Without a light there is no specular term. Splats of Gaussians whose
    /// attributes are not finite, of those that the rules ask for, are not drawn from here on.
    fn shade(
        &mut self,
        gaussians: &Gaussians<Self::Array>,
        camera: &Camera,
        splats: &mut Self::Splats,
        light: Option<&Self::Light>,
        rules: &RenderRules,
    ) -> Result<Self::Colors, Self::Error>;
    /// Splats to tiles, sorted front to back; ties in the order of the Gaussians.
    fn bin(&mut self, splats: &Self::Splats, camera: &Camera) -> Result<Self::Tiles, Self::Error>;
    /// Tiles to a picture.
    fn blend(
        &mut self,
        splats: &Self::Splats,
        colors: &Self::Colors,
        tiles: &Self::Tiles,
        camera: &Camera,
    ) -> Result<Self::Frame, Self::Error>;
    /// The light of every pixel added to its blended surface ([`crate::pixel`]): the colour of the
    /// picture becomes what it shows; where the layers of specular colour and light are asked for,
    /// they are filled in. The frame keeps the surface, which the gradients of this stage and of
    /// blending read.
    fn shade_pixels(
        &mut self,
        surface: Self::Frame,
        light: Option<&Self::Light>,
        camera: &Camera,
    ) -> Result<Self::Frame, Self::Error>;
}

/// A machine that can train as well: losses, gradients, updates.
pub trait Executor: Renderer {
    /// The gradient of a light.
    type LightGrad;
    /// The gradient of a frame.
    type FrameGrad;
    /// The gradient of splats and their channels.
    type SplatGrads;
    /// A picture to compare with.
    type Target;

    /// A picture of 8-bit sRGB and straight alpha, row by row, to the executor.
    fn target(&mut self, width: usize, height: usize, rgba: &[u8]) -> Result<Self::Target, Self::Error>;
    /// [`Renderer::bin`] for a step of training. An executor that would have to wait to know how
    /// much memory it takes may go by former steps instead; if that is too little, no later stage
    /// of the step changes anything, and [`Executor::report`] says so.
    fn bin_for_step(&mut self, splats: &Self::Splats, camera: &Camera) -> Result<Self::Tiles, Self::Error> {
        self.bin(splats, camera)
    }
    /// A picture as a photograph of this exposure shows it ([`crate::expose`]). The frame keeps the
    /// colours as they were, which the gradients of this stage read.
    fn expose(&mut self, frame: Self::Frame, exposure: &Exposure<f32>) -> Result<Self::Frame, Self::Error>;
    /// The gradient of a picture's losses against what it should be, over a background in
    /// sRGB. What the losses came to is told by [`Executor::report`].
    fn loss(
        &mut self,
        frame: &Self::Frame,
        target: &Self::Target,
        camera: &Camera,
        weights: &LossWeights,
        background: [f32; 3],
    ) -> Result<Self::FrameGrad, Self::Error>;

    /// Gradient of [`Executor::expose`]: that of the photograph becomes that of the picture as it
    /// was before. That of the exposure, a sum over the pixels, is told by [`Executor::report`].
    fn expose_vjp(
        &mut self,
        frame: &Self::Frame,
        exposure: &Exposure<f32>,
        grad: Self::FrameGrad,
    ) -> Result<Self::FrameGrad, Self::Error>;
    /// Gradient of [`Renderer::shade_pixels`]: that of the picture becomes that of the blended
    /// surface; and that of the light, if there is one.
    fn shade_pixels_vjp(
        &mut self,
        surface: &Self::Frame,
        light: Option<&Self::Light>,
        camera: &Camera,
        grad: Self::FrameGrad,
    ) -> Result<(Self::FrameGrad, Option<Self::LightGrad>), Self::Error>;
    /// Gradient of [`Renderer::blend`].
    fn blend_vjp(
        &mut self,
        splats: &Self::Splats,
        colors: &Self::Colors,
        tiles: &Self::Tiles,
        frame: &Self::Frame,
        grad: &Self::FrameGrad,
        camera: &Camera,
    ) -> Result<Self::SplatGrads, Self::Error>;
    /// Gradient of [`Renderer::shade`] and [`Renderer::project`], which read the same attributes:
    /// of the Gaussians, and of the light if there is one and the Gaussians looked it up. Adds the
    /// losses on the attributes themselves.
    fn gaussians_vjp(
        &mut self,
        gaussians: &Gaussians<Self::Array>,
        camera: &Camera,
        splats: &Self::Splats,
        light: Option<&Self::Light>,
        rules: &RenderRules,
        weights: &LossWeights,
        grads: &Self::SplatGrads,
    ) -> Result<(Gaussians<Self::Array>, Option<Self::LightGrad>), Self::Error>;
    /// Gradient of [`Renderer::prefilter`].
    fn prefilter_vjp(
        &mut self,
        environment: &Environment<Self::Array>,
        light: &Self::Light,
        grad: &Self::LightGrad,
    ) -> Result<Self::Array, Self::Error>;

    /// One step of Adam for every plane, each at its own rate. Gradients that are not finite are
    /// left out, and counted.
    fn optimise(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        grad: Gaussians<Self::Array>,
        rates: &[f32],
        step: u32,
    ) -> Result<(), Self::Error>;
    /// [`Executor::gaussians_vjp`] and [`Executor::optimise`], one after the other. An executor may
    /// do both at once, so that the gradient never goes through memory; the result is the same to
    /// the last bit.
    fn update(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        splats: &Self::Splats,
        light: Option<&Self::Light>,
        grads: &Self::SplatGrads,
        step: &TrainingStep<'_, Self>,
    ) -> Result<Option<Self::LightGrad>, Self::Error>
    where
        Self: Sized,
    {
        let (grad, of_light) =
            self.gaussians_vjp(gaussians, step.camera, splats, light, step.rules, step.weights, grads)?;
        self.optimise(gaussians, moments, grad, step.rates, step.number)?;
        Ok(of_light)
    }
    /// One step of Adam for the light; radiance that is kept as it is stays between zero and
    /// `radiance_max`. Gradients that are not finite are left out, and counted.
    fn optimise_environment(
        &mut self,
        environment: &mut Environment<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        grad: Self::Array,
        rate: f32,
        radiance_max: f32,
        step: u32,
    ) -> Result<(), Self::Error>;
    /// Results of the stages since the last report: the losses of the last picture, the gradient of
    /// its exposure, and the number of gradients left out. It is the only synchronisation point of
    /// a step. `None` if [`Executor::bin_for_step`] took too little memory: then nothing was
    /// changed, and the step has to be repeated, for which there is enough now.
    fn report(&mut self) -> Result<Option<StepReport>, Self::Error>;

    /// Adds one view to what densification knows.
    fn observe(
        &mut self,
        statistics: &mut Statistics<Self::Array>,
        splats: &Self::Splats,
        grads: &Self::SplatGrads,
        camera: &Camera,
    ) -> Result<(), Self::Error>;
    /// Clones, splits and prunes, and sorts Gaussians into Morton order ([`crate::morton`]); new
    /// Gaussians start without momentum, and the statistics start again.
    fn densify(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        statistics: &mut Statistics<Self::Array>,
        rules: &DensifyRules,
        count_max: usize,
        key: RandomKey,
    ) -> Result<DensifyReport, Self::Error>;
    /// Limits one plane to at most `ceiling` and forgets its momentum, as the opacity reset does;
    /// where a ball is given, of those Gaussians whose means lie outside.
    fn limit_plane(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        plane: usize,
        ceiling: f32,
        outside: Option<Ball>,
    ) -> Result<(), Self::Error>;
}
