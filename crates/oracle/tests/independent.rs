//! The renderer that shares no formula with core: against the pipeline, and its invariants.

use glam::{DMat3, DQuat, DVec3};
use specula_core::{
    antialias::LowPass,
    cutoffs::Cutoffs,
    double::Double,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::{Environment, Gaussians, LOG_SCALE, Layout, MEAN, RadianceActivation},
    shade::ShadingRules,
};
use specula_oracle::{
    self as oracle,
    independent::{
        LightPer,
        lobe::{CubeMap, filtered},
        rays::{self, Gaussian, Order, RayView, blend},
        render,
        surface::{Look, gaussians},
    },
    scenes::{camera, random_cloud, random_environment},
};

/// Core's constants have 32 bits: the exponent is off by a few parts in a hundred million, and so
/// is what depends on it.
const CONSTANTS_OF_CORE: f64 = 2e-7;
/// A few roundings of `f64`.
const ROUNDING: f64 = 1e-11;
const SIZE: [u32; 2] = [40, 30];
const ORDERS: [Order; 3] = [Order::Mean, Order::Distance, Order::Response];

/// A cloud whose Gaussians are larger by a factor.
fn cloud(layout: Layout, seed: u64, larger: f32) -> Gaussians<Vec<f32>> {
    let mut cloud = random_cloud(60, layout, seed);
    for k in 0..cloud.count {
        cloud.set(k, LOG_SCALE, cloud.get::<3>(k, LOG_SCALE).map(|scale| scale + larger.ln()));
    }
    cloud
}

fn view() -> RayView {
    RayView::of(&camera(SIZE[0], SIZE[1]))
}

/// The pipeline's colours and transmittance, along rays, nothing cut off.
fn pipeline(cloud: &Gaussians<Vec<f32>>, light: Option<&oracle::Light<Double>>, shading: ShadingRules) -> Vec<f64> {
    let rules = RenderRules {
        sh_degree: cloud.layout.sh_degree,
        ..RenderRules::full(shading, PrefilterScheme::Exact, Channels::Color)
    };
    let lifted = oracle::lift_gaussians(cloud);
    let frame = oracle::render_within(&lifted, light, &camera(SIZE[0], SIZE[1]), &rules, &Cutoffs::REFERENCE);
    let (size, last) = (frame.pixel_count(), frame.channels - 1);
    let planes = [0, 1, 2, last].map(|plane| &frame.values[plane * size..(plane + 1) * size]);
    planes.concat().iter().map(|x| x.0).collect()
}

fn no_light(_: DVec3, _: f64) -> DVec3 {
    DVec3::ZERO
}

fn largest_difference(one: &[f64], other: &[f64]) -> f64 {
    assert_eq!(one.len(), other.len(), "pictures of one size");
    let differences = one.iter().zip(other).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |most, x| if x.is_nan() { f64::INFINITY } else { x.max(most) })
}

#[test]
fn in_one_order_the_renderer_draws_the_pictures_of_the_pipeline() {
    for (seed, degree) in [(1, 0), (2, 1), (3, 2), (4, 3)] {
        let plain = Layout::radiance(degree);
        let compensated = Layout { low_pass: LowPass::Compensated, ..plain };
        for layout in [plain, compensated, plain.antialiased()] {
            let cloud = cloud(layout, seed, 1.0);
            let own = render(&gaussians(&cloud), &no_light, LightPer::Gaussian, &view(), Order::Mean);
            let difference = largest_difference(&own.values, &pipeline(&cloud, None, ShadingRules::PAPER));
            println!("{layout:?}: {difference:.1e}");
            assert!(difference < CONSTANTS_OF_CORE, "{difference:e}");
            let other = pipeline(&self::cloud(layout, seed + 1, 1.0), None, ShadingRules::PAPER);
            assert!(largest_difference(&own.values, &other) > 0.1, "another scene is another picture");
        }
    }
}

/// Gaussians one behind the other, small beside what lies between them, so that there is but one
/// order.
fn queue() -> Gaussians<Vec<f32>> {
    let mut cloud = cloud(Layout::radiance(1), 5, 1.0);
    let (eye, target) = (glam::Vec3::new(2.0, -3.0, 1.5), glam::Vec3::new(0.2, 0.0, 0.1));
    for k in 0..cloud.count {
        let place = eye + (target - eye).normalize() * (2.0 + 0.3 * k as f32);
        let aside = glam::Vec3::from_array(cloud.get(k, MEAN)) * 0.1;
        cloud.set(k, MEAN, (place + aside).to_array());
        cloud.set(k, LOG_SCALE, [-3.0, -3.1, -3.3]);
    }
    cloud
}

#[test]
fn pictures_agree_where_orders_agree() {
    let cloud = queue();
    let of = |order| render(&gaussians(&cloud), &no_light, LightPer::Gaussian, &view(), order).values;
    let pipeline = pipeline(&cloud, None, ShadingRules::PAPER);
    assert!(pipeline[3 * 1200..].iter().any(|passed| *passed < 0.01), "they cover one another");
    for order in ORDERS {
        let difference = largest_difference(&of(order), &pipeline);
        println!("{order:?}: {difference:.1e}");
        assert!(difference < CONSTANTS_OF_CORE, "{order:?}: {difference:e}");
    }
}

/// Light that is the same from everywhere needs no filter, and every way of shading shows it.
#[test]
fn both_renderers_shade_surfaces_by_the_paper() {
    let cloud = cloud(Layout::shaded(Some(2)), 6, 1.0);
    let constant = Environment { resolution: 16, activation: RadianceActivation::Identity, values: vec![1.7; 6 * 768] };
    let operator = oracle::Operator::finer(16, 1);
    let light = oracle::prefilter(&oracle::lift_environment(&constant), &operator);
    for (shading, light_per) in [(ShadingRules::PAPER, LightPer::Gaussian), (ShadingRules::DEFERRED, LightPer::Pixel)] {
        let bright = |_: DVec3, _: f64| DVec3::splat(f64::from(1.7_f32));
        let own = render(&gaussians(&cloud), &bright, light_per, &view(), Order::Mean);
        let difference = largest_difference(&own.values, &pipeline(&cloud, Some(&light), shading));
        println!("{light_per:?}: {difference:.1e}");
        assert!(difference < 10.0 * CONSTANTS_OF_CORE, "{light_per:?}: {difference:e}");
    }
}

/// Levels of light are a few hundredths from the integral; a random light is the hardest.
#[test]
fn filtered_light_is_close_to_light_by_quadrature() {
    const RESOLUTION: usize = 16;
    let cloud = cloud(Layout::shaded(None), 7, 1.0);
    let environment = random_environment(RESOLUTION, RadianceActivation::Identity, 8);
    let operator = oracle::Operator::finer(RESOLUTION, 2);
    let light = oracle::prefilter(&oracle::lift_environment(&environment), &operator);
    let texels = environment.values.chunks_exact(3).map(|texel| [0, 1, 2].map(|c| f64::from(texel[c]))).collect();
    let map = CubeMap { resolution: RESOLUTION, texels };
    let by_quadrature = |direction: DVec3, roughness: f64| {
        DVec3::from_array(filtered(|light_dir| map.sample(light_dir), direction.into(), roughness, RESOLUTION))
    };
    let own = render(&gaussians(&cloud), &by_quadrature, LightPer::Gaussian, &view(), Order::Mean);
    let difference = largest_difference(&own.values, &pipeline(&cloud, Some(&light), ShadingRules::PAPER));
    println!("filtered light: {difference:.1e}");
    assert!(difference < 0.02 && difference > CONSTANTS_OF_CORE, "{difference}");
}

/// Two long Gaussians that cross: the one whose mean is nearer is behind on one side.
fn crossing() -> (Vec<Gaussian>, Vec<Vec<f64>>) {
    let long = |turn: f64, depth: f64| Gaussian {
        mean: DVec3::new(0.0, 0.0, depth),
        axes: DMat3::from_rotation_y(turn) * DMat3::from_diagonal(DVec3::new(0.8, 0.3, 0.02)),
        opacity: 0.95,
        low_pass: rays::LowPass::INRIA,
    };
    (vec![long(0.5, 3.0), long(-0.5, 3.01)], vec![vec![1.0, 0.0], vec![0.0, 1.0]])
}

/// Looks along +z from the origin.
fn straight() -> RayView {
    RayView {
        camera_from_world: DMat3::IDENTITY,
        position: DVec3::ZERO,
        focal_px: [40.0, 40.0],
        principal_px: [20.0, 15.0],
        near: 0.2,
        size: [40, 30],
    }
}

#[test]
fn crossing_gaussians_swap_their_order_at_the_crossing() {
    let (gaussians, channels) = crossing();
    let [mean, distance, response] = ORDERS.map(|order| blend(&gaussians, &channels, &straight(), order));
    let (left, right) = (15 * 40 + 14, 15 * 40 + 25);
    for one_order in [&mean, &distance] {
        for pixel in [left, right] {
            assert!(one_order.values[pixel] > one_order.values[1200 + pixel], "the nearer mean is in front everywhere");
        }
    }
    // Turned about y by half a radian, the first is farther away on the left.
    let [left, right] = [left, right].map(|pixel| response.values[pixel] - response.values[1200 + pixel]);
    assert!(left * right < 0.0, "each is in front on one side: {left} and {right}");
    assert!(largest_difference(&mean.values, &response.values) > 0.3, "and that is seen");
}

#[test]
fn the_order_of_the_list_changes_nothing() {
    let (cloud, view) = (cloud(Layout::radiance(2), 9, 1.5), view());
    let scene = gaussians(&cloud);
    let backwards: Vec<(Gaussian, Look)> = scene.iter().rev().cloned().collect();
    for order in ORDERS {
        let [one, other] =
            [&scene, &backwards].map(|scene| render(scene, &no_light, LightPer::Gaussian, &view, order).values);
        assert_eq!(one, other, "{order:?}");
    }
}

#[test]
fn weights_and_transmittance_sum_to_one() {
    let scene = gaussians(&cloud(Layout::radiance(0), 10, 2.0));
    let own: Vec<Gaussian> = scene.iter().map(|(gaussian, _)| *gaussian).collect();
    for order in ORDERS {
        let picture = blend(&own, &vec![vec![1.0]; own.len()], &view(), order);
        let (weights, passed) = picture.values.split_at(picture.pixel_count());
        for (weights, passed) in weights.iter().zip(passed) {
            assert!(
                (weights + passed - 1.0).abs() < ROUNDING && (0.0..=1.0).contains(passed),
                "{weights} and {passed}"
            );
        }
        assert!(passed.iter().any(|passed| *passed < 0.01), "something is covered");
    }
}

#[test]
fn turning_the_whole_world_changes_nothing() {
    let (scene, view) = (gaussians(&cloud(Layout::radiance(0), 11, 1.5)), view());
    let turn = DMat3::from_quat(DQuat::from_xyzw(0.3, -0.5, 0.2, 0.8).normalize());
    let turned = |(own, look): &(Gaussian, Look)| {
        (Gaussian { mean: turn * own.mean, axes: turn * own.axes, ..*own }, look.clone())
    };
    let turned: Vec<_> = scene.iter().map(turned).collect();
    let other = RayView {
        camera_from_world: view.camera_from_world * turn.transpose(),
        position: turn * view.position,
        ..view
    };
    for order in ORDERS {
        let before = render(&scene, &no_light, LightPer::Gaussian, &view, order).values;
        let after = render(&turned, &no_light, LightPer::Gaussian, &other, order).values;
        let difference = largest_difference(&before, &after);
        assert!(difference < ROUNDING, "{order:?}: {difference:e}");
    }
}

/// A camera that turns in its place sees along a ray what it saw there before, in the same order:
/// nothing pops. By the depth of means it does, because depths change.
#[test]
fn turning_the_camera_pops_only_in_the_order_of_means() {
    let (mut gaussians, channels) = crossing();
    gaussians[0].mean.x = -0.1;
    gaussians[1].mean.x = 0.1;
    let apart = |order| {
        let mut most = 0.0_f64;
        for step in -20..20 {
            let turned = |step: f64| RayView {
                camera_from_world: DMat3::from_rotation_y(1e-3 * step),
                // The same ray, of so narrow a pixel that the low-pass is nothing.
                focal_px: [1e6, 1e6],
                principal_px: [0.5 - 1e6 * (1e-3 * step + 0.12).tan(), 0.5],
                size: [1, 1],
                ..straight()
            };
            let [one, next] = [0.0, 1.0]
                .map(|k| blend(&gaussians, &channels, &turned(4.0 * f64::from(step) + 4.0 * k), order).values);
            most = most.max(largest_difference(&one, &next));
        }
        most
    };
    let [mean, distance, response] = ORDERS.map(apart);
    assert!(mean > 0.3, "it pops: {mean}");
    assert!(distance < 1e-3 && response < 1e-3, "{distance} and {response}");
}

#[test]
fn responses_behind_the_eye_or_the_near_plane_are_skipped_in_their_pixels() {
    let ball = |mean: DVec3| Gaussian {
        mean,
        axes: DMat3::from_diagonal(DVec3::splat(0.3)),
        opacity: 0.9,
        low_pass: rays::LowPass::INRIA,
    };
    let drawn = |mean: DVec3, order: Order| {
        let picture = blend(&[ball(mean)], &[vec![1.0]], &straight(), order);
        picture.values[..1200].iter().filter(|weight| **weight > 0.0).count()
    };
    for behind in [-2.0, 0.0, 0.15] {
        assert_eq!(drawn(DVec3::new(0.0, 0.0, behind), Order::Mean), 0, "means decide at {behind}");
    }
    assert_eq!(drawn(DVec3::new(0.0, 0.0, -2.0), Order::Response), 0, "nothing of it is in front");
    // Beside the eye, a little behind it: rays to its side are nearest to its mean in front of the
    // eye.
    let beside = DVec3::new(2.0, 0.0, -0.1);
    assert_eq!(drawn(beside, Order::Mean), 0, "its mean is behind");
    let seen = drawn(beside, Order::Response);
    assert!(seen > 0 && seen < 1200, "some rays come nearest beyond the near plane: {seen}");
}

/// The renderer is written again and must not depend on core: it only uses types of scenes.
#[test]
fn the_renderer_uses_only_scenes_and_cameras_of_core() {
    let sources = [
        include_str!("../src/independent.rs"),
        include_str!("../src/independent/rays.rs"),
        include_str!("../src/independent/surface.rs"),
        include_str!("../src/independent/sphere.rs"),
        include_str!("../src/independent/lobe.rs"),
        include_str!("../src/independent/brdf.rs"),
    ];
    for rest in sources.iter().flat_map(|source| source.split("specula_core").skip(1)) {
        let is_type =
            ["::scene", "::camera", "::{camera::Camera, scene::Image}"].iter().any(|own| rest.starts_with(own));
        assert!(is_type, "specula_core{}", rest.lines().next().unwrap_or_default());
    }
    assert!(sources.iter().all(|source| !source.contains("use crate::{")), "nor anything of the plain pipeline");
}
