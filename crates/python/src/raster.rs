//! Differentiable rasterisation of arrays.

use crate::{
    arrays::{Floats, array, rows},
    errors::{Failure, Result},
    threads::{try_compute, try_compute_with},
};
use numpy::PyArrayDyn;
use pyo3::{prelude::*, types::PyDict};
use specula_cpu::CpuExecutor;
use specula_kit::{
    Colors, Context, Cotangents, DepthMode, Images, Inputs, Options, PinholeView, RasterizeError, Rasterizer,
    ViewGradients,
};
use std::sync::Mutex;

impl<E: core::error::Error + 'static> From<RasterizeError<E>> for Failure {
    fn from(error: RasterizeError<E>) -> Self {
        match &error {
            RasterizeError::Input(specula_kit::InputError::LowPass { .. }) => Self::unsupported(&error),
            RasterizeError::Input(_) => Self::input(&error),
            RasterizeError::Executor(_) => Self::Named("DeviceError", error.to_string()),
        }
    }
}

/// Channels of a picture: colours, depth, or both.
#[derive(Clone, Copy, Debug)]
struct Mode {
    has_color: bool,
    depth: DepthMode,
}

impl Mode {
    fn of(name: &str) -> Result<Self> {
        let (has_color, depth) = match name {
            "RGB" => (true, DepthMode::None),
            "D" => (false, DepthMode::Accumulated),
            "ED" => (false, DepthMode::Expected),
            "RGB+D" => (true, DepthMode::Accumulated),
            "RGB+ED" => (true, DepthMode::Expected),
            _ => return Err(Failure::unsupported(format!("render_mode {name:?} is not supported"))),
        };
        Ok(Self { has_color, depth })
    }

    fn channels(self) -> usize {
        3 * usize::from(self.has_color) + usize::from(self.depth != DepthMode::None)
    }

    /// Channels of all pictures, pixel by pixel.
    fn pixels(self, images: &mut [Images]) -> Vec<f32> {
        match (self.has_color, self.depth, images) {
            // The only picture is passed on without a copy.
            (true, DepthMode::None, [image]) => core::mem::take(&mut image.rgb),
            (true, DepthMode::None, images) => images.iter().flat_map(|image| &image.rgb).copied().collect(),
            (false, _, images) => images.iter().flat_map(|image| &image.depth).copied().collect(),
            (true, _, images) => {
                let pixel = |([r, g, b], depth): (&[f32; 3], &f32)| [*r, *g, *b, *depth];
                let of = |image: &Images| -> Vec<[f32; 4]> {
                    image.rgb.as_chunks().0.iter().zip(&image.depth).map(pixel).collect()
                };
                images.iter().flat_map(of).collect::<Vec<_>>().into_flattened()
            }
        }
    }

    /// Cotangents of colours and depths from those of one picture, where they are apart.
    fn split(self, pixels: &[f32]) -> Option<(Vec<f32>, Vec<f32>)> {
        let both = self.channels() == 4;
        both.then(|| {
            let pixels = pixels.as_chunks::<4>().0;
            (pixels.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect(), pixels.iter().map(|[.., d]| *d).collect())
        })
    }
}

/// Tape of a rasterisation, for its gradient.
#[pyclass(frozen, module = "specula_gs._core")]
#[derive(Debug)]
pub(crate) struct Tape {
    state: Mutex<(Rasterizer<CpuExecutor>, Context<CpuExecutor>)>,
    mode: Mode,
    /// Number of cameras, rows, pixels in a row.
    shape: [usize; 3],
    count: usize,
}

/// Arrays of a forward pass: pictures, coverages, radii, centres, depths; and its tape.
type Pictures<'py> = (
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<i32>>,
    Bound<'py, PyArrayDyn<f32>>,
    Bound<'py, PyArrayDyn<f32>>,
    Option<Tape>,
);

/// Pictures of Gaussians, and the tape of their gradient if it is wanted. Shapes are checked by the
/// caller, and here no further than memory needs.
#[pyfunction]
#[expect(non_snake_case, reason = "the name of intrinsics in the field")]
pub(crate) fn rasterize<'py>(
    py: Python<'py>,
    means: &Bound<'py, PyAny>,
    quats: &Bound<'py, PyAny>,
    scales: &Bound<'py, PyAny>,
    opacities: &Bound<'py, PyAny>,
    colors: &Bound<'py, PyAny>,
    sh_degree: Option<u8>,
    viewmats: &Bound<'py, PyAny>,
    Ks: &Bound<'py, PyAny>,
    backgrounds: Option<&Bound<'py, PyAny>>,
    width: u32,
    height: u32,
    near: f32,
    far: f32,
    radius_clip: f32,
    eps2d: f32,
    antialiased: bool,
    render_mode: &str,
    is_taped: bool,
    view_gradients: bool,
    absolute_gradients: bool,
) -> PyResult<Pictures<'py>> {
    let mode = Mode::of(render_mode)?;
    let means = Floats::new(means, "means")?.shaped("means", "[N, 3]")?;
    let quats = Floats::new(quats, "quats")?.shaped("quats", "[N, 4]")?;
    let scales = Floats::new(scales, "scales")?.shaped("scales", "[N, 3]")?;
    let opacities = Floats::new(opacities, "opacities")?.shaped("opacities", "[N]")?;
    let colors = Floats::new(colors, "colors")?.shaped("colors", "[N, 3]")?;
    let viewmats = Floats::new(viewmats, "viewmats")?.shaped("viewmats", "[C, 4, 4]")?;
    let intrinsics = Floats::new(Ks, "Ks")?.shaped("Ks", "[C, 3, 3]")?;
    let backgrounds =
        backgrounds.map(|value| Floats::new(value, "backgrounds")?.shaped("backgrounds", "[C, 3]")).transpose()?;
    let views: Vec<PinholeView> = (viewmats.rows::<4>().as_chunks::<4>().0.iter())
        .zip(intrinsics.rows::<3>().as_chunks::<3>().0)
        .enumerate()
        .map(|(index, (view_matrix, intrinsics))| PinholeView {
            view_matrix: *view_matrix,
            intrinsics: *intrinsics,
            width,
            height,
            background: backgrounds.as_ref().and_then(|rows| rows.rows().get(index).copied()).unwrap_or_default(),
        })
        .collect();
    let colors = match sh_degree {
        None => Colors::Rgb(colors.rows()),
        Some(degree) => Colors::Harmonics { degree, coefficients: colors.rows() },
    };
    let inputs = Inputs {
        means: means.rows(),
        quats: quats.rows(),
        scales: scales.rows(),
        opacities: opacities.values(),
        colors,
    };
    let options =
        Options { near, far, radius_clip, eps2d, antialiased, depth: mode.depth, view_gradients, absolute_gradients };
    let shape = [views.len(), height as usize, width as usize];
    let [cameras, height, width] = shape;
    let count = inputs.means.len();
    let drawn = try_compute(py, || {
        let mut rasterizer = Rasterizer::new(options);
        let (mut images, context) = rasterizer.forward(&inputs, &views)?;
        let pixels = mode.pixels(&mut images);
        let splats = images.iter().flat_map(|image| &image.splats);
        let (centers, depths) = splats.map(|splat| (splat.mean2d, splat.depth)).collect::<(Vec<_>, Vec<_>)>();
        let radii: Vec<[i32; 2]> = images.iter().flat_map(Images::radii).collect();
        let alphas = match &mut images[..] {
            [image] => core::mem::take(&mut image.alpha),
            images => images.iter().flat_map(|image| &image.alpha).copied().collect(),
        };
        let tape = is_taped.then(|| Tape { state: Mutex::new((rasterizer, context)), mode, shape, count });
        Ok((pixels, alphas, radii, centers, depths, tape))
    })?;
    let (pixels, alphas, radii, centers, depths, tape) = drawn;
    Ok((
        array(py, pixels, &[cameras, height, width, mode.channels()])?,
        array(py, alphas, &[cameras, height, width, 1])?,
        array(py, radii.into_flattened(), &[cameras, count, 2])?,
        rows(py, centers, &[cameras, count, 2])?,
        array(py, depths, &[cameras, count])?,
        tape,
    ))
}

#[pymethods]
impl Tape {
    /// Gradients of the inputs from those of pictures and coverages; those of view matrices if they
    /// were asked for in the forward pass.
    fn vjp<'py>(
        &self,
        py: Python<'py>,
        grad_colors: Option<&Bound<'py, PyAny>>,
        grad_alphas: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let [cameras, height, width] = self.shape;
        let size = height * width;
        let read = |value: Option<&Bound<'py, PyAny>>, name: &str, channels: usize| -> Result<Option<Floats<'py>>> {
            let Some(value) = value else { return Ok(None) };
            let wanted = [cameras, height, width, channels];
            let floats = Floats::new(value, name)?;
            match floats.shape() == wanted {
                true => Ok(Some(floats)),
                false => Err(Failure::input(format!("{name} has the shape {:?}; use {wanted:?}", floats.shape()))),
            }
        };
        let colors = read(grad_colors, "grad_colors", self.mode.channels())?;
        let alphas = read(grad_alphas, "grad_alphas", 1)?;
        let (colors, alphas) = (colors.as_ref().map(Floats::values), alphas.as_ref().map(Floats::values));
        let mut grads = try_compute_with(py, &self.state, |(rasterizer, context)| {
            let channels = size * self.mode.channels();
            let view_grads = |view: usize| colors.map(|all| &all[view * channels..(view + 1) * channels]);
            let split: Vec<_> =
                (0..cameras).map(|view| view_grads(view).and_then(|one| self.mode.split(one))).collect();
            let cotangents: Vec<Cotangents<'_>> = (split.iter().enumerate())
                .map(|(view, split)| {
                    let whole = view_grads(view).unwrap_or_default();
                    let (rgb, depth): (&[f32], &[f32]) = match (split, self.mode.has_color) {
                        (Some((rgb, depth)), _) => (rgb, depth),
                        (None, true) => (whole, &[]),
                        (None, false) => (&[], whole),
                    };
                    let alpha = alphas.map_or(&[][..], |all| &all[view * size..(view + 1) * size]);
                    Cotangents { rgb, alpha, depth }
                })
                .collect();
            Ok(rasterizer.backward(context, &cotangents)?)
        })?;
        let named = PyDict::new(py);
        let colors = grads.colors.len();
        named.set_item("means", rows(py, grads.means, &[self.count, 3])?)?;
        named.set_item("quats", rows(py, grads.quats, &[self.count, 4])?)?;
        named.set_item("scales", rows(py, grads.scales, &[self.count, 3])?)?;
        named.set_item("opacities", array(py, grads.opacities, &[self.count])?)?;
        named.set_item("colors", rows(py, grads.colors, &[colors, 3])?)?;
        let backgrounds = grads.views.iter().map(|view| view.background).collect();
        named.set_item("backgrounds", rows(py, backgrounds, &[cameras, 3])?)?;
        let matrices: Option<Vec<[[f32; 4]; 4]>> = grads.views.iter().map(|view| view.view_matrix).collect();
        if let Some(matrices) = matrices {
            named.set_item("viewmats", rows(py, matrices.into_flattened(), &[cameras, 4, 4])?)?;
        }
        let absolute: Option<Vec<Vec<[f32; 2]>>> =
            grads.views.iter_mut().map(|view| view.absolute_means2d.take()).collect();
        if let Some(absolute) = absolute {
            named
                .set_item("absgrad", rows(py, absolute.into_iter().flatten().collect(), &[cameras, self.count, 2])?)?;
        }
        let centers = grads.views.into_iter().flat_map(|ViewGradients { means2d, .. }| means2d).collect();
        named.set_item("means2d", rows(py, centers, &[cameras, self.count, 2])?)?;
        Ok(named)
    }
}
