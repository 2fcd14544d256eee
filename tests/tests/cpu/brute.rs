//! The plain pipeline, made of core's formulas, against a renderer that has none of them.

use specula_core::{
    antialias::LowPass,
    camera::Camera,
    double::Double,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Layout,
    shade::ShadingRules,
};
use specula_tests::{
    brute,
    compare::{assert_psnr, psnr},
    independent::{rays::RayView, surface::gaussians},
    plain::{composite, lift_gaussians, render},
    strategies::random_cloud,
};

/// Both compute the same picture in `f64`; what differs is core's constants of `f32`, 1e-8, which
/// is 160 dB. A single pixel on the wrong side of the cut at 1/255 would be 88 dB.
const SAME_PICTURE: f64 = 120.0;
const BACKGROUND: [f32; 3] = [0.1, 0.2, 0.3];

/// Both pictures of a scene: the plain pipeline's and the other's.
fn both(seed: u64, layout: Layout) -> [Vec<f64>; 2] {
    let (width, height) = (64, 48);
    let cloud = random_cloud(60, layout, seed);
    let position = glam::Vec3::new(2.0, -3.0, 1.5);
    let camera = Camera::look_at(position, glam::Vec3::new(0.2, 0.0, 0.1), glam::Vec3::Z, 0.7, width, height);
    let rules = RenderRules {
        sh_degree: layout.sh_degree,
        ..RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Color)
    };
    let frame = render::<Double>(&lift_gaussians(&cloud), None, &camera, &rules);
    let plain = composite(&frame, BACKGROUND).iter().map(|x| x.0).collect();

    let picture = brute::render(&gaussians(&cloud), &RayView::of(&camera), BACKGROUND.map(f64::from));
    [plain, [0, 1, 2].iter().flat_map(|c| picture.iter().map(|rgb| rgb[*c])).collect()]
}

#[test]
fn the_plain_pipeline_draws_what_an_independent_renderer_draws() {
    for (seed, degree) in [(1, 0), (2, 1), (3, 2), (4, 3)] {
        let layout = Layout::radiance(degree);
        let compensated = Layout { low_pass: LowPass::Compensated, ..layout };
        for layout in [layout, compensated, layout.antialiased()] {
            let [plain, independent] = both(seed, layout);
            println!("{layout:?}: {:.1} dB", psnr(&plain, &independent));
            assert_psnr(&plain, &independent, SAME_PICTURE);
        }
    }
}

#[test]
fn another_scene_is_another_picture() {
    let ([plain, _], [_, other]) = (both(1, Layout::radiance(3)), both(2, Layout::radiance(3)));
    assert!(psnr(&plain, &other) < 40.0, "two random scenes do not look alike");
    let [filtered, _] = both(1, Layout::radiance(3).antialiased());
    assert!(psnr(&plain, &filtered) < 40.0, "filters are seen");
}
