//! Smoothness of normals: surfaces that it does not change, creases that it exempts.

use specula_core::{
    double::Double,
    smoothness::{CREASE_REACH, Line, REACHES, REFLECTED_HALF, bending, bending_vjp, blurred_normal, evenness, gloss},
    vector::Vec3,
};
use specula_tests::number::vector;

/// Pixels from the optical axis to the edge of the picture, and to a length of one at a depth of
/// one.
const HALF: i32 = 60;
const FOCAL: f64 = 150.0;

/// Unit direction to the eye through a place of the picture.
fn view_dir(x: f64, y: f64) -> [f64; 3] {
    let length = (x * x + y * y + FOCAL * FOCAL).sqrt();
    [-x / length, -y / length, -FOCAL / length]
}

/// Unit normal of a sphere at this place and distance, where the ray through a pixel hits it.
fn sphere(centre: [f64; 3], radius: f64, [x, y]: [i32; 2]) -> Option<[f64; 3]> {
    let ray = view_dir(x.into(), y.into()).map(|number| -number);
    let along: f64 = (0..3).map(|k| ray[k] * centre[k]).sum();
    let squared: f64 = centre.iter().map(|x| x * x).sum();
    let under = along * along - squared + radius * radius;
    (under > 0.0).then(|| core::array::from_fn(|k| ((along - under.sqrt()) * ray[k] - centre[k]) / radius))
}

/// Largest bend of lines whose pixels all see the surface, and largest second difference without
/// the projection.
fn largest_bends(normal: impl Fn([i32; 2]) -> Option<[f64; 3]>) -> [f64; 2] {
    let mut largest = [0.0_f64; 2];
    let mut count = 0;
    for (x, y) in (-HALF..HALF).flat_map(|y| (-HALF..HALF).map(move |x| (x, y))) {
        for (reach, [right, down]) in REACHES.iter().flat_map(|reach| [(reach, [1, 0]), (reach, [0, 1])]) {
            let at = |k: i32| normal([x + k * right * *reach as i32, y + k * down * *reach as i32]);
            let (Some(before), Some(middle), Some(after)) = (at(-1), at(0), at(1)) else { continue };
            let line = Line { before: vector(before), at: vector(middle), after: vector(after) };
            let bend: Vec3<Double> = line.bend(vector(view_dir(x.into(), y.into())));
            largest[0] = largest[0].max(bend.length_squared().0.sqrt());
            let along: Vec3<Double> = (line.before - line.at) + (line.after - line.at);
            largest[1] = largest[1].max(along.length_squared().0.sqrt());
            count += 1;
        }
    }
    assert!(count > 1000, "{count} lines lie on the surface");
    largest
}

#[test]
fn spheres_and_planes_are_smooth_up_to_their_outline() {
    let [plane, _] = largest_bends(|_| Some([0.6, 0.0, -0.8]));
    assert_eq!(plane, 0.0);
    for (centre, radius) in [([0.0, 0.0, 4.0], 1.0), ([0.8, -0.5, 4.0], 0.6), ([0.0, 0.0, 3.0], 1.2)] {
        let [bend, whole] = largest_bends(|pixel| sphere(centre, radius, pixel));
        // One degree, where second differences along the line of sight are ten degrees and more.
        assert!(bend < 0.02, "the bend of a sphere is {bend}");
        assert!(whole > 0.15, "at its outline normals turn by {whole}");
    }
    let noisy = |[x, y]: [i32; 2]| {
        let tilt = if (x + y) % 3 == 0 { 0.05 } else { 0.0 };
        Some([tilt, 0.0, -(1.0_f64 - tilt * tilt).sqrt()])
    };
    assert!(largest_bends(noisy)[0] > 0.04, "noise of three degrees is not smooth");
}

/// Evenness beside a crease between two planes that meet in column 0, blurred as the loss does.
fn evenness_at(x: i32, turn: f64) -> f64 {
    let plane = |x: i32| if x < 0 { [0.0, 0.0, -1.0] } else { [turn.sin(), 0.0, -turn.cos()] };
    let blurred = |x: i32| {
        let sum = (x - 2..=x + 2).fold(Vec3::zero(Double(0.0)), |sum, x| sum + vector(plane(x)));
        blurred_normal(sum)
    };
    let reach = CREASE_REACH as i32;
    let row = Line { before: blurred(x - reach), at: blurred(x), after: blurred(x + reach) };
    let column = Line { before: blurred(x), at: blurred(x), after: blurred(x) };
    evenness(&row, &column, vector(view_dir(x.into(), 0.0))).0
}

#[test]
fn creases_are_spared() {
    assert_eq!(evenness_at(-20, 0.5), 1.0, "a plane is even");
    for x in -2..2 {
        assert!(evenness_at(x, 0.5) < 0.05, "a crease of 30° is spared at {x}");
    }
    assert!(evenness_at(0, 0.02) > 0.5, "a turn of 1° is noise");
    let eye = vector([0.0, 0.0, -1.0]);
    let slope = |turn: f64| {
        let (flat, turned) = (vector([0.0, 0.0, -1.0]), vector([turn.sin(), 0.0, -turn.cos()]));
        bending_vjp(&Line { before: flat, at: flat, after: turned }, eye, Double(1.0), Double(1.0)).x.0
    };
    assert!(slope(0.4) < 0.02 * slope(0.02), "what turns by 23° is let go: {} and {}", slope(0.4), slope(0.02));
}

#[test]
fn lines_that_leave_the_surface_have_no_loss() {
    let [unit, none] = [vector::<Double>([0.0, 0.0, -1.0]), Vec3::zero(Double(0.0))];
    let (bent, eye) = (vector([0.6, 0.0, -0.8]), vector([0.0, 0.0, -1.0]));
    let whole = Line { before: unit, at: bent, after: unit };
    assert!(bending(&whole, eye, Double(1.0)).0 > 0.0);
    for line in [Line { before: none, ..whole }, Line { at: none, ..whole }, Line { after: none, ..whole }] {
        assert_eq!(bending(&line, eye, Double(1.0)).0, 0.0);
        assert_eq!(bending_vjp(&line, eye, Double(1.0), Double(1.0)).to_array().map(|x| x.0), [0.0; 3]);
        assert_eq!(evenness(&line, &whole, eye).0, 0.0);
    }
}

/// Gloss of a pixel of this share of the picture, with grey colours.
fn gloss_of(lit: f64, unlit: f64, roughness: f64, coverage: f64) -> f64 {
    let grey = |value: f64| vector([value * coverage; 3]);
    gloss(grey(lit), grey(unlit), Double(roughness * coverage), Double(coverage)).0
}

#[test]
fn mirrors_count_and_matte_pixels_do_not() {
    assert_eq!(gloss_of(0.4, 0.4, 0.1, 1.0), 0.0, "what reflects nothing");
    assert_eq!(gloss_of(0.3, 0.4, 0.1, 1.0), 0.0, "what is darker under the light");
    assert_eq!(gloss_of(0.9, 0.0, 1.0, 1.0), 0.0, "what is as rough as can be");
    let half = f64::from(REFLECTED_HALF);
    assert!((gloss_of(0.3 + half, 0.3, 0.0, 1.0) - 0.5).abs() < 1e-7);
    assert!(gloss_of(0.008, 0.0, 0.6, 1.0) < 0.02, "a matte surface with a trace of tint");
    assert!(gloss_of(0.6, 0.0, 0.1, 1.0) > 0.6, "a mirror");
    for bright in [1e4, f32::MAX, f32::INFINITY] {
        let share = gloss(Vec3 { x: bright, y: bright, z: bright }, Vec3::zero(0.0), 0.0, 1.0_f32);
        assert!((0.999..=1.0).contains(&share), "{share} under a light of {bright}");
    }
    assert!(gloss_of(0.6, 0.0, 0.1, 0.5) < gloss_of(0.6, 0.0, 0.1, 1.0), "what is transparent counts less");
    assert_eq!(gloss_of(0.6, 0.0, 0.1, 0.0), 0.0);
}
