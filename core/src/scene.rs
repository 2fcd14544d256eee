//! Scene types: Gaussians, an environment, images. They are generic over the storage `A`, which is
//! host memory (`Vec<f32>`) or an executor's arrays.
//!
//! Gaussians are stored in blocks of sixteen, plane by plane: a block is a contiguous piece of
//! memory for one task, and a plane of it is one vector. Parameters, gradients and the moments of
//! Adam share this layout.

use crate::{antialias::LowPass, light_network::WEIGHT_COUNT};
use core::ops::Range;

/// Source of a Gaussian's colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Appearance {
    /// Only spherical harmonics: plain Gaussian splatting.
    Radiance,
    /// Diffuse, tint, roughness, two normal residuals and residual harmonics: the paper's shading
    /// function.
    Shaded,
}

/// Planes of Gaussians. A plane is one number of every Gaussian, side by side.
///
/// Planes, in order: means 0–2, log scales 3–5, quats (w, x, y, z) 6–9, opacity logit 10; then,
/// shaded only, diffuse 11–13, tint 14–16, roughness 17, normal residuals Δn₁ 18–20 and Δn₂ 21–23;
/// then the spherical harmonics, plane 3k + c for coefficient k and colour c; then, physical only,
/// albedo, metalness and ambient transfer ([`ALBEDO`], [`METALNESS`], [`AMBIENT`]); then,
/// anti-aliased only, the deviation of the filter in space. All values but ambient transfer and
/// deviation are kept before activation.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Layout {
    /// Source of colours.
    pub appearance: Appearance,
    /// Degree of the spherical harmonics, 0–3; `None` is no harmonics at all.
    pub sh_degree: Option<u8>,
    /// Whether each Gaussian has a physical material in addition to its view-dependent colour
    /// ([`mod@crate::physical`]).
    pub is_physical: bool,
    /// Low-pass of splats in the training of the opacities.
    pub low_pass: LowPass,
    /// Whether each Gaussian has a filter in space ([`crate::antialias`]).
    pub is_smoothed: bool,
}

/// Prints materials and filters only if there are any: checkpoints contain the text of their
/// settings.
impl core::fmt::Debug for Layout {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { appearance, sh_degree, is_physical, low_pass, is_smoothed } = self;
        let mut text = out.debug_struct("Layout");
        text.field("appearance", appearance).field("sh_degree", sh_degree);
        if *is_physical {
            text.field("is_physical", is_physical);
        }
        if (*low_pass, *is_smoothed) != (LowPass::Dilated, false) {
            text.field("low_pass", low_pass).field("is_smoothed", is_smoothed);
        }
        text.finish()
    }
}

/// First plane of the means, in world space.
pub const MEAN: usize = 0;
/// First plane of the natural logarithms of the scales.
pub const LOG_SCALE: usize = 3;
/// First plane of the quats (w, x, y, z), of any length but zero.
pub const QUAT: usize = 6;
/// The plane of the opacities before the sigmoid.
pub const OPACITY: usize = 10;
/// First plane of the diffuse colour before activation.
pub const DIFFUSE: usize = 11;
/// First plane of the specular tint before the sigmoid.
pub const TINT: usize = 14;
/// The plane of the roughness before the sigmoid.
pub const ROUGHNESS: usize = 17;
/// First plane of Δn₁, the residual of a normal that already faces the viewer.
pub const NORMAL_RESIDUAL_1: usize = 18;
/// First plane of Δn₂, the residual of a normal that had to be flipped.
pub const NORMAL_RESIDUAL_2: usize = 21;

/// First of the physical planes: the albedo before the sigmoid, counted from
/// [`Layout::physical_planes`].
pub const ALBEDO: usize = 0;
/// The metalness before the sigmoid, counted likewise.
pub const METALNESS: usize = 3;
/// First plane of the ambient transfer, counted likewise: linear, 1 in the open.
pub const AMBIENT: usize = 4;
/// Physical planes of a Gaussian.
const PHYSICAL_LEN: usize = AMBIENT + 3;

/// Gaussians side by side in a block, one per SIMD lane.
pub const BLOCK: usize = 16;

impl Layout {
    /// Plain Gaussian splatting.
    pub const fn radiance(sh_degree: u8) -> Self {
        Self {
            appearance: Appearance::Radiance,
            sh_degree: Some(sh_degree),
            is_physical: false,
            low_pass: LowPass::Dilated,
            is_smoothed: false,
        }
    }
    /// The paper's attributes, with or without residual harmonics.
    pub const fn shaded(sh_degree: Option<u8>) -> Self {
        Self { appearance: Appearance::Shaded, ..Self::radiance(0).with_harmonics(sh_degree) }
    }
    /// The same attributes with other residual harmonics, or without any.
    const fn with_harmonics(self, sh_degree: Option<u8>) -> Self {
        Self { sh_degree, ..self }
    }
    /// The same attributes with a physical material.
    #[must_use]
    pub const fn physical(self) -> Self {
        Self { is_physical: true, ..self }
    }
    /// The same attributes with both filters of Mip-Splatting.
    #[must_use]
    pub const fn antialiased(self) -> Self {
        Self { low_pass: LowPass::Mip, is_smoothed: true, ..self }
    }
    /// True if there are shading attributes.
    pub const fn is_shaded(self) -> bool {
        matches!(self.appearance, Appearance::Shaded)
    }
    /// First plane of the spherical harmonics.
    pub const fn sh_start(self) -> usize {
        if self.is_shaded() { 24 } else { 11 }
    }
    /// Number of harmonics per colour: (degree + 1)², or none.
    pub const fn sh_count(self) -> usize {
        match self.sh_degree {
            Some(degree) => (degree as usize + 1) * (degree as usize + 1),
            None => 0,
        }
    }
    /// Past the last plane of the spherical harmonics.
    pub const fn sh_end(self) -> usize {
        self.sh_start() + 3 * self.sh_count()
    }
    /// First of the physical planes, if Gaussians have a physical material.
    pub const fn physical_planes(self) -> Option<usize> {
        if self.is_physical { Some(self.sh_end()) } else { None }
    }
    /// Past the last plane of harmonics and physical material.
    pub const fn physical_end(self) -> usize {
        self.sh_end() + PHYSICAL_LEN * self.is_physical as usize
    }
    /// Plane of the deviations of the filter in space, in world units, if Gaussians have one.
    pub const fn filter_plane(self) -> Option<usize> {
        if self.is_smoothed { Some(self.physical_end()) } else { None }
    }
    /// Number of planes.
    pub const fn plane_count(self) -> usize {
        self.physical_end() + self.is_smoothed as usize
    }
}

/// Gaussians in blocks of [`BLOCK`]: a block holds plane after plane, each [`BLOCK`] numbers long,
/// so that a block is one piece of memory and a plane of it one SIMD vector. The last block is
/// padded; the padding is ignored.
#[derive(Clone, Debug, PartialEq)]
pub struct Gaussians<A> {
    /// Number of Gaussians.
    pub count: usize,
    /// Meaning of the planes.
    pub layout: Layout,
    /// The blocks, one after the other: `len_of_values` numbers.
    pub values: A,
}

/// Length of the values of `count` Gaussians.
pub const fn len_of_values(count: usize, layout: Layout) -> usize {
    count.next_multiple_of(BLOCK) * layout.plane_count()
}

impl<A> Gaussians<A> {
    /// The same Gaussians with other storage.
    pub fn with_values<B>(&self, values: B) -> Gaussians<B> {
        Gaussians { count: self.count, layout: self.layout, values }
    }
    /// Numbers in a block.
    pub fn block_len(&self) -> usize {
        BLOCK * self.layout.plane_count()
    }
    /// Index of a plane's number of one Gaussian.
    pub fn index_of(&self, gaussian: usize, plane: usize) -> usize {
        (gaussian / BLOCK * self.layout.plane_count() + plane) * BLOCK + gaussian % BLOCK
    }
}

/// Error of a change of some of the Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum ChangeError {
    /// Another number of Gaussians, or other planes, than before.
    Shape,
    /// The range ends behind the last Gaussian, or before its start.
    Range {
        /// End of the range.
        end: usize,
        /// Number of Gaussians.
        count: usize,
    },
}

impl core::fmt::Display for ChangeError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Shape => out.write_str(
                "the changed Gaussians have another count or other planes than the uploaded ones; upload all of them",
            ),
            Self::Range { end, count } => write!(out, "a range of Gaussians ends at {end}, but there are {count}"),
        }
    }
}

impl core::error::Error for ChangeError {}

impl<A: AsRef<[f32]>> Gaussians<A> {
    /// Range of the values of the blocks that hold some of these Gaussians, which replace those of
    /// `before`.
    ///
    /// # Errors
    ///
    /// [`ChangeError`] if count or layout differ from those of `before`, or the range is not within
    /// the count.
    pub fn changed_values<B>(&self, before: &Gaussians<B>, range: Range<usize>) -> Result<Range<usize>, ChangeError> {
        if (self.count, self.layout) != (before.count, before.layout) {
            return Err(ChangeError::Shape);
        }
        if range.end > self.count || range.start > range.end {
            return Err(ChangeError::Range { end: range.end, count: self.count });
        }
        let block_len = self.block_len();
        Ok(range.start / BLOCK * block_len..range.end.div_ceil(BLOCK) * block_len)
    }

    /// `N` neighbouring planes of one Gaussian.
    pub fn get<const N: usize>(&self, gaussian: usize, first_plane: usize) -> [f32; N] {
        core::array::from_fn(|k| self.values.as_ref()[self.index_of(gaussian, first_plane + k)])
    }
    /// One plane of every Gaussian, in order.
    pub fn plane(&self, plane: usize) -> impl Iterator<Item = f32> + '_ {
        (0..self.count).map(move |gaussian| self.values.as_ref()[self.index_of(gaussian, plane)])
    }
}

impl<A: AsMut<[f32]>> Gaussians<A> {
    /// Writes `N` neighbouring planes of one Gaussian.
    pub fn set<const N: usize>(&mut self, gaussian: usize, first_plane: usize, numbers: [f32; N]) {
        for (k, number) in numbers.into_iter().enumerate() {
            let index = self.index_of(gaussian, first_plane + k);
            self.values.as_mut()[index] = number;
        }
    }
}

/// Activation of an environment's numbers to radiance ([`crate::environment`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum RadianceActivation {
    /// Numbers are radiance, which a trainer keeps non-negative.
    Identity,
    /// exp(x): positive and unbounded, with the same relative step at every brightness.
    Exponential,
    /// The numbers are the weights of a network ([`crate::light_network`]), which returns the
    /// logarithm of radiance; only [`crate::environment::texels`] gives the texels.
    Network,
}

/// Distant light: a cube map of linear radiance, six faces (+X −X +Y −Y +Z −Z) of resolution² RGB
/// texels, row by row, in the texel order of OpenGL, Vulkan and WebGPU; or a network that is
/// evaluated in such texels.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment<A> {
    /// Texels along an edge of a face.
    pub resolution: usize,
    /// Activation of the numbers.
    pub activation: RadianceActivation,
    /// 6 · resolution² · 3 numbers, or the weights of a network.
    pub values: A,
}

impl<A> Environment<A> {
    /// The same light with other storage.
    pub fn with_values<B>(&self, values: B) -> Environment<B> {
        Environment { resolution: self.resolution, activation: self.activation, values }
    }
    /// Whether the numbers are the weights of a network.
    pub fn is_network(&self) -> bool {
        self.activation == RadianceActivation::Network
    }
    /// Numbers in all texels, or in all weights of a network.
    pub fn len_of_values(&self) -> usize {
        if self.is_network() { WEIGHT_COUNT } else { 6 * self.resolution * self.resolution * 3 }
    }
}

/// An image as planes: `channels` planes of height · width numbers, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<A> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Planes.
    pub channels: usize,
    /// The planes, one after the other.
    pub values: A,
}

impl<A> Image<A> {
    /// Pixels in a plane.
    pub fn pixel_count(&self) -> usize {
        self.width * self.height
    }
}

impl<A: AsRef<[f32]>> Image<A> {
    /// One channel of every pixel.
    pub fn plane(&self, channel: usize) -> &[f32] {
        let size = self.pixel_count();
        &self.values.as_ref()[channel * size..(channel + 1) * size]
    }
    /// The first three channels of a pixel.
    pub fn rgb(&self, pixel: usize) -> [f32; 3] {
        core::array::from_fn(|channel| self.plane(channel)[pixel])
    }
}

impl<A: AsMut<[f32]>> Image<A> {
    /// One channel of every pixel, to be written.
    pub fn plane_mut(&mut self, channel: usize) -> &mut [f32] {
        let size = self.pixel_count();
        &mut self.values.as_mut()[channel * size..(channel + 1) * size]
    }
}
