//! Empty scenes and pictures.

use specula_core::{
    executor::Renderer,
    pipeline::render,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    shade::ShadingRules,
};
use specula_cpu::CpuExecutor;
use specula_tests::{
    formulas::camera,
    strategies::random_cloud,
    stress::{LAYOUT, every_case, results::Results},
};

/// Index of the normal loss among the losses.
const NORMAL: usize = 4;

#[test]
fn an_empty_picture_has_no_normal_loss_and_no_gradient_through_it() {
    let mut exec = CpuExecutor::new();
    for name in ["everything behind the eye", "no Gaussians"] {
        let case = every_case().into_iter().find(|case| case.name == name).expect("a case of that name");
        let results = Results::new(&mut exec, &case, ShadingRules::PAPER);
        assert_eq!(results.losses[NORMAL], 0.0, "{name}");
        assert!(results.losses.iter().all(|x| x.is_finite()), "{name}: {:?}", results.losses);
        let count = case.cloud.count;
        let moved = results.gradient[..10 * count].iter().filter(|x| **x != 0.0).count();
        assert_eq!(moved, 0, "{name}: nothing in a picture, nothing to move it");
    }
}

#[test]
fn pictures_without_gaussians_or_pixels_are_empty() {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Training);
    let mut exec = CpuExecutor::new();
    for (width, height, count) in [(48, 32, 0), (1, 1, 0), (1, 1, 60), (0, 32, 60), (48, 0, 60), (0, 0, 0)] {
        let mut camera = camera(48, 32);
        (camera.width, camera.height) = (width, height);
        let frame = render(&mut exec, &random_cloud(count, LAYOUT, 1), None, &camera, &rules).expect("the CPU renders");
        let size = (width * height) as usize;
        let mut values = vec![-1.0; 9 * size];
        exec.read_frame(&frame, &mut values).expect("the frame has that size");
        assert!(values.iter().all(|x| x.is_finite() && *x != -1.0), "{width} × {height}, {count} Gaussians");
        if count == 0 {
            assert!(values[8 * size..].iter().all(|passed| *passed == 1.0), "the background shines through");
        }
    }
}
