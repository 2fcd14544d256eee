//! Light as a network: its formulas, their derivatives, and the CPU executor against them.

use specula_core::{
    cubemap::{FACE_COUNT, texel_direction, texel_solid_angle},
    double::Double,
    dual::Dual,
    environment::{number_of, texels},
    executor::{Executor, Renderer},
    ggx,
    light_network::{
        DEGREES, ENCODING, LAYER_STARTS, LightNetworkError, WEIGHT_COUNT, WEIGHT_MAX, attenuation, attenuations,
        concentration, encode, initial_weight,
    },
    prefilter::{LevelRange, PrefilterScheme},
    random,
    real::Real,
    scene::{Environment, RadianceActivation},
    vector::{Vec3, vec3},
};
use specula_cpu::{CpuError, CpuExecutor};
use specula_tests::{
    compare::{ROUNDING_F32, assert_all_close, assert_close, relative_difference},
    derivative::random_cotangent,
    plain::{self, lift_environment},
    strategies::random_environment,
};

/// Resolution of the base in most tests.
const RESOLUTION: usize = 16;
/// `f32` against `f64` over three layers of sums and an exponential.
const SAME_LIGHT: f64 = 3e-6;
/// The same, back and summed over all texels.
const SAME_GRADIENT: f64 = 1e-5;
/// Distance of the shares that the fitted lobe leaves of a degree from those of the GGX lobe: the
/// bound that [`concentration`] states.
const FITTED: f64 = 0.08;

fn network(seed: u64) -> Environment<Vec<f32>> {
    random_environment(RESOLUTION, RadianceActivation::Network, seed)
}

fn filtered(exec: &mut CpuExecutor, light: &Environment<Vec<f32>>) -> specula_cpu::stages::prefilter::Light {
    exec.prefilter(light, PrefilterScheme::Exact, LevelRange::ALL).expect("a network that can be evaluated")
}

fn unit_vectors(count: u64) -> impl Iterator<Item = Vec3<Double>> {
    (0..count).map(|k| {
        let [x, y, z] = [0, 1, 2].map(|axis| Double(f64::from(random::normal(5, axis, k))));
        let v = vec3(x, y, z);
        v * v.length_squared().sqrt().recip()
    })
}

/// Legendre polynomial of a degree.
fn legendre(degree: usize, x: f64) -> f64 {
    let (mut before, mut value) = (1.0, x);
    for l in 2..=degree {
        let l = l as f64;
        (before, value) = (value, ((2.0 * l - 1.0) * x * value - (l - 1.0) * before) / l);
    }
    value
}

/// Share of a zonal harmonic of each degree that a lobe around its axis leaves, by integration over
/// the cosine.
fn shares(angle_max: f64, weight: impl Fn(f64) -> f64) -> [f64; DEGREES.len()] {
    const STEPS: u32 = 20_000;
    let mut sums = [0.0; DEGREES.len() + 1];
    for step in 0..STEPS {
        // Denser around the axis.
        let t = (f64::from(step) + 0.5) / f64::from(STEPS);
        let angle = angle_max * t * t * t;
        let weight = weight(angle) * angle.sin() * t * t;
        sums[0] += weight;
        for (sum, degree) in sums[1..].iter_mut().zip(DEGREES) {
            *sum += weight * legendre(degree, angle.cos());
        }
    }
    core::array::from_fn(|k| sums[k + 1] / sums[0])
}

#[test]
fn harmonics_of_a_degree_depend_only_on_the_angle_between_directions() {
    let none = [Double(1.0); DEGREES.len()];
    let vectors: Vec<_> = unit_vectors(40).collect();
    for (a, b) in vectors.iter().zip(vectors.iter().rev()) {
        let (encoded_a, encoded_b) = (encode(*a, &none), encode(*b, &none));
        let mut first = 0;
        for degree in DEGREES {
            let range = first..first + 2 * degree + 1;
            let sum: f64 = range.clone().map(|k| encoded_a[k].0 * encoded_b[k].0).sum();
            let count = (2 * degree + 1) as f64;
            assert_close(sum, count * legendre(degree, a.dot(*b).0), 1e-10 * count);
            first = range.end;
        }
        assert_eq!(first, ENCODING);
    }
}

#[test]
fn harmonics_are_orthogonal_and_of_mean_square_one() {
    const FINE: usize = 64;
    let mut sums = vec![0.0; ENCODING * ENCODING];
    for index in 0..FACE_COUNT * FINE * FINE {
        let (face, row, column) = (index / (FINE * FINE), index / FINE % FINE, index % FINE);
        let [x, y, z] = texel_direction(face, column, row, FINE).map(Double);
        let encoding = encode(vec3(x, y, z), &[Double(1.0); DEGREES.len()]);
        let share = texel_solid_angle(column, row, FINE) / (4.0 * core::f64::consts::PI);
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += share * encoding[k / ENCODING].0 * encoding[k % ENCODING].0;
        }
    }
    for (k, sum) in sums.iter().enumerate() {
        let expected = if k / ENCODING == k % ENCODING { 1.0 } else { 0.0 };
        assert_close(*sum, expected, 2e-3);
    }
}

/// The attenuation approximates the GGX lobe that filters the levels of a cube map.
#[test]
fn the_attenuation_of_a_roughness_is_that_of_its_ggx_lobe() {
    let mut worst: f64 = 0.0;
    for roughness in [0.07, 0.125, 0.17, 0.23, 0.3, 0.4, 0.55, 0.75, 1.0] {
        let alpha = roughness * roughness;
        let ggx = shares(core::f64::consts::FRAC_PI_2, |angle| {
            let axis = vec3(Double(0.0), Double(0.0), Double(1.0));
            let light = vec3(Double(angle.sin()), Double(0.0), Double(angle.cos()));
            ggx::lobe_weight(axis, light, Double(alpha)).0 * angle.cos()
        });
        let found = attenuations(roughness as f32);
        let off = found.iter().zip(ggx).map(|(found, ggx)| (found - ggx).abs()).fold(0.0, f64::max);
        println!("roughness {roughness}: {found:.3?} for {ggx:.3?}");
        worst = worst.max(off);
    }
    assert!(worst <= FITTED, "{worst}");
    assert!(worst > FITTED / 2.0, "{worst}: the comparison shows what the fit leaves");
}

/// Ref-NeRF, eq. 8, is an approximation for lobes that are not too wide.
#[test]
fn the_attenuation_of_a_concentration_is_the_integral_over_its_lobe() {
    for kappa in [30.0, 100.0, 1000.0] {
        let lobe = shares(core::f64::consts::PI, |angle: f64| (kappa * (angle.cos() - 1.0)).exp());
        for (degree, integral) in DEGREES.into_iter().zip(lobe) {
            assert_close(attenuation(degree, kappa), integral, 0.02);
        }
    }
}

#[test]
fn rough_lobes_keep_only_low_degrees_and_mirrors_keep_all() {
    assert_eq!(attenuations(0.0), [1.0; DEGREES.len()]);
    let rough = attenuations(1.0);
    assert!(rough[3] < 1e-6 && rough[0] > 0.5, "{rough:?}");
    let [one, other] = [concentration(0.3), concentration(0.31)];
    assert!(one > other, "rougher lobes are wider");
}

#[test]
fn a_new_network_is_the_same_light_in_every_direction_and_at_every_roughness() {
    let mut exec = CpuExecutor::new();
    for radiance in [0.01_f32, 0.5, 30.0] {
        let number = number_of(RadianceActivation::Network, radiance);
        let values = (0..WEIGHT_COUNT).map(|index| initial_weight(index, number, 4)).collect();
        let light = Environment { resolution: RESOLUTION, activation: RadianceActivation::Network, values };
        let texel =
            |x: f32| assert_close(f64::from(x), f64::from(radiance), f64::from(radiance.max(1.0)) * ROUNDING_F32);
        filtered(&mut exec, &light).texels().iter().flat_map(|texel| texel[..3].to_vec()).for_each(texel);
        texels(&light).flatten().for_each(texel);
        let hidden = &light.values[..LAYER_STARTS[2]];
        let variance = hidden.iter().map(|weight| weight * weight).sum::<f32>() / hidden.len() as f32;
        assert!((0.03..0.06).contains(&variance), "{variance}: hidden layers are not zero");
    }
}

#[test]
fn the_first_level_is_the_light_of_its_texels() {
    let light = network(5);
    let faces = filtered(&mut CpuExecutor::new(), &light).faces(0);
    let direct: Vec<f32> = texels(&light).flatten().collect();
    assert_all_close(&to_f64(&faces), &to_f64(&direct), ROUNDING_F32);
    let [least, most] = faces.iter().fold([f32::MAX, 0.0], |[least, most], x| [least.min(*x), most.max(*x)]);
    assert!(least < 0.8 * most, "{least} to {most}: it differs from direction to direction");
}

#[test]
fn levels_and_gradients_are_those_of_f64() {
    let mut exec = CpuExecutor::new();
    let light = network(6);
    let operator = plain::Operator::new(RESOLUTION);
    let exact = lift_environment::<Double>(&light);
    let exact_levels = plain::prefilter(&exact, &operator);
    let ours = filtered(&mut exec, &light);
    let expected = numbers_of_maps(&exact_levels);
    let found: Vec<f64> = ours.texels().iter().flat_map(|texel| [0, 1, 2].map(|c| f64::from(texel[c]))).collect();
    println!("levels: {:.1e}", relative_difference(&found, &expected));
    assert_all_close(&found, &expected, SAME_LIGHT);
    let wrong = lift_environment::<Double>(&network(7));
    let wrong = numbers_of_maps(&plain::prefilter(&wrong, &operator));
    assert!(relative_difference(&found, &wrong) > 100.0 * SAME_LIGHT, "the comparison can fail");

    let cotangent = random_cotangent(expected.len(), 1);
    let grad = ours.grad(&as_texels(&cotangent));
    let back = exec.prefilter_vjp(&light, &ours, &grad).expect("the CPU goes back");
    let mut level_grads = plain::LightGrad::<Double>::zero(&exact_levels);
    let mut numbers = cotangent.chunks_exact(3);
    for texel in &mut level_grads.texels {
        let rgb = numbers.next().expect("as many texels");
        *texel = vec3(Double(rgb[0]), Double(rgb[1]), Double(rgb[2]));
    }
    let expected: Vec<f64> = plain::prefilter_vjp(&exact, &operator, &level_grads).iter().map(|x| x.0).collect();
    println!("gradient: {:.1e}", relative_difference(&to_f64(&back), &expected));
    assert_all_close(&to_f64(&back), &expected, SAME_GRADIENT);
}

/// ⟨J dx, y⟩ = ⟨dx, Jᵀ y⟩: the left side from dual numbers, the right side from the executor.
#[test]
fn the_gradient_of_the_weights_is_the_adjoint_of_the_levels() {
    let mut exec = CpuExecutor::new();
    let light = network(8);
    let operator = plain::Operator::new(RESOLUTION);
    let ours = filtered(&mut exec, &light);
    for draw in 0..3 {
        let along = random_cotangent(WEIGHT_COUNT, 10 + draw);
        let cotangent = random_cotangent(3 * ours.texels().len(), 20 + draw);
        let mut lifted = lift_environment::<Dual>(&light);
        for (weight, along) in lifted.values.iter_mut().zip(&along) {
            weight.slope = *along;
        }
        let levels = plain::prefilter(&lifted, &operator);
        let slopes = levels.texels.iter().flat_map(|texel| texel.to_array().map(|x| x.slope));
        let (mut forward, mut size) = (0.0, 0.0);
        for (slope, y) in slopes.zip(&cotangent) {
            forward += slope * y;
            size += (slope * y).abs();
        }
        let grad = ours.grad(&as_texels(&cotangent));
        let back = exec.prefilter_vjp(&light, &ours, &grad).expect("the CPU goes back");
        let backward: f64 = back.iter().zip(&along).map(|(g, dx)| f64::from(*g) * dx).sum();
        assert_close(backward, forward, SAME_LIGHT * size);
        assert!(forward.abs() > 1e-3 * size, "there is something to compare: {forward} of {size}");
    }
}

#[test]
fn levels_and_gradients_are_the_same_bits_on_any_number_of_threads() {
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            let (mut exec, light) = (CpuExecutor::new(), network(9));
            let levels = filtered(&mut exec, &light);
            let grad = levels.grad(&as_texels(&random_cotangent(3 * levels.texels().len(), 2)));
            let back = exec.prefilter_vjp(&light, &levels, &grad).expect("the CPU goes back");
            (levels.texels().to_vec(), back)
        })
    };
    let once = on(1);
    assert!(once == on(2) && once == on(5), "the light or its gradient depends on the number of threads");
}

#[test]
fn levels_that_are_not_kept_are_zero_and_the_others_the_same_bits() {
    let (mut exec, light) = (CpuExecutor::new(), network(10));
    let all = filtered(&mut exec, &light);
    let kept = LevelRange { first: 3, end: 6 };
    let some = exec.prefilter(&light, PrefilterScheme::Exact, kept).expect("it can be evaluated");
    for level in 0..all.levels().len() {
        let faces = some.faces(level);
        if kept.contains(level) {
            assert!(faces == all.faces(level), "level {level}");
        } else {
            assert!(faces.iter().all(|x| *x == 0.0), "level {level} is left out");
        }
    }
}

#[test]
fn what_is_no_network_is_refused() {
    let mut exec = CpuExecutor::new();
    let mut refused = |light: &Environment<Vec<f32>>, scheme| {
        exec.prefilter(light, scheme, LevelRange::ALL).map(drop).expect_err("it is no network")
    };
    let changed = |change: &dyn Fn(&mut Environment<Vec<f32>>)| {
        let mut light = network(11);
        change(&mut light);
        light
    };
    let fine = Environment { resolution: 64, ..network(11) };
    let exact = PrefilterScheme::Exact;
    assert_eq!(refused(&fine, PrefilterScheme::Official), CpuError::LightNetwork(LightNetworkError::Scheme));
    let broken = changed(&|light| light.values[500] = f32::NAN);
    let nonfinite = CpuError::LightNetwork(LightNetworkError::Nonfinite { count: 1 });
    assert_eq!(refused(&broken, exact), nonfinite);
    let short = changed(&|light| light.values.truncate(WEIGHT_COUNT - 1));
    let count = LightNetworkError::Count { found: WEIGHT_COUNT - 1 };
    assert_eq!(refused(&short, exact), CpuError::LightNetwork(count));
    let large = changed(&|light| light.resolution = 256);
    let resolution = LightNetworkError::Resolution { resolution: 256 };
    assert_eq!(refused(&large, exact), CpuError::LightNetwork(resolution));
    let odd = changed(&|light| light.resolution = 24);
    assert_eq!(refused(&odd, exact), CpuError::LightResolution { resolution: 24, least: 16 });
}

/// Weights of any finite size make light and gradients of finite size.
#[test]
fn weights_of_every_size_are_evaluated_to_finite_light() {
    let mut exec = CpuExecutor::new();
    let sizes = [f32::MAX, 1e20, 1e6, 1e3, 1.0, 1e-30, 1e-45];
    for (seed, size) in sizes.into_iter().enumerate() {
        let mut light = network(12);
        for (index, weight) in light.values.iter_mut().enumerate() {
            *weight = size * (2.0 * random::uniform(seed as u64, 3, index as u64) - 1.0);
        }
        let levels = filtered(&mut exec, &light);
        assert!(levels.texels().iter().flatten().all(|x| x.is_finite() && *x >= 0.0), "weights up to {size:e}");
        let grad = levels.grad(&as_texels(&random_cotangent(3 * levels.texels().len(), 4)));
        let back = exec.prefilter_vjp(&light, &levels, &grad).expect("the CPU goes back");
        let gated = back.iter().zip(&light.values).all(|(grad, weight)| weight.abs() < WEIGHT_MAX || *grad == 0.0);
        assert!(gated, "weights up to {size:e}: there is no gradient beyond the bound");
        assert!(back.iter().all(|x| x.is_finite()), "weights up to {size:e}: gradients");
    }
}

fn numbers_of_maps(light: &plain::Light<Double>) -> Vec<f64> {
    light.texels.iter().flat_map(|texel| texel.to_array().map(|x| x.0)).collect()
}

fn as_texels(numbers: &[f64]) -> Vec<[f32; 4]> {
    numbers.chunks_exact(3).map(|rgb| [rgb[0] as f32, rgb[1] as f32, rgb[2] as f32, 0.0]).collect()
}

fn to_f64(numbers: &[f32]) -> Vec<f64> {
    numbers.iter().map(|x| f64::from(*x)).collect()
}
