//! Lamps: invariants of physics and geometry, shadows known in closed form, and pictures against
//! the plain pipeline.

use core::f32::consts::PI;
use glam::Vec3;
use proptest::prelude::*;
use specula_core::{
    activation::logit,
    camera::Camera,
    color::linear_from_srgb,
    double::Double,
    executor::{Occluder, Renderer},
    lamps::{
        DirectLight, LAMPS_MAX, LIGHT_MAX, Lamp, LampError, LampOf, LitPixel, RAYS_MAX, Toward, check, check_reflected,
        direct_light, disc_axes, horizon, seen_share, shadow_ray, shift, specular, spiral_point, toward,
    },
    near_field::{BACK_DEPTH, CULL_BACKFACES, NearField, T_MISS, TRIANGLE_LEN, crossing},
    physical::PixelFacing,
    plan::{Needs, Plan, Unlit},
    prefilter::{LevelRange, Levels, PrefilterScheme},
    rules::{Channels, LightLayer, RenderRules},
    scene::{
        ALBEDO, AMBIENT, Environment, Gaussians, Image, LOG_SCALE, Layout, MEAN, METALNESS, OPACITY, QUAT, ROUGHNESS,
        RadianceActivation, len_of_values,
    },
    shade::ShadingRules,
    sphere,
    vector::Vec3 as Real3,
};
use specula_cpu::{CpuError, CpuExecutor};
use specula_tests::{
    compare::{assert_psnr, psnr},
    near_fields::{gray, lit_near_field, of_triangles, polished, random_near_field},
    plain::{self, lift_environment, lift_gaussians},
    strategies::{random_cloud, random_environment, same_every_time, unit_vector},
};
use specula_train::evaluate::render_view;

/// `f32` on lanes against `f64`: 1e-5 is 100 dB; one of 32 rays of a pixel that hits the other of
/// two triangles brings a small picture down to 80 dB.
const SAME_FRAME: f64 = 75.0;
/// Rounding of a few dozen operations in `f32`.
const ROUNDING: f32 = 1e-5;
const RESOLUTION: usize = 16;
const RAYS: usize = 32;

fn facing(normal: Vec3, view_dir: Vec3) -> PixelFacing<f32> {
    PixelFacing { normal: normal.into(), n_dot_v: normal.dot(view_dir).max(1e-4) }
}

/// A surface at the origin.
fn surface(normal: Vec3, view_dir: Vec3, f0: f32, alpha_ggx: f32) -> LitPixel<f32> {
    let origin = Real3::splat(0.0);
    let (facing, view_dir) = (facing(normal, view_dir), view_dir.into());
    LitPixel { point: origin, start: origin, view_dir, facing, f0: Real3::splat(f0), alpha_ggx }
}

fn seen(lamp: &Lamp, point: Vec3) -> Toward<f32> {
    toward(&LampOf::from_array(lamp.numbers()), point.into(), Vec3::Z.into())
}

fn sun(direction: Vec3, irradiance: f32, diameter: f32) -> Lamp {
    Lamp::Sun { direction: direction.to_array(), irradiance: [irradiance; 3], diameter }
}

fn ball(position: Vec3, intensity: f32, radius: f32) -> Lamp {
    Lamp::Sphere { position: position.to_array(), intensity: [intensity; 3], radius }
}

fn is_finite(light: &DirectLight<f32>) -> bool {
    light.to_array().iter().all(|x| x.is_finite() && *x >= 0.0)
}

fn above() -> impl Strategy<Value = Vec3> {
    unit_vector().prop_map(|d| Vec3::new(d[0] as f32, d[1] as f32, d[2].abs() as f32))
}

proptest! {
    #![proptest_config(same_every_time())]

    /// Reciprocity: light takes the same way back.
    #[test]
    fn reflections_are_reciprocal(to in above(), from in above(), alpha in 0.01..1.0_f32, f0 in 0.0..1.0_f32) {
        prop_assume!(to.z > 0.05 && from.z > 0.05);
        let f0 = Real3::splat(f0);
        let there = specular(f0, alpha, &facing(Vec3::Z, to), to.into(), from.into(), 0.0).x / from.z;
        let back = specular(f0, alpha, &facing(Vec3::Z, from), from.into(), to.into(), 0.0).x / to.z;
        prop_assert!((there - back).abs() <= 1e-3 * there.max(1e-6), "{there} {back}");
    }

    /// A lamp of any extent, also none, is finite from anywhere, also from behind, and does not
    /// light surfaces that face away from all of it.
    #[test]
    fn light_is_finite_and_ends_behind_the_horizon(
        position in proptest::array::uniform3(-2.0..2.0_f32),
        radius in prop_oneof![Just(0.0_f32), 0.0..3.0_f32],
        alpha in 0.0..1.0_f32,
        view_dir in above(),
        light in prop_oneof![Just(1.0_f32), Just(LIGHT_MAX)],
    ) {
        let pixel = surface(Vec3::Z, view_dir, 0.04, alpha);
        let position = Vec3::from(position);
        for lamp in [ball(position, light, radius), sun(position, light, radius.min(3.1))] {
            let seen = seen(&lamp, Vec3::ZERO);
            let found = direct_light(&pixel, &seen, 1.0);
            prop_assert!(is_finite(&found), "{lamp:?}: {found:?}");
            if Vec3::from(seen.direction).z < -seen.sine {
                prop_assert_eq!(found.to_array(), [0.0; 6], "from behind");
            }
        }
    }

    /// A front within reach blocks a ray, and so does a back that it reaches from below; nothing
    /// else does.
    #[test]
    fn rays_are_blocked_by_fronts_and_by_backs_above_them(
        seed in any::<u64>(),
        origin in proptest::array::uniform3(-3.0..3.0_f32),
        direction in unit_vector(),
        reach in prop_oneof![Just(T_MISS), 0.0..4.0_f32],
    ) {
        let near_field = random_near_field(40, seed);
        let origin = Real3::from(Vec3::from(origin));
        let direction = Real3::from(Vec3::from(direction.map(|x| x as f32)));
        let position = |vertex: usize| Real3::from(Vec3::from_slice(&near_field.vertex(vertex)[..3]));
        let depth = BACK_DEPTH * near_field.offset;
        let nearest = (0..near_field.triangle_count)
            .map(|triangle| crossing(near_field.corners(triangle).map(position), origin, direction, depth).distance)
            .fold(T_MISS, f32::min);
        prop_assert_eq!(near_field.is_blocked(origin, direction, reach), nearest < reach);
        let front = near_field.first_hit(origin, direction).map_or(T_MISS, |hit| hit.distance);
        prop_assert!(nearest <= front);
    }

    /// Rays hit the back of a triangle from the depth on, and not from a start that noise put below
    /// its own surface.
    #[test]
    fn rays_hit_backs_from_a_depth(
        corners in [unit_vector(), unit_vector(), unit_vector()],
        weights in [0.1..0.4_f32, 0.1..0.4_f32],
        direction in unit_vector(),
        depth in 0.01..0.5_f32,
        below in prop_oneof![0.0..0.9_f32, 1.1..3.0_f32],
    ) {
        let [a, b, c] = corners.map(|corner| Vec3::from(corner.map(|x| x as f32)));
        let normal = (b - a).cross(c - a);
        prop_assume!(normal.length() > 0.1);
        let normal = normal.normalize();
        let direction = Vec3::from(direction.map(|x| x as f32));
        let along = direction.dot(normal);
        prop_assume!(along > 0.1);
        let place = a + weights[0] * (b - a) + weights[1] * (c - a);
        let start = place - direction * (below * depth / along);
        let found = |depth: f32| crossing([a, b, c].map(Real3::from), start.into(), direction.into(), depth).distance;
        prop_assert_eq!(found(depth) < T_MISS, below > 1.0);
        prop_assert_eq!(found(CULL_BACKFACES), T_MISS);
    }

    /// Rays lead to the lamp's disc, and their weights sum to the disc's irradiance on the surface.
    #[test]
    fn rays_weigh_what_the_disc_shines(direction in above(), sine in 0.0..0.9_f32, column in 0..4000_u16, row in 0..4000_u16) {
        const POINTS: usize = 512;
        let toward = Toward { direction: direction.into(), irradiance: Real3::splat(1.0), sine, reach: 1.0 };
        let shift = shift(f32::from(column), f32::from(row), 3.0);
        let axes = disc_axes(toward.direction);
        let mut sum = 0.0;
        for k in 0..POINTS {
            let ray = shadow_ray(Vec3::Z.into(), &toward, axes, &shift, spiral_point(k, POINTS));
            let to = Vec3::from(ray.direction);
            prop_assert!((to.length() - 1.0).abs() < ROUNDING);
            prop_assert!(to.cross(direction).length() <= sine + ROUNDING && to.dot(direction) > 0.0, "outside of the disc");
            prop_assert_eq!(ray.weight > 0.0, to.z > 0.0);
            sum += ray.weight / POINTS as f32;
        }
        // A disc at the horizon shines (asin s − s cos s) / (π s²): 0.21 s of a small one, 0.31 s
        // of the largest, and s / 4 by the parabola.
        let expected = horizon(direction.z, sine);
        prop_assert!((sum - expected).abs() < 0.07 * sine + ROUNDING, "{sum} {expected}");
        if direction.z > sine {
            prop_assert!((sum - expected).abs() < 0.005 * sine + ROUNDING, "{sum} {expected}");
        }
    }
}

/// A white surface of a metal under light from everywhere: it reflects the light that it receives,
/// or less where light is scattered between its facets.
#[test]
fn no_surface_reflects_more_than_it_receives() {
    /// A lattice of this many directions resolves lobes of α ≥ 0.1 within a hundredth.
    const DIRECTIONS: usize = 200_000;
    const ERROR: f64 = 0.01;
    for alpha in [0.1, 0.3, 0.6, 1.0] {
        for n_dot_v in [0.05_f32, 0.3, 0.7, 1.0] {
            let view_dir = Vec3::new((1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
            let reflected = |direction: [f64; 3]| {
                let light_dir = Vec3::from(direction.map(|x| x as f32));
                let facing = facing(Vec3::Z, view_dir);
                f64::from(specular(Real3::splat(1.0), alpha, &facing, view_dir.into(), light_dir.into(), 0.0).x)
            };
            let sum: f64 = sphere::directions(DIRECTIONS).map(reflected).sum();
            let all = sum * 4.0 * core::f64::consts::PI / DIRECTIONS as f64;
            assert!(all < 1.0 + ERROR && all > 0.3, "α {alpha}, n·v {n_dot_v}: {all}");
            // In closed form for the roughest lobe along its axis.
            let is_known = alpha == 1.0 && n_dot_v == 1.0;
            assert!(!is_known || (all - (1.0 - core::f64::consts::LN_2)).abs() < 1e-3, "{all}");
        }
    }
}

#[test]
fn a_white_surface_that_faces_a_sun_returns_its_irradiance_over_pi() {
    for diameter in [0.0, 0.01, 0.5] {
        let seen = seen(&sun(2.0 * Vec3::Z, 3.0, diameter), Vec3::ZERO);
        let light = direct_light(&surface(Vec3::Z, Vec3::X, 0.0, 1.0), &seen, 1.0);
        assert!((light.irradiance.x - 3.0 / PI).abs() < ROUNDING, "{diameter}: {light:?}");
    }
}

#[test]
fn light_of_lamps_falls_with_the_square_of_the_distance() {
    for radius in [0.0, 0.1] {
        for distance in [0.5, 1.0, 4.0, 100.0] {
            let seen = seen(&ball(distance * Vec3::Z, 5.0, radius), Vec3::ZERO);
            let expected = 5.0 / (distance * distance);
            assert!((seen.irradiance.x / expected - 1.0).abs() < ROUNDING);
            assert!(
                (seen.sine - radius / distance).abs() < ROUNDING && (seen.reach - distance + radius).abs() < ROUNDING
            );
        }
    }
    let [inside, center] = [0.3, 0.0].map(|height| seen(&ball(height * Vec3::Z, 5.0, 1.0), Vec3::ZERO));
    assert_eq!([inside.irradiance.x, center.irradiance.x], [5.0; 2], "no more than at its surface");
    assert_eq!([inside.reach, center.reach], [0.0; 2], "nothing is between");
    assert_eq!(Vec3::from(center.direction), Vec3::Z, "along the normal");
}

/// A mirror shows a lamp at the lamp's own radiance, E / (π sin² ω), and no brighter.
#[test]
fn highlights_are_no_brighter_than_the_lamp() {
    for diameter in [0.01_f32, 0.1, 1.0] {
        let seen = seen(&sun(Vec3::Z, 2.0, diameter), Vec3::ZERO);
        let radiance = 2.0 / (PI * (0.5 * diameter).sin().powi(2));
        for alpha in [0.0, 0.001, 0.1] {
            let light = direct_light(&surface(Vec3::Z, Vec3::Z, 1.0, alpha), &seen, 1.0);
            assert!(light.specular.x <= radiance * (1.0 + 10.0 * ROUNDING), "{diameter} {alpha}: {light:?} {radiance}");
            let is_mirror = alpha < 0.1 * diameter;
            assert!(!is_mirror || light.specular.x > 0.9 * radiance, "{diameter} {alpha}: {light:?} {radiance}");
        }
    }
}

#[test]
fn small_suns_approach_a_direction() {
    let to_sun = Vec3::new(0.3, -0.2, 0.7).normalize();
    let view_dir = Vec3::new(-0.5, 0.1, 0.6).normalize();
    let pixel = surface(Vec3::Z, view_dir, 0.5, 0.2);
    let [point, disc] =
        [0.0, 1e-3].map(|diameter| direct_light(&pixel, &seen(&sun(to_sun, 2.0, diameter), Vec3::ZERO), 1.0));
    for (point, disc) in point.to_array().into_iter().zip(disc.to_array()) {
        assert!((point - disc).abs() < 1e-4 * point, "{point} {disc}");
    }
}

/// Light fades at the horizon, within the lamp's width, without a step.
#[test]
fn the_horizon_is_as_blurred_as_the_lamp_is_wide() {
    let heights: Vec<f32> = (-100..=100).map(|k| horizon(0.01 * k as f32, 0.3)).collect();
    assert!(heights.windows(2).all(|pair| pair[1] >= pair[0] && pair[1] - pair[0] < 0.0101));
    assert_eq!([heights[0], heights[69]], [0.0; 2], "below");
    assert!((heights[150] - 0.5).abs() < ROUNDING && (heights[131] - 0.31).abs() < ROUNDING, "above");
    assert_eq!([horizon(-1e-3, 0.0), horizon(0.0, 0.0)].map(|x| x < 1e-6), [true; 2], "of a point");
    assert_eq!(horizon(0.25, 0.0), 0.25);
}

/// Each pixel draws its own numbers, the same in any precision, uniform between 0 and 1.
#[test]
fn pixels_shift_their_rays_by_numbers_of_their_own() {
    const EDGE: usize = 200;
    let mut bins = [0_usize; 10];
    for (column, row) in (0..EDGE).flat_map(|row| (0..EDGE).map(move |column| (column, row))) {
        let single = shift(column as f32, row as f32, 1.0);
        let double = shift(Double(column as f64), Double(row as f64), Double(1.0));
        assert!((f64::from(single.outwards) - double.outwards.0).abs() < 1e-6, "{column} {row}");
        let [cosine, sine] = single.turn;
        assert!((cosine * cosine + sine * sine - 1.0).abs() < ROUNDING);
        bins[(10.0 * single.outwards) as usize] += 1;
        assert_ne!(single.outwards, shift(column as f32 + 1.0, row as f32, 1.0).outwards, "{column} {row}");
    }
    // 4000 of each, with a deviation of 60.
    assert!(bins.iter().all(|count| count.abs_diff(EDGE * EDGE / 10) < 300), "{bins:?}");
    assert_eq!([seen_share(2.0, 0.5), seen_share(0.0, 0.0)], [0.25, 0.0]);
}

#[test]
fn lamps_with_a_fault_are_refused() {
    let fine = sun(Vec3::X, 1.0, 0.01);
    assert_eq!(check(&[fine, ball(Vec3::X, 0.0, 0.0)], RAYS), Ok(()));
    assert_eq!(check(&[], 1), Ok(()));
    assert_eq!(check(&vec![fine; LAMPS_MAX + 1], 1), Err(LampError::Count));
    assert_eq!([check(&[fine], 0), check(&[fine], RAYS_MAX + 1)], [Err(LampError::Count); 2]);
    let faults = [
        sun(Vec3::ZERO, 1.0, 0.1),
        sun(Vec3::X, -1.0, 0.1),
        sun(Vec3::X, f32::NAN, 0.1),
        sun(Vec3::X, 1.0, PI),
        sun(Vec3::new(f32::INFINITY, 0.0, 0.0), 1.0, 0.1),
        ball(Vec3::new(f32::NAN, 0.0, 0.0), 1.0, 0.0),
        ball(Vec3::X, 1.0, -0.1),
        ball(Vec3::X, 2.0 * LIGHT_MAX, 0.0),
    ];
    for fault in faults {
        assert_eq!(check(&[fine, fault], RAYS), Err(LampError::Number { index: 1 }), "{fault:?}");
    }
    let mut exec = CpuExecutor::new();
    let environment = random_environment(RESOLUTION, RadianceActivation::Identity, 1);
    let light = exec.prefilter(&environment, PrefilterScheme::Exact, LevelRange::ALL).expect("16 is a power of two");
    let refused = exec.add_lamps(light, &[faults[0]], RAYS, None).expect_err("it has no direction");
    assert_eq!(refused, CpuError::Lamps(LampError::Number { index: 0 }));
}

/// Physical Gaussians under a light.
struct Subject {
    gaussians: Gaussians<Vec<f32>>,
    environment: Environment<Vec<f32>>,
    camera: Camera,
    occluder: Option<NearField<Vec<f32>>>,
    /// Light that the occluder reflects onto itself.
    reflected: Vec<f32>,
}

impl Subject {
    fn new(seed: u64) -> Self {
        let eye = Vec3::new(2.0, -3.0, 1.5);
        Self {
            gaussians: polished(random_cloud(80, Layout::shaded(Some(1)).physical(), seed)),
            environment: random_environment(RESOLUTION, RadianceActivation::Identity, seed),
            camera: Camera::look_at(eye, Vec3::new(0.2, 0.0, 0.1), Vec3::Z, 0.7, 70, 45),
            occluder: Some(random_near_field(60, seed)),
            reflected: Vec::new(),
        }
    }

    fn rules(illuminates: bool, channels: Channels) -> RenderRules {
        RenderRules { illuminates, ..RenderRules::full(ShadingRules::PHYSICAL, PrefilterScheme::Exact, channels) }
    }

    fn picture(&self, lamps: Option<&[Lamp]>, rules: &RenderRules) -> Image<Vec<f32>> {
        let mut exec = CpuExecutor::new();
        let mut light = exec.prefilter(&self.environment, rules.scheme, rules.levels).expect("16 is a power of two");
        let occluder = self.occluder.as_ref().map(|near_field| {
            exec.upload_near_field(&near_field.with_values(near_field.values.as_slice())).expect("it is whole")
        });
        let occluder = occluder.as_ref().map(|surface| Occluder { surface, reflected: &self.reflected });
        if let Some(lamps) = lamps {
            light = exec.add_lamps(light, lamps, RAYS, occluder).expect("they can shine");
        }
        render_view(&mut exec, &self.gaussians, Some(&light), &self.camera, rules).expect("the CPU renders")
    }
}

/// A sun of a large disc, a point and a ball.
fn lamps() -> [Lamp; 3] {
    [
        sun(Vec3::new(0.5, -1.0, 0.8), 2.0, 0.2),
        ball(Vec3::new(1.5, -1.0, 1.0), 3.0, 0.0),
        ball(Vec3::new(-1.0, -1.5, 1.0), 3.0, 0.3),
    ]
}

fn colors(image: &Image<Vec<f32>>) -> Vec<f32> {
    (0..3).flat_map(|plane| image.plane(plane).to_vec()).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

#[test]
fn a_picture_under_lamps_is_that_of_the_plain_pipeline_in_every_layer() {
    let seeds = [(1, LightLayer::Reflected), (2, LightLayer::Irradiance), (3, LightLayer::Irradiance)];
    for (seed, light_layer) in seeds {
        let mut subject = Subject::new(seed);
        match seed {
            2 => subject.occluder = None,
            3 => {
                let (occluder, reflected) = lit_near_field(60, seed);
                (subject.occluder, subject.reflected) = (Some(occluder), reflected);
            }
            _ => {}
        }
        let rules = RenderRules { light_layer, ..Subject::rules(true, Channels::Layers) };
        let ours = wide(&subject.picture(Some(&lamps()), &rules).values);
        let operator = plain::Operator::new(RESOLUTION);
        let light = plain::prefilter::<Double>(&lift_environment(&subject.environment), &operator);
        let gaussians = lift_gaussians(&subject.gaussians);
        let exact = |light: plain::Light<Double>| {
            let frame = plain::render(&gaussians, Some(&light), &subject.camera, &rules);
            frame.values.iter().map(|x| x.0).collect::<Vec<f64>>()
        };
        let without = exact(light.clone());
        let lit = plain::Lamps {
            lamps: lamps().to_vec(),
            rays: RAYS,
            occluder: subject.occluder.clone(),
            reflected: subject.reflected.clone(),
        };
        let exact = exact(light.with_lamps(lit));
        println!("seed {seed}: {:.1} dB; without {:.1} dB", psnr(&ours, &exact), psnr(&ours, &without));
        assert_psnr(&ours, &exact, SAME_FRAME);
        assert!(psnr(&ours, &without) < 40.0, "lamps shine");
    }
}

/// Light that other surfaces reflect is that of the triangle below a pixel; without it, or of
/// zeros, no bit changes.
#[test]
fn reflected_light_is_added_to_what_lies_below_a_pixel() {
    let rules = Subject::rules(true, Channels::Color);
    let (occluder, reflected) = lit_near_field(60, 4);
    let mut subject = Subject { occluder: Some(occluder), ..Subject::new(4) };
    let picture = |subject: &Subject| colors(&subject.picture(Some(&lamps()), &rules));
    let without = picture(&subject);
    subject.reflected = vec![0.0; reflected.len()];
    assert!(picture(&subject) == without, "zeros change a bit");
    subject.reflected = reflected;
    let with = picture(&subject);
    assert!(with.iter().zip(&without).all(|(with, without)| with >= without), "light is added");
    let brighter = with.iter().zip(&without).filter(|(with, without)| **with > **without + 0.01).count();
    assert!(brighter > with.len() / 50, "{brighter} of {} numbers", with.len());
}

#[test]
fn invalid_reflected_light_is_refused() {
    assert_eq!([check_reflected(2, &[]), check_reflected(2, &[0.5; 6])], [Ok(()); 2]);
    for fault in [vec![0.5; 5], vec![0.5; 9], [vec![0.5; 5], vec![f32::NAN]].concat(), vec![f32::INFINITY; 6]] {
        assert_eq!(check_reflected(2, &fault), Err(LampError::Reflected), "{fault:?}");
    }
}

/// Lamps that are off, and rules without lamps, change no bit; channels that were not requested
/// change nothing either.
#[test]
fn black_lamps_and_channels_change_no_bit() {
    let subject = Subject::new(3);
    let [on, off] = [true, false].map(|illuminates| Subject::rules(illuminates, Channels::Color));
    let without = colors(&subject.picture(None, &off));
    let black = lamps().map(|lamp| match lamp {
        Lamp::Sun { direction, diameter, .. } => Lamp::Sun { direction, irradiance: [0.0; 3], diameter },
        Lamp::Sphere { position, radius, .. } => Lamp::Sphere { position, intensity: [0.0; 3], radius },
    });
    for (lamps, rules) in [(Some(&black[..]), &on), (Some(&lamps()[..]), &off), (None, &on), (Some(&[][..]), &on)] {
        let found = colors(&subject.picture(lamps, rules));
        assert!(found.iter().zip(&without).all(|(a, b)| a.to_bits() == b.to_bits()), "{lamps:?}");
    }
    let lit = colors(&subject.picture(Some(&lamps()), &on));
    assert_ne!(lit, without);
    assert_eq!(lit, colors(&subject.picture(Some(&lamps()), &Subject::rules(true, Channels::Layers))));
    assert_eq!(on.blended(subject.gaussians.layout), Channels::Layers, "albedo and depth");
    let view = RenderRules { shading: ShadingRules::DEFERRED, ..on };
    assert_eq!(view.blended(subject.gaussians.layout), Channels::Lit, "lamps light only materials");
}

/// Suns of a million and lamps within the scene, among surfaces with holes and without normals.
#[test]
fn pictures_under_any_lamps_are_finite() {
    let rules = Subject::rules(true, Channels::Layers);
    for seed in 7..10 {
        let mut subject = Subject::new(seed);
        let near_field = subject.occluder.as_mut().expect("there is one");
        near_field.vertices_mut().iter_mut().for_each(|vertex| vertex[3..6].fill(0.0));
        subject.gaussians.set(0, QUAT, [0.0; 4]);
        for lamps in [
            [sun(Vec3::new(0.1, -0.2, 1.0), 1e6, 0.0), sun(-Vec3::Z, LIGHT_MAX, 3.1)],
            [ball(Vec3::ZERO, LIGHT_MAX, 0.0), ball(Vec3::new(0.1, 0.0, 0.0), 1e6, 1.0)],
            [ball(subject.camera.position, 1e6, 0.5), ball(1e6 * Vec3::X, LIGHT_MAX, 1e3)],
        ] {
            let picture = subject.picture(Some(&lamps), &rules);
            assert!(picture.values.iter().all(|x| x.is_finite()), "{seed}: {lamps:?}");
        }
    }
}

/// A closed box keeps out all light.
#[test]
fn nothing_shines_into_a_closed_box() {
    let mut subject = Subject::new(11);
    subject.environment.values.fill(0.0);
    let mut walls = sphere_of(Vec3::ZERO, 3.0);
    // From within: rays hit only the fronts of triangles.
    let triangles = walls.triangles_start()..walls.vertices_start();
    walls.values[triangles].as_chunks_mut::<TRIANGLE_LEN>().0.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    subject.occluder = Some(walls);
    let rules = Subject::rules(true, Channels::Color);
    let [outside, inside] = [ball(5.0 * Vec3::Z, 1e6, 0.2), ball(1.5 * Vec3::Z, 1.0, 0.2)];
    let suns = [sun(Vec3::new(0.3, 0.4, 1.0), 1e6, 0.3), sun(Vec3::new(-0.3, 0.4, -1.0), 1e6, 0.0), outside];
    assert!(colors(&subject.picture(Some(&suns), &rules)).iter().all(|x| *x == 0.0), "the box is closed");
    assert!(colors(&subject.picture(Some(&[inside]), &rules)).iter().any(|x| *x > 0.1), "a lamp within shines");
}

#[test]
fn pictures_do_not_depend_on_threads() {
    let subject = Subject::new(5);
    let rules = Subject::rules(true, Channels::Color);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("there are threads");
        pool.install(|| subject.picture(Some(&lamps()), &rules))
    };
    let one = on(1);
    assert!(one.values.iter().zip(&on(3).values).all(|(a, b)| a.to_bits() == b.to_bits()));
}

/// Lamps light a dark scene; the plan includes them, and omits what they do not need.
#[test]
fn lamps_are_planned_for_in_the_dark() {
    let mut subject = Subject::new(6);
    subject.environment.values.fill(0.0);
    let asked = Subject::rules(false, Channels::Color);
    let needs = Needs::of(&subject.gaussians).under(Some(&subject.environment));
    let levels = Levels::new(asked.scheme, RESOLUTION);
    let plan = Plan::new(subject.gaussians.layout, &needs, Some(&levels), &asked);
    assert_eq!(plan.unlit, Some(Unlit::Dark));
    let lit = plan.illuminated(true);
    assert!(lit.unlit.is_none() && lit.rules.is_lit && lit.rules.illuminates && lit.full.illuminates);
    let [planned, full] = [lit.rules, lit.full].map(|rules| colors(&subject.picture(Some(&lamps()), &rules)));
    assert!(planned.iter().zip(&full).all(|(a, b)| a.to_bits() == b.to_bits()), "omissions change no bit");
    assert!(planned.iter().any(|x| *x > 0.1), "there is light");
    let dark = plan.illuminated(false);
    assert!(!dark.rules.is_lit && !dark.rules.illuminates && dark.unlit == Some(Unlit::Dark));
    assert!(colors(&subject.picture(Some(&lamps()), &dark.rules)).iter().all(|x| *x == 0.0));
}

/// Opaque plane z = 0 of albedo one half, seen from above, and nothing else.
fn plane(occluder: Option<NearField<Vec<f32>>>) -> Subject {
    const EDGE: usize = 61;
    const STEP: f32 = 0.1;
    let layout = Layout::shaded(None).physical();
    let count = EDGE * EDGE;
    let mut gaussians = Gaussians { count, layout, values: vec![0.0; len_of_values(count, layout)] };
    let first = layout.physical_planes().expect("materials are physical");
    for index in 0..count {
        let [x, y] = [index % EDGE, index / EDGE].map(|k| STEP * (k as f32 - 0.5 * (EDGE - 1) as f32));
        gaussians.set(index, MEAN, [x, y, 0.0]);
        gaussians.set(index, LOG_SCALE, [STEP.ln(), STEP.ln(), -9.0]);
        gaussians.set(index, QUAT, [1.0, 0.0, 0.0, 0.0]);
        gaussians.set(index, OPACITY, [logit(0.99)]);
        gaussians.set(index, ROUGHNESS, [logit(0.9)]);
        gaussians.set(index, first + ALBEDO, [0.0; 3]);
        gaussians.set(index, first + METALNESS, [-30.0]);
        gaussians.set(index, first + AMBIENT, [1.0; 3]);
    }
    let mut environment = random_environment(RESOLUTION, RadianceActivation::Identity, 1);
    environment.values.fill(0.0);
    let camera = Camera::look_at(8.0 * Vec3::Z, Vec3::ZERO, Vec3::Y, 0.6, 120, 120);
    Subject { gaussians, environment, camera, occluder, reflected: Vec::new() }
}

/// Sphere of triangles, whose faces are within 0.2 % of its radius.
fn sphere_of(center: Vec3, radius: f32) -> NearField<Vec<f32>> {
    const RINGS: u32 = 48;
    const AROUND: u32 = 96;
    let point = |ring: u32, segment: u32| {
        let (polar, around) = (PI * ring as f32 / RINGS as f32, 2.0 * PI * segment as f32 / AROUND as f32);
        center + radius * Vec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos())
    };
    let quads = (0..RINGS).flat_map(|ring| (0..AROUND).map(move |segment| (ring, segment)));
    let triangles = quads.flat_map(|(ring, segment)| {
        let [a, b] = [point(ring, segment), point(ring + 1, segment)];
        let [c, d] = [point(ring + 1, segment + 1), point(ring, segment + 1)];
        [([a, b, c], gray(0.5, 0.0, 1.0)), ([a, c, d], gray(0.5, 0.0, 1.0))]
    });
    of_triangles(&triangles.collect::<Vec<_>>())
}

/// Points of the plane in the pixels of a subject's picture.
fn points(camera: &Camera) -> Vec<Vec3> {
    let pixels = (0..camera.width * camera.height).map(|index| [index % camera.width, index / camera.width]);
    let world_from_camera = camera.camera_from_world.transpose();
    let point = |[x, y]: [u32; 2]| {
        let ray = world_from_camera * camera.ray_in_camera(x as f32 + 0.5, y as f32 + 0.5);
        camera.position - ray * (camera.position.z / ray.z)
    };
    pixels.map(point).collect()
}

/// Share of the light that shadows leave in each pixel.
fn shares(center: Vec3, radius: f32, lamp: Lamp) -> (Vec<f32>, Vec<Vec3>) {
    let open = plane(None);
    let shadowed = plane(Some(sphere_of(center, radius)));
    let rules = Subject::rules(true, Channels::Color);
    let [open_light, light] = [&open, &shadowed].map(|subject| {
        let image = subject.picture(Some(&[lamp]), &rules);
        image.plane(0).iter().map(|x| linear_from_srgb(*x)).collect::<Vec<f32>>()
    });
    assert!(open_light.iter().all(|x| *x > 0.01), "the plane is lit all over");
    (light.iter().zip(&open_light).map(|(light, open)| light / open).collect(), points(&open.camera))
}

/// Angle between the directions from a point to a sphere and to a lamp, and the angular radius of
/// the sphere.
fn angles(point: Vec3, center: Vec3, radius: f32, to_lamp: Vec3) -> [f32; 2] {
    let to_center = center - point;
    [to_center.angle_between(to_lamp), (radius / to_center.length()).asin()]
}

/// A sphere above a plane casts the shadow of geometry: an ellipse.
#[test]
fn the_shadow_of_a_sphere_on_a_plane_has_the_known_boundary() {
    /// A pixel of the picture is 0.04 wide, the shadow 1; the mesh of the sphere is inscribed.
    const IOU_MIN: f64 = 0.97;
    let (center, radius) = (Vec3::new(-0.3, 0.2, 1.0), 0.5);
    let sunlight = sun(Vec3::new(0.6, 0.3, 1.0), 3.0, 0.0);
    let point = ball(Vec3::new(0.8, 0.9, 3.0), 20.0, 0.0);
    for lamp in [sunlight, point] {
        let (shares, points) = shares(center, radius, lamp);
        let [mut both, mut any] = [0_u32; 2];
        for (share, at) in shares.iter().zip(points) {
            let to_lamp = match lamp {
                Lamp::Sun { direction, .. } => Vec3::from(direction),
                Lamp::Sphere { position, .. } => Vec3::from(position) - at,
            };
            let [between, sphere_radius] = angles(at, center, radius, to_lamp);
            let (ours, theirs) = (*share < 0.5, between < sphere_radius);
            both += u32::from(ours && theirs);
            any += u32::from(ours || theirs);
        }
        let iou = f64::from(both) / f64::from(any);
        println!("{lamp:?}: IoU {iou:.4} of {any} pixels");
        assert!(any > 300 && iou >= IOU_MIN, "{lamp:?}: {iou}");
    }
}

/// Shadows of wide lamps are dark in the umbra, grey in the penumbra and nowhere else.
#[test]
fn soft_shadows_have_the_known_umbra_and_penumbra() {
    let (center, radius, diameter) = (Vec3::new(-0.3, 0.2, 1.0), 0.5, 0.3);
    let direction = Vec3::new(0.6, 0.3, 1.0);
    let (shares, points) = shares(center, radius, sun(direction, 3.0, diameter));
    let mut counts = [0_u32; 3];
    let mut worst = 0.0_f32;
    for (share, at) in shares.iter().zip(points) {
        let [between, sphere_radius] = angles(at, center, radius, direction);
        // Half a pixel, as an angle from the plane.
        const MARGIN: f32 = 0.03;
        let expected = overlap(between, sphere_radius, 0.5 * diameter);
        if between > sphere_radius + 0.5 * diameter + MARGIN {
            assert!((share - 1.0).abs() < ROUNDING, "{share} in the light");
            counts[0] += 1;
        } else if between < sphere_radius - 0.5 * diameter - MARGIN {
            assert_eq!(*share, 0.0, "in the umbra");
            counts[1] += 1;
        } else {
            worst = worst.max((share - (1.0 - expected)).abs());
            counts[2] += 1;
        }
    }
    println!("{counts:?} pixels in light, umbra and penumbra; {worst} off at most");
    assert!(counts.iter().all(|count| *count > 100), "{counts:?}");
    // Rays in 32 equal areas, of which an edge cuts about six, and weights of rays.
    assert!(worst < 0.2, "{worst}");
}

/// Share of a disc of angular radius `b` that a disc of radius `a` covers, their centres this far
/// apart, all small.
fn overlap(apart: f32, a: f32, b: f32) -> f32 {
    if apart >= a + b {
        return 0.0;
    }
    if apart <= (a - b).abs() {
        return if a > b { 1.0 } else { (a / b).powi(2) };
    }
    let angle = |own: f32, other: f32| {
        ((apart * apart + own * own - other * other) / (2.0 * apart * own)).clamp(-1.0, 1.0).acos()
    };
    let segment = |radius: f32, angle: f32| radius * radius * (angle - 0.5 * (2.0 * angle).sin());
    (segment(a, angle(a, b)) + segment(b, angle(b, a))) / (PI * b * b)
}

#[test]
fn discs_overlap_as_geometry_says() {
    assert_eq!([overlap(3.0, 1.0, 1.0), overlap(0.1, 2.0, 1.0), overlap(0.0, 0.5, 1.0)], [0.0, 1.0, 0.25]);
    // A half-plane covers half.
    assert!((overlap(100.0, 100.0, 1.0) - 0.5).abs() < 0.01);
}
