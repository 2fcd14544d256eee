//! Frames for engines: behind the engine's depth buffer, in the engine's memory.

use crate::{SceneError, SceneRenderer};
use half::f16;
use rayon::prelude::*;
use specula_core::{
    camera::{Camera, Scissor},
    color::linear_from_srgb,
    metrics::quantize,
    occlusion::{DepthRange, is_hidden},
    rules::{Channels, RenderRules, channel},
    scene::Image,
};
use std::borrow::Cow;

/// View for an engine.
#[derive(Clone, Copy, Debug)]
pub struct FrameRequest<'a> {
    camera: Camera,
    slot: usize,
    surfaces: Option<Surfaces<'a>>,
    has_median_depths: bool,
}

/// Depths of the engine's opaque surfaces, one number for each pixel of the picture, row by row.
#[derive(Clone, Copy, Debug)]
pub enum Surfaces<'a> {
    /// z in camera space, in units of the scene; infinite where there is no surface.
    Depths(&'a [f32]),
    /// Values of a depth buffer.
    Buffer(&'a [f32], DepthRange),
}

impl Surfaces<'_> {
    fn depths(&self) -> Cow<'_, [f32]> {
        match *self {
            Self::Depths(depths) => Cow::Borrowed(depths),
            Self::Buffer(values, range) => values.par_iter().map(|value| range.depth(*value)).collect(),
        }
    }
}

impl<'a> FrameRequest<'a> {
    /// View under the light of its camera ([`Camera::light`]), in front of everything.
    pub fn new(camera: &Camera) -> Self {
        Self { camera: *camera, slot: camera.light as usize, surfaces: None, has_median_depths: false }
    }

    /// Selects the light of another slot ([`SceneRenderer::set_light`]).
    #[must_use]
    pub fn under(self, slot: usize) -> Self {
        Self { slot, ..self }
    }

    /// Hides splats behind the surfaces of the engine. A splat is hidden in a pixel if its mean is
    /// not in front of the surface ([`mod@specula_core::occlusion`]).
    #[must_use]
    pub fn behind(self, surfaces: Surfaces<'a>) -> Self {
        Self { surfaces: Some(surfaces), ..self }
    }

    /// Selects median instead of mean depths: that of the splat behind which half of the light or
    /// less passes, which is never between two surfaces. They take a pass of their own.
    #[must_use]
    pub fn with_median_depths(self) -> Self {
        Self { has_median_depths: true, ..self }
    }

    /// Renders and writes only a part of the picture; it has the bits of the whole picture.
    #[must_use]
    pub fn within(self, scissor: Scissor) -> Self {
        Self { camera: Camera { scissor: Some(scissor), ..self.camera }, ..self }
    }
}

/// Picture in the engine's memory: red, green, blue and alpha of each pixel, row by row from the
/// top, `stride` numbers from one row to the next.
#[derive(Debug)]
pub enum Target<'a> {
    /// sRGB colours in bytes, with linear alpha.
    Rgba8(&'a mut [u8], usize),
    /// Linear colours in halves.
    Rgba16Float(&'a mut [f16], usize),
    /// Linear colours.
    Rgba32Float(&'a mut [f32], usize),
}

/// Background of the splats of a frame. Colours are mixed in the encoding of the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Behind {
    /// Contents of the target; their alpha becomes α + (1 − α) · alpha.
    Contents,
    /// Nothing: the target gets premultiplied colour and alpha.
    Nothing,
    /// A colour in the encoding of the target; the target becomes opaque.
    Color([f32; 3]),
}

impl SceneRenderer {
    /// Renders a view into an engine's memory. `depth` receives the depth of each pixel of the
    /// picture, row by row: the mean z of its splats in camera space, by their weights, infinite
    /// where there are none; or the median
    /// ([`with_median_depths`](FrameRequest::with_median_depths)), infinite where half of the light
    /// passes. Only pixels of the requested part are written.
    ///
    /// # Errors
    ///
    /// Nothing is written then: [`SceneError::Part`] for a part that is not in the picture;
    /// [`SceneError::FrameMemory`] for memory or surfaces of another size; those of
    /// [`SceneRenderer::render`], and of executors that render nothing behind surfaces.
    pub fn render_into(
        &mut self,
        request: &FrameRequest<'_>,
        target: Target<'_>,
        behind: Behind,
        depth: Option<&mut [f32]>,
    ) -> Result<(), SceneError> {
        let FrameRequest { camera, slot, surfaces, has_median_depths } = request;
        let (width, height) = (camera.width as usize, camera.height as usize);
        let Camera { width: columns, height: rows, .. } = *camera;
        let part = camera.scissor.unwrap_or(Scissor { x: 0, y: 0, width: columns, height: rows });
        if !part.fits(columns, rows) {
            return Err(SceneError::Part { part, width: columns, height: rows });
        }
        target.check(width, height)?;
        if let Some(depth) = &depth {
            check("the buffer of depths", depth.len(), width * height)?;
        }
        // An empty part needs no picture.
        if part.width == 0 || part.height == 0 {
            return Ok(());
        }
        let channels = match self.rules().channels {
            Channels::Color if depth.is_some() && !has_median_depths => Channels::Training,
            channels => channels,
        };
        let rules = RenderRules { channels, ..*self.rules() };
        let surfaces = surfaces.as_ref().map(Surfaces::depths);
        let image = match &surfaces {
            None => self.render_lit(*slot, camera, &rules)?,
            Some(depths) => {
                check("the buffer of surfaces", depths.len(), width * height)?;
                self.backend_mut().render_occluded(*slot, camera, &rules, depths)?
            }
        };
        let Some(depth) = depth else {
            target.write(&image, &part, behind);
            return Ok(());
        };
        if *has_median_depths {
            let medians = self.backend_mut().median_depths(camera, &rules)?;
            // Splats before the surface are the first of all.
            let is_seen = |pixel: usize| surfaces.as_ref().is_none_or(|all| !is_hidden(medians[pixel], all[pixel]));
            pixels_of(&part, width).for_each(|pixel| {
                depth[pixel] = if is_seen(pixel) { medians[pixel] } else { f32::INFINITY };
            });
        } else {
            write_mean_depths(&image, &part, depth);
        }
        target.write(&image, &part, behind);
        Ok(())
    }
}

/// Checks the length of memory.
fn check(what: &'static str, found: usize, expected: usize) -> Result<(), SceneError> {
    if found == expected { Ok(()) } else { Err(SceneError::FrameMemory { what, found, expected }) }
}

/// Channels of a pixel.
const RGBA: usize = 4;

impl Target<'_> {
    /// Checks that the rows of a picture fit.
    fn check(&self, width: usize, height: usize) -> Result<(), SceneError> {
        let (found, stride) = match self {
            Self::Rgba8(pixels, stride) => (pixels.len(), *stride),
            Self::Rgba16Float(pixels, stride) => (pixels.len(), *stride),
            Self::Rgba32Float(pixels, stride) => (pixels.len(), *stride),
        };
        if stride < RGBA * width {
            return Err(SceneError::FrameMemory { what: "a row of the target", found: stride, expected: RGBA * width });
        }
        // The last row may end with the picture.
        let least = height.saturating_sub(1) * stride + RGBA * width;
        if found < least {
            return Err(SceneError::FrameMemory { what: "the target", found, expected: least });
        }
        Ok(())
    }

    /// Writes a part of a picture.
    fn write(self, image: &Image<Vec<f32>>, part: &Scissor, behind: Behind) {
        match self {
            Self::Rgba8(pixels, stride) => {
                write_rows(
                    image,
                    part,
                    |pixel| pixel,
                    behind,
                    pixels,
                    stride,
                    |byte| f32::from(byte) / 255.0,
                    quantize,
                );
            }
            Self::Rgba16Float(pixels, stride) => {
                write_rows(image, part, linear, behind, pixels, stride, f16::to_f32, f16::from_f32);
            }
            Self::Rgba32Float(pixels, stride) => {
                write_rows(image, part, linear, behind, pixels, stride, |number| number, |number| number);
            }
        }
    }
}

/// Premultiplied linear colour and alpha of an sRGB pixel.
fn linear([r, g, b, alpha]: [f32; RGBA]) -> [f32; RGBA] {
    if alpha <= 0.0 {
        return [r, g, b, alpha];
    }
    let [r, g, b] = [r, g, b].map(|premultiplied| linear_from_srgb(premultiplied / alpha) * alpha);
    [r, g, b, alpha]
}

/// Writes a part of a picture to rows of pixels. `encode` turns a premultiplied sRGB pixel into the
/// target's encoding; `number` and `stored` convert its channels.
fn write_rows<T: Copy + Send>(
    image: &Image<Vec<f32>>,
    part: &Scissor,
    encode: impl Fn([f32; RGBA]) -> [f32; RGBA] + Sync,
    behind: Behind,
    pixels: &mut [T],
    stride: usize,
    number: impl Fn(T) -> f32 + Sync,
    stored: impl Fn(f32) -> T + Sync,
) {
    let (first, columns) = (part.x as usize, part.width as usize);
    let planes = [0, 1, 2, image.channels - 1].map(|plane| image.plane(plane));
    let rows = pixels.par_chunks_mut(stride).enumerate().skip(part.y as usize).take(part.height as usize);
    rows.for_each(|(row, pixels)| {
        let start = row * image.width + first;
        let pixels = pixels[RGBA * first..].as_chunks_mut::<RGBA>().0;
        for (index, pixel) in pixels.iter_mut().take(columns).enumerate() {
            let [r, g, b, passed] = planes.map(|plane| plane[start + index]);
            let color = encode([r, g, b, 1.0 - passed]);
            let below = match behind {
                Behind::Contents => pixel.map(&number),
                Behind::Nothing => [0.0; RGBA],
                Behind::Color([r, g, b]) => [r, g, b, 1.0],
            };
            for (channel, out) in pixel.iter_mut().enumerate() {
                *out = stored(color[channel] + passed * below[channel]);
            }
        }
    });
}

/// Pixels of a part of a picture with rows of so many pixels.
fn pixels_of(part: &Scissor, width: usize) -> impl Iterator<Item = usize> {
    let [x, y, columns, rows] = [part.x, part.y, part.width, part.height].map(|number| number as usize);
    (y..y + rows).flat_map(move |row| row * width + x..row * width + x + columns)
}

/// Mean depths of a part of a picture.
fn write_mean_depths(image: &Image<Vec<f32>>, part: &Scissor, depth: &mut [f32]) {
    let (sums, passed) = (image.plane(channel::DEPTH), image.plane(image.channels - 1));
    for pixel in pixels_of(part, image.width) {
        let coverage = 1.0 - passed[pixel];
        depth[pixel] = if coverage > 0.0 { sums[pixel] / coverage } else { f32::INFINITY };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Scene, ShadingModel};
    use glam::Vec3;
    use specula_core::scene::{DIFFUSE, Gaussians, LOG_SCALE, Layout, MEAN, OPACITY, QUAT, len_of_values};
    use specula_cpu::CpuExecutor;

    const WIDTH: usize = 40;
    const HEIGHT: usize = 24;
    const STRIDE: usize = 4 * WIDTH + 8;
    /// A rounding of a colour, and one of its curve.
    const SAME_COLOR: f32 = 1e-5;

    /// Two discs that face the camera, the nearer one on the left.
    fn renderer() -> SceneRenderer {
        let (count, layout) = (2, Layout::radiance(0));
        let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
        for (k, (mean, color)) in [([-0.3, -0.5, 0.0], 1.0), ([0.3, 0.5, 0.0], -1.0)].into_iter().enumerate() {
            gaussians.set(k, MEAN, mean);
            gaussians.set(k, LOG_SCALE, [-1.2, -4.0, -1.2]);
            gaussians.set(k, QUAT, [1.0, 0.0, 0.0, 0.0]);
            gaussians.set(k, OPACITY, [1.0]);
            gaussians.set(k, DIFFUSE, [color, 0.5, -0.5 * color]);
        }
        let scene = Scene::unlit(gaussians, ShadingModel::PAPER);
        scene.renderer(CpuExecutor::new(), Channels::Color).unwrap()
    }

    fn camera() -> Camera {
        Camera::look_at(Vec3::NEG_Y * 3.0, Vec3::ZERO, Vec3::Z, 0.9, WIDTH as u32, HEIGHT as u32)
    }

    fn bytes(renderer: &mut SceneRenderer, request: &FrameRequest<'_>, behind: Behind) -> Vec<u8> {
        let mut pixels = vec![7; STRIDE * HEIGHT];
        renderer.render_into(request, Target::Rgba8(&mut pixels, STRIDE), behind, None).unwrap();
        pixels
    }

    #[test]
    fn bytes_over_a_color_are_those_of_the_picture() {
        let mut renderer = renderer();
        let background = [0.25, 0.5, 0.75];
        let expected = renderer.picture(&camera(), background).unwrap();
        let pixels = bytes(&mut renderer, &FrameRequest::new(&camera()), Behind::Color(background));
        for (row, pixels) in pixels.chunks(STRIDE).enumerate() {
            for (column, pixel) in pixels.chunks_exact(4).take(WIDTH).enumerate() {
                let [r, g, b] = expected.get_pixel(column as u32, row as u32).0;
                assert_eq!(pixel, [r, g, b, 255], "pixel {column}, {row}");
            }
            assert_eq!(pixels[4 * WIDTH..], [7; 8], "what lies between rows is not written");
        }
    }

    #[test]
    fn a_part_has_the_pixels_of_the_whole_and_nothing_else_is_written() {
        let mut renderer = renderer();
        let request = FrameRequest::new(&camera());
        let part = Scissor { x: 9, y: 5, width: 20, height: 13 };
        for behind in [Behind::Nothing, Behind::Contents] {
            let whole = bytes(&mut renderer, &request, behind);
            let partial = bytes(&mut renderer, &request.within(part), behind);
            for (index, (part_byte, whole_byte)) in partial.iter().zip(&whole).enumerate() {
                let (row, column) = (index / STRIDE, index % STRIDE / 4);
                let is_inside = (5..18).contains(&row) && (9..29).contains(&column);
                assert_eq!(*part_byte, if is_inside { *whole_byte } else { 7 }, "byte {index}");
            }
        }
    }

    #[test]
    fn linear_targets_hold_linear_light() {
        let mut renderer = renderer();
        let (image, request) = (renderer.render(&camera()).unwrap(), FrameRequest::new(&camera()));
        let mut pixels = vec![0.5; 4 * WIDTH * HEIGHT];
        let target = Target::Rgba32Float(&mut pixels, 4 * WIDTH);
        renderer.render_into(&request, target, Behind::Contents, None).unwrap();
        let mut halves = vec![f16::from_f32(0.5); 4 * WIDTH * HEIGHT];
        let target = Target::Rgba16Float(&mut halves, 4 * WIDTH);
        renderer.render_into(&request, target, Behind::Contents, None).unwrap();
        for (k, pixel) in pixels.chunks_exact(4).enumerate() {
            let passed = image.plane(3)[k];
            let alpha = 1.0 - passed;
            for c in 0..3 {
                let straight = if alpha > 0.0 { image.plane(c)[k] / alpha } else { 0.0 };
                let expected = linear_from_srgb(straight) * alpha + 0.5 * passed;
                assert!((pixel[c] - expected).abs() < SAME_COLOR, "channel {c} of pixel {k}");
                assert_eq!(halves[4 * k + c], f16::from_f32(pixel[c]), "channel {c} of pixel {k}");
            }
            assert!((pixel[3] - (alpha + 0.5 * passed)).abs() < SAME_COLOR, "alpha of pixel {k}");
        }
    }

    #[test]
    fn a_wall_between_two_discs_hides_the_farther_one() {
        let mut renderer = renderer();
        let camera = camera();
        let open = bytes(&mut renderer, &FrameRequest::new(&camera), Behind::Contents);
        let range = DepthRange::reversed(0.1, 100.0);
        let value = 0.1 / 99.9 * (100.0 / 3.0 - 1.0);
        let walls = [vec![3.0; WIDTH * HEIGHT], vec![value; WIDTH * HEIGHT]];
        let [by_depth, by_value] = [Surfaces::Depths(&walls[0]), Surfaces::Buffer(&walls[1], range)]
            .map(|wall| bytes(&mut renderer, &FrameRequest::new(&camera).behind(wall), Behind::Contents));
        assert!(by_depth == by_value, "the wall is the same");
        let pixel = |pixels: &[u8], column: usize| pixels[STRIDE * (HEIGHT / 2) + 4 * column..][..4].to_vec();
        let (left, right) = (WIDTH / 2 - 14, WIDTH - 8);
        assert_eq!(pixel(&by_depth, left), pixel(&open, left), "the nearer disc is before the wall");
        assert_ne!(pixel(&open, right), [7; 4], "the farther disc is seen without a wall");
        assert_eq!(pixel(&by_depth, right), [7; 4], "and hidden with it");
    }

    #[test]
    fn depths_are_those_of_the_splats_in_sight() {
        let mut renderer = renderer();
        let (mut pixels, mut depth) = (vec![0; 4 * WIDTH * HEIGHT], vec![f32::NAN; WIDTH * HEIGHT]);
        let target = Target::Rgba8(&mut pixels, 4 * WIDTH);
        renderer.render_into(&FrameRequest::new(&camera()), target, Behind::Nothing, Some(&mut depth)).unwrap();
        let at = |column: usize| depth[WIDTH * (HEIGHT / 2) + column];
        assert!((at(WIDTH / 2 - 10) - 2.5).abs() < 1e-4, "{}", at(WIDTH / 2 - 10));
        assert!((at(WIDTH - 8) - 3.5).abs() < 1e-4, "{}", at(WIDTH - 8));
        assert_eq!(depth[0], f32::INFINITY, "nothing is in the corner");
    }

    #[test]
    fn a_median_depth_is_that_of_a_splat_before_the_surface() {
        let mut renderer = renderer();
        let camera = camera();
        let request = FrameRequest::new(&camera).with_median_depths();
        let walls = vec![3.0; WIDTH * HEIGHT];
        let [open, behind_wall] = [request, request.behind(Surfaces::Depths(&walls))].map(|request| {
            let (mut pixels, mut depth) = (vec![0; 4 * WIDTH * HEIGHT], vec![f32::NAN; WIDTH * HEIGHT]);
            let target = Target::Rgba8(&mut pixels, 4 * WIDTH);
            renderer.render_into(&request, target, Behind::Nothing, Some(&mut depth)).unwrap();
            depth
        });
        let at = |depth: &[f32], column: usize| depth[WIDTH * (HEIGHT / 2) + column];
        let (left, right) = (WIDTH / 2 - 5, WIDTH / 2 + 3);
        assert_eq!([at(&open, left), at(&open, right), open[0]], [2.5, 3.5, f32::INFINITY]);
        assert_eq!([at(&behind_wall, left), at(&behind_wall, right)], [2.5, f32::INFINITY]);
    }

    #[test]
    fn memory_and_parts_that_do_not_fit_are_refused() {
        let mut renderer = renderer();
        let request = FrameRequest::new(&camera());
        let error = |renderer: &mut SceneRenderer, request: &FrameRequest<'_>, len: usize, stride: usize| {
            let mut pixels = vec![0; len];
            let target = Target::Rgba8(&mut pixels, stride);
            renderer.render_into(request, target, Behind::Nothing, None).unwrap_err().to_string()
        };
        let all = 4 * WIDTH * HEIGHT;
        let said = error(&mut renderer, &request, all - 1, 4 * WIDTH);
        assert_eq!(said, format!("the target has {} numbers, but needs {all}", all - 1));
        let said = error(&mut renderer, &request, all, 4 * WIDTH - 1);
        assert!(said.starts_with("a row of the target has"), "{said}");
        let short = vec![1.0; 3];
        let said = error(&mut renderer, &request.behind(Surfaces::Depths(&short)), all, 4 * WIDTH);
        assert!(said.starts_with("the buffer of surfaces has 3"), "{said}");
        let part = Scissor { x: 30, y: 0, width: 11, height: 1 };
        let said = error(&mut renderer, &request.within(part), all, 4 * WIDTH);
        assert!(said.contains("is not in a picture of 40 × 24 pixels"), "{said}");
    }
}
