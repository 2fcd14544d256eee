//! The straightforward loop that kernels are timed beside.

#[path = "../benches/own/mod.rs"]
mod own;

use own::work::{blend_plainly, count};
use specula_benches::{camera, torus};
use specula_core::{executor::Renderer, rules::RenderRules};
use specula_cpu::CpuExecutor;
use specula_train::profile::by_name;

/// Kernels and loop differ only by rounding: α of the same formula, summed in the same order.
const ROUNDING: f32 = 2e-5;

#[test]
fn the_loop_and_the_kernels_give_the_same_picture() {
    let profile = by_name("3dgs", 100).expect("a profile of that name");
    let (cloud, camera) = (torus(2000, profile.layout), camera(90));
    let channels = specula_core::rules::Channels::Color;
    let rules = RenderRules::full(profile.shading, profile.scheme, channels);
    let mut exec = CpuExecutor::new();
    let mut splats = exec.project(&cloud, &camera).expect("the CPU projects");
    let colors = exec.shade(&cloud, &camera, &mut splats, None, &rules).expect("the CPU shades");
    let tiles = exec.bin(&splats, &camera).expect("the CPU bins");
    let frame = exec.blend(&splats, &colors, &tiles, &camera).expect("the CPU blends");
    let plain = blend_plainly(&splats, &colors, &tiles, &camera);
    let mut ours = vec![0.0; plain.len()];
    frame.read(&mut ours);
    let largest = ours.iter().zip(&plain).fold(0.0_f32, |max, (a, b)| max.max((a - b).abs()));
    assert!(largest < ROUNDING, "pictures differ by {largest}");
    let work = count(&splats, &tiles);
    assert!(work.significant <= work.processed && work.significant > work.intersections, "counts: {work:?}");
}
