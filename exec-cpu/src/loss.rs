//! A picture against what it should be: colour, structure, normals, coverage, and their gradients.

mod normals;
mod structure;

use crate::{
    buffer::Buffer,
    frame::{Cover, Frame, FrameGrad, PIXEL_X, PIXEL_Y, QUAD, QUADS, Quad, SIZE, at, quad_origin, tile_len},
    lanes::Lanes,
    machine::Machine,
    parts::{Parts, Pieces, each_part},
    planes::{Planes, Row, put_quad},
};
use fearless_simd::{Simd, dispatch};
use normals::normal_loss;
use rayon::prelude::*;
use specula_core::{
    bin::tile_count,
    camera::Camera,
    color::{composite, composite_vjp, from_byte, has_alpha, is_unknown, over},
    depth_normal::{expected_depth, is_surface},
    loss::{LossReport, LossWeights, absolute, absolute_vjp, sparse_coverage_vjp, squared, squared_vjp},
    real::Real,
    rules::{Channels, channel},
    scene::BLOCK,
};
use structure::structure_loss;

/// A picture to compare with: 8-bit sRGB with straight alpha.
#[derive(Clone, Debug)]
pub struct Target {
    pub(crate) width: usize,
    pub(crate) height: usize,
    columns: usize,
    /// Tile by tile and quad by quad: the reds of a quad, its greens, its blues, its alphas.
    quads: Vec<[[u8; BLOCK]; 4]>,
    /// Whether a tile is transparent everywhere.
    is_empty: Vec<bool>,
    /// Whether any pixel is not opaque.
    has_alpha: bool,
    /// Whether nothing is known of some pixel.
    has_unknown: bool,
}

impl Target {
    pub(crate) fn new(width: usize, height: usize, rgba: &[u8]) -> Self {
        let [columns, rows] = [width, height].map(|pixels| tile_count(pixels as u32) as usize);
        let mut quads = vec![[[0; BLOCK]; 4]; columns * rows * QUADS];
        for (pixel, rgba) in rgba.chunks_exact(4).enumerate() {
            let (x, y) = (pixel % width, pixel / width);
            let tile = y / SIZE * columns + x / SIZE;
            let quad = &mut quads[tile * QUADS + y % SIZE / QUAD * (SIZE / QUAD) + x % SIZE / QUAD];
            let lane = y % QUAD * QUAD + x % QUAD;
            quad.iter_mut().zip(rgba).for_each(|(channel, value)| channel[lane] = *value);
        }
        let is_transparent = |quads: &[[[u8; BLOCK]; 4]]| quads.iter().all(|quad| quad[3] == [0; BLOCK]);
        Self {
            width,
            height,
            columns,
            is_empty: quads.chunks_exact(QUADS).map(is_transparent).collect(),
            has_alpha: has_alpha(rgba),
            has_unknown: rgba.chunks_exact(4).any(is_unknown),
            quads,
        }
    }

    /// One for the pixels of a quad of which something is known, zero for others.
    #[inline(always)]
    fn known<S: Simd>(&self, simd: S, [column, row]: [usize; 2], quad: usize) -> Lanes<S> {
        let quad = &self.quads[(row * self.columns + column) * QUADS + quad];
        let mut known = [1.0; BLOCK];
        for lane in 0..BLOCK {
            let pixel = [quad[0][lane], quad[1][lane], quad[2][lane], quad[3][lane]];
            known[lane] = if is_unknown(&pixel) { 0.0 } else { 1.0 };
        }
        Lanes::from_array(simd, known)
    }
}

/// What is compared, and how.
struct Comparison<'a> {
    machine: &'a Machine,
    frame: &'a Frame,
    target: &'a Target,
    camera: &'a Camera,
    weights: LossWeights,
    background: [f32; 3],
    /// How many tiles each tile is away from one that shows anything but the background, up to [`FAR`].
    distance: Buffer<u32>,
}

/// Farther than any window reaches.
const FAR: u32 = 3;

/// Planes that windows look at.
mod plane {
    /// The rendered colour over the background.
    pub(super) const RENDERED: usize = 0;
    /// The true colour over the background.
    pub(super) const TRUTH: usize = 3;
    /// Coverage of the rendered picture.
    pub(super) const COVERAGE: usize = 6;
    /// Its expected depth, zero where there is no surface.
    pub(super) const DEPTH: usize = 7;
}

pub(crate) fn loss_all(
    machine: &Machine,
    frame: &Frame,
    target: &Target,
    camera: &Camera,
    weights: &LossWeights,
    background: [f32; 3],
) -> (LossReport, FrameGrad) {
    let has_geometry = Channels::of_count(frame.channels).index_of(channel::DEPTH).is_some();
    let weights = weights.where_possible(target.has_alpha, has_geometry);
    let distance = distances(machine, frame, target);
    let comparison = Comparison { machine, frame, target, camera, weights, background, distance };
    let mut grad = machine.quads.take(frame.cover.tiles.len() * tile_len(frame.channels));
    let (mut report, planes) = comparison.pixel_losses(&mut grad);
    if weights.dssim != 0.0 {
        report.ssim = structure_loss(&comparison, &planes, &mut grad);
    }
    comparison.background_vjp(&mut grad);
    if weights.normal != 0.0 {
        report.normal = normal_loss(&comparison, &planes, &mut grad);
    }
    (report.with_total(&weights), FrameGrad { channels: frame.channels, values: grad })
}

impl Comparison<'_> {
    fn pixel_count(&self) -> usize {
        self.target.width * self.target.height
    }
    /// Where the gradient of each row of tiles begins.
    fn grad_starts(&self) -> impl Fn(usize) -> usize + Sync + '_ {
        |row| self.frame.cover.before_row(row) * tile_len(self.frame.channels)
    }
    /// Visits the rows of tiles with their share of something, and adds up what they find, in their order.
    fn each_tile_row<P: Parts>(&self, parts: P, visit: impl Fn(usize, P) -> [f64; 4] + Sync) -> [f64; 4] {
        let rows = self.frame.cover.rows;
        let mut sums = self.machine.sums.take(rows);
        let one_by_one = |row: usize| row;
        let parts = (parts, Pieces::new(&mut sums, &one_by_one));
        each_part(rows, parts, &|row, (part, sum): (P, Pieces<'_, [f64; 4]>)| sum.only()[0] = visit(row, part));
        sums.iter().fold([0.0; 4], |sum, row| core::array::from_fn(|k| sum[k] + row[k]))
    }

    /// Losses that look at one pixel at a time, and their gradients: colour and coverage. Writes what windows will
    /// look at as well.
    fn pixel_losses(&self, grad: &mut [Quad]) -> (LossReport, Planes) {
        let cover = &self.frame.cover;
        let count = if self.weights.normal != 0.0 {
            plane::DEPTH + 1
        } else if self.weights.dssim != 0.0 {
            plane::COVERAGE
        } else {
            0
        };
        let mut planes = Planes::new(self.machine, [cover.columns, cover.rows], count);
        let (values, values_of) = planes.parts();
        let grad_of = self.grad_starts();
        let parts = (Pieces::new(grad, &grad_of), Pieces::new(values, &values_of));
        let sums = self.each_tile_row(parts, |row, (grad, values)| {
            let (grad, values) = (grad.only(), values.only());
            dispatch!(self.machine.level, simd => self.pixel_losses_in_row(simd, row, grad, values))
        });
        let pixels = self.pixel_count() as f64;
        let report = LossReport {
            absolute: sums[0] / (3.0 * pixels),
            squared: sums[1] / (3.0 * pixels),
            coverage: sums[2] / pixels,
            ..LossReport::default()
        };
        (report, planes)
    }

    #[inline(always)]
    fn pixel_losses_in_row<S: Simd>(&self, simd: S, row: usize, grad: &mut [Quad], values: &mut [Row]) -> [f64; 4] {
        let cover = &self.frame.cover;
        let grad_len = tile_len(self.frame.channels);
        let mut sums = [Lanes::splat(simd, 0.0); 3];
        for column in 0..cover.columns {
            let tile = row * cover.columns + column;
            if self.distance[tile] >= FAR {
                continue;
            }
            let slot = cover.slot(tile);
            let mut grad = slot.map(|slot| &mut grad[(slot - cover.before_row(row)) * grad_len..][..grad_len]);
            for quad in 0..QUADS {
                let pixels = self.quad_losses(simd, [column, row], quad, slot, grad.as_deref_mut(), &mut sums);
                for (plane, pixels) in values.chunks_exact_mut(cover.columns * SIZE).zip(pixels) {
                    put_quad(&mut plane[column * SIZE..], quad, &pixels.to_array());
                }
            }
        }
        [f64::from(sums[0].sum()), f64::from(sums[1].sum()), f64::from(sums[2].sum()), 0.0]
    }

    /// Losses of a quad; returns what its planes hold, zero outside the picture and where nothing is known of it.
    #[inline(always)]
    fn quad_losses<S: Simd>(
        &self,
        simd: S,
        place: [usize; 2],
        quad: usize,
        slot: Option<usize>,
        mut grad: Option<&mut [Quad]>,
        sums: &mut [Lanes<S>; 3],
    ) -> [Lanes<S>; 8] {
        let Self { frame, target, weights, background, .. } = self;
        let channels = frame.channels;
        let mut inside = self.inside(simd, place, quad);
        if target.has_unknown {
            inside = inside * target.known(simd, place, quad);
        }
        let [truth @ .., alpha] =
            read_target(simd, &target.quads[(place[1] * target.columns + place[0]) * QUADS + quad]);
        let share = |weight: f32, values: usize| inside * (weight / (values * self.pixel_count()) as f32);
        let (of_absolute, of_squared) = (share(weights.absolute, 3), share(weights.squared, 3));
        let of_channel =
            |slot: usize, channel: usize| Lanes::load(simd, &frame.tile(slot)[at(channels, quad, channel)]);
        let passed = match slot {
            Some(slot) => of_channel(slot, channels),
            None => inside.constant(1.0),
        };
        let mut pixels = [inside.zero(); 8];
        for c in 0..3 {
            let behind = Lanes::splat(simd, background[c]);
            let rendered = match slot {
                Some(slot) => composite(Lanes::load(simd, frame.color(slot, quad, c)), passed, behind),
                None => behind,
            } * inside;
            let truth = over(truth[c], alpha, behind) * inside;
            sums[0] = sums[0] + absolute(rendered, truth);
            sums[1] = sums[1] + squared(rendered, truth);
            if let Some(grad) = &mut grad {
                let own = absolute_vjp(rendered, truth, of_absolute) + squared_vjp(rendered, truth, of_squared);
                own.store(&mut grad[at(channels, quad, c)]);
            }
            (pixels[plane::RENDERED + c], pixels[plane::TRUTH + c]) = (rendered, truth);
        }
        let coverage = (-passed + 1.0) * inside;
        if weights.coverage != 0.0 {
            sums[2] = sums[2] + absolute(coverage, alpha);
        }
        if let (Some(grad), Some(slot)) = (grad, slot) {
            grad[at(channels, quad, 3)..at(channels, quad, 3) + channels - 3].fill([0.0; BLOCK]);
            let of_coverage = absolute_vjp(coverage, alpha, share(weights.coverage, 1))
                + sparse_coverage_vjp(coverage, share(weights.sparse_coverage, 1));
            (-of_coverage).store(&mut grad[at(channels, quad, channels)]);
            if weights.residual_image != 0.0 {
                let of_residual = coverage * share(weights.residual_image, 1);
                of_residual.store(&mut grad[at(channels, quad, channel::RESIDUAL_SIZE)]);
            }
            if weights.normal != 0.0 {
                let depth = expected_depth(of_channel(slot, channel::DEPTH), coverage);
                (pixels[plane::COVERAGE], pixels[plane::DEPTH]) = (coverage, depth.keep(is_surface(coverage)));
            }
        }
        pixels
    }

    /// Gradient of the transmittance through the background. Windows of SSIM reach pixels of which nothing is known, but
    /// these have no gradient.
    fn background_vjp(&self, grad: &mut [Quad]) {
        let channels = self.frame.channels;
        grad.par_chunks_mut(tile_len(channels)).enumerate().for_each(|(slot, tile)| {
            dispatch!(self.machine.level, simd => {
                for quad in 0..QUADS {
                    if self.target.has_unknown {
                        let known = self.target.known(simd, self.frame.cover.place(slot), quad);
                        for c in 0..3 {
                            let color = &mut tile[at(channels, quad, c)];
                            (Lanes::load(simd, color) * known).store(color);
                        }
                    }
                    let mut sum = Lanes::load(simd, &tile[at(channels, quad, channels)]);
                    for c in 0..3 {
                        let behind = Lanes::splat(simd, self.background[c]);
                        sum = composite_vjp(behind, Lanes::load(simd, &tile[at(channels, quad, c)]), sum);
                    }
                    sum.store(&mut tile[at(channels, quad, channels)]);
                }
            });
        });
    }

    /// One for the pixels of a quad that lie in the picture, zero for others.
    #[inline(always)]
    fn inside<S: Simd>(&self, simd: S, place: [usize; 2], quad: usize) -> Lanes<S> {
        let [x, y] = quad_origin(quad);
        let x = Lanes::from_array(simd, PIXEL_X) + (place[0] * SIZE + x) as f32;
        let y = Lanes::from_array(simd, PIXEL_Y) + (place[1] * SIZE + y) as f32;
        let end = |pixels: usize| Lanes::splat(simd, pixels as f32);
        let is_inside = x.less(end(self.target.width)) & y.less(end(self.target.height));
        x.constant(1.0).keep(is_inside)
    }
}

/// How far each tile is from one that a splat touches or that the true picture covers.
fn distances(machine: &Machine, frame: &Frame, target: &Target) -> Buffer<u32> {
    let Cover { columns, rows, .. } = frame.cover;
    let mut distance = machine.indices.take(columns * rows);
    for (tile, distance) in distance.iter_mut().enumerate() {
        let is_active = frame.cover.slot(tile).is_some() || !target.is_empty[tile];
        *distance = if is_active { 0 } else { FAR };
    }
    // The larger of two distances along rows and columns: rows first, then columns of what that gives.
    for row in distance.chunks_exact_mut(columns) {
        spread_distance(row, columns, 1);
    }
    for column in 0..columns {
        let len = (rows - 1) * columns + 1;
        spread_distance(&mut distance[column..column + len], rows, columns);
    }
    distance
}

/// Lets every distance be at most one more than its neighbour's, forwards and backwards.
fn spread_distance(distance: &mut [u32], count: usize, step: usize) {
    for k in 1..count {
        distance[k * step] = distance[k * step].min(distance[(k - 1) * step] + 1);
    }
    for k in (1..count).rev() {
        distance[(k - 1) * step] = distance[(k - 1) * step].min(distance[k * step] + 1);
    }
}

/// Red, green, blue and alpha of a quad, in \[0, 1\].
#[inline(always)]
fn read_target<S: Simd>(simd: S, quad: &[[u8; BLOCK]; 4]) -> [Lanes<S>; 4] {
    let mut numbers = [[0.0; BLOCK]; 4];
    for (numbers, bytes) in numbers.iter_mut().zip(quad) {
        for lane in 0..BLOCK {
            numbers[lane] = f32::from(bytes[lane]);
        }
    }
    let channel = |k: usize| from_byte(Lanes::from_array(simd, numbers[k]));
    [channel(0), channel(1), channel(2), channel(3)]
}

/// A row of a tile's channel, from its four quads.
#[inline(always)]
fn row_of_tile(tile: &[Quad], channels: usize, channel: usize, y: usize) -> [f32; SIZE] {
    let mut row = [0.0; SIZE];
    for (k, to) in row.chunks_exact_mut(QUAD).enumerate() {
        let quad = &tile[at(channels, y / QUAD * QUAD + k, channel)];
        to.copy_from_slice(&quad[y % QUAD * QUAD..][..QUAD]);
    }
    row
}

/// Adds to a row of a tile's channel.
#[inline(always)]
fn add_to_row(tile: &mut [Quad], channels: usize, channel: usize, y: usize, row: &[f32; SIZE]) {
    for (k, from) in row.chunks_exact(QUAD).enumerate() {
        let quad = &mut tile[at(channels, y / QUAD * QUAD + k, channel)];
        quad[y % QUAD * QUAD..][..QUAD].iter_mut().zip(from).for_each(|(sum, x)| *sum += x);
    }
}
