//! Baking of a shading function into spherical harmonics: the colours of a scene under its light,
//! for programs without a shading function.
//!
//! The colours of a Gaussian towards cameras are fitted by weighted least squares
//! ([`specula_core::sh_fit`]). A camera's weight is the contribution of the Gaussian to its
//! picture, Σ αT over the pixels, so that hidden Gaussians do not count and the harmonics fit the
//! cameras' directions. `UNIFORM_COUNT` uniform directions, the same for all Gaussians, have a
//! total of `UNIFORM_WEIGHT` times the cameras' weight, which keeps other views plausible. In
//! models that look light up per pixel, a Gaussian is shaded by the light of the pixels that show
//! it; their mean normals are smoother than its own.

use crate::{Scene, ShadingModel, environment::fitting, renderer::upload_near_field};
use glam::Vec3;
use rayon::prelude::*;
use specula_core::{
    activation::sigmoid,
    attributes::{GaussianShading, StoredGaussian},
    camera::Camera,
    executor::ReadBack,
    near_field::NearField,
    pipeline::{Pass, render_pass, shade_gaussians},
    prefilter::{LevelRange, PrefilterScheme},
    rules::{Channels, RenderRules, channel},
    scene::{BLOCK, DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, len_of_values},
    sh::Y0,
    sh_fit::{Fit, Harmonics, harmonics},
    shade::{self, Material, ShadingForm, ShadingRules, Surface, Terms, surface},
    sphere::directions,
    vector::{Vec3 as Vector, vec3},
};
use specula_mesh::fusion::evenly_spaced;

/// Number of uniform directions around each Gaussian.
const UNIFORM_COUNT: usize = 256;
/// Total weight of the uniform directions, relative to that of the cameras.
const UNIFORM_WEIGHT: f64 = 0.02;
/// Largest number of cameras that are rendered.
const CAMERAS_MAX: usize = 96;
/// Largest number of cameras that [`bake_diffuse`] renders.
const NORMAL_CAMERAS_MAX: usize = 8;
/// Largest number of colours in memory, over all Gaussians and cameras: a gigabyte.
const COLORS_MAX: usize = 1 << 26;
/// Longer edge of rendered pictures, in pixels, which is enough for contributions.
const EDGE_MAX_PX: u32 = 400;
/// Number of Gaussians that are fitted at once.
const CHUNK: usize = 256 * BLOCK;

/// Gaussians without shading attributes that look like shaded ones, and their normals.
#[derive(Clone, Debug)]
pub struct Baked {
    /// Gaussians with spherical harmonics.
    pub gaussians: Gaussians<Vec<f32>>,
    /// Unit normals towards the cameras that see each Gaussian.
    pub normals: Vec<[f32; 3]>,
}

/// Bakes the colours of a shaded scene, as seen from cameras, into harmonics of this degree, 0 to
/// 3. Without a light nothing specular is baked.
///
/// The result of an executor is the same on every run. `progress` receives the number of steps done
/// and of all steps.
///
/// # Errors
///
/// Those of the executor.
pub fn bake<E: ReadBack>(
    exec: E,
    scene: &Scene,
    cameras: &[Camera],
    degree: u8,
    mut progress: impl FnMut(usize, usize),
) -> Result<Baked, E::Error> {
    let count_max = (COLORS_MAX / scene.gaussians.count.max(1)).clamp(8, CAMERAS_MAX);
    let cameras = evenly_spaced(cameras, count_max);
    let steps = cameras.len() + scene.gaussians.count.div_ceil(CHUNK);
    let mut baker = Baker::new(exec, scene)?;
    let uploaded = baker.exec.upload_gaussians(&scene.gaussians)?;
    let mut views = Vec::new();
    for camera in &cameras {
        views.push(baker.sample_view(&uploaded, camera)?);
        progress(views.len(), steps);
    }
    drop(uploaded);
    baker.fit(&scene.gaussians, &views, degree, |chunks| progress(cameras.len() + chunks, steps))
}

/// Bakes only the diffuse colours of a shaded scene, without any light.
///
/// # Errors
///
/// Those of [`bake`], which finds the normals.
pub(crate) fn bake_diffuse<E: ReadBack>(
    exec: E,
    scene: &Scene,
    cameras: &[Camera],
    progress: impl FnMut(usize, usize),
) -> Result<Baked, E::Error> {
    let Scene { gaussians, shading_model, .. } = scene;
    let normals = bake(exec, scene, &evenly_spaced(cameras, NORMAL_CAMERAS_MAX), 0, progress)?.normals;
    let mut plain = shapes_of(gaussians, Layout::radiance(0));
    let start = plain.layout.sh_start();
    for gaussian in 0..gaussians.count {
        let color = diffuse_color(gaussians, gaussian, shading_model.shading);
        plain.set(gaussian, start, color.to_array().map(|channel| (channel - 0.5) / Y0));
    }
    Ok(Baked { gaussians: plain, normals })
}

/// Activated attributes of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ActivatedAttributes {
    /// Diffuse colour.
    pub(crate) diffuse: [f32; 3],
    /// Specular tint.
    pub(crate) tint: [f32; 3],
    /// Perceptual roughness, in (0, 1).
    pub(crate) roughness: f32,
}

impl ActivatedAttributes {
    /// Attributes of one of the Gaussians of a shaded scene.
    pub(crate) fn of(gaussians: &Gaussians<Vec<f32>>, index: usize, shading: ShadingRules) -> Self {
        let material = material(gaussians, index, shading);
        let Surface { diffuse, tint, .. } = surface(&material, vector([0.0, 0.0, 1.0]), shading);
        Self { diffuse: diffuse.to_array(), tint: tint.to_array(), roughness: sigmoid(material.roughness) }
    }
}

/// Diffuse colour of a Gaussian without light; the albedo of a physical material.
fn diffuse_color(gaussians: &Gaussians<Vec<f32>>, index: usize, shading: ShadingRules) -> Vector<f32> {
    let diffuse = shade::diffuse(material(gaussians, index, shading).diffuse, shading);
    let form = match shading.form {
        ShadingForm::Physical => ShadingForm::Paper,
        _ => per_gaussian(shading).form,
    };
    shade::shade(form, &Terms::unlit(diffuse, Vector::default()))
}

/// Shading rules that look the light up per Gaussian.
fn per_gaussian(shading: ShadingRules) -> ShadingRules {
    match shading.form {
        ShadingForm::Deferred => ShadingRules { form: ShadingForm::Paper, ..shading },
        _ => shading,
    }
}

/// Contribution and colour of each Gaussian in a view.
#[derive(Debug)]
struct ViewSamples {
    position: Vec3,
    /// Σ αT over the pixels.
    weights: Vec<f32>,
    colors: Vec<[f32; 3]>,
}

/// Executor and light for baking.
struct Baker<E: ReadBack> {
    exec: E,
    light: Option<E::Light>,
    /// Rules of the scene's pictures, with all layers.
    picture_rules: RenderRules,
    /// Rules that look the light up per Gaussian.
    gaussian_rules: RenderRules,
}

/// Light around a near field, if there is one.
fn surrounded<E: ReadBack>(
    exec: &mut E,
    light: E::Light,
    near_field: Option<&NearField<Vec<f32>>>,
) -> Result<E::Light, E::Error> {
    let Some(near_field) = near_field else { return Ok(light) };
    let near_field = upload_near_field(exec, near_field)?;
    exec.surround(light, &near_field)
}

impl<E: ReadBack> Baker<E> {
    fn new(mut exec: E, scene: &Scene) -> Result<Self, E::Error> {
        let ShadingModel { shading, scheme, .. } = scene.shading_model;
        let light = match &scene.light {
            Some(light) => {
                let light = fitting(light, scheme);
                let values = exec.upload(&light.values)?;
                let filtered = exec.prefilter(&light.with_values(values), scheme, LevelRange::ALL)?;
                Some(surrounded(&mut exec, filtered, scene.near_field())?)
            }
            None => None,
        };
        let traces_near = scene.near_field.is_some() && scene.shading_model.traces_near();
        let picture_rules = RenderRules { traces_near, ..RenderRules::full(shading, scheme, Channels::Layers) };
        let gaussian_rules = RenderRules::full(per_gaussian(shading), scheme, Channels::Color);
        Ok(Self { exec, light, picture_rules, gaussian_rules })
    }

    /// Contributions and colours of Gaussians in a view. By linearity, the gradients of a
    /// Gaussian's channels are sums over the pixels, each times the Gaussian's share αT of the
    /// pixel. So its weight and the light of its pixels are gradients of pictures of coverage and
    /// of light. A Gaussian of a physical material has the mean colour of its pixels, which are
    /// occluded by the scene's surface.
    fn sample_view(&mut self, gaussians: &Gaussians<E::Array>, camera: &Camera) -> Result<ViewSamples, E::Error> {
        let (camera, rules) = (camera.limited(EDGE_MAX_PX), self.picture_rules);
        let (exec, light) = (&mut self.exec, self.light.as_ref());
        let Pass { splats, colors, tiles, frame } = render_pass(exec, gaussians, light, &camera, &rules, &mut ())?;
        let channels = rules.blended(gaussians.layout).count();
        let pixels = (camera.width * camera.height) as usize;
        let mut picture = vec![0.0; (channels + 1) * pixels];
        exec.read_frame(&frame, &mut picture)?;
        let form = rules.shading.form;
        let shown = if form == ShadingForm::Physical { channel::COLOR } else { channel::LIGHT };
        let gradient = exec.upload_frame_grad(&frame, &shown_and_coverage(&picture, shown, pixels))?;
        let grads = exec.blend_vjp(&splats, &colors, &tiles, &frame, &gradient, &camera)?;

        let mut layers = vec![0.0; gaussians.count * channels];
        exec.read_colors(&colors, &mut layers)?;
        let mut sums = vec![0.0; gaussians.count * SUMS];
        exec.read_channel_grads(&grads, 0..SUMS, &mut sums)?;
        let (sums, _) = sums.as_chunks::<SUMS>();
        let color = |(layers, sums): (&[f32], &[f32; SUMS])| match form {
            ShadingForm::Deferred => under_light_of_pixels(layers, *sums),
            ShadingForm::Physical => mean_of_pixels(*sums),
            ShadingForm::Paper | ShadingForm::Official => three(layers, channel::COLOR),
        };
        Ok(ViewSamples {
            position: camera.position,
            weights: sums.iter().map(|sums| sums[WEIGHT]).collect(),
            colors: layers.chunks_exact(channels).zip(sums).map(color).collect(),
        })
    }

    /// Colours of Gaussians towards uniform directions, direction by direction: Gaussians at the
    /// origin, seen from the unit sphere.
    fn sample_uniform(&mut self, gaussians: &Gaussians<Vec<f32>>) -> Result<Vec<Vec<[f32; 3]>>, E::Error> {
        let Self { exec, light, gaussian_rules: rules, .. } = self;
        let channels = rules.blended(gaussians.layout).count();
        let centred = exec.upload_gaussians(&in_the_origin(gaussians))?;
        let mut layers = vec![0.0; gaussians.count * channels];
        let colors = |towards: [f64; 3]| -> Result<Vec<[f32; 3]>, E::Error> {
            let eye = Vec3::from(towards.map(|x| x as f32));
            let size = BLOCK as u32;
            let camera = Camera::look_at(eye, Vec3::ZERO, eye.any_orthonormal_vector(), 1.0, size, size);
            let (_, colors) = shade_gaussians(exec, &centred, light.as_ref(), &camera, rules, &mut ())?;
            exec.read_colors(&colors, &mut layers)?;
            Ok(layers.chunks_exact(channels).map(|layers| three(layers, channel::COLOR)).collect())
        };
        directions(UNIFORM_COUNT).map(colors).collect()
    }

    /// Fits harmonics to the colours of views and of uniform directions, chunk by chunk.
    fn fit(
        &mut self,
        gaussians: &Gaussians<Vec<f32>>,
        views: &[ViewSamples],
        degree: u8,
        mut progress: impl FnMut(usize),
    ) -> Result<Baked, E::Error> {
        let mut plain = shapes_of(gaussians, Layout::radiance(degree));
        let uniform = UniformDirections::new(plain.layout.sh_count());
        let mut normals = Vec::with_capacity(gaussians.count);
        for (step, first) in (0..gaussians.count).step_by(CHUNK).enumerate() {
            let chunk = part(gaussians, first, CHUNK.min(gaussians.count - first));
            let around = self.sample_uniform(&chunk)?;
            let shading = self.gaussian_rules.shading;
            let is_physical = shading.form == ShadingForm::Physical;
            let fitted: Vec<_> = (0..chunk.count)
                .into_par_iter()
                .map(|k| {
                    let samples = ColorSamples::new(first + k, chunk.get::<3>(k, MEAN).into(), views);
                    // A physical material is lit only through its pixels.
                    let seen = if is_physical { samples.mean_color() } else { None };
                    (
                        samples.fit(&uniform, |direction| seen.unwrap_or(around[direction][k])),
                        normal(&chunk, k, samples.towards(), shading),
                    )
                })
                .collect();
            for (k, (coefficients, normal)) in fitted.into_iter().enumerate() {
                for (index, color) in coefficients.iter().take(plain.layout.sh_count()).enumerate() {
                    plain.set(first + k, plain.layout.sh_start() + 3 * index, *color);
                }
                normals.push(normal);
            }
            progress(step + 1);
        }
        Ok(Baked { gaussians: plain, normals })
    }
}

/// Uniform directions, the same for all Gaussians.
struct UniformDirections {
    /// Number of harmonics.
    count: usize,
    harmonics: Vec<Harmonics>,
    fit: Fit,
}

impl UniformDirections {
    fn new(count: usize) -> Self {
        let harmonics: Vec<Harmonics> =
            directions(UNIFORM_COUNT).map(|towards| harmonics(towards.map(|x| -x as f32), count)).collect();
        let mut fit = Fit::new(count);
        harmonics.iter().for_each(|harmonics| fit.add_direction(harmonics, 1.0 / UNIFORM_COUNT as f64));
        Self { count, harmonics, fit }
    }
}

/// Index of the coverage among a gradient's planes, after three of light.
const WEIGHT: usize = 3;
/// Planes of a gradient that are not zero.
const SUMS: usize = WEIGHT + 1;

/// Planes of a gradient: three channels of the picture from `shown` on, coverage, then zeros.
fn shown_and_coverage(picture: &[f32], shown: usize, pixels: usize) -> Vec<f32> {
    let mut planes = vec![0.0; picture.len()];
    planes[..WEIGHT * pixels].copy_from_slice(&picture[shown * pixels..(shown + 3) * pixels]);
    let transmittance = &picture[picture.len() - pixels..];
    planes[WEIGHT * pixels..].iter_mut().zip(transmittance).for_each(|(weight, passed)| *weight = 1.0 - passed);
    planes
}

/// Mean of the pixels that show a Gaussian, from their sums and that of coverage; black if none
/// does.
fn mean_of_pixels([r, g, b, weight]: [f32; SUMS]) -> [f32; 3] {
    if weight > 0.0 { [r, g, b].map(|sum| sum / weight) } else { [0.0; 3] }
}

/// Colour of a Gaussian under the mean light of the pixels that show it, from the sums of light and
/// of coverage.
fn under_light_of_pixels(layers: &[f32], sums: [f32; SUMS]) -> [f32; 3] {
    let terms = Terms {
        tint: vector(three(layers, channel::TINT)),
        specular_light: vector(mean_of_pixels(sums)),
        ..Terms::unlit(vector(three(layers, channel::DIFFUSE)), vector(three(layers, channel::RESIDUAL)))
    };
    shade::shade(ShadingForm::Paper, &terms).to_array()
}

/// Weight, direction to the Gaussian and colour of each view that shows a Gaussian.
struct ColorSamples(Vec<(f64, Vec3, [f32; 3])>);

impl ColorSamples {
    fn new(gaussian: usize, mean: Vec3, views: &[ViewSamples]) -> Self {
        let sample = |view: &ViewSamples| {
            let direction = (mean - view.position).normalize_or_zero();
            (f64::from(view.weights[gaussian]), direction, view.colors[gaussian])
        };
        Self(views.iter().map(sample).filter(|(weight, ..)| *weight > 0.0).collect())
    }

    fn total_weight(&self) -> f64 {
        self.0.iter().map(|(weight, ..)| weight).sum()
    }

    /// Mean colour over the views; none without any.
    fn mean_color(&self) -> Option<[f32; 3]> {
        let total = self.total_weight();
        let mean = |c: usize| self.0.iter().map(|(weight, _, color)| weight * f64::from(color[c])).sum::<f64>() / total;
        (total > 0.0).then(|| [0, 1, 2].map(|c| mean(c) as f32))
    }

    /// Coefficients of harmonics; `around` returns the colours of the uniform directions.
    fn fit(&self, uniform: &UniformDirections, around: impl Fn(usize) -> [f32; 3]) -> [[f32; 3]; 16] {
        let total = self.total_weight();
        let uniform_weight = if total > 0.0 { UNIFORM_WEIGHT } else { 1.0 };
        let mut fit = uniform.fit.without_colors(uniform_weight);
        for (direction, harmonics) in uniform.harmonics.iter().enumerate() {
            fit.add_color(harmonics, around(direction), uniform_weight / UNIFORM_COUNT as f64);
        }
        for (weight, direction, color) in &self.0 {
            fit.add(&harmonics(direction.to_array(), uniform.count), *color, weight / total);
        }
        fit.solve().unwrap_or_default()
    }

    /// Mean direction towards the views; +z without views.
    fn towards(&self) -> Vec3 {
        let sum: Vec3 = self.0.iter().map(|(weight, direction, _)| *direction * -(*weight as f32)).sum();
        sum.try_normalize().unwrap_or(Vec3::Z)
    }
}

/// Normal of a Gaussian on the side of a direction.
pub(crate) fn normal(gaussians: &Gaussians<Vec<f32>>, index: usize, towards: Vec3, shading: ShadingRules) -> [f32; 3] {
    let material = Material { mean: Vector::default(), ..material(gaussians, index, shading) };
    surface(&material, vector(towards.to_array()), shading).facing.normal.to_array()
}

fn material(gaussians: &Gaussians<Vec<f32>>, index: usize, shading: ShadingRules) -> Material<f32> {
    // The prefilter and the channels do not affect materials.
    let rules = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Color);
    GaussianShading { layout: gaussians.layout, rules }.material(&StoredGaussian { gaussians, index })
}

/// Means, shapes and opacities, without colours.
fn shapes_of(gaussians: &Gaussians<Vec<f32>>, layout: Layout) -> Gaussians<Vec<f32>> {
    let count = gaussians.count;
    let mut plain = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    for gaussian in 0..count {
        plain.set(gaussian, MEAN, gaussians.get::<DIFFUSE>(gaussian, MEAN));
    }
    plain
}

/// `count` Gaussians from the first of a block.
fn part(gaussians: &Gaussians<Vec<f32>>, first: usize, count: usize) -> Gaussians<Vec<f32>> {
    let start = first / BLOCK * gaussians.block_len();
    let values = gaussians.values[start..start + len_of_values(count, gaussians.layout)].to_vec();
    Gaussians { count, layout: gaussians.layout, values }
}

/// Gaussians at the origin, small and opaque so that all are drawn; keeps the order of scales,
/// which determines the axis of normals.
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

fn vector([x, y, z]: [f32; 3]) -> Vector<f32> {
    vec3(x, y, z)
}

fn three(channels: &[f32], first: usize) -> [f32; 3] {
    [channels[first], channels[first + 1], channels[first + 2]]
}
