//! Rasteriser: columns to pictures, and cotangents of pictures to gradients of columns.

use crate::{
    cloud::{add_rows, check, from_columns, layout_of},
    error::{InputError, RasterizeError},
    inputs::{
        Colors, Cotangents, DepthMode, Images, InputGradients, Inputs, Options, PinholeView, ViewGradients, radii_of,
    },
};
use specula_core::{
    camera::{Camera, CameraGrad},
    double::Double,
    executor::{OnScreen, ReadBack},
    pipeline::{Gradients, Tape, render_and_camera_vjp, render_colors_taped, render_taped, render_vjp},
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules, channel},
    scene::{Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT},
    shade::ShadingRules,
    splat::SplatGrad,
    vector::Vec3,
};

/// Channels of a colour.
const RGB: usize = 3;
/// Least alpha that an expected depth is divided by.
const ALPHA_MIN: f32 = 1e-10;
/// Largest edge of a picture, in pixels.
const EDGE_MAX: u32 = 1 << 16;

/// Result of the rasteriser on an executor.
pub type RasterizeResult<T, E> = Result<T, RasterizeError<<E as specula_core::executor::Renderer>::Error>>;

/// Differentiable rasteriser of Gaussians on an executor.
///
/// The crate lists its [conventions](crate#conventions). Equal inputs give equal bits, on a CPU for
/// any number of threads.
#[derive(Debug)]
pub struct Rasterizer<E> {
    exec: E,
    options: Options,
}

/// State of a forward pass that its gradient reads.
pub struct Context<E: ReadBack> {
    options: Options,
    layout: Layout,
    has_harmonics: bool,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    /// Gaussians of all views, except those with a cloud of their own.
    gaussians: Gaussians<E::Array>,
    views: Vec<ViewContext<E>>,
}

/// State of one view.
struct ViewContext<E: ReadBack> {
    tape: Tape<E>,
    background: [f32; 3],
    /// Gaussians without those that this view leaves out, if there are any.
    kept: Option<Gaussians<E::Array>>,
    alpha: Vec<f32>,
    /// Σ w z, if depth is expected.
    accumulated: Vec<f32>,
    /// Opacities of the splats, if they are compensated.
    splat_opacities: Vec<f32>,
}

impl<E: ReadBack> core::fmt::Debug for Context<E> {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (gaussians, views) = (self.scales.len(), self.views.len());
        out.debug_struct("Context").field("gaussians", &gaussians).field("views", &views).finish_non_exhaustive()
    }
}

#[cfg(feature = "cpu")]
impl Rasterizer<specula_cpu::CpuExecutor> {
    /// Rasteriser on the threads of rayon's current pool.
    pub fn new(options: Options) -> Self {
        Self::on(specula_cpu::CpuExecutor::new(), options)
    }
}

impl<E: ReadBack> Rasterizer<E> {
    /// Rasteriser on an executor.
    pub const fn on(exec: E, options: Options) -> Self {
        Self { exec, options }
    }
    /// Settings of the next forward pass.
    pub const fn options(&self) -> &Options {
        &self.options
    }
    /// Sets the settings of the next forward pass; earlier contexts keep theirs.
    pub const fn set_options(&mut self, options: Options) {
        self.options = options;
    }

    /// Pictures of Gaussians in each view, and the context of their gradient.
    ///
    /// # Errors
    ///
    /// [`InputError`] names what is out of range, and where; otherwise the error of the executor.
    pub fn forward(
        &mut self,
        inputs: &Inputs<'_>,
        views: &[PinholeView],
    ) -> RasterizeResult<(Vec<Images>, Context<E>), E> {
        check(inputs)?;
        self.options.check_ranges()?;
        let layout = layout_of(inputs, self.options.low_pass()?)?;
        let cameras = views.iter().enumerate().map(|(index, view)| camera_of(index, view, &self.options));
        let cameras = cameras.collect::<Result<Vec<Camera>, InputError>>()?;
        let cloud = from_columns(inputs, layout);
        let gaussians = self.exec.upload_gaussians(&cloud).map_err(RasterizeError::Executor)?;
        let mut context = Context {
            options: self.options,
            layout,
            has_harmonics: matches!(inputs.colors, Colors::Harmonics { .. }),
            scales: inputs.scales.to_vec(),
            opacities: inputs.opacities.to_vec(),
            gaussians,
            views: Vec::with_capacity(views.len()),
        };
        let mut images = Vec::with_capacity(views.len());
        for (view, camera) in views.iter().zip(&cameras) {
            let (picture, view) = self
                .forward_view(inputs, &cloud, &context.gaussians, camera, view.background)
                .map_err(RasterizeError::Executor)?;
            images.push(picture);
            context.views.push(view);
        }
        Ok((images, context))
    }

    fn forward_view(
        &mut self,
        inputs: &Inputs<'_>,
        cloud: &Gaussians<Vec<f32>>,
        gaussians: &Gaussians<E::Array>,
        camera: &Camera,
        background: [f32; 3],
    ) -> Result<(Images, ViewContext<E>), E::Error> {
        let Self { exec, options } = self;
        let mut left_out = beyond(cloud, camera, options.far);
        if options.radius_clip > 0.0 {
            left_out.extend(small(exec, gaussians, camera, options.radius_clip)?);
        }
        let kept = match left_out.is_empty() {
            true => None,
            false => Some(exec.upload_gaussians(&without(cloud, &left_out))?),
        };
        let drawn = kept.as_ref().unwrap_or(gaussians);
        let tape = match inputs.colors {
            Colors::Rgb(rgb) => render_colors_taped(exec, drawn, rgb, camera, &rules(options, None))?,
            Colors::Harmonics { degree, .. } => {
                render_taped(exec, drawn, None, None, camera, &rules(options, Some(degree)))?
            }
        };
        let mut splats = vec![OnScreen::default(); cloud.count];
        exec.read_splats(&tape.splats, &mut splats)?;

        let [width, height] = [camera.width as usize, camera.height as usize];
        let size = width * height;
        let channels = tape.rules.channels.count();
        let mut planes = vec![0.0; (channels + 1) * size];
        exec.read_frame(&tape.frame, &mut planes)?;
        let transmittance = &planes[channels * size..];
        let mut rgb = vec![0.0; RGB * size];
        for (pixel, rgb) in rgb.as_chunks_mut::<RGB>().0.iter_mut().enumerate() {
            for c in 0..RGB {
                rgb[c] = planes[c * size + pixel] + transmittance[pixel] * background[c];
            }
        }
        let alpha: Vec<f32> = transmittance.iter().map(|passed| 1.0 - passed).collect();
        let accumulated = match tape.rules.channels.index_of(channel::DEPTH) {
            Some(plane) => planes[plane * size..(plane + 1) * size].to_vec(),
            None => Vec::new(),
        };
        let (depth, accumulated) = match options.depth {
            DepthMode::Expected => {
                let expected = accumulated.iter().zip(&alpha).map(|(depth, alpha)| depth / alpha.max(ALPHA_MIN));
                (expected.collect(), accumulated)
            }
            DepthMode::None | DepthMode::Accumulated => (accumulated, Vec::new()),
        };
        let is_compensated = cloud.layout.low_pass.is_compensated();
        let splat_opacities =
            if is_compensated { splats.iter().map(|splat| splat.opacity).collect() } else { Vec::new() };
        let view = ViewContext { tape, background, kept, alpha: alpha.clone(), accumulated, splat_opacities };
        Ok((Images { width, height, rgb, alpha, depth, splats }, view))
    }

    /// Gradients of a loss from its cotangents with respect to the pictures of a forward pass, one
    /// for each view.
    ///
    /// # Errors
    ///
    /// [`InputError`], where cotangents do not have the lengths of their pictures; otherwise the
    /// error of the executor, such as one that has no gradient of view matrices.
    pub fn backward(
        &mut self,
        context: &Context<E>,
        cotangents: &[Cotangents<'_>],
    ) -> RasterizeResult<InputGradients, E> {
        let (expected, found) = (context.views.len(), cotangents.len());
        if expected != found {
            return Err(InputError::Cotangents { expected, found }.into());
        }
        for (index, (view, cotangents)) in context.views.iter().zip(cotangents).enumerate() {
            view.check(index, cotangents, context.options.depth)?;
        }
        let count = context.scales.len();
        let colors = if context.has_harmonics { count * context.layout.sh_count() } else { count };
        let mut gradients = InputGradients {
            means: vec![[0.0; 3]; count],
            quats: vec![[0.0; 4]; count],
            scales: vec![[0.0; 3]; count],
            opacities: vec![0.0; count],
            colors: vec![[0.0; 3]; colors],
            views: Vec::with_capacity(expected),
        };
        for (view, cotangents) in context.views.iter().zip(cotangents) {
            let view =
                self.backward_view(context, view, cotangents, &mut gradients).map_err(RasterizeError::Executor)?;
            gradients.views.push(view);
        }
        Ok(gradients)
    }

    /// Adds the gradients of one view, and returns those of the view itself.
    fn backward_view(
        &mut self,
        context: &Context<E>,
        view: &ViewContext<E>,
        cotangents: &Cotangents<'_>,
        sums: &mut InputGradients,
    ) -> Result<ViewGradients, E::Error> {
        let exec = &mut self.exec;
        let drawn = view.kept.as_ref().unwrap_or(&context.gaussians);
        let (planes, background) = view.frame_cotangent(cotangents, context.options.depth);
        let cotangent = exec.upload_frame_grad(&view.tape.frame, &planes)?;
        let count = context.scales.len();
        let absolute_means2d = if context.options.absolute_gradients {
            let (Tape { splats, colors, tiles, frame, .. }, mut sums) = (&view.tape, vec![[0.0; 2]; count]);
            exec.read_absolute_center_grads(splats, colors, tiles, frame, &cotangent, &mut sums)?;
            Some(sums)
        } else {
            None
        };
        let (Gradients { gaussians, splats, .. }, camera_grad) = if context.options.view_gradients {
            let (gradients, camera) = render_and_camera_vjp(exec, &view.tape, drawn, None, cotangent)?;
            (gradients, Some(camera))
        } else {
            (render_vjp(exec, &view.tape, drawn, None, cotangent)?, None)
        };

        let mut values = vec![0.0; specula_core::scene::len_of_values(count, context.layout)];
        exec.download(&gaussians.values, &mut values)?;
        let grad = gaussians.with_values(values);
        let scales = context.scales.as_flattened();
        add_rows(sums.means.as_flattened_mut(), 3, &grad, MEAN, |_| 1.0);
        add_rows(sums.quats.as_flattened_mut(), 4, &grad, QUAT, |_| 1.0);
        add_rows(sums.scales.as_flattened_mut(), 3, &grad, LOG_SCALE, |index| scales[index].recip());
        if context.has_harmonics {
            let width = RGB * context.layout.sh_count();
            add_rows(sums.colors.as_flattened_mut(), width, &grad, context.layout.sh_start(), |_| 1.0);
        } else {
            let mut rgb = vec![0.0; RGB * count];
            exec.read_channel_grads(&splats, 0..RGB, &mut rgb)?;
            sums.colors.as_flattened_mut().iter_mut().zip(&rgb).for_each(|(sum, number)| *sum += number);
        }

        let none = SplatGrad { mean2d: [0.0; 2], root_conic: [0.0; 3], depth: 0.0, opacity: 0.0 };
        let mut splat_grads = vec![none; count];
        exec.read_splat_grads(&splats, &mut splat_grads)?;
        for (gaussian, (sum, splat)) in sums.opacities.iter_mut().zip(&splat_grads).enumerate() {
            *sum += splat.opacity * view.compensation(gaussian, context.opacities[gaussian]);
        }
        Ok(ViewGradients {
            means2d: splat_grads.iter().map(|splat| splat.mean2d).collect(),
            absolute_means2d,
            background,
            view_matrix: camera_grad.map(|grad| view_matrix(&grad, &view.tape.camera)),
        })
    }
}

impl<E: ReadBack> ViewContext<E> {
    fn check(&self, view: usize, cotangents: &Cotangents<'_>, depth: DepthMode) -> Result<(), InputError> {
        let size = self.alpha.len();
        let depth_len = if depth == DepthMode::None { 0 } else { size };
        let images = [
            ("rgb", RGB * size, cotangents.rgb.len()),
            ("alpha", size, cotangents.alpha.len()),
            ("depth", depth_len, cotangents.depth.len()),
        ];
        match images.into_iter().find(|(_, expected, found)| *found != 0 && found != expected) {
            Some((image, expected, found)) => Err(InputError::CotangentLength { view, image, expected, found }),
            None => Ok(()),
        }
    }

    /// Planes of the cotangent of the frame, and the gradient of the background.
    fn frame_cotangent(&self, cotangents: &Cotangents<'_>, depth: DepthMode) -> (Vec<f32>, [f32; 3]) {
        let (size, channels) = (self.alpha.len(), self.tape.rules.channels.count());
        let mut planes = vec![0.0; (channels + 1) * size];
        let (colors, rest) = planes.split_at_mut(RGB * size);
        let (layers, grad_transmittance) = rest.split_at_mut((channels - RGB) * size);
        let mut background = [0.0_f64; RGB];
        for (pixel, grad) in cotangents.rgb.as_chunks::<RGB>().0.iter().enumerate() {
            let transmittance = 1.0 - self.alpha[pixel];
            for c in 0..RGB {
                colors[c * size + pixel] = grad[c];
                grad_transmittance[pixel] += grad[c] * self.background[c];
                background[c] += f64::from(grad[c] * transmittance);
            }
        }
        grad_transmittance.iter_mut().zip(cotangents.alpha).for_each(|(sum, grad)| *sum -= grad);
        if let Some(plane) = self.tape.rules.channels.index_of(channel::DEPTH) {
            let grad_depth = &mut layers[(plane - RGB) * size..(plane - RGB + 1) * size];
            for (pixel, grad) in cotangents.depth.iter().enumerate() {
                grad_depth[pixel] = match depth {
                    DepthMode::Expected if self.alpha[pixel] > ALPHA_MIN => {
                        let grad = grad / self.alpha[pixel];
                        grad_transmittance[pixel] += grad * self.accumulated[pixel] / self.alpha[pixel];
                        grad
                    }
                    DepthMode::Expected => grad / ALPHA_MIN,
                    DepthMode::None | DepthMode::Accumulated => *grad,
                };
            }
        }
        (planes, background.map(|sum| sum as f32))
    }

    /// Factor of a Gaussian's opacity by the compensation of its low-pass.
    fn compensation(&self, gaussian: usize, opacity: f32) -> f32 {
        match self.splat_opacities.get(gaussian) {
            Some(splat) if opacity > 0.0 => splat / opacity,
            _ => 1.0,
        }
    }
}

/// Rules of plain Gaussians: their colours, and their depths if they are wanted.
fn rules(options: &Options, sh_degree: Option<u8>) -> RenderRules {
    let channels = if options.depth == DepthMode::None { Channels::Color } else { Channels::Training };
    let full = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, channels);
    RenderRules { sh_degree, is_lit: false, ..full }
}

fn camera_of(index: usize, view: &PinholeView, options: &Options) -> Result<Camera, InputError> {
    let PinholeView { width, height, .. } = *view;
    if !(1..=EDGE_MAX).contains(&width) || !(1..=EDGE_MAX).contains(&height) {
        return Err(InputError::Size { view: index, width, height });
    }
    if !view.background.iter().all(|x| x.is_finite()) {
        return Err(InputError::Background { view: index });
    }
    match Camera::from_matrices(&view.view_matrix, &view.intrinsics, width, height) {
        Ok(camera) => Ok(Camera { near: options.near, ..camera }),
        Err(error) => Err(InputError::Camera { view: index, error }),
    }
}

/// Gaussians beyond the far plane.
fn beyond(cloud: &Gaussians<Vec<f32>>, camera: &Camera, far: f32) -> Vec<usize> {
    let lifted = camera.lift(0.0_f32);
    let is_far = |gaussian: &usize| {
        let [x, y, z] = cloud.get::<3>(*gaussian, MEAN);
        lifted.to_camera(Vec3 { x, y, z }).z > far
    };
    (0..cloud.count).filter(is_far).collect()
}

/// Gaussians whose radii are both at most a limit.
fn small<E: ReadBack>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    camera: &Camera,
    limit: f32,
) -> Result<Vec<usize>, E::Error> {
    let splats = exec.project(gaussians, camera)?;
    let mut on_screen = vec![OnScreen::default(); gaussians.count];
    exec.read_splats(&splats, &mut on_screen)?;
    let size = [camera.width as f32, camera.height as f32];
    let is_small = |splat: &OnScreen| radii_of(splat, size).iter().all(|radius| *radius as f32 <= limit);
    Ok((0..gaussians.count).filter(|gaussian| is_small(&on_screen[*gaussian])).collect())
}

/// The cloud with Gaussians left out: the logits of their opacities are not finite, so that they
/// are not drawn and have no gradient.
fn without(cloud: &Gaussians<Vec<f32>>, left_out: &[usize]) -> Gaussians<Vec<f32>> {
    let mut kept = cloud.clone();
    left_out.iter().for_each(|gaussian| kept.set(*gaussian, OPACITY, [f32::NEG_INFINITY]));
    kept
}

fn view_matrix(grad: &CameraGrad<Double>, camera: &Camera) -> [[f32; 4]; 4] {
    let (rotation, translation) = grad.view_matrix(&camera.lift(Double(0.0)));
    let row = |k: usize| {
        let [x, y, z] = rotation.rows[k].to_array();
        [x, y, z, translation.to_array()[k]].map(|number| number.0 as f32)
    };
    [row(0), row(1), row(2), [0.0; 4]]
}
