//! One group for each stage, on the torus at 800 × 800; throughput in the stage's own unit of
//! work. What there is to do is printed first: it does not depend on the machine.

mod own;

use criterion::{Criterion, criterion_group, criterion_main};
use own::{
    trained::Trained,
    work::{self, work_of},
};
use specula_benches::{
    environment,
    groups::Groups,
    scene::{LIGHT, Scene, View},
    stages::{Amounts, Meter, Stage, Work, measure_picture, measure_step},
};
use specula_core::{
    executor::Renderer,
    pack::Storage,
    plan::{Needs, Plan},
    prefilter::LevelRange,
    rules::{Channels, RenderRules},
    scene::{Gaussians, TINT},
    state::SceneState,
};
use specula_cpu::CpuExecutor;
use std::path::Path;

/// The program's allocator, so that the times are those of the program.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const GAUSSIANS: usize = 100_000;
const SIZE: u32 = 800;
/// Light per pixel, 12 channels; light per Gaussian, 8 channels; no light, 3 channels.
const PROFILES: [&str; 3] = ["3dgs", "paper", "specula"];
/// Sizes of pictures and clouds for whole steps.
const STEPS: [(u32, usize); 2] = [(400, 50_000), (800, 200_000)];
const SAMPLES: usize = 20;
/// Views of a trained model among which the hardest is taken.
const TRAINED_VIEWS: usize = 8;

/// Benches of a scene with so much to do.
fn groups<'a>(
    criterion: &'a mut Criterion,
    name: &str,
    view: &View<'_, CpuExecutor>,
    work: Work,
) -> Groups<'a, CpuExecutor> {
    let Gaussians { count, layout, .. } = *view.cloud;
    let pixels = view.camera.width as usize * view.camera.height as usize;
    let amounts = Amounts { gaussians: count, layout, storage: Storage::F32, pixels, rules: *view.rules, work };
    Groups { criterion, name: name.to_owned(), samples: SAMPLES, amounts, finish: |_| Ok(()) }
}

fn scene(exec: &mut CpuExecutor, profile: &str, size: u32, count: usize) -> Scene<CpuExecutor> {
    own::scene(exec, profile, size, count).expect("the CPU takes every scene")
}

fn stages(criterion: &mut Criterion) {
    PROFILES.iter().for_each(|profile| stages_of(criterion, profile));
}

fn stages_of(criterion: &mut Criterion, name: &str) {
    let mut exec = CpuExecutor::new();
    let mut scene = scene(&mut exec, name, SIZE, GAUSSIANS);
    let light = scene.filtered(&mut exec).expect("64 is a power of two");
    let work = work_of(&mut exec, &scene.state.gaussians, &scene.camera);
    println!("{name}: {work}");
    let view =
        View { cloud: &scene.state.gaussians, light: light.as_ref(), camera: &scene.camera, rules: &scene.rules };
    let mut groups = groups(criterion, name, &view, work);
    picture_stages(&mut exec, &view, &mut groups);
    plain_loop(&mut exec, &view, &mut groups);
    measure_step(&mut exec, &mut scene, &mut groups).expect("the CPU trains");
}

/// Stages of a picture for only its colours, and those of the CPU beside.
fn picture_stages(exec: &mut CpuExecutor, view: &View<'_, CpuExecutor>, groups: &mut Groups<'_, CpuExecutor>) {
    measure_picture(exec, view, groups).expect("the CPU renders");
    let splats = exec.project(view.cloud, view.camera).expect("the CPU projects");
    groups.bench(exec, "sort", view.cloud.count, |_| Ok(()), |exec, ()| Ok(exec.depth_order(&splats)));
}

/// Blending one pixel after the other.
fn plain_loop(exec: &mut CpuExecutor, view: &View<'_, CpuExecutor>, groups: &mut Groups<'_, CpuExecutor>) {
    let View { cloud, light, camera, rules } = *view;
    let mut splats = exec.project(cloud, camera).expect("the CPU projects");
    let colors = exec.shade(cloud, camera, &mut splats, light, rules).expect("the CPU shades");
    let tiles = exec.bin(&splats, camera).expect("the CPU bins");
    let pairs = groups.amounts.elements(Stage::Blend);
    let blend = |_: &mut CpuExecutor, ()| Ok(work::blend_plainly(&splats, &colors, &tiles, camera));
    groups.bench(exec, "blend_plainly", pairs, |_| Ok(()), blend);
}

fn steps(criterion: &mut Criterion) {
    for (profile, (size, count)) in PROFILES.iter().flat_map(|profile| STEPS.map(|step| (profile, step))) {
        let mut exec = CpuExecutor::new();
        let mut scene = scene(&mut exec, profile, size, count);
        let name = format!("{profile}, {count} at {size}");
        let view = View { cloud: &scene.state.gaussians, light: None, camera: &scene.camera, rules: &scene.rules };
        let mut groups = groups(criterion, &name, &view, Work::default());
        groups.measure(&mut exec, Stage::TrainStep, |_| Ok(()), |exec, ()| scene.train(exec)).expect("the CPU trains");
    }
}

/// A scene without specular tints, under a light, rendered by its plan: plain Gaussian splatting
/// remains.
fn diffuse(criterion: &mut Criterion) {
    const NO_TINT: f32 = -100.0;
    let mut exec = CpuExecutor::new();
    let Scene { state: SceneState { gaussians: mut cloud, .. }, camera, rules, .. } =
        scene(&mut exec, "specula", SIZE, GAUSSIANS);
    (0..cloud.count).for_each(|index| cloud.set(index, TINT, [NO_TINT; 3]));
    let rules = RenderRules { channels: Channels::Color, ..rules };
    let plan = Plan::new(cloud.layout, &Needs::of(&cloud).under(Some(&environment(LIGHT))), None, &rules);
    assert!(plan.unlit.is_some(), "a scene without tint needs no light");
    let view = View { cloud: &cloud, light: None, camera: &camera, rules: &plan.rules };
    let work = work_of(&mut exec, &cloud, &camera);
    picture_stages(&mut exec, &view, &mut groups(criterion, "diffuse", &view, work));
}

/// A trained model from the hardest of its first views. `SPECULA_MODEL` names its folder.
fn trained(criterion: &mut Criterion) {
    let Some(folder) = std::env::var_os("SPECULA_MODEL") else {
        println!("no trained model is rendered; name its folder in SPECULA_MODEL");
        return;
    };
    let Trained { cloud, light, profile, cameras } = Trained::open(Path::new(&folder));
    let full = RenderRules::full(profile.shading, profile.scheme, Channels::Color);
    let plan = Plan::new(cloud.layout, &Needs::of(&cloud).under(light.as_ref()), None, &full);
    let mut exec = CpuExecutor::new();
    let light = light.map(|light| exec.prefilter(&light, profile.scheme, LevelRange::ALL).expect("specula wrote it"));
    let views = cameras.iter().take(TRAINED_VIEWS);
    let camera = views.max_by_key(|camera| work_of(&mut exec, &cloud, camera).processed).expect("a model has cameras");
    let view = View { cloud: &cloud, light: light.as_ref(), camera, rules: &plan.rules };
    let work = work_of(&mut exec, &cloud, camera);
    println!("trained: {} Gaussians, {work}", cloud.count);
    picture_stages(&mut exec, &view, &mut groups(criterion, "trained", &view, work));
}

criterion_group!(benches, stages, diffuse, trained, steps);
criterion_main!(benches);
