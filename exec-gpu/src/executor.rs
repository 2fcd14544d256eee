//! The executor: core's contract, stage by stage.

use crate::{
    bin::{Tiles, bin},
    blend::{Frame, blend, read},
    blend_vjp::{FrameGrad, SplatGrads, blend_vjp},
    densify::{densify, limit_plane, observe},
    device::{Gpu, GpuError},
    expose::{expose, expose_vjp},
    gaussians_vjp::{Way, gaussians_vjp},
    loss::{Target, loss},
    machine::Machine,
    optimise::{optimise, optimise_environment},
    pieces::Pieces,
    pixel::{shade_pixels, shade_pixels_vjp},
    prefilter::{Light, LightGrad, Weights, prefilter, prefilter_vjp},
    project::{Splats, project},
    shade::{Colors, shade},
};
use specula_core::{
    camera::Camera,
    densify::DensifyRules,
    executor::{BufferLength, DensifyReport, Executor, RandomKey, Renderer, StepReport},
    expose::Exposure,
    loss::LossWeights,
    pack::Storage,
    prefilter::{LevelRange, PrefilterScheme},
    region::Ball,
    rules::RenderRules,
    scene::{Environment, Gaussians},
    state::{AdamMoments, Statistics},
};
use std::sync::Arc;

/// Runs the stages on a device of wgpu.
#[derive(Debug)]
pub struct GpuExecutor {
    pub(crate) machine: Machine,
    /// The prefilter's weights of the last scheme, resolution and levels.
    weights: Option<Arc<Weights>>,
}

impl GpuExecutor {
    /// An executor on this device.
    pub fn new(gpu: Gpu) -> Self {
        Self { machine: Machine::new(gpu), weights: None }
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.machine.gpu
    }

    /// Bytes of the device that arrays take, those included that are kept to be used again.
    pub fn memory(&self) -> u64 {
        self.machine.memory()
    }

    /// Gives back memory that no array uses.
    pub fn forget_memory(&mut self) {
        self.machine.forget_memory();
    }

    pub(crate) fn weights(&mut self, key: (PrefilterScheme, usize, LevelRange)) -> Result<Arc<Weights>, GpuError> {
        let (scheme, resolution, _) = key;
        let least = scheme.resolution_min();
        if resolution < least || !resolution.is_power_of_two() {
            return Err(GpuError::LightResolution { resolution, least });
        }
        match &self.weights {
            Some(weights) if weights.key == key => Ok(weights.clone()),
            _ => {
                let weights = Weights::new(&mut self.machine, key)?;
                self.weights = Some(weights.clone());
                Ok(weights)
            }
        }
    }
}

impl Renderer for GpuExecutor {
    type Array = Pieces;
    type Light = Light;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = GpuError;

    fn upload(&mut self, values: &[f32]) -> Result<Pieces, GpuError> {
        self.machine.upload("numbers", values).map(Pieces::from)
    }

    fn upload_gaussians<A: AsRef<[f32]>>(&mut self, gaussians: &Gaussians<A>) -> Result<Gaussians<Pieces>, GpuError> {
        let division = self.machine.division(gaussians.layout.plane_count());
        let values = gaussians.values.as_ref();
        Ok(gaussians.with_values(self.machine.upload_pieces("Gaussians", values, gaussians.count, division)?))
    }

    fn download(&mut self, array: &Pieces, values: &mut [f32]) -> Result<(), GpuError> {
        BufferLength::check(array.len(), values).map_err(GpuError::BufferLength)?;
        self.machine.download_pieces(array, values)
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), GpuError> {
        BufferLength::check(frame.len_of_values(), values).map_err(GpuError::BufferLength)?;
        read(&mut self.machine, frame, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Pieces>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, GpuError> {
        let weights = self.weights((scheme, environment.resolution, levels))?;
        prefilter(&mut self.machine, &weights, &environment.with_values(environment.values.whole()), Storage::F32)
    }

    fn project(&mut self, gaussians: &Gaussians<Pieces>, camera: &Camera) -> Result<Splats, GpuError> {
        project(&mut self.machine, &gaussians.with_values(&gaussians.values), Storage::F32, camera)
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Pieces>,
        camera: &Camera,
        splats: &mut Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, GpuError> {
        let gaussians = gaussians.with_values(&gaussians.values);
        shade(&mut self.machine, &gaussians, Storage::F32, camera, splats, light, rules)
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
        bin(&mut self.machine, splats, camera, None)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, GpuError> {
        blend(&mut self.machine, splats, colors, tiles, camera)
    }

    fn shade_pixels(&mut self, surface: Frame, light: Option<&Light>, camera: &Camera) -> Result<Frame, GpuError> {
        shade_pixels(&mut self.machine, surface, light, camera)
    }
}

impl Executor for GpuExecutor {
    type LightGrad = LightGrad;
    type FrameGrad = FrameGrad;
    type SplatGrads = SplatGrads;
    type Target = Target;

    fn target(&mut self, width: usize, height: usize, rgba: &[u8]) -> Result<Target, GpuError> {
        Target::new(&mut self.machine, [width, height], rgba)
    }

    fn bin_for_step(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
        let room = self.machine.room;
        bin(&mut self.machine, splats, camera, room)
    }

    fn loss(
        &mut self,
        frame: &Frame,
        target: &Target,
        camera: &Camera,
        weights: &LossWeights,
        background: [f32; 3],
    ) -> Result<FrameGrad, GpuError> {
        loss(&mut self.machine, frame, target, camera, weights, background)
    }

    fn expose(&mut self, frame: Frame, exposure: &Exposure<f32>) -> Result<Frame, GpuError> {
        expose(&mut self.machine, frame, exposure)
    }

    fn expose_vjp(&mut self, frame: &Frame, exposure: &Exposure<f32>, grad: FrameGrad) -> Result<FrameGrad, GpuError> {
        expose_vjp(&mut self.machine, frame, exposure, grad)
    }

    fn shade_pixels_vjp(
        &mut self,
        surface: &Frame,
        light: Option<&Light>,
        camera: &Camera,
        grad: FrameGrad,
    ) -> Result<(FrameGrad, Option<LightGrad>), GpuError> {
        shade_pixels_vjp(&mut self.machine, surface, light, camera, grad)
    }

    fn blend_vjp(
        &mut self,
        splats: &Splats,
        colors: &Colors,
        tiles: &Tiles,
        frame: &Frame,
        grad: &FrameGrad,
        camera: &Camera,
    ) -> Result<SplatGrads, GpuError> {
        blend_vjp(&mut self.machine, splats, colors, tiles, frame, grad, camera)
    }

    fn gaussians_vjp(
        &mut self,
        gaussians: &Gaussians<Pieces>,
        camera: &Camera,
        _splats: &Splats,
        light: Option<&Light>,
        rules: &RenderRules,
        weights: &LossWeights,
        grads: &SplatGrads,
    ) -> Result<(Gaussians<Pieces>, Option<LightGrad>), GpuError> {
        let way = Way { light, rules, weights, grads };
        gaussians_vjp(&mut self.machine, gaussians, camera, &way)
    }

    fn prefilter_vjp(
        &mut self,
        environment: &Environment<Pieces>,
        light: &Light,
        grad: &LightGrad,
    ) -> Result<Pieces, GpuError> {
        let environment = environment.with_values(environment.values.whole());
        prefilter_vjp(&mut self.machine, &environment, light, grad).map(Pieces::from)
    }

    fn optimise(
        &mut self,
        gaussians: &mut Gaussians<Pieces>,
        moments: &mut AdamMoments<Pieces>,
        grad: Gaussians<Pieces>,
        rates: &[f32],
        step: u32,
    ) -> Result<(), GpuError> {
        optimise(&mut self.machine, gaussians, moments, &grad, rates, step)
    }

    fn optimise_environment(
        &mut self,
        environment: &mut Environment<Pieces>,
        moments: &mut AdamMoments<Pieces>,
        grad: Pieces,
        rate: f32,
        radiance_max: f32,
        step: u32,
    ) -> Result<(), GpuError> {
        optimise_environment(&mut self.machine, environment, moments, &grad, rate, radiance_max, step)
    }

    fn report(&mut self) -> Result<Option<StepReport>, GpuError> {
        self.machine.report()
    }

    fn observe(
        &mut self,
        statistics: &mut Statistics<Pieces>,
        splats: &Splats,
        grads: &SplatGrads,
        camera: &Camera,
    ) -> Result<(), GpuError> {
        observe(&mut self.machine, statistics, splats, grads, camera)
    }

    fn densify(
        &mut self,
        gaussians: &mut Gaussians<Pieces>,
        moments: &mut AdamMoments<Pieces>,
        statistics: &mut Statistics<Pieces>,
        rules: &DensifyRules,
        count_max: usize,
        key: RandomKey,
    ) -> Result<DensifyReport, GpuError> {
        densify(&mut self.machine, gaussians, moments, statistics, rules, count_max, key)
    }

    fn limit_plane(
        &mut self,
        gaussians: &mut Gaussians<Pieces>,
        moments: &mut AdamMoments<Pieces>,
        plane: usize,
        ceiling: f32,
        outside: Option<Ball>,
    ) -> Result<(), GpuError> {
        limit_plane(&mut self.machine, gaussians, moments, plane, ceiling, outside)
    }
}
