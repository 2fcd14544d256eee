//! Tests of memory, of parts and of the order in space. The modules are compiled again here, with
//! their tests, as the crate is not: its kernels for every vector width take minutes.

use specula_core::scene::{Gaussians, Layout, MEAN, len_of_values};
use specula_cpu::morton::sort_in_space;

#[path = "../src/buffer.rs"]
#[allow(dead_code, unreachable_pub, reason = "the stages use the rest")]
mod buffer;
#[path = "../src/parts.rs"]
#[allow(dead_code, reason = "the stages use the rest")]
mod parts;

#[test]
fn sorting_moves_whole_gaussians() {
    let layout = Layout::radiance(0);
    let values = vec![0.0; len_of_values(40, layout)];
    let mut cloud = Gaussians { count: 40, layout, values };
    for index in 0..40 {
        let x = ((index * 7) % 40) as f32;
        cloud.set(index, MEAN, [x, 0.0, 0.0]);
        cloud.set(index, layout.sh_start(), [x]);
    }
    sort_in_space(&mut cloud);
    for index in 0..40 {
        let ([x], [color]) = (cloud.get::<1>(index, MEAN), cloud.get::<1>(index, layout.sh_start()));
        assert_eq!((x, color), (index as f32, index as f32), "in order, with what belongs to it");
    }
}
