//! Pictures in the command encoder of another program.

use core::array;
use specula_core::{
    executor::Renderer,
    pack::Storage,
    pipeline::render,
    prefilter::PrefilterScheme,
    rules::{Channels, RenderRules},
    scene::Layout,
    shade::ShadingRules,
};
use specula_gpu::{Frame, Gpu, GpuError, GpuExecutor};
use specula_oracle::scenes::camera;
use specula_tests::{device::executor, strategies::random_cloud};

const SIZE: u32 = 48;

fn rules() -> RenderRules {
    let rules = RenderRules::full(ShadingRules::PAPER, PrefilterScheme::Exact, Channels::Layers);
    RenderRules { is_lit: false, ..rules }
}

fn viewer(gpu: &Gpu) -> GpuExecutor<Storage> {
    GpuExecutor::viewer(gpu.clone(), Storage::F32)
}

fn planes(exec: &mut GpuExecutor<Storage>, frame: &Frame) -> Vec<f32> {
    let mut planes = vec![0.0; (Channels::Layers.count() + 1) * (SIZE * SIZE) as usize];
    exec.read_frame(frame, &mut planes).expect("the frame has that size");
    planes
}

#[test]
fn recorded_pictures_wait_for_nothing_and_have_the_same_bits() {
    let Some(gpu) = executor().map(|exec| exec.gpu().clone()) else { return };
    let clouds: [_; 3] = array::from_fn(|seed| random_cloud(200, Layout::radiance(1), seed as u64));
    let camera = camera(SIZE, SIZE);

    let mut waiting = viewer(&gpu);
    let expected = clouds.each_ref().map(|cloud| {
        let scene = waiting.upload_gaussians(cloud).expect("it fits");
        let frame = render(&mut waiting, &scene, None, &camera, &rules()).expect("it is rendered");
        planes(&mut waiting, &frame)
    });

    let mut exec = viewer(&gpu);
    exec.read_later();
    let scenes = clouds.each_ref().map(|cloud| exec.upload_gaussians(cloud).expect("it fits"));
    let mut incomplete = 0;
    let frames = loop {
        let waits = exec.gpu().waits();
        // Several pictures have more kernels than a submission of the executor's own.
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        let frames: Vec<Frame> = exec
            .record(&mut encoder, |exec| {
                scenes.each_ref().map(|scene| render(exec, scene, None, &camera, &rules())).into_iter().collect()
            })
            .expect("it is recorded");
        assert_eq!(exec.gpu().waits(), waits, "nothing waits");
        gpu.queue().submit([encoder.finish()]);
        let status = exec.frame_status_later().expect("it is asked for");
        exec.finish().expect("the device is there");
        let status = pollster::block_on(status).expect("the device is done");
        if status.is_complete {
            break frames;
        }
        incomplete += 1;
        assert!(incomplete <= 3, "a granted capacity suffices");
        exec.grant(status.capacity);
    };
    assert!(incomplete > 0, "the first frame has no capacity");
    for (frame, expected) in frames.iter().zip(&expected) {
        assert!(planes(&mut exec, frame) == *expected, "a recorded picture differs");
    }
    // What is not recorded is submitted as before.
    let frame = render(&mut exec, &scenes[0], None, &camera, &rules()).expect("it is rendered");
    assert!(planes(&mut exec, &frame) == expected[0], "a later picture differs");
}

#[test]
fn results_before_the_submission_are_refused() {
    let Some(gpu) = executor().map(|exec| exec.gpu().clone()) else { return };
    let cloud = random_cloud(20, Layout::radiance(0), 1);
    let camera = camera(SIZE, SIZE);
    let mut exec = viewer(&gpu);
    let scene = exec.upload_gaussians(&cloud).expect("it fits");
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    // Pairs are counted first, since nothing was granted.
    let counted = exec.record(&mut encoder, |exec| render(exec, &scene, None, &camera, &rules()));
    assert_eq!(counted.expect_err("counts are read").to_string(), GpuError::NotSubmitted.to_string());
    let nested = exec.record(&mut encoder, |exec| {
        let mut other = gpu.device().create_command_encoder(&Default::default());
        exec.record(&mut other, |_| Ok(()))
    });
    assert_eq!(nested, Err(GpuError::NotSubmitted));
    assert_eq!(exec.record(&mut encoder, GpuExecutor::finish), Err(GpuError::NotSubmitted));
    // Later pictures are rendered as before.
    let frame = render(&mut exec, &scene, None, &camera, &rules()).expect("it is rendered");
    assert!(planes(&mut exec, &frame).iter().any(|x| *x != 0.0), "the picture is black");
}
