//! Inputs and outputs of the rasteriser.

use crate::error::InputError;
use specula_core::{
    antialias::{BLUR, LowPass, MIP_BLUR},
    executor::OnScreen,
};

/// Gaussians as activated columns, one row for each.
#[derive(Clone, Copy, Debug)]
pub struct Inputs<'a> {
    /// Centres, in world space.
    pub means: &'a [[f32; 3]],
    /// Orientations (w, x, y, z), of any length but zero.
    pub quats: &'a [[f32; 4]],
    /// Standard deviations along the axes, in world units; above zero.
    pub scales: &'a [[f32; 3]],
    /// Opacities, in \[0, 1\]; values outside of \[1e-7, 1 − 1e-7\] count as its ends.
    pub opacities: &'a [f32],
    /// Colours.
    pub colors: Colors<'a>,
}

/// Colours of Gaussians.
#[derive(Clone, Copy, Debug)]
pub enum Colors<'a> {
    /// Red, green and blue of each Gaussian, blended as they are; of any sign.
    Rgb(&'a [[f32; 3]]),
    /// Real spherical harmonics of the direction from the camera to the mean: the colour is
    /// max(Σ Yₖ · coefficientₖ + ½, 0).
    Harmonics {
        /// Highest band that is evaluated, 0–3.
        degree: u8,
        /// K coefficients of each Gaussian, Gaussian by Gaussian, of red, green and blue each: the
        /// array \[N, K, 3\]. K is 1, 4, 9 or 16, and (degree + 1)² or more; bands above the degree
        /// are not read, and get no gradient.
        coefficients: &'a [[f32; 3]],
    },
}

/// Pinhole camera and background of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeView {
    /// Matrix from world to camera, by rows (OpenCV: x to the right, y down, z along the view).
    pub view_matrix: [[f32; 4]; 4],
    /// Intrinsics fx 0 cx, 0 fy cy, 0 0 1, by rows, in pixels; pixel centres at + ½.
    pub intrinsics: [[f32; 3]; 3],
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Colour behind all Gaussians.
    pub background: [f32; 3],
}

/// Depth that is rendered beside colour and alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum DepthMode {
    /// None.
    #[default]
    None,
    /// Σ w z over the Gaussians of a pixel, with their weights w and the depths z of their means.
    Accumulated,
    /// Σ w z / max(Σ w, 1e-10).
    Expected,
}

/// Settings of the rasteriser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Gaussians whose mean is nearer than this are not drawn, in world units; 0.01 by default.
    pub near: f32,
    /// Gaussians whose mean is farther than this are not drawn, in world units; 1e10 by default.
    pub far: f32,
    /// Gaussians whose [radii](Images::radii) are both at most this are not drawn, in pixels; 0 by
    /// default. Above 0, each view is projected once more.
    pub radius_clip: f32,
    /// Variance that splats are widened by, in px²: 0.3, or 0.1 with antialiasing.
    pub eps2d: f32,
    /// Whether the opacity of a splat is multiplied by √(det Σ₂ / det(Σ₂ + eps2d I)).
    pub antialiased: bool,
    /// Depth beside colour and alpha.
    pub depth: DepthMode,
    /// Whether [`Rasterizer::backward`](crate::Rasterizer::backward) returns the gradients of view
    /// matrices.
    pub view_gradients: bool,
    /// Whether [`Rasterizer::backward`](crate::Rasterizer::backward) returns the sums of the
    /// absolute gradients of the splats' centres, for which the tiles are replayed once more.
    pub absolute_gradients: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            near: 0.01,
            far: 1e10,
            radius_clip: 0.0,
            eps2d: BLUR,
            antialiased: false,
            depth: DepthMode::None,
            view_gradients: false,
            absolute_gradients: false,
        }
    }
}

impl Options {
    /// Low-pass of the splats.
    pub(crate) fn low_pass(&self) -> Result<LowPass, InputError> {
        let Self { eps2d, antialiased, .. } = *self;
        [LowPass::Dilated, LowPass::Compensated, LowPass::Mip]
            .into_iter()
            .find(|low_pass| low_pass.variance() == eps2d && low_pass.is_compensated() == antialiased)
            .ok_or(InputError::LowPass { eps2d, antialiased })
    }
    pub(crate) fn check_ranges(&self) -> Result<(), InputError> {
        let Self { near, far, radius_clip, .. } = *self;
        if !(near >= 0.0 && near < far) {
            return Err(InputError::Planes { near, far });
        }
        if radius_clip >= 0.0 { Ok(()) } else { Err(InputError::RadiusClip { radius_clip }) }
    }
}

const _: () = assert!(BLUR == 0.3 && MIP_BLUR == 0.1, "the documentation names both");

/// Pictures of one view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Images {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of each pixel, over the background: height · width · 3 numbers.
    pub rgb: Vec<f32>,
    /// 1 − transmittance of each pixel.
    pub alpha: Vec<f32>,
    /// Depth of each pixel, in world units, without the background; empty with
    /// [`DepthMode::None`].
    pub depth: Vec<f32>,
    /// Each Gaussian on the screen.
    pub splats: Vec<OnScreen>,
}

impl Images {
    /// Half width and half height of the box around each Gaussian in whole pixels, rounded up; zero
    /// for a Gaussian that is not drawn, or whose box misses the picture.
    pub fn radii(&self) -> Vec<[i32; 2]> {
        self.splats.iter().map(|splat| radii_of(splat, [self.width as f32, self.height as f32])).collect()
    }
    /// Gaussians with radii above zero, in order.
    pub fn visible(&self) -> Vec<u32> {
        let radii = self.radii();
        (0..).zip(&radii).filter(|(_, radii)| **radii != [0; 2]).map(|(gaussian, _)| gaussian).collect()
    }
}

/// Half width and half height of the box around a splat in a picture of this size.
pub(crate) fn radii_of(splat: &OnScreen, size: [f32; 2]) -> [i32; 2] {
    let radii = splat.half_extent.map(f32::ceil);
    let touches = |axis: usize| {
        let (center, radius) = (splat.mean2d[axis], radii[axis]);
        radius > 0.0 && center + radius > 0.0 && center - radius < size[axis]
    };
    if touches(0) && touches(1) { radii.map(|radius| radius as i32) } else { [0; 2] }
}

/// Cotangents of the pictures of one view: gradients of a loss. An empty slice is zeros.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cotangents<'a> {
    /// Cotangent of [`Images::rgb`].
    pub rgb: &'a [f32],
    /// Cotangent of [`Images::alpha`].
    pub alpha: &'a [f32],
    /// Cotangent of [`Images::depth`].
    pub depth: &'a [f32],
}

/// Gradients of a loss with respect to the inputs, in their layout; sums over the views.
#[derive(Clone, Debug, PartialEq)]
pub struct InputGradients {
    /// Gradients of the means.
    pub means: Vec<[f32; 3]>,
    /// Gradients of the quats.
    pub quats: Vec<[f32; 4]>,
    /// Gradients of the standard deviations.
    pub scales: Vec<[f32; 3]>,
    /// Gradients of the opacities.
    pub opacities: Vec<f32>,
    /// Gradients of the colours, or of the coefficients of the harmonics.
    pub colors: Vec<[f32; 3]>,
    /// Gradients of each view.
    pub views: Vec<ViewGradients>,
}

/// Gradients of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewGradients {
    /// Gradient of the centre of each splat, in 1/px.
    pub means2d: Vec<[f32; 2]>,
    /// Sum over the pixels of the absolute gradient of the centre of each splat, by axis, in 1/px.
    /// `None` without [`Options::absolute_gradients`].
    pub absolute_means2d: Option<Vec<[f32; 2]>>,
    /// Gradient of the background.
    pub background: [f32; 3],
    /// Gradient of the view matrix, by rows, as if its numbers were independent; its last row is
    /// zero. `None` without [`Options::view_gradients`].
    pub view_matrix: Option<[[f32; 4]; 4]>,
}
