//! Blending of splats, pixel by pixel.

use crate::number::{Number, take3};
use specula_core::{
    bin,
    blend::{self, Composite, OffsetMoments, PixelState, Replay, StepGrad},
    camera::Camera,
    cutoffs::Cutoffs,
    occlusion::is_hidden,
    order::ResponseDepth,
    perspective::{self, Perspective},
    scene::Image,
    splat::{Splat, Splat2d, SplatGrad},
    vector::Vec3,
};

/// A blended picture: premultiplied channels as planes, then transmittance as the last plane.
pub type Frame<R> = Image<Vec<R>>;

/// Drawn splats, nearest first; those of equal depth in the order of the Gaussians.
pub fn front_to_back<R: Number>(splats: &[Splat<R>]) -> Vec<usize> {
    front_to_back_within(splats, &Cutoffs::DEFAULT)
}

/// [`front_to_back`] with other cutoffs.
pub fn front_to_back_within<R: Number>(splats: &[Splat<R>], cutoffs: &Cutoffs) -> Vec<usize> {
    let is_drawn = |index: &usize| bin::footprint_within(&splats[*index], cutoffs).reach.value() > 0.0;
    let mut order: Vec<usize> = (0..splats.len()).filter(is_drawn).collect();
    order.sort_by(|a, b| splats[*a].depth.value().total_cmp(&splats[*b].depth.value()));
    order
}

/// Offset of a pixel's centre from a splat's.
fn offset<R: Number>(splat: &Splat<R>, column: usize, row: usize) -> [R; 2] {
    let [x, y] = [column, row].map(|index| R::of(index as f64 + 0.5));
    [x - splat.mean2d[0], y - splat.mean2d[1]]
}

/// log₂ of a splat's strength at an offset from its mean; affine without a `perspective`.
fn log2_strength<R: Number>(splat: &Splat2d<R>, perspective: Option<&Perspective<R>>, [dx, dy]: [R; 2]) -> R {
    let falloff = blend::falloff(splat, dx, dy);
    let Some(perspective) = perspective else { return falloff.log2_strength };
    let [u, w] = falloff.offset;
    let scale = perspective::ray_scale(R::of(1.0), perspective.slope, [dx, dy]);
    let curvature = perspective::scaled_curvature(perspective.curvature);
    perspective::log2_strength(splat.log2_opacity, u * u + w * w, scale, curvature)
}

fn splats2d<R: Number>(splats: &[Splat<R>]) -> Vec<Splat2d<R>> {
    splats.iter().map(|splat| Splat2d::new(splat.mean2d, splat.root_conic, splat.opacity.log2())).collect()
}

/// First row of pixels that a splat may overlap, and one past the last.
fn rows_of<R: Number>(
    splat: &Splat<R>,
    perspective: Option<&Perspective<R>>,
    height: usize,
    cutoffs: &Cutoffs,
) -> [usize; 2] {
    let reach = bin::footprint_within(splat, cutoffs).reach;
    let (mean2d, variance) = match perspective {
        None => (splat.mean2d, splat.variance),
        Some(perspective) => {
            let (footprint, variance) = perspective::footprint_in_perspective(splat, perspective, reach);
            (footprint.mean2d, variance)
        }
    };
    let half = (variance[1].sqrt() * reach).value();
    let y = mean2d[1].value();
    [y - half - 1.0, y + half + 1.0].map(|y| y.clamp(0.0, height as f64) as usize)
}

/// Splats to a picture.
pub fn blend<R: Number>(splats: &[Splat<R>], colors: &[Vec<R>], order: &[usize], camera: &Camera) -> Frame<R> {
    blend_within(splats, None, colors, order, camera, &Cutoffs::DEFAULT)
}

/// [`blend()`] with other cutoffs, except the reach of splats into tiles and their order
/// ([`blend_in_order`]). Without perspectives the projection is affine.
pub fn blend_within<R: Number>(
    splats: &[Splat<R>],
    perspectives: Option<&[Perspective<R>]>,
    colors: &[Vec<R>],
    order: &[usize],
    camera: &Camera,
    cutoffs: &Cutoffs,
) -> Frame<R> {
    blend_in_order(splats, perspectives, None, colors, order, camera, None, cutoffs)
}

/// [`blend_within`] in the order of the cutoffs, which needs the depths of responses; without them
/// in `order`. Splats behind the depths of an occlusion ([`mod@specula_core::occlusion`]) are left
/// out. Rows without a visible part of a splat are skipped, which changes nothing.
pub fn blend_in_order<R: Number>(
    splats: &[Splat<R>],
    perspectives: Option<&[Perspective<R>]>,
    responses: Option<&[ResponseDepth<R>]>,
    colors: &[Vec<R>],
    order: &[usize],
    camera: &Camera,
    occlusion: Option<&[f32]>,
    cutoffs: &Cutoffs,
) -> Frame<R> {
    let channels = colors.first().map_or(0, Vec::len);
    let (width, height) = (camera.width as usize, camera.height as usize);
    let size = width * height;
    let splats2d = splats2d(splats);
    let mut values = vec![R::of(0.0); (channels + 1) * size];
    let perspective = |k: usize| perspectives.map(|all| &all[k]);
    let rows: Vec<[usize; 2]> =
        splats.iter().enumerate().map(|(k, splat)| rows_of(splat, perspective(k), height, cutoffs)).collect();
    for row in 0..height {
        let near: Vec<usize> = order.iter().copied().filter(|k| rows[*k][0] <= row && row < rows[*k][1]).collect();
        for pixel in row * width..(row + 1) * width {
            let hit = |k: &usize| {
                let offset = offset(&splats[*k], pixel % width, row);
                let strength = log2_strength(&splats2d[*k], perspective(*k), offset);
                let depth = responses.map(|responses| responses[*k].at(offset));
                let surface = occlusion.map_or(f32::INFINITY, |depths| depths[pixel]);
                let is_visible = !is_hidden(depth.unwrap_or(splats[*k].depth), R::of(f64::from(surface)));
                let depth = depth.map_or(0.0, Number::value);
                (is_visible && cutoffs.passes_alpha_test(strength)).then_some(Hit { splat: *k, strength, depth })
            };
            let hits: Vec<Hit<R>> = near.iter().filter_map(hit).collect();
            let mut state = PixelState::open(R::of(1.0));
            for hit in sorted(hits, cutoffs.order().window()) {
                let Composite { weight, behind } = cutoffs.step(cutoffs.alpha(hit.strength), state);
                for (channel, color) in colors[hit.splat].iter().enumerate() {
                    let value = &mut values[channel * size + pixel];
                    *value = *value + weight * *color;
                }
                state = behind;
            }
            values[channels * size + pixel] = state.final_transmittance;
        }
    }
    Image { width, height, channels: channels + 1, values }
}

/// Visible splat of a pixel.
struct Hit<R> {
    splat: usize,
    strength: R,
    /// Depth of its largest response.
    depth: f64,
}

/// Splats of a pixel sorted within a window of this size, unlimited for `None`; ties in their
/// order.
fn sorted<R>(hits: Vec<Hit<R>>, window: Option<usize>) -> Vec<Hit<R>> {
    let mut sorted: Vec<Hit<R>> = Vec::with_capacity(hits.len());
    for (count, hit) in hits.into_iter().enumerate() {
        // All but the last `window − 1` have been blended.
        let blended = window.map_or(0, |window| (count + 1).saturating_sub(window));
        let place = blended + sorted[blended..].partition_point(|other| other.depth <= hit.depth);
        sorted.insert(place, hit);
    }
    sorted
}

/// Gradient of [`blend()`]: of each splat and of its channels.
pub fn blend_vjp<R: Number>(
    splats: &[Splat<R>],
    colors: &[Vec<R>],
    order: &[usize],
    frame: &Frame<R>,
    grad: &Frame<R>,
) -> (Vec<SplatGrad<R>>, Vec<Vec<R>>) {
    let zero = R::of(0.0);
    let (size, channels) = (frame.pixel_count(), frame.channels - 1);
    let splats2d = splats2d(splats);
    let mut moments = vec![OffsetMoments::zero(zero); splats.len()];
    let mut grad_colors = vec![vec![zero; channels]; splats.len()];
    for pixel in 0..size {
        let pixel_grad: Vec<R> = (0..channels).map(|channel| grad.values[channel * size + pixel]).collect();
        let all = (0..=channels).map(|plane| frame.values[plane * size + pixel] * grad.values[plane * size + pixel]);
        let mut replay = Replay { transmittance: R::of(1.0), remaining: all.fold(zero, |sum, x| sum + x) };
        for &k in order {
            let [dx, dy] = offset(&splats[k], pixel % frame.width, pixel / frame.width);
            let falloff = blend::falloff(&splats2d[k], dx, dy);
            let dot = colors[k].iter().zip(&pixel_grad).fold(zero, |sum, (color, grad)| sum + *color * *grad);
            let StepGrad { log_strength, weight, behind } = blend::step_vjp(falloff.log2_strength, replay, dot);
            for (sum, grad) in grad_colors[k].iter_mut().zip(&pixel_grad) {
                *sum = *sum + weight * *grad;
            }
            moments[k] = moments[k].with(log_strength, falloff.offset);
            replay = behind;
        }
    }
    let grad_splat = |k: usize| blend::moments_vjp(&splats2d[k], splats[k].opacity, &moments[k]);
    ((0..splats.len()).map(grad_splat).collect(), grad_colors)
}

/// Colours over a background: C + T · background, three planes.
pub fn composite<R: Number>(frame: &Frame<R>, background: [f32; 3]) -> Vec<R> {
    let size = frame.pixel_count();
    let passed = &frame.values[(frame.channels - 1) * size..];
    let over = |index: usize| frame.values[index] + passed[index % size] * background[index / size];
    (0..3 * size).map(over).collect()
}

/// Three planes at one pixel.
pub(super) fn vector_at<R: Number>(frame: &Frame<R>, first: usize, pixel: usize) -> Vec3<R> {
    let size = frame.pixel_count();
    take3(&[0, 1, 2].map(|c| frame.values[(first + c) * size + pixel]))
}
