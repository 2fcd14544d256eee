//! A picture of Gaussians over what another program has drawn with wgpu, without leaving the
//! device: `texture [PICTURE.png]`. Here the program draws nothing but a blue sky.

use core::error::Error;
use specula_core::{
    camera::Camera,
    executor::Renderer,
    pipeline,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Gaussians,
    shade::ShadingRules,
};
use specula_examples::ring;
use specula_gpu::{Composer, Gpu, GpuExecutor};
use specula_io::picture;
use std::path::Path;
use wgpu::{
    BufferUsages, Color, CommandEncoderDescriptor, Device, Extent3d, LoadOp, Operations, Queue,
    RenderPassColorAttachment, RenderPassDescriptor, StoreOp, Texture, TextureDescriptor, TextureDimension,
    TextureFormat, TextureUsages, TextureViewDescriptor,
};

const SKY: [f32; 3] = [0.2, 0.4, 0.8];
/// A row of the texture is a multiple of 256 bytes, as wgpu wants rows that are copied.
const SIZE: u32 = 512;

/// The program that Gaussians are to be part of: its device, and a texture that it draws into.
struct Program {
    device: Device,
    queue: Queue,
    texture: Texture,
}

impl Program {
    async fn new() -> Result<Self, Box<dyn Error>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default()).await?;
        let (device, queue) = adapter.request_device(&wgpu::DeviceDescriptor::default()).await?;
        let texture = device.create_texture(&TextureDescriptor {
            label: Some("screen"),
            size: Extent3d { width: SIZE, height: SIZE, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format: TextureFormat::Rgba8Unorm,
            usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        Ok(Self { device, queue, texture })
    }

    /// A sky, and Gaussians before it.
    fn draw(&self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<(), Box<dyn Error>> {
        let mut exec = GpuExecutor::new(Gpu::shared(self.device.clone(), self.queue.clone())?);
        let composer = Composer::new(&exec, self.texture.format());
        let scene = exec.upload_gaussians(gaussians)?;
        let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
        let frame = pipeline::render(&mut exec, &scene, None, camera, &RenderRules { is_lit: false, ..rules })?;
        let mut encoder = self.device.create_command_encoder(&CommandEncoderDescriptor::default());
        let [r, g, b] = SKY.map(f64::from);
        let sky = RenderPassColorAttachment {
            view: &self.texture.create_view(&TextureViewDescriptor::default()),
            depth_slice: None,
            resolve_target: None,
            ops: Operations { load: LoadOp::Clear(Color { r, g, b, a: 1.0 }), store: StoreOp::Store },
        };
        let descriptor = RenderPassDescriptor { color_attachments: &[Some(sky)], ..RenderPassDescriptor::default() };
        composer.draw(&mut exec, &frame, &mut encoder.begin_render_pass(&descriptor))?;
        self.queue.submit([encoder.finish()]);
        Ok(())
    }

    /// Pixels of the texture, RGBA with 8 bits a channel.
    fn pixels(&self) -> Result<Vec<u8>, Box<dyn Error>> {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(4 * SIZE * SIZE),
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&CommandEncoderDescriptor::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * SIZE), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.texture.as_image_copy(), to, self.texture.size());
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |_| ());
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(buffer.get_mapped_range(..)?.to_vec())
    }
}

fn camera() -> Camera {
    Camera::look_at(glam::Vec3::new(2.0, -2.5, 1.5), glam::Vec3::ZERO, glam::Vec3::Z, 0.8, SIZE, SIZE)
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

#[test]
fn the_texture_holds_what_the_processor_renders_over_the_sky() {
    use specula_train::evaluate::{over_background, render_view};
    let program = match pollster::block_on(Program::new()) {
        Ok(program) => program,
        Err(error) if std::env::var_os("CI").is_some() => panic!("CI needs an adapter: {error}"),
        Err(error) => return eprintln!("NOT TESTED, because {error}"),
    };
    program.draw(&ring(), &camera()).unwrap();
    let mut exec = specula_cpu::CpuExecutor::new();
    let scene = exec.upload_gaussians(&ring()).unwrap();
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color);
    let image = render_view(&mut exec, &scene, None, &camera(), &RenderRules { is_lit: false, ..rules }).unwrap();
    let expected = over_background(&image, SKY);
    let pixels = program.pixels().unwrap();
    let plane = pixels.len() / 4;
    for (k, pixel) in pixels.chunks_exact(4).enumerate() {
        for c in 0..3 {
            let own = f32::from(pixel[c]) / 255.0;
            // Half a step of eight bits for each of two roundings, and what the processor and the
            // device differ by.
            assert!((own - expected[c * plane + k].clamp(0.0, 1.0)).abs() < 1.5 / 255.0, "channel {c} of pixel {k}");
        }
    }
    assert!(pixels.chunks_exact(4).any(|pixel| pixel[0] > 150), "something is before the sky");
}
