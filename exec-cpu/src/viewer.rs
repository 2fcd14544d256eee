//! Pictures with other cutoffs: what is only looked at may be cut off sooner, or later.

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
    cutoffs::Cutoffs,
    executor::Renderer,
    prefilter::{LevelRange, PrefilterScheme},
    rules::RenderRules,
    scene::{Environment, Gaussians},
};

/// A [`CpuExecutor`] that makes pictures within [`Cutoffs`] of one's choice. It is no executor, because gradients know the
/// usual ones alone; within [`Cutoffs::DEFAULT`] its pictures are those of the executor to the last bit.
#[derive(Debug, Default)]
pub struct CpuViewer {
    exec: CpuExecutor,
    cutoffs: Cutoffs,
}

impl CpuViewer {
    /// A viewer within these cutoffs.
    pub fn new(cutoffs: Cutoffs) -> Self {
        Self { exec: CpuExecutor::new(), cutoffs }
    }
    /// Other cutoffs for the pictures that follow. Splats that were projected before belong to the former ones.
    pub fn set_cutoffs(&mut self, cutoffs: Cutoffs) {
        self.cutoffs = cutoffs;
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
        Ok(project_all(&self.exec.machine, gaussians, camera, &self.cutoffs))
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
        Ok(blend_all(&self.exec.machine, splats, colors, tiles, camera, &self.cutoffs))
    }

    fn shade_pixels(&mut self, surface: Frame, light: Option<&Light>, camera: &Camera) -> Result<Frame, CpuError> {
        self.exec.shade_pixels(surface, light, camera)
    }
}
