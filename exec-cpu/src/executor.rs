//! The executor: core's contract, stage by stage.

use crate::{
    bin::{Tiles, bin_all, depth_order},
    blend::{SplatGrads, blend_all, blend_all_vjp},
    densify,
    expose::{expose, expose_vjp},
    frame::{Frame, FrameGrad},
    loss::{Target, loss_all},
    machine::Machine,
    optimise::{StepSize, adam_all, adam_blocks},
    pixel::{shade_pixels, shade_pixels_vjp},
    prefilter::{Light, LightGrad},
    project::{Splats, project_all},
    shade::{Colors, Scene, gaussians_vjp, shade_all, update},
};
use specula_core::{
    attributes::GaussianShading,
    camera::Camera,
    cutoffs::Cutoffs,
    densify::DensifyRules,
    executor::{BufferLength, DensifyReport, Executor, RandomKey, Renderer, StepReport, TrainingStep},
    expose::Exposure,
    loss::LossWeights,
    prefilter::{LevelRange, Levels, PrefilterScheme},
    region::Ball,
    rules::RenderRules,
    scene::{Environment, Gaussians, RadianceActivation},
    state::{AdamMoments, Statistics},
};
use specula_prefilter::Operator;
use std::sync::Arc;

/// Why a stage could not run.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum CpuError {
    /// A picture's bytes do not fit its size.
    #[error("a picture of {width} × {height} pixels needs {expected} bytes of RGBA, but has {found}")]
    TargetSize {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes that it should have.
        expected: usize,
        /// Bytes that it has.
        found: usize,
    },
    /// A light's resolution cannot be filtered.
    #[error("a light of resolution {resolution} cannot be filtered; use a power of two, at least {least}")]
    LightResolution {
        /// Texels along an edge of a face.
        resolution: usize,
        /// The smallest that can be.
        least: usize,
    },
    /// Tiles hold more splats than are counted.
    #[error(
        "the tiles of a picture hold more than 4 294 967 295 splats; use a smaller picture, or fewer or smaller Gaussians"
    )]
    TooManySplats,
    /// A picture was compared with one of another size.
    #[error("a picture of {found:?} pixels was compared with one of {expected:?}")]
    FrameSize {
        /// Width and height of the target.
        expected: [usize; 2],
        /// Width and height of the frame.
        found: [usize; 2],
    },
    /// A buffer of another length than the numbers that are read into it.
    #[error(transparent)]
    BufferLength(BufferLength),
}

/// Runs the stages on the threads of rayon's current pool.
#[derive(Debug)]
pub struct CpuExecutor {
    pub(crate) machine: Machine,
    /// The prefilter's operator of the last scheme, resolution and levels.
    operator: Option<((PrefilterScheme, usize, LevelRange), Arc<Operator>)>,
    /// What came of the stages since the last report.
    report: StepReport,
}

impl Default for CpuExecutor {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuExecutor {
    /// An executor with the widest vectors that this machine has.
    pub fn new() -> Self {
        Self { machine: Machine::new(), operator: None, report: StepReport::default() }
    }

    /// The vectors that it computes with, in words.
    pub fn vectors(&self) -> String {
        let name = format!("{:?}", self.machine.level);
        format!("{} vectors", name.split('(').next().unwrap_or_default())
    }

    /// Depth and number of the Gaussians that are drawn, front to back; ties in their order.
    pub fn depth_order(&self, splats: &Splats) -> Vec<(f32, u32)> {
        let order = depth_order(&self.machine, &splats.records);
        order.iter().map(|(depth, gaussian)| (f32::from_bits(*depth), *gaussian)).collect()
    }

    /// Filters light into levels of one's own, with the weights of a scheme. The first of them is as fine as the light.
    pub fn prefilter_into(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: Levels,
    ) -> Result<Light, CpuError> {
        let first = levels.as_slice()[0].resolution;
        if environment.resolution != first {
            return Err(CpuError::LightResolution { resolution: environment.resolution, least: first });
        }
        Ok(self.filter(environment, &Arc::new(Operator::of_levels(scheme, levels, LevelRange::ALL))))
    }

    /// Filters light with weights that are at hand, for a base of its resolution.
    pub fn filter(&mut self, environment: &Environment<Vec<f32>>, operator: &Arc<Operator>) -> Light {
        assert_eq!(environment.resolution, operator.base_resolution(), "weights are for one resolution");
        Light::new(&self.machine, operator.clone(), environment)
    }

    fn operator(
        &mut self,
        scheme: PrefilterScheme,
        resolution: usize,
        levels: LevelRange,
    ) -> Result<Arc<Operator>, CpuError> {
        let least = scheme.resolution_min();
        if resolution < least || !resolution.is_power_of_two() {
            return Err(CpuError::LightResolution { resolution, least });
        }
        match &self.operator {
            Some((key, operator)) if *key == (scheme, resolution, levels) => Ok(operator.clone()),
            _ => {
                let operator = Arc::new(Operator::new(scheme, resolution, levels));
                self.operator = Some(((scheme, resolution, levels), operator.clone()));
                Ok(operator)
            }
        }
    }
}

impl Renderer for CpuExecutor {
    type Array = Vec<f32>;
    type Light = Light;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = CpuError;

    fn upload(&mut self, values: &[f32]) -> Result<Vec<f32>, CpuError> {
        Ok(values.to_vec())
    }

    fn download(&mut self, array: &Vec<f32>, values: &mut [f32]) -> Result<(), CpuError> {
        BufferLength::check(array.len(), values).map_err(CpuError::BufferLength)?;
        values.copy_from_slice(array);
        Ok(())
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), CpuError> {
        BufferLength::check(frame.len_of_values(), values).map_err(CpuError::BufferLength)?;
        frame.read(values);
        Ok(())
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, CpuError> {
        let operator = self.operator(scheme, environment.resolution, levels)?;
        Ok(Light::new(&self.machine, operator, environment))
    }

    fn project(&mut self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Splats, CpuError> {
        Ok(project_all(&self.machine, gaussians, camera, &Cutoffs::DEFAULT))
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
        Ok(shade_all(&self.machine, gaussians, camera, splats, scene))
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, CpuError> {
        bin_all(&self.machine, splats, camera)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, CpuError> {
        Ok(blend_all(&self.machine, splats, colors, tiles, camera, &Cutoffs::DEFAULT))
    }

    fn shade_pixels(&mut self, surface: Frame, light: Option<&Light>, camera: &Camera) -> Result<Frame, CpuError> {
        Ok(shade_pixels(&self.machine, surface, light, camera))
    }
}

impl Executor for CpuExecutor {
    type LightGrad = LightGrad;
    type FrameGrad = FrameGrad;
    type SplatGrads = SplatGrads;
    type Target = Target;

    fn target(&mut self, width: usize, height: usize, rgba: &[u8]) -> Result<Target, CpuError> {
        let expected = width * height * 4;
        if rgba.len() != expected {
            return Err(CpuError::TargetSize { width, height, expected, found: rgba.len() });
        }
        Ok(Target::new(width, height, rgba))
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
        let (losses, grad) = loss_all(&self.machine, frame, target, camera, weights, background);
        self.report.loss = losses;
        Ok(grad)
    }

    fn expose(&mut self, frame: Frame, exposure: &Exposure<f32>) -> Result<Frame, CpuError> {
        Ok(expose(&self.machine, frame, exposure))
    }

    fn expose_vjp(&mut self, frame: &Frame, exposure: &Exposure<f32>, grad: FrameGrad) -> Result<FrameGrad, CpuError> {
        let (grad, of_exposure) = expose_vjp(&self.machine, frame, exposure, grad);
        self.report.exposure = Some(of_exposure);
        Ok(grad)
    }

    fn shade_pixels_vjp(
        &mut self,
        surface: &Frame,
        light: Option<&Light>,
        camera: &Camera,
        grad: FrameGrad,
    ) -> Result<(FrameGrad, Option<LightGrad>), CpuError> {
        Ok(shade_pixels_vjp(&self.machine, surface, light, camera, grad))
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
        Ok(blend_all_vjp(&self.machine, splats, colors, tiles, frame, grad))
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
        Ok(gaussians_vjp(&self.machine, gaussians, camera, splats, scene, weights, grads))
    }

    fn prefilter_vjp(
        &mut self,
        environment: &Environment<Vec<f32>>,
        light: &Light,
        grad: &LightGrad,
    ) -> Result<Vec<f32>, CpuError> {
        Ok(light.vjp(&self.machine, environment.activation, grad))
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
        let size = StepSize::new(&self.machine, rates, step);
        self.report.nonfinite += adam_blocks(&self.machine, &mut gaussians.values, mean, square, &grad.values, &size);
        self.machine.numbers.give(grad.values);
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
        let size = StepSize::new(&self.machine, step.rates, step.number);
        let (nonfinite, of_light) = update(&self.machine, gaussians, moments, step, splats, scene, grads, &size);
        self.report.nonfinite += nonfinite;
        Ok(of_light)
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
        self.report.nonfinite += adam_all(&self.machine, &mut environment.values, mean, square, &grad, rate, step);
        self.machine.numbers.give(grad);
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
        densify::observe(&self.machine, statistics, splats, grads, camera);
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
