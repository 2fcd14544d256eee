//! Metrics of a scene on held-out views.

use crate::view::{Normals, View};
use specula_core::{
    color::linear_from_srgb,
    executor::Renderer,
    expose::{Exposure, IDENTITY, expose},
    least_squares::{LeastSquares, Row, UNKNOWNS_MAX},
    loss::{SSIM_WINDOW, SsimMoments, ssim, ssim_window},
    metrics::{angle_degrees, psnr, quantize},
    pipeline::render,
    rules::{Channels, RenderRules, channel},
    scene::{Gaussians, Image, Layout},
    vector::vec3,
};

/// Metrics of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewQuality {
    /// Name of the view.
    pub name: String,
    /// Peak signal-to-noise ratio in dB of 8-bit pictures.
    pub psnr: f64,
    /// Structural similarity of 8-bit pictures.
    pub ssim: f64,
    /// Mean angle between rendered and ground-truth normals in degrees, over pixels with a
    /// ground-truth normal and an alpha above one half; pixels without a rendered normal count as
    /// 90°.
    pub normal_mae: Option<f64>,
}

/// Means over views; of normals over the views that have them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Mean PSNR in dB.
    pub psnr: f64,
    /// Mean SSIM.
    pub ssim: f64,
    /// Mean normal error in degrees.
    pub normal_mae: Option<f64>,
}

/// Means of the metrics of some views.
pub fn mean_quality(views: &[ViewQuality]) -> Quality {
    let mean = |of: &dyn Fn(&ViewQuality) -> Option<f64>| {
        let values: Vec<f64> = views.iter().filter_map(of).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    Quality {
        psnr: mean(&|view| Some(view.psnr)).unwrap_or(f64::NAN),
        ssim: mean(&|view| Some(view.ssim)).unwrap_or(f64::NAN),
        normal_mae: mean(&|view| view.normal_mae),
    }
}

/// Renders a view into host memory: channels, then transmittance.
///
/// # Errors
///
/// An error of the executor.
pub fn render_view<E: Renderer>(
    exec: &mut E,
    gaussians: &Gaussians<E::Array>,
    light: Option<&E::Light>,
    camera: &specula_core::camera::Camera,
    rules: &RenderRules,
) -> Result<Image<Vec<f32>>, E::Error> {
    let frame = render(exec, gaussians, light, camera, rules)?;
    read_image(exec, &frame, gaussians.layout, camera, rules)
}

/// Reads a frame that was rendered by these rules from Gaussians of a layout.
///
/// # Errors
///
/// Those of the executor.
pub fn read_image<E: Renderer>(
    exec: &mut E,
    frame: &E::Frame,
    layout: Layout,
    camera: &specula_core::camera::Camera,
    rules: &RenderRules,
) -> Result<Image<Vec<f32>>, E::Error> {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let channels = rules.blended(layout).count() + 1;
    let mut values = vec![0.0; channels * width * height];
    exec.read_frame(frame, &mut values)?;
    Ok(Image { width, height, channels, values })
}

/// Composites a rendered image over a background into three planes.
pub fn over_background(image: &Image<Vec<f32>>, background: [f32; 3]) -> Vec<f32> {
    let passed = image.plane(image.channels - 1);
    (0..3)
        .flat_map(|c| image.plane(c).iter().zip(passed).map(move |(color, passed)| color + passed * background[c]))
        .collect()
}

/// Largest difference of two pictures of a view in the channels `asked` and in transmittance.
/// Infinity where a channel is missing, sizes differ or a difference is NaN.
pub fn largest_difference(one: &Image<Vec<f32>>, other: &Image<Vec<f32>>, asked: Channels) -> f32 {
    if [one.width, one.height] != [other.width, other.height] {
        return f32::INFINITY;
    }
    let last = [one, other].map(|image| image.channels - 1);
    let index_in = |count: usize, channel: usize| Channels::with_count(count)?.index_of(channel);
    let asked = (0..Channels::Layers.count()).filter(|channel| asked.index_of(*channel).is_some());
    let difference = asked.map(|channel| match last.map(|count| index_in(count, channel)) {
        [Some(a), Some(b)] => plane_difference(one.plane(a), other.plane(b)),
        _ => f32::INFINITY,
    });
    difference.fold(plane_difference(one.plane(last[0]), other.plane(last[1])), f32::max)
}

fn plane_difference(one: &[f32], other: &[f32]) -> f32 {
    let difference = |(a, b): (&f32, &f32)| if a.to_bits() == b.to_bits() { 0.0 } else { (a - b).abs() };
    one.iter().zip(other).map(difference).fold(0.0, |max, x| if x.is_nan() { f32::INFINITY } else { max.max(x) })
}

/// Rules to render a view for its metrics: normals are included if there is ground truth.
pub fn rules_to_measure(view: &View, rules: &RenderRules) -> RenderRules {
    let channels = if view.normals.is_some() { Channels::Training } else { Channels::Color };
    RenderRules { channels, ..*rules }
}

/// A rendered view with its ground truth for metrics: three sRGB planes each over the same
/// background, black in unknown pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// Pixels in a row.
    pub width: usize,
    /// Rendered picture.
    pub rendered: Vec<f32>,
    /// Ground truth.
    pub truth: Vec<f32>,
    /// Mask of known pixels; `None` if all are known.
    pub known: Option<Vec<bool>>,
}

impl Pair {
    /// Pairs a rendered image with its view.
    pub fn new(image: &Image<Vec<f32>>, view: &View, background: [f32; 3]) -> Self {
        let mut rendered = over_background(image, background);
        let mut truth = view.over(background);
        let known = view.known();
        if let Some(known) = &known {
            blacken(&mut rendered, known);
            blacken(&mut truth, known);
        }
        Self { width: image.width, rendered, truth, known }
    }
}

/// Metrics of a view rendered with [`rules_to_measure`].
pub fn measure_view(image: &Image<Vec<f32>>, view: &View, background: [f32; 3]) -> ViewQuality {
    measure_pair(&Pair::new(image, view, background), image, view)
}

/// Metrics of a paired view.
pub fn measure_pair(pair: &Pair, image: &Image<Vec<f32>>, view: &View) -> ViewQuality {
    let Pair { width, rendered, truth, known } = pair;
    let share = known.as_deref().map_or(1.0, share_of);
    ViewQuality {
        name: view.name.clone(),
        psnr: psnr(mean_squared_error(rendered, truth) / share),
        ssim: ssim_of_known(*width, rendered, truth, known.as_deref()),
        normal_mae: normal_error(image, view),
    }
}

/// PSNR in dB of linear radiance, with white as 1 and no limit above it, for pictures that are
/// linear themselves; `None` for others.
pub fn linear_psnr(image: &Image<Vec<f32>>, view: &View, background: [f32; 3]) -> Option<f64> {
    let truth = view.radiance_over(background)?;
    let mut rendered: Vec<f32> = over_background(image, background).into_iter().map(linear_from_srgb).collect();
    let known = view.known();
    if let Some(known) = &known {
        blacken(&mut rendered, known);
    }
    let square = |(x, y): (&f32, &f32)| (f64::from(*x) - f64::from(*y)).powi(2);
    let mean = rendered.iter().zip(&truth).map(square).sum::<f64>() / truth.len() as f64;
    Some(psnr(mean / known.as_deref().map_or(1.0, share_of)))
}

/// PSNR in dB after fitting an exposure to the ground truth. Photographs of a scene may differ in
/// exposure, which held-out views cannot predict. The fit uses the ground truth, so the value does
/// not measure prediction.
pub fn fitted_psnr(image: &Image<Vec<f32>>, view: &View, background: [f32; 3]) -> f64 {
    let pair = Pair::new(image, view, background);
    let exposed = exposed(image, &fitted_exposure(image, &pair, background));
    let rendered = Pair::new(&exposed, view, background).rendered;
    let share = pair.known.as_deref().map_or(1.0, share_of);
    psnr(mean_squared_error(&rendered, &pair.truth) / share)
}

/// Least-squares fit of the exposure from a rendered picture to its ground truth over known pixels.
/// Undetermined parameters remain at the identity.
fn fitted_exposure(image: &Image<Vec<f32>>, pair: &Pair, background: [f32; 3]) -> Exposure<f32> {
    /// Weight of the identity, in pixels.
    const UNDECIDED: f64 = 1e-3;
    const UNKNOWNS: usize = 4;
    let size = image.pixel_count();
    let mut fit = LeastSquares::new(UNKNOWNS);
    for pixel in (0..size).filter(|pixel| pair.known.as_ref().is_none_or(|known| known[*pixel])) {
        let passed = f64::from(image.plane(image.channels - 1)[pixel]);
        let [r, g, b] = image.rgb(pixel).map(f64::from);
        let behind = |c: usize| passed * f64::from(background[c]);
        let target = [0, 1, 2].map(|c| f64::from(pair.truth[c * size + pixel]) - behind(c));
        fit.add(&row_of([r, g, b, 1.0 - passed]), target, 1.0);
    }
    for k in 0..UNKNOWNS {
        let unit = core::array::from_fn(|other| if other == k { 1.0 } else { 0.0 });
        fit.add(&row_of(unit), IDENTITY.map(|row| f64::from(row[k])), UNDECIDED);
    }
    let columns = fit.solve();
    columns.map_or(IDENTITY, |columns| core::array::from_fn(|c| core::array::from_fn(|k| columns[k][c])))
}

/// Coefficients of an equation, padded with zeros.
fn row_of(numbers: [f64; 4]) -> Row {
    let mut row = [0.0; UNKNOWNS_MAX];
    row[..4].copy_from_slice(&numbers);
    row
}

/// Applies an exposure to a rendered picture.
fn exposed(image: &Image<Vec<f32>>, exposure: &Exposure<f32>) -> Image<Vec<f32>> {
    let mut exposed = image.clone();
    let size = image.pixel_count();
    for pixel in 0..size {
        let [r, g, b] = image.rgb(pixel);
        let coverage = 1.0 - image.plane(image.channels - 1)[pixel];
        let color = expose(exposure, vec3(r, g, b), coverage).to_array();
        color.into_iter().enumerate().for_each(|(c, value)| exposed.values[c * size + pixel] = value);
    }
    exposed
}

/// Sets unknown pixels to black.
fn blacken(planes: &mut [f32], known: &[bool]) {
    let pixels = planes.iter_mut().zip(known.iter().cycle());
    pixels.filter(|(_, known)| !**known).for_each(|(value, _)| *value = 0.0);
}

/// Share of known pixels, counting at least one.
fn share_of(known: &[bool]) -> f64 {
    known.iter().filter(|known| **known).count().max(1) as f64 / known.len() as f64
}

/// Mean squared error of two pictures quantised to 8 bits.
pub fn mean_squared_error(x: &[f32], y: &[f32]) -> f64 {
    let square = |(x, y): (&f32, &f32)| {
        let difference = (f64::from(quantize(*x)) - f64::from(quantize(*y))) / 255.0;
        difference * difference
    };
    x.iter().zip(y).map(square).sum::<f64>() / x.len().max(1) as f64
}

/// Mean angle between rendered and ground-truth normals in degrees, over pixels that are more than
/// half covered; `None` without ground truth or such a pixel.
fn normal_error(image: &Image<Vec<f32>>, view: &View) -> Option<f64> {
    let normals = view.normals.as_ref()?;
    let (mut sum, mut count) = (0.0, 0.0);
    for pixel in (0..image.pixel_count()).filter(|pixel| normals.mask[*pixel] && view.rgba[4 * pixel + 3] > 127) {
        sum += normal_angle(image, normals, pixel);
        count += 1.0;
    }
    (count > 0.0).then(|| sum / count)
}

/// Mean angle between rendered and ground-truth normals in degrees, weighted by the product of
/// rendered and ground-truth opacity (Ref-NeRF, Verbin et al. 2022):
///
/// ```text
/// Σ A α arccos(n·n_gt) / Σ A α
/// ```
///
/// over pixels with a ground-truth normal. `None` without ground truth, or if every weight is zero.
/// Pixels without a rendered surface do not count.
pub fn weighted_normal_error(image: &Image<Vec<f32>>, view: &View) -> Option<f64> {
    let normals = view.normals.as_ref()?;
    let (mut sum, mut weights) = (0.0, 0.0);
    for pixel in (0..image.pixel_count()).filter(|pixel| normals.mask[*pixel]) {
        let opacity = 1.0 - f64::from(image.plane(image.channels - 1)[pixel]);
        let weight = opacity * f64::from(view.rgba[4 * pixel + 3]);
        sum += weight * normal_angle(image, normals, pixel);
        weights += weight;
    }
    (weights > 0.0).then(|| sum / weights)
}

/// Angle between the rendered normal of a pixel and its ground truth in degrees; 90 without a
/// rendered normal.
fn normal_angle(image: &Image<Vec<f32>>, truth: &Normals, pixel: usize) -> f64 {
    const NOTHING_RENDERED: f64 = 90.0;
    let rendered = [0, 1, 2].map(|c| image.plane(channel::NORMAL + c)[pixel]);
    let is_there = rendered.iter().any(|c| c.abs() > 1e-6);
    if is_there { angle_degrees(rendered, truth.values[pixel]) } else { NOTHING_RENDERED }
}

/// Mean SSIM of two pictures of three planes, quantised to 8 bits.
pub fn mean_ssim(width: usize, height: usize, x: &[f32], y: &[f32]) -> f64 {
    assert_eq!(x.len(), 3 * width * height, "three planes are compared");
    ssim_of_known(width, x, y, None)
}

/// Mean SSIM over windows centred on known pixels.
fn ssim_of_known(width: usize, x: &[f32], y: &[f32], known: Option<&[bool]>) -> f64 {
    let size = (x.len() / 3).max(1);
    let share = known.map_or(1.0, share_of);
    let sums = x.chunks(size).zip(y.chunks(size)).map(|(x, y)| ssim_sum(width, x, y, known));
    sums.sum::<f64>() / (x.len().max(1) as f64 * share)
}

fn ssim_sum(width: usize, x: &[f32], y: &[f32], known: Option<&[bool]>) -> f64 {
    let shown = |plane: &[f32]| plane.iter().map(|v| f32::from(quantize(*v)) / 255.0).collect::<Vec<_>>();
    let (x, y) = (shown(x), shown(y));
    let product = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>();
    let maps = [&product(&x, &x), &product(&y, &y), &product(&x, &y), &x, &y].map(|map| blur(width, map));
    let [xx, yy, xy, x, y] = &maps;
    let counted = (0..x.len()).filter(|k| known.is_none_or(|known| known[*k]));
    counted.map(|k| f64::from(ssim(&SsimMoments { x: x[k], y: y[k], xx: xx[k], yy: yy[k], xy: xy[k] }))).sum()
}

/// Convolves a plane with the window of SSIM, zero-padded.
fn blur(width: usize, plane: &[f32]) -> Vec<f32> {
    const REACH: usize = SSIM_WINDOW / 2;
    let window = ssim_window();
    let height = plane.len() / width;
    let mut across = vec![0.0; plane.len()];
    for (row, out) in plane.chunks(width).zip(across.chunks_mut(width)) {
        for (column, out) in out.iter_mut().enumerate() {
            let first = column.saturating_sub(REACH);
            let last = (column + REACH).min(width - 1);
            *out = (first..=last).map(|k| row[k] * window[k + REACH - column]).sum();
        }
    }
    let mut out = vec![0.0; plane.len()];
    for (row, out) in out.chunks_mut(width).enumerate() {
        for k in row.saturating_sub(REACH)..=(row + REACH).min(height - 1) {
            let weight = window[k + REACH - row];
            out.iter_mut().zip(&across[k * width..]).for_each(|(sum, x)| *sum += weight * x);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use specula_core::{
        camera::Camera,
        color::{UNKNOWN, srgb_from_linear},
    };

    #[test]
    fn unknown_pixels_are_not_measured() {
        let (width, height) = (32, 24);
        let camera = Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, width as u32, height as u32);
        let truth = |k: usize| if k % width < 20 { [k as u8, 77, 3, 255] } else { UNKNOWN };
        let rgba = (0..width * height).flat_map(truth).collect();
        let view = View { name: "torn".into(), camera, rgba, unclipped: None, normals: None };
        // Known pixels are one level too bright; unknown ones hold noise, then zeros.
        let image = |elsewhere: fn(usize) -> f32| {
            let shown = |c: usize, k: usize| match view.rgba[4 * k..4 * k + 4] {
                [.., 0] => elsewhere(k),
                ref pixel => (f32::from(pixel[c]) + 1.0).min(255.0) / 255.0,
            };
            let color = (0..3).flat_map(|c| (0..width * height).map(move |k| (c, k)));
            let mut values: Vec<f32> = color.map(|(c, k)| shown(c, k)).collect();
            values.extend(vec![0.0; width * height]);
            Image { width, height, channels: 4, values }
        };
        let [noisy, empty] = [image(|k| (k % 7) as f32 / 7.0), image(|_| 0.0)];
        let [noisy, empty] = [noisy, empty].map(|image| measure_view(&image, &view, [1.0; 3]));
        assert_eq!(noisy, empty);
        let one_level = 20.0 * 255.0_f64.log10();
        assert!((noisy.psnr - one_level).abs() < 0.1, "{} dB", noisy.psnr);
        assert!(noisy.ssim > 0.9, "{}", noisy.ssim);
    }

    #[test]
    fn errors_of_normals_are_averaged_equally_or_by_both_opacities() {
        /// Ground-truth alpha, rendered opacity and rendered normal of a pixel whose true normal is
        /// +x: right; a faint edge, off by 90°; nothing rendered; off by 45°; without ground truth.
        const PIXELS: [(u8, f32, [f32; 3]); 5] = [
            (255, 1.0, [1.0, 0.0, 0.0]),
            (51, 0.5, [0.0, 0.5, 0.0]),
            (255, 0.0, [0.0; 3]),
            (204, 0.25, [0.125, 0.0, 0.125]),
            (255, 1.0, [0.0, 0.0, 1.0]),
        ];
        let (width, height) = (PIXELS.len(), 1);
        let camera = Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, width as u32, height as u32);
        let channels = Channels::Training.count() + 1;
        let mut image = Image { width, height, channels, values: vec![0.0; channels * width] };
        for (pixel, (_, opacity, normal)) in PIXELS.iter().enumerate() {
            let mut set = |plane: usize, value: f32| image.values[plane * width + pixel] = value;
            normal.iter().enumerate().for_each(|(c, value)| set(channel::NORMAL + c, *value));
            set(channels - 1, 1.0 - opacity);
        }
        let mask: Vec<bool> = (0..width).map(|pixel| pixel != 4).collect();
        let values = mask.iter().map(|mask| [f32::from(u8::from(*mask)), 0.0, 0.0]).collect();
        let rgba = PIXELS.iter().flat_map(|(alpha, ..)| [9, 9, 9, *alpha]).collect();
        let view = View { name: "one".into(), camera, rgba, unclipped: None, normals: Some(Normals { values, mask }) };

        let alike = measure_view(&image, &view, [1.0; 3]).normal_mae.unwrap();
        assert!((alike - (0.0 + 90.0 + 45.0) / 3.0).abs() < 1e-6, "{alike}°: the faint edge does not count");
        let weighted = weighted_normal_error(&image, &view).unwrap();
        let expected = (0.2 * 0.5 * 90.0 + 0.8 * 0.25 * 45.0) / (1.0 + 0.2 * 0.5 + 0.8 * 0.25);
        assert!((weighted - expected).abs() < 1e-6, "{weighted}°, not {expected}°: unrendered pixels do not count");

        let unseen = View { rgba: vec![0; 4 * width], ..view.clone() };
        assert_eq!(measure_view(&image, &unseen, [1.0; 3]).normal_mae, None, "no pixel is covered");

        let values = (0..channels * width).map(|k| if k < (channels - 1) * width { 0.0 } else { 1.0 }).collect();
        let empty = Image { values, ..image.clone() };
        assert_eq!(weighted_normal_error(&empty, &view), None, "an empty picture has no weight");
        assert_eq!(weighted_normal_error(&image, &View { normals: None, ..view }), None);
    }

    /// A rendered picture with a soft edge, and a view of it under an exposure.
    fn photographed(exposure: &Exposure<f32>) -> (Image<Vec<f32>>, View) {
        let (width, height) = (24, 16);
        let camera = Camera::look_at(Vec3::X * 4.0, Vec3::ZERO, Vec3::Z, 0.7, width as u32, height as u32);
        let coverage = |k: usize| ((k % width) as f32 / 12.0).min(1.0);
        let color = |c: usize, k: usize| coverage(k) * (0.2 + 0.05 * ((k * (c + 2) + k / width) % 7) as f32);
        let mut values: Vec<f32> = (0..3).flat_map(|c| (0..width * height).map(move |k| color(c, k))).collect();
        values.extend((0..width * height).map(|k| 1.0 - coverage(k)));
        let image = Image { width, height, channels: 4, values };
        let seen = over_background(&exposed(&image, exposure), BACKGROUND);
        let pixel = |k: usize| [0, 1, 2].map(|c| quantize(seen[c * width * height + k]));
        let rgba = (0..width * height).map(pixel).flat_map(|[r, g, b]| [r, g, b, 255]).collect();
        (image, View { name: "one".into(), camera, rgba, unclipped: None, normals: None })
    }

    #[test]
    fn radiance_above_white_is_measured_in_linear_pictures() {
        let (image, view) = photographed(&IDENTITY);
        assert_eq!(linear_psnr(&image, &view, BACKGROUND), None, "8 bits say nothing of it");
        let rendered = over_background(&image, BACKGROUND);
        let size = image.pixel_count();
        // A tenth brighter than rendered, but for the first pixel, which is unknown.
        let truth = |k: usize| {
            let radiance = |c: usize| linear_from_srgb(rendered[c * size + k]) + 0.1;
            [0, 1, 2].map(|c| half::f16::from_f32(srgb_from_linear(radiance(c))))
        };
        let mut view = View { unclipped: Some((0..size).map(truth).collect()), ..view };
        view.rgba[..4].copy_from_slice(&UNKNOWN);
        let found = linear_psnr(&image, &view, BACKGROUND).unwrap();
        assert!((found - 20.0).abs() < 0.02, "{found} dB of an error of 0.1");
        view.unclipped.as_mut().unwrap()[size - 1] = [half::f16::from_f32(srgb_from_linear(10.0)); 3];
        assert!(linear_psnr(&image, &view, BACKGROUND).unwrap() < 8.0, "white is no limit");
    }

    const BACKGROUND: [f32; 3] = [0.9, 0.5, 0.1];

    #[test]
    fn fits_recover_the_exposure_of_a_photograph() {
        /// PSNR in dB of rounding to 8 bits: errors of 0.29 levels.
        const ROUNDED: f64 = 55.0;
        let exposure = [[0.7, 0.1, 0.0, 0.05], [0.05, 0.9, -0.1, 0.1], [0.0, 0.1, 0.8, -0.02]];
        let (image, view) = photographed(&exposure);
        let [plain, fitted] = [measure_view(&image, &view, BACKGROUND).psnr, fitted_psnr(&image, &view, BACKGROUND)];
        assert!(plain < 30.0 && fitted > ROUNDED, "{plain} dB, fitted {fitted}");
        let found = fitted_exposure(&image, &Pair::new(&image, &view, BACKGROUND), BACKGROUND);
        for (found, own) in found.as_flattened().iter().zip(exposure.as_flattened()) {
            assert!((found - own).abs() < 0.01, "{found} is not {own}");
        }
        let (image, view) = photographed(&IDENTITY);
        let [plain, fitted] = [measure_view(&image, &view, BACKGROUND).psnr, fitted_psnr(&image, &view, BACKGROUND)];
        assert!(plain > ROUNDED && fitted > ROUNDED, "{plain} dB, fitted {fitted}");
    }

    #[test]
    fn an_empty_picture_has_no_exposure() {
        let (image, view) = photographed(&IDENTITY);
        let size = image.pixel_count();
        let values = (0..4 * size).map(|k| if k < 3 * size { 0.0 } else { 1.0 }).collect();
        let empty = Image { values, ..image };
        let pair = Pair::new(&empty, &view, BACKGROUND);
        assert_eq!(fitted_exposure(&empty, &pair, BACKGROUND), IDENTITY);
        assert_eq!(fitted_psnr(&empty, &view, BACKGROUND), measure_view(&empty, &view, BACKGROUND).psnr);
    }
}
