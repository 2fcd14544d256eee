//! Pictures of what is stored as it was asked for.

use crate::{
    bin::Tiles,
    blend::Frame,
    device::GpuError,
    executor::GpuExecutor,
    pieces::Pieces,
    prefilter::{Light, prefilter},
    project::{Splats, project},
    shade::{Colors, shade},
};
use specula_core::{
    camera::Camera,
    executor::Renderer,
    pack::{Storage, pack, unpack},
    prefilter::{LevelRange, PrefilterScheme},
    rules::RenderRules,
    scene::{BLOCK, Environment, Gaussians, Layout},
};

/// Renders on a device of wgpu and stores Gaussians and filtered light as it was told. It is no
/// [`Executor`](specula_core::executor::Executor): training needs its numbers in full.
#[derive(Debug)]
pub struct GpuViewer {
    exec: GpuExecutor,
    storage: Storage,
}

/// Numbers of a [`GpuViewer`].
#[derive(Debug)]
pub struct Stored {
    words: Pieces,
    /// The planes of the Gaussians that the words hold as halves; none where they are numbers in full.
    halves_of: Option<Layout>,
}

impl Stored {
    fn storage(&self) -> Storage {
        if self.halves_of.is_some() { Storage::F16 } else { Storage::F32 }
    }
    /// Bytes that they take on the device.
    pub fn bytes(&self) -> usize {
        size_of::<u32>() * self.words.len()
    }
    /// How many arrays they lie in.
    pub fn piece_count(&self) -> usize {
        self.words.piece_count()
    }
}

impl GpuViewer {
    /// Renders with an executor.
    pub fn new(exec: GpuExecutor, storage: Storage) -> Self {
        Self { exec, storage }
    }

    /// How Gaussians and light are stored from now on.
    pub fn set_storage(&mut self, storage: Storage) {
        self.storage = storage;
    }

    /// The executor, whose arrays are its own.
    pub fn executor(&mut self) -> &mut GpuExecutor {
        &mut self.exec
    }

    /// Rounded and packed on the host, so that every device has the same halves, and has no more of them than it needs.
    fn upload_halves<A: AsRef<[f32]>>(&mut self, gaussians: &Gaussians<A>) -> Result<Pieces, GpuError> {
        let (count, words_each) = (gaussians.count, Storage::F16.words(gaussians.layout));
        let mut words = vec![0; count.next_multiple_of(BLOCK) * words_each];
        pack(gaussians, &mut words);
        let division = self.exec.machine.division(words_each);
        self.exec.machine.upload_pieces("Gaussians", &words, count, division)
    }
}

impl Renderer for GpuViewer {
    type Array = Stored;
    type Light = Light;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = GpuError;

    /// Numbers in full.
    fn upload(&mut self, values: &[f32]) -> Result<Stored, GpuError> {
        Ok(Stored { words: self.exec.upload(values)?, halves_of: None })
    }

    fn upload_gaussians<A: AsRef<[f32]>>(&mut self, gaussians: &Gaussians<A>) -> Result<Gaussians<Stored>, GpuError> {
        let stored = match self.storage {
            Storage::F32 => Stored { words: self.exec.upload_gaussians(gaussians)?.values, halves_of: None },
            Storage::F16 => Stored { words: self.upload_halves(gaussians)?, halves_of: Some(gaussians.layout) },
        };
        Ok(gaussians.with_values(stored))
    }

    fn download(&mut self, array: &Stored, values: &mut [f32]) -> Result<(), GpuError> {
        let Some(layout) = array.halves_of else { return self.exec.download(&array.words, values) };
        let mut words = vec![0; array.words.len()];
        self.exec.machine.download_pieces(&array.words, &mut words)?;
        unpack(&words, layout, values);
        Ok(())
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), GpuError> {
        self.exec.read_frame(frame, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<Stored>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, GpuError> {
        let weights = self.exec.weights((scheme, environment.resolution, levels))?;
        let environment = environment.with_values(environment.values.words.whole());
        prefilter(&mut self.exec.machine, &weights, &environment, self.storage)
    }

    fn project(&mut self, gaussians: &Gaussians<Stored>, camera: &Camera) -> Result<Splats, GpuError> {
        let Stored { words, .. } = &gaussians.values;
        project(&mut self.exec.machine, &gaussians.with_values(words), gaussians.values.storage(), camera)
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<Stored>,
        camera: &Camera,
        splats: &mut Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, GpuError> {
        let storage = gaussians.values.storage();
        let gaussians = gaussians.with_values(&gaussians.values.words);
        shade(&mut self.exec.machine, &gaussians, storage, camera, splats, light, rules)
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
        self.exec.bin(splats, camera)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, GpuError> {
        self.exec.blend(splats, colors, tiles, camera)
    }

    fn shade_pixels(&mut self, surface: Frame, light: Option<&Light>, camera: &Camera) -> Result<Frame, GpuError> {
        self.exec.shade_pixels(surface, light, camera)
    }
}
