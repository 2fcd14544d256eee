//! What a rendered view shows: its colours, or one of the layers that they are made of.

use crate::background::Background;
use clap::ValueEnum;
use specula_core::{
    color::srgb_from_linear,
    plan::{Channels, channel},
    scene::Image,
    shade::ShadingForm,
};
use specula_io::picture::{self, RgbImage};
use specula_train::evaluate::over_background;

/// A picture that can be made of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Layer {
    /// What an eye sees.
    Rgb,
    /// World-space normals, 0.5 + 0.5 n.
    Normal,
    /// Distance along the optical axis, near is red.
    Depth,
    /// Coverage.
    Alpha,
    /// Diffuse colour.
    Diffuse,
    /// Reflected light, tinted.
    Specular,
    /// Residual colour.
    Residual,
    /// Roughness, mirrors are black.
    Roughness,
    /// Specular tint.
    Tint,
    /// Light that reaches the surface along the reflected view.
    Light,
    /// All of them.
    All,
}

impl Layer {
    const EACH: [Self; 10] = [
        Self::Rgb,
        Self::Normal,
        Self::Depth,
        Self::Alpha,
        Self::Diffuse,
        Self::Specular,
        Self::Residual,
        Self::Roughness,
        Self::Tint,
        Self::Light,
    ];

    /// The name, as typed.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Normal => "normal",
            Self::Depth => "depth",
            Self::Alpha => "alpha",
            Self::Diffuse => "diffuse",
            Self::Specular => "specular",
            Self::Residual => "residual",
            Self::Roughness => "roughness",
            Self::Tint => "tint",
            Self::Light => "light",
            Self::All => "all",
        }
    }

    /// Whether only shaded Gaussians have it.
    pub(crate) fn is_of_shading(self) -> bool {
        !matches!(self, Self::Rgb | Self::Normal | Self::Depth | Self::Alpha | Self::All)
    }

    /// Each layer once, in order.
    pub(crate) fn expanded(asked: &[Self]) -> Vec<Self> {
        Self::EACH.into_iter().filter(|layer| asked.contains(layer) || asked.contains(&Self::All)).collect()
    }

    /// What has to be blended to show these layers.
    pub(crate) fn channels(layers: &[Self]) -> Channels {
        if layers.iter().any(|layer| layer.is_of_shading()) {
            Channels::Layers
        } else if layers.iter().any(|layer| matches!(layer, Self::Normal | Self::Depth)) {
            Channels::Training
        } else {
            Channels::Color
        }
    }

    /// The layer of a rendered view.
    pub(crate) fn picture(self, image: &Image<Vec<f32>>, form: ShadingForm, background: Background) -> RgbImage {
        // The authors' equation adds its terms as they are shown; the paper's adds linear light.
        let is_linear = form != ShadingForm::Official;
        match self {
            Self::Rgb | Self::All => rgb(image, &over_background(image, background.0)),
            Self::Normal => normals(image),
            Self::Depth => depths(image),
            Self::Alpha => gray(image, &alpha(image)),
            Self::Diffuse => light(image, channel::DIFFUSE, is_linear),
            Self::Specular => light(image, channel::SPECULAR, is_linear),
            Self::Residual => light(image, channel::RESIDUAL, is_linear),
            Self::Roughness => gray(image, image.plane(channel::ROUGHNESS)),
            Self::Tint => light(image, channel::TINT, false),
            Self::Light => light(image, channel::LIGHT, true),
        }
    }
}

/// Coverage of each pixel: what light does not pass.
pub(crate) fn alpha(image: &Image<Vec<f32>>) -> Vec<f32> {
    image.plane(image.channels - 1).iter().map(|transmittance| 1.0 - transmittance).collect()
}

fn rgb(image: &Image<Vec<f32>>, planes: &[f32]) -> RgbImage {
    picture::rgb(image.width, image.height, planes)
}

fn gray(image: &Image<Vec<f32>>, plane: &[f32]) -> RgbImage {
    rgb(image, &[plane, plane, plane].concat())
}

/// Three channels over black.
fn light(image: &Image<Vec<f32>>, first: usize, is_linear: bool) -> RgbImage {
    let planes: Vec<f32> = (first..first + 3).flat_map(|channel| image.plane(channel)).copied().collect();
    if is_linear {
        rgb(image, &planes.into_iter().map(srgb_from_linear).collect::<Vec<_>>())
    } else {
        rgb(image, &planes)
    }
}

/// Blended normals, made unit.
fn normals(image: &Image<Vec<f32>>) -> RgbImage {
    let [x, y, z] = [0, 1, 2].map(|axis| image.plane(channel::NORMAL + axis));
    let scale: Vec<f32> = (0..image.pixel_count())
        .map(|pixel| {
            let length = (x[pixel] * x[pixel] + y[pixel] * y[pixel] + z[pixel] * z[pixel]).sqrt();
            if length > 0.0 { length.recip() } else { 0.0 }
        })
        .collect();
    let planes: Vec<f32> =
        [x, y, z].into_iter().flat_map(|plane| plane.iter().zip(&scale).map(|(n, s)| n * s)).collect();
    picture::normals(image.width, image.height, &planes, &alpha(image))
}

/// Blended depths, divided by the coverage.
fn depths(image: &Image<Vec<f32>>) -> RgbImage {
    let alpha = alpha(image);
    let depths: Vec<f32> = image.plane(channel::DEPTH).iter().zip(&alpha).map(|(depth, alpha)| depth / alpha).collect();
    picture::depth(image.width, image.height, &depths, &alpha)
}
