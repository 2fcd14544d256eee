//! Gaussians in the frame of another program that draws with wgpu, without leaving the device:
//! `texture [PICTURE.png]`. The program draws a sky and a floor; splats below the floor are hidden.

use core::error::Error;
use glam::Vec3;
use specula_core::{
    camera::Camera,
    executor::Renderer,
    occlusion::DepthRange,
    pack::Storage,
    pipeline,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Gaussians,
    shade::ShadingRules,
};
use specula_examples::ring;
use specula_gpu::{Composer, DepthReader, Gpu, GpuExecutor, PassFormat};
use specula_io::picture;
use std::path::Path;
use wgpu::{
    BufferUsages, Color, CommandEncoder, CompareFunction, DepthBiasState, DepthStencilState, Device, Extent3d, LoadOp,
    Operations, Queue, RenderPass, RenderPassColorAttachment, RenderPassDepthStencilAttachment, RenderPassDescriptor,
    RenderPipeline, StencilState, StoreOp, Texture, TextureDescriptor, TextureDimension, TextureFormat, TextureUsages,
    util::DeviceExt,
};

const SKY: [f32; 3] = [0.2, 0.4, 0.8];
const FLOOR: [f32; 3] = [0.5, 0.45, 0.4];
/// Half an edge of the floor, at z = 0.
const FLOOR_HALF: f32 = 1.1;
/// Near plane of the program, whose depth buffer is reversed and has no far plane.
const NEAR: f32 = 0.1;
/// A row of the texture is a multiple of 256 bytes, as wgpu wants rows that are copied.
const SIZE: u32 = 512;

const VERTEX: &str = "@vertex fn place(@location(0) corner: vec4f) -> @builtin(position) vec4f { return corner; }";

/// The program that Gaussians are to be part of.
struct Program {
    device: Device,
    queue: Queue,
    screen: Texture,
    depth: Texture,
    floor: RenderPipeline,
}

impl Program {
    async fn new() -> Result<Self, Box<dyn Error>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await?;
        let (device, queue) = adapter.request_device(&wgpu::DeviceDescriptor::default()).await?;
        let texture = |format, usage| {
            device.create_texture(&TextureDescriptor {
                label: None,
                size: Extent3d { width: SIZE, height: SIZE, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: TextureDimension::D2,
                format,
                usage: TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            })
        };
        let screen = texture(TextureFormat::Rgba8Unorm, TextureUsages::COPY_SRC);
        let depth = texture(TextureFormat::Depth32Float, TextureUsages::TEXTURE_BINDING);
        let floor = floor_pipeline(&device, &screen, &depth);
        Ok(Self { device, queue, screen, depth, floor })
    }

    /// Frames of a sky, a floor and Gaussians until one is complete: the first has no capacity for
    /// splats yet, since it does not wait for their number.
    fn draw(&self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<(), Box<dyn Error>> {
        let mut exec = GpuExecutor::viewer(Gpu::shared(self.device.clone(), self.queue.clone())?, Storage::F32);
        exec.read_later();
        let scene = exec.upload_gaussians(gaussians)?;
        let reader = DepthReader::new(&exec);
        let composer = Composer::new(&exec, &PassFormat::new(self.screen.format()).depth(self.depth.format()));
        loop {
            let mut encoder = self.device.create_command_encoder(&Default::default());
            self.draw_floor(&mut encoder, camera);
            let depth = self.depth.create_view(&Default::default());
            let frame = exec.record(&mut encoder, |exec| {
                let surfaces = reader.read(exec, &depth, [SIZE; 2], DepthRange::reversed(NEAR, f32::INFINITY))?;
                pipeline::render_occluded(exec, &scene, None, camera, &rules(), &surfaces)
            })?;
            composer.draw(&mut exec, &frame, &mut self.pass(&mut encoder, LoadOp::Load, LoadOp::Load))?;
            self.queue.submit([encoder.finish()]);

            // A program that shows one frame after the other would look at this some frames later.
            let status = exec.frame_status_later()?;
            self.device.poll(wgpu::PollType::wait_indefinitely())?;
            let status = pollster::block_on(status)?;
            if status.is_complete {
                return Ok(());
            }
            exec.grant(status.capacity);
        }
    }

    fn draw_floor(&self, encoder: &mut CommandEncoder, camera: &Camera) {
        let corners = self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("floor"),
            contents: &floor_corners(camera),
            usage: BufferUsages::VERTEX,
        });
        let [r, g, b] = SKY.map(f64::from);
        let mut pass = self.pass(encoder, LoadOp::Clear(Color { r, g, b, a: 1.0 }), LoadOp::Clear(0.0));
        pass.set_pipeline(&self.floor);
        pass.set_vertex_buffer(0, corners.slice(..));
        pass.draw(0..6, 0..1);
    }

    /// Pass with the screen and its depth buffer.
    fn pass(&self, encoder: &mut CommandEncoder, color: LoadOp<Color>, depth: LoadOp<f32>) -> RenderPass<'static> {
        let screen = RenderPassColorAttachment {
            view: &self.screen.create_view(&Default::default()),
            depth_slice: None,
            resolve_target: None,
            ops: Operations { load: color, store: StoreOp::Store },
        };
        let depth = RenderPassDepthStencilAttachment {
            view: &self.depth.create_view(&Default::default()),
            depth_ops: Some(Operations { load: depth, store: StoreOp::Store }),
            stencil_ops: None,
        };
        let descriptor = RenderPassDescriptor {
            color_attachments: &[Some(screen)],
            depth_stencil_attachment: Some(depth),
            ..RenderPassDescriptor::default()
        };
        encoder.begin_render_pass(&descriptor).forget_lifetime()
    }

    /// Pixels of the screen, RGBA with 8 bits a channel.
    fn pixels(&self) -> Result<Vec<u8>, Box<dyn Error>> {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(4 * SIZE * SIZE),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * SIZE), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.screen.as_image_copy(), to, self.screen.size());
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(buffer.get_mapped_range(..)?.to_vec())
    }
}

fn floor_pipeline(device: &Device, screen: &Texture, depth: &Texture) -> RenderPipeline {
    let [r, g, b] = FLOOR;
    let fragment = format!("@fragment fn paint() -> @location(0) vec4f {{ return vec4f({r}, {g}, {b}, 1.0); }}");
    let source = wgpu::ShaderSource::Wgsl(format!("{VERTEX}\n{fragment}").into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let corner = wgpu::VertexBufferLayout {
        array_stride: 16,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Float32x4],
    };
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("floor"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            buffers: &[Some(corner)],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(DepthStencilState {
            format: depth.format(),
            depth_write_enabled: Some(true),
            depth_compare: Some(CompareFunction::Greater),
            stencil: StencilState::default(),
            bias: DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: None,
            compilation_options: Default::default(),
            targets: &[Some(screen.format().into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Corners of the floor's two triangles in clip space.
fn floor_corners(camera: &Camera) -> Vec<u8> {
    let corner = |[x, y]: [f32; 2]| {
        let point = camera.camera_from_world * (Vec3::new(x, y, 0.0) * FLOOR_HALF - camera.position);
        let axis = |along: f32, axis: usize, size: u32| {
            (2.0 * camera.focal_px[axis] * along + (2.0 * camera.principal_px[axis] - size as f32) * point.z)
                / size as f32
        };
        [axis(point.x, 0, camera.width), -axis(point.y, 1, camera.height), NEAR, point.z]
    };
    let [a, b, c, d] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(corner);
    [a, b, c, a, c, d].as_flattened().iter().flat_map(|number| number.to_le_bytes()).collect()
}

const fn rules() -> RenderRules {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    RenderRules { is_lit: false, ..rules }
}

fn camera() -> Camera {
    Camera::look_at(Vec3::new(2.0, -2.5, 1.5), Vec3::ZERO, Vec3::Z, 0.8, SIZE, SIZE)
}

fn main() -> Result<(), Box<dyn Error>> {
    let program = pollster::block_on(Program::new())?;
    let gaussians = ring();
    program.draw(&gaussians, &camera())?;
    let pixels = program.pixels()?;
    let plane = |channel: usize| pixels.chunks_exact(4).map(move |pixel| f32::from(pixel[channel]) / 255.0);
    let colors: Vec<f32> = (0..3).flat_map(plane).collect();
    let place = std::env::args().skip(1).find(|name| name.ends_with(".png")).unwrap_or("texture.png".to_owned());
    picture::write_rgb(Path::new(&place), SIZE as usize, SIZE as usize, &colors, None)?;
    println!("{} Gaussians in {place}", gaussians.count);
    Ok(())
}

/// Depth of the floor in a pixel; infinite beyond its edges.
#[cfg(test)]
fn floor_depth(camera: &Camera, column: u32, row: u32) -> f32 {
    let ray = camera.ray_in_camera(column as f32 + 0.5, row as f32 + 0.5);
    let ray = camera.camera_from_world.transpose() * ray;
    let depth = -camera.position.z / ray.z;
    let point = camera.position + depth * ray;
    let is_floor = depth > 0.0 && point.x.abs().max(point.y.abs()) <= FLOOR_HALF;
    if is_floor { depth } else { f32::INFINITY }
}

#[test]
fn the_screen_holds_what_the_processor_renders_behind_the_floor() {
    use specula_scene::{Behind, FrameRequest, Scene, ShadingModel, Surfaces, Target};
    let program = match pollster::block_on(Program::new()) {
        Ok(program) => program,
        Err(error) if std::env::var_os("CI").is_some() => panic!("CI needs an adapter: {error}"),
        Err(error) => return eprintln!("NOT TESTED, because {error}"),
    };
    let camera = camera();
    program.draw(&ring(), &camera).unwrap();
    let pixels = program.pixels().unwrap();

    let pixel = |index: u32| (index % SIZE, index / SIZE);
    let depths: Vec<f32> = (0..SIZE * SIZE).map(pixel).map(|(x, y)| floor_depth(&camera, x, y)).collect();
    let [floor, sky] = [FLOOR, SKY].map(|color| color.map(|x| (x * 255.0 + 0.5) as u8));
    let paint = |depth: &f32| if depth.is_finite() { floor } else { sky };
    let empty: Vec<u8> = depths.iter().map(paint).flat_map(|[r, g, b]| [r, g, b, 255]).collect();
    let scene = Scene::unlit(ring(), ShadingModel::PAPER);
    let mut renderer = scene.renderer(specula_cpu::CpuExecutor::new(), Channels::Color).unwrap();
    let mut picture = |surfaces: &[f32]| {
        let (mut pixels, request) = (empty.clone(), FrameRequest::new(&camera).behind(Surfaces::Depths(surfaces)));
        renderer.render_into(&request, Target::Rgba8(&mut pixels, 4 * SIZE as usize), Behind::Contents, None).unwrap();
        pixels
    };
    let psnr = |other: &[u8]| {
        let squared = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
        let sum: f64 = pixels.iter().zip(other).map(squared).sum();
        10.0 * (255.0 * 255.0 * pixels.len() as f64 / sum).log10()
    };
    let (behind, before) = (psnr(&picture(&depths)), psnr(&picture(&vec![f32::INFINITY; depths.len()])));
    println!("{behind:.1} dB; {before:.1} dB without hidden splats");
    // Pixels at the floor's edge, and splats at its depth, differ by rounding.
    assert!(behind > 50.0, "only {behind:.1} dB");
    assert!(before < 30.0, "the floor hides nothing: {before:.1} dB");
}
