#[path = "../../benches/src/lib.rs"]
#[allow(dead_code, warnings)]
mod bench;
use specula_core::{executor::*, loss::*, plan::Channels, prefilter::*, scene::*, shade::ShadingRules};
use specula_gpu::{GpuExecutor, blend_vjp::FrameGrad};
use specula_tests::device::executor;
use std::time::Instant;

#[test]
fn time() {
    let Some(mut gpu) = executor() else { return };
    let gpu = &mut gpu;
    let size: u32 = std::env::var("SIZE").map_or(800, |s| s.parse().unwrap());
    let profile = specula_train::profile::by_name("specula").unwrap();
    let cloud = bench::torus(100_000, &profile);
    let camera = bench::camera(size);
    let shading = match std::env::var("FORM").as_deref() {
        Ok("paper") => ShadingRules::PAPER,
        _ => ShadingRules::DEFERRED,
    };
    let rules = RenderRules::full(shading, PrefilterScheme::Exact, Channels::Training);
    let layout = cloud.layout;
    let up = Gaussians { count: cloud.count, layout, values: gpu.upload(&cloud.values).unwrap() };
    let light = match std::env::var("LIT") {
        Ok(_) => {
            let e = bench::environment(128);
            let e = Environment {
                resolution: e.resolution,
                activation: e.activation,
                values: gpu.upload(&e.values).unwrap(),
            };
            Some(gpu.prefilter(&e, PrefilterScheme::Exact, LevelRange::ALL).unwrap())
        }
        _ => None,
    };
    let channels = rules.blended(layout).count();
    let grad: Vec<f32> = (0..(channels + 1) * (size * size) as usize)
        .map(|k| ((k * 2654435761usize) % 1000) as f32 / 500.0 - 1.0)
        .collect();
    let grad = FrameGrad::new([size as usize; 2], channels, gpu.upload(&grad).unwrap());
    let w = LossWeights {
        absolute: 0.0,
        squared: 0.0,
        dssim: 0.0,
        normal: 0.0,
        normal_form: NormalForm::Cosine,
        sparse_coverage: 0.0,
        residual_image: 0.0,
        coverage: 0.0,
        sparse: 0.1,
        residual: 0.1,
    };
    let mut m = Moments {
        mean: gpu.upload(&vec![0.0; cloud.values.len()]).unwrap(),
        square: gpu.upload(&vec![0.0; cloud.values.len()]).unwrap(),
    };
    let mut up = up;
    for round in 0..4 {
        let mut t = Instant::now();
        let splats = gpu.project(&up, &camera).unwrap();
        lap2(gpu, round, "project", &mut t);
        let colors = gpu.shade(&up, &camera, &splats, light.as_ref(), &rules).unwrap();
        lap2(gpu, round, "shade", &mut t);
        let tiles = gpu.bin(&splats, &camera).unwrap();
        lap2(gpu, round, "bin", &mut t);
        let frame = gpu.blend(&splats, &colors, &tiles, &camera).unwrap();
        lap2(gpu, round, "blend", &mut t);
        let g = gpu.blend_vjp(&splats, &colors, &tiles, &frame, &grad, &camera).unwrap();
        lap2(gpu, round, "blend_vjp", &mut t);
        let (d, _) = gpu.gaussians_vjp(&up, &camera, &splats, light.as_ref(), &rules, &w, &g).unwrap();
        lap2(gpu, round, "gaussians_vjp", &mut t);
        let rates = vec![0.0; layout.plane_count()];
        gpu.optimise(&mut up, &mut m, d, &rates, 1).unwrap();
        lap2(gpu, round, "optimise", &mut t);
        println!("{} intersections", tiles.intersection_count());
    }
}
fn lap2(gpu: &mut GpuExecutor, round: usize, what: &str, t: &mut Instant) {
    let a = gpu.upload(&[1.0]).unwrap();
    let mut v = [0.0];
    gpu.download(&a, &mut v).unwrap();
    if round > 0 {
        print!("{what} {:.1} ms  ", t.elapsed().as_secs_f64() * 1e3);
    }
    *t = Instant::now();
}
