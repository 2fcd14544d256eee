//! Executor on the CPU: core's contract, stage by stage.

use crate::{
    context::Context,
    error::CpuError,
    frame::{Frame, FrameGrad},
    stages::{
        bin::{Tiles, bin_all},
        blend::blend_all,
        blend_vjp::{SplatGrads, blend_all_vjp},
        densify,
        expose::{expose, expose_vjp},
        gaussians_vjp::{gaussians_vjp, update},
        illuminate::{Lamps, illuminate},
        loss::{Target, loss_all},
        median_depths::median_depths,
        optimise::{StepSize, adam_all, adam_blocks, add_all},
        prefilter::{Light, LightGrad},
        project::{Splats, project_all},
        sampling::sampling,
        shade::{Colors, Scene, shade_all},
        shade_pixels::{shade_pixels, shade_pixels_vjp},
        trace::trace,
    },
};
use core::{ops::Range, sync::atomic::AtomicBool};
use specula_core::{
    attributes::GaussianShading,
    camera::{Camera, CameraGrad},
    color::Picture,
    cutoffs::Cutoffs,
    densify::DensifyRules,
    double::Double,
    executor::{
        BufferLength, DensifyReport, Executor, Feature, Occluder, RandomKey, Renderer, StepReport, TrainingStep,
    },
    expose::Exposure,
    lamps::Lamp,
    light_network::LightNetworkError,
    loss::LossWeights,
    near_field::NearField,
    prefilter::{LevelRange, Levels, PrefilterScheme},
    region::Ball,
    rules::RenderRules,
    scene::{Environment, Gaussians, RadianceActivation},
    state::{AdamMoments, Statistics},
};
use specula_prefilter::{Operator, encoded::EncodedTexels};
use std::sync::Arc;

/// Source of an executor's [`Cutoffs`].
pub trait CutoffPolicy {
    /// Cutoffs of later pictures.
    fn cutoffs(&self) -> &Cutoffs;
}

/// [`Cutoffs::DEFAULT`], the only cutoffs with gradients.
#[derive(Clone, Copy, Debug, Default)]
pub struct DefaultCutoffs;

impl CutoffPolicy for DefaultCutoffs {
    fn cutoffs(&self) -> &Cutoffs {
        &Cutoffs::DEFAULT
    }
}

impl CutoffPolicy for Cutoffs {
    fn cutoffs(&self) -> &Cutoffs {
        self
    }
}

/// Executor on the threads of rayon's current pool.
///
/// With `DefaultCutoffs` it also trains; with other [`Cutoffs`] it only renders.
#[derive(Debug)]
pub struct CpuExecutor<C = DefaultCutoffs> {
    pub(crate) context: Context,
    cutoffs: C,
    /// Prefilter operator of the last scheme, resolution and levels.
    operator: Option<((PrefilterScheme, usize, LevelRange), Arc<Operator>)>,
    /// Texels of the last network light.
    encoded: Option<Arc<EncodedTexels>>,
    /// Results of the stages since the last report.
    report: StepReport,
}

/// Renderer within any [`Cutoffs`]; within [`Cutoffs::DEFAULT`] its pictures equal those of the
/// training executor to the last bit.
pub type CpuViewer = CpuExecutor<Cutoffs>;

impl Default for CpuExecutor {
    fn default() -> Self {
        Self::new()
    }
}

impl Default for CpuViewer {
    fn default() -> Self {
        Self::with_cutoffs(Cutoffs::DEFAULT)
    }
}

impl CpuExecutor {
    /// Creates an executor with the widest vectors of this machine.
    pub fn new() -> Self {
        Self::with_policy(DefaultCutoffs)
    }
}

impl CpuViewer {
    /// Creates a renderer within these cutoffs.
    pub fn with_cutoffs(cutoffs: Cutoffs) -> Self {
        Self::with_policy(cutoffs)
    }
    /// Sets the cutoffs of later pictures. Splats that were projected before must no longer be
    /// used.
    pub fn set_cutoffs(&mut self, cutoffs: Cutoffs) {
        self.cutoffs = cutoffs;
    }
}

impl<C: CutoffPolicy> CpuExecutor<C> {
    fn with_policy(cutoffs: C) -> Self {
        Self { context: Context::new(), cutoffs, operator: None, encoded: None, report: StepReport::default() }
    }

    /// Sets the flag that cancels pictures from another thread. While it is true, stages that work
    /// on pixels fail with [`CpuError::Cancelled`], in progress after their current tiles, and
    /// frames are not read. Frames that are being read or written are completed, and later pictures
    /// are unaffected.
    pub fn set_cancel(&mut self, cancel: Option<Arc<AtomicBool>>) {
        self.context.cancel = cancel;
    }

    /// Name of its vector instructions.
    pub fn vectors(&self) -> String {
        let name = format!("{:?}", self.context.level);
        format!("{} vectors", name.split('(').next().unwrap_or_default())
    }

    #[cfg(feature = "testing")]
    /// Depth and index of the drawn Gaussians, front to back; ties in their order.
    pub fn depth_order(&self, splats: &Splats) -> Vec<(f32, u32)> {
        let order = crate::stages::bin::depth_order(&self.context, &splats.records);
        order.iter().map(|(depth, gaussian)| (f32::from_bits(*depth), *gaussian)).collect()
    }

    /// Filters light into given levels, with the weights of a scheme. The first level has the
    /// resolution of the light.
    ///
    /// # Errors
    ///
    /// [`CpuError::LightResolution`] if the resolutions differ.
    pub fn prefilter_into(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: Levels,
    ) -> Result<Light, CpuError> {
        let first = levels.as_slice()[0].resolution;
        assert!(!environment.is_network(), "a network has its own levels; filter its texels");
        if environment.resolution != first {
            return Err(CpuError::LightResolution { resolution: environment.resolution, least: first });
        }
        Ok(self.filter(environment, &Arc::new(Operator::of_levels(scheme, levels, LevelRange::ALL))))
    }

    /// Filters light with an operator for a base of its resolution.
    pub fn filter(&mut self, environment: &Environment<Vec<f32>>, operator: &Arc<Operator>) -> Light {
        assert_eq!(environment.resolution, operator.base_resolution(), "weights are for one resolution");
        assert!(!environment.is_network(), "a network has its own levels; filter its texels");
        Light::new(&self.context, operator.clone(), environment)
    }

    fn evaluate_network(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, CpuError> {
        let Environment { resolution, values, .. } = environment;
        LightNetworkError::check(*resolution, values.len(), scheme).map_err(CpuError::LightNetwork)?;
        LightNetworkError::check_weights(values).map_err(CpuError::LightNetwork)?;
        check_resolution(scheme, *resolution)?;
        let encoded = match &self.encoded {
            Some(encoded) if (encoded.resolution(), encoded.kept_levels()) == (*resolution, levels) => encoded.clone(),
            _ => Arc::new(EncodedTexels::new(*resolution, levels)),
        };
        self.encoded = Some(encoded.clone());
        Ok(Light::of_network(&self.context, &encoded, values))
    }

    fn operator(
        &mut self,
        scheme: PrefilterScheme,
        resolution: usize,
        levels: LevelRange,
    ) -> Result<Arc<Operator>, CpuError> {
        check_resolution(scheme, resolution)?;
        match &self.operator {
            Some((key, operator)) if *key == (scheme, resolution, levels) => Ok(operator.clone()),
            _ => {
                let operator = Operator::shared(scheme, resolution, levels);
                self.operator = Some(((scheme, resolution, levels), operator.clone()));
                Ok(operator)
            }
        }
    }
}

fn check_resolution(scheme: PrefilterScheme, resolution: usize) -> Result<(), CpuError> {
    let least = scheme.resolution_min();
    if scheme.takes(resolution) { Ok(()) } else { Err(CpuError::LightResolution { resolution, least }) }
}

impl<C: CutoffPolicy> Renderer for CpuExecutor<C> {
    type Array = Vec<f32>;
    type Light = Light;
    type NearField = Arc<NearField<Vec<f32>>>;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = CpuError;

    fn has(&self, _: Feature) -> bool {
        true
    }

    fn upload(&mut self, values: &[f32]) -> Result<Vec<f32>, CpuError> {
        Ok(self.context.copy_of(values))
    }

    fn write_gaussians<A: AsRef<[f32]>>(
        &mut self,
        uploaded: &mut Gaussians<Vec<f32>>,
        gaussians: &Gaussians<A>,
        range: Range<usize>,
    ) -> Result<(), CpuError> {
        let values = gaussians.changed_values(uploaded, range).map_err(CpuError::Change)?;
        uploaded.values[values.clone()].copy_from_slice(&gaussians.values.as_ref()[values]);
        Ok(())
    }

    fn download(&mut self, array: &Vec<f32>, values: &mut [f32]) -> Result<(), CpuError> {
        BufferLength::check(array.len(), values).map_err(CpuError::BufferLength)?;
        values.copy_from_slice(array);
        Ok(())
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), CpuError> {
        BufferLength::check(frame.len_of_values(), values).map_err(CpuError::BufferLength)?;
        if !self.context.skips() {
            frame.read(values);
        }
        self.context.complete(())
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, CpuError> {
        if environment.is_network() {
            return self.evaluate_network(environment, scheme, levels);
        }
        let operator = self.operator(scheme, environment.resolution, levels)?;
        Ok(Light::new(&self.context, operator, environment))
    }

    fn upload_near_field(&mut self, near_field: &NearField<&[f32]>) -> Result<Self::NearField, CpuError> {
        near_field.check().map_err(CpuError::NearField)?;
        Ok(Arc::new(near_field.with_values(near_field.values.to_vec())))
    }

    fn surround(&mut self, light: Light, near_field: &Self::NearField) -> Result<Light, CpuError> {
        Ok(light.around(near_field))
    }

    fn add_lamps(
        &mut self,
        light: Light,
        lamps: &[Lamp],
        rays: usize,
        occluder: Option<Occluder<'_, Self::NearField>>,
    ) -> Result<Light, CpuError> {
        Ok(light.with_lamps(Lamps::new(lamps, rays, occluder)?))
    }

    fn project(&mut self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Splats, CpuError> {
        Ok(project_all(&self.context, gaussians, camera, self.cutoffs.cutoffs()))
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        camera: &Camera,
        splats: &mut Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, CpuError> {
        let scene = Scene { shading: GaussianShading { layout: gaussians.layout, rules: *rules }, light };
        Ok(shade_all(&self.context, gaussians, camera, splats, scene))
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, CpuError> {
        bin_all(&self.context, splats, camera)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, CpuError> {
        self.context.complete(blend_all(&self.context, splats, colors, tiles, camera, None, self.cutoffs.cutoffs()))
    }

    fn blend_occluded(
        &mut self,
        splats: &Splats,
        colors: &Colors,
        tiles: &Tiles,
        camera: &Camera,
        occlusion: &Vec<f32>,
    ) -> Result<Frame, CpuError> {
        let pixels = camera.width as usize * camera.height as usize;
        BufferLength::check(pixels, occlusion).map_err(CpuError::BufferLength)?;
        let occlusion = Some(occlusion.as_slice());
        self.context.complete(blend_all(
            &self.context,
            splats,
            colors,
            tiles,
            camera,
            occlusion,
            self.cutoffs.cutoffs(),
        ))
    }

    fn median_depths(&mut self, splats: &Splats, tiles: &Tiles, camera: &Camera) -> Result<Vec<f32>, CpuError> {
        self.context.complete(median_depths(&self.context, splats, tiles, camera, self.cutoffs.cutoffs()))
    }

    fn trace(&mut self, surface: Frame, light: &Light, camera: &Camera) -> Result<Frame, CpuError> {
        self.context.complete(trace(&self.context, surface, light.near_field.as_deref(), camera))
    }

    fn illuminate(&mut self, surface: Frame, light: &Light, camera: &Camera) -> Result<Frame, CpuError> {
        self.context.complete(illuminate(&self.context, surface, light.lamps.as_deref(), camera))
    }

    fn shade_pixels(
        &mut self,
        surface: Frame,
        light: Option<&Light>,
        camera: &Camera,
        rules: &RenderRules,
    ) -> Result<Frame, CpuError> {
        self.context.complete(shade_pixels(&self.context, surface, light, camera, rules))
    }
}

impl Executor for CpuExecutor {
    type LightGrad = LightGrad;
    type FrameGrad = FrameGrad;
    type SplatGrads = SplatGrads;
    type Target = Target;

    const IS_DEVICE: bool = false;

    fn target(&mut self, picture: &Picture<'_>) -> Result<Target, CpuError> {
        if let Some([expected, found]) = picture.wrong_len() {
            let Picture { width, height, .. } = *picture;
            return Err(CpuError::TargetSize { width, height, expected, found });
        }
        Ok(Target::new(picture))
    }

    fn loss(
        &mut self,
        frame: &Frame,
        target: &Target,
        camera: &Camera,
        weights: &LossWeights,
        background: [f32; 3],
    ) -> Result<FrameGrad, CpuError> {
        let (expected, found) = ([target.width, target.height], frame.size());
        if expected != found {
            return Err(CpuError::FrameSize { expected, found });
        }
        let (losses, grad) = loss_all(&self.context, frame, target, camera, weights, background);
        self.report.loss = losses;
        Ok(grad)
    }

    fn expose(&mut self, frame: Frame, exposure: &Exposure<f32>) -> Result<Frame, CpuError> {
        Ok(expose(&self.context, frame, exposure))
    }

    fn expose_vjp(&mut self, frame: &Frame, exposure: &Exposure<f32>, grad: FrameGrad) -> Result<FrameGrad, CpuError> {
        let (grad, exposure_grad) = expose_vjp(&self.context, frame, exposure, grad);
        self.report.exposure = Some(exposure_grad);
        Ok(grad)
    }

    fn shade_pixels_vjp(
        &mut self,
        surface: &Frame,
        light: Option<&Light>,
        camera: &Camera,
        rules: &RenderRules,
        grad: FrameGrad,
    ) -> Result<(FrameGrad, Option<LightGrad>), CpuError> {
        Ok(shade_pixels_vjp(&self.context, surface, light, camera, rules, grad))
    }

    fn blend_vjp(
        &mut self,
        splats: &Splats,
        colors: &Colors,
        tiles: &Tiles,
        frame: &Frame,
        grad: &FrameGrad,
        _camera: &Camera,
    ) -> Result<SplatGrads, CpuError> {
        Ok(blend_all_vjp(&self.context, splats, colors, tiles, frame, grad))
    }

    fn gaussians_vjp(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        camera: &Camera,
        splats: &Splats,
        light: Option<&Light>,
        rules: &RenderRules,
        weights: &LossWeights,
        grads: &SplatGrads,
    ) -> Result<(Gaussians<Vec<f32>>, Option<LightGrad>), CpuError> {
        let scene = Scene { shading: GaussianShading { layout: gaussians.layout, rules: *rules }, light };
        let (grad, light_grad, _) =
            gaussians_vjp(&self.context, gaussians, camera, splats, scene, weights, grads, false);
        Ok((grad, light_grad))
    }

    fn gaussians_and_camera_vjp(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        camera: &Camera,
        splats: &Splats,
        light: Option<&Light>,
        rules: &RenderRules,
        grads: &SplatGrads,
    ) -> Result<(Gaussians<Vec<f32>>, Option<LightGrad>, CameraGrad<Double>), CpuError> {
        let scene = Scene { shading: GaussianShading { layout: gaussians.layout, rules: *rules }, light };
        let weights = &LossWeights::NONE;
        Ok(gaussians_vjp(&self.context, gaussians, camera, splats, scene, weights, grads, true))
    }

    fn prefilter_vjp(
        &mut self,
        environment: &Environment<Vec<f32>>,
        light: &Light,
        grad: &LightGrad,
    ) -> Result<Vec<f32>, CpuError> {
        Ok(light.vjp(&self.context, environment, grad))
    }

    fn add(&mut self, sum: &mut Vec<f32>, term: &Vec<f32>) -> Result<(), CpuError> {
        BufferLength::check(sum.len(), term).map_err(CpuError::BufferLength)?;
        add_all(sum, term);
        Ok(())
    }

    fn optimise(
        &mut self,
        gaussians: &mut Gaussians<Vec<f32>>,
        moments: &mut AdamMoments<Vec<f32>>,
        grad: Gaussians<Vec<f32>>,
        rates: &[f32],
        step: u32,
    ) -> Result<(), CpuError> {
        let AdamMoments { mean, square } = moments;
        let size = StepSize::new(&self.context, rates, step);
        self.report.nonfinite += adam_blocks(&self.context, &mut gaussians.values, mean, square, &grad.values, &size);
        self.context.give(grad.values);
        Ok(())
    }

    fn update(
        &mut self,
        gaussians: &mut Gaussians<Vec<f32>>,
        moments: &mut AdamMoments<Vec<f32>>,
        splats: &Splats,
        light: Option<&Light>,
        grads: &SplatGrads,
        step: &TrainingStep<'_, Self>,
    ) -> Result<Option<LightGrad>, CpuError> {
        let scene = Scene { shading: GaussianShading { layout: gaussians.layout, rules: *step.rules }, light };
        let size = StepSize::new(&self.context, step.rates, step.number);
        let (nonfinite, light_grad) =
            update(&self.context, gaussians, moments, step.camera, splats, scene, step.weights, grads, &size);
        self.report.nonfinite += nonfinite;
        Ok(light_grad)
    }

    fn optimise_environment(
        &mut self,
        environment: &mut Environment<Vec<f32>>,
        moments: &mut AdamMoments<Vec<f32>>,
        grad: Vec<f32>,
        rate: f32,
        radiance_max: f32,
        step: u32,
    ) -> Result<(), CpuError> {
        let AdamMoments { mean, square } = moments;
        self.report.nonfinite += adam_all(&self.context, &mut environment.values, mean, square, &grad, rate, step);
        self.context.give(grad);
        if environment.activation == RadianceActivation::Identity {
            environment.values.iter_mut().for_each(|radiance| *radiance = radiance.clamp(0.0, radiance_max));
        }
        Ok(())
    }

    fn report(&mut self) -> Result<Option<StepReport>, CpuError> {
        Ok(Some(core::mem::take(&mut self.report)))
    }

    fn observe(
        &mut self,
        statistics: &mut Statistics<Vec<f32>>,
        splats: &Splats,
        grads: &SplatGrads,
        camera: &Camera,
    ) -> Result<(), CpuError> {
        densify::observe(&self.context, statistics, splats, grads, camera);
        Ok(())
    }

    fn densify(
        &mut self,
        gaussians: &mut Gaussians<Vec<f32>>,
        moments: &mut AdamMoments<Vec<f32>>,
        statistics: &mut Statistics<Vec<f32>>,
        rules: &DensifyRules,
        count_max: usize,
        key: RandomKey,
    ) -> Result<DensifyReport, CpuError> {
        Ok(densify::densify(gaussians, moments, statistics, rules, count_max, key))
    }

    fn sampling(&mut self, gaussians: &mut Gaussians<Vec<f32>>, views: &[Camera]) -> Result<(), CpuError> {
        sampling(&self.context, gaussians, views);
        Ok(())
    }

    fn limit_plane(
        &mut self,
        gaussians: &mut Gaussians<Vec<f32>>,
        moments: &mut AdamMoments<Vec<f32>>,
        plane: usize,
        ceiling: f32,
        outside: Option<Ball>,
    ) -> Result<(), CpuError> {
        densify::limit_plane(gaussians, moments, plane, ceiling, outside);
        Ok(())
    }
}
