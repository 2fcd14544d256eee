//! Gradients of pictures under any cotangent on the device, against the CPU executor.

use specula_core::{
    executor::{OnScreen, ReadBack, Renderer},
    pipeline::{Gradients, Tape, render_and_camera_vjp, render_colors_taped, render_taped, render_vjp},
    prefilter::PrefilterScheme,
    random,
    rules::{Channels, RenderRules},
    scene::{Environment, Layout, RadianceActivation},
    shade::ShadingRules,
    splat::SplatGrad,
};
use specula_cpu::CpuExecutor;
use specula_gpu::GpuError;
use specula_tests::{
    compare::assert_all_close,
    device::{executor, executor_in_chunks_of},
    formulas::camera,
    strategies::{random_cloud, random_environment},
};

/// Gradients of a small picture in `f32`, relative to the largest of their kind: a pixel on the
/// other side of the cut at 1/255 makes a few in ten thousand.
const SAME_GRADIENT: f64 = 1e-3;
/// Positions and extents on the screen: a few roundings of projection.
const SAME_SPLAT: f64 = 1e-5;
const COUNT: usize = 60;
const SIZE: usize = 40;

/// Results of an executor: splats, their gradients, those of three channels, of Gaussians and of
/// the light.
struct Results {
    splats: Vec<f64>,
    splat_grads: Vec<f64>,
    channel_grads: Vec<f64>,
    gaussians: Vec<f64>,
    environment: Vec<f64>,
}

fn wide(values: impl IntoIterator<Item = f32>) -> Vec<f64> {
    values.into_iter().map(f64::from).collect()
}

fn rules(shading: ShadingRules) -> RenderRules {
    RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training)
}

/// Colours of the caller for plain Gaussians, a light for shaded ones.
fn results<E: ReadBack>(exec: &mut E, layout: Layout) -> Results {
    let cloud = random_cloud(COUNT, layout, 3);
    let gaussians = exec.upload_gaussians(&cloud).expect("it fits");
    let light = random_environment(16, RadianceActivation::Exponential, 3);
    let values = exec.upload(&light.values).expect("it fits");
    let environment = Environment { resolution: light.resolution, activation: light.activation, values };
    let environment = Some(&environment).filter(|_| layout.is_shaded());
    let rules = rules(ShadingRules::DEFERRED);
    let camera = camera(SIZE as u32, SIZE as u32);
    let draw = |seed: u64, k: usize| 2.0 * random::uniform(seed, 1, k as u64) - 1.0;
    let tape: Tape<E> = if layout.is_shaded() {
        render_taped(exec, &gaussians, environment, None, &camera, &rules)
    } else {
        let rgb: Vec<[f32; 3]> = (0..COUNT).map(|k| [0, 1, 2].map(|c| draw(4, 3 * k + c))).collect();
        render_colors_taped(exec, &gaussians, &rgb, &camera, &rules)
    }
    .expect("it renders");
    let planes = tape.rules.blended(layout).count() + 1;
    let cotangent: Vec<f32> = (0..planes * SIZE * SIZE).map(|k| draw(5, k)).collect();
    let cotangent = exec.upload_frame_grad(&tape.frame, &cotangent).expect("the planes fit");
    let gradients = render_vjp(exec, &tape, &gaussians, environment, cotangent).expect("it derives");
    let Gradients { gaussians: grad, environment: light_grad, splats } = gradients;

    let mut screens = vec![OnScreen::default(); COUNT];
    exec.read_splats(&tape.splats, &mut screens).expect("one for each");
    let none = SplatGrad { mean2d: [0.0; 2], root_conic: [0.0; 3], depth: 0.0, opacity: 0.0 };
    let mut splat_grads = vec![none; COUNT];
    exec.read_splat_grads(&splats, &mut splat_grads).expect("one for each");
    let mut channel_grads = vec![0.0; 3 * COUNT];
    exec.read_channel_grads(&splats, 0..3, &mut channel_grads).expect("they come back");
    let mut values = vec![0.0; cloud.values.len()];
    exec.download(&grad.values, &mut values).expect("they come back");
    let mut texels = vec![0.0; light_grad.as_ref().map_or(0, |_| light.values.len())];
    light_grad.iter().for_each(|grad| exec.download(grad, &mut texels).expect("they come back"));
    let on_screen = |screen: &OnScreen| {
        let OnScreen { mean2d: [x, y], half_extent: [w, h], depth, opacity } = *screen;
        [x, y, w, h, depth, opacity]
    };
    let grads = |grad: &SplatGrad<f32>| {
        let ([x, y], [xx, yx, yy]) = (grad.mean2d, grad.root_conic);
        [x, y, xx, yx, yy, grad.opacity]
    };
    let grad = grad.with_values(values);
    let planes = 0..layout.plane_count();
    Results {
        splats: wide(screens.iter().flat_map(on_screen)),
        splat_grads: wide(splat_grads.iter().flat_map(grads)),
        channel_grads: wide(channel_grads),
        gaussians: wide(planes.flat_map(|plane| grad.plane(plane).collect::<Vec<f32>>())),
        environment: wide(texels),
    }
}

#[test]
fn gradients_under_any_cotangent_are_those_of_the_cpu() {
    let Some(mut gpu) = executor() else { return };
    for layout in [Layout { sh_degree: None, ..Layout::radiance(0) }, Layout::shaded(Some(1))] {
        let (found, expected) = (results(&mut gpu, layout), results(&mut CpuExecutor::new(), layout));
        assert_all_close(&found.splats, &expected.splats, SAME_SPLAT);
        assert_all_close(&found.splat_grads, &expected.splat_grads, SAME_GRADIENT);
        assert_all_close(&found.channel_grads, &expected.channel_grads, SAME_GRADIENT);
        assert_all_close(&found.gaussians, &expected.gaussians, SAME_GRADIENT);
        assert_eq!(expected.environment.is_empty(), !layout.is_shaded(), "only a light has a gradient");
        assert_all_close(&found.environment, &expected.environment, SAME_GRADIENT);
        let largest = expected.splat_grads.iter().fold(0.0, |largest, x| f64::max(largest, x.abs()));
        assert!(largest > 0.1, "splats have gradients");
    }
}

/// Gradient of the camera under a random cotangent, and those of the Gaussians with and without it.
fn camera_grad<E: ReadBack>(exec: &mut E, layout: Layout) -> (Vec<f64>, [Vec<f32>; 2]) {
    // More than a workgroup.
    let cloud = random_cloud(5 * COUNT, layout, 6);
    let gaussians = exec.upload_gaussians(&cloud).expect("it fits");
    let light = random_environment(16, RadianceActivation::Exponential, 3);
    let values = exec.upload(&light.values).expect("it fits");
    let environment = Environment { resolution: light.resolution, activation: light.activation, values };
    let environment = Some(&environment).filter(|_| layout.is_shaded());
    let camera = camera(SIZE as u32, SIZE as u32);
    let rules = rules(ShadingRules::PAPER);
    let tape = render_taped(exec, &gaussians, environment, None, &camera, &rules).expect("it renders");
    let planes = tape.rules.blended(layout).count() + 1;
    let numbers = (planes * SIZE * SIZE) as u64;
    let cotangent: Vec<f32> = (0..numbers).map(|k| 2.0 * random::uniform(5, 1, k) - 1.0).collect();
    let upload = |exec: &mut E| exec.upload_frame_grad(&tape.frame, &cotangent).expect("the planes fit");
    let one = upload(exec);
    let (moving, grad) = render_and_camera_vjp(exec, &tape, &gaussians, environment, one).expect("it derives");
    let another = upload(exec);
    let still = render_vjp(exec, &tape, &gaussians, environment, another).expect("it derives");
    let gaussians = [moving, still].map(|gradients| {
        let mut values = vec![0.0; cloud.values.len()];
        exec.download(&gradients.gaussians.values, &mut values).expect("they come back");
        values
    });
    (grad.rows().into_iter().flat_map(|row| row.to_array().map(|x| x.0)).collect(), gaussians)
}

#[test]
fn the_gradient_of_the_camera_is_that_of_the_cpu() {
    for layout in [Layout::radiance(1), Layout::shaded(Some(1))] {
        // Blocks of 16 Gaussians, so that a chunk is smaller than a workgroup or takes several.
        let chunks = [64, 272, 1 << 20].map(|count| 4 * count * layout.plane_count() as u64);
        for bytes in chunks {
            let Some(mut gpu) = executor_in_chunks_of(bytes) else { return };
            let (found, [moving, still]) = camera_grad(&mut gpu, layout);
            assert!(moving == still, "the camera changes no bit of the others");
            let (expected, _) = camera_grad(&mut CpuExecutor::new(), layout);
            for part in [0..9, 9..12] {
                assert_all_close(&found[part.clone()], &expected[part], SAME_GRADIENT);
            }
            assert!(expected.iter().all(|x| x.abs() > 1e-3), "the camera has a gradient: {expected:?}");
        }
    }
}

#[test]
fn cameras_of_light_added_pixel_by_pixel_are_refused_by_name() {
    let Some(mut gpu) = executor() else { return };
    let gaussians = gpu.upload_gaussians(&random_cloud(COUNT, Layout::shaded(None), 4)).expect("it fits");
    let light = random_environment(16, RadianceActivation::Exponential, 3);
    let values = gpu.upload(&light.values).expect("it fits");
    let environment = Environment { resolution: light.resolution, activation: light.activation, values };
    let (camera, rules) = (camera(SIZE as u32, SIZE as u32), rules(ShadingRules::DEFERRED));
    let tape = render_taped(&mut gpu, &gaussians, Some(&environment), None, &camera, &rules).expect("it renders");
    let planes = vec![0.0; (tape.rules.blended(Layout::shaded(None)).count() + 1) * SIZE * SIZE];
    let cotangent = gpu.upload_frame_grad(&tape.frame, &planes).expect("the planes fit");
    let refused = render_and_camera_vjp(&mut gpu, &tape, &gaussians, Some(&environment), cotangent).err();
    assert!(matches!(refused, Some(GpuError::Unsupported(_))), "{refused:?}");
}
