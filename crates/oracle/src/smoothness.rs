//! Smoothness of rendered normals, pixel by pixel ([`mod@specula_core::smoothness`]).

use crate::{
    number::Number,
    picture::{Frame, vector_at},
};
use specula_core::{
    camera::{Camera, CameraOf},
    rules::channel,
    smoothness::{
        BLUR_REACH, CREASE_REACH, Line, REACHES, bending, bending_vjp, blurred_normal, evenness, gloss, unit_normal,
        unit_normal_vjp,
    },
    vector::Vec3,
};

/// Coverage below which a pixel has no surface.
pub(crate) const SURFACE_COVERAGE: f64 = 0.5;

/// Unit normals of a picture, and its camera.
struct Normals<R> {
    size: [usize; 2],
    units: Vec<Vec3<R>>,
    camera: CameraOf<R>,
}

fn is_surface<R: Number>(frame: &Frame<R>, pixel: usize) -> bool {
    1.0 - frame.values[(frame.channels - 1) * frame.pixel_count() + pixel].value() > SURFACE_COVERAGE
}

/// A mask that every number of this kind has.
fn mask<R: Number>(is_true: bool) -> R::Mask {
    R::of(0.0).less(R::of(f64::from(u8::from(is_true))))
}

impl<R: Number> Normals<R> {
    fn new(frame: &Frame<R>, camera: &Camera) -> Self {
        let unit =
            |pixel: usize| unit_normal(vector_at(frame, channel::NORMAL, pixel), mask::<R>(is_surface(frame, pixel)));
        let units = (0..frame.pixel_count()).map(unit).collect();
        Self { size: [frame.width, frame.height], units, camera: camera.lift(R::of(0.0)) }
    }

    fn view_dir(&self, pixel: usize) -> Vec3<R> {
        let [x, y] = [pixel % self.size[0], pixel / self.size[0]].map(|k| R::of(k as f64 + 0.5));
        self.camera.view_dir(x, y)
    }

    /// Pixels before and after one along an axis, if both are in the picture.
    fn ends(&self, pixel: usize, axis: usize, reach: usize) -> Option<[usize; 2]> {
        let [width, height] = self.size;
        let (place, end, step) = [(pixel % width, width, 1), (pixel / width, height, width)][axis];
        (place >= reach && place + reach < end).then(|| [pixel - reach * step, pixel + reach * step])
    }

    /// Line of these normals through a pixel, if it is in the picture.
    fn line(&self, of: &[Vec3<R>], pixel: usize, axis: usize, reach: usize) -> Option<Line<R>> {
        let [before, after] = self.ends(pixel, axis, reach)?;
        Some(Line { before: of[before], at: of[pixel], after: of[after] })
    }

    fn blurred(&self) -> Vec<Vec3<R>> {
        let [width, height] = self.size;
        let around = |at: usize, end: usize| at.saturating_sub(BLUR_REACH)..(at + BLUR_REACH + 1).min(end);
        let blur = |pixel: usize| {
            let mut sum = Vec3::zero(R::of(0.0));
            for y in around(pixel / width, height) {
                for x in around(pixel % width, width) {
                    sum = sum + self.units[y * width + x];
                }
            }
            blurred_normal(sum)
        };
        (0..self.units.len()).map(blur).collect()
    }

    /// Every line of the loss, with its pixel, axis and reach.
    fn lines(&self) -> impl Iterator<Item = (usize, [usize; 2], Line<R>)> + '_ {
        let places = (0..self.units.len()).flat_map(|pixel| [0, 1].map(|axis| (pixel, axis)));
        let places = places.flat_map(|(pixel, axis)| REACHES.map(|reach| (pixel, axis, reach)));
        places.filter_map(|(pixel, axis, reach)| {
            let line = self.line(&self.units, pixel, axis, reach)?;
            Some((pixel, self.ends(pixel, axis, reach)?, line))
        })
    }
}

/// Weight of each pixel, constant in the loss. `unlit` is the picture without light, if light is
/// added per pixel.
pub(crate) fn weights_of<R: Number>(frame: &Frame<R>, unlit: Option<&Frame<R>>, camera: &Camera) -> Vec<f64> {
    let normals = Normals::new(frame, camera);
    let blurred = normals.blurred();
    let weigh = |pixel: usize| {
        let [row, column] = [0, 1].map(|axis| normals.line(&blurred, pixel, axis, CREASE_REACH));
        let (Some(row), Some(column)) = (row, column) else { return 0.0 };
        let gloss = unlit.map_or(1.0, |unlit| gloss_of(frame, unlit, pixel));
        gloss * evenness(&row, &column, normals.view_dir(pixel)).value()
    };
    (0..frame.pixel_count()).map(weigh).collect()
}

fn gloss_of<R: Number>(frame: &Frame<R>, unlit: &Frame<R>, pixel: usize) -> f64 {
    let plane = |channel: usize| frame.values[channel * frame.pixel_count() + pixel];
    let [lit, unlit] = [frame, unlit].map(|frame| vector_at(frame, channel::COLOR, pixel));
    gloss(lit, unlit, plane(channel::ROUGHNESS), -plane(frame.channels - 1) + 1.0).value()
}

/// Mean loss of a picture with [`weights_of`] its pixels, times a weight.
pub(crate) fn smoothness_loss<R: Number>(frame: &Frame<R>, camera: &Camera, weights: &[f64], weight: f32) -> R {
    let normals = Normals::new(frame, camera);
    let share = share_of(frame, weight);
    normals.lines().fold(R::of(0.0), |sum, (pixel, _, line)| {
        sum + bending(&line, normals.view_dir(pixel), R::of(weights[pixel])) * share
    })
}

/// Adds the gradient of [`smoothness_loss`] to the planes of a frame.
pub(crate) fn smoothness_loss_vjp<R: Number>(
    frame: &Frame<R>,
    camera: &Camera,
    weights: &[f64],
    weight: f32,
    out: &mut Frame<R>,
) {
    let normals = Normals::new(frame, camera);
    let share = share_of(frame, weight);
    let mut grads = vec![Vec3::zero(R::of(0.0)); normals.units.len()];
    for (pixel, [before, after], line) in normals.lines() {
        let slope = bending_vjp(&line, normals.view_dir(pixel), R::of(weights[pixel]), share);
        grads[before] = grads[before] + slope;
        grads[pixel] = grads[pixel] - (slope + slope);
        grads[after] = grads[after] + slope;
    }
    for (pixel, grad) in grads.into_iter().enumerate() {
        let blended = vector_at(frame, channel::NORMAL, pixel);
        let grad = unit_normal_vjp(blended, mask::<R>(is_surface(frame, pixel)), grad);
        for (c, number) in grad.to_array().into_iter().enumerate() {
            let slot = &mut out.values[(channel::NORMAL + c) * frame.pixel_count() + pixel];
            *slot = *slot + number;
        }
    }
}

/// Weight of one line.
fn share_of<R: Number>(frame: &Frame<R>, weight: f32) -> R {
    R::of(f64::from(weight) / (REACHES.len() * frame.pixel_count()) as f64)
}
