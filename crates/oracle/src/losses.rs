//! Losses of training, pixel by pixel and Gaussian by Gaussian.

use crate::{
    cloud::{AddedGrads, gaussian},
    number::{Number, take3},
    picture::{Frame, composite, vector_at},
    smoothness::{SURFACE_COVERAGE, smoothness_loss, smoothness_loss_vjp, weights_of},
};
use specula_core::{
    attributes::AttributeLosses,
    camera::Camera,
    depth_normal::{self, Cross},
    loss::{self, LossWeights, NormalForm, SSIM_WINDOW, SsimMoments, White},
    rules::channel,
    scene::Gaussians,
    vector::{Mat3, Vec3},
};

/// Ground truth over its background.
#[derive(Clone, Debug)]
pub struct Target<R> {
    /// Three planes, sRGB.
    pub srgb: Vec<R>,
    /// Its alpha, if it has one.
    pub alpha: Option<Vec<R>>,
    /// Background colour, sRGB.
    pub background: [f32; 3],
    /// Whether no number is above white.
    pub is_clipped: bool,
}

/// Numbers of a picture that the losses use as constant weights.
#[derive(Clone, Debug)]
pub struct FrozenWeights {
    /// Coverage of every pixel.
    coverage: Vec<f64>,
    /// Coverage of pixels with a surface in them and their four neighbours, else zero.
    surface: Vec<f64>,
    /// Evenness of the surface around every pixel, times its gloss.
    smoothness: Vec<f64>,
}

impl FrozenWeights {
    /// Number of pixels of the normal loss.
    pub fn surface_count(&self) -> usize {
        self.surface.iter().filter(|weight| **weight > 0.0).count()
    }
}

/// The weights of a picture; `unlit` is the picture without light, if light is added per pixel.
pub fn freeze_weights<R: Number>(frame: &Frame<R>, unlit: Option<&Frame<R>>, camera: &Camera) -> FrozenWeights {
    let (width, height) = (frame.width, frame.height);
    let size = frame.pixel_count();
    let coverage: Vec<f64> = frame.values[(frame.channels - 1) * size..].iter().map(|t| 1.0 - t.value()).collect();
    let weigh = |pixel: usize| {
        let (column, row) = (pixel % width, pixel / width);
        if column == 0 || row == 0 || column + 1 == width || row + 1 == height {
            return 0.0;
        }
        let five = [pixel, pixel - 1, pixel + 1, pixel - width, pixel + width];
        if five.iter().all(|p| coverage[*p] > SURFACE_COVERAGE) { coverage[pixel] } else { 0.0 }
    };
    let surface = (0..size).map(weigh).collect();
    let has_geometry = frame.channels > channel::RESIDUAL_SIZE;
    let smoothness = if has_geometry { weights_of(frame, unlit, camera) } else { Vec::new() };
    FrozenWeights { coverage, surface, smoothness }
}

/// Rendered and true colour in the losses.
fn compared<R: Number>(frame: &Frame<R>, target: &Target<R>, weights: &LossWeights) -> [Vec<R>; 2] {
    let white = weights.white(target.is_clipped);
    let alpha_of = |pixel: usize| target.alpha.as_ref().map_or(R::of(1.0), |alpha| alpha[pixel]);
    let rendered = composite(frame, target.background);
    let pairs = rendered.iter().zip(&target.srgb).enumerate();
    let pairs =
        pairs.map(|(index, (x, y))| <(R, R)>::from(white.compared(*x, *y, alpha_of(index % frame.pixel_count()))));
    let (rendered, truth) = pairs.unzip();
    [rendered, truth]
}

/// The losses of a picture.
pub fn frame_loss<R: Number>(
    frame: &Frame<R>,
    target: &Target<R>,
    camera: &Camera,
    weights: &LossWeights,
    frozen: &FrozenWeights,
) -> R {
    let size = frame.pixel_count();
    let [rendered, truth] = compared(frame, target, weights);
    let mut total = R::of(0.0);
    let weighted_mean = |weight: f32, f: fn(R, R) -> R| {
        let sum = rendered.iter().zip(&truth).fold(R::of(0.0), |sum, (x, y)| sum + f(*x, *y));
        sum * R::of(f64::from(weight) / (3 * size) as f64)
    };
    total = total + weighted_mean(weights.absolute, loss::absolute) + weighted_mean(weights.squared, loss::squared);
    if weights.dssim != 0.0 {
        let similarities = ssim_moments(frame.width, frame.height, &rendered, &truth);
        let sum = similarities.iter().fold(R::of(0.0), |sum, moments| sum + loss::ssim(moments));
        total = total + (-(sum / R::of((3 * size) as f64)) + 1.0) * weights.dssim;
    }
    for pixel in 0..size {
        let share = |weight: f32| R::of(f64::from(weight) / size as f64);
        let coverage = -frame.values[(frame.channels - 1) * size + pixel] + 1.0;
        if let Some(alpha) = &target.alpha {
            total = total + loss::absolute(coverage, alpha[pixel]) * share(weights.coverage);
        }
        if frame.channels > channel::RESIDUAL_SIZE {
            total = total + loss::sparse_coverage(coverage) * share(weights.sparse_coverage);
            let residual = frame.values[channel::RESIDUAL_SIZE * size + pixel];
            total = total + residual * R::of(frozen.coverage[pixel]) * share(weights.residual_image);
            if frozen.surface[pixel] > 0.0 && weights.normal != 0.0 {
                let compared = Compared::new(frame, camera, pixel, frozen.surface[pixel]);
                let value = compared.loss(weights.normal_form);
                total = total + value * R::of(frozen.surface[pixel]) * share(weights.normal);
            }
        }
    }
    if frame.channels > channel::RESIDUAL_SIZE && weights.smoothness != 0.0 {
        total = total + smoothness_loss(frame, camera, &frozen.smoothness, weights.smoothness);
    }
    total
}

/// Gradient of [`frame_loss`], in the planes of a frame.
pub fn frame_loss_vjp<R: Number>(
    frame: &Frame<R>,
    target: &Target<R>,
    camera: &Camera,
    weights: &LossWeights,
    frozen: &FrozenWeights,
) -> Frame<R> {
    let size = frame.pixel_count();
    let last = (frame.channels - 1) * size;
    let [rendered, truth] = compared(frame, target, weights);
    let mut grad = Frame { values: vec![R::of(0.0); frame.values.len()], ..*frame };

    let grad_of_value = |weight: f32| R::of(f64::from(weight) / (3 * size) as f64);
    for (index, (x, y)) in rendered.iter().zip(&truth).enumerate() {
        grad.values[index] = loss::absolute_vjp(*x, *y, grad_of_value(weights.absolute))
            + loss::squared_vjp(*x, *y, grad_of_value(weights.squared));
    }
    if weights.dssim != 0.0 {
        let grad_ssim = -grad_of_value(weights.dssim);
        for (sum, x) in grad.values.iter_mut().zip(mean_ssim_vjp(frame, &rendered, &truth, grad_ssim)) {
            *sum = *sum + x;
        }
    }
    match weights.white(target.is_clipped) {
        White::Exact => {}
        White::Saturated => {
            for (grad, (x, y)) in grad.values.iter_mut().zip(rendered.iter().zip(&truth)) {
                *grad = loss::recorded_vjp(*x, *y, *grad);
            }
        }
        White::Unclipped => {
            for (grad, y) in grad.values.iter_mut().zip(&target.srgb) {
                *grad = *grad * loss::unclipped_scale(*y);
            }
        }
    }
    for index in 0..3 * size {
        let behind = grad.values[index] * target.background[index / size];
        grad.values[last + index % size] = grad.values[last + index % size] + behind;
    }

    for pixel in 0..size {
        let share = |weight: f32| R::of(f64::from(weight) / size as f64);
        let coverage = -frame.values[last + pixel] + 1.0;
        let mut grad_coverage = R::of(0.0);
        if let Some(alpha) = &target.alpha {
            grad_coverage = grad_coverage + loss::absolute_vjp(coverage, alpha[pixel], share(weights.coverage));
        }
        if frame.channels > channel::RESIDUAL_SIZE {
            grad_coverage = grad_coverage + loss::sparse_coverage_vjp(coverage, share(weights.sparse_coverage));
            grad.values[channel::RESIDUAL_SIZE * size + pixel] =
                R::of(frozen.coverage[pixel]) * share(weights.residual_image);
            if frozen.surface[pixel] > 0.0 && weights.normal != 0.0 {
                let compared = Compared::new(frame, camera, pixel, frozen.surface[pixel]);
                let scale = R::of(frozen.surface[pixel]) * share(weights.normal);
                compared.vjp(weights.normal_form, scale, frame, &mut grad);
            }
        }
        grad.values[last + pixel] = grad.values[last + pixel] - grad_coverage;
    }
    if frame.channels > channel::RESIDUAL_SIZE && weights.smoothness != 0.0 {
        smoothness_loss_vjp(frame, camera, &frozen.smoothness, weights.smoothness, &mut grad);
    }
    grad
}

/// The rendered normal and the depth's normal at one pixel, in world space.
struct Compared<R> {
    pixel: usize,
    coverage: R,
    rotation: Mat3<R>,
    rays: Cross<Vec3<R>>,
    depths: Cross<R>,
    /// Blended normal; its length is the coverage if all splats agree.
    rendered: Vec3<R>,
    /// Unit normal of the depth.
    geometric: Vec3<R>,
}

impl<R: Number> Compared<R> {
    fn new(frame: &Frame<R>, camera: &Camera, pixel: usize, coverage: f64) -> Self {
        let [x, y] = [pixel % frame.width, pixel / frame.width].map(|k| k as f64 + 0.5);
        let [principal, focal] = [camera.principal_px, camera.focal_px].map(|pair| pair.map(f64::from));
        let ray =
            |x: f64, y: f64| take3(&[(x - principal[0]) / focal[0], (y - principal[1]) / focal[1], 1.0].map(R::of));
        let rays =
            Cross { left: ray(x - 1.0, y), right: ray(x + 1.0, y), above: ray(x, y - 1.0), below: ray(x, y + 1.0) };
        let depth = |neighbour: usize| {
            let (blended, coverage) = depth_and_coverage(frame, neighbour);
            depth_normal::expected_depth(blended, coverage)
        };
        let [left, right, above, below] = neighbours(pixel, frame.width).map(depth);
        let depths = Cross { left, right, above, below };
        let rotation = Mat3::constant(R::of(0.0), camera.camera_from_world);
        let geometric = rotation.transform_transposed(depth_normal::normal(&rays, &depths));
        let rendered = vector_at(frame, channel::NORMAL, pixel);
        Self { pixel, coverage: R::of(coverage), rotation, rays, depths, rendered, geometric }
    }

    fn loss(&self, form: NormalForm) -> R {
        match form {
            NormalForm::Distance => loss::normal_distance(self.rendered, self.geometric * self.coverage),
            NormalForm::Cosine | NormalForm::CosineDetached => loss::normal_cosine(self.rendered, self.geometric),
        }
    }

    fn vjp(&self, form: NormalForm, grad: R, frame: &Frame<R>, out: &mut Frame<R>) {
        let (grad_rendered, grad_geometric) = match form {
            NormalForm::Distance => {
                let grad = loss::normal_distance_vjp(self.rendered, self.geometric * self.coverage, grad);
                (grad, -grad * self.coverage)
            }
            NormalForm::Cosine => loss::normal_cosine_vjp(self.rendered, self.geometric, grad),
            NormalForm::CosineDetached => {
                (loss::normal_cosine_vjp(self.rendered, self.geometric, grad).0, Vec3::zero(grad))
            }
        };
        let size = frame.pixel_count();
        let mut sum = |plane: usize, pixel: usize, value: R| {
            let slot = &mut out.values[plane * size + pixel];
            *slot = *slot + value;
        };
        for (c, value) in grad_rendered.to_array().into_iter().enumerate() {
            sum(channel::NORMAL + c, self.pixel, value);
        }
        let in_camera = self.rotation.transform(grad_geometric);
        let depths = depth_normal::normal_vjp(&self.rays, &self.depths, in_camera);
        let grads = [depths.left, depths.right, depths.above, depths.below];
        for (neighbour, grad) in neighbours(self.pixel, frame.width).into_iter().zip(grads) {
            let (blended, coverage) = depth_and_coverage(frame, neighbour);
            let depth = depth_normal::expected_depth(blended, coverage);
            let (grad_blended, grad_coverage) = depth_normal::expected_depth_vjp(depth, coverage, grad);
            sum(channel::DEPTH, neighbour, grad_blended);
            sum(frame.channels - 1, neighbour, -grad_coverage);
        }
    }
}

/// Left, right, above, below.
fn neighbours(pixel: usize, width: usize) -> [usize; 4] {
    [pixel - 1, pixel + 1, pixel - width, pixel + width]
}

fn depth_and_coverage<R: Number>(frame: &Frame<R>, pixel: usize) -> (R, R) {
    let size = frame.pixel_count();
    (frame.values[channel::DEPTH * size + pixel], -frame.values[(frame.channels - 1) * size + pixel] + 1.0)
}

/// Pixels of one plane in the window around a pixel, with their weights; outside the picture all is
/// zero.
fn window(
    weights: [f64; SSIM_WINDOW],
    width: usize,
    height: usize,
    pixel: usize,
) -> impl Iterator<Item = (usize, f64)> {
    let reach = (SSIM_WINDOW / 2) as isize;
    let (column, row) = ((pixel % width) as isize, (pixel / width) as isize);
    let inside = |index: isize, end: usize| (0..end as isize).contains(&index);
    (-reach..=reach).flat_map(move |dy| (-reach..=reach).map(move |dx| (dx, dy))).filter_map(move |(dx, dy)| {
        let (x, y) = (column + dx, row + dy);
        let weight = weights[(dx + reach) as usize] * weights[(dy + reach) as usize];
        (inside(x, width) && inside(y, height)).then(|| (y as usize * width + x as usize, weight))
    })
}

/// Moments of every SSIM window of every plane.
fn ssim_moments<R: Number>(width: usize, height: usize, x: &[R], y: &[R]) -> Vec<SsimMoments<R>> {
    let size = width * height;
    let weights = loss::ssim_window().map(f64::from);
    let at = |index: usize| {
        let zero = R::of(0.0);
        let plane = index / size * size;
        let mut m = SsimMoments { x: zero, y: zero, xx: zero, yy: zero, xy: zero };
        for (pixel, weight) in window(weights, width, height, index % size) {
            let (x, y, weight) = (x[plane + pixel], y[plane + pixel], R::of(weight));
            m.x = m.x + x * weight;
            m.y = m.y + y * weight;
            m.xx = m.xx + x * x * weight;
            m.yy = m.yy + y * y * weight;
            m.xy = m.xy + x * y * weight;
        }
        m
    };
    (0..x.len()).map(at).collect()
}

/// Gradient of the sum of all similarities with respect to the rendered planes.
fn mean_ssim_vjp<R: Number>(frame: &Frame<R>, x: &[R], y: &[R], grad: R) -> Vec<R> {
    let size = frame.pixel_count();
    let weights = loss::ssim_window().map(f64::from);
    let mut out = vec![R::of(0.0); x.len()];
    for (index, moments) in ssim_moments(frame.width, frame.height, x, y).iter().enumerate() {
        let [grad_x, grad_xx, grad_xy] = loss::ssim_vjp(moments, grad);
        let plane = index / size * size;
        for (pixel, weight) in window(weights, frame.width, frame.height, index % size) {
            let pixel = plane + pixel;
            let slope = grad_x + grad_xx * x[pixel] * 2.0 + grad_xy * y[pixel];
            out[pixel] = out[pixel] + slope * R::of(weight);
        }
    }
    out
}

/// The losses of the Gaussians themselves.
pub fn attribute_loss<R: Number>(gaussians: &Gaussians<Vec<R>>, weights: &LossWeights) -> R {
    let losses = AttributeLosses::new(weights, gaussians.layout);
    let loss_of = |index: usize| losses.loss(&gaussian(gaussians, index), attribute_factors(weights, gaussians.count));
    (0..gaussians.count).fold(R::of(0.0), |total, index| total + loss_of(index))
}

/// [`AttributeLosses::factors`] in `f64`.
fn attribute_factors<R: Number>(weights: &LossWeights, count: usize) -> [R; 4] {
    let means = [weights.sparse, 2.0 * weights.residual, weights.metalness].map(f64::from);
    let [sparse, residual, metalness] = means.map(|weight| R::of(weight / count as f64));
    [sparse, residual, metalness, R::of(f64::from(weights.mean_light))]
}

/// Gradient of [`attribute_loss`], added to that of the Gaussians.
pub fn attribute_loss_vjp<R: Number>(
    gaussians: &Gaussians<Vec<R>>,
    weights: &LossWeights,
    out: &mut Gaussians<Vec<R>>,
) {
    let losses = AttributeLosses::new(weights, gaussians.layout);
    for index in 0..gaussians.count {
        let factors = attribute_factors(weights, gaussians.count);
        losses.loss_vjp(&gaussian(gaussians, index), factors, &mut AddedGrads { gaussians: out, index });
    }
}
