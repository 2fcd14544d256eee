//! Work of blending, counted with core's formulas one pixel at a time: the counts do not depend on
//! the machine, and the loop that makes them is the scalar path that the executors are compared
//! with.

use specula_benches::stages::Work;
use specula_core::{
    bin::TILE_SIZE,
    blend::{Composite, PixelState, alpha, falloff, is_active, may_overlap, step},
    camera::Camera,
    executor::Renderer,
    scene::Gaussians,
    splat::Splat2d,
};
use specula_cpu::{
    CpuExecutor,
    stages::{
        bin::Tiles,
        project::{SplatRecord, Splats},
        shade::Colors,
    },
};

const TILE: usize = TILE_SIZE as usize;
/// Pixels along an edge of a quad, the least that the CPU's kernels work on.
const QUAD: usize = 4;

/// Counts the work of blending a picture of this cloud.
pub(crate) fn work_of(exec: &mut CpuExecutor, cloud: &Gaussians<Vec<f32>>, camera: &Camera) -> Work {
    let splats = exec.project(cloud, camera).expect("the CPU projects");
    let tiles = exec.bin(&splats, camera).expect("the CPU bins");
    count(&splats, &tiles)
}

/// Counts the pairs of pixels and splats.
pub(crate) fn count(splats: &Splats, tiles: &Tiles) -> Work {
    let [columns, rows] = tiles.grid();
    let mut work = Work { intersections: tiles.intersection_count(), ..Work::default() };
    for tile in 0..columns * rows {
        let origin = [tile % columns * TILE, tile / columns * TILE];
        let mut states = [PixelState::open(0.0); TILE * TILE];
        for gaussian in tiles.gaussians_of(tile) {
            if states.iter().all(|state| !is_active(state.transmittance)) {
                break;
            }
            let splat = splat_of(&splats.records()[gaussian]);
            for quad in (0..TILE * TILE).step_by(QUAD * QUAD).map(|k| k / (QUAD * QUAD)) {
                let first = [quad % QUAD * QUAD, quad / QUAD * QUAD];
                count_quad(&splat, origin, first, &mut states, &mut work);
            }
        }
    }
    work
}

fn splat_of(record: &SplatRecord) -> Splat2d<f32> {
    Splat2d::new(record.mean2d, record.root_conic, record.log2_opacity)
}

/// From a splat's centre to that of a pixel.
fn offset(splat: &Splat2d<f32>, x: usize, y: usize) -> [f32; 2] {
    [x as f32 + 0.5 - splat.mean2d[0], y as f32 + 0.5 - splat.mean2d[1]]
}

fn count_quad(
    splat: &Splat2d<f32>,
    origin: [usize; 2],
    first: [usize; 2],
    states: &mut [PixelState<f32>],
    work: &mut Work,
) {
    const ACROSS: f32 = (QUAD - 1) as f32;
    let [x, y] = offset(splat, origin[0] + first[0], origin[1] + first[1]);
    if !may_overlap(splat, [x, x + ACROSS], [y, y + ACROSS]) {
        return;
    }
    work.processed += QUAD * QUAD;
    for pixel in 0..QUAD * QUAD {
        let (column, row) = (first[0] + pixel % QUAD, first[1] + pixel / QUAD);
        let [dx, dy] = offset(splat, origin[0] + column, origin[1] + row);
        let state = &mut states[row * TILE + column];
        let alpha = alpha(falloff(splat, dx, dy).log2_strength);
        work.significant += usize::from(alpha > 0.0 && is_active(state.transmittance));
        *state = step(alpha, *state).behind;
    }
}

/// The straightforward loop: every pixel of a tile walks through the tile's splats until it ends.
/// Channels, then the transmittance, plane by plane.
pub(crate) fn blend_plainly(splats: &Splats, colors: &Colors, tiles: &Tiles, camera: &Camera) -> Vec<f32> {
    let [width, height] = [camera.width as usize, camera.height as usize];
    let channels = colors.channels;
    let mut values = vec![0.0; (channels + 1) * width * height];
    let mut pixel = vec![0.0; channels];
    for y in 0..height {
        for x in 0..width {
            let mut state = PixelState::open(0.0);
            pixel.fill(0.0);
            for gaussian in tiles.gaussians_of(y / TILE * tiles.grid()[0] + x / TILE) {
                let splat = splat_of(&splats.records()[gaussian]);
                let [dx, dy] = offset(&splat, x, y);
                let alpha = alpha(falloff(&splat, dx, dy).log2_strength);
                if alpha > 0.0 {
                    let Composite { weight, behind } = step(alpha, state);
                    state = behind;
                    let color = colors.of(gaussian);
                    pixel.iter_mut().zip(color).for_each(|(sum, c)| *sum += weight * c);
                }
                if !is_active(state.transmittance) {
                    break;
                }
            }
            for (channel, value) in pixel.iter().chain([&state.final_transmittance]).enumerate() {
                values[(channel * height + y) * width + x] = *value;
            }
        }
    }
    values
}
