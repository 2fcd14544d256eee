//! The gradient of light on the GPU: looked up, pixel by pixel, and through the prefilter.

use specula_core::{
    camera::Camera,
    cubemap::{bilinear, bilinear_weights, footprint, padded_len, project},
    double::Double,
    dual::Dual,
    executor::{Executor, ReadBack, Renderer},
    light_network::{LightNetworkError, WEIGHT_COUNT, WEIGHT_MAX},
    near_field::NearField,
    prefilter::{IRRADIANCE_RESOLUTION, Level, LevelRange, Levels, PrefilterScheme, level_of_roughness},
    random::uniform,
    rules::{Channels, RenderRules, channel},
    scene::{Environment, Gaussians, Image, Layout, RadianceActivation},
    shade::ShadingRules,
    vector::Vec3,
};
use specula_cpu::CpuExecutor;
use specula_gpu::{
    GpuError, GpuExecutor,
    stages::{
        light::formulas::{DirectionVjp, RoughnessVjp, SplitSumVjp, TexelShares, TexelsMean, TexelsVjp},
        light_network::formulas::{
            BoundedNumber, BoundedNumberVjp, BoundedWeight, BoundedWeightVjp, Rectify, RectifyVjp,
        },
        prefilter::formulas::RadianceOf,
        prefilter_vjp::formulas::RadianceVjp,
    },
};
use specula_tests::{
    compare::{assert_all_close, assert_close, relative_difference},
    derivative::pull_back,
    device::{executor, executor_with_arrays_of},
    formulas::{assert_every_formula_has_a_case, assert_same, camera, side_by_side, uniform_rows},
    near_fields::{polished, random_near_field},
    number::{Number, vector},
    plain,
    strategies::{random_cloud, random_environment, under_turned_light},
};

/// Sums of some thousand products, each executor's in its own order, as a share of the largest.
const SAME_SUM: f64 = 1e-6;
/// Gradients of looking light up, as a share of their root mean square and of themselves: they are
/// differences of texels, and the irradiance changes by less than a hundredth of itself from one to
/// the next.
const SAME_SLOPE: f64 = 2e-4;
/// A gradient of a pixel, as a share of its plane's root mean square and of itself: it divides by
/// the coverage and by the length of a mean normal, so roundings of the blended values count more
/// where either is small.
const SAME_PIXEL: f64 = 1e-3;
/// Share of the pixels that may be further apart. The slope of a bilinear mean jumps from texel to
/// texel, so directions next to a border fall to either side.
const ON_A_BORDER: f64 = 0.003;
/// A light's gradient from a picture, root mean square: that of pixels, of which none counts for
/// much.
const SAME_LIGHT_GRAD: f64 = 1e-4;

#[test]
fn every_formula_is_on_the_device_what_it_is_on_the_host() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    let signed = [-1.0, 1.0];
    assert_same(gpu, &TexelShares, &uniform_rows(1, &[[0.0, 1.0]; 2]));
    let texels = uniform_rows(2, &[[0.0, 2.0]; 12]);
    let places = uniform_rows(3, &[[0.0, 1.0], [0.0, 1.0], [16.0, 16.0], signed, signed, signed]);
    let between = uniform_rows(3, &[[0.0, 1.0]; 2]);
    assert_same(gpu, &TexelsMean, &side_by_side(&texels, &between));
    assert_same(gpu, &TexelsVjp, &side_by_side(&texels, &places));
    assert_same(gpu, &SplitSumVjp, &uniform_rows(17, &[[0.0, 1.0]; 12]));
    assert_same(gpu, &DirectionVjp, &uniform_rows(4, &[[-1.0, -0.1], [0.2, 0.8], signed, signed, signed]));
    for (scheme, resolution) in [(PrefilterScheme::Exact, 64), (PrefilterScheme::Official, 64)] {
        let levels = Levels::new(scheme, resolution).as_slice().to_vec();
        let bounds = [[0.0, 1.0], [0.0, 2.0], [0.0, 2.0], [0.0, 2.0], [0.0, 2.0], [0.0, 2.0], [0.0, 2.0]];
        let grads = uniform_rows(6, &[signed; 3]);
        assert_same(gpu, &RoughnessVjp { levels }, &side_by_side(&uniform_rows(5, &bounds), &grads));
    }
    for activation in [RadianceActivation::Identity, RadianceActivation::Exponential, RadianceActivation::Network] {
        assert_same(gpu, &RadianceOf { activation }, &uniform_rows(11, &[[-6.0, 3.0]]));
        assert_same(gpu, &RadianceVjp { activation }, &uniform_rows(12, &[[0.0, 20.0], [-1.0, 1.0]]));
    }
    for bound in [1.0, 3.0 * WEIGHT_MAX] {
        let (numbers, rows) = ([-bound, bound], uniform_rows(13, &[[-bound, bound], signed]));
        assert_same(gpu, &BoundedWeight, &uniform_rows(14, &[numbers]));
        assert_same(gpu, &BoundedWeightVjp, &rows);
        assert_same(gpu, &BoundedNumber, &uniform_rows(15, &[numbers]));
        assert_same(gpu, &BoundedNumberVjp, &rows);
        assert_same(gpu, &Rectify, &uniform_rows(16, &[numbers]));
        assert_same(gpu, &RectifyVjp, &rows);
    }
}

#[test]
fn no_formula_is_left_out() {
    let formulas = [
        include_str!("../../../exec-gpu/src/stages/light/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/light_network/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/prefilter/formulas.rs"),
        include_str!("../../../exec-gpu/src/stages/prefilter_vjp/formulas.rs"),
    ];
    // The lookup itself has its cases beside those of the other stages.
    let cases = [include_str!("light.rs"), include_str!("stages.rs")].concat();
    assert_every_formula_has_a_case(&formulas, &cases, 15);
}

/// Colours to add to a few texels: of either sign and of any size.
fn colors_to_add(count: usize) -> (Vec<u32>, Vec<[f32; 4]>) {
    let draw = |index: usize, stream: u64| uniform(21, stream, index as u64);
    let number = |index: usize, stream: u64| {
        let size = 10.0_f32.powf(-13.0 + 15.0 * draw(index, stream));
        if draw(index, stream + 3) < 0.5 { size } else { -size }
    };
    let places = (0..count).map(|index| (7.0 * draw(index, 9)) as u32).collect();
    let colors = (0..count).map(|index| [number(index, 0), number(index, 1), number(index, 2), 1.0]).collect();
    (places, colors)
}

fn sums_of(gpu: &mut GpuExecutor, places: &[u32], colors: &[[f32; 4]]) -> Vec<f32> {
    let grad = gpu.add_colors(7, places, colors).expect("colours fit");
    gpu.read_light_grad(&grad).expect("sums can be read")
}

#[test]
fn sums_of_a_light_are_exact_in_any_order() {
    /// Half a step of 2⁻⁵² for each number.
    const STEP: f64 = 1.2e-16;
    let Some(mut gpu) = executor() else { return };
    for count in [0, 1, 10_000] {
        let (mut places, mut colors) = colors_to_add(count);
        let sums = sums_of(&mut gpu, &places, &colors);
        let mut exact = [[0.0_f64; 3]; 7];
        for (place, color) in places.iter().zip(&colors) {
            (0..3).for_each(|c| exact[*place as usize][c] += f64::from(color[c]));
        }
        for (sum, exact) in sums.chunks_exact(4).zip(exact) {
            for c in 0..3 {
                let rounding = 1.5 * f64::from(f32::EPSILON) * exact[c].abs();
                assert_close(f64::from(sum[c]), exact[c], rounding + STEP * count as f64);
            }
            assert_eq!(sum[3], 0.0, "there is no fourth colour");
        }
        places.reverse();
        colors.reverse();
        assert!(sums_of(&mut gpu, &places, &colors) == sums, "the order changes nothing");
    }
}

#[test]
fn sums_of_a_light_hold_the_largest_numbers_and_tell_what_is_none() {
    let Some(mut gpu) = executor() else { return };
    let count = 100_000;
    for size in [1e30, -1e30] {
        let sums = sums_of(&mut gpu, &vec![2; count], &vec![[size; 4]; count]);
        let limited = f64::from(size.signum()) * 262_144.0 * count as f64;
        assert_close(f64::from(sums[8]), limited, 1e-6 * limited.abs());
    }
    let none = [f32::NAN, 1.0, f32::INFINITY, 0.0];
    let less_than_none = [-1.0, f32::NEG_INFINITY, f32::NEG_INFINITY, 0.0];
    let sums = sums_of(&mut gpu, &[3, 3, 3, 4], &[[1.0, 2.0, 3.0, 0.0], none, less_than_none, [0.5; 4]]);
    assert!(sums[12..15].iter().all(|sum| !sum.is_finite()), "what is no number makes the sum none");
    assert_eq!(sums[16..20], [0.5, 0.5, 0.5, 0.0], "other sums stay numbers");
}

/// Offsets of the levels of a light, and of the irradiance map behind them.
struct Maps {
    levels: Vec<Level>,
    /// First texel and resolution.
    places: Vec<(usize, usize)>,
}

impl Maps {
    fn new(scheme: PrefilterScheme, resolution: usize) -> Self {
        let levels = Levels::new(scheme, resolution).as_slice().to_vec();
        let mut resolutions: Vec<usize> = levels.iter().map(|level| level.resolution).collect();
        if scheme == PrefilterScheme::Official {
            resolutions.push(IRRADIANCE_RESOLUTION);
        }
        let mut first = 0;
        let mut next = |resolution| {
            let place = (first, resolution);
            first += padded_len(resolution);
            place
        };
        Self { levels, places: resolutions.into_iter().map(&mut next).collect() }
    }

    /// The four texels of a direction in a map, and its place among them.
    fn corners<R: Number>(&self, direction: Vec3<R>, map: usize) -> ([usize; 4], [R; 2]) {
        let (first, resolution) = self.places[map];
        let place = footprint(&project(direction), R::of(resolution as f64));
        let first = first + place.texel.value() as usize;
        let corners = [first, first + 1, first + resolution + 2, first + resolution + 3];
        (corners, [place.right, place.lower])
    }

    fn in_map<R: Number>(&self, texels: &[f32], direction: Vec3<R>, map: usize) -> Vec3<R> {
        let (corners, [right, lower]) = self.corners(direction, map);
        let texel =
            |first: usize| vector([texels[4 * first], texels[4 * first + 1], texels[4 * first + 2]].map(f64::from));
        bilinear(corners.map(texel), right, lower)
    }

    /// The maps that a roughness lies between, and the share of the second.
    fn between<R: Number>(&self, roughness: R) -> (usize, R) {
        let position = level_of_roughness(roughness, &self.levels);
        let sharp = (position.value().floor() as usize).min(self.levels.len() - 2);
        (sharp, position - R::of(sharp as f64))
    }
}

/// One look at a light: direction, roughness, and the gradient of the radiance.
fn looks(count: usize) -> Vec<[f32; 8]> {
    let draw = |index: usize, k: usize| match k {
        3 => 1.2 * uniform(31, k as u64, index as u64) - 0.1,
        _ => 2.0 * uniform(31, k as u64, index as u64) - 1.0,
    };
    (0..count).map(|index| core::array::from_fn(|k| draw(index, k))).collect()
}

/// Gradient of a light lookup with respect to direction and roughness; adds that of the texels.
fn look_vjp(maps: &Maps, texels: &[f32], look: &[f32; 8], is_irradiance: bool, texel_grads: &mut [f64]) -> Vec<f64> {
    let numbers = look.map(f64::from);
    let seen = |input: &[Dual]| {
        let direction = Vec3 { x: input[0], y: input[1], z: input[2] };
        if is_irradiance {
            return maps.in_map(texels, direction, maps.levels.len()).to_array().to_vec();
        }
        let (sharp, share) = maps.between(input[3]);
        let [near, far] = [sharp, sharp + 1].map(|map| maps.in_map(texels, direction, map));
        near.add_scaled(share, far - near).to_array().to_vec()
    };
    let (sharp, share) = maps.between(Double(numbers[3]));
    let shares =
        if is_irradiance { vec![(maps.levels.len(), 1.0)] } else { vec![(sharp, 1.0 - share.0), (sharp + 1, share.0)] };
    for (map, share) in shares {
        let (corners, [right, lower]) = maps.corners(vector::<Double>([numbers[0], numbers[1], numbers[2]]), map);
        for (corner, weight) in corners.into_iter().zip(bilinear_weights(right, lower)) {
            (0..3).for_each(|c| texel_grads[4 * corner + c] += share * weight.0 * numbers[4 + c]);
        }
    }
    pull_back(seen, &numbers[..4], &numbers[4..7])
}

const SCHEMES: [(PrefilterScheme, usize); 3] =
    [(PrefilterScheme::Exact, 16), (PrefilterScheme::Exact, 64), (PrefilterScheme::Official, 64)];

fn to_f64(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

fn upload<E: Renderer>(exec: &mut E, environment: &Environment<Vec<f32>>) -> Environment<E::Array> {
    let Environment { resolution, activation, values } = environment;
    let values = exec.upload(values).expect("texels fit");
    Environment { resolution: *resolution, activation: *activation, values }
}

fn light_of<E: Renderer>(exec: &mut E, environment: &Environment<Vec<f32>>, scheme: PrefilterScheme) -> E::Light {
    let environment = upload(exec, environment);
    exec.prefilter(&environment, scheme, LevelRange::ALL).expect("the resolution is allowed")
}

#[test]
fn gradients_of_looking_light_up_are_derivatives() {
    let Some(mut gpu) = executor() else { return };
    for (scheme, resolution) in SCHEMES {
        let environment = random_environment(resolution, RadianceActivation::Identity, 4);
        let light = light_of(&mut gpu, &environment, scheme);
        let texels = gpu.read_light(&light).expect("a light can be read");
        let maps = Maps::new(scheme, resolution);
        for is_irradiance in [false, true] {
            if is_irradiance && scheme == PrefilterScheme::Exact {
                continue;
            }
            let looks = looks(2000);
            let (rows, grad) = gpu.look_up_vjp(&light, &looks, is_irradiance).expect("light can be looked up");
            let grad = to_f64(&gpu.read_light_grad(&grad).expect("a gradient can be read"));
            let mut exact_grad = vec![0.0; texels.len()];
            let exact: Vec<f64> =
                looks.iter().flat_map(|look| look_vjp(&maps, &texels, look, is_irradiance, &mut exact_grad)).collect();
            assert_mostly_close(&to_f64(rows.as_flattened()), &exact, SAME_SLOPE, ON_A_BORDER);
            assert_same_grad(&grad, &exact_grad, SAME_LIGHT_GRAD);
        }
    }
}

/// Numbers agree up to `tolerance` times their own size and the root mean square, but for a share
/// of them.
#[track_caller]
fn assert_mostly_close(actual: &[f64], expected: &[f64], tolerance: f64, share: f64) {
    let (far, largest) = far_apart(actual, expected, tolerance);
    assert!(far <= share, "{far} of all numbers are further apart than {tolerance:e}, at most {largest:e}");
}

/// The share of numbers that are further apart than that, and the largest distance of those that
/// are not.
#[track_caller]
fn far_apart(actual: &[f64], expected: &[f64], tolerance: f64) -> (f64, f64) {
    assert_eq!(actual.len(), expected.len(), "lists of different lengths cannot be close");
    let mean = (expected.iter().map(|x| x * x).sum::<f64>() / expected.len().max(1) as f64).sqrt();
    let distances = actual.iter().zip(expected).map(|(a, e)| (a - e).abs() / (mean + e.abs()).max(f64::MIN_POSITIVE));
    let (near, far): (Vec<f64>, Vec<f64>) = distances.partition(|distance| *distance <= tolerance);
    (far.len() as f64 / expected.len().max(1) as f64, near.into_iter().fold(0.0, f64::max))
}

#[test]
#[should_panic(expected = "further apart")]
fn numbers_apart_are_not_mostly_close() {
    assert_mostly_close(&[1.0, 2.1, 3.0], &[1.0, 2.0, 3.0], 0.01, 0.3);
}

#[test]
#[should_panic(expected = "further apart")]
fn nan_is_not_mostly_close() {
    assert_mostly_close(&[1.0, f64::NAN, 3.0], &[1.0, 2.0, 3.0], 0.01, 0.3);
}

/// Root mean square of the difference, as a share of that of the expected numbers; infinite for
/// NaN.
fn difference(actual: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(actual.len(), expected.len(), "lists of different lengths have no difference");
    let squared: f64 = actual.iter().zip(expected).map(|(a, e)| (a - e) * (a - e)).sum();
    let size: f64 = expected.iter().map(|x| x * x).sum::<f64>().max(f64::MIN_POSITIVE);
    if squared.is_nan() { f64::INFINITY } else { (squared / size).sqrt() }
}

#[track_caller]
fn assert_same_grad(actual: &[f64], expected: &[f64], tolerance: f64) {
    let difference = difference(actual, expected);
    assert!(difference <= tolerance, "gradients differ by {difference:e}, allowed are {tolerance:e}");
}

#[test]
#[should_panic(expected = "differ by")]
fn gradients_apart_are_not_the_same() {
    assert_same_grad(&[1.0, 2.001], &[1.0, 2.0], SAME_LIGHT_GRAD);
}

#[test]
#[should_panic(expected = "differ by")]
fn nan_is_not_the_same_gradient() {
    assert_same_grad(&[1.0, f64::NAN], &[1.0, 2.0], SAME_LIGHT_GRAD);
}

/// A scene that is lit pixel by pixel.
struct Scene {
    cloud: Gaussians<Vec<f32>>,
    environment: Environment<Vec<f32>>,
    camera: Camera,
    rules: RenderRules,
    near_field: Option<NearField<Vec<f32>>>,
    seed: u64,
}

/// Gradients of a scene's pixels.
struct Gradient {
    /// Planes of the blended surface, and their gradient.
    blended: Vec<f32>,
    grad: Vec<f64>,
    /// Of the light's texels, and of the environment's numbers.
    light: Vec<f64>,
    environment: Vec<f64>,
}

/// Access to an executor's results.
trait Read: ReadBack {
    fn texels_of(&mut self, grad: &Self::LightGrad) -> Vec<f32>;
}

impl Read for CpuExecutor {
    fn texels_of(&mut self, grad: &Self::LightGrad) -> Vec<f32> {
        grad.texels().as_flattened().to_vec()
    }
}

impl Read for GpuExecutor {
    fn texels_of(&mut self, grad: &Self::LightGrad) -> Vec<f32> {
        self.read_light_grad(grad).expect("a gradient can be read")
    }
}

impl Scene {
    fn new(count: usize, size: [u32; 2], rules: RenderRules, seed: u64) -> Self {
        let activation = match rules.scheme {
            PrefilterScheme::Exact => RadianceActivation::Exponential,
            PrefilterScheme::Official => RadianceActivation::Identity,
        };
        Self {
            cloud: random_cloud(count, Layout::shaded(Some(1)), seed),
            environment: random_environment(rules.scheme.resolution_min(), activation, seed),
            camera: camera(size[0], size[1]),
            rules,
            near_field: None,
            seed,
        }
    }

    /// Physical materials.
    fn physical(channels: Channels, seed: u64) -> Self {
        let rules = RenderRules::full(ShadingRules::PHYSICAL, PrefilterScheme::Exact, channels);
        let scene = Self::new(80, [70, 45], rules, seed);
        Self { cloud: random_cloud(80, Layout::shaded(Some(1)).physical(), seed), ..scene }
    }

    /// Polished Gaussians among triangles.
    fn among_triangles(channels: Channels, seed: u64) -> Self {
        let rules = RenderRules { traces_near: true, ..rules(channels, PrefilterScheme::Exact) };
        let scene = Self::new(80, [70, 45], rules, seed);
        Self { cloud: polished(scene.cloud), near_field: Some(random_near_field(60, seed)), ..scene }
    }

    fn channels(&self) -> Channels {
        self.rules.blended(self.cloud.layout)
    }

    fn pixel_count(&self) -> usize {
        (self.camera.width * self.camera.height) as usize
    }

    /// A gradient for every plane, as small as that of a mean.
    fn grad_of_picture(&self) -> Vec<f32> {
        let size = self.pixel_count();
        let number = |index: usize| (2.0 * uniform(self.seed, 77, index as u64) - 1.0) / size as f32;
        (0..(self.channels().count() + 1) * size).map(number).collect()
    }

    fn gradient<E: Read>(&self, exec: &mut E, grad: &[f32]) -> Gradient {
        let Gaussians { count, layout, values } = &self.cloud;
        let cloud = Gaussians { count: *count, layout: *layout, values: exec.upload(values).expect("numbers fit") };
        let environment = upload(exec, &self.environment);
        let mut light = self.rules.is_lit.then(|| light_of(exec, &self.environment, self.rules.scheme));
        if let Some(near_field) = &self.near_field {
            let near_field = exec.upload_near_field(&near_field.with_values(&near_field.values)).expect("it is whole");
            light = light.map(|light| exec.surround(light, &near_field).expect("the executor traces"));
        }
        let mut splats = exec.project(&cloud, &self.camera).expect("the executor projects");
        let colors = exec.shade(&cloud, &self.camera, &mut splats, light.as_ref(), &self.rules).expect("it shades");
        let tiles = exec.bin(&splats, &self.camera).expect("it sorts");
        let frame = exec.blend(&splats, &colors, &tiles, &self.camera).expect("it blends");
        let mut blended = vec![0.0; grad.len()];
        exec.read_frame(&frame, &mut blended).expect("the frame has that size");
        let frame = match light.as_ref().filter(|_| self.rules.traces_near) {
            Some(light) => exec.trace(frame, light, &self.camera).expect("it traces"),
            None => frame,
        };
        let frame = exec.shade_pixels(frame, light.as_ref(), &self.camera, &self.rules).expect("it shades pixels");
        let grad = exec.upload_frame_grad(&frame, grad).expect("planes fit");
        let (grad, light_grad) =
            exec.shade_pixels_vjp(&frame, light.as_ref(), &self.camera, &self.rules, grad).expect("it goes back");
        let mut planes = vec![0.0; blended.len()];
        exec.read_frame_grad(&frame, &grad, &mut planes).expect("planes can be read");
        let (mut texel_grads, mut environment_grad) = (Vec::new(), Vec::new());
        if let (Some(light), Some(grad)) = (&light, &light_grad) {
            texel_grads = exec.texels_of(grad);
            let grad = exec.prefilter_vjp(&environment, light, grad).expect("it goes back through the prefilter");
            environment_grad = vec![0.0; self.environment.values.len()];
            exec.download(&grad, &mut environment_grad).expect("a gradient can be read");
        }
        assert_eq!(light.is_some(), light_grad.is_some(), "there is a gradient of a light if there is one");
        Gradient { blended, grad: to_f64(&planes), light: to_f64(&texel_grads), environment: to_f64(&environment_grad) }
    }

    /// The pixels that something covers in both pictures.
    fn covered(&self, ours: &Gradient, theirs: &Gradient) -> Vec<usize> {
        let size = self.pixel_count();
        let first = self.channels().count() * size;
        (0..size).filter(|pixel| [ours, theirs].iter().all(|of| of.blended[first + pixel] < 1.0)).collect()
    }
}

/// The gradients of two executors agree.
#[track_caller]
fn assert_same_gradient(scene: &Scene, ours: &Gradient, theirs: &Gradient) {
    let covered = scene.covered(ours, theirs);
    let size = scene.pixel_count();
    for plane in 0..=scene.channels().count() {
        let of =
            |gradient: &Gradient| covered.iter().map(|pixel| gradient.grad[plane * size + pixel]).collect::<Vec<_>>();
        let (far, largest) = far_apart(&of(ours), &of(theirs), SAME_PIXEL);
        println!("  plane {plane}: {far:.4} far apart, others {largest:.1e}");
        assert_mostly_close(&of(ours), &of(theirs), SAME_PIXEL, ON_A_BORDER);
    }
    println!("  light: {:.1e}", difference(&ours.light, &theirs.light));
    println!("  environment: {:.1e}", difference(&ours.environment, &theirs.environment));
    assert_same_grad(&ours.light, &theirs.light, SAME_LIGHT_GRAD);
    assert_same_grad(&ours.environment, &theirs.environment, SAME_LIGHT_GRAD);
}

fn rules(channels: Channels, scheme: PrefilterScheme) -> RenderRules {
    RenderRules::full(ShadingRules::DEFERRED, scheme, channels)
}

#[test]
fn pixels_give_back_what_they_do_on_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let mut scenes = Vec::new();
    for scheme in [PrefilterScheme::Exact, PrefilterScheme::Official] {
        for channels in [Channels::Color, Channels::Training, Channels::Layers] {
            scenes.push(Scene::new(80, [70, 45], rules(channels, scheme), 1));
            let unlit = RenderRules { is_lit: false, ..rules(channels, scheme) };
            scenes.push(Scene::new(80, [70, 45], unlit, 2));
        }
    }
    for (seed, (count, size)) in (3..).zip([(0, [70, 45]), (1, [17, 16]), (200, [1, 1]), (200, [17, 16])]) {
        scenes.push(Scene::new(count, size, rules(Channels::Training, PrefilterScheme::Exact), seed));
    }
    scenes.extend(
        (20..).zip([Channels::Color, Channels::Layers]).map(|(seed, channels)| Scene::among_triangles(channels, seed)),
    );
    for (seed, channels) in (30..).zip([Channels::Color, Channels::Training, Channels::Layers]) {
        let scene = Scene::physical(channels, seed);
        let rules = RenderRules { is_lit: false, ..scene.rules };
        scenes.extend([scene, Scene { rules, ..Scene::physical(channels, seed) }]);
    }
    let traced = RenderRules { traces_near: true, ..Scene::physical(Channels::Training, 40).rules };
    scenes.push(Scene {
        rules: traced,
        near_field: Some(random_near_field(60, 40)),
        ..Scene::physical(Channels::Training, 40)
    });
    for scene in [
        Scene::among_triangles(Channels::Training, 50),
        Scene::physical(Channels::Training, 51),
        Scene::new(80, [70, 45], rules(Channels::Layers, PrefilterScheme::Official), 52),
    ] {
        scenes.push(Scene { camera: under_turned_light(scene.camera), ..scene });
    }
    for scene in scenes {
        println!("{:?}, {:?}, lit {}", scene.channels(), scene.rules.scheme, scene.rules.is_lit);
        let grad = scene.grad_of_picture();
        let (ours, theirs) = (scene.gradient(&mut gpu, &grad), scene.gradient(&mut cpu, &grad));
        assert_same_gradient(&scene, &ours, &theirs);
        let covered = scene.covered(&ours, &ours);
        let is_left = |index: &usize| covered.binary_search(&(index % scene.pixel_count())).is_err();
        let left: Vec<usize> = (0..grad.len()).filter(is_left).collect();
        assert!(left.iter().all(|k| ours.grad[*k] == f64::from(grad[*k])), "what nothing covers is left as it is");
    }
}

#[test]
fn pixels_give_back_what_plain_loops_do() {
    let Some(mut gpu) = executor() else { return };
    gives_back_what_plain_loops_do(
        &mut gpu,
        &Scene::new(80, [70, 45], rules(Channels::Training, PrefilterScheme::Exact), 9),
    );
    gives_back_what_plain_loops_do(&mut gpu, &Scene::among_triangles(Channels::Training, 10));
    gives_back_what_plain_loops_do(&mut gpu, &Scene::physical(Channels::Training, 11));
    let scene = Scene::physical(Channels::Training, 12);
    gives_back_what_plain_loops_do(&mut gpu, &Scene { camera: under_turned_light(scene.camera), ..scene });
}

#[track_caller]
fn gives_back_what_plain_loops_do(gpu: &mut GpuExecutor, scene: &Scene) {
    let grad = scene.grad_of_picture();
    let ours = scene.gradient(gpu, &grad);
    let image = |values: &[f32]| Image {
        width: scene.camera.width as usize,
        height: scene.camera.height as usize,
        channels: scene.channels().count() + 1,
        values: plain::lift::<Double>(values),
    };
    let environment = plain::lift_environment::<Double>(&scene.environment);
    let operator = plain::Operator::new(environment.resolution);
    let mut light = plain::prefilter(&environment, &operator);
    if let Some(near_field) = &scene.near_field {
        light = light.around(near_field.clone());
    }
    let (mut exact, mut light_grad) = (image(&grad), plain::LightGrad::zero(&light));
    plain::shade_pixels_vjp(
        &image(&ours.blended),
        Some(&light),
        &scene.camera,
        &scene.rules,
        &mut exact,
        Some(&mut light_grad),
    );
    let flat = |texel: &Vec3<Double>| [texel.x.0, texel.y.0, texel.z.0, 0.0];
    let exact = Gradient {
        blended: ours.blended.clone(),
        grad: exact.values.iter().map(|x| x.0).collect(),
        light: light_grad.texels.iter().flat_map(flat).collect(),
        environment: plain::prefilter_vjp(&environment, &operator, &light_grad).iter().map(|x| x.0).collect(),
    };
    assert_same_gradient(scene, &ours, &exact);
}

#[test]
fn a_device_goes_back_to_the_same_bits_twice_and_whatever_it_did_before() {
    let Some(mut gpu) = executor() else { return };
    let scene = Scene::new(500, [70, 45], rules(Channels::Training, PrefilterScheme::Exact), 11);
    let grad = scene.grad_of_picture();
    let gradient = |gpu: &mut GpuExecutor| {
        let Gradient { grad, light, environment, .. } = scene.gradient(gpu, &grad);
        (grad, light, environment)
    };
    let first = gradient(&mut gpu);
    let other = Scene::new(37, [70, 45], rules(Channels::Layers, PrefilterScheme::Official), 12);
    other.gradient(&mut gpu, &other.grad_of_picture());
    assert!(gradient(&mut gpu) == first, "memory that was used before changes nothing");
    let mut another = executor().expect("there was one before");
    assert!(gradient(&mut another) == first, "a new executor computes the same");
}

#[test]
fn nan_gradients_reach_the_light_as_on_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    let scene = Scene::new(80, [70, 45], rules(Channels::Training, PrefilterScheme::Exact), 13);
    let mut grad = scene.grad_of_picture();
    let size = scene.pixel_count();
    grad[(channel::COLOR + 1) * size + 22 * 70 + 35] = f32::NAN;
    let (ours, theirs) = (scene.gradient(&mut gpu, &grad), scene.gradient(&mut cpu, &grad));
    let nonfinite = |values: &[f64]| values.iter().map(|x| !x.is_finite()).collect::<Vec<_>>();
    assert!(nonfinite(&ours.light).contains(&true), "the gradient of the light reports them");
    assert!(nonfinite(&ours.light) == nonfinite(&theirs.light), "the same texels are");
    assert!(nonfinite(&ours.environment) == nonfinite(&theirs.environment), "so is the same of the environment");
    assert!(nonfinite(&ours.grad) == nonfinite(&theirs.grad), "and the same of the pixels");
}

fn random_texels(count: usize) -> Vec<f32> {
    let number = |k: usize| if k % 4 == 3 { 0.0 } else { 2.0 * uniform(41, 0, k as u64) - 1.0 };
    (0..4 * count).map(number).collect()
}

#[test]
fn the_way_back_through_the_prefilter_is_the_transposed_one() {
    let Some(mut gpu) = executor() else { return };
    for (scheme, resolution) in SCHEMES {
        let environment = random_environment(resolution, RadianceActivation::Identity, 5);
        let light = light_of(&mut gpu, &environment, scheme);
        let texels = gpu.read_light(&light).expect("a light can be read");
        let cotangent = random_texels(texels.len() / 4);
        let grad = gpu.light_grad(&cotangent).expect("texels fit");
        let on_device = upload(&mut gpu, &environment);
        let grad = gpu.prefilter_vjp(&on_device, &light, &grad).expect("the light goes back");
        let mut back = vec![0.0; environment.values.len()];
        gpu.download(&grad, &mut back).expect("a gradient can be read");
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let size = texels.iter().zip(&cotangent).map(|(a, b)| f64::from((a * b).abs())).sum::<f64>();
        assert_close(dot(&texels, &cotangent), dot(&environment.values, &back), SAME_SUM * size);
    }
}

#[test]
fn the_prefilter_goes_back_as_on_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    for (scheme, resolution) in SCHEMES {
        for activation in [RadianceActivation::Identity, RadianceActivation::Exponential] {
            let environment = random_environment(resolution, activation, 6);
            let light = light_of(&mut cpu, &environment, scheme);
            let texels = random_texels(light.texels().len());
            let grad = light.grad(texels.as_chunks().0);
            let expected = cpu.prefilter_vjp(&environment, &light, &grad).expect("the CPU goes back");

            let light = light_of(&mut gpu, &environment, scheme);
            let grad = gpu.light_grad(&texels).expect("texels fit");
            let on_device = upload(&mut gpu, &environment);
            let grad = gpu.prefilter_vjp(&on_device, &light, &grad).expect("the device goes back");
            let mut actual = vec![0.0; expected.len()];
            gpu.download(&grad, &mut actual).expect("a gradient can be read");
            println!(
                "{scheme:?} {resolution} {activation:?}: {:.1e}",
                difference(&to_f64(&actual), &to_f64(&expected))
            );
            assert_all_close(&to_f64(&actual), &to_f64(&expected), SAME_SUM);
        }
    }
}

/// Texels of a network and gradients of its weights: sums of tens of products in other roundings,
/// then an exponential; as a share of the largest.
const SAME_NETWORK: f64 = 5e-6;

#[track_caller]
fn assert_same_network(actual: &[f64], expected: &[f64]) {
    let apart = relative_difference(actual, expected);
    assert!(apart <= SAME_NETWORK, "{apart:e} of the largest apart, allowed are {SAME_NETWORK:e}");
}

/// Gradient of the weights of a network from that of its levels.
fn network_there_and_back<E: Executor>(
    exec: &mut E,
    light: &E::Light,
    environment: &Environment<Vec<f32>>,
    grad: &E::LightGrad,
) -> Vec<f32> {
    let on_device = upload(exec, environment);
    let grad = exec.prefilter_vjp(&on_device, light, grad).expect("the executor goes back");
    let mut weights = vec![0.0; environment.len_of_values()];
    exec.download(&grad, &mut weights).expect("a gradient can be read");
    weights
}

#[test]
fn a_network_is_evaluated_there_and_back_as_on_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    let mut cpu = CpuExecutor::new();
    // The finer one has more texels than one backward pass takes.
    for (resolution, seed) in [(16, 3), (64, 4)] {
        let network = random_environment(resolution, RadianceActivation::Network, seed);
        let expected = light_of(&mut cpu, &network, PrefilterScheme::Exact);
        let light = light_of(&mut gpu, &network, PrefilterScheme::Exact);
        let levels = to_f64(&gpu.read_light(&light).expect("a light can be read"));
        let cpu_levels = to_f64(expected.texels().as_flattened());
        println!("{resolution}: levels {:.1e}", difference(&levels, &cpu_levels));
        assert_same_network(&levels, &cpu_levels);
        let other = random_environment(resolution, RadianceActivation::Network, seed + 1);
        let other = light_of(&mut cpu, &other, PrefilterScheme::Exact);
        assert!(difference(&levels, &to_f64(other.texels().as_flattened())) > 1e-2, "the comparison can fail");

        let texels = random_texels(levels.len() / 4);
        let grad = expected.grad(texels.as_chunks().0);
        let expected = network_there_and_back(&mut cpu, &expected, &network, &grad);
        let grad = gpu.light_grad(&texels).expect("texels fit");
        let actual = network_there_and_back(&mut gpu, &light, &network, &grad);
        println!("{resolution}: gradient {:.1e}", difference(&to_f64(&actual), &to_f64(&expected)));
        assert_same_network(&to_f64(&actual), &to_f64(&expected));
        let again = network_there_and_back(&mut gpu, &light, &network, &grad);
        assert!(again == actual, "a gradient is the same bits twice");
    }
}

#[test]
#[should_panic(expected = "of the largest apart")]
fn a_network_with_one_weight_changed_is_another_light() {
    let (mut cpu, network) = (CpuExecutor::new(), random_environment(16, RadianceActivation::Network, 3));
    let mut changed = network.clone();
    changed.values[WEIGHT_COUNT / 2] += 0.01;
    let [one, other] = [network, changed]
        .map(|light| to_f64(light_of(&mut cpu, &light, PrefilterScheme::Exact).texels().as_flattened()));
    assert_same_network(&one, &other);
}

#[test]
fn weights_of_every_size_are_evaluated_to_finite_light_on_the_device() {
    let Some(mut gpu) = executor() else { return };
    for (stream, size) in [f32::MAX, 1e20, WEIGHT_MAX, 1.0, 1e-30].into_iter().enumerate() {
        let mut network = random_environment(16, RadianceActivation::Network, 5);
        for (index, weight) in network.values.iter_mut().enumerate() {
            *weight = size * (2.0 * uniform(6, stream as u64, index as u64) - 1.0);
        }
        let light = light_of(&mut gpu, &network, PrefilterScheme::Exact);
        let levels = gpu.read_light(&light).expect("a light can be read");
        assert!(levels.iter().all(|x| x.is_finite() && *x >= 0.0), "weights up to {size:e}");
        let grad = gpu.light_grad(&random_texels(levels.len() / 4)).expect("texels fit");
        let back = network_there_and_back(&mut gpu, &light, &network, &grad);
        assert!(back.iter().all(|x| x.is_finite()), "weights up to {size:e}: gradients");
    }
}

#[test]
fn levels_of_a_network_that_are_not_kept_are_zero_and_the_others_the_same_bits() {
    let Some(mut gpu) = executor() else { return };
    let network = random_environment(16, RadianceActivation::Network, 7);
    let on_device = upload(&mut gpu, &network);
    let mut levels = |kept: LevelRange| {
        let light = gpu.prefilter(&on_device, PrefilterScheme::Exact, kept).expect("it can be evaluated");
        gpu.read_light(&light).expect("a light can be read")
    };
    let (all, some) = (levels(LevelRange::ALL), levels(LevelRange { first: 3, end: 6 }));
    let none = levels(LevelRange::NONE);
    let len = 4 * padded_len(16);
    for (level, (all, some)) in all.chunks(len).zip(some.chunks(len)).enumerate() {
        assert!(if (3..6).contains(&level) { some == all } else { some.iter().all(|x| *x == 0.0) }, "level {level}");
    }
    assert!(none.iter().all(|x| *x == 0.0));
}

#[test]
fn the_device_refuses_invalid_networks() {
    let Some(mut gpu) = executor() else { return };
    let mut refused = |environment: &Environment<Vec<f32>>, scheme: PrefilterScheme| {
        let on_device = upload(&mut gpu, environment);
        gpu.prefilter(&on_device, scheme, LevelRange::ALL).map(drop).expect_err("it is no network")
    };
    let network = random_environment(64, RadianceActivation::Network, 8);
    let is = GpuError::LightNetwork;
    assert_eq!(refused(&network, PrefilterScheme::Official), is(LightNetworkError::Scheme));
    let fine = Environment { resolution: 256, ..network.clone() };
    assert_eq!(refused(&fine, PrefilterScheme::Exact), is(LightNetworkError::Resolution { resolution: 256 }));
    let short = network.with_values(network.values[1..].to_vec());
    let count = LightNetworkError::Count { found: WEIGHT_COUNT - 1 };
    assert_eq!(refused(&short, PrefilterScheme::Exact), is(count));
}

#[test]
fn weights_that_no_array_holds_filter_light_to_the_same_bits_in_pieces() {
    let Some(mut whole) = executor() else { return };
    let mut pieces = executor_with_arrays_of(1 << 21).expect("there was one before");
    for scheme in [PrefilterScheme::Exact, PrefilterScheme::Official] {
        let environment = random_environment(scheme.resolution_min().max(32), RadianceActivation::Identity, 6);
        let both = [&mut whole, &mut pieces].map(|gpu| {
            let light = light_of(gpu, &environment, scheme);
            let texels = gpu.read_light(&light).expect("texels come back");
            let grad = gpu.light_grad(&random_texels(texels.len() / 4)).expect("the gradient fits");
            let environment = upload(gpu, &environment);
            let grad = gpu.prefilter_vjp(&environment, &light, &grad).expect("the device goes back");
            let mut own = vec![0.0; environment.len_of_values()];
            gpu.download(&grad, &mut own).expect("numbers come back");
            (texels, own)
        });
        assert!(both[0] == both[1], "{scheme:?}: the light or its gradient depends on how weights are divided");
    }
}

#[test]
fn gaussians_that_no_array_holds_are_refused_with_the_limit_and_what_to_do() {
    let Some(mut gpu) = executor_with_arrays_of(1000) else { return };
    gpu.upload(&[0.0; 248]).expect("they fit");
    let refused = gpu.upload(&[0.0; 249]).expect_err("these do not").to_string();
    for said in ["996", "992", "fewer Gaussians", "the CPU"] {
        assert!(refused.contains(said), "{refused:?} should say {said:?}");
    }
}
