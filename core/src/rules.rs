//! Rendering rules: shading function, prefilter, and the channels of a picture.

use crate::{
    prefilter::{LevelRange, PrefilterScheme},
    scene::{DIFFUSE, Layout, NORMAL_RESIDUAL_1, ROUGHNESS, TINT},
    shade::{ShadingForm, ShadingRules},
};

/// Rendering rules of a scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderRules {
    /// The shading function.
    pub shading: ShadingRules,
    /// The prefilter.
    pub scheme: PrefilterScheme,
    /// Highest band of the spherical harmonics that is used; `None` omits them.
    pub sh_degree: Option<u8>,
    /// Whether residuals are added to normals.
    pub normal_residuals: bool,
    /// Whether light is looked up.
    pub is_lit: bool,
    /// Whether reflected rays are traced against the near field of a light that has one.
    pub traces_near: bool,
    /// True if lamps of a light illuminate physical materials.
    pub illuminates: bool,
    /// The levels of the light that are looked up.
    pub levels: LevelRange,
    /// Requested channels: colour, those of training, or all layers.
    pub channels: Channels,
    /// Light in the channel [`channel::LIGHT`] of all layers.
    pub light_layer: LightLayer,
}

/// Light in the layer of light, for surfaces lit per pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LightLayer {
    /// Light along the reflected direction.
    #[default]
    Reflected,
    /// Part reflected by other surfaces.
    Indirect,
    /// Unoccluded share of the far light along the reflected direction, in all three channels: 1
    /// without occlusion or without light.
    Visibility,
    /// Irradiance / π of a physical material's diffuse layer: that of the far light, times the mean
    /// of its ambient transfer, plus that of lamps; zero for other materials.
    Irradiance,
}

impl LightLayer {
    /// Light layers other than the reflected one; each is rendered as a separate picture on
    /// request.
    pub const OTHERS: [Self; 3] = [Self::Indirect, Self::Visibility, Self::Irradiance];
}

impl RenderRules {
    /// Rules with all terms except a near field and lamps.
    pub const fn full(shading: ShadingRules, scheme: PrefilterScheme, channels: Channels) -> Self {
        Self {
            shading,
            scheme,
            sh_degree: Some(3),
            normal_residuals: true,
            is_lit: true,
            traces_near: false,
            illuminates: false,
            levels: LevelRange::ALL,
            channels,
            light_layer: LightLayer::Reflected,
        }
    }
    /// Whether the light of such a scene is added pixel by pixel, after blending.
    pub fn is_deferred(&self, layout: Layout) -> bool {
        layout.is_shaded() && matches!(self.shading.form, ShadingForm::Deferred | ShadingForm::Physical)
    }
    /// Tests whether lamps light the pixels of such a scene.
    pub fn is_illuminated(&self, layout: Layout) -> bool {
        self.is_lit && self.illuminates && layout.is_shaded() && self.shading.form == ShadingForm::Physical
    }
    /// Channels that must be blended for the requested ones.
    pub fn blended(&self, layout: Layout) -> Channels {
        let is_lit_by_pixel = self.is_lit && self.is_deferred(layout);
        match self.channels {
            // Lamps light the albedo, at the depth of a pixel.
            _ if self.is_illuminated(layout) => Channels::Layers,
            // Rays start at the depth of a pixel.
            Channels::Color if is_lit_by_pixel && self.traces_near => Channels::Surface,
            Channels::Color if is_lit_by_pixel => Channels::Lit,
            Channels::Training if is_lit_by_pixel => Channels::Surface,
            channels => channels,
        }
    }
    /// Tests whether only the surface's own colour is requested, without light.
    pub(crate) fn is_color_alone(&self, layout: Layout) -> bool {
        !self.is_lit && self.blended(layout) == Channels::Color
    }
    /// Harmonics that are read, for each colour: those that are present and in use.
    #[inline]
    pub fn sh_count(&self, layout: Layout) -> usize {
        Layout { sh_degree: self.sh_degree.min(layout.sh_degree), ..layout }.sh_count()
    }
    /// Number of planes that are read of each Gaussian.
    pub fn numbers_read(&self, layout: Layout) -> usize {
        let shading_end = match layout.is_shaded() {
            false => DIFFUSE,
            true if self.is_color_alone(layout) => TINT,
            true if self.normal_residuals => layout.sh_start(),
            true => NORMAL_RESIDUAL_1,
        };
        let is_physical = self.shading.form == ShadingForm::Physical && layout.is_physical;
        let colors = if is_physical && !self.is_color_alone(layout) {
            // Materials replace diffuse colour, tint and harmonics.
            layout.physical_end() - layout.sh_end() - (ROUGHNESS - DIFFUSE)
        } else {
            3 * self.sh_count(layout)
        };
        shading_end + colors + usize::from(layout.is_smoothed)
    }
}

/// Channels of a picture, blended in one pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Channels {
    /// Only colour: 3 channels.
    Color,
    /// Colour, normal, depth and |Δn|²: the 8 channels that the losses read.
    Training,
    /// Colour, normal, tint and roughness: the 10 channels that light per pixel needs.
    Lit,
    /// Channels of training, then tint and roughness: 12 channels.
    Surface,
    /// Channels of a surface, then diffuse, specular, residual and light: 24 channels.
    Layers,
}

impl Channels {
    const ALL: [Self; 5] = [Self::Color, Self::Training, Self::Lit, Self::Surface, Self::Layers];

    /// Number of channels.
    pub const fn count(self) -> usize {
        match self {
            Self::Color => channel::NORMAL,
            Self::Training => channel::TINT,
            Self::Lit => channel::DEPTH + (channel::DIFFUSE - channel::TINT),
            Self::Surface => channel::DIFFUSE,
            Self::Layers => channel::LIGHT + 3,
        }
    }

    /// Channels with this count; `None` if no channels have it.
    pub const fn with_count(count: usize) -> Option<Self> {
        let mut k = 0;
        while k < Self::ALL.len() {
            if Self::ALL[k].count() == count {
                return Some(Self::ALL[k]);
            }
            k += 1;
        }
        None
    }

    /// Channels of an executor's frame, which has this count.
    ///
    /// # Panics
    ///
    /// If no channels have this count.
    pub const fn of_count(count: usize) -> Self {
        match Self::with_count(count) {
            Some(channels) => channels,
            None => panic!("no picture has this number of channels"),
        }
    }

    /// Whether a channel of all layers, as [`mod@channel`] numbers them, is among these.
    #[inline(always)]
    pub const fn contain(self, layer: usize) -> bool {
        self.index_of(layer).is_some()
    }

    /// Index among these channels of a channel of all layers, as [`mod@channel`] numbers them;
    /// `None` if it is not blended.
    #[inline(always)]
    pub const fn index_of(self, layer: usize) -> Option<usize> {
        match self {
            Self::Lit => match layer {
                ..channel::DEPTH => Some(layer),
                channel::TINT..channel::DIFFUSE => Some(layer - channel::TINT + channel::DEPTH),
                _ => None,
            },
            _ if layer < self.count() => Some(layer),
            _ => None,
        }
    }
}

/// First channel of each layer in a picture of all layers; [`Channels::index_of`] gives its place
/// in others.
pub mod channel {
    /// Colour, sRGB-encoded.
    pub const COLOR: usize = 0;
    /// World-space normal.
    pub const NORMAL: usize = 3;
    /// Depth along the optical axis.
    pub const DEPTH: usize = 6;
    /// |Δn|².
    pub const RESIDUAL_SIZE: usize = 7;
    /// Specular tint.
    pub const TINT: usize = 8;
    /// Perceptual roughness.
    pub const ROUGHNESS: usize = 11;
    /// Activated diffuse colour, linear.
    pub const DIFFUSE: usize = 12;
    /// Tint times specular light, linear.
    pub const SPECULAR: usize = 15;
    /// Residual colour, linear.
    pub const RESIDUAL: usize = 18;
    /// Metalness, instead of the residual colour if materials are physical.
    pub const METALNESS: usize = RESIDUAL;
    /// Mean of the ambient transfer of physical materials.
    pub const AMBIENT: usize = RESIDUAL + 1;
    /// Prefiltered light on the surface, linear.
    pub const LIGHT: usize = 21;
}
