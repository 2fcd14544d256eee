//! Layers of a rendered view: its colours, or one of their components.

use core::str::FromStr;
use specula_core::{
    color::{linear_from_srgb, srgb_from_linear},
    rules::{Channels, LightLayer, channel},
    scene::{Image, Layout},
    shade::ShadingForm,
};
use specula_io::{
    picture::{self, RgbImage},
    planes::NamedPlane,
};
use specula_train::evaluate::over_background;

/// Picture of one component of a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// Colours over the background.
    Rgb,
    /// World-space normals, 0.5 + 0.5 n.
    Normal,
    /// Distance along the optical axis, red is near.
    Depth,
    /// Coverage, 1 − transmittance.
    Alpha,
    /// Diffuse colour.
    Diffuse,
    /// Tinted reflection.
    Specular,
    /// Residual colour.
    Residual,
    /// Roughness, black is a mirror.
    Roughness,
    /// Specular tint.
    Tint,
    /// Light that reaches the surface along the reflected viewing direction.
    Light,
    /// Albedo of physical materials.
    Albedo,
    /// Metalness of physical materials, white is a metal.
    Metallic,
    /// Share of the light from all directions that reaches the surface, including reflections of
    /// other surfaces; white in the open.
    Ambient,
    /// Share of the distant light along the reflected direction that is not blocked; white in the
    /// open.
    Visibility,
    /// Light of other surfaces along the reflected direction.
    Indirect,
    /// Irradiance of the diffuse layers of physical materials, divided by π: the colour of a white
    /// wall.
    Irradiance,
    /// Every layer.
    All,
}

impl Layer {
    /// Layers in the order of tables and keys, without [`Layer::All`].
    pub const EACH: [Self; 16] = [
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
        Self::Albedo,
        Self::Metallic,
        Self::Ambient,
        Self::Visibility,
        Self::Indirect,
        Self::Irradiance,
    ];

    /// Lower-case name, of folders and options.
    pub fn name(self) -> &'static str {
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
            Self::Albedo => "albedo",
            Self::Metallic => "metallic",
            Self::Ambient => "ambient",
            Self::Visibility => "visibility",
            Self::Indirect => "indirect",
            Self::Irradiance => "irradiance",
            Self::All => "all",
        }
    }

    /// Whether the layer exists for shaded Gaussians only.
    pub fn is_of_shading(self) -> bool {
        !matches!(self, Self::Rgb | Self::Normal | Self::Depth | Self::Alpha | Self::All)
    }

    /// Whether the layer exists for physical materials only.
    pub fn is_of_materials(self) -> bool {
        matches!(self, Self::Albedo | Self::Metallic | Self::Ambient | Self::Irradiance)
    }

    /// Whether the layer exists for this shading of Gaussians with these attributes.
    pub fn exists(self, layout: Layout, form: ShadingForm) -> bool {
        let is_lit_by_pixel = matches!(form, ShadingForm::Deferred | ShadingForm::Physical);
        if self.is_of_materials() {
            layout.is_physical && form == ShadingForm::Physical
        } else if matches!(self, Self::Visibility | Self::Indirect) {
            layout.is_shaded() && is_lit_by_pixel
        } else {
            // Physical materials have no residual colour.
            let is_shown = self != Self::Residual || form != ShadingForm::Physical;
            is_shown && (layout.is_shaded() || !self.is_of_shading())
        }
    }

    /// Requested layers without repetition, in the order of [`Layer::EACH`].
    pub fn expanded(requested: &[Self]) -> Vec<Self> {
        Self::EACH.into_iter().filter(|layer| requested.contains(layer) || requested.contains(&Self::All)).collect()
    }

    /// Light that the rules write to the light channel for this layer.
    pub fn light_layer(self) -> LightLayer {
        match self {
            Self::Visibility => LightLayer::Visibility,
            Self::Indirect => LightLayer::Indirect,
            Self::Irradiance => LightLayer::Irradiance,
            _ => LightLayer::Reflected,
        }
    }

    /// Minimum channels to blend for these layers.
    pub fn channels(layers: &[Self]) -> Channels {
        if layers.iter().any(|layer| layer.is_of_shading()) {
            Channels::Layers
        } else if layers.iter().any(|layer| matches!(layer, Self::Normal | Self::Depth)) {
            Channels::Training
        } else {
            Channels::Color
        }
    }

    /// Picture of a view that was rendered with [`Layer::light_layer`], sRGB with 8 bits a channel.
    /// `background`, sRGB from 0 to 1, lies behind [`Layer::Rgb`] only; `form` determines whether
    /// the shading function adds its terms in linear light.
    pub fn picture(self, image: &Image<Vec<f32>>, form: ShadingForm, background: [f32; 3]) -> RgbImage {
        // The authors' code adds its terms in sRGB, the paper's equation in linear light.
        let is_linear = form != ShadingForm::Official;
        match self {
            Self::Rgb | Self::All => rgb(image, &over_background(image, background)),
            Self::Normal => normals(image),
            Self::Depth => depths(image),
            Self::Alpha => gray(image, &alpha(image)),
            Self::Diffuse | Self::Albedo => colors(image, channel::DIFFUSE, is_linear),
            Self::Specular => colors(image, channel::SPECULAR, is_linear),
            Self::Residual => colors(image, channel::RESIDUAL, is_linear),
            Self::Roughness => gray(image, image.plane(channel::ROUGHNESS)),
            Self::Tint => colors(image, channel::TINT, false),
            Self::Light | Self::Indirect | Self::Irradiance => colors(image, channel::LIGHT, true),
            Self::Visibility => gray(image, image.plane(channel::LIGHT)),
            Self::Metallic => gray(image, image.plane(channel::METALNESS)),
            Self::Ambient => gray(image, image.plane(channel::AMBIENT)),
        }
    }

    /// Numbers of a view that was rendered with [`Layer::light_layer`], by the channels of OpenEXR,
    /// without a background. Without coverage normals are 0 and depths infinite.
    ///
    /// | layer | channels |
    /// |---|---|
    /// | [`Layer::Rgb`] | R, G, B in linear light, premultiplied, and A |
    /// | [`Layer::Normal`] | X, Y, Z of unit normals in the world |
    /// | [`Layer::Depth`] | Z, distance along the optical axis in units of the scene |
    /// | [`Layer::Alpha`] | A, coverage |
    /// | other colours | R, G, B as the shading function has them, premultiplied |
    /// | other numbers | Y, premultiplied |
    pub fn planes(self, image: &Image<Vec<f32>>) -> Vec<NamedPlane> {
        let rgb = |first: usize| -> Vec<NamedPlane> {
            [("R", 0), ("G", 1), ("B", 2)].map(|(name, k)| (name, image.plane(first + k).to_vec())).into()
        };
        let gray = |channel: usize| vec![("Y", image.plane(channel).to_vec())];
        match self {
            Self::Rgb | Self::All => {
                let alpha = alpha(image);
                let mut planes = rgb(0);
                for (_, plane) in &mut planes {
                    plane.iter_mut().zip(&alpha).for_each(|(color, alpha)| *color = linear(*color, *alpha));
                }
                planes.push(("A", alpha));
                planes
            }
            Self::Normal => ["X", "Y", "Z"].into_iter().zip(unit_normals(image)).collect(),
            Self::Depth => vec![("Z", mean_depths(image, &alpha(image)))],
            Self::Alpha => vec![("A", alpha(image))],
            Self::Diffuse | Self::Albedo => rgb(channel::DIFFUSE),
            Self::Specular => rgb(channel::SPECULAR),
            Self::Residual => rgb(channel::RESIDUAL),
            Self::Tint => rgb(channel::TINT),
            Self::Light | Self::Indirect | Self::Irradiance => rgb(channel::LIGHT),
            Self::Roughness => gray(channel::ROUGHNESS),
            Self::Visibility => gray(channel::LIGHT),
            Self::Metallic => gray(channel::METALNESS),
            Self::Ambient => gray(channel::AMBIENT),
        }
    }
}

/// Converts a colour premultiplied in sRGB, as splats are blended, to one premultiplied in linear
/// light.
fn linear(color: f32, alpha: f32) -> f32 {
    if alpha > 0.0 { alpha * linear_from_srgb(color / alpha) } else { 0.0 }
}

impl FromStr for Layer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut names = Self::EACH.into_iter().chain([Self::All]);
        names.find(|layer| layer.name() == text).ok_or_else(|| format!("{text:?} is not a layer"))
    }
}

/// Coverage of each pixel, 1 − transmittance.
pub fn alpha(image: &Image<Vec<f32>>) -> Vec<f32> {
    image.plane(image.channels - 1).iter().map(|transmittance| 1.0 - transmittance).collect()
}

fn rgb(image: &Image<Vec<f32>>, planes: &[f32]) -> RgbImage {
    picture::rgb(image.width, image.height, planes)
}

fn gray(image: &Image<Vec<f32>>, plane: &[f32]) -> RgbImage {
    rgb(image, &[plane, plane, plane].concat())
}

/// Three consecutive channels over black.
fn colors(image: &Image<Vec<f32>>, first: usize, is_linear: bool) -> RgbImage {
    let planes: Vec<f32> = (first..first + 3).flat_map(|channel| image.plane(channel)).copied().collect();
    if is_linear {
        rgb(image, &planes.into_iter().map(srgb_from_linear).collect::<Vec<_>>())
    } else {
        rgb(image, &planes)
    }
}

/// Blended normals, normalised.
fn normals(image: &Image<Vec<f32>>) -> RgbImage {
    picture::normals(image.width, image.height, &unit_normals(image).concat(), &alpha(image))
}

/// Three planes of the blended normals, normalised; 0 where there is none.
fn unit_normals(image: &Image<Vec<f32>>) -> [Vec<f32>; 3] {
    let planes = [0, 1, 2].map(|axis| image.plane(channel::NORMAL + axis));
    let [x, y, z] = planes;
    let scale = |pixel: usize| {
        let length = (x[pixel] * x[pixel] + y[pixel] * y[pixel] + z[pixel] * z[pixel]).sqrt();
        if length > 0.0 { length.recip() } else { 0.0 }
    };
    let scales: Vec<f32> = (0..image.pixel_count()).map(scale).collect();
    planes.map(|plane| plane.iter().zip(&scales).map(|(n, scale)| n * scale).collect())
}

/// Blended depths divided by coverage, as a picture.
fn depths(image: &Image<Vec<f32>>) -> RgbImage {
    let alpha = alpha(image);
    picture::depth(image.width, image.height, &mean_depths(image, &alpha), &alpha)
}

/// Blended depths divided by coverage; infinite where nothing is covered.
fn mean_depths(image: &Image<Vec<f32>>, alpha: &[f32]) -> Vec<f32> {
    let mean = |(depth, alpha): (&f32, &f32)| if *alpha > 0.0 { depth / alpha } else { f32::INFINITY };
    image.plane(channel::DEPTH).iter().zip(alpha).map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_linear_premultiplied_unit_and_in_units_of_the_scene() {
        /// Decoding of a power, in `f32`.
        const ROUNDING: f32 = 1e-6;
        let channels = Channels::Training.count() + 1;
        let mut image = Image { width: 2, height: 1, channels, values: vec![0.0; 2 * channels] };
        // A pixel half covered, at depth 4, whose normals blend to a short one; and an empty one.
        for (channel, number) in [
            (0, 0.25),
            (1, 0.5),
            (2, 0.0),
            (channel::NORMAL, 0.3),
            (channel::NORMAL + 2, -0.4),
            (channel::DEPTH, 2.0),
            (channels - 1, 0.5),
        ] {
            image.plane_mut(channel)[0] = number;
        }
        image.plane_mut(channels - 1)[1] = 1.0;
        let near = |one: f32, other: f32| (one - other).abs() <= ROUNDING || one == other;
        let holds = |layer: Layer, expected: &[(&str, [f32; 2])]| {
            let planes = layer.planes(&image);
            assert_eq!(planes.len(), expected.len(), "{layer:?}");
            for ((name, plane), (wanted, numbers)) in planes.iter().zip(expected) {
                let is_right = name == wanted && plane.iter().zip(numbers).all(|(one, other)| near(*one, *other));
                assert!(is_right, "{layer:?}: {name} {plane:?} is not {wanted} {numbers:?}");
            }
        };
        // An sRGB of one half is 0.21404 in linear light (IEC 61966-2-1).
        holds(Layer::Rgb, &[("R", [0.107_020_6, 0.0]), ("G", [0.5, 0.0]), ("B", [0.0, 0.0]), ("A", [0.5, 0.0])]);
        holds(Layer::Normal, &[("X", [0.6, 0.0]), ("Y", [0.0, 0.0]), ("Z", [-0.8, 0.0])]);
        holds(Layer::Depth, &[("Z", [4.0, f32::INFINITY])]);
        holds(Layer::Alpha, &[("A", [0.5, 0.0])]);
    }
}
