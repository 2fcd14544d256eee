//! Losses of single pixels: colour and coverage.

use super::comparison::{Comparison, FAR, plane};
use crate::{
    frame::{QUADS, Quad, SIZE, at, tile_len},
    lanes::Lanes,
    parts::Pieces,
    planes::{Planes, Row, store_quad},
};
use fearless_simd::{Simd, dispatch};
use rayon::prelude::*;
use specula_core::{
    color::{composite, composite_vjp, over},
    depth_normal::{expected_depth, is_surface},
    loss::{LossReport, White, absolute, absolute_vjp, sparse_coverage_vjp, squared, squared_vjp, unclipped_scale},
    real::Real,
    rules::channel,
    scene::BLOCK,
};

impl Comparison<'_> {
    /// True if windows need coverage and depth.
    fn looks_at_surfaces(&self) -> bool {
        self.weights.normal != 0.0 || self.weights.smoothness != 0.0
    }

    /// Losses of single pixels, colour and coverage, and their gradients. Also writes the planes
    /// for windows.
    pub(super) fn pixel_losses(&self, grad: &mut [Quad]) -> (LossReport, Planes) {
        let cover = &self.frame.cover;
        let count = if self.looks_at_surfaces() {
            plane::DEPTH + 1
        } else if self.weights.dssim != 0.0 {
            plane::COVERAGE
        } else {
            0
        };
        let mut planes = Planes::new(self.context, [cover.columns, cover.rows], count);
        let (values, values_of) = planes.parts();
        let grad_of = self.grad_starts();
        let parts = (Pieces::new(grad, &grad_of), Pieces::new(values, &values_of));
        let sums = self.each_tile_row(parts, |row, (grad, values)| {
            let (grad, values) = (grad.only(), values.only());
            dispatch!(self.context.level, simd => self.pixel_losses_in_row(simd, row, grad, values))
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
                    store_quad(&mut plane[column * SIZE..], quad, &pixels.to_array());
                }
            }
        }
        [f64::from(sums[0].sum()), f64::from(sums[1].sum()), f64::from(sums[2].sum()), 0.0]
    }

    /// Losses of a quad; returns the values of its planes, zero outside the picture and in unknown
    /// pixels.
    #[inline(always)]
    fn quad_losses<S: Simd>(
        &self,
        simd: S,
        position: [usize; 2],
        quad: usize,
        slot: Option<usize>,
        mut grad: Option<&mut [Quad]>,
        sums: &mut [Lanes<S>; 3],
    ) -> [Lanes<S>; 8] {
        let Self { frame, target, weights, background, .. } = self;
        let channels = frame.channels;
        let mut inside = self.inside(simd, position, quad);
        if target.has_unknown {
            inside = inside * target.known(simd, position, quad);
        }
        let [truth @ .., alpha] = target.read(simd, position, quad);
        let share = |weight: f32, values: usize| inside * (weight / (values * self.pixel_count()) as f32);
        let (share_absolute, share_squared) = (share(weights.absolute, 3), share(weights.squared, 3));
        let load = |slot: usize, channel: usize| Lanes::load(simd, &frame.tile(slot)[at(channels, quad, channel)]);
        let passed = match slot {
            Some(slot) => load(slot, channels),
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
            let [rendered, truth] = self.white.compared(rendered, truth, alpha);
            sums[0] = sums[0] + absolute(rendered, truth);
            sums[1] = sums[1] + squared(rendered, truth);
            if let Some(grad) = &mut grad {
                let color_grad =
                    absolute_vjp(rendered, truth, share_absolute) + squared_vjp(rendered, truth, share_squared);
                color_grad.store(&mut grad[at(channels, quad, c)]);
            }
            (pixels[plane::RENDERED + c], pixels[plane::TRUTH + c]) = (rendered, truth);
        }
        let coverage = (-passed + 1.0) * inside;
        if weights.coverage != 0.0 {
            sums[2] = sums[2] + absolute(coverage, alpha);
        }
        if let (Some(grad), Some(slot)) = (grad, slot) {
            grad[at(channels, quad, 3)..at(channels, quad, 3) + channels - 3].fill([0.0; BLOCK]);
            let grad_coverage = absolute_vjp(coverage, alpha, share(weights.coverage, 1))
                + sparse_coverage_vjp(coverage, share(weights.sparse_coverage, 1));
            (-grad_coverage).store(&mut grad[at(channels, quad, channels)]);
            if weights.residual_image != 0.0 {
                let grad_residual = coverage * share(weights.residual_image, 1);
                grad_residual.store(&mut grad[at(channels, quad, channel::RESIDUAL_SIZE)]);
            }
            if self.looks_at_surfaces() {
                let depth = expected_depth(load(slot, channel::DEPTH), coverage);
                (pixels[plane::COVERAGE], pixels[plane::DEPTH]) = (coverage, depth.keep(is_surface(coverage)));
            }
        }
        pixels
    }

    /// Gradient of the transmittance through the background, after those of colours that are not
    /// clipped are scaled. Windows of SSIM include unknown pixels, but these have no gradient.
    pub(super) fn background_vjp(&self, grad: &mut [Quad]) {
        let channels = self.frame.channels;
        grad.par_chunks_mut(tile_len(channels)).enumerate().for_each(|(slot, tile)| {
            dispatch!(self.context.level, simd => {
                for quad in 0..QUADS {
                    if self.target.has_unknown {
                        let known = self.target.known(simd, self.frame.cover.tile_position(slot), quad);
                        for c in 0..3 {
                            let color = &mut tile[at(channels, quad, c)];
                            (Lanes::load(simd, color) * known).store(color);
                        }
                    }
                    if self.white == White::Unclipped {
                        let [truth @ .., alpha] = self.target.read(simd, self.frame.cover.tile_position(slot), quad);
                        for c in 0..3 {
                            let truth = over(truth[c], alpha, Lanes::splat(simd, self.background[c]));
                            let color = &mut tile[at(channels, quad, c)];
                            (Lanes::load(simd, color) * unclipped_scale(truth)).store(color);
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
}
