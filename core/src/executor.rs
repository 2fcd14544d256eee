//! Contract between the pipeline and the executors: one method for each stage.

use crate::{
    camera::{Camera, CameraGrad},
    color::Picture,
    densify::DensifyRules,
    double::Double,
    expose::Exposure,
    lamps::Lamp,
    loss::{LossReport, LossWeights},
    near_field::NearField,
    prefilter::{LevelRange, PrefilterScheme},
    region::Ball,
    rules::RenderRules,
    scene::{Environment, Gaussians, Layout},
    splat::SplatGrad,
    state::{AdamMoments, Statistics},
};
use core::{fmt, ops::Range};

/// Surface around lamps; `N` is the near field of an executor.
#[derive(Clone, Copy, Debug)]
pub struct Occluder<'a, N> {
    /// Surface that casts shadows.
    pub surface: &'a N,
    /// Irradiance / π of each vertex by interreflected lamp light: red, green and blue, finite;
    /// empty without interreflections.
    pub reflected: &'a [f32],
}

/// Error of a host buffer with a length other than that of the array or frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferLength {
    /// Numbers to read.
    pub expected: usize,
    /// Length of the buffer.
    pub found: usize,
}

impl BufferLength {
    /// Compares the length of a buffer with the number of values to read.
    ///
    /// # Errors
    ///
    /// Both lengths if they differ.
    pub const fn check(expected: usize, buffer: &[f32]) -> Result<(), Self> {
        Self::check_len(expected, buffer.len())
    }

    /// Compares two lengths: of values, and of the buffer for them.
    ///
    /// # Errors
    ///
    /// Returns both lengths where they differ.
    pub const fn check_len(expected: usize, found: usize) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self { expected, found }) }
    }
}

impl fmt::Display for BufferLength {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { expected, found } = self;
        write!(
            out,
            "a buffer has {found} numbers instead of {expected}; a frame has width × height numbers for each blended \
             channel (RenderRules::blended) and for transmittance"
        )
    }
}

impl core::error::Error for BufferLength {}

/// Result that an executor does not compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unsupported {
    /// Name of the result.
    pub what: &'static str,
}

impl fmt::Display for Unsupported {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "this executor does not compute {}; use the CPU executor", self.what)
    }
}

impl core::error::Error for Unsupported {}

impl Unsupported {
    /// Error for a feature that an executor does not have.
    pub const fn feature(feature: Feature) -> Self {
        Self { what: feature.name() }
    }
}

/// Result that executors need not compute: the default of its methods refuses by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Feature {
    /// Near fields ([`Renderer::upload_near_field`], [`Renderer::surround`], [`Renderer::trace`]).
    NearFields,
    /// Lamps ([`Renderer::add_lamps`], [`Renderer::illuminate`]).
    Lamps,
    /// Lights of networks ([`crate::light_network`]), in [`Renderer::prefilter`].
    LightNetworks,
    /// The authors' filter of light, [`PrefilterScheme::Official`].
    OfficialPrefilter,
    /// Exposures of photographs ([`Executor::expose`], [`Executor::expose_vjp`]).
    Exposures,
    /// Gradients of pixels that look light up ([`Executor::shade_pixels_vjp`]).
    PixelGradients,
    /// Gradients and steps of lights ([`Executor::prefilter_vjp`],
    /// [`Executor::optimise_environment`]).
    LightGradients,
    /// Gradients of cameras ([`Executor::gaussians_and_camera_vjp`]).
    CameraGradients,
    /// Sums of arrays ([`Executor::add`]), for several views in a step.
    Sums,
    /// Filters in space ([`Executor::sampling`]).
    Sampling,
    /// Ceilings of planes ([`Executor::limit_plane`]), for resets of opacities.
    Limits,
    /// Surfaces of other renderers in front of splats ([`Renderer::blend_occluded`]).
    Occlusions,
    /// Median depths ([`Renderer::median_depths`]).
    MedianDepths,
    /// Changes of some Gaussians ([`Renderer::write_gaussians`]).
    PartialWrites,
}

impl Feature {
    /// Every feature.
    pub const ALL: [Self; 14] = [
        Self::NearFields,
        Self::Lamps,
        Self::LightNetworks,
        Self::OfficialPrefilter,
        Self::Exposures,
        Self::PixelGradients,
        Self::LightGradients,
        Self::CameraGradients,
        Self::Sums,
        Self::Sampling,
        Self::Limits,
        Self::Occlusions,
        Self::MedianDepths,
        Self::PartialWrites,
    ];

    /// Name, as [`Unsupported`] has it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NearFields => "near fields",
            Self::Lamps => "lamps",
            Self::LightNetworks => "lights of networks",
            Self::OfficialPrefilter => "the official filter of light",
            Self::Exposures => "exposures",
            Self::PixelGradients => "gradients of pixels that look light up",
            Self::LightGradients => "gradients of lights",
            Self::CameraGradients => "gradients of cameras",
            Self::Sums => "sums of gradients",
            Self::Sampling => "filters in space",
            Self::Limits => "ceilings of planes",
            Self::Occlusions => "splats behind surfaces of another renderer",
            Self::MedianDepths => "median depths",
            Self::PartialWrites => "changes of some Gaussians",
        }
    }
}

/// Counts of one densification.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DensifyReport {
    /// Gaussians that were copied.
    pub cloned: usize,
    /// Gaussians that were split.
    pub split: usize,
    /// Gaussians that were removed.
    pub pruned: usize,
}

/// Key of random draws: equal keys give equal draws on every machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RandomKey {
    /// Seed of the run.
    pub seed: u64,
    /// Stream of draws, such as an iteration.
    pub stream: u64,
}

/// Inputs of one training step other than the scene.
#[derive(Debug)]
pub struct TrainingStep<'a, E: Executor> {
    /// Camera of the photograph.
    pub camera: &'a Camera,
    /// Photograph to fit.
    pub target: &'a E::Target,
    /// Background colour, sRGB.
    pub background: [f32; 3],
    /// Exposure of the photograph; `None` compares colours unchanged.
    pub exposure: Option<&'a Exposure<f32>>,
    /// Near field for reflected rays, if the rules need it.
    pub near_field: Option<&'a E::NearField>,
    /// Rendering rules.
    pub rules: &'a RenderRules,
    /// Weights of the losses.
    pub weights: &'a LossWeights,
    /// True if the step adds to the statistics of densification.
    pub is_observed: bool,
    /// Learning rate of every plane; [`AT_REST`](crate::optimise::AT_REST) for planes at rest.
    pub rates: &'a [f32],
    /// Learning rate of the light.
    pub environment_rate: f32,
    /// Largest radiance that the light keeps.
    pub radiance_max: f32,
    /// Number of this step, from 1.
    pub number: u32,
    /// Number of this step among those of its light, from 1.
    pub light_number: u32,
    /// Loss of the caller, in addition to those of the weights.
    pub own_loss: Option<OwnLoss<'a, E>>,
}

/// Loss of the caller, and the photograph of a step.
#[derive(Debug)]
pub struct OwnLoss<'a, E: Executor> {
    /// Loss.
    pub loss: &'a dyn PictureLoss<E>,
    /// Index of the photograph among those of the training.
    pub view: usize,
}

/// Picture of a step before its gradient.
pub struct StepPicture<'a, E: Executor> {
    /// Blended channels. Colours are those that are compared with the photograph, after its
    /// exposure.
    pub frame: &'a E::Frame,
    /// Layout of the Gaussians, which determines the channels ([`RenderRules::blended`]).
    pub layout: Layout,
    /// Index of the photograph among those of the training.
    pub view: usize,
    /// Inputs of the step.
    pub step: &'a TrainingStep<'a, E>,
}

impl<E: Executor> fmt::Debug for StepPicture<'_, E> {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("StepPicture").field("layout", &self.layout).field("view", &self.view).finish_non_exhaustive()
    }
}

/// Loss of the caller on the pictures of a training, such as the difference from measured depths.
pub trait PictureLoss<E: Executor>: fmt::Debug {
    /// Adds the gradient of the loss with respect to a picture to that of the other losses. A
    /// training is deterministic if the result depends only on the arguments.
    ///
    /// # Errors
    ///
    /// Those of the executor, which end the step.
    fn add_grad(
        &self,
        exec: &mut E,
        picture: &StepPicture<'_, E>,
        grad: E::FrameGrad,
    ) -> Result<E::FrameGrad, E::Error>;
}

/// Results of one step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Losses before the step.
    pub loss: LossReport,
    /// Number of gradients that were skipped because they were not finite.
    pub nonfinite: usize,
    /// Gradient of the exposure, if there was one.
    pub exposure: Option<Exposure<f64>>,
}

/// Executor of the stages of a picture, with associated types for arrays and for the results of
/// stages.
///
/// Stages compute the same on every executor, up to rounding, and each is deterministic. The crate
/// `specula-conformance` tests all that is said here.
///
/// * The required methods are those of pictures. Those of a [`Feature`] have defaults that refuse
///   by name, and [`Renderer::has`] lists what an executor has beyond the required methods.
/// * [`crate::pipeline`] calls the stages in order: [`project`](Self::project),
///   [`shade`](Self::shade), [`bin`](Self::bin), [`blend`](Self::blend); for pixels that look light
///   up [`trace`](Self::trace), [`illuminate`](Self::illuminate) and
///   [`shade_pixels`](Self::shade_pixels), the first two with a light only, and only if the rules
///   ask for them. It passes a light only under rules that are lit ([`RenderRules::is_lit`]), so
///   stages need not read that rule.
/// * The result of a stage is valid for later stages of the same executor, with the same Gaussians
///   and camera, as long as it lives: a frame can be read, and its gradient taken, after other
///   pictures were rendered.
/// * A light has the maps of [`Levels`](crate::prefilter::Levels). Where the scheme has no map of
///   irradiance ([`PrefilterScheme::Exact`]), its last level, of roughness 1, is that map.
pub trait Renderer {
    /// Array of `f32` in the executor's memory.
    type Array;
    /// Light filtered into levels, with its near field and lamps.
    type Light;
    /// Near field in the executor's memory; a clone shares it.
    type NearField: Clone;
    /// Gaussians on the screen.
    type Splats;
    /// Channels of splats.
    type Colors;
    /// Splats of each tile, front to back.
    type Tiles;
    /// Blended picture: premultiplied channels and transmittance.
    type Frame;
    /// Error of a stage.
    type Error: core::error::Error + From<Unsupported> + 'static;

    /// Returns whether the executor has a feature beyond the required methods.
    fn has(&self, feature: Feature) -> bool {
        let _ = feature;
        false
    }

    /// Uploads numbers to the executor.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn upload(&mut self, values: &[f32]) -> Result<Self::Array, Self::Error>;

    /// Uploads Gaussians, or anything else with the same planes, such as their moments. Executors
    /// may accept more Gaussians than fit into a single array.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn upload_gaussians<A: AsRef<[f32]>>(
        &mut self,
        gaussians: &Gaussians<A>,
    ) -> Result<Gaussians<Self::Array>, Self::Error> {
        Ok(gaussians.with_values(self.upload(gaussians.values.as_ref())?))
    }

    /// Replaces Gaussians of an uploaded array by those with the same indices of `gaussians`, which
    /// has the same count and layout. Whole blocks of [`BLOCK`](crate::scene::BLOCK) Gaussians are
    /// written, those that `range` touches.
    ///
    /// # Errors
    ///
    /// The error of the executor: another count or layout, or a range beyond the count
    /// ([`Gaussians::changed_values`]); a lost device; [`Unsupported`] without
    /// [`Feature::PartialWrites`].
    fn write_gaussians<A: AsRef<[f32]>>(
        &mut self,
        uploaded: &mut Gaussians<Self::Array>,
        gaussians: &Gaussians<A>,
        range: Range<usize>,
    ) -> Result<(), Self::Error> {
        let _ = (uploaded, gaussians, range);
        Err(Unsupported::feature(Feature::PartialWrites).into())
    }

    /// Downloads an array to the host.
    ///
    /// # Errors
    ///
    /// [`BufferLength`] if `values` does not have the array's length; otherwise the error of the
    /// executor.
    fn download(&mut self, array: &Self::Array, values: &mut [f32]) -> Result<(), Self::Error>;

    /// Downloads a frame: its channels, then its transmittance, plane by plane. The channels are
    /// those of [`RenderRules::blended`], more than the requested ones if light is looked up per
    /// pixel.
    ///
    /// # Errors
    ///
    /// [`BufferLength`] if `values` has another length; otherwise the error of the executor.
    fn read_frame(&mut self, frame: &Self::Frame, values: &mut [f32]) -> Result<(), Self::Error>;

    /// Filters light into the roughness levels of later lookups; other levels may stay zero.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as a resolution that cannot be filtered, or
    /// [`Unsupported`] for [`Feature::LightNetworks`] and [`Feature::OfficialPrefilter`].
    fn prefilter(
        &mut self,
        environment: &Environment<Self::Array>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Self::Light, Self::Error>;

    /// Uploads a near field.
    ///
    /// # Errors
    ///
    /// The error of the executor: a near field with a fault ([`NearField::check`]), too little
    /// memory or a lost device; [`Unsupported`] without [`Feature::NearFields`].
    fn upload_near_field(&mut self, near_field: &NearField<&[f32]>) -> Result<Self::NearField, Self::Error> {
        let _ = near_field;
        Err(Unsupported::feature(Feature::NearFields).into())
    }

    /// Attaches a near field to a light, and replaces its former one.
    ///
    /// # Errors
    ///
    /// [`Unsupported`] without [`Feature::NearFields`].
    fn surround(&mut self, light: Self::Light, near_field: &Self::NearField) -> Result<Self::Light, Self::Error> {
        let _ = (light, near_field);
        Err(Unsupported::feature(Feature::NearFields).into())
    }

    /// Attaches lamps to a light, and replaces its former ones, with `rays` shadow rays to each
    /// area lamp. Surfaces of `occluder` cast the shadows and reflect light onto each other; `None`
    /// disables shadows and indirect light.
    ///
    /// # Errors
    ///
    /// The error of the executor: lamps with a fault ([`crate::lamps::check`]), too little memory
    /// or a lost device; [`Unsupported`] without [`Feature::Lamps`].
    fn add_lamps(
        &mut self,
        light: Self::Light,
        lamps: &[Lamp],
        rays: usize,
        occluder: Option<Occluder<'_, Self::NearField>>,
    ) -> Result<Self::Light, Self::Error> {
        let _ = (light, lamps, rays, occluder);
        Err(Unsupported::feature(Feature::Lamps).into())
    }

    /// Projects Gaussians to splats. Gaussians whose mean, shape or opacity is not finite are not
    /// drawn.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn project(&mut self, gaussians: &Gaussians<Self::Array>, camera: &Camera) -> Result<Self::Splats, Self::Error>;

    /// Shades splats. Without a light there is no specular term. Later stages do not draw splats if
    /// an attribute that the rules read is not finite.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn shade(
        &mut self,
        gaussians: &Gaussians<Self::Array>,
        camera: &Camera,
        splats: &mut Self::Splats,
        light: Option<&Self::Light>,
        rules: &RenderRules,
    ) -> Result<Self::Colors, Self::Error>;

    /// Sorts splats into tiles, front to back; ties keep the order of the Gaussians.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn bin(&mut self, splats: &Self::Splats, camera: &Camera) -> Result<Self::Tiles, Self::Error>;

    /// Blends tiles into a frame.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn blend(
        &mut self,
        splats: &Self::Splats,
        colors: &Self::Colors,
        tiles: &Self::Tiles,
        camera: &Camera,
    ) -> Result<Self::Frame, Self::Error>;

    /// [`Renderer::blend`] without the splats that surfaces of another renderer hide
    /// ([`mod@crate::occlusion`]): one depth for each pixel of the camera, row by row. Render only:
    /// gradients of such a frame are those of a picture without surfaces.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as an occlusion of another size; [`Unsupported`] without
    /// [`Feature::Occlusions`].
    fn blend_occluded(
        &mut self,
        splats: &Self::Splats,
        colors: &Self::Colors,
        tiles: &Self::Tiles,
        camera: &Camera,
        occlusion: &Self::Array,
    ) -> Result<Self::Frame, Self::Error> {
        let _ = (splats, colors, tiles, camera, occlusion);
        Err(Unsupported::feature(Feature::Occlusions).into())
    }

    /// Median depth of each pixel of the camera, row by row: the depth of the splat that brings the
    /// transmittance to one half or less ([`crate::blend::is_median`]), infinite without one.
    ///
    /// # Errors
    ///
    /// The error of the executor; [`Unsupported`] without [`Feature::MedianDepths`].
    fn median_depths(
        &mut self,
        splats: &Self::Splats,
        tiles: &Self::Tiles,
        camera: &Camera,
    ) -> Result<Self::Array, Self::Error> {
        let _ = (splats, tiles, camera);
        Err(Unsupported::feature(Feature::MedianDepths).into())
    }

    /// Traces the reflected ray of every pixel against the near field of the light
    /// ([`mod@crate::near_field`]); the frame keeps the reflections for [`Renderer::shade_pixels`]
    /// and its gradient. A frame without depths, or of a light without a near field, is returned
    /// unchanged; so is every frame by default, since lights have no near fields then.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn trace(
        &mut self,
        surface: Self::Frame,
        light: &Self::Light,
        camera: &Camera,
    ) -> Result<Self::Frame, Self::Error> {
        let _ = (light, camera);
        Ok(surface)
    }

    /// Evaluates the direct light of lamps in every pixel ([`mod@crate::lamps`]); the frame keeps
    /// it for [`Renderer::shade_pixels`] of physical materials. A frame without all layers, or of a
    /// light without lamps, is returned unchanged; so is every frame by default. Render only; not
    /// differentiated.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn illuminate(
        &mut self,
        surface: Self::Frame,
        light: &Self::Light,
        camera: &Camera,
    ) -> Result<Self::Frame, Self::Error> {
        let _ = (light, camera);
        Ok(surface)
    }

    /// Adds light to the blended surface of every pixel ([`crate::shade_pixels`]): the surface's
    /// base colour becomes the colour of the picture. The frame keeps the surface, which the
    /// gradients of this stage and of blending read.
    ///
    /// [`PixelShading`](crate::pixel_light::PixelShading) composes a pixel. Layers that were
    /// requested are premultiplied: the specular colour is that part of the colour, and the layer
    /// of light is that of [`RenderRules::light_layer`]. Without a light physical materials are
    /// black, and other surfaces keep their base colour. The table of the split sum is looked up
    /// bilinearly between the centres of its texels, clamped at its edges
    /// ([`table_position`](crate::split_sum::table_position)).
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn shade_pixels(
        &mut self,
        surface: Self::Frame,
        light: Option<&Self::Light>,
        camera: &Camera,
        rules: &RenderRules,
    ) -> Result<Self::Frame, Self::Error>;
}

/// Renderer that also trains: losses, gradients, updates. The required methods are those of a
/// training of unlit Gaussians.
pub trait Executor: Renderer {
    /// Gradient of a light.
    type LightGrad;
    /// Gradient of a frame.
    type FrameGrad;
    /// Gradient of splats and their channels.
    type SplatGrads;
    /// Picture to compare with.
    type Target;

    /// True if targets are in device memory, so caching them there saves uploads.
    const IS_DEVICE: bool = true;

    /// Uploads a picture. Losses compare its unclipped colours, if it has them.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as a picture whose pixels do not fit its size.
    fn target(&mut self, picture: &Picture<'_>) -> Result<Self::Target, Self::Error>;

    /// [`Renderer::bin`] for a step of training. To avoid waiting for the required amount of
    /// memory, an executor may estimate it from previous steps; if the estimate is too small, no
    /// later stage of the step changes anything, and [`Executor::report`] returns `None`.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn bin_for_step(&mut self, splats: &Self::Splats, camera: &Camera) -> Result<Self::Tiles, Self::Error> {
        self.bin(splats, camera)
    }

    /// Applies the exposure of a photograph ([`crate::expose`]). The frame keeps its previous
    /// colours for the gradients of this stage.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::Exposures`].
    fn expose(&mut self, frame: Self::Frame, exposure: &Exposure<f32>) -> Result<Self::Frame, Self::Error> {
        let _ = (frame, exposure);
        Err(Unsupported::feature(Feature::Exposures).into())
    }

    /// Gradient of a picture's losses against its target, over a background in sRGB.
    /// [`Executor::report`] returns the values of the losses.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as a target of another size.
    fn loss(
        &mut self,
        frame: &Self::Frame,
        target: &Self::Target,
        camera: &Camera,
        weights: &LossWeights,
        background: [f32; 3],
    ) -> Result<Self::FrameGrad, Self::Error>;

    /// Gradient of [`Executor::expose`] with respect to the picture. [`Executor::report`] returns
    /// the gradient of the exposure, a sum over pixels.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::Exposures`].
    fn expose_vjp(
        &mut self,
        frame: &Self::Frame,
        exposure: &Exposure<f32>,
        grad: Self::FrameGrad,
    ) -> Result<Self::FrameGrad, Self::Error> {
        let _ = (frame, exposure, grad);
        Err(Unsupported::feature(Feature::Exposures).into())
    }

    /// Gradient of [`Renderer::shade_pixels`] with respect to the blended surface, and to the
    /// light, if there is one.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::PixelGradients`].
    fn shade_pixels_vjp(
        &mut self,
        surface: &Self::Frame,
        light: Option<&Self::Light>,
        camera: &Camera,
        rules: &RenderRules,
        grad: Self::FrameGrad,
    ) -> Result<(Self::FrameGrad, Option<Self::LightGrad>), Self::Error> {
        let _ = (surface, light, camera, rules, grad);
        Err(Unsupported::feature(Feature::PixelGradients).into())
    }

    /// Gradient of [`Renderer::blend`].
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
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
    /// of the Gaussians, and of the light, if there is one that Gaussians look up. Adds the
    /// gradients of the losses on attributes. The gradient of the channel of depth is that of
    /// [`SplatGrad::depth`].
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
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

    /// [`Executor::gaussians_vjp`] without losses on attributes, and the gradient of the camera's
    /// pose: the sum of [`camera_vjp`](crate::attributes::camera_vjp) over the Gaussians, in an
    /// order that does not depend on the number of threads.
    ///
    /// # Errors
    ///
    /// [`Unsupported`], where the executor has no gradient of the camera; otherwise the error of
    /// the executor.
    fn gaussians_and_camera_vjp(
        &mut self,
        gaussians: &Gaussians<Self::Array>,
        camera: &Camera,
        splats: &Self::Splats,
        light: Option<&Self::Light>,
        rules: &RenderRules,
        grads: &Self::SplatGrads,
    ) -> Result<(Gaussians<Self::Array>, Option<Self::LightGrad>, CameraGrad<Double>), Self::Error> {
        let _ = (gaussians, camera, splats, light, rules, grads);
        Err(Unsupported::feature(Feature::CameraGradients).into())
    }

    /// Gradient of [`Renderer::prefilter`] with respect to the environment's numbers.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::LightGradients`].
    fn prefilter_vjp(
        &mut self,
        environment: &Environment<Self::Array>,
        light: &Self::Light,
        grad: &Self::LightGrad,
    ) -> Result<Self::Array, Self::Error> {
        let _ = (environment, light, grad);
        Err(Unsupported::feature(Feature::LightGradients).into())
    }

    /// Adds an array to another of the same layout: gradients of the same Gaussians or of the same
    /// light, or their statistics.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as a lost device; [`Unsupported`] without
    /// [`Feature::Sums`].
    fn add(&mut self, sum: &mut Self::Array, term: &Self::Array) -> Result<(), Self::Error> {
        let _ = (sum, term);
        Err(Unsupported::feature(Feature::Sums).into())
    }

    /// Takes one Adam step in every plane, at its own rate or at rest
    /// ([`AT_REST`](crate::optimise::AT_REST)). Gradients that are not finite are skipped and
    /// counted.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn optimise(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        grad: Gaussians<Self::Array>,
        rates: &[f32],
        step: u32,
    ) -> Result<(), Self::Error>;

    /// [`Executor::gaussians_vjp`], then [`Executor::optimise`]. An executor may fuse both, so that
    /// the gradient is never stored; the result is the same to the last bit.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
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
        let (grad, light_grad) =
            self.gaussians_vjp(gaussians, step.camera, splats, light, step.rules, step.weights, grads)?;
        self.optimise(gaussians, moments, grad, step.rates, step.number)?;
        Ok(light_grad)
    }

    /// Takes one Adam step for the light. Radiance that is stored without activation is kept
    /// between zero and `radiance_max`. Gradients that are not finite are skipped and counted.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::LightGradients`].
    fn optimise_environment(
        &mut self,
        environment: &mut Environment<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        grad: Self::Array,
        rate: f32,
        radiance_max: f32,
        step: u32,
    ) -> Result<(), Self::Error> {
        let _ = (environment, moments, grad, rate, radiance_max, step);
        Err(Unsupported::feature(Feature::LightGradients).into())
    }

    /// Results of the stages since the last report: the losses of the last picture, the gradient of
    /// its exposure, and the number of skipped gradients. It is the only synchronisation point of a
    /// step. `None` if [`Executor::bin_for_step`] reserved too little memory: then nothing was
    /// changed, and the step must be repeated, now with enough memory.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn report(&mut self) -> Result<Option<StepReport>, Self::Error>;

    /// Adds one view to the statistics of densification.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn observe(
        &mut self,
        statistics: &mut Statistics<Self::Array>,
        splats: &Self::Splats,
        grads: &Self::SplatGrads,
        camera: &Camera,
    ) -> Result<(), Self::Error>;

    /// Clones, splits and prunes, and sorts Gaussians into Morton order ([`crate::morton`]). New
    /// Gaussians start without momentum, and the statistics start again.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device.
    fn densify(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        statistics: &mut Statistics<Self::Array>,
        rules: &DensifyRules,
        count_max: usize,
        key: RandomKey,
    ) -> Result<DensifyReport, Self::Error>;

    /// Sets the filter in space of Gaussians that have one: the smallest sampling interval of these
    /// views at the mean ([`mod@crate::antialias`]). Other Gaussians are unchanged.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::Sampling`].
    fn sampling(&mut self, gaussians: &mut Gaussians<Self::Array>, views: &[Camera]) -> Result<(), Self::Error> {
        let _ = (gaussians, views);
        Err(Unsupported::feature(Feature::Sampling).into())
    }

    /// Clamps one plane to at most `ceiling` and resets its momentum, as the opacity reset does;
    /// with a ball, only for Gaussians whose means lie outside of it.
    ///
    /// # Errors
    ///
    /// The error of the executor, such as too little memory or a lost device;
    /// [`Unsupported`] without [`Feature::Limits`].
    fn limit_plane(
        &mut self,
        gaussians: &mut Gaussians<Self::Array>,
        moments: &mut AdamMoments<Self::Array>,
        plane: usize,
        ceiling: f32,
        outside: Option<Ball>,
    ) -> Result<(), Self::Error> {
        let _ = (gaussians, moments, plane, ceiling, outside);
        Err(Unsupported::feature(Feature::Limits).into())
    }
}

/// Gaussian on the screen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OnScreen {
    /// Centre, in pixels.
    pub mean2d: [f32; 2],
    /// Half width and half height of the box around the ellipse in which it is drawn, in pixels;
    /// zero for a Gaussian that is not drawn. The box may lie outside of the picture.
    pub half_extent: [f32; 2],
    /// Depth along the optical axis, in world units; −1 for a Gaussian that is nearer than the
    /// camera draws, or not finite.
    pub depth: f32,
    /// Opacity, after the compensation of its low-pass.
    pub opacity: f32,
}

/// Executor with readable stage results and frame gradients from the host: for sums over the pixels
/// of a view for each Gaussian.
pub trait ReadBack: Executor {
    /// Reads the channels of Gaussians, `channels` numbers for each Gaussian; arbitrary for
    /// Gaussians that are not drawn.
    ///
    /// # Errors
    ///
    /// [`BufferLength`] if `values` has another length.
    fn read_colors(&mut self, colors: &Self::Colors, values: &mut [f32]) -> Result<(), Self::Error>;

    /// Gradient of a frame from its planes, in the order of [`Renderer::read_frame`].
    ///
    /// # Errors
    ///
    /// [`BufferLength`] if `planes` does not have the length of the frame's values; otherwise the
    /// error of the executor.
    fn upload_frame_grad(&mut self, frame: &Self::Frame, planes: &[f32]) -> Result<Self::FrameGrad, Self::Error>;

    /// Reads the planes of a frame's gradient; those of pixels without a splat may be 0.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where `planes` has not the length of the frame's values; [`Unsupported`],
    /// where the executor does not read them back; otherwise the error of the executor.
    fn read_frame_grad(
        &mut self,
        frame: &Self::Frame,
        grad: &Self::FrameGrad,
        planes: &mut [f32],
    ) -> Result<(), Self::Error> {
        let _ = (frame, grad, planes);
        Err(Unsupported { what: "gradients of pictures on the host" }.into())
    }

    /// Reads the gradients of some channels of splats, `channels.len()` numbers for each Gaussian.
    ///
    /// # Errors
    ///
    /// A download that failed.
    fn read_channel_grads(
        &mut self,
        grads: &Self::SplatGrads,
        channels: Range<usize>,
        values: &mut [f32],
    ) -> Result<(), Self::Error>;

    /// Reads each Gaussian on the screen.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where `screens` has not one element for each Gaussian; [`Unsupported`],
    /// where the executor does not read them back; otherwise the error of the executor.
    fn read_splats(&mut self, splats: &Self::Splats, screens: &mut [OnScreen]) -> Result<(), Self::Error> {
        let _ = (splats, screens);
        Err(Unsupported { what: "positions and extents of splats on the host" }.into())
    }

    /// Reads the gradient of each splat. Depths have none: theirs is that of their channel.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where `values` has not one element for each Gaussian; [`Unsupported`],
    /// where the executor does not read them back; otherwise the error of the executor.
    fn read_splat_grads(&mut self, grads: &Self::SplatGrads, values: &mut [SplatGrad<f32>]) -> Result<(), Self::Error> {
        let _ = (grads, values);
        Err(Unsupported { what: "gradients of splats on the host" }.into())
    }

    /// Reads, for each splat, the sum over the pixels of the absolute gradient of its centre, by
    /// axis: what densification by [AbsGS](https://arxiv.org/abs/2404.10484) compares, where
    /// gradients of opposite pixels do not cancel. The gradient is that of the blended frame.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where `sums` has not one element for each Gaussian; [`Unsupported`], where
    /// the executor does not sum them; otherwise the error of the executor.
    fn read_absolute_center_grads(
        &mut self,
        splats: &Self::Splats,
        colors: &Self::Colors,
        tiles: &Self::Tiles,
        frame: &Self::Frame,
        grad: &Self::FrameGrad,
        sums: &mut [[f32; 2]],
    ) -> Result<(), Self::Error> {
        let _ = (splats, colors, tiles, frame, grad, sums);
        Err(Unsupported { what: "absolute gradients of splats" }.into())
    }

    /// Sets the colour of each Gaussian: red, green and blue as they are blended. Other channels
    /// stay.
    ///
    /// # Errors
    ///
    /// [`BufferLength`], where there is not one colour for each Gaussian; [`Unsupported`], where
    /// the executor takes no colours from the host; otherwise the error of the executor.
    fn write_colors(&mut self, colors: &mut Self::Colors, rgb: &[[f32; 3]]) -> Result<(), Self::Error> {
        let _ = (colors, rgb);
        Err(Unsupported { what: "colours from the host" }.into())
    }
}
