//! Textbook forms beside the robust ones: each breaks a guarantee that core keeps.

use super::{
    blending, numbers,
    splats::{DETERMINANT, EXPONENT, LENGTHS, determinant, exponent, lens, needle, point_beside},
    worst,
};
use specula_core::{
    activation::softplus,
    antialias::BLUR,
    bin::footprint,
    blend::MAX_ALPHA,
    cutoffs::ALPHA_MIN,
    double::Double,
    ggx,
    loss::sparse,
    real::Real,
    vector::{Vec3, vec3},
};

/// Weights of a lobe are products of some ten roundings.
const LOBE: f64 = 1e-5;

/// Both rows of the half matrix of a needle at 37°, as `splats::needle` has them.
fn half_matrix(length: f32) -> [[f32; 3]; 2] {
    let (sin, cos) = 37.0_f32.to_radians().sin_cos();
    let thin = (-12.0_f32).exp() * lens(800, 800).focal_px[0] / 4.0;
    [[cos * length, -sin * thin, 0.0], [sin * length, cos * thin, 0.0]]
}

/// a, b and c of [[a, b], [b, c]] = V Vᵀ + 0.3 I, and its determinant in the textbook's form.
fn textbook_variance(length: f32) -> ([f32; 3], f32) {
    let [first, second] = half_matrix(length);
    let dot = |p: [f32; 3], q: [f32; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
    let (a, b, c) = (dot(first, first) + BLUR, dot(first, second), dot(second, second) + BLUR);
    ([a, b, c], a * c - b * b)
}

#[test]
fn the_determinant_ac_minus_b_squared_loses_its_digits() {
    let camera = lens(800, 800);
    let off = |length: &f32| {
        let exact = determinant(&needle::<Double>(*length, &camera));
        let (_, textbook) = textbook_variance(*length);
        println!("{length} px: {exact}, textbook {textbook}");
        (f64::from(textbook) / exact - 1.0).abs()
    };
    let worst = worst(LENGTHS.iter().map(off));
    assert!(worst > 1e4 * DETERMINANT, "the textbook's is off by {worst:e} only");
    assert!(LENGTHS.iter().any(|length| textbook_variance(*length).1 <= 0.0), "and is not even positive");
}

#[test]
fn the_exponent_from_the_conic_loses_its_digits_and_its_sign() {
    let camera = lens(800, 800);
    let off = |length: &f32| {
        let ([a, b, c], determinant) = textbook_variance(*length);
        let [dx, dy] = point_beside(*length);
        let textbook = -0.5 * (c * dx * dx + a * dy * dy) / determinant + b * dx * dy / determinant;
        let [exact, ours] = [exponent::<Double>(*length, &camera), exponent::<f32>(*length, &camera)];
        assert!((ours - exact).abs() <= EXPONENT, "ours is {ours} and not {exact}");
        println!("{length} px: {exact}, textbook {textbook}");
        (f64::from(textbook) - exact).abs()
    };
    let worst = worst(LENGTHS.iter().map(off));
    assert!(worst > 10.0 * EXPONENT, "the textbook's is off by {worst:e} only");
}

#[test]
fn logarithms_of_a_sigmoid_are_infinite_where_the_softplus_is_not() {
    let textbook_sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
    let textbook_sparse = |x: f32| textbook_sigmoid(x).ln() + (1.0 - textbook_sigmoid(x)).ln();
    let textbook_softplus = |x: f32| (1.0 + x.exp()).ln();
    for x in [-1e4_f32, -100.0, 100.0, 1e4] {
        assert!(!textbook_sparse(x).is_finite(), "the textbook's sparse loss of {x} is {}", textbook_sparse(x));
        assert!((f64::from(sparse(x)) + f64::from(x.abs())).abs() < 1e-3 * f64::from(x.abs()), "ours is −|x|");
    }
    assert!(!textbook_softplus(100.0).is_finite() && softplus(100.0_f32) == 100.0);
}

/// A unit vector at an angle from +z, in any number.
fn at_angle<R: Real>(like: R, angle: f64, of: impl Fn(f64) -> R) -> Vec3<R> {
    vec3(of(angle.sin() * 0.6), of(angle.sin() * 0.8), of(angle.cos())) * like.constant(1.0)
}

#[test]
fn lobes_from_the_cosine_lose_their_digits_where_surfaces_are_smooth() {
    let (mut ours_off, mut textbook_off) = (0.0, 0.0);
    for roughness in [0.02_f64, 0.05, 0.1] {
        let alpha = roughness * roughness;
        for share in [0.5, 1.0, 2.0] {
            // The directions as an f32 has them, so that only formulas differ.
            let rounded = |x: f64| x as f32;
            let axis = at_angle(1.0_f32, 0.5, rounded);
            let light = at_angle(1.0_f32, 0.5 + 2.0 * share * alpha, rounded);
            let wide = |v: Vec3<f32>| vec3(Double::from(v.x), Double::from(v.y), Double::from(v.z));
            let exact = ggx::lobe_weight(wide(axis), wide(light), Double::from(alpha as f32)).0;
            let ours = ggx::lobe_weight(axis, light, alpha as f32);
            // The peak of the textbook's density, 1/(π α²), divided out of it.
            let alpha = alpha as f32;
            let cosine = axis.dot(light);
            let squared = 0.5 * (1.0 + cosine);
            let q = (squared * (alpha * alpha - 1.0) + 1.0) / (alpha * alpha);
            let textbook = 1.0 / (q * q);
            ours_off = f64::max(ours_off, (f64::from(ours) / exact - 1.0).abs());
            textbook_off = worst([textbook_off, (f64::from(textbook) / exact - 1.0).abs()].into_iter());
        }
    }
    println!("lobes: ours {ours_off:.1e}, from the cosine {textbook_off:.1e}");
    assert!(ours_off <= LOBE, "ours is off by {ours_off:e}");
    assert!(textbook_off > 1e4 * LOBE, "the textbook's is off by {textbook_off:e} only");
}

#[test]
fn bits_of_depths_of_either_sign_are_in_no_order() {
    let depths = [-1.0_f32, -0.5, -0.0, 0.0, 1e-45, 1e-30, 0.3, 1.0, 1e30];
    let sorted = |key: fn(f32) -> u32| {
        let mut sorted = depths;
        sorted.sort_by_key(|depth| key(*depth));
        sorted.map(f32::to_bits)
    };
    let expected = depths.map(f32::to_bits);
    let total = |depth: f32| {
        let bits = depth.to_bits();
        bits ^ ((((bits as i32) >> 31) as u32) | 0x8000_0000)
    };
    assert_ne!(sorted(f32::to_bits), expected, "plain bits put what is behind the eye last, and upside down");
    assert_eq!(sorted(total), expected);
    // Ours sorts plain bits, but of depths that are drawn, all positive: `splats` has the test.
    let drawn = depths.map(|depth| if depth > specula_core::camera::NEAR { depth } else { 0.0 });
    assert!(drawn.map(f32::to_bits).is_sorted());
}

#[test]
fn three_standard_deviations_cut_off_what_is_seen() {
    let at = |deviations: f32| MAX_ALPHA * (-0.5 * deviations * deviations).exp();
    let splat = needle::<f32>(5.0, &lens(64, 64));
    let splat = specula_core::splat::Splat { opacity: MAX_ALPHA, ..splat };
    assert!(at(3.0) > 2.0 * ALPHA_MIN, "a seam of {} at the edge of a tile", at(3.0));
    assert!(at(footprint(&splat).reach) <= ALPHA_MIN * 1.000_01, "ours ends where nothing is drawn");
}

/// Transmittance in front of each layer of a stack, computed backwards by division from the final
/// transmittance.
fn divided(alphas: &[f32]) -> f64 {
    let behind = alphas.iter().fold(1.0_f32, |passed, alpha| passed * (1.0 - alpha));
    let front = alphas.iter().rev().fold(behind, |passed, alpha| passed / (1.0 - alpha));
    f64::from(front)
}

#[test]
fn transmittance_by_division_from_behind_is_lost_where_layers_are_opaque() {
    let opaque = [1.0 - 1e-9_f32; 3];
    assert!(!divided(&opaque).is_finite() || (divided(&opaque) - 1.0).abs() > 0.5, "{}", divided(&opaque));
    let deep = [0.9_f32; 60];
    assert!(!divided(&deep).is_finite() || (divided(&deep) - 1.0).abs() > 0.5, "{}", divided(&deep));
    // Ours goes front to back, from a transmittance of one, and limits alpha.
    blending::assert_front_to_back_is_finite(&[1.0 - 1e-9; 3]);
    blending::assert_front_to_back_is_finite(&[0.9; 60]);
}

#[test]
fn a_square_of_a_large_gradient_freezes_a_number_for_ever() {
    let textbook = |grad: f32| {
        let square = 0.001 * grad * grad;
        1e-3 * 0.1 * grad / square.sqrt()
    };
    assert_eq!(textbook(1e30), 0.0, "a mean square of infinity lets nothing move any more");
    let (_, left_out) = numbers::stepped(&[1e30]);
    assert_eq!(left_out, 1, "ours leaves it out and says so");
}
