//! Pictures with other limits: what is only looked at may be cut off sooner, or later.

use crate::{
    CpuError, CpuExecutor,
    bin::Tiles,
    blend::blend_all,
    frame::Frame,
    prefilter::Light,
    project::{Splats, project_all},
    shade::Colors,
};
use specula_core::{
    camera::Camera,
    executor::{RenderRules, Renderer},
    limits::Limits,
    prefilter::{LevelRange, PrefilterScheme},
    scene::{Environment, Gaussians},
};

/// A [`CpuExecutor`] that makes pictures within [`Limits`] of one's choice. It is no executor, because gradients know the
/// usual ones alone; within [`Limits::USUAL`] its pictures are those of the executor to the last bit.
#[derive(Debug, Default)]
pub struct CpuViewer {
    exec: CpuExecutor,
    limits: Limits,
}

impl CpuViewer {
    /// A viewer within these limits.
    pub fn new(limits: Limits) -> Self {
        Self { exec: CpuExecutor::new(), limits }
    }
    /// Other limits for the pictures that follow. Splats that were projected before belong to the former ones.
    pub fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
    }
}

impl Renderer for CpuViewer {
    type Array = Vec<f32>;
    type Light = Light;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = CpuError;

    fn upload(&mut self, values: &[f32]) -> Result<Vec<f32>, CpuError> {
        self.exec.upload(values)
    }

    fn download(&mut self, array: &Vec<f32>, values: &mut [f32]) -> Result<(), CpuError> {
        self.exec.download(array, values)
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), CpuError> {
        self.exec.read_frame(frame, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Vec<f32>>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, CpuError> {
        self.exec.prefilter(environment, scheme, levels)
    }

    fn project(&mut self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Splats, CpuError> {
        Ok(project_all(&self.exec.machine, gaussians, camera, &self.limits))
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        camera: &Camera,
        splats: &mut Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, CpuError> {
        self.exec.shade(gaussians, camera, splats, light, rules)
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, CpuError> {
        self.exec.bin(splats, camera)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, CpuError> {
        Ok(blend_all(&self.exec.machine, splats, colors, tiles, camera, &self.limits))
    }

    fn shade_pixels(&mut self, surface: Frame, light: Option<&Light>, camera: &Camera) -> Result<Frame, CpuError> {
        self.exec.shade_pixels(surface, light, camera)
    }
}
