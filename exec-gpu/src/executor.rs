//! Executor: core's contract, stage by stage.

use crate::{
    device::{
        ceilings::{self, Ceilings},
        chunks::ChunkedArray,
        context::Context,
        error::GpuError,
        gpu::Gpu,
        kernel_set::KernelSet,
        memory::Array,
        timer::{KernelTime, KernelTimer},
    },
    stages::{
        add::add,
        bin::{Tiles, bin},
        blend::{blend, read},
        blend_in_order::blend_in_order,
        blend_vjp::{ReplayDivision, SplatGrads, blend_vjp},
        densify::densify,
        expose::expose,
        expose_vjp::{ExposureSums, expose_vjp},
        frame::{Frame, FrameContent, FrameGrad},
        gaussians_vjp::{BackwardInputs, gaussians_vjp},
        illuminate::{Lamps, illuminate},
        light::LightGrad,
        light_network::NetworkTexels,
        limit_plane::limit_plane,
        loss::{Losses, Target, loss},
        median_depths::median_depths,
        observe::observe,
        optimise::{optimise, optimise_environment},
        prefilter::{Light, Weights, evaluated, prefilter},
        prefilter_vjp::prefilter_vjp,
        project::{Splats, project},
        sampling::sampling,
        shade::{Colors, shade},
        shade_pixels::shade_pixels,
        shade_pixels_vjp::shade_pixels_vjp,
        step_counters::{Capacity, StepCounters, StepCounts},
        trace::{trace, upload_near_field},
    },
};
use core::{fmt::Debug, iter, mem, ops::Range};
use specula_core::{
    camera::{Camera, CameraGrad},
    color::Picture,
    cutoffs::BlendOrder,
    densify::DensifyRules,
    double::Double,
    executor::{BufferLength, DensifyReport, Executor, Feature, Occluder, RandomKey, Renderer, StepReport},
    expose::Exposure,
    lamps::Lamp,
    light_network::LightNetworkError,
    loss::{LossReport, LossWeights},
    near_field::NearField,
    pack::{Storage, pack, unpack, unpacked_len},
    prefilter::{LevelRange, PrefilterScheme},
    region::Ball,
    rules::RenderRules,
    scene::{BLOCK, Environment, Gaussians},
    state::{AdamMoments, Statistics},
};
use std::sync::Arc;
use wgpu::CommandEncoder;

/// Storage format of an executor's Gaussians and filtered lights.
pub trait Precision: Debug {
    /// The format.
    fn storage(&self) -> Storage;
}

/// Capacity that a frame needs.
#[derive(Clone, Copy, Debug)]
pub struct FrameCapacity(Capacity);

/// Result of [`GpuExecutor::frame_status_later`].
#[derive(Clone, Copy, Debug)]
pub struct FrameStatus {
    /// Whether all splats are in the frame; otherwise they exceeded the capacity, and the frame
    /// shows none.
    pub is_complete: bool,
    /// Capacity that the frame needs, for [`GpuExecutor::grant`].
    pub capacity: FrameCapacity,
}

impl FrameStatus {
    fn new(counters: &[u8], gpu: &Gpu) -> Result<Self, GpuError> {
        let counts = StepCounts::new(&bytemuck::pod_collect_to_vec::<u8, u32>(counters));
        Ok(Self { is_complete: !counts.exceeds_capacity, capacity: FrameCapacity(counts.required(gpu)?) })
    }
}

/// Result of [`GpuExecutor::read_frame_later`].
#[derive(Clone, Debug)]
pub struct LaterFrame {
    /// Values of the frame; `None` if its splats exceeded the capacity.
    pub values: Option<Vec<f32>>,
    /// Number of its planes.
    pub planes: usize,
    /// Capacity that the frame needs, for [`GpuExecutor::grant`].
    pub capacity: FrameCapacity,
}

/// 32 bits, as training needs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Full;

impl Precision for Full {
    fn storage(&self) -> Storage {
        Storage::F32
    }
}

/// Format chosen at run time, only for rendering.
impl Precision for Storage {
    fn storage(&self) -> Storage {
        *self
    }
}

/// Executor on a device of wgpu.
///
/// The parameter is the storage format. With [`Full`] precision it is an [`Executor`], which
/// renders and trains; with a [`Storage`] chosen at run time it is a [`Renderer`], which may store
/// Gaussians and lights as halves.
///
/// Contributions of single pixels and Gaussians to the gradient of a texel of the light are clamped
/// to ± 2¹⁸, unlike on the CPU: they are summed as integers, independent of the order.
#[derive(Debug)]
pub struct GpuExecutor<P = Full> {
    pub(crate) context: Context,
    precision: P,
    /// Order of splats in a pixel; training only supports that of means.
    order: BlendOrder,
    /// Weights of the last prefilter.
    weights: Option<Arc<Weights>>,
    /// Texels of the last network light.
    network: Option<Arc<NetworkTexels>>,
    /// Counters of the current training step.
    pub(crate) counters: StepCounters,
    /// Capacity of training steps, after the first has counted its pairs.
    pub(crate) capacity: Option<Capacity>,
    /// Capacity of pictures that are read later; `None` if each counts its pairs first.
    picture_capacity: Option<Capacity>,
    pub(crate) replay: ReplayDivision,
    /// Losses of the current training step.
    losses: Option<Losses>,
    /// Gradient of the exposure in the current training step.
    exposure_sums: Option<ExposureSums>,
}

impl GpuExecutor {
    /// An executor with full precision.
    pub fn new(gpu: Gpu) -> Self {
        Self::with_precision(gpu, Full)
    }
}

impl GpuExecutor<Storage> {
    /// A renderer that stores Gaussians and filtered lights in a format.
    pub fn viewer(gpu: Gpu, storage: Storage) -> Self {
        Self::with_precision(gpu, storage)
    }

    /// Sets the storage format of later Gaussians and lights.
    pub fn set_storage(&mut self, storage: Storage) {
        self.precision = storage;
    }

    /// Prepares to render pictures without blocking: their splats are sorted with the capacity of
    /// earlier ones. They may be incomplete, as only [`GpuExecutor::read_frame_later`] and
    /// [`GpuExecutor::frame_status_later`] tell.
    pub fn read_later(&mut self) {
        self.picture_capacity = Some(Capacity::default());
    }

    /// Records stages into the encoder of another program, which submits it: nothing is submitted,
    /// nothing waits, kernels are not timed. Pictures need [`GpuExecutor::read_later`], and
    /// [`GpuExecutor::frame_status_later`] tells whether they are complete: the first one is not,
    /// since no capacity was granted. [`Composer::draw`](crate::Composer::draw) and
    /// [`DepthReader::read`](crate::DepthReader::read) may use the same encoder. The program
    /// submits it before it renders again, which may reuse the memory of its arrays.
    ///
    /// ```no_run
    /// # use specula_core::{camera::Camera, executor::Renderer, pipeline::render};
    /// # use specula_core::{rules::RenderRules, scene::Gaussians};
    /// # use specula_gpu::{Composer, GpuError, GpuExecutor};
    /// # fn draw(
    /// #     exec: &mut GpuExecutor<specula_core::pack::Storage>,
    /// #     gaussians: &Gaussians<<GpuExecutor as Renderer>::Array>,
    /// #     camera: &Camera,
    /// #     rules: &RenderRules,
    /// #     composer: &Composer,
    /// #     descriptor: &wgpu::RenderPassDescriptor<'_>,
    /// #     encoder: &mut wgpu::CommandEncoder,
    /// # ) -> Result<(), GpuError> {
    /// let frame = exec.record(encoder, |exec| render(exec, gaussians, None, camera, rules))?;
    /// composer.draw(exec, &frame, &mut encoder.begin_render_pass(descriptor))
    /// # }
    /// ```
    ///
    /// # Errors
    ///
    /// Those of the stages; [`GpuError::NotSubmitted`] for those that read a result on the host,
    /// such as a picture whose pairs are counted first.
    pub fn record<T>(
        &mut self,
        encoder: &mut CommandEncoder,
        stages: impl FnOnce(&mut Self) -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let timer = self.context.start_recording(encoder)?;
        let result = stages(self);
        self.context.end_recording(encoder, timer);
        result
    }

    /// Planes of a frame in the order of [`Renderer::read_frame`], after the device is done; `None`
    /// if the frame exceeded the capacity: then render it again, after [`GpuExecutor::grant`].
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub fn read_frame_later(
        &mut self,
        frame: &Frame,
        content: FrameContent,
    ) -> Result<impl Future<Output = Result<LaterFrame, GpuError>> + use<>, GpuError> {
        let counters = (self.counters.array(), 0..self.counters.array().len());
        let parts: Vec<(&Array, Range<usize>)> = iter::once(counters).chain(frame.parts(content)).collect();
        let bytes = self.context.read_later(&parts)?;
        self.counters.reset_step(&mut self.context);
        let (len, planes, gpu) = (4 * self.counters.array().len(), content.planes(frame), self.context.gpu.clone());
        Ok(async move {
            let bytes = bytes.await?;
            let (counter_bytes, frame_bytes) = bytes.split_at(len);
            let FrameStatus { is_complete, capacity } = FrameStatus::new(counter_bytes, &gpu)?;
            let values = is_complete.then(|| bytemuck::pod_collect_to_vec(frame_bytes));
            Ok(LaterFrame { values, planes, capacity })
        })
    }

    /// Status of the last frame, after the device is done with it, for frames that stay on the
    /// device.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub fn frame_status_later(
        &mut self,
    ) -> Result<impl Future<Output = Result<FrameStatus, GpuError>> + use<>, GpuError> {
        let len = self.counters.array().len();
        let bytes = self.context.read_later(&[(self.counters.array(), 0..len)])?;
        self.counters.reset_step(&mut self.context);
        let gpu = self.context.gpu.clone();
        Ok(async move { FrameStatus::new(&bytes.await?, &gpu) })
    }

    /// Grants later pictures the capacity of one picture plus a quarter.
    pub fn grant(&mut self, capacity: FrameCapacity) {
        let FrameCapacity(needed) = capacity;
        self.picture_capacity = Some(needed.grown(self.picture_capacity, &self.context.gpu));
    }

    /// Sets the order of splats in a pixel for later pictures. Splats that were projected before
    /// must no longer be used.
    pub fn set_order(&mut self, order: BlendOrder) {
        self.order = order;
    }
}

impl<P> GpuExecutor<P> {
    fn with_precision(gpu: Gpu, precision: P) -> Self {
        let context = Context::new(gpu);
        let replay = ReplayDivision::new(context.kernels);
        let counters = StepCounters::new(&context);
        Self {
            context,
            precision,
            order: BlendOrder::Mean,
            weights: None,
            network: None,
            counters,
            capacity: None,
            picture_capacity: None,
            replay,
            losses: None,
            exposure_sums: None,
        }
    }

    /// The device.
    pub fn gpu(&self) -> &Gpu {
        &self.context.gpu
    }

    /// Variants of the kernels: those for the device's kind, unless others were set.
    pub fn kernels(&self) -> KernelSet {
        self.context.kernels
    }

    /// Sets the variants of the kernels. Pictures and gradients differ by rounding.
    pub fn set_kernels(&mut self, kernels: KernelSet) {
        self.context.kernels = kernels;
        self.replay = ReplayDivision::new(kernels);
    }

    /// Bytes of device memory in use, including buffers kept for reuse.
    pub fn memory_bytes(&self) -> u64 {
        self.context.memory_bytes()
    }

    /// Frees device memory that no array uses.
    pub fn free_unused_memory(&mut self) {
        self.context.free_unused_memory();
    }

    /// Submits the recorded commands and blocks until the device is done.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub fn finish(&mut self) -> Result<(), GpuError> {
        self.context.finish()
    }

    /// Starts or ends the timing of kernels; returns whether the device supports it. Each timed
    /// submission blocks until it is done, so whole stages are slower.
    pub fn time_kernels(&mut self, is_timed: bool) -> bool {
        let timer = if is_timed { KernelTimer::new(&self.context.gpu) } else { None };
        let is_possible = timer.is_some() || !is_timed;
        self.context.recorder.timer = timer;
        is_possible
    }

    /// Durations of kernels by name, since their timing started or since the last call.
    ///
    /// # Errors
    ///
    /// Errors that the device reported since the last call.
    pub fn kernel_times(&mut self) -> Result<Vec<(&'static str, KernelTime)>, GpuError> {
        self.context.kernel_times()
    }

    /// Measures the peak rates of the device; `None` if kernels cannot be timed. Discards the
    /// durations of kernels so far, and ends their timing.
    ///
    /// # Errors
    ///
    /// Errors of allocation and of the device.
    pub fn ceilings(&mut self) -> Result<Option<Ceilings>, GpuError> {
        ceilings::measure(&mut self.context)
    }

    fn weights(&mut self, key: (PrefilterScheme, usize, LevelRange)) -> Result<Arc<Weights>, GpuError> {
        let (scheme, resolution, _) = key;
        check_resolution(scheme, resolution)?;
        match &self.weights {
            Some(weights) if weights.key == key => Ok(weights.clone()),
            _ => {
                let weights = Weights::new(&mut self.context, key)?;
                self.weights = Some(weights.clone());
                Ok(weights)
            }
        }
    }

    /// Packs Gaussians as halves on the host, so that all devices store the same bits.
    fn upload_packed<A: AsRef<[f32]>>(&mut self, gaussians: &Gaussians<A>) -> Result<ChunkedArray, GpuError> {
        let (count, words_each) = (gaussians.count, Storage::F16.words(gaussians.layout));
        let mut words = vec![0; count.next_multiple_of(BLOCK) * words_each];
        pack(gaussians, &mut words);
        let chunking = self.context.chunking(words_each);
        let chunked = self.context.upload_chunks("Gaussians", &words, count, chunking)?;
        Ok(chunked.packed_from(gaussians.layout))
    }
}

impl<P: Precision> GpuExecutor<P> {
    /// Blends splats behind the surfaces of another renderer, if there are any.
    fn blend_behind(
        &mut self,
        splats: &Splats,
        colors: &Colors,
        tiles: &Tiles,
        camera: &Camera,
        surfaces: Option<&Array>,
    ) -> Result<Frame, GpuError> {
        let context = &mut self.context;
        match &splats.responses {
            None => blend(context, splats, colors, tiles, camera, surfaces),
            Some(responses) => {
                let window = self.order.window();
                blend_in_order(context, splats, responses, colors, tiles, camera, surfaces, window)
            }
        }
    }

    /// Evaluates a network light. Does not check that weights are finite, because they are on the
    /// device.
    fn evaluate_network(
        &mut self,
        environment: &Environment<ChunkedArray>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, GpuError> {
        let resolution = environment.resolution;
        LightNetworkError::check(resolution, environment.values.len(), scheme).map_err(GpuError::LightNetwork)?;
        check_resolution(scheme, resolution)?;
        let network = match &self.network {
            Some(network) if network.key() == (resolution, levels) => network.clone(),
            _ => NetworkTexels::new(&mut self.context, resolution, levels)?,
        };
        self.network = Some(network.clone());
        let environment = environment.with_values(environment.values.whole());
        evaluated(&mut self.context, &network, &environment, self.precision.storage())
    }
}

fn check_resolution(scheme: PrefilterScheme, resolution: usize) -> Result<(), GpuError> {
    let least = scheme.resolution_min();
    if scheme.takes(resolution) { Ok(()) } else { Err(GpuError::LightResolution { resolution, least }) }
}

impl<P: Precision> Renderer for GpuExecutor<P> {
    type Array = ChunkedArray;
    type Light = Light;
    type NearField = Arc<NearField<Array>>;
    type Splats = Splats;
    type Colors = Colors;
    type Tiles = Tiles;
    type Frame = Frame;
    type Error = GpuError;

    fn has(&self, _: Feature) -> bool {
        true
    }

    fn upload(&mut self, values: &[f32]) -> Result<ChunkedArray, GpuError> {
        self.context.upload("numbers", values).map(ChunkedArray::from)
    }

    fn upload_gaussians<A: AsRef<[f32]>>(
        &mut self,
        gaussians: &Gaussians<A>,
    ) -> Result<Gaussians<ChunkedArray>, GpuError> {
        let chunked = match self.precision.storage() {
            Storage::F32 => {
                let chunking = self.context.chunking(gaussians.layout.plane_count());
                self.context.upload_chunks("Gaussians", gaussians.values.as_ref(), gaussians.count, chunking)?
            }
            Storage::F16 => self.upload_packed(gaussians)?,
        };
        Ok(gaussians.with_values(chunked))
    }

    fn write_gaussians<A: AsRef<[f32]>>(
        &mut self,
        uploaded: &mut Gaussians<ChunkedArray>,
        gaussians: &Gaussians<A>,
        range: Range<usize>,
    ) -> Result<(), GpuError> {
        let values = gaussians.changed_values(uploaded, range).map_err(GpuError::Change)?;
        let blocks = values.start / gaussians.block_len()..values.end / gaussians.block_len();
        let changed = &gaussians.values.as_ref()[values.clone()];
        match uploaded.values.storage() {
            Storage::F32 => self.context.write_chunks(&uploaded.values, values.start, changed),
            Storage::F16 => {
                let layout = gaussians.layout;
                let changed = Gaussians { count: BLOCK * blocks.len(), layout, values: changed };
                let words_each = Storage::F16.words(layout);
                let mut words = vec![0; changed.count * words_each];
                pack(&changed, &mut words);
                self.context.write_chunks(&uploaded.values, BLOCK * blocks.start * words_each, &words)
            }
        }
    }

    fn download(&mut self, array: &ChunkedArray, values: &mut [f32]) -> Result<(), GpuError> {
        let Some(layout) = array.packed_layout() else {
            BufferLength::check(array.len(), values).map_err(GpuError::BufferLength)?;
            return self.context.download_chunks(array, values);
        };
        BufferLength::check(unpacked_len(array.len(), layout), values).map_err(GpuError::BufferLength)?;
        let mut words = vec![0; array.len()];
        self.context.download_chunks(array, &mut words)?;
        unpack(&words, layout, values);
        Ok(())
    }

    fn read_frame(&mut self, frame: &Frame, values: &mut [f32]) -> Result<(), GpuError> {
        BufferLength::check(frame.len_of_values(), values).map_err(GpuError::BufferLength)?;
        read(&mut self.context, frame, values)
    }

    fn prefilter(
        &mut self,
        environment: &Environment<ChunkedArray>,
        scheme: PrefilterScheme,
        levels: LevelRange,
    ) -> Result<Light, GpuError> {
        if environment.is_network() {
            return self.evaluate_network(environment, scheme, levels);
        }
        let weights = self.weights((scheme, environment.resolution, levels))?;
        let environment = environment.with_values(environment.values.whole());
        prefilter(&mut self.context, &weights, &environment, self.precision.storage())
    }

    fn upload_near_field(&mut self, near_field: &NearField<&[f32]>) -> Result<Self::NearField, GpuError> {
        upload_near_field(&mut self.context, near_field)
    }

    fn surround(&mut self, light: Light, near_field: &Self::NearField) -> Result<Light, GpuError> {
        Ok(light.around(near_field))
    }

    fn add_lamps(
        &mut self,
        light: Light,
        lamps: &[Lamp],
        rays: usize,
        occluder: Option<Occluder<'_, Self::NearField>>,
    ) -> Result<Light, GpuError> {
        Ok(light.with_lamps(Lamps::new(&mut self.context, lamps, rays, occluder)?))
    }

    fn project(&mut self, gaussians: &Gaussians<ChunkedArray>, camera: &Camera) -> Result<Splats, GpuError> {
        project(&mut self.context, gaussians, camera, self.order)
    }

    fn shade(
        &mut self,
        gaussians: &Gaussians<ChunkedArray>,
        camera: &Camera,
        splats: &mut Splats,
        light: Option<&Light>,
        rules: &RenderRules,
    ) -> Result<Colors, GpuError> {
        shade(&mut self.context, gaussians, camera, splats, light, rules)
    }

    fn bin(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
        bin(&mut self.context, &self.counters, splats, camera, self.picture_capacity)
    }

    fn blend(&mut self, splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Result<Frame, GpuError> {
        self.blend_behind(splats, colors, tiles, camera, None)
    }

    fn blend_occluded(
        &mut self,
        splats: &Splats,
        colors: &Colors,
        tiles: &Tiles,
        camera: &Camera,
        occlusion: &ChunkedArray,
    ) -> Result<Frame, GpuError> {
        let pixels = camera.width as usize * camera.height as usize;
        BufferLength::check_len(pixels, occlusion.len()).map_err(GpuError::BufferLength)?;
        self.blend_behind(splats, colors, tiles, camera, Some(occlusion.whole()))
    }

    fn median_depths(&mut self, splats: &Splats, tiles: &Tiles, camera: &Camera) -> Result<ChunkedArray, GpuError> {
        median_depths(&mut self.context, splats, tiles, camera).map(ChunkedArray::from)
    }

    fn trace(&mut self, surface: Frame, light: &Light, camera: &Camera) -> Result<Frame, GpuError> {
        trace(&mut self.context, surface, light.near_field.as_deref(), camera)
    }

    fn illuminate(&mut self, surface: Frame, light: &Light, camera: &Camera) -> Result<Frame, GpuError> {
        illuminate(&mut self.context, surface, light.lamps.as_deref(), camera)
    }

    fn shade_pixels(
        &mut self,
        surface: Frame,
        light: Option<&Light>,
        camera: &Camera,
        rules: &RenderRules,
    ) -> Result<Frame, GpuError> {
        shade_pixels(&mut self.context, surface, light, camera, rules)
    }
}

impl Executor for GpuExecutor {
    type LightGrad = LightGrad;
    type FrameGrad = FrameGrad;
    type SplatGrads = SplatGrads;
    type Target = Target;

    fn target(&mut self, picture: &Picture<'_>) -> Result<Target, GpuError> {
        Target::new(&mut self.context, picture)
    }

    fn bin_for_step(&mut self, splats: &Splats, camera: &Camera) -> Result<Tiles, GpuError> {
        bin(&mut self.context, &self.counters, splats, camera, self.capacity)
    }

    fn loss(
        &mut self,
        frame: &Frame,
        target: &Target,
        camera: &Camera,
        weights: &LossWeights,
        background: [f32; 3],
    ) -> Result<FrameGrad, GpuError> {
        let (grad, losses) = loss(&mut self.context, frame, target, camera, weights, background)?;
        self.losses = Some(losses);
        Ok(grad)
    }

    fn expose(&mut self, frame: Frame, exposure: &Exposure<f32>) -> Result<Frame, GpuError> {
        expose(&mut self.context, frame, exposure)
    }

    fn expose_vjp(&mut self, frame: &Frame, exposure: &Exposure<f32>, grad: FrameGrad) -> Result<FrameGrad, GpuError> {
        let (grad, sums) = expose_vjp(&mut self.context, frame, exposure, grad)?;
        self.exposure_sums = Some(sums);
        Ok(grad)
    }

    fn shade_pixels_vjp(
        &mut self,
        surface: &Frame,
        light: Option<&Light>,
        camera: &Camera,
        rules: &RenderRules,
        grad: FrameGrad,
    ) -> Result<(FrameGrad, Option<LightGrad>), GpuError> {
        shade_pixels_vjp(&mut self.context, surface, light, camera, rules, grad)
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
        blend_vjp(&mut self.context, self.replay, splats, colors, tiles, frame, grad, camera)
    }

    fn gaussians_vjp(
        &mut self,
        gaussians: &Gaussians<ChunkedArray>,
        camera: &Camera,
        _splats: &Splats,
        light: Option<&Light>,
        rules: &RenderRules,
        weights: &LossWeights,
        grads: &SplatGrads,
    ) -> Result<(Gaussians<ChunkedArray>, Option<LightGrad>), GpuError> {
        let inputs = BackwardInputs { light, rules, weights, grads };
        let gradients = gaussians_vjp(&mut self.context, gaussians, camera, &inputs, false)?;
        Ok((gradients.gaussians, gradients.light))
    }

    fn gaussians_and_camera_vjp(
        &mut self,
        gaussians: &Gaussians<ChunkedArray>,
        camera: &Camera,
        _splats: &Splats,
        light: Option<&Light>,
        rules: &RenderRules,
        grads: &SplatGrads,
    ) -> Result<(Gaussians<ChunkedArray>, Option<LightGrad>, CameraGrad<Double>), GpuError> {
        let inputs = BackwardInputs { light, rules, weights: &LossWeights::NONE, grads };
        let gradients = gaussians_vjp(&mut self.context, gaussians, camera, &inputs, true)?;
        let camera = gradients.camera(&mut self.context)?;
        Ok((gradients.gaussians, gradients.light, camera))
    }

    fn prefilter_vjp(
        &mut self,
        environment: &Environment<ChunkedArray>,
        light: &Light,
        grad: &LightGrad,
    ) -> Result<ChunkedArray, GpuError> {
        let environment = environment.with_values(environment.values.whole());
        prefilter_vjp(&mut self.context, &environment, light, grad).map(ChunkedArray::from)
    }

    fn add(&mut self, sum: &mut ChunkedArray, term: &ChunkedArray) -> Result<(), GpuError> {
        add(&mut self.context, sum, term)
    }

    fn optimise(
        &mut self,
        gaussians: &mut Gaussians<ChunkedArray>,
        moments: &mut AdamMoments<ChunkedArray>,
        grad: Gaussians<ChunkedArray>,
        rates: &[f32],
        step: u32,
    ) -> Result<(), GpuError> {
        optimise(&mut self.context, &self.counters, gaussians, moments, &grad, rates, step)
    }

    fn optimise_environment(
        &mut self,
        environment: &mut Environment<ChunkedArray>,
        moments: &mut AdamMoments<ChunkedArray>,
        grad: ChunkedArray,
        rate: f32,
        radiance_max: f32,
        step: u32,
    ) -> Result<(), GpuError> {
        let Self { context, counters, .. } = self;
        optimise_environment(context, counters, environment, moments, &grad, rate, radiance_max, step)
    }

    /// Downloads the counters, the losses and the gradient of the exposure with one wait for the
    /// device.
    fn report(&mut self) -> Result<Option<StepReport>, GpuError> {
        let (losses, exposure_sums) = (mem::take(&mut self.losses), mem::take(&mut self.exposure_sums));
        let arrays = [
            Some(self.counters.array()),
            losses.as_ref().map(Losses::sums),
            exposure_sums.as_ref().map(ExposureSums::array),
        ];
        let parts: Vec<(&Array, Range<usize>)> =
            arrays.into_iter().flatten().map(|array| (array, 0..array.len())).collect();
        let (mut counts, mut loss, mut exposure) = (StepCounts::default(), LossReport::default(), None);
        self.context.read(&parts, |bytes| {
            let (counter_bytes, sums) = bytes.split_at(4 * self.counters.array().len());
            let (loss_bytes, exposure_bytes) =
                sums.split_at(losses.as_ref().map_or(0, |losses| 4 * losses.sums().len()));
            let numbers = bytemuck::pod_collect_to_vec::<u8, f32>;
            counts = StepCounts::new(&bytemuck::pod_collect_to_vec::<u8, u32>(counter_bytes));
            loss = losses.as_ref().map_or(loss, |losses| losses.report(&numbers(loss_bytes)));
            exposure = exposure_sums.as_ref().map(|_| ExposureSums::total(&numbers(exposure_bytes)));
        })?;
        self.counters.reset_step(&mut self.context);
        let gpu = &self.context.gpu;
        self.capacity = Some(counts.required(gpu)?.grown(self.capacity, gpu));
        Ok((!counts.exceeds_capacity).then_some(StepReport { loss, nonfinite: counts.nonfinite, exposure }))
    }

    fn observe(
        &mut self,
        statistics: &mut Statistics<ChunkedArray>,
        splats: &Splats,
        grads: &SplatGrads,
        camera: &Camera,
    ) -> Result<(), GpuError> {
        observe(&mut self.context, &self.counters, statistics, splats, grads, camera)
    }

    fn densify(
        &mut self,
        gaussians: &mut Gaussians<ChunkedArray>,
        moments: &mut AdamMoments<ChunkedArray>,
        statistics: &mut Statistics<ChunkedArray>,
        rules: &DensifyRules,
        count_max: usize,
        key: RandomKey,
    ) -> Result<DensifyReport, GpuError> {
        densify(&mut self.context, &self.counters, gaussians, moments, statistics, rules, count_max, key)
    }

    fn sampling(&mut self, gaussians: &mut Gaussians<ChunkedArray>, views: &[Camera]) -> Result<(), GpuError> {
        sampling(&mut self.context, gaussians, views)
    }

    fn limit_plane(
        &mut self,
        gaussians: &mut Gaussians<ChunkedArray>,
        moments: &mut AdamMoments<ChunkedArray>,
        plane: usize,
        ceiling: f32,
        outside: Option<Ball>,
    ) -> Result<(), GpuError> {
        limit_plane(&mut self.context, gaussians, moments, plane, ceiling, outside)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::{
        pin::pin,
        task::{Context as TaskContext, Poll, Waker},
    };
    use specula_core::{
        pipeline::render,
        prefilter::PrefilterScheme,
        rules::Channels,
        scene::{Layout, MEAN, OPACITY, QUAT, len_of_values},
        shade::ShadingRules,
    };

    const SIZE: u32 = 40;

    /// Balls in a row, all of them seen.
    fn gaussians() -> Gaussians<Vec<f32>> {
        let (count, layout) = (64, Layout::radiance(0));
        let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        for index in 0..count {
            let across = index as f32 / count as f32 - 0.5;
            gaussians.set(index, MEAN, [across, 0.3 * across, 4.0 + across]);
            gaussians.set(index, 3, [-3.0; 3]);
            gaussians.set(index, QUAT, [1.0, 0.0, 0.0, 0.0]);
            gaussians.set(index, OPACITY, [2.0]);
        }
        gaussians
    }

    /// Result of a future that is ready after the device is done.
    fn waited<T>(exec: &GpuExecutor<Storage>, later: impl Future<Output = T>) -> T {
        exec.gpu().wait().expect("the device is there");
        let mut later = pin!(later);
        let mut context = TaskContext::from_waker(Waker::noop());
        match later.as_mut().poll(&mut context) {
            Poll::Ready(result) => result,
            Poll::Pending => panic!("the device is done"),
        }
    }

    #[test]
    fn a_frame_read_later_equals_one_read_at_once() {
        let Some(context) = Context::for_tests() else { return };
        let camera = Camera::look_at([0.0; 3].into(), [0.0, 0.0, 1.0].into(), [0.0, -1.0, 0.0].into(), 0.6, SIZE, SIZE);
        let full = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
        let rules = RenderRules { sh_degree: Some(0), ..full };
        let mut exec = GpuExecutor::viewer(context.gpu, Storage::F32);
        let scene = exec.upload_gaussians(&gaussians()).expect("it fits");
        let frame = render(&mut exec, &scene, None, &camera, &rules).expect("the device renders");
        let mut expected = vec![0.0; frame.len_of_values()];
        exec.read_frame(&frame, &mut expected).expect("the length is that of the frame");
        assert!(expected.iter().any(|number| *number > 0.1), "something is seen");

        exec.read_later();
        render(&mut exec, &scene, None, &camera, &rules).expect("the device renders");
        let later = exec.frame_status_later().expect("it is recorded");
        let status = waited(&exec, later).expect("the device is there");
        assert!(!status.is_complete, "nothing is known of its splats before");
        let frame = render(&mut exec, &scene, None, &camera, &rules).expect("the device renders");
        let later = exec.read_frame_later(&frame, FrameContent::Channels).expect("it is recorded");
        let LaterFrame { values, capacity, .. } = waited(&exec, later).expect("the device is there");
        assert_eq!(values, None, "nothing is known of its splats before");
        exec.grant(capacity);
        let frame = render(&mut exec, &scene, None, &camera, &rules).expect("the device renders");
        let later = exec.frame_status_later().expect("it is recorded");
        assert!(waited(&exec, later).expect("the device is there").is_complete, "its splats have room");
        for (content, planes) in [(FrameContent::Channels, frame.channels + 1), (FrameContent::Colors, 4)] {
            let later = exec.read_frame_later(&frame, content).expect("it is recorded");
            let later = waited(&exec, later).expect("the device is there");
            let values = later.values.expect("the capacity is enough");
            assert_eq!((later.planes, values.len()), (planes, planes * frame.pixel_count()));
            let shown = 3 * frame.pixel_count();
            assert_eq!(values[..shown], expected[..shown]);
            let passed = frame.pixel_count();
            assert_eq!(values[values.len() - passed..], expected[expected.len() - passed..]);
        }
    }
}
