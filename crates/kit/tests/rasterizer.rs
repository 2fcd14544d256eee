//! Pictures and gradients of the rasteriser against dual numbers in `f64`: a renderer in gsplat's
//! equations, from activated columns and matrices, one loop after the other.

use rayon::ThreadPoolBuilder;
use specula_core::{
    camera::CameraError,
    dual::Dual,
    random,
    real::Real,
    sh,
    vector::{Mat3, Vec3, vec3},
};
use specula_kit::{
    Colors, Column, Context, Cotangents, DepthMode, Images, InputError, InputGradients, Inputs, Options, PinholeView,
    RasterizeError, Rasterizer, prelude::CpuExecutor,
};

/// Rounding of pictures in `f32`, of logarithms of scales and of logits of opacities.
const SAME_PICTURE: f64 = 1e-5;
/// Rounding of gradients in `f32`: sums of a thousand pixels, as a share of the largest gradient of
/// a column. Expected depths of faint pixels divide by their alpha: 2.4e-5.
const SAME_GRADIENT: f64 = 1e-4;

const WIDTH: u32 = 26;
const HEIGHT: u32 = 20;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;

/// Columns that the tests own.
#[derive(Clone)]
struct Case {
    means: Vec<[f32; 3]>,
    quats: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    colors: Vec<[f32; 3]>,
    /// Degree that is evaluated; `None` for colours.
    degree: Option<u8>,
    views: Vec<PinholeView>,
    options: Options,
}

impl Case {
    /// Random Gaussians in front of two cameras with principal points off the centre.
    fn new(count: usize, degree: Option<(u8, usize)>, options: Options, seed: u64) -> Self {
        let draw = |gaussian: usize, index: u64, low: f32, high: f32| {
            low + (high - low) * random::uniform(seed, gaussian as u64, index)
        };
        let each = 0..count;
        let colors = degree.map_or(1, |(_, stored)| stored);
        Self {
            means: each.clone().map(|g| [0, 1, 2].map(|k| draw(g, k, -0.9, 0.9))).collect(),
            quats: each.clone().map(|g| [3, 4, 5, 6].map(|k| draw(g, k, -2.0, 2.0))).collect(),
            scales: each.clone().map(|g| [7, 8, 9].map(|k| draw(g, k, 0.02, 0.5))).collect(),
            // An opaque one, whose logit would be infinite.
            opacities: each.map(|g| if g == 1 { 1.0 } else { draw(g, 10, 0.1, 0.98) }).collect(),
            colors: (0..count * colors).map(|g| [11, 12, 13].map(|k| draw(g, k, -0.3, 0.9))).collect(),
            degree: degree.map(|(degree, _)| degree),
            views: vec![view(0.3, [0.2, 0.5, 0.9]), view(2.1, [0.0, 0.1, 0.0])],
            options,
        }
    }
    fn inputs(&self) -> Inputs<'_> {
        let colors = match self.degree {
            None => Colors::Rgb(&self.colors),
            Some(degree) => Colors::Harmonics { degree, coefficients: &self.colors },
        };
        let Self { means, quats, scales, opacities, .. } = self;
        Inputs { means, quats, scales, opacities, colors }
    }
    fn run(&self, cotangents: &[Vec<f32>]) -> (Vec<Images>, InputGradients) {
        let mut rasterizer = Rasterizer::new(self.options);
        let (images, context) = rasterizer.forward(&self.inputs(), &self.views).expect("the inputs are valid");
        let has_depth = self.options.depth != DepthMode::None;
        let cotangent = |all: &'_ Vec<f32>| -> [Vec<f32>; 3] {
            let (rgb, rest) = all.split_at(3 * PIXELS);
            let (alpha, depth) = rest.split_at(PIXELS);
            [rgb.to_vec(), alpha.to_vec(), if has_depth { depth.to_vec() } else { Vec::new() }]
        };
        let owned: Vec<[Vec<f32>; 3]> = cotangents.iter().map(cotangent).collect();
        let cotangents: Vec<Cotangents<'_>> =
            owned.iter().map(|[rgb, alpha, depth]| Cotangents { rgb, alpha, depth }).collect();
        let gradients = rasterizer.backward(&context, &cotangents).expect("the cotangents fit");
        (images, gradients)
    }
    /// All inputs of a view as numbers: columns, view matrix, background, shifts of the centres.
    fn numbers(&self, view: &PinholeView) -> Vec<f64> {
        let columns: [&[f32]; 7] = [
            self.means.as_flattened(),
            self.quats.as_flattened(),
            self.scales.as_flattened(),
            &self.opacities,
            self.colors.as_flattened(),
            view.view_matrix[..3].as_flattened(),
            &view.background,
        ];
        let shifts = vec![0.0; 2 * self.means.len()];
        columns.concat().into_iter().map(f64::from).chain(shifts).collect()
    }
    /// The gradient of a view as the same numbers; columns are sums over views.
    fn columns_of(gradients: &InputGradients, view: usize) -> Vec<(&'static str, Vec<f32>)> {
        let own = &gradients.views[view];
        let matrix = own.view_matrix.expect("gradients of views were asked for");
        vec![
            ("means", gradients.means.as_flattened().to_vec()),
            ("quats", gradients.quats.as_flattened().to_vec()),
            ("scales", gradients.scales.as_flattened().to_vec()),
            ("opacities", gradients.opacities.clone()),
            ("colors", gradients.colors.as_flattened().to_vec()),
            ("view matrix", matrix[..3].as_flattened().to_vec()),
            ("background", own.background.to_vec()),
            ("means2d", own.means2d.as_flattened().to_vec()),
        ]
    }
}

/// Camera on a circle around the origin.
fn view(angle: f32, background: [f32; 3]) -> PinholeView {
    let eye = glam_of(3.0 * angle.cos(), 3.0 * angle.sin(), 0.8);
    let camera = specula_core::camera::Camera::look_at(eye, glam_of(0.1, 0.0, 0.0), glam_of(0.0, 0.0, 1.0), 0.8, 9, 9);
    let rows = [0, 1, 2].map(|row| camera.camera_from_world.row(row));
    let shift = camera.camera_from_world * -camera.position;
    let row = |k: usize| [rows[k].x, rows[k].y, rows[k].z, shift[k]];
    PinholeView {
        view_matrix: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        intrinsics: [[27.0, 0.0, 11.0], [0.0, 29.0, 11.5], [0.0, 0.0, 1.0]],
        width: WIDTH,
        height: HEIGHT,
        background,
    }
}

fn glam_of(x: f32, y: f32, z: f32) -> glam::Vec3 {
    glam::Vec3::new(x, y, z)
}

/// Reads numbers one after the other.
struct Reader<'a>(&'a [Dual]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [Dual; N] {
        let (first, rest) = self.0.split_at(N);
        self.0 = rest;
        core::array::from_fn(|k| first[k])
    }
    fn rows<const N: usize>(&mut self, count: usize) -> Vec<[Dual; N]> {
        (0..count).map(|_| self.take()).collect()
    }
}

/// Splat of the reference.
struct Splat {
    mean: [Dual; 2],
    conic: [Dual; 3],
    opacity: Dual,
    depth: Dual,
    color: [Dual; 3],
}

fn vector([x, y, z]: [Dual; 3]) -> Vec3<Dual> {
    vec3(x, y, z)
}

/// Σ = R S² Rᵀ of a quat, which is normalised.
fn covariance([w, x, y, z]: [Dual; 4], scales: [Dual; 3]) -> Mat3<Dual> {
    let length = (w * w + x * x + y * y + z * z).sqrt();
    let [w, x, y, z] = [w, x, y, z].map(|c| c / length);
    let one = w.constant(1.0);
    let rows = [
        vec3(one - (y * y + z * z) * 2.0, (x * y - w * z) * 2.0, (x * z + w * y) * 2.0),
        vec3((x * y + w * z) * 2.0, one - (x * x + z * z) * 2.0, (y * z - w * x) * 2.0),
        vec3((x * z - w * y) * 2.0, (y * z + w * x) * 2.0, one - (x * x + y * y) * 2.0),
    ];
    let squares = vector(scales.map(|s| s * s));
    Mat3 { rows: [0, 1, 2].map(|i| vector([0, 1, 2].map(|j: usize| rows[i].times(squares).dot(rows[j])))) }
}

/// The pictures of a view: planes of red, green, blue, alpha and depth.
fn reference(case: &Case, view: &PinholeView, numbers: &[Dual]) -> Vec<Dual> {
    let count = case.means.len();
    let mut reader = Reader(numbers);
    let means: Vec<[Dual; 3]> = reader.rows(count);
    let quats: Vec<[Dual; 4]> = reader.rows(count);
    let scales: Vec<[Dual; 3]> = reader.rows(count);
    let opacities: Vec<[Dual; 1]> = reader.rows(count);
    let colors: Vec<[Dual; 3]> = reader.rows(case.colors.len());
    let matrix: [[Dual; 4]; 3] = [reader.take(), reader.take(), reader.take()];
    let background: [Dual; 3] = reader.take();
    let shifts: Vec<[Dual; 2]> = reader.rows(count);

    let rotation = Mat3 { rows: matrix.map(|[x, y, z, _]| vec3(x, y, z)) };
    let translation = vector(matrix.map(|row| row[3]));
    let [a, b, c] = rotation.rows;
    let inverse_volume = a.dot(b.cross(c)).recip();
    let inverse = Mat3::from_columns([b.cross(c), c.cross(a), a.cross(b)].map(|column| column * inverse_volume));
    let eye = -inverse.transform(translation);
    let of = |x: f32| translation.x.constant(x);
    let [[fx, _, cx], [_, fy, cy], _] = view.intrinsics.map(|row| row.map(of));
    let limit = |center: f32, extent: u32, focal: f32| of(1.3 * center.max(extent as f32 - center) / focal);
    let limits = [
        limit(view.intrinsics[0][2], view.width, view.intrinsics[0][0]),
        limit(view.intrinsics[1][2], view.height, view.intrinsics[1][1]),
    ];

    let mut splats = Vec::new();
    for gaussian in 0..count {
        let mean = vector(means[gaussian]);
        let p = rotation.transform(mean) + translation;
        if p.z.value < f64::from(case.options.near) || p.z.value > f64::from(case.options.far) {
            continue;
        }
        let slope = |x: Dual, limit: Dual| (x / p.z).max(-limit).min(limit);
        let (tx, ty) = (slope(p.x, limits[0]), slope(p.y, limits[1]));
        let zero = of(0.0);
        let jacobian = [vec3(fx / p.z, zero, -(fx * tx) / p.z), vec3(zero, fy / p.z, -(fy * ty) / p.z)];
        let sigma = covariance(quats[gaussian], scales[gaussian]);
        let rows = jacobian.map(|row| rotation.transform_transposed(row));
        let along = |i: usize, j: usize| rows[i].dot(sigma.transform(rows[j]));
        let (xx, xy, yy) = (along(0, 0), along(0, 1), along(1, 1));
        let unblurred = xx * yy - xy * xy;
        let (xx, yy) = (xx + case.options.eps2d, yy + case.options.eps2d);
        let determinant = xx * yy - xy * xy;
        let [mut opacity] = opacities[gaussian];
        if case.options.antialiased {
            opacity = opacity * (unblurred / determinant).max(of(1e-6)).sqrt();
        }
        let color = match case.degree {
            None => colors[gaussian],
            Some(degree) => {
                let stored = colors.len() / count;
                let direction = mean - eye;
                let direction = direction * direction.length_squared().sqrt().recip();
                let basis = sh::basis(direction, (usize::from(degree) + 1).pow(2));
                [0, 1, 2].map(|channel: usize| {
                    let terms = (0..stored).map(|k| basis[k] * colors[gaussian * stored + k][channel]);
                    (terms.fold(of(0.0), |sum, term| sum + term) + 0.5).max(of(0.0))
                })
            }
        };
        let shift = shifts[gaussian];
        splats.push(Splat {
            mean: [fx * (p.x / p.z) + cx + shift[0], fy * (p.y / p.z) + cy + shift[1]],
            conic: [yy / determinant, -xy / determinant, xx / determinant],
            opacity,
            depth: p.z,
            color,
        });
    }
    splats.sort_by(|a, b| a.depth.value.total_cmp(&b.depth.value));

    let mut planes = vec![of(0.0); 5 * PIXELS];
    for pixel in 0..PIXELS {
        let at = [pixel as u32 % view.width, pixel as u32 / view.width].map(|index| of(index as f32 + 0.5));
        let (mut transmittance, mut sums) = (of(1.0), [of(0.0); 4]);
        for splat in &splats {
            let (dx, dy) = (at[0] - splat.mean[0], at[1] - splat.mean[1]);
            let [a, b, c] = splat.conic;
            let exponent = (a * dx * dx + c * dy * dy) * 0.5 + b * dx * dy;
            let alpha = (splat.opacity * (-exponent).exp()).min(of(0.99));
            if alpha.value < 1.0 / 255.0 {
                continue;
            }
            let behind = transmittance * (of(1.0) - alpha);
            if behind.value < 1e-4 {
                break;
            }
            let weight = alpha * transmittance;
            let [r, g, b] = splat.color;
            for (sum, value) in sums.iter_mut().zip([r, g, b, splat.depth]) {
                *sum = *sum + weight * value;
            }
            transmittance = behind;
        }
        for channel in 0..3 {
            planes[channel * PIXELS + pixel] = sums[channel] + transmittance * background[channel];
        }
        let alpha = of(1.0) - transmittance;
        planes[3 * PIXELS + pixel] = alpha;
        planes[4 * PIXELS + pixel] = match case.options.depth {
            DepthMode::None => of(0.0),
            DepthMode::Accumulated => sums[3],
            DepthMode::Expected => sums[3] / alpha.max(of(1e-10)),
        };
    }
    planes
}

/// Interleaved colours, alpha and depth as one list, as cotangents are ordered.
fn interleaved(planes: &[f64]) -> Vec<f64> {
    let rgb = (0..3 * PIXELS).map(|k| planes[k % 3 * PIXELS + k / 3]);
    rgb.chain(planes[3 * PIXELS..].iter().copied()).collect()
}

fn cotangents_of(seed: u64) -> Vec<f32> {
    (0..5 * PIXELS as u64).map(|k| 2.0 * random::uniform(seed, 77, k) - 1.0).collect()
}

fn largest(numbers: &[f64]) -> f64 {
    numbers.iter().fold(0.0, |largest, x| f64::max(largest, x.abs()))
}

/// Checks pictures and gradients of a case against the reference.
#[track_caller]
fn assert_same(case: &Case) {
    let cotangents: Vec<Vec<f32>> = (0..case.views.len() as u64).map(cotangents_of).collect();
    let (images, gradients) = case.run(&cotangents);
    let lens: Vec<usize> = Case::columns_of(&gradients, 0).iter().map(|(_, numbers)| numbers.len()).collect();
    let shared: usize = lens[..5].iter().sum();
    let mut sums = vec![0.0; shared];
    let mut own = Vec::new();
    for ((view, images), cotangent) in case.views.iter().zip(&images).zip(&cotangents) {
        let numbers = case.numbers(view);
        let constants: Vec<Dual> = numbers.iter().map(|x| Dual::constant_from(*x)).collect();
        let values: Vec<f64> = reference(case, view, &constants).iter().map(|number| number.value).collect();
        let empty = vec![0.0; if images.depth.is_empty() { PIXELS } else { 0 }];
        let found = [&images.rgb[..], &images.alpha, &images.depth, &empty].concat();
        for (index, (found, expected)) in found.iter().zip(interleaved(&values)).enumerate() {
            let difference = (f64::from(*found) - expected).abs();
            assert!(difference <= SAME_PICTURE * (1.0 + expected.abs()), "number {index}: {found} is not {expected}");
        }
        let slope_along = |index: usize| {
            let mut moved = constants.clone();
            moved[index] = Dual::variable(numbers[index]);
            let slopes: Vec<f64> = reference(case, view, &moved).iter().map(|number| number.slope).collect();
            interleaved(&slopes).iter().zip(cotangent).map(|(slope, c)| slope * f64::from(*c)).sum::<f64>()
        };
        let slopes: Vec<f64> = (0..numbers.len()).map(slope_along).collect();
        sums.iter_mut().zip(&slopes).for_each(|(sum, slope)| *sum += slope);
        own.push(slopes[shared..].to_vec());
    }
    for (view, own) in own.iter().enumerate() {
        let expected = [&sums[..], own].concat();
        let mut rest = &expected[..];
        for (name, found) in Case::columns_of(&gradients, view) {
            let (expected, behind) = rest.split_at(found.len());
            rest = behind;
            let scale = largest(expected);
            assert!(scale > 0.0, "{name} has a gradient");
            let differences: Vec<f64> = expected.iter().zip(&found).map(|(e, f)| (f64::from(*f) - e) / scale).collect();
            println!("{name} of view {view}: {:.1e} of {scale:.1e}", largest(&differences));
            assert!(
                largest(&differences) <= SAME_GRADIENT,
                "{name} of view {view}: {found:?} is not {expected:?} within {SAME_GRADIENT} of {scale}"
            );
        }
        assert!(rest.is_empty(), "every gradient was compared");
    }
}

fn options(depth: DepthMode) -> Options {
    Options { depth, view_gradients: true, ..Options::default() }
}

#[test]
fn colors_and_their_gradients_are_those_of_the_reference() {
    assert_same(&Case::new(8, None, options(DepthMode::None), 1));
}

#[test]
fn accumulated_depths_and_their_gradients_are_those_of_the_reference() {
    assert_same(&Case::new(20, None, options(DepthMode::Accumulated), 2));
}

#[test]
fn expected_depths_with_antialiasing_are_those_of_the_reference() {
    let options = Options { antialiased: true, ..options(DepthMode::Expected) };
    assert_same(&Case::new(9, None, options, 3));
    assert_same(&Case::new(5, None, Options { eps2d: 0.1, ..options }, 4));
}

#[test]
fn harmonics_of_each_degree_are_those_of_the_reference() {
    for degree in 0..4 {
        let stored = (usize::from(degree) + 1).pow(2);
        assert_same(&Case::new(6, Some((degree, stored)), options(DepthMode::None), 5 + u64::from(degree)));
    }
}

#[test]
fn bands_above_the_degree_are_not_read() {
    let case = Case::new(6, Some((1, 16)), options(DepthMode::Accumulated), 9);
    assert_same(&case);
    let (_, gradients) = case.run(&[cotangents_of(0), cotangents_of(1)]);
    assert!(gradients.colors.chunks(16).all(|rows| rows[4..] == [[0.0; 3]; 12]), "they have no gradient");
}

#[test]
fn gaussians_nearer_or_farther_than_the_planes_are_not_drawn() {
    let mut case = Case::new(12, None, options(DepthMode::Accumulated), 10);
    let (all, _) = case.run(&[cotangents_of(0), cotangents_of(1)]);
    for antialiased in [true, false] {
        case.options = Options { near: 2.6, far: 3.3, antialiased, ..case.options };
        assert_same(&case);
    }
    let (some, _) = case.run(&[cotangents_of(0), cotangents_of(1)]);
    let visible = some[0].visible();
    assert!(!visible.is_empty() && visible.len() < all[0].visible().len(), "{visible:?} of {:?}", all[0].visible());
    let is_between = |gaussian: &u32| (2.6..=3.3).contains(&all[0].splats[*gaussian as usize].depth);
    assert!(visible.iter().all(is_between), "depths between the planes");
}

/// Small Gaussians are left out of a view as if they were not there; the others keep their bits.
#[test]
fn gaussians_up_to_the_clipped_radius_are_not_drawn() {
    let mut case = Case::new(12, None, options(DepthMode::Accumulated), 13);
    let cotangents = [cotangents_of(0), cotangents_of(1)];
    let (all, _) = case.run(&cotangents);
    let mut sizes: Vec<i32> = all[0].radii().iter().map(|[x, y]| *x.max(y)).collect();
    sizes.sort_unstable();
    case.options.radius_clip = sizes[6] as f32;
    let (some, gradients) = case.run(&cotangents);
    let is_left_out = |view: usize, gaussian: usize| {
        all[view].radii()[gaussian].iter().all(|radius| *radius as f32 <= case.options.radius_clip)
    };
    assert!((1..12).contains(&some[0].visible().len()), "{:?} of {sizes:?}", some[0].visible());
    for view in 0..2 {
        let mut rest = Case::new(12, None, options(DepthMode::Accumulated), 13);
        (0..12).filter(|gaussian| is_left_out(view, *gaussian)).for_each(|gaussian| rest.opacities[gaussian] = 0.0);
        let (without, _) = rest.run(&cotangents);
        assert_eq!(some[view].rgb, without[view].rgb, "view {view}");
        assert!((0..12).all(|gaussian| (some[view].radii()[gaussian] == [0; 2]) >= is_left_out(view, gaussian)));
    }
    for gaussian in (0..12).filter(|gaussian| is_left_out(0, *gaussian) && is_left_out(1, *gaussian)) {
        assert_eq!((gradients.means[gaussian], gradients.opacities[gaussian]), ([0.0; 3], 0.0), "{gaussian}");
    }
}

/// Black and negative colours take gradients, which a floor at zero would keep from them.
#[test]
fn colors_have_no_floor() {
    let mut case = Case::new(4, None, options(DepthMode::None), 11);
    case.colors = vec![[0.0, -1.0, 2.0]; 4];
    assert_same(&case);
}

/// An absolute gradient is the sum of |∂L/∂centre| over the pixels: of cotangents with one pixel
/// each.
#[test]
fn absolute_gradients_are_those_of_single_pixels() {
    let options = Options { absolute_gradients: true, ..options(DepthMode::Expected) };
    let case = Case::new(12, None, options, 5);
    let mut rasterizer = Rasterizer::new(case.options);
    let (_, context) = rasterizer.forward(&case.inputs(), &case.views[..1]).expect("the inputs are valid");
    let all = cotangents_of(9);
    let (rgb, rest) = all.split_at(3 * PIXELS);
    let (alpha, depth) = rest.split_at(PIXELS);
    let whole = Cotangents { rgb, alpha, depth };
    let found = rasterizer.backward(&context, &[whole]).expect("the cotangents fit").views.remove(0);
    let absolute = found.absolute_means2d.expect("they were asked for");
    let mut expected = vec![[0.0; 2]; case.means.len()];
    for pixel in 0..PIXELS {
        let only = |values: &[f32], width: usize| -> Vec<f32> {
            let of = |(k, x): (usize, &f32)| if k / width == pixel { *x } else { 0.0 };
            values.iter().enumerate().map(of).collect()
        };
        let (rgb, alpha, depth) = (only(rgb, 3), only(alpha, 1), only(depth, 1));
        let one = Cotangents { rgb: &rgb, alpha: &alpha, depth: &depth };
        let one = rasterizer.backward(&context, &[one]).expect("the cotangents fit").views.remove(0);
        for (sum, grad) in expected.iter_mut().zip(&one.means2d) {
            *sum = [0, 1].map(|axis| sum[axis] + f64::from(grad[axis].abs()));
        }
    }
    let most = largest(expected.as_flattened());
    for (found, expected) in absolute.as_flattened().iter().zip(expected.as_flattened()) {
        assert!((f64::from(*found) - expected).abs() <= SAME_GRADIENT * most, "{found} is not {expected}");
    }
    let larger = absolute.iter().zip(&found.means2d).filter(|(sum, grad)| sum[0] > 2.0 * grad[0].abs());
    assert!(larger.count() > 3, "gradients of opposite pixels cancel in the others");
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let case = Case::new(500, Some((3, 16)), options(DepthMode::Expected), 12);
    let run = |threads: usize| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("some threads");
        pool.install(|| case.run(&[cotangents_of(0), cotangents_of(1)]))
    };
    let (one, three) = (run(1), run(3));
    assert!(one == three, "the same bits");
}

/// Contexts may be dropped, and rasterisers used, on another thread.
#[test]
fn rasterisers_and_contexts_move_between_threads() {
    fn moves<T: Send>() {}
    moves::<Rasterizer<CpuExecutor>>();
    moves::<Context<CpuExecutor>>();
}

#[test]
fn nothing_to_draw_is_a_background() {
    let mut case = Case::new(0, None, options(DepthMode::Expected), 13);
    let (images, gradients) = case.run(&[cotangents_of(0), cotangents_of(1)]);
    assert!(images[0].rgb.chunks(3).all(|rgb| rgb == [0.2, 0.5, 0.9]), "only the background");
    assert!(images[0].depth.iter().all(|depth| *depth == 0.0), "at no depth");
    assert!(gradients.means.is_empty() && gradients.views[0].background[0] != 0.0, "which has a gradient");
    case.views.clear();
    let (images, _) = case.run(&[]);
    assert!(images.is_empty(), "no view, no picture");
}

#[test]
fn radii_are_whole_pixels_and_zero_beside_the_picture() {
    let mut case = Case::new(2, None, options(DepthMode::None), 14);
    case.scales = vec![[0.05; 3]; 2];
    case.means = vec![[0.0; 3], [0.0, 0.0, 80.0]];
    case.opacities = vec![0.9; 2];
    let (images, _) = case.run(&[cotangents_of(0), cotangents_of(1)]);
    let [[width, height], beside] = images[0].radii()[..] else { panic!("one for each Gaussian") };
    // Three standard deviations of √(0.3 + (29 · 0.05 / 3)²) px.
    assert!((2..=3).contains(&width) && (2..=3).contains(&height), "{width} × {height}");
    assert_eq!((beside, images[0].visible()), ([0; 2], vec![0]));
}

/// Error of a changed case.
fn error_of(change: impl FnOnce(&mut Case)) -> InputError {
    let mut case = Case::new(3, None, options(DepthMode::None), 15);
    change(&mut case);
    match Rasterizer::new(case.options).forward(&case.inputs(), &case.views) {
        Err(RasterizeError::Input(error)) => error,
        other => panic!("{other:?} is no refusal"),
    }
}

#[test]
fn invalid_inputs_are_refused_by_name() {
    let value = |column: Column, row: usize| InputError::Value { column, row };
    assert_eq!(error_of(|case| case.means[2][1] = f32::NAN), value(Column::Means, 2));
    assert_eq!(error_of(|case| case.quats[1] = [0.0; 4]), value(Column::Quats, 1));
    assert_eq!(error_of(|case| case.scales[0][2] = 0.0), value(Column::Scales, 0));
    assert_eq!(error_of(|case| case.opacities[0] = 1.5), value(Column::Opacities, 0));
    assert_eq!(error_of(|case| case.colors[1][0] = f32::INFINITY), value(Column::Colors, 1));
    let short = InputError::Length { column: Column::Scales, expected: 3, found: 2 };
    assert_eq!(error_of(|case| case.scales.truncate(2)), short);
    let harmonics = InputError::Harmonics { degree: 1, coefficients: 3, count: 3 };
    assert_eq!(error_of(|case| case.degree = Some(1)), harmonics);
    let low_pass = InputError::LowPass { eps2d: 0.5, antialiased: false };
    assert_eq!(error_of(|case| case.options.eps2d = 0.5), low_pass);
    assert_eq!(error_of(|case| case.options.far = 0.0), InputError::Planes { near: 0.01, far: 0.0 });
    assert_eq!(error_of(|case| case.options.radius_clip = -1.0), InputError::RadiusClip { radius_clip: -1.0 });
    let camera = |error: CameraError| InputError::Camera { view: 1, error };
    let entry = |case: &mut Case, row: usize, column: usize| case.views[1].view_matrix[row][column] += 0.1;
    assert_eq!(error_of(|case| entry(case, 3, 0)), camera(CameraError::LastRow));
    assert_eq!(error_of(|case| entry(case, 0, 0)), camera(CameraError::Rotation));
    assert_eq!(error_of(|case| case.views[1].intrinsics[0][1] = 0.1), camera(CameraError::Intrinsics));
    assert_eq!(error_of(|case| case.views[1].view_matrix[0][3] = f32::NAN), camera(CameraError::NotFinite));
    assert_eq!(error_of(|case| case.views[0].width = 0), InputError::Size { view: 0, width: 0, height: HEIGHT });
}

#[test]
fn cotangents_of_another_size_are_refused_by_name() {
    let case = Case::new(3, None, options(DepthMode::None), 16);
    let mut rasterizer = Rasterizer::new(case.options);
    let (_, context) = rasterizer.forward(&case.inputs(), &case.views).expect("the inputs are valid");
    let none = Cotangents::default();
    let long = [0.0; PIXELS];
    let refused = rasterizer.backward(&context, &[none, Cotangents { depth: &long, ..none }]);
    let Err(RasterizeError::Input(error)) = refused else { panic!("there is no depth") };
    assert_eq!(error, InputError::CotangentLength { view: 1, image: "depth", expected: 0, found: PIXELS });
    let refused = rasterizer.backward(&context, &[none]);
    let Err(RasterizeError::Input(error)) = refused else { panic!("there are two views") };
    assert_eq!(error, InputError::Cotangents { expected: 2, found: 1 });
    let zeros = rasterizer.backward(&context, &[none; 2]).expect("empty cotangents are zeros");
    assert!(zeros.means.as_flattened().iter().all(|x| *x == 0.0), "of which the gradient is zero");
}
