//! The executor: core's contract, stage by stage.

use crate::{
    bin::{Tiles, bin},
    blend::{Frame, blend, read},
    device::{Gpu, GpuError},
    machine::Machine,
    memory::Array,
    pixel::shade_pixels,
    prefilter::{Light, Weights, prefilter},
    project::{Splats, project},
    shade::{Colors, shade},
};
use specula_core::{
    camera::Camera,
    executor::{RenderRules, Renderer},
    prefilter::{LevelRange, PrefilterScheme},
    scene::{Environment, Gaussians},
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

    fn weights(&mut self, key: (PrefilterScheme, usize, LevelRange)) -> Result<Arc<Weights>, GpuError> {
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
    type Array = Array;
    type Light = Light;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = GpuError;

    fn upload(&mut self, values: &[f32]) -> Result<Array, GpuError> {
        self.machine.upload("numbers", values)
    }

    fn download(&mut self, array: &Array, values: &mut [f32]) -> Result<(), GpuError> {
        self.machine.download(array, 0, values)
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), GpuError> {
        read(&mut self.machine, frame, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Array>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, GpuError> {
        let weights = self.weights((scheme, environment.resolution, levels))?;
        prefilter(&mut self.machine, &weights, environment)
    }

    fn project(&mut self, gaussians: &Gaussians<Array>, camera: &Camera) -> Result<Splats, GpuError> {
        project(&mut self.machine, gaussians, camera)
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Array>,
        camera: &Camera,
        splats: &Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, GpuError> {
        shade(&mut self.machine, gaussians, camera, splats, light, rules)
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
        bin(&mut self.machine, splats, camera)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, GpuError> {
        blend(&mut self.machine, splats, colors, tiles, camera)
    }

    fn shade_pixels(&mut self, surface: Frame, light: Option<&Light>, camera: &Camera) -> Result<Frame, GpuError> {
        shade_pixels(&mut self.machine, surface, light, camera)
    }
}
