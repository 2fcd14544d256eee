//! A shading function as spherical harmonics: what a scene looks like under its light, for programs that know no other.
//!
//! A Gaussian's colours towards cameras are fitted by weighted least squares ([`specula_core::sh_fit`]). A camera weighs
//! as much as the Gaussian is seen by it, Σ αT over its pixels: what is behind the object counts for nothing, and
//! harmonics are spent where somebody looks. A few hundred directions all around, the same for all Gaussians, weigh
//! [`EVERYWHERE`] together, so that views from elsewhere show nothing strange. Where pixels look the light up, a Gaussian
//! is shaded by the light of the pixels that show it: their mean normals are smoother than its own.

use crate::{
    failure::Failure,
    progress::{self, Work},
};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    activation::sigmoid,
    camera::Camera,
    executor::{Executor, Renderer},
    prefilter::LevelRange,
    rules::{Channels, RenderRules, channel},
    scene::{
        BLOCK, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, NORMAL_RESIDUAL_1, NORMAL_RESIDUAL_2, OPACITY, QUAT,
        ROUGHNESS, TINT, len_of_values,
    },
    sh::Y0,
    sh_fit::{Fit, Harmonics, harmonics},
    shade::{self, Material, ShadingForm, ShadingRules, Surface, Terms, surface},
    sphere::directions,
    vector::{Vec3 as Vector, vec3},
};
use specula_cpu::{CpuExecutor, stages::prefilter::Light};
use specula_scene::{Scene, ShadingModel, environment::fitting, orbit::evenly_spaced};

/// Directions all around.
const AROUND: usize = 256;
/// What they weigh together, as a share of what cameras weigh.
const EVERYWHERE: f64 = 0.02;
/// Cameras that are looked through, at most.
const CAMERAS_MAX: usize = 96;
/// Colours that are kept, over all Gaussians and cameras: a gigabyte.
const COLORS_MAX: usize = 1 << 26;
/// Pixels along the longer edge of a picture: who sees what is known from few.
const EDGE_MAX: u32 = 400;
/// Gaussians that are fitted at once.
const CHUNK: usize = 256 * BLOCK;

/// Plain Gaussians that look like shaded ones, and their normals towards who sees them.
#[derive(Clone, Debug)]
pub(crate) struct Baked {
    pub(crate) gaussians: Gaussians<Vec<f32>>,
    pub(crate) normals: Vec<[f32; 3]>,
}

/// Bakes the colours of a shaded scene, seen from these cameras, into harmonics.
pub(crate) fn bake(scene: &Scene, cameras: &[Camera], degree: u8) -> Result<Baked, Failure> {
    let most = (COLORS_MAX / scene.gaussians.count.max(1)).clamp(8, CAMERAS_MAX);
    let cameras = evenly_spaced(cameras, most);
    let mut studio = Studio::new(scene)?;
    let work = progress::work("baking", cameras.len() as u64);
    let mut sights = Vec::new();
    for camera in &cameras {
        sights.push(studio.sight(&scene.gaussians, camera)?);
        work.done(sights.len() as u64, String::new);
    }
    let baked = studio.fit(&scene.gaussians, &sights, degree, &work)?;
    work.finish();
    Ok(baked)
}

/// The diffuse colours of a shaded scene alone, without any light.
pub(crate) fn diffuse(scene: &Scene, cameras: &[Camera]) -> Result<Baked, Failure> {
    let Scene { gaussians, shading_model, .. } = scene;
    let normals = bake(scene, &evenly_spaced(cameras, 8), 0)?.normals;
    let mut plain = shapes_of(gaussians, Layout::radiance(0));
    let start = plain.layout.sh_start();
    for gaussian in 0..gaussians.count {
        let own = shade::diffuse(vector(gaussians.get(gaussian, DIFFUSE)), shading_model.shading);
        let color = shade::shade(gaussian_form(shading_model.shading).form, &Terms::unlit(own, Vector::default()));
        plain.set(gaussian, start, color.to_array().map(|channel| (channel - 0.5) / Y0));
    }
    Ok(Baked { gaussians: plain, normals })
}

/// Each Gaussian looks the light up itself, also where pixels do it otherwise.
fn gaussian_form(shading: ShadingRules) -> ShadingRules {
    match shading.form {
        ShadingForm::Deferred => ShadingRules { form: ShadingForm::Paper, ..shading },
        _ => shading,
    }
}

/// What a camera sees of each Gaussian.
#[derive(Debug)]
struct Sight {
    position: Vec3,
    /// Σ αT over the pixels.
    weights: Vec<f32>,
    colors: Vec<[f32; 3]>,
}

/// Where Gaussians are shaded.
struct Studio {
    exec: CpuExecutor,
    light: Option<Light>,
    /// As the scene is rendered, with all layers.
    pictures: RenderRules,
    /// Each Gaussian by itself.
    alone: RenderRules,
}

impl Studio {
    fn new(scene: &Scene) -> Result<Self, Failure> {
        let mut exec = CpuExecutor::new();
        let ShadingModel { shading, scheme } = scene.shading_model;
        let light = scene.light.as_ref().map(|light| fitting(light, scheme));
        if light.is_none() {
            tracing::warn!("the scene has no light, so nothing specular is baked; name one with --env");
        }
        let light = light.map(|light| exec.prefilter(&light, scheme, LevelRange::ALL)).transpose()?;
        let pictures = RenderRules::full(shading, scheme, Channels::Layers);
        let alone = RenderRules::full(gaussian_form(shading), scheme, Channels::Color);
        Ok(Self { exec, light, pictures, alone })
    }

    /// What a camera sees of each Gaussian: by linearity the gradients of its channels are sums over the pixels, each times
    /// the share αT that the Gaussian has of it. So weights and the light of its pixels are those of two pictures that are
    /// taken for a gradient, coverage and light.
    fn sight(&mut self, gaussians: &Gaussians<Vec<f32>>, camera: &Camera) -> Result<Sight, Failure> {
        let (camera, light, exec) = (small(camera), self.light.as_ref(), &mut self.exec);
        let is_deferred = self.pictures.is_deferred(gaussians.layout);
        let mut splats = exec.project(gaussians, &camera)?;
        let colors = exec.shade(gaussians, &camera, &mut splats, light, &self.pictures)?;
        let tiles = exec.bin(&splats, &camera)?;
        let mut frame = exec.blend(&splats, &colors, &tiles, &camera)?;
        if is_deferred {
            frame = exec.shade_pixels(frame, light, &camera)?;
        }
        let pixels = (camera.width * camera.height) as usize;
        let mut picture = vec![0.0; (colors.channels + 1) * pixels];
        exec.read_frame(&frame, &mut picture)?;
        let gradient = frame.grad(&light_and_coverage(&picture, pixels));
        let seen = exec.blend_vjp(&splats, &colors, &tiles, &frame, &gradient, &camera)?;

        let color = |gaussian: usize| match is_deferred {
            true => under_light_of_pixels(colors.of(gaussian), core::array::from_fn(|c| seen.of_channel(gaussian, c))),
            false => three(colors.of(gaussian), channel::COLOR),
        };
        Ok(Sight {
            position: camera.position,
            weights: (0..gaussians.count).map(|gaussian| seen.of_channel(gaussian, WEIGHT)).collect(),
            colors: (0..gaussians.count).map(color).collect(),
        })
    }

    /// Colours of Gaussians towards directions all around, direction by direction: they stand in the origin, and who looks
    /// stands on the unit sphere.
    fn around(&mut self, gaussians: &Gaussians<Vec<f32>>) -> Result<Vec<Vec<[f32; 3]>>, Failure> {
        let centred = in_the_origin(gaussians);
        let colors = |towards: [f64; 3]| -> Result<Vec<[f32; 3]>, Failure> {
            let eye = Vec3::from(towards.map(|x| x as f32));
            let camera =
                Camera::look_at(eye, Vec3::ZERO, eye.any_orthonormal_vector(), 1.0, BLOCK as u32, BLOCK as u32);
            let mut splats = self.exec.project(&centred, &camera)?;
            let colors = self.exec.shade(&centred, &camera, &mut splats, self.light.as_ref(), &self.alone)?;
            Ok((0..centred.count).map(|gaussian| three(colors.of(gaussian), channel::COLOR)).collect())
        };
        directions(AROUND).map(colors).collect()
    }

    fn fit(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        sights: &[Sight],
        degree: u8,
        work: &Work,
    ) -> Result<Baked, Failure> {
        let mut plain = shapes_of(gaussians, Layout::radiance(degree));
        let everywhere = Everywhere::new(plain.layout.sh_count());
        let mut normals = Vec::with_capacity(gaussians.count);
        work.set_steps((sights.len() + gaussians.count.div_ceil(CHUNK)) as u64);
        for (step, first) in (0..gaussians.count).step_by(CHUNK).enumerate() {
            let chunk = part(gaussians, first, CHUNK.min(gaussians.count - first));
            let around = self.around(&chunk)?;
            let shading = self.alone.shading;
            let fitted: Vec<_> = (0..chunk.count)
                .into_par_iter()
                .map(|k| {
                    let seen = Seen::new(first + k, chunk.get::<3>(k, MEAN).into(), sights);
                    (
                        seen.fit(&everywhere, |direction| around[direction][k]),
                        normal(&chunk, k, seen.towards(), shading),
                    )
                })
                .collect();
            for (k, (coefficients, normal)) in fitted.into_iter().enumerate() {
                for (place, color) in coefficients.iter().take(plain.layout.sh_count()).enumerate() {
                    plain.set(first + k, plain.layout.sh_start() + 3 * place, *color);
                }
                normals.push(normal);
            }
            work.done((sights.len() + step + 1) as u64, String::new);
        }
        Ok(Baked { gaussians: plain, normals })
    }
}

/// Directions all around, which are the same for all Gaussians.
struct Everywhere {
    count: usize,
    harmonics: Vec<Harmonics>,
    fit: Fit,
}

impl Everywhere {
    fn new(count: usize) -> Self {
        let harmonics: Vec<Harmonics> =
            directions(AROUND).map(|towards| harmonics(towards.map(|x| -x as f32), count)).collect();
        let mut fit = Fit::new(count);
        harmonics.iter().for_each(|harmonics| fit.add_direction(harmonics, 1.0 / AROUND as f64));
        Self { count, harmonics, fit }
    }
}

/// Where the gradient's plane of coverage is, behind three of light.
const WEIGHT: usize = 3;

/// Planes of a gradient: light, coverage, and nothing else.
fn light_and_coverage(picture: &[f32], pixels: usize) -> Vec<f32> {
    let mut planes = vec![0.0; picture.len()];
    let light = channel::LIGHT * pixels..(channel::LIGHT + 3) * pixels;
    planes[..WEIGHT * pixels].copy_from_slice(&picture[light]);
    let passed = &picture[picture.len() - pixels..];
    planes[WEIGHT * pixels..].iter_mut().zip(passed).for_each(|(weight, passed)| *weight = 1.0 - passed);
    planes
}

/// The colour of a Gaussian under the mean light of the pixels that show it: sums of light, and of coverage.
fn under_light_of_pixels(layers: &[f32], [r, g, b, weight]: [f32; 4]) -> [f32; 3] {
    let light = if weight > 0.0 { [r, g, b].map(|sum| sum / weight) } else { [0.0; 3] };
    let terms = Terms {
        tint: vector(three(layers, channel::TINT)),
        specular_light: vector(light),
        ..Terms::unlit(vector(three(layers, channel::DIFFUSE)), vector(three(layers, channel::RESIDUAL)))
    };
    shade::shade(ShadingForm::Paper, &terms).to_array()
}

/// A Gaussian and who sees it: weight, direction to the Gaussian, and colour.
struct Seen(Vec<(f64, Vec3, [f32; 3])>);

impl Seen {
    fn new(gaussian: usize, mean: Vec3, sights: &[Sight]) -> Self {
        let of = |sight: &Sight| {
            let direction = (mean - sight.position).normalize_or_zero();
            (f64::from(sight.weights[gaussian]), direction, sight.colors[gaussian])
        };
        Self(sights.iter().map(of).filter(|(weight, ..)| *weight > 0.0).collect())
    }

    fn total(&self) -> f64 {
        self.0.iter().map(|(weight, ..)| weight).sum()
    }

    fn fit(&self, everywhere: &Everywhere, around: impl Fn(usize) -> [f32; 3]) -> [[f32; 3]; 16] {
        let total = self.total();
        let of_everywhere = if total > 0.0 { EVERYWHERE } else { 1.0 };
        let mut fit = everywhere.fit.without_colors(of_everywhere);
        for (direction, harmonics) in everywhere.harmonics.iter().enumerate() {
            fit.add_color(harmonics, around(direction), of_everywhere / AROUND as f64);
        }
        for (weight, direction, color) in &self.0 {
            fit.add(&harmonics(direction.to_array(), everywhere.count), *color, weight / total);
        }
        fit.solve().unwrap_or_default()
    }

    /// To those who see it, in the mean; straight up where nobody does.
    fn towards(&self) -> Vec3 {
        let sum: Vec3 = self.0.iter().map(|(weight, direction, _)| *direction * -(*weight as f32)).sum();
        sum.try_normalize().unwrap_or(Vec3::Z)
    }
}

/// The normal of a Gaussian, turned to who looks from that direction.
fn normal(gaussians: &Gaussians<Vec<f32>>, gaussian: usize, towards: Vec3, shading: ShadingRules) -> [f32; 3] {
    let material = Material { mean: Vector::default(), ..material(gaussians, gaussian) };
    surface(&material, vector(towards.to_array()), shading).facing.normal.to_array()
}

/// What shading reads of a Gaussian.
fn material(gaussians: &Gaussians<Vec<f32>>, gaussian: usize) -> Material<f32> {
    let of = |plane: usize| vector(gaussians.get(gaussian, plane));
    Material {
        mean: of(MEAN),
        quat: gaussians.get(gaussian, QUAT),
        log_scales: of(LOG_SCALE),
        diffuse: of(DIFFUSE),
        tint: of(TINT),
        roughness: gaussians.get::<1>(gaussian, ROUGHNESS)[0],
        normal_residuals: [of(NORMAL_RESIDUAL_1), of(NORMAL_RESIDUAL_2)],
    }
}

/// Activated attributes of a Gaussian, seen from the side that a normal points to.
pub(crate) fn attributes(
    gaussians: &Gaussians<Vec<f32>>,
    gaussian: usize,
    shading: ShadingRules,
) -> ([f32; 3], [f32; 3], f32) {
    let material = material(gaussians, gaussian);
    let Surface { diffuse, tint, .. } = surface(&material, vector([0.0, 0.0, 1.0]), shading);
    (diffuse.to_array(), tint.to_array(), sigmoid(material.roughness))
}

/// Places, shapes and opacities, without colours.
fn shapes_of(gaussians: &Gaussians<Vec<f32>>, layout: Layout) -> Gaussians<Vec<f32>> {
    let count = gaussians.count;
    let mut plain = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for gaussian in 0..count {
        plain.set(gaussian, MEAN, gaussians.get::<DIFFUSE>(gaussian, MEAN));
    }
    plain
}

/// Some Gaussians in a row, from the first of a block.
fn part(gaussians: &Gaussians<Vec<f32>>, first: usize, count: usize) -> Gaussians<Vec<f32>> {
    let start = first / BLOCK * gaussians.block_len();
    let values = gaussians.values[start..start + len_of_values(count, gaussians.layout)].to_vec();
    Gaussians { count, layout: gaussians.layout, values }
}

/// Gaussians in the origin, so small and opaque that all are seen; their scales keep their order, by which axes are told.
fn in_the_origin(gaussians: &Gaussians<Vec<f32>>) -> Gaussians<Vec<f32>> {
    const LOG_SIZE: f32 = -5.0;
    let mut centred = gaussians.clone();
    for gaussian in 0..gaussians.count {
        let log_scales = gaussians.get::<3>(gaussian, LOG_SCALE);
        let largest = log_scales.into_iter().fold(f32::MIN, f32::max);
        centred.set(gaussian, MEAN, [0.0; 3]);
        centred.set(gaussian, LOG_SCALE, log_scales.map(|log_scale| log_scale - largest + LOG_SIZE));
        centred.set(gaussian, OPACITY, [1.0]);
    }
    centred
}

fn small(camera: &Camera) -> Camera {
    let longest = camera.width.max(camera.height);
    let size = |edge: u32| if longest > EDGE_MAX { (edge * EDGE_MAX).div_ceil(longest) } else { edge };
    camera.resized(size(camera.width), size(camera.height))
}

fn vector([x, y, z]: [f32; 3]) -> Vector<f32> {
    vec3(x, y, z)
}

fn three(channels: &[f32], first: usize) -> [f32; 3] {
    [channels[first], channels[first + 1], channels[first + 2]]
}
